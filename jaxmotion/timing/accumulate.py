"""Dynamic programming over the anti-diagonals of a cost matrix, many pairs of clips side by side.

    C_s(i, j) = weight · D[i, j] + min over arrivals (Δi, Δj, r) of s   of   C_r(i − Δi, j − Δj)

i, j: frames of x and y; s, r: states of the step pattern; k = i + j numbers the anti-diagonals,
whose cells do not depend on each other. One ``lax.scan`` step handles a whole anti-diagonal:
K = n + m − 1 steps of O(n S) each. Every path starts from a virtual cell of cost 0, the pattern's
longest step before (0, 0).

Many pairs (``jax.vmap``, nested too) lie along the last, contiguous axis: the *lanes*. Lanes are
taken in blocks whose working set fits a core's cache, which is what the time depends on. Sharp bit:
nothing here is differentiated; :mod:`jaxmotion.timing.dtw` attaches the derivative.
"""

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap
from jaxtyping import Array

from jaxmotion.timing.step_patterns import StepPattern

_CACHED_VALUES = 2**17  # numbers a block of lanes may keep in flight: 1 MiB of float64
_MOST_LANES = 1024


class Ends(NamedTuple):
    """Accumulated values where a path may end, per anti-diagonal k and state s.

    ``row_cost[k, s]`` is C_s at (last frame of x, k − last frame of x), ``column_cost[k, s]`` at
    (k − last frame of y, last frame of y); ``…_cells`` count the cells of those paths. What was not
    asked for is empty. ``arrivals[k, i]`` says how each state of cell (i, k − i) was entered.
    """

    row_cost: Array
    row_cells: Array
    column_cost: Array
    column_cells: Array
    arrivals: Array


def arrival_radix(pattern: StepPattern) -> list[int]:
    """Place values under which the arrivals of all states of a cell are packed into one integer."""
    sizes = [len(ways) for ways in pattern.arrivals]
    return [math.prod(sizes[:s]) for s in range(len(sizes))]


def skew(cost: Array) -> Array:
    """``(n, m, ...)`` to ``(n + m − 1, n, ...)``: row k holds the cells i + j = k; ∞ outside."""
    n, m, *rest = cost.shape
    wide = jnp.pad(cost, [(0, 0), (0, n), *([(0, 0)] * len(rest))], constant_values=jnp.inf)
    shifted = wide.reshape(n * (n + m), *rest)[: n * (n + m - 1)]
    return jnp.swapaxes(shifted.reshape(n, n + m - 1, *rest), 0, 1)


def unskew(diagonals: Array, m: int) -> Array:
    """Inverse of :func:`skew`: ``(n + m − 1, n)`` to ``(n, m)``."""
    n = diagonals.shape[1]
    shifted = jnp.pad(diagonals.T.reshape(-1), (0, n))
    return shifted.reshape(n, n + m)[:, :m]


def shift_in(values: Array, outside: float | Array) -> Array:
    """Row i of the result is row i − 1; ``outside`` enters at row 0."""
    fill = jnp.asarray(outside, values.dtype)
    return lax.pad(values[:-1], fill, [(1, 0, 0)] + [(0, 0, 0)] * (values.ndim - 1))


@functools.cache
def accumulator(pattern: StepPattern, *, ragged: bool, columns: bool, count: bool):
    """The recursion of one pattern as a function of (cost (B, n, m), last_x (B,), last_y (B,)).

    Args:
        pattern: the path automaton.
        ragged: whether the pairs' last frames differ from the shape's.
        columns: whether values along y's last frame are wanted too.
        count: whether the number of cells of each path is wanted.

    Returns:
        A function to :class:`Ends` with a leading axis B; under ``jax.vmap`` the new axis joins B.
    """

    def one_block(cost: Array, last_x: Array, last_y: Array) -> Ends:
        ends = _scan_diagonals(
            jnp.moveaxis(cost, 0, -1), last_x, last_y, pattern, ragged, columns, count
        )
        return Ends(*(jnp.moveaxis(e, -1, 0) for e in ends))

    @custom_vmap
    def accumulate(cost: Array, last_x: Array, last_y: Array) -> Ends:
        pairs, n, _ = cost.shape
        in_flight = n * len(_history_keys(pattern)) * (2 if count else 1)
        most = min(max(_CACHED_VALUES // in_flight, 8), _MOST_LANES)
        blocks = -(-pairs // most)
        if blocks <= 1:
            return one_block(cost, last_x, last_y)
        lanes = -(-pairs // blocks)

        def in_blocks(a: Array) -> Array:
            fill = [(0, blocks * lanes - pairs)] + [(0, 0)] * (a.ndim - 1)
            return jnp.pad(a, fill).reshape(blocks, lanes, *a.shape[1:])

        ends = lax.map(
            lambda args: one_block(*args), jax.tree.map(in_blocks, (cost, last_x, last_y))
        )
        return jax.tree.map(lambda e: e.reshape(blocks * lanes, *e.shape[2:])[:pairs], ends)

    @accumulate.def_vmap
    def join_axes(axis_size, in_batched, *args):
        full = [
            a if batched else jnp.broadcast_to(a, (axis_size, *a.shape))
            for a, batched in zip(args, in_batched, strict=True)
        ]
        pairs = full[0].shape[1]
        ends = accumulate(*(a.reshape(-1, *a.shape[2:]) for a in full))
        split = jax.tree.map(lambda e: e.reshape(axis_size, pairs, *e.shape[1:]), ends)
        return split, jax.tree.map(lambda _: True, split)

    return accumulate


def _history_keys(pattern: StepPattern) -> list[tuple[int, int, int]]:
    """(Δi, k back, state) of the anti-diagonals a step reads, and those that will become them."""
    keys = set()
    for ways in pattern.arrivals:
        for di, dj, state in ways:
            keys |= {(di, back, state) for back in range(1, di + dj + 1)}
    return sorted(keys)


def _scan_diagonals(cost, last_x, last_y, pattern, ragged, columns, count) -> Ends:
    """Values along the lanes of one block: cost ``(n, m, lanes)``."""
    n, m, lanes = cost.shape
    keys = _history_keys(pattern)
    unreached = jnp.full((n, lanes), jnp.inf, cost.dtype)
    start = unreached.at[0].set(0)
    no_cells = jnp.zeros((n, lanes), cost.dtype)
    costs = {key: start if key == (1, pattern.depth, 0) else unreached for key in keys}
    cells = {key: no_cells for key in keys} if count else {}

    def diagonal(carry, row):
        costs, cells = carry
        k, d = row
        new_costs, new_cells, code = _enter_cells(pattern, d, costs, cells)
        last = last_x if ragged else n - 1
        column_costs, column_cells = [], []
        i = k - last_y
        if columns:
            inside = jnp.clip(i, 0, n - 1)
            outside = (i < 0) | (i >= n)
            column_costs = [jnp.where(outside, jnp.inf, _take_row(v, inside)) for v in new_costs]
            column_cells = [_take_row(v, inside) for v in new_cells]
        out = Ends(
            _stack([_take_row(v, last) for v in new_costs], lanes),
            _stack([_take_row(v, last) for v in new_cells], lanes),
            _stack(column_costs, lanes),
            _stack(column_cells, lanes),
            code,
        )
        return (_advance(keys, costs, new_costs, jnp.inf), _advance(keys, cells, new_cells, 0)), out

    diagonals = (jnp.arange(n + m - 1, dtype=last_y.dtype), skew(cost))
    return lax.scan(diagonal, (costs, cells), diagonals)[1]


def _enter_cells(pattern, d, costs, cells):
    """Costs, cell counts and packed arrivals of every state on one anti-diagonal."""
    dtype = jnp.uint8  # every pattern's arrivals pack into a byte; slope3 needs 112 values
    code = jnp.zeros(d.shape, dtype)
    new_costs, new_cells = [], []
    for radix, ways in zip(arrival_radix(pattern), pattern.arrivals, strict=True):
        values, lengths = [], []
        for way in ways:
            key = (way.di, way.di + way.dj, way.state)
            extra = pattern.weight(way.di, way.dj) - 1
            values.append(costs[key] + extra * d if extra else costs[key])
            lengths.append(cells.get(key))
        best, length, choice = values[0], lengths[0], jnp.zeros(d.shape, dtype)
        for number in range(1, len(ways)):
            better = values[number] < best
            choice = jnp.where(better, jnp.asarray(number * radix, dtype), choice)
            best = jnp.minimum(best, values[number])
            if cells:
                length = jnp.where(better, lengths[number], length)
        new_costs.append(best + d)
        code = code + choice
        if cells:
            new_cells.append(length + 1)
    return new_costs, new_cells, code


def _advance(keys, old, new, outside):
    """The next step's history: new values come in, shifted by a row where a step moves in x."""
    if not new:
        return {}
    shifted = [shift_in(v, outside) for v in new]
    return {
        (di, back, s): old[(di, back - 1, s)] if back > 1 else (shifted if di else new)[s]
        for di, back, s in keys
    }


def _take_row(values, at):
    """values[at] for one row number, or for one row number per lane."""
    if isinstance(at, int):
        return values[at]
    return jnp.take_along_axis(values, at[None, :], axis=0)[0]


def _stack(values: list[Array], lanes: int) -> Array:
    return jnp.stack(values) if values else jnp.zeros((0, lanes), jnp.uint8)
