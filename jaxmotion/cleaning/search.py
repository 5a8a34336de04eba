"""The search for the nearest words in one pool of clips: blocks of words, side by side.

What is warped, and what a target is known for a minimum by, is told in :mod:`.neighbours`. A
``bound`` is a distance that the K-th of a word's neighbours is known not to pass, by what was found
in other pools: what lies beyond is neither looked for nor told.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from jax.sharding import Mesh

from jaxmotion._cluster.connections import cores
from jaxmotion._width import kept_wide, wide
from jaxmotion.cleaning.bound import WordShape
from jaxmotion.cleaning.pairs import Pairs, Pool, frame_distances

Tried: TypeAlias = Literal["bounded", "all"]
Metric: TypeAlias = Literal["pose", "points"]
Progress: TypeAlias = Callable[[int, int], None]

_WORDS = 32  # a block, of each device
_FIRST = 48  # targets of least bound that are warped first


class Query(NamedTuple):
    """What is looked for, in NumPy: ``words`` f[T, J, 4] or f[T, J, 6], the clip as it is compared;
    ``starts`` i[W], ``stride`` apart at most; ``stands`` f[3] and ``joints``, by which other clips
    are brought to that; ``k``, ``shape``, ``trim``, ``pairs``, ``metric``, ``own``: as
    :func:`nearest_words` has them; ``dtype``: that all is computed in."""

    words: np.ndarray
    starts: np.ndarray
    stride: int
    stands: Any
    joints: tuple[int, ...]
    k: int
    shape: WordShape
    trim: int
    pairs: Tried
    metric: Metric
    own: bool
    dtype: np.dtype


class Found(NamedTuple):
    """Of words: ``clip`` i32[W, K], −1 where there is none, ``frame`` i32[W, K], ``distance`` f[W,
    K], ``warp`` u[W, K, N], frames after that ``frame``; ``left_out`` f[W]; ``warped``: pairs."""

    clip: np.ndarray
    frame: np.ndarray
    distance: np.ndarray
    warp: np.ndarray
    left_out: np.ndarray
    warped: int


def nothing(words: int, query: Query) -> Found:
    """No neighbours."""
    none = np.full((words, query.k), -1, np.int32)
    warp = np.zeros((words, query.k, query.shape.length), offsets(query.shape))
    far = np.full((words, query.k), np.inf, query.dtype)
    return Found(none, none.copy(), far, warp, np.full(words, np.inf, query.dtype), 0)


def offsets(shape: WordShape) -> np.dtype:
    """The least dtype of a target's frames."""
    return np.min_scalar_type(shape.target)


def search(
    query: Query,
    pool: Pool,
    mesh: Mesh,
    words: slice,
    bound: np.ndarray,
    progress: Callable[[int], None] = lambda done: None,
) -> Found:
    """What is nearest to some of the words in a pool, on every core there is; ``progress``: called
    with how many of them are done."""
    starts = query.starts[words]
    size = mesh.size * _WORDS
    blocks = [(starts[i : i + size], bound[i : i + size]) for i in range(0, len(starts), size)]
    on, found, done = wide(), [], 0

    def one(block: tuple[np.ndarray, np.ndarray]) -> Found:
        with kept_wide(on):
            return _of_block(query, pool, mesh, *block)

    workers = ThreadPoolExecutor(max(1, _cores() // mesh.size))
    try:
        for block, result in zip(blocks, workers.map(one, blocks), strict=True):
            found.append(result)
            done += len(block[0])
            progress(done)
    finally:
        workers.shutdown(cancel_futures=True)
    *arrays, warped = zip(*(found or [nothing(0, query)]), strict=True)
    return Found._make([*map(np.concatenate, arrays), sum(warped)])


def _cores() -> int:
    """How many there are for this process, or its share: what JAX's threads are told by."""
    share = os.environ.get("NPROC", "")
    return min(cores(), int(share)) if share.isdecimal() and int(share) else cores()


def _of_block(query: Query, pool: Pool, mesh: Mesh, starts: np.ndarray, bound: np.ndarray) -> Found:
    """What is nearest to a block of words, what the least left out can be, and how many pairs were
    warped."""
    k, shape = query.k, query.shape
    size = mesh.size * _WORDS
    filled = np.append(starts, np.repeat(starts[-1:], size - len(starts)))
    filled = filled.reshape(mesh.size, _WORDS)
    first = filled[:, :1]
    rows = first + np.arange(_rows(filled, query))
    words = query.words[np.minimum(rows, len(query.words) - 1)].astype(query.dtype, copy=False)
    d = frame_distances(words, pool.poses, query.trim, mesh)
    known = Pairs(d, filled - first, shape, len(starts), pool, mesh)
    apart = np.abs(2 * (pool.frame - starts[:, None]) + shape.target - shape.length)
    allowed = pool.fits & ~((pool.clip == 0) & (apart < shape.length))
    bound = bound[:, None]
    if query.pairs == "all":
        known.warp(np.broadcast_to(pool.fits, allowed.shape))
    else:
        _warp_what_may_be_near(known, allowed, k, bound)
    minima = allowed & known.minima() & (known.exact <= bound)
    best = _least(np.where(minima, known.exact, np.inf), k)
    distance, there = (np.take_along_axis(x, best, axis=1) for x in (known.exact, minima))
    warp = known.paths(best)
    return Found(
        np.where(there, pool.clip[best], -1).astype(np.int32),
        np.where(there, pool.frame[best], -1).astype(np.int32),
        np.where(there, distance, np.inf).astype(query.dtype, copy=False),
        np.where(there[..., None], warp, 0).astype(offsets(shape)),
        np.where(allowed & ~known.done, known.least, np.inf).min(axis=1),
        known.warped,
    )


def _warp_what_may_be_near(known: Pairs, allowed: np.ndarray, k: int, bound: np.ndarray) -> None:
    """Warp pairs until the K least minima of every word are among them, or those within the
    ``bound`` f[B, 1]: those of least bound, until there are K minima at all, then whatever may
    still come before the last of them."""
    many = _FIRST
    allowed = allowed & (known.least <= bound)
    known.warp(_least_bounded(np.where(allowed, known.least, np.inf), many))
    while True:
        minima = allowed & known.minima()
        worst = _kth(np.where(minima, known.exact, np.inf), k)[:, None]
        short = np.isinf(worst)
        wanted = allowed & ~known.done & ~short & (known.least <= worst)
        # A low target is a minimum when what stands beside it is known to be no lower.
        unsure = allowed & known.done & ~minima & (known.exact <= np.minimum(worst, bound))
        wanted[:, 1:] |= unsure[:, :-1] & (known.least[:, 1:] <= known.exact[:, :-1])
        wanted[:, :-1] |= unsure[:, 1:] & (known.least[:, :-1] <= known.exact[:, 1:])
        if short.any():
            many *= 2
            left = np.where(allowed & ~known.done & short, known.least, np.inf)
            wanted |= _least_bounded(left, many)
        if not known.warp(wanted):
            return


def _rows(starts: np.ndarray, query: Query) -> int:
    """Rows of a block of words: as many as full blocks have, or a half or a quarter of them, for
    every number is compiled for."""
    needed = int((starts[:, -1] - starts[:, 0]).max()) + query.shape.length
    full = (_WORDS - 1) * query.stride + query.shape.length
    return min(size for size in (-(-full // 4), -(-full // 2), full) if size >= needed)


def _least_bounded(bounds: np.ndarray, many: int) -> np.ndarray:
    """Where the least ``many`` of each row are, those that are finite."""
    chosen = np.zeros(bounds.shape, bool)
    many = min(many, bounds.shape[1])
    np.put_along_axis(chosen, np.argpartition(bounds, many - 1, axis=1)[:, :many], True, axis=1)
    return chosen & np.isfinite(bounds)


def _kth(values: np.ndarray, k: int) -> np.ndarray:
    """The k-th least of every row."""
    if values.shape[1] < k:
        return np.full(len(values), np.inf, values.dtype)
    return np.partition(values, k - 1, axis=1)[:, k - 1]


def _least(values: np.ndarray, k: int) -> np.ndarray:
    """Where the k least of every row are, in order; of equals the first."""
    best = np.zeros((len(values), k), int)
    for row, (kth, chosen) in enumerate(zip(_kth(values, k), best, strict=True)):
        found = np.flatnonzero(values[row] <= kth)
        found = found[np.argsort(values[row, found], kind="stable")][:k]
        chosen[: len(found)] = found
    return best
