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

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer
from jaxtyping import Array, Float

from jaxmotion._types import ArrayLike
from jaxmotion.timing.antidiagonals import entering, in_strips, skew, unskew
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
    return _compiled(_soft_value, x, y, gamma, cost, metric, x_length, y_length)


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
    arguments = (x, y, gamma, cost, metric, x_length, y_length)
    return _compiled(_value_and_alignment, *arguments)[1]


def _compiled(function, x, y, gamma, cost, metric, x_length, y_length):
    if not isinstance(gamma, Tracer) and not np.all(np.asarray(gamma) > 0):
        raise ValueError(f"gamma={gamma}; want a temperature above 0")
    arrays = (
        None if given is None else jnp.asarray(given)
        for given in (x, y, cost, x_length, y_length, gamma)
    )
    return _run(function, metric, *arrays)


@eqx.filter_jit
def _run(function, metric, x, y, cost, x_length, y_length, gamma):
    d = local_cost(x, y, cost, metric)
    n, m = d.shape
    last_x = jnp.asarray(n if x_length is None else x_length, jnp.int32) - 1
    last_y = jnp.asarray(m if y_length is None else y_length, jnp.int32) - 1
    return function(d, gamma.astype(d.dtype), last_x, last_y)


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
    visits = _sweep_back(chances, last_x, last_y, d.shape[1])
    return gamma * value, visits[: d.shape[0]]


def _sweep_forward(d, last_x, last_y):
    """R at the last cell for γ = 1, and each cell's softmin weights by strip and anti-diagonal.

    The weights ``(strips, m + h − 1, h)`` are the chances of having come by (1, 1), (1, 0), (0, 1).
    """
    m = d.shape[1]
    strips = in_strips(d)
    h = strips.shape[1]
    blank = jnp.full(h + 1, jnp.inf, d.dtype)

    def one_strip(row_above, strip):
        number, d = strip
        start = jnp.where(number == 0, 0, jnp.inf).astype(d.dtype)

        def diagonal(carry, row):
            before, two_before = carry
            d, enters = row
            came_from = (two_before[:-1], before[:-1], before[1:])
            least = lax.stop_gradient(functools.reduce(jnp.minimum, came_from))
            reached = least < jnp.inf
            least = jnp.where(reached, least, 0)
            weights = [jnp.exp(least - r) for r in came_from]
            total = jnp.where(reached, weights[0] + weights[1] + weights[2], 1)
            r = jnp.where(reached, least - jnp.log(total), jnp.inf) + d
            out = (r[-1], r[last_x % h], [w / total for w in weights])
            return (jnp.concatenate([enters[None], r]), before), out

        carry = (blank.at[0].set(row_above[0]), blank.at[0].set(start))
        rows = (skew(d), entering(row_above, h, jnp.inf))
        bottom, values, chances = lax.scan(diagonal, carry, rows)[1]
        return bottom[h - 1 :], (values, chances)

    numbered = (jnp.arange(strips.shape[0], dtype=last_x.dtype), strips)
    nothing_above = jnp.full(m, jnp.inf, d.dtype)
    values, chances = lax.scan(one_strip, nothing_above, numbered)[1]
    return values[last_x // h, last_x % h + last_y], chances


def _sweep_back(chances, last_x, last_y, m):
    """Chance that a path from the last cell to the first visits each cell ``(strips h, m)``."""
    num_strips, diagonals, h = chances[0].shape
    i = jnp.arange(h, dtype=last_x.dtype)
    none = jnp.zeros(h, chances[0].dtype)

    def one_strip(row_below, strip):
        """``row_below (m,)`` is what the strip below sends up to this one's last row."""
        number, chances = strip

        def diagonal(carry, row):
            arriving, arriving_next = carry
            k, from_below, (by_corner, by_above, by_left) = row
            at_end = (number * h + i == last_x) & (k == last_x % h + last_y)
            visits = (arriving + at_end.astype(arriving.dtype)).at[-1].add(from_below)
            up, corner = visits * by_above, visits * by_corner
            one_back = visits * by_left + _shift_out(up)
            return (arriving_next + one_back, _shift_out(corner)), (visits, up[0], corner[0])

        k = jnp.arange(diagonals, dtype=last_x.dtype)
        rows = (k, jnp.pad(row_below, (h - 1, 0)), chances)
        visits, up, corner = lax.scan(diagonal, (none, none), rows, reverse=True)[1]
        sent_up = up[:m] + jnp.pad(corner, (0, 1))[1 : m + 1]
        return sent_up, unskew(visits, m)

    numbered = (jnp.arange(num_strips, dtype=last_x.dtype), chances)
    nothing_below = jnp.zeros(m, none.dtype)
    visits = lax.scan(one_strip, nothing_below, numbered, reverse=True)[1]
    return visits.reshape(num_strips * h, m)


def _shift_out(values: Array) -> Array:
    """Entry i of the result is entry i + 1; zero enters at the end."""
    return lax.pad(values[1:], jnp.zeros((), values.dtype), [(0, 1, 0)])
