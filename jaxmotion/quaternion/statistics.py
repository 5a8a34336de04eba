"""Mean and standard deviation of rotations.

Three means of samples q_n with weights w_n ≥ 0:

    karcher    argmin_m Σ w_n ‖log(m⁻¹q_n)‖²           the intrinsic mean; Newton's method
    chordal    argmax_m mᵀ(Σ w_n q_n q_nᵀ)m             an eigenvector; cheapest, ignores signs
    recursive  m_1 = q_1, m_n = slerp(m_{n−1}, q_n, w_n/Σ_{k≤n} w_k)    Wu et al. 2006 (1/n, not
               the printed (n−1)/n); depends on the order of the samples

and std = √(Σ w_n ‖log(m⁻¹q_n)‖² / Σ w_n), a full angle in radians (Wu's σ is half of it).

The iterations run on constants; one last Newton step from the converged point carries the
derivative. Its residual is zero there, so first derivatives are exact in both modes and nothing
is unrolled. O(n) a step.
"""

from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmotion._checks import one_of
from jaxmotion._numerics import rounding_angle, safe_norm, safe_sqrt, series_switch
from jaxmotion._program import one_program
from jaxmotion._types import ArrayLike, Quaternion
from jaxmotion.quaternion.algebra import between, ending_in, leading_axis, multiply, normalize
from jaxmotion.quaternion.explog import exp, log
from jaxmotion.quaternion.interpolate import slerp

_NEWTON_STEPS = 30


@one_program("axis", "method")
def mean(
    q: Quaternion,
    weights: ArrayLike | None = None,
    *,
    axis: int = 0,
    method: Literal["karcher", "recursive", "chordal"] = "karcher",
) -> Quaternion:
    """Mean rotation along ``axis``.

    O(n) a step; first derivatives are exact in both modes. Source: Wu et al. 2006 ("recursive").

    **Arguments:** ``q``: f[..., 4], unit; ``weights``: ≥ 0, one a sample, either 1-D along ``axis``
    or broadcasting with q's leading axes; all zero counts as all equal; ``axis``: of the samples,
    not the last; ``method``: "karcher" (least squares of angles), "recursive" (by slerp, sample
    after sample) or "chordal" (an eigenvector: cheapest, ignores signs).
    **Returns:** q's shape without ``axis``, on the hemisphere of the first sample ("recursive"
    begins there).
    **Raises:** ``ValueError`` for an unknown method, a last axis that is not 4, an axis that is
    none before the last, or no samples.
    """
    one_of("mean: method", method, ("karcher", "recursive", "chordal"))
    samples, w = _samples(q, weights, axis)
    if method == "recursive":
        return _recursive(samples, w)
    result = _chordal(samples, w) if method == "chordal" else _karcher(samples, w)
    return jnp.where(jnp.sum(result * samples[0], -1, keepdims=True) < 0, -result, result)


@one_program("axis", "method")
def std(
    q: Quaternion,
    mean: Quaternion | None = None,
    weights: ArrayLike | None = None,
    *,
    axis: int = 0,
    method: Literal["karcher", "recursive", "chordal"] = "karcher",
) -> Float[Array, "..."]:
    """Standard deviation of rotations about their mean; 0 with gradient 0 for equal samples.

    O(n) a step. Source: Wu et al. 2006, §5, whose σ is half of it.

    **Arguments:** ``q``: f[..., 4], unit; ``mean``: the centre, computed by ``method`` when absent;
    ``weights``, ``axis``, ``method``: as :func:`mean`.
    **Returns:** q's shape without ``axis`` and components, in radians.
    **Raises:** as :func:`mean`.
    """
    q = jnp.asarray(q)
    samples, w = _samples(q, weights, axis)
    centre = _mean(q, weights, axis=axis, method=method) if mean is None else mean
    deviation = log(between(centre, samples))
    variance = jnp.sum(w * jnp.sum(deviation**2, -1), 0)
    return safe_sqrt(variance, rounding_angle(q.dtype) ** 2)


_mean = mean  # ``std`` has an argument of that name


def _samples(q, weights, axis):
    """Samples along axis 0 and weights that sum to 1 along it, of the samples' batch rank."""
    q = ending_in(q, (4,), "mean, std: q")
    axis = leading_axis(axis, q.shape, "mean, std")
    if q.shape[axis] == 0:
        raise ValueError(f"mean, std: q of shape {q.shape} has no samples along axis {axis}")
    samples = jnp.moveaxis(q, axis, 0)
    shape = samples.shape[:-1]
    if weights is None:
        w = jnp.ones(shape, q.dtype)
    else:
        w = jnp.asarray(weights, q.dtype)
        if w.ndim == 1 and w.shape[0] == shape[0]:
            w = w.reshape((-1,) + (1,) * (len(shape) - 1))
        else:
            w = jnp.moveaxis(jnp.broadcast_to(w, q.shape[:-1]), axis, 0)
        w = jnp.broadcast_to(w, shape)
    w = jnp.where(jnp.sum(w, 0) > 0, w, 1.0)
    return samples, w / jnp.sum(w, 0)


def _chordal(samples: Quaternion, w: Float[Array, "n ..."]) -> Quaternion:
    scatter = jnp.einsum("n...,n...i,n...j->...ij", w, samples, samples)
    fixed = jax.lax.stop_gradient(scatter)
    values, vectors = jnp.linalg.eigh(fixed)
    m, top = vectors[..., -1], values[..., -1, None]
    residual = jnp.einsum("...ij,...j->...i", scatter, m) - top * m
    # One step of (top·I − scatter)⁺ in the eigenvectors' own basis. Directions as good as m (a
    # mean that is not unique) have no derivative and are left out.
    gap = top - values
    distinct = gap > 16 * jnp.finfo(m.dtype).eps * top
    along = jnp.einsum("...ik,...i->...k", vectors, residual)
    along = jnp.where(distinct, along / jnp.where(distinct, gap, 1.0), 0.0)
    return normalize(m + jnp.einsum("...ik,...k->...i", vectors, along))


def _karcher(samples: Quaternion, w: Float[Array, "n ..."]) -> Quaternion:
    fixed, fixed_w = jax.lax.stop_gradient((samples, w))

    def unconverged(state):
        i, _, size = state
        return (i < _NEWTON_STEPS) & (size > 4 * jnp.finfo(samples.dtype).eps)

    def iterate(state):
        i, m, _ = state
        delta = _newton_step(m, fixed, fixed_w)
        return i + 1, normalize(multiply(m, exp(delta))), jnp.max(safe_norm(delta), initial=0)

    start = (0, _chordal(fixed, fixed_w), jnp.array(jnp.inf, samples.dtype))
    m = jax.lax.stop_gradient(jax.lax.while_loop(unconverged, iterate, start)[1])
    return multiply(m, exp(_newton_step(m, samples, w)))


def _newton_step(m: Quaternion, samples: Quaternion, w: Float[Array, "n ..."]):
    """δ that zeroes, to first order, the weighted mean of log(exp(−δ) m⁻¹ q_n).

    With v_n = log(m⁻¹q_n) of length θ_n, δ = H⁻¹ Σ w_n v_n, where
    H = I − Σ w_n c_n (θ_n² I − v_n v_nᵀ), c = (1 − θ/2·cot θ/2)/θ², is the slope at the mean.
    """
    v = log(between(m, samples))
    fixed = jax.lax.stop_gradient(v)
    squared = jnp.sum(fixed**2, -1)
    near = squared < series_switch(v.dtype)
    safe = jnp.where(near, 1.0, squared)
    half = 0.5 * jnp.sqrt(safe)
    c = jnp.where(near, 1 / 12 + squared / 720, (1.0 - half / jnp.tan(half)) / safe)
    share = jax.lax.stop_gradient(w) * c
    flat = 1.0 - jnp.sum(share * squared, 0)
    slope = jnp.einsum("n...,n...i,n...j->...ij", share, fixed, fixed)
    slope = slope + flat[..., None, None] * jnp.eye(3, dtype=v.dtype)
    return jnp.linalg.solve(slope, jnp.sum(w[..., None] * v, 0)[..., None])[..., 0]


def _recursive(samples: Quaternion, w: Float[Array, "n ..."]) -> Quaternion:
    seen = jnp.cumsum(w, 0)
    share = w / jnp.where(seen > 0, seen, 1.0)

    def step(m, sample):
        q, t = sample
        return slerp(m, q, t), None

    return jax.lax.scan(step, samples[0], (samples[1:], share[1:]))[0]
