"""All levels in turn: down by R with what each leaves out, up by E with what each is given.

The finest levels of a long clip are compiled for their own sizes; all others run as one loop over
arrays padded to the largest, each with its own count of frames. Each level there costs what the
largest of them does, and a gradient keeps padded arrays for it, so the loop is left to levels that
are short; compiling costs seven levels at most however many there are.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion.multiresolution.kernels import Rotations
from jaxmotion.multiresolution.levels import (
    FinestLevel,
    Level,
    continued,
    expanded,
    level_of,
    reduced,
)
from jaxmotion.multiresolution.poses import Poses
from jaxmotion.multiresolution.rows import interleaved
from jaxmotion.multiresolution.schedule import Schedule, level_sizes

_LONG, _UNROLLED = 150, 6


def descend(
    finest: FinestLevel, levels: int, lazy: bool, describe: Callable[[Poses, Poses], Any]
) -> tuple[Level, list[Any]]:
    """Halve ``levels`` times. ``describe(poses, expanded)`` is what is kept of each level (lazy:
    of its odd frames), fine to coarse."""
    sizes = level_sizes(finest.rotations.num_frames, levels)
    kept = []

    def halved(fine: Level | FinestLevel) -> tuple[Level, Any]:
        coarse = reduced(fine, smooth=not lazy)
        spacing = None if fine.spacing is None else continued(fine.spacing, fine.count)
        even, odd = expanded(coarse, spacing)
        poses = fine.translations, fine.rotations
        rows = fine.rotations.num_frames
        if lazy:
            return coarse, describe(jax.tree.map(lambda x: x[1::2], poses), odd)
        return coarse, describe(poses, merged(even, odd, rows))

    unrolled, fine = _unrolled(sizes), finest
    for _ in range(unrolled):
        fine, description = halved(fine)
        kept.append(description)
    if isinstance(fine, FinestLevel):  # the loop carries steps
        fine = level_of(fine.translations, fine.rotations, fine.spacing, fine.count)
    if unrolled < levels:
        rows = fine.rotations.num_frames

        def again(level: Level, _):
            coarse, description = halved(level)
            return _padded_level(coarse, rows), description

        fine, stacked = jax.lax.scan(again, fine, None, levels - unrolled)
        for k, size in enumerate(sizes[unrolled:-1]):
            size = size // 2 if lazy else size
            kept.append(jax.tree.map(lambda x, k=k, size=size: x[k, :size], stacked))
        fine = _padded_level(fine, sizes[-1])
    return fine, kept


def _unrolled(sizes: list[int]) -> int:
    """How many of the finest levels are compiled each for its own size."""
    levels = len(sizes) - 1
    long = sum(size > _LONG for size in sizes[:_UNROLLED])
    return levels if levels - long <= 1 else min(long, levels)


def _padded_level(level: Level, rows: int) -> Level:
    """The level with ``rows`` frames, the last repeated or dropped."""
    more = rows - level.rotations.num_frames

    def fitted(part):
        return jax.tree.map(lambda x: _fitted(x, len(x) + more), part)

    p, q, moves, turns, spacing, count = level
    return Level(fitted(p), fitted(q), fitted(moves), fitted(turns), fitted(spacing), count)


def _fitted(x: Float[Array, "frame *rest"], rows: int) -> Float[Array, "row *rest"]:
    if len(x) >= rows:
        return x[:rows]
    return jnp.pad(x, ((0, rows - len(x)),) + ((0, 0),) * (x.ndim - 1), "edge")


def ascend(
    poses: Poses,
    data: list[Any],
    combine: Callable[[Poses, Any], tuple[Poses, Any]],
    schedule: Schedule,
) -> tuple[Poses, list[Any]]:
    """Double once for each entry of ``data``, coarse to fine. ``combine(expanded, datum)`` makes a
    level's poses (lazy: its odd ones) and something to keep; data are f[T, J] or f[J]. What is kept
    of the looped levels is padded."""
    frames, skips, counts, spacings, lazy = schedule
    levels = schedule.levels
    looped = levels - _unrolled(list(frames[::-1]))
    kept = []

    def doubled(poses, datum, count, spacing, fine_spacing, rows, cut):
        even, odd = expanded(level_of(poses[0], poses[1], spacing, count), fine_spacing)
        if not lazy:
            return combine(jax.tree.map(cut, merged(even, odd, rows)), datum)
        odd, result = combine(odd, datum)
        return jax.tree.map(cut, merged(even, odd, rows)), result

    if looped:
        rows = frames[looped]
        view = min(rows // 2 + 2, rows)
        size = view - 1 if lazy else rows

        def stacked(*x: Array) -> Array:
            return jnp.stack([_fitted(y, size) if y.ndim > 1 else y for y in x])

        stack = jax.tree.map(stacked, *data[:looped])
        h = fine_h = None
        if spacings is not None:
            pairs = zip(spacings[1 : looped + 1], counts[1 : looped + 1], strict=True)
            h = jnp.stack([_fitted(x, view - 1) for x in spacings[:looped]])
            fine_h = jnp.stack([_fitted(continued(x, c), 2 * view - 2) for x, c in pairs])

        def again(poses, level):
            datum, count, skip, h, fine_h = level
            some = first_rows(poses, view)
            return doubled(
                some,
                datum,
                count,
                h,
                fine_h,
                2 * view - 1,
                lambda x: jax.lax.dynamic_slice_in_dim(x, skip, rows),
            )

        poses = jax.tree.map(lambda x: _fitted(x, rows), poses)
        inputs = stack, jnp.stack(counts[:looped]), np.asarray(skips[:looped], int), h, fine_h
        poses, results = jax.lax.scan(again, poses, inputs)
        kept = [jax.tree.map(lambda x, n=n: x[n], results) for n in range(looped)]
    for n in range(looped, levels):
        h = fine_h = None
        if spacings is not None:
            h, fine_h = spacings[n], continued(spacings[n + 1], counts[n + 1])
        start = skips[n]
        poses, result = doubled(
            first_rows(poses, frames[n]),
            data[n],
            counts[n],
            h,
            fine_h,
            start + frames[n + 1],
            lambda x, start=start: x[start:],
        )
        kept.append(result)
    return first_rows(poses, frames[-1]), kept


def first_rows(poses: Poses, rows: int) -> Poses:
    """The first frames."""
    return jax.tree.map(lambda x: x[:rows], poses)


def merged(even: Poses, odd: Poses, rows: int) -> Poses:
    """Even and odd frames in turn, the first ``rows`` of them."""
    (p, r), (new_p, new_r) = even, odd
    rotations = Rotations(*(interleaved(x, y, rows) for x, y in zip(r, new_r, strict=True)))
    return interleaved(p, new_p, rows), rotations
