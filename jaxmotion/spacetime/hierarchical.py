"""Hierarchical B-spline fitting: contacts met by splines with ever finer knots.

    for levels h = 0, 1, ..       knots s_h frames apart, s_h = max(T / 2^h, 1)
        d_t      the pose that meets frame t's rows by itself, minus the pose it has
        phi_k  = sum_t w_t B_k(t)^2 (B_k(t) d_t / sum_j B_j(t)^2) / sum_t w_t B_k(t)^2
        q_t   <- q_t exp(sum_k B_k(t) phi_k)          levels are composed, not summed

d_t: damped least squares with a damping per frame (Levenberg and Marquardt), from the pose so far;
B_k: uniform cubic B-splines; w_t: the firmest weight of frame t, contacts' ramps included (1 where
limits or a floor are kept, which any frame may break). A spline takes only the smooth part of what
is missing and leaves the rest to finer levels. Source: Lee and Shin, *A hierarchical approach to
interactive motion editing for human-like figures* (1999); the fit is Lee, Wolberg and Shin's
(1997).

Cost O(T d r^2) a level for r rows on d unknowns, log2(T) + 5 levels. Derivatives are those of the
steps taken.
"""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxmotion import quaternion
from jaxmotion.spacetime.problem import Problem

_POSE_STEPS = 6
_LAST_LEVELS = 5  # on the finest knots, which approximate but do not interpolate


def hierarchical(
    problem: Problem,
) -> tuple[Float[Array, "time d"], Int[Array, ""], Bool[Array, ""]]:
    """(z, levels, True): the displacement as one, and how many levels it took."""
    weight, frames = _weight(problem), problem.start.num_frames
    depth = max(0, math.ceil(math.log2(frames)))
    spacings = np.maximum(frames / 2.0 ** np.arange(depth + _LAST_LEVELS), 1.0)

    def level(clip, spacing):
        here = eqx.tree_at(lambda p: p.start, problem, problem.start.with_transforms(*clip))
        smooth = _spline(_pose(here), weight, spacing)
        moved = here.motion(smooth)
        return (moved.translations, quaternion.normalize(moved.rotations)), None

    start = problem.start.translations, problem.start.rotations
    clip, _ = lax.scan(level, start, jnp.asarray(spacings, problem.start.dtype))
    z = problem.displacement(problem.start.with_transforms(*clip))
    return z, jnp.asarray(len(spacings), jnp.int32), jnp.asarray(True)


def _weight(problem: Problem) -> Float[Array, " time"]:
    """w_t."""
    firmest = jnp.zeros_like(problem.unmoved[:, 0])
    for term in problem.terms:
        if term.firmness is None:
            return jnp.ones_like(firmest)
        firmest = jnp.maximum(firmest, term.firmness)
    return firmest / jnp.maximum(jnp.max(firmest), jnp.finfo(firmest.dtype).tiny)


def _pose(problem: Problem) -> Float[Array, "time d"]:
    """d: each frame's displacement to where its own rows vanish, or come closest to it."""

    def step(state, _):
        z, rows, jacobian, damping = state
        gram = jnp.einsum("trd,tsd->trs", jacobian, jacobian)
        gram = gram + damping[:, None, None] * jnp.eye(rows.shape[1], dtype=z.dtype)
        force = jnp.linalg.solve(gram, rows[..., None])[..., 0]
        tried = z - jnp.einsum("trd,tr->td", jacobian, force)
        tried_rows, tried_jacobian = problem.linearized(tried)
        better = jnp.sum(tried_rows**2, axis=1) <= jnp.sum(rows**2, axis=1)
        new = (tried, tried_rows, tried_jacobian)
        z, rows, jacobian = (
            jnp.where(jnp.expand_dims(better, tuple(range(1, a.ndim))), a, b)
            for a, b in zip(new, (z, rows, jacobian), strict=True)
        )
        return (z, rows, jacobian, damping * jnp.where(better, 0.3, 8.0).astype(z.dtype)), None

    unmoved = problem.unmoved
    damping = jnp.broadcast_to(problem.prior.size, unmoved.shape[:1])
    state = (unmoved, *problem.linearized(unmoved), damping)
    return lax.scan(step, state, None, length=_POSE_STEPS)[0][0]


def _spline(
    data: Float[Array, "time d"], weight: Float[Array, " time"], spacing: Float[Array, ""]
) -> Float[Array, "time d"]:
    """The B-spline of the module's phi, at every frame."""
    frames = data.shape[0]
    place = jnp.arange(frames, dtype=data.dtype) / spacing
    knot = jnp.floor(place)
    u = (place - knot)[:, None]
    basis = (
        jnp.concatenate(
            [(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3], axis=1
        )
        / 6
    )
    index = knot.astype(jnp.int32)[:, None] + jnp.arange(4, dtype=jnp.int32)
    share = weight[:, None] * basis**2
    wanted = (basis / jnp.sum(basis**2, axis=1, keepdims=True))[..., None] * data[:, None]
    total = jnp.zeros((frames + 4,), data.dtype).at[index].add(share)
    summed = jnp.zeros((frames + 4, data.shape[1]), data.dtype)
    summed = summed.at[index].add(share[..., None] * wanted)
    some = total > 0
    coefficients = jnp.where(some[:, None], summed / jnp.where(some, total, 1)[:, None], 0)
    return jnp.einsum("tk,tkd->td", basis, coefficients[index])
