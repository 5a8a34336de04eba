"""Linear time-invariant filters for motions (Lee & Shin 2001, §3.1, Eq. 4–6).

    F(p_i) = Σ_m a_m p_{i+m}                        translations
    H(q_i) = q_i · exp(Σ_{m=−k}^{k−1} b_m ω_{i+m})   rotations,  ω_i = log(q_i⁻¹ q_{i+1})
    b_m = Σ_{j>m} a_j for m ≥ 0,  −Σ_{j≤m} a_j for m < 0

a is a mask with Σa = 1 (:mod:`~jaxmotion.multiresolution.masks`). F is the same as p_i plus b over
the steps p_{i+1} − p_i, and that is how it is computed: a constant stays one to the last bit. Past
the ends the *steps* are mirrored (Eq. 6), so steady motion stays steady.

a·H(q)·b = H(a·q·b) for any rotations a, b; shifting or (symmetric masks) reversing time commutes
with H; log H is the vector mask of log q up to second order, and exactly for one axis.

O(T·J·k), differentiable in q, the mask and its times. Sharp bits: steps take the short way round,
so q and −q filter alike, and a joint that turns by π between two frames has no defined step.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion._checks import known, no_module, require
from jaxmotion._entry import finite_clip
from jaxmotion._types import AnyArray, ArrayLike, Quaternion
from jaxmotion.frames.ends import steps_around
from jaxmotion.motion import Motion
from jaxmotion.multiresolution.kernels import quaternions_of, rotations_of, steps, turned
from jaxmotion.multiresolution.poses import aligned
from jaxmotion.quaternion.parts import together


def orientation_filter(q: Quaternion, mask: ArrayLike) -> Quaternion:
    """H(q): rotations over time through a mask.

    Lee & Shin 2001, Eq. 5, 6.

    **Arguments:** ``q``: f[T, ..., 4], unit; ``mask``: a₋ₖ … aₖ, f[2k + 1], or f[T, 2k + 1] with a
    row a frame. Its sum is 1; the middle coefficient is taken to be what makes it so.
    **Returns:** f[T, ..., 4], neighbours in one hemisphere.
    **Raises:** ``ValueError`` for a mask of even width, another number of rows or another sum; at
    run time for the sum of a traced mask.
    """
    no_module("orientation_filter: q", q)
    q = jnp.asarray(q)
    return _orientation_filter(q, _step_weights(mask, q.shape[0], q.dtype, "orientation_filter"))


def vector_filter(x: Float[AnyArray, "time *rest"], mask: ArrayLike) -> Float[Array, "time *rest"]:
    """F(x): vectors over time through a mask.

    Lee & Shin 2001, Eq. 4; past the ends the steps are mirrored, Eq. 6.

    **Arguments:** ``x``: f[T, ...], in any unit; ``mask``: as :func:`orientation_filter`.
    **Returns:** f[T, ...], in the same unit.
    **Raises:** ``ValueError``, or at run time, as :func:`orientation_filter`.
    """
    no_module("vector_filter: x", x)
    x = jnp.asarray(x)
    return _vector_filter(x, _step_weights(mask, x.shape[0], x.dtype, "vector_filter"))


def filter_motion(motion: Motion, mask: ArrayLike) -> Motion:
    """Every joint's translation and rotation through a mask.

    By :func:`vector_filter` and :func:`orientation_filter`. Lee & Shin 2001, Eq. 4–6.

    **Arguments:** ``motion``: T frames, one clip; ``mask``: f[2k + 1] or f[T, 2k + 1], as
    :func:`orientation_filter`.
    **Returns:** a motion of the same shape.
    **Raises:** ``ValueError`` for what is not one clip of finite numbers; otherwise as
    :func:`orientation_filter`.
    """
    finite_clip("filter_motion", motion)
    weights = _step_weights(mask, motion.num_frames, motion.dtype, "filter_motion")
    return motion.with_transforms(
        _vector_filter(jnp.asarray(motion.translations), weights),
        _orientation_filter(jnp.asarray(motion.rotations), weights),
    )


@eqx.filter_jit
def _orientation_filter(q: Array, weights: Array) -> Array:
    rotations = rotations_of(q)
    if len(q) < 2:
        return together(quaternions_of(rotations))
    rotations, omega = steps(rotations)
    change = tuple(_weighted(x, weights) for x in omega)
    unscaled = jnp.ones(q.shape[1:-1], q.dtype)
    return together(quaternions_of(aligned(turned(rotations, change, unscaled))))


@eqx.filter_jit
def _vector_filter(x: Array, weights: Array) -> Array:
    return x + _weighted(x[1:] - x[:-1], weights) if len(x) > 1 else x


def _weighted(steps: Array, weights: Array) -> Array:
    """Σ_m b_m ω_{i+m} for every frame i: f[T − 1, ...] to f[T, ...]; ``weights`` b, f[2k] or
    f[T, 2k]."""
    frames, width = steps.shape[0] + 1, weights.shape[-1]
    if width == 0:
        return jnp.zeros((frames, *steps.shape[1:]), steps.dtype)
    index = steps_around(frames - 1, width // 2, width // 2)
    outside = width // 2, width // 2 + frames - 1
    longer = jnp.concatenate([steps[index[: outside[0]]], steps, steps[index[outside[1] :]]])
    column = (-1,) + (1,) * (steps.ndim - 1)
    return sum(
        (weights[..., m].reshape(column) * longer[m : m + frames] for m in range(width)),
        start=jnp.zeros((), steps.dtype),
    )


def _step_weights(mask: ArrayLike, frames: int, dtype, caller: str) -> Array:
    """b of a mask a: one weight a step, f[2k] or f[T, 2k]."""
    shape = np.shape(mask)
    if shape[-1:] == () or shape[-1] % 2 == 0 or shape[:-1] not in ((), (frames,)):
        raise ValueError(
            f"{caller}: mask has shape {shape}; expected an odd number of coefficients, "
            f"(2k + 1,) or ({frames}, 2k + 1) with a row a frame"
        )
    sums = known(mask).sum(-1)
    wrong = ~(abs(sums - 1) <= 1e-4).all()
    message = f"{caller}: the mask must sum to 1, so that poses stay"
    mask = require(jnp.asarray(mask, dtype), wrong, message, got=sums)
    half = shape[-1] // 2
    left = -jnp.cumsum(mask[..., :half], axis=-1)
    right = jnp.flip(jnp.cumsum(jnp.flip(mask[..., half + 1 :], -1), axis=-1), -1)
    return jnp.concatenate([left, right], axis=-1)
