"""Dynamic programming over the anti-diagonals of a cost matrix, many pairs of clips side by side.

    C_s(i, j) = weight_s · D[i, j] + P_p(i − Δi, j − Δj),          (Δi, Δj, p) = moves[s]
    P_p(i, j) = min over states s in pool p of C_s(i, j)

i, j: frames of x and y; states, moves and pools: :mod:`jaxmotion.timing.step_patterns`. D ``(n,
m)`` is taken in strips of rows and each strip by anti-diagonals, one ``lax.scan`` in another
(:mod:`jaxmotion.timing.antidiagonals`). A pool that steps in x start from is held as h + 1 numbers:
first the one that enters from the strip above, then the strip's own, so that such a step is a read
one place earlier. Every path starts from a virtual cell of cost 0, the longest step before (0, 0).

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

from jaxmotion.timing.antidiagonals import entering, in_strips, skew, strip_rows
from jaxmotion.timing.step_patterns import StepPattern

_CACHED_VALUES = 2**16  # numbers a block of lanes may keep in flight: half a MiB of float64
_MOST_LANES = 1024


class Ends(NamedTuple):
    """Accumulated values where a path may end.

    ``row_cost[j]`` is P_0 at (last frame of x, j), ``column_cost[i]`` at (i, last frame of y);
    ``…_cells`` count the cells of those paths. What was not asked for is empty.
    ``choices[strip, k, i]`` packs which state each pool of the k-th cell of a strip's row i chose.
    """

    row_cost: Array
    row_cells: Array
    column_cost: Array
    column_cells: Array
    choices: Array


def choice_radix(pattern: StepPattern) -> list[int]:
    """Place values under which the choices of all pools of a cell are packed into one integer."""
    sizes = [len(pool) for pool in pattern.pools]
    return [math.prod(sizes[:p]) for p in range(len(sizes))]


@functools.cache
def accumulator(pattern: StepPattern, *, ragged: bool, columns: bool, count: bool):
    """The recursion of one pattern as a function of (cost (B, n, m), last_x (B,), last_y (B,)).

    **Arguments:** ``pattern``: the path automaton; ``ragged``: whether the pairs' last frames
    differ from the shape's; ``columns``: whether values along y's last frame are wanted too;
    ``count``: whether the number of cells of each path is wanted.
    **Returns:** a function to :class:`Ends` with a leading axis B; under ``jax.vmap`` the new axis
    joins B.
    """

    def one_block(cost: Array, last_x: Array, last_y: Array) -> Ends:
        last = (last_x, last_y) if ragged else (cost.shape[1] - 1, cost.shape[2] - 1)
        ends = _scan_strips(jnp.moveaxis(cost, 0, -1), *last, pattern, columns, count)
        ends = Ends(*(jnp.moveaxis(e, -1, 0) for e in ends))
        gather = functools.partial(_gather_ends, n=cost.shape[1], m=cost.shape[2])
        if ragged:
            return jax.vmap(gather)(ends, *last)
        return jax.vmap(lambda e: gather(e, *last))(ends)

    @custom_vmap
    def accumulate(cost: Array, last_x: Array, last_y: Array) -> Ends:
        pairs, n, _ = cost.shape
        in_flight = strip_rows(n) * len(_history_keys(pattern)) * (2 if count else 1)
        most = min(max(_CACHED_VALUES // in_flight, 8), _MOST_LANES)
        blocks = -(-pairs // most)
        if blocks <= 1:
            return one_block(cost, last_x, last_y)
        lanes = -(-pairs // blocks)

        def in_blocks(a: Array) -> Array:
            fill = [(0, blocks * lanes - pairs)] + [(0, 0)] * (a.ndim - 1)
            return jnp.pad(a, fill).reshape(blocks, lanes, *a.shape[1:])

        args = jax.tree.map(in_blocks, (cost, last_x, last_y))
        ends = lax.map(lambda args: one_block(*args), args)
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


def _history_keys(pattern: StepPattern) -> list[tuple[int, int]]:
    """(k back, pool) of the anti-diagonals a step reads, and those that will become them."""
    reach = {}
    for move in pattern.moves:
        reach[move.pool] = max(reach.get(move.pool, 0), move.di + move.dj)
    return [(back, p) for p in sorted(reach) for back in range(1, reach[p] + 1)]


def _scan_strips(cost, last_x, last_y, pattern, columns, count) -> Ends:
    """Ends of one block of lanes, ``(n, m, lanes)``, as they come: by strip and anti-diagonal."""
    strips = in_strips(cost)
    num_strips, h, m, lanes = strips.shape
    keys = _history_keys(pattern)
    none = jnp.zeros((0, lanes), jnp.uint8)
    entered = sorted({move.pool for move in pattern.moves if move.di})

    def histories(rows_above, outside, dtype):
        """Before a strip's first step only what enters above its first cell is known."""
        known = {}
        for back, p in keys:
            blank = jnp.full((h + (p in entered), lanes), outside, dtype)
            enters = back == 1 and p in entered
            known[back, p] = blank.at[0].set(rows_above[p][0]) if enters else blank
        return known

    def one_strip(rows_above, strip):
        number, d = strip
        costs = histories(rows_above[0], jnp.inf, cost.dtype)
        start = jnp.where(number == 0, 0, jnp.inf).astype(cost.dtype)
        costs[pattern.depth, 0] = costs[pattern.depth, 0].at[0].set(start)
        cells = histories(rows_above[1], 0, jnp.int32) if count else {}

        def diagonal(carry, row):
            costs, cells = carry
            k, d, enter_costs, enter_cells = row
            pool_costs, pool_cells, code = _enter_cells(pattern, entered, d, costs, cells)
            at = jnp.clip(k - last_y, 0, h - 1)
            ends = Ends(
                _take_row(pool_costs[0], last_x % h),
                _take_row(pool_cells[0], last_x % h) if count else none,
                _take_row(pool_costs[0], at) if columns else none,
                _take_row(pool_cells[0], at) if count and columns else none,
                code,
            )
            carry = (
                _advance(keys, costs, pool_costs, enter_costs),
                _advance(keys, cells, pool_cells, enter_cells) if count else {},
            )
            bottom = [
                {p: pool_costs[p][-1] for p in entered},
                {p: pool_cells[p][-1] for p in entered} if count else {},
            ]
            return carry, (bottom, ends)

        above = (
            {p: entering(row, h, jnp.inf) for p, row in rows_above[0].items()},
            {p: entering(row, h, 0) for p, row in rows_above[1].items()},
        )
        k = jnp.arange(m + h - 1, dtype=jnp.int32)
        bottom, ends = lax.scan(diagonal, (costs, cells), (k, skew(d), *above))[1]
        return jax.tree.map(lambda row: row[h - 1 :], bottom), ends

    nothing = [
        {p: jnp.full((m, lanes), jnp.inf, cost.dtype) for p in entered},
        {p: jnp.zeros((m, lanes), jnp.int32) for p in entered} if count else {},
    ]
    numbered = (jnp.arange(num_strips, dtype=jnp.int32), strips)
    return lax.scan(one_strip, nothing, numbered)[1]


def _gather_ends(ends: Ends, last_x, last_y, *, n: int, m: int) -> Ends:
    """From values by strip and anti-diagonal to values by frame, of one pair."""
    h = strip_rows(n)

    def along_row(values):
        in_strip = lax.dynamic_index_in_dim(values, last_x // h, keepdims=False)
        return lax.dynamic_slice_in_dim(in_strip, last_x % h, m)

    def along_column(values):
        return lax.dynamic_slice_in_dim(values, last_y, h, axis=1).reshape(-1)[:n]

    row_cost, row_cells, column_cost, column_cells, choices = ends
    return Ends(
        along_row(row_cost),
        along_row(row_cells) if row_cells.size else row_cells,
        along_column(column_cost) if column_cost.size else column_cost,
        along_column(column_cells) if column_cells.size else column_cells,
        choices,
    )


def _enter_cells(pattern, entered, d, costs, cells):
    """Costs, cell counts and packed choices of every pool on one anti-diagonal."""

    def source(history, move):
        values = history[move.di + move.dj, move.pool]
        if move.pool not in entered:
            return values
        return values[:-1] if move.di else values[1:]

    values = [source(costs, move) + pattern.weight(move) * d for move in pattern.moves]
    lengths = [source(cells, move) for move in pattern.moves] if cells else []
    dtype = jnp.uint8  # every pattern's choices pack into a byte; slope3 needs 112 values
    code = jnp.zeros(d.shape, dtype)
    pool_costs, pool_cells = [], []
    for radix, (first, *others) in zip(choice_radix(pattern), pattern.pools, strict=True):
        best, choice = values[first], jnp.zeros(d.shape, dtype)
        length = lengths[first] + 1 if cells else d
        for number, state in enumerate(others, 1):
            better = values[state] < best
            choice = jnp.where(better, jnp.asarray(number * radix, dtype), choice)
            best = jnp.minimum(best, values[state])
            if cells:
                length = jnp.where(better, lengths[state] + 1, length)
        code = code + choice
        pool_costs.append(best)
        pool_cells.append(length)
    return pool_costs, pool_cells, code


def _advance(keys, old, new, enters):
    """The next step's history; a pool entered from above gets what enters as row 0."""

    def latest(p):
        return jnp.concatenate([enters[p][None], new[p]]) if p in enters else new[p]

    return {(back, p): old[back - 1, p] if back > 1 else latest(p) for back, p in keys}


def _take_row(values, at) -> Array:
    """values[at] for one row number, or for one per lane."""
    if jnp.ndim(at) == 0:
        return values[at]
    return jnp.take_along_axis(values, at[None, :], axis=0)[0]
