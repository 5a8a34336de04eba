"""Joints smoothed together, along the directions in which they turn together.

A clip's rotations are unrolled about a first estimate q̂ of them (Jupp & Kent 1987):

    Φ_t = Σ log(q̂_{t-1}⁻¹ q̂_t)       y_t = Φ_t + log(q̂_t⁻¹ q_t)       3J numbers a frame

What is white noise in q is white in y and, over every joint's own noise σ_j, as large in every
direction. So y is turned by an orthogonal matrix into columns whose noise is independent, and each
is smoothed by itself, λ, σ and heavy tails learned from it, O(T). A joint that found no noise is
taken to have a third of the noisiest joint's, and no column has more than that joint. The result x
goes back as q̂_t exp(x_t - Φ_t). The matrix is of the principal directions of

    Q/tr Q + P/(10 tr P)       Q the prior's covariance of accelerations, P that of q̂

P gives the clip a say in its directions: an error or a move that no other clip has, in one joint,
would otherwise be spread over all. O(T·J² + J³).

A sample of weight w counts w times as much: what is missing is q̂ itself (one step of EM), and a
frame weighs as much as its most trusted joint.

Jupp & Kent 1987, "Fitting smooth paths to spherical data" (unrolling).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmotion import quaternion
from jaxmotion._types import AnyArray
from jaxmotion.displacement import minus
from jaxmotion.motion import Motion
from jaxmotion.smoothing.lgs import lgs
from jaxmotion.smoothing.tuning import tune_signal

_OWN = 0.1  # the clip's say in its directions
_APART = 3.0  # how many times less than the noisiest joint's a joint's noise may be


def smoothed_together(
    motion: Motion,
    first: Motion,
    sigma: Float[AnyArray, " joint"],
    covariance: Float[AnyArray, "axis axis"],
    weights: Array | None,
) -> Motion:
    """``motion`` smoothed along the directions of a prior.

    **Arguments:** ``first``: the clip smoothed joint by joint; ``sigma``: every joint's noise about
    each axis, radians; ``covariance``: of its joints' accelerations
    (``MotionPrior.of``); ``weights``: f[T] or f[T, J], or None.
    **Returns:** a motion with the translations of ``first``.
    """
    frames, joints = motion.rotations.shape[:2]
    steps = quaternion.log(quaternion.between(first.rotations[:-1], first.rotations[1:]))
    start = jnp.zeros((1, joints, 3), steps.dtype)
    path = jnp.concatenate([start, jnp.cumsum(steps, axis=0)])
    noise = minus(motion, first).rotations
    seen = jnp.ones(frames, path.dtype)
    if weights is not None:
        share = weights.reshape(frames, -1) / jnp.maximum(jnp.max(weights, axis=0), 1e-30)
        seen = jnp.max(share, axis=1)
        share = share / jnp.where(seen > 0, seen, 1)[:, None]
        noise = jnp.where(share[:, :, None] > 0, share[:, :, None] * noise, 0)
    rounding = 64 * float(jnp.finfo(path.dtype).eps)
    turns = jnp.max(jnp.abs(path), axis=(0, 2)) + jnp.max(jnp.abs(noise), axis=(0, 2)) > rounding
    path, noise = (jnp.where(turns[:, None], v, 0) for v in (path, noise))
    most = jnp.max(jnp.where(turns, sigma, 0))
    unit = jnp.where(turns, jnp.maximum(sigma, most / _APART), 1)[:, None]

    def unrolled(x: Array) -> Array:
        return (x / unit).reshape(frames, -1)

    counts = (seen[:-2] > 0) & (seen[1:-1] > 0) & (seen[2:] > 0)
    bends = jnp.where(counts[:, None], jnp.diff(unrolled(path), n=2, axis=0), 0)
    scale = jnp.repeat(jnp.where(turns, 1 / unit[:, 0], 0), 3)
    along = _directions(covariance * scale[:, None] * scale, bends)
    y = unrolled(path + noise) @ along
    middle = seen @ y / jnp.sum(seen)  # rounding is of what is left
    learned = tune_signal(y - middle, weights=seen, prior="student", most=_APART)
    firm = learned.stiffness
    x = middle + lgs(y - middle, learned.lam, learned.sigma, stiffness=firm, weights=seen).mean
    turn = quaternion.exp((x @ along.T).reshape(frames, joints, 3) * unit - path)
    return first.with_transforms(rotations=quaternion.multiply(first.rotations, turn))


def _directions(shared: Array, bends: Array) -> Array:
    """The columns of an orthogonal matrix, of a covariance and a clip's own f[T-2, 3J]; an axis
    that is 0 in both is a column by itself."""
    own = bends.T @ bends

    def per_trace(x: Array) -> Array:
        trace = jnp.trace(x)
        return x / jnp.where(trace > 0, trace, 1)

    both = per_trace(shared) + _OWN * per_trace(own)
    return jnp.linalg.eigh(jax.lax.stop_gradient(both))[1]
