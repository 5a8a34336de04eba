"""Soft dynamic time warping: a smooth loss between two clips, and the alignment it expects.

    soft_dtw(D, γ) = −γ log Σ_paths exp(−Σ_t D[i_t, j_t] / γ)
    R(i, j)        = D[i, j] + softmin_γ(R(i−1, j−1), R(i−1, j), R(i, j−1)),   R(0, 0) = D[0, 0]
    E[i, j]        = ∂ soft_dtw / ∂D[i, j] = chance that a path drawn ∝ exp(−cost/γ) visits (i, j)
    ∂ soft_dtw/∂γ  = (soft_dtw − ⟨E, D⟩) / γ

Paths step by (1, 0), (0, 1) and (1, 1) from (0, 0) to the last cell. D ``(n, m)`` is a cost matrix,
by default squared Euclidean distances; γ > 0 has its unit. As γ → 0 the value falls on that of
``dtw`` from below and E becomes its path; with larger γ more paths take part, and the value may be
negative. Cost O(n m) time and memory.

Sources: Cuturi & Blondel 2017, algorithms 1 and 2; Mensch & Blondel 2018 for E as an expectation.

E is found with a second sweep from the end, which passes each cell's chance back along the softmin
weights of the first; both sweeps take an anti-diagonal at a time and subtract the least of three
before exponentiating. The value's derivative is E itself, in both modes; E is made of ordinary
operations, so it can be differentiated again. Beyond ``x_length``, ``y_length`` it is zero.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer
from jaxtyping import Array, Float

from jaxmotion._types import ArrayLike
from jaxmotion.timing.accumulate import shift_in, skew, unskew
from jaxmotion.timing.frame_distance import Metric, local_cost


def soft_dtw(
    x: ArrayLike | None = None,
    y: ArrayLike | None = None,
    gamma: ArrayLike = 1.0,
    *,
    cost: ArrayLike | None = None,
    metric: Metric = "sqeuclidean",
    x_length: ArrayLike | None = None,
    y_length: ArrayLike | None = None,
) -> Float[Array, ""]:
    """Soft minimum over all warps of x onto y of the summed frame distances; a training loss.

    Args:
        x: features ``(n, f)``, or local rotations ``(n, J, 4)`` with ``metric="pose"``.
        y: features ``(m, f)`` or rotations ``(m, J, 4)``.
        gamma: temperature > 0, in the unit of the cost; differentiable.
        cost: a cost matrix ``(n, m)`` instead of x and y.
        metric: distance of two frames; see :func:`frame_distance`.
        x_length: frames of x that count when it is padded (``pad_to_bucket``); may be traced.
        y_length: the same for y.

    Returns:
        The value, in the unit of the cost. One pair; use ``jax.vmap`` for many. Differentiable in
        x, y, cost and gamma in both modes, to any order.

    Raises:
        ValueError: bad shapes, or a gamma that is not positive (when it is not traced).
    """
    return _soft_value(*_prepare(x, y, gamma, cost, metric, x_length, y_length))


def soft_alignment(
    x: ArrayLike | None = None,
    y: ArrayLike | None = None,
    gamma: ArrayLike = 1.0,
    *,
    cost: ArrayLike | None = None,
    metric: Metric = "sqeuclidean",
    x_length: ArrayLike | None = None,
    y_length: ArrayLike | None = None,
) -> Float[Array, "frames_x frames_y"]:
    """How likely each pair of frames is matched: the gradient of :func:`soft_dtw` in the cost.

    Arguments and errors are those of :func:`soft_dtw`.

    Returns:
        ``(n, m)``, entries in [0, 1], 1 at the first and last pair. Differentiable.
    """
    return _value_and_alignment(*_prepare(x, y, gamma, cost, metric, x_length, y_length))[1]


def _prepare(x, y, gamma, cost, metric, x_length, y_length):
    d = local_cost(x, y, cost, metric)
    if not isinstance(gamma, Tracer) and not np.all(np.asarray(gamma) > 0):
        raise ValueError(f"gamma={gamma}; want a temperature above 0")
    n, m = d.shape
    last_x = jnp.asarray(n if x_length is None else x_length, jnp.int32) - 1
    last_y = jnp.asarray(m if y_length is None else y_length, jnp.int32) - 1
    return d, jnp.asarray(gamma, d.dtype), last_x, last_y


@jax.custom_jvp
def _soft_value(d, gamma, last_x, last_y):
    return gamma * _sweep_forward(d / gamma, last_x, last_y)[0]


@_soft_value.defjvp
def _soft_value_jvp(primals, tangents):
    d, gamma, last_x, last_y = primals
    value, expected = _value_and_alignment(d, gamma, last_x, last_y)
    visited = expected > 0
    mean_cost = jnp.sum(jnp.where(visited, expected * jnp.where(visited, d, 0), 0))
    in_gamma = (value - mean_cost) / gamma
    return value, jnp.sum(expected * tangents[0]) + in_gamma * tangents[1]


def _value_and_alignment(d, gamma, last_x, last_y):
    value, chances = _sweep_forward(d / gamma, last_x, last_y)
    return gamma * value, _sweep_back(chances, last_x, last_y, d.shape[1])


def _sweep_forward(d, last_x, last_y):
    """R at the last cell for γ = 1, and each cell's softmin probabilities by anti-diagonal.

    The probabilities ``(n + m − 1, n)`` are those of having come along (1, 1), (1, 0) and (0, 1).
    """
    n = d.shape[0]
    unreached = jnp.full(n, jnp.inf, d.dtype)

    def diagonal(carry, row):
        left, above, corner = carry
        least = lax.stop_gradient(jnp.minimum(jnp.minimum(left, above), corner))
        reached = least < jnp.inf
        least = jnp.where(reached, least, 0)
        weights = [jnp.exp(least - r) for r in (corner, above, left)]
        total = jnp.where(reached, weights[0] + weights[1] + weights[2], 1)
        r = jnp.where(reached, least - jnp.log(total), jnp.inf) + row
        return (r, shift_in(r, jnp.inf), above), (r[last_x], [w / total for w in weights])

    start = (unreached, unreached, unreached.at[0].set(0))
    values, chances = lax.scan(diagonal, start, skew(d))[1]
    return values[last_x + last_y], chances


def _sweep_back(chances, last_x, last_y, m):
    """Probability that a path from the last cell back to the first visits each cell ``(n, m)``."""
    diagonals, n = chances[0].shape
    k = jnp.arange(diagonals, dtype=last_x.dtype)
    i = jnp.arange(n, dtype=last_x.dtype)

    def diagonal(carry, row):
        arriving, arriving_next = carry
        k, (by_corner, by_above, by_left) = row
        at_end = (k == last_x + last_y) & (i == last_x)
        visits = arriving + at_end.astype(arriving.dtype)
        one_back = visits * by_left + _shift_out(visits * by_above)
        return (arriving_next + one_back, _shift_out(visits * by_corner)), visits

    none = jnp.zeros_like(chances[0][0])
    visits = lax.scan(diagonal, (none, none), (k, chances), reverse=True)[1]
    return unskew(visits, m)


def _shift_out(values: Array) -> Array:
    """Row i of the result is row i + 1; zero enters at the end."""
    return lax.pad(values[1:], jnp.zeros((), values.dtype), [(0, 1, 0)])
