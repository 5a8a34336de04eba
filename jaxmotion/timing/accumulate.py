"""Dynamic programming over the anti-diagonals of a cost matrix, many pairs of clips side by side.

    C_s(i, j) = weight · D[i, j] + min over arrivals (Δi, Δj, r) of s   of   C_r(i − Δi, j − Δj)

i, j: frames of x and y; s, r: states of the step pattern. D ``(n, m)`` is taken strip by strip and
anti-diagonal by anti-diagonal (:mod:`jaxmotion.timing.antidiagonals`), one ``lax.scan`` in another.
The values of one state on one anti-diagonal are held as h + 1 numbers: first the one that enters
from the strip above, then the strip's own, so that a step in x is a read one place earlier. Every
path starts from a virtual cell of cost 0, the pattern's longest step before (0, 0).

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

_CACHED_VALUES = 2**17  # numbers a block of lanes may keep in flight: 1 MiB of float64
_MOST_LANES = 1024


class Ends(NamedTuple):
    """Accumulated values where a path may end, by state s.

    ``row_cost[j, s]`` is C_s at (last frame of x, j), ``column_cost[i, s]`` at (i, last frame of
    y); ``…_cells`` count the cells of those paths. What was not asked for has no states.
    ``arrivals[strip, k, i]`` packs how each state of the k-th cell of a strip's row i was entered.
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
    """(k back, state) of the anti-diagonals a step reads, and those that will become them."""
    reach = {}
    for way in (way for ways in pattern.arrivals for way in ways):
        reach[way.state] = max(reach.get(way.state, 0), way.di + way.dj)
    return [(back, s) for s in sorted(reach) for back in range(1, reach[s] + 1)]


def _scan_strips(cost, last_x, last_y, pattern, columns, count) -> Ends:
    """Ends of one block of lanes, ``(n, m, lanes)``, as they come: by strip and anti-diagonal."""
    strips = in_strips(cost)
    num_strips, h, m, lanes = strips.shape
    keys = _history_keys(pattern)
    states = range(len(pattern.arrivals))

    def histories(row_above, outside):
        """Before a strip's first step only what enters above its first cell is known."""
        blank = jnp.full((h + 1, lanes), outside, cost.dtype)
        return {(b, s): blank.at[0].set(row_above[s][0]) if b == 1 else blank for b, s in keys}

    def one_strip(rows_above, strip):
        number, d = strip
        costs = histories(rows_above[0], jnp.inf)
        start = jnp.where(number == 0, 0, jnp.inf).astype(cost.dtype)
        costs[pattern.depth, 0] = costs[pattern.depth, 0].at[0].set(start)
        cells = histories(rows_above[1], 0) if count else {}

        def diagonal(carry, row):
            costs, cells = carry
            k, d, enter_costs, enter_cells = row
            new_costs, new_cells, code = _enter_cells(pattern, d, costs, cells)
            at = jnp.clip(k - last_y, 0, h - 1)
            ends = Ends(
                _take_row(new_costs, last_x % h, lanes),
                _take_row(new_cells, last_x % h, lanes),
                _take_row(new_costs if columns else [], at, lanes),
                _take_row(new_cells if columns else [], at, lanes),
                code,
            )
            carry = (
                _advance(keys, costs, new_costs, enter_costs),
                _advance(keys, cells, new_cells, enter_cells),
            )
            bottom = ([v[-1] for v in new_costs], [v[-1] for v in new_cells])
            return carry, (bottom, ends)

        above = (
            [entering(row, h, jnp.inf) for row in rows_above[0]],
            [entering(row, h, 0.0) for row in rows_above[1]],
        )
        k = jnp.arange(m + h - 1, dtype=jnp.int32)
        bottom, ends = lax.scan(diagonal, (costs, cells), (k, skew(d), *above))[1]
        return jax.tree.map(lambda row: row[h - 1 :], bottom), ends

    unreached = [jnp.full((m, lanes), jnp.inf, cost.dtype) for _ in states]
    no_cells = [jnp.zeros((m, lanes), cost.dtype) for _ in states] if count else []
    numbered = (jnp.arange(num_strips, dtype=jnp.int32), strips)
    return lax.scan(one_strip, (unreached, no_cells), numbered)[1]


def _gather_ends(ends: Ends, last_x, last_y, *, n: int, m: int) -> Ends:
    """From values by strip and anti-diagonal to values by frame, of one pair."""
    h = strip_rows(n)

    def along_row(values):
        in_strip = lax.dynamic_index_in_dim(values, last_x // h, keepdims=False)
        return lax.dynamic_slice_in_dim(in_strip, last_x % h, m)

    def along_column(values):
        by_row = lax.dynamic_slice_in_dim(values, last_y, h, axis=1)
        return by_row.reshape(by_row.shape[0] * h, values.shape[-1])[:n]

    return Ends(
        along_row(ends.row_cost),
        along_row(ends.row_cells),
        along_column(ends.column_cost),
        along_column(ends.column_cells),
        ends.arrivals,
    )


def _enter_cells(pattern, d, costs, cells):
    """Costs, cell counts and packed arrivals of every state on one anti-diagonal."""
    dtype = jnp.uint8  # every pattern's arrivals pack into a byte; slope3 needs 112 values
    code = jnp.zeros(d.shape, dtype)
    new_costs, new_cells = [], []
    for radix, ways in zip(arrival_radix(pattern), pattern.arrivals, strict=True):
        values, lengths = [], []
        for way in ways:
            key = (way.di + way.dj, way.state)
            source = slice(None, -1) if way.di else slice(1, None)
            extra = pattern.weight(way.di, way.dj) - 1
            values.append(costs[key][source] + extra * d if extra else costs[key][source])
            lengths.append(cells[key][source] if cells else None)
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


def _advance(keys, old, new, enter):
    """The next step's history; new values get what enters above them as row 0."""
    if not new:
        return {}
    latest = [jnp.concatenate([e[None], v]) for e, v in zip(enter, new, strict=True)]
    return {(back, s): old[back - 1, s] if back > 1 else latest[s] for back, s in keys}


def _take_row(states: list[Array], at, lanes: int) -> Array:
    """Every state's value at one row, or at one row per lane: ``(states, lanes)``."""
    if not states:
        return jnp.zeros((0, lanes), jnp.uint8)
    if jnp.ndim(at) == 0:
        return jnp.stack([values[at] for values in states])
    return jnp.stack([jnp.take_along_axis(v, at[None, :], axis=0)[0] for v in states])
