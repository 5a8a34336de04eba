"""Soft dynamic time warping: a smooth loss between two clips, and the alignment it expects.

    soft_dtw(D, γ) = −γ log Σ_paths exp(−Σ_t D[i_t, j_t] / γ)
    R(i, j)        = D[i, j] + softmin_γ(R(i−1, j−1), R(i−1, j), R(i, j−1)),   R(0, 0) = D[0, 0]
    E[i, j]        = ∂ soft_dtw / ∂D[i, j] = chance that a path drawn ∝ exp(−cost/γ) visits (i, j)
    ∂ soft_dtw/∂γ  = Σ_ij E[i, j] Σ_k s_k log s_k        s: shares of the three ways to (i, j)

Paths step by (1, 0), (0, 1) and (1, 1) from (0, 0) to the last cell. D ``(n, m)`` is a cost matrix,
by default squared Euclidean distances; γ > 0 has its unit. As γ → 0 the value falls on that of
``dtw`` from below and E becomes its path; with larger γ more paths take part, and the value may be
negative. Cost O(n m) time and memory, three numbers a cell.

Sources: Cuturi & Blondel 2017, algorithms 1 and 2; Mensch & Blondel 2018 for E as an expectation.

The sweep works on Z = exp(−R/γ), the sum over all paths to a cell, which is a product and two sums
a cell. Z leaves the range of floating point, so it is kept as m·2ᵉ with 1 ≤ m < 2 and e a whole
number in a float of its own (:class:`_Scaled`): powers of two are put together from bits, one
exponential a cell is all that is computed, and nothing is lost however small a path's part. Where
γ is so small that even e leaves its range, a larger γ takes its place that is still below the
rounding of the value: the answer is that of ``dtw``, with ties shared between a few paths.

E is found with a second sweep from the end, which passes each cell's chance back along the shares
that its three predecessors have in its sum:

    total(i, j)    = Z(i−1, j−1) + Z(i−1, j) + Z(i, j−1),    Z(i, j) = total(i, j) exp(−D[i, j]/γ)
    E[i, j]        = E[i+1, j+1] Z(i, j)/total(i+1, j+1) + E[i+1, j] Z(i, j)/total(i+1, j)
                     + E[i, j+1] Z(i, j)/total(i, j+1)

Shares compare neighbours only, so they are right wherever Z is, however large its exponent. They
are worked out for a strip at once when its sums are known, outside the loop over anti-diagonals,
whose steps cost as much as what is computed in them. The value's derivative is E itself, in both
modes; E is made of ordinary operations, in which exponents are constants, so it can be
differentiated again. Beyond ``x_length``, ``y_length`` it is zero.
"""

import math
from functools import reduce
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from jaxmotion._checks import known, require, traced
from jaxmotion._types import ArrayLike, Metric, ScalarLike
from jaxmotion.motion import Motion
from jaxmotion.timing.antidiagonals import entering, in_strips, skew, unskew
from jaxmotion.timing.frame_distance import compared, counted_pair, last_frames, local_cost

# With 1000 x 1000 cells in float64, costs, shares and one strip at work then stay below 32 MB. What
# is larger, glibc hands back after each call, and the next one pays for every page again.
_MOST_ROWS = 125


def soft_dtw(
    x: ArrayLike | Motion | None = None,
    y: ArrayLike | Motion | None = None,
    gamma: ScalarLike = 1.0,
    *,
    cost: ArrayLike | None = None,
    metric: Metric | None = None,
    x_length: ScalarLike | None = None,
    y_length: ScalarLike | None = None,
) -> Float[Array, ""]:
    """Soft minimum over all warps of x onto y of the summed frame distances; a training loss.

    One pair of clips; ``jax.vmap`` makes many. O(n m). Differentiable in x, y, cost and gamma in
    both modes, to any order. Source: Cuturi & Blondel 2017, algorithms 1 and 2.

    **Arguments:**

    - ``x``: features f[n, f], or local rotations f[n, J, 4] with ``metric="pose"``, or a motion.
    - ``y``: features f[m, f] or rotations f[m, J, 4], or a motion of the same joints.
    - ``gamma``: temperature > 0, in the unit of the cost. As small as the dtype has, the value is
      that of :func:`dtw`.
    - ``cost``: f[n, m], a cost matrix instead of x and y.
    - ``metric``: distance of two frames; see :func:`frame_distance`. By default "pose" of motions,
      whose rotations are compared, and "sqeuclidean" of arrays.
    - ``x_length``, ``y_length``: frames of x and y that count when they are padded
      (:func:`pad_to_bucket`); may be traced.

    **Returns:** f[], in the unit of the cost; it may be negative.
    **Raises:** ``ValueError`` for bad shapes or lengths, an unknown metric, or a gamma that is not
    positive; at run time for traced ones.
    """
    return _compiled("soft_dtw", _soft_value, x, y, gamma, cost, metric, x_length, y_length)


def soft_alignment(
    x: ArrayLike | Motion | None = None,
    y: ArrayLike | Motion | None = None,
    gamma: ScalarLike = 1.0,
    *,
    cost: ArrayLike | None = None,
    metric: Metric | None = None,
    x_length: ScalarLike | None = None,
    y_length: ScalarLike | None = None,
) -> Float[Array, "frames_x frames_y"]:
    """How likely each pair of frames is matched: the gradient of :func:`soft_dtw` in the cost.

    O(n m). Differentiable in both modes. Source: Mensch & Blondel 2018.

    **Arguments:** ``x``, ``y``, ``gamma``, ``cost``, ``metric``, ``x_length``, ``y_length``: as
    :func:`soft_dtw`.
    **Returns:** f[n, m], entries in [0, 1], 1 at the first and last pair.
    **Raises:** as :func:`soft_dtw`.
    """
    arguments = (x, y, gamma, cost, metric, x_length, y_length)
    return _compiled("soft_alignment", _value_and_alignment, *arguments)[1]


def _compiled(caller, function, x, y, gamma, cost, metric, x_length, y_length):
    x, y, metric = compared(caller, x, y, metric, "sqeuclidean")
    clips, n, m = counted_pair(caller, x, y, cost, x_length, y_length)
    given = jnp.asarray(gamma)
    message = f"{caller}: gamma must be a temperature above 0"
    # XLA takes numbers below the dtype's normal ones for 0; the value is that of dtw there.
    bad = ~(given >= 0) if traced(gamma) else not known(gamma) > 0
    clips = require(clips, bad, message, got=gamma)
    return _run(function, metric, *clips, n, m, given)


@eqx.filter_jit
def _run(function, metric, x, y, cost, x_length, y_length, gamma):
    d = local_cost(x, y, cost, metric)
    return function(d, gamma.astype(d.dtype), *last_frames(d, x_length, y_length))


@jax.custom_jvp
def _soft_value(d, gamma, last_x, last_y):
    gamma = _workable(d, gamma, last_x, last_y)
    return _sweep_forward(in_strips(d, _MOST_ROWS), gamma, last_x, last_y)[0]


def _soft_value_jvp(primals, tangents):
    d, gamma, last_x, last_y = primals
    d_dot, gamma_dot = tangents[:2]
    value, expected, entropy = _value_and_statistics(d, gamma, last_x, last_y)
    change = jnp.zeros_like(value)
    if not isinstance(d_dot, SymbolicZero):
        change += jnp.sum(expected * d_dot)
    if not isinstance(gamma_dot, SymbolicZero):
        change -= jnp.sum(expected * entropy) * gamma_dot
    return value, change


_soft_value.defjvp(_soft_value_jvp, symbolic_zeros=True)


def _value_and_alignment(d, gamma, last_x, last_y):
    return _value_and_statistics(d, gamma, last_x, last_y)[:2]


def _value_and_statistics(d, gamma, last_x, last_y):
    """The value, E and the entropy of where a path to each cell comes from; ``(n, m)`` each."""
    strips = in_strips(d, _MOST_ROWS)
    gamma = _workable(d, gamma, last_x, last_y)
    value, shares = _sweep_forward(strips, gamma, last_x, last_y)
    visits = _sweep_back(strips, shares, last_x, last_y)
    entropy = jax.vmap(lambda s: unskew(_entropy(s), d.shape[1]))(shares)
    return value, *(x.reshape(-1, d.shape[1])[: d.shape[0]] for x in (visits, entropy))


def _entropy(shares: Array) -> Array:
    """−Σ s log s of ``(k, 2, h)`` shares and what they leave of one, ``(k, h)``."""
    corner, up = shares[:, 0], shares[:, 1]
    parts = jnp.stack([corner, up, jnp.maximum(1 - corner - up, 0)])
    some = parts > 0
    return -jnp.sum(jnp.where(some, parts * jnp.log(jnp.where(some, parts, 1)), 0), axis=0)


def _workable(d: Array, gamma: Array, last_x: Array, last_y: Array) -> Array:
    """γ, or if the exponents of all paths leave their range the first of γ, f γ, f² γ … for which
    they do not: f is the square root of that range, so the rest of it is beyond any rounding."""
    kind = jnp.finfo(d.dtype)
    least = jnp.where(gamma >= 0, jnp.maximum(gamma, float(kind.tiny)), gamma)
    fixed = lax.stop_gradient((least, d))
    factor = math.sqrt(-_never(d.dtype))
    largest = sum(d.shape) * jnp.max(jnp.where(jnp.isfinite(fixed[1]), jnp.abs(fixed[1]), 0))
    strips = in_strips(fixed[1], _MOST_ROWS)

    def unsure(state):
        gamma, found = state
        return ~found & (largest / gamma > factor)

    def attempt(state):
        gamma, _ = state
        found = ~jnp.isposinf(_sweep_forward(strips, gamma, last_x, last_y)[0])
        return jnp.where(found, gamma, factor * gamma), found

    raised = lax.while_loop(unsure, attempt, (fixed[0], jnp.zeros((), bool)))[0]
    return jnp.where(raised > gamma, raised, gamma)


class _Scaled(NamedTuple):
    """Positive numbers m·2ᵉ, of any size; e is a whole number, and ``_never`` for zero."""

    m: Array
    e: Array


def _never(dtype) -> float:
    """An exponent that stays far below all others when a clip's worth of them is added."""
    return -(float(jnp.finfo(dtype).max) ** 0.75)


def _power_of_two(e: Array) -> Array:
    """2ᵉ of whole numbers 1 − bias ≤ e ≤ bias, below them 0; a constant to differentiation."""
    mantissa, bias, integer = _layout(e.dtype)
    # In 2ⁿ + k, n the bits of the mantissa, the lowest bits are those of the whole number k.
    shifted = jnp.maximum(lax.stop_gradient(e), -bias) + (2.0**mantissa + bias)
    bits = lax.bitcast_convert_type(shifted, integer)
    return lax.bitcast_convert_type(lax.shift_left(bits, integer(mantissa)), e.dtype)


def _exponent(x: Array) -> Array:
    """⌊log₂ x⌋ of normal numbers x > 0; a constant to differentiation."""
    mantissa, bias, integer = _layout(x.dtype)
    bits = lax.bitcast_convert_type(lax.stop_gradient(x), integer)
    whole = lax.shift_right_logical(bits, integer(mantissa)) | lax.bitcast_convert_type(
        jnp.asarray(2.0**mantissa, x.dtype), integer
    )
    return lax.bitcast_convert_type(whole, x.dtype) - (2.0**mantissa + bias)


def _layout(dtype) -> tuple[int, float, type]:
    """Bits of the mantissa, bias of the exponent and the integer type of a float's size."""
    kind = jnp.finfo(dtype)
    return kind.nmant, kind.maxexp - 1.0, jnp.int64 if kind.bits == 64 else jnp.int32


def _factors(costs: Array, gamma: Array) -> _Scaled:
    """exp(−costs/γ); of infinite costs next to nothing, whose derivative is zero."""
    log_2 = math.log(2)
    x = -jnp.minimum(costs, -log_2 * _never(costs.dtype) * lax.stop_gradient(gamma)) / gamma
    e = lax.stop_gradient(jnp.round(x / log_2))
    # ln 2 in two parts, so that the difference of two large numbers is exact. Where they are so
    # large that not even that helps, what is left is noise, and is kept small.
    scale = 2.0 ** (jnp.finfo(x.dtype).nmant // 2)
    high = round(log_2 * scale) / scale
    rest = (x - e * high) - e * (log_2 - high)
    return _Scaled(jnp.exp(jnp.clip(rest, -1, 1)), e)


def _sweep_forward(
    strips: Array, gamma: Array, last_x: Array, last_y: Array
) -> tuple[Array, Array]:
    """R at the last cell, and the shares of all cells, as :func:`_shares` by strip."""
    h, m = strips.shape[1:]
    row_above = _Scaled(jnp.ones(m, strips.dtype), jnp.full(m, _never(strips.dtype), strips.dtype))

    def one_strip(row_above, strip):
        number, costs = strip
        row = last_x % h
        # A sweep gives out what a step took in, two anti-diagonals back: it goes two too far.
        longer = jnp.pad(costs, [(0, 0), (0, 2)], constant_values=jnp.inf)
        factors = _factors(skew(longer), gamma)
        before, bottom, watched = _strip_forward(row_above, number, factors, row)
        at_last = jax.tree.map(lambda z: z[row + last_y + 2], watched)
        return jax.tree.map(lambda z: z[h + 1 :], bottom), (at_last, _shares(before))

    ends, shares = lax.scan(one_strip, row_above, _numbered(strips, last_x))[1]
    z, e = ends.m[last_x // h], ends.e[last_x // h]
    no_path = e < 0.5 * _never(e.dtype)
    return jnp.where(no_path, jnp.inf, -gamma * (jnp.log(z) + math.log(2) * e)), shares


def _strip_forward(row_above: _Scaled, number: Array, factors: _Scaled, watched: Array):
    """Z of a strip by anti-diagonal, ``(k, h + 1)``: cell (i, j) is entry (i + j + 2, i + 1).

    ``factors (k, h)`` are the cells' own, skewed. Row 0 is the row above the strip. The first two
    anti-diagonals come before the first cell, so that of number k has its predecessors in the
    entries k and k + 1. Besides, the strip's last row and a ``watched`` one alone, ``(k,)``: where
    only the value is asked for, no more is kept.
    """
    h, dtype = factors.m.shape[1], factors.m.dtype
    never = _never(dtype)

    def diagonal(carry, row):
        before, two_before = carry
        cell, enters = row
        (corner, up, left), most = _predecessors(two_before, before)
        product = (corner + up + left) * cell.m
        carried = _exponent(product)
        z = _Scaled(product * _power_of_two(-carried), most + cell.e + carried)
        after = jax.tree.map(lambda new, x: jnp.pad(x, (1, 0)).at[0].set(new), enters, z)
        rows = jnp.stack([x[row] for row in (-1, watched + 1) for x in two_before])
        return (after, before), (two_before, rows)

    def blank(m, e):
        return _Scaled(
            jnp.ones(h + 1, dtype).at[0].set(m), jnp.full(h + 1, never, dtype).at[0].set(e)
        )

    first = blank(row_above.m[0], row_above.e[0]), blank(1, jnp.where(number == 0, 0, never))
    enters = _Scaled(entering(row_above.m, h + 2, 1.0), entering(row_above.e, h + 2, never))
    # Two steps at a time, an anti-diagonal need not be moved to where the next step looks for it.
    every, rows = lax.scan(diagonal, first, (factors, enters), unroll=2)[1]
    return every, _Scaled(*rows[:, :2].T), _Scaled(*rows[:, 2:].T)


def _predecessors(two_before: _Scaled, before: _Scaled) -> tuple[list[Array], Array]:
    """Z at (−1, −1), (−1, 0) and (0, −1) from each cell, in units of 2 to their largest exponent;
    and that exponent."""
    came_from = (
        jax.tree.map(lambda z: z[..., :-1], two_before),
        jax.tree.map(lambda z: z[..., :-1], before),
        jax.tree.map(lambda z: z[..., 1:], before),
    )
    most = reduce(jnp.maximum, [z.e for z in came_from])
    return [z.m * _power_of_two(z.e - most) for z in came_from], most


def _shares(before: _Scaled) -> Array:
    """Shares of (1, 1) and (1, 0) in the sum to each cell, ``(m + h − 1, 2, h)``."""
    two_before = jax.tree.map(lambda z: z[:-2], before)
    one_before = jax.tree.map(lambda z: z[1:-1], before)
    corner, up, left = _predecessors(two_before, one_before)[0]
    return jnp.stack([corner, up], axis=1) * (1 / (corner + up + left))[:, None]


def _sweep_back(strips: Array, shares: Array, last_x: Array, last_y: Array) -> Array:
    """Chance that a path from the last cell to the first visits each cell ``(strips, h, m)``.

    It is written over the strips of costs, which are used up, so as to need no memory of its own.
    """
    h, m = strips.shape[1:]
    i = jnp.arange(h, dtype=last_x.dtype)
    none = jnp.zeros(h, strips.dtype)

    def one_strip(carry, strip):
        """``row_below (m,)`` is what the strip below sends up to this one's last row."""
        row_below, chances = carry
        number, shares = strip

        def diagonal(carry, row):
            arriving, arriving_next = carry
            k, from_below, (by_corner, by_above) = row
            at_end = (number * h + i == last_x) & (k == last_x % h + last_y)
            visits = arriving + at_end.astype(arriving.dtype) + jnp.where(i == h - 1, from_below, 0)
            corner, up = visits * by_corner, visits * by_above
            by_left = jnp.maximum(1 - by_corner - by_above, 0)
            one_back = visits * by_left + _shift_out(up)
            return (arriving_next + one_back, _shift_out(corner)), visits

        k = jnp.arange(m + h - 1, dtype=last_x.dtype)
        rows = (k, jnp.pad(row_below, (h - 1, 0)), shares)
        visits = lax.scan(diagonal, (none, none), rows, reverse=True)[1]
        corner, up = (visits[:m, None, 0] * shares[:m, :, 0]).T
        row_above = up + jnp.pad(corner, (0, 1))[1:]
        return (row_above, chances.at[number].set(unskew(visits, m))), None

    nothing_below = jnp.zeros(m, strips.dtype)
    upwards = _numbered(shares, last_x)
    return lax.scan(one_strip, (nothing_below, strips), upwards, reverse=True)[0][1]


def _numbered(strips: Array, like: Array) -> tuple[Array, Array]:
    return jnp.arange(strips.shape[0], dtype=like.dtype), strips


def _shift_out(values: Array) -> Array:
    """Entry i of the result is entry i + 1; zero enters at the end."""
    return lax.pad(values[1:], jnp.zeros((), values.dtype), [(0, 1, 0)])
