"""The nearest of all words: those at which the body does most nearly the same.

A word of N frames is compared with M frames that begin at every frame of every clip, in D of
:func:`jaxmotion.timing.pose_distance` (the largest joint terms left out) by DTW ("slope3": at most
three steps on end along one axis), from both first frames to the word's last frame and a frame of
the target after its middle, where the mean of D along the path is least. Neighbours are the K least
of the local minima over a clip: less than the frame before, no more than the next. In the word's
own clip those whose middles are less than N/2 frames apart are left out. Equals go by clip, then
frame.

Most pairs are never warped (:mod:`.bound`): of each word the targets of least bound are, and
more until K local minima are known to be; what could still come before the last of them is warped
then, and nothing else. A target is known for a minimum when the targets beside it are warped or
their bounds are above it. The answer is that of warping all pairs, bit for bit.

Words go in blocks, side by side on the host's cores: memory O(block · pool). Source: Aristidou et
al. 2018, §3; the bound is ours.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Literal, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmotion._checks import one_of, static
from jaxmotion._portable import Portable
from jaxmotion._posture import upright
from jaxmotion._summary import some
from jaxmotion._types import AnyArray
from jaxmotion.cleaning.bound import WordShape
from jaxmotion.cleaning.groups import as_clips, one_skeleton
from jaxmotion.cleaning.pairs import Pairs, Pool, frame_distances, pooled
from jaxmotion.cleaning.words import check_sizes, chosen_joints, points, texture, word_starts
from jaxmotion.motion import Motion

Tried: TypeAlias = Literal["bounded", "all"]
Metric: TypeAlias = Literal["pose", "points"]
Progress: TypeAlias = Callable[[int, int], None]

_RUN = 3  # of "slope3"
_WORDS = 32  # a block
_FIRST = 48  # targets of least bound that are warped first
_RATES = 0.01  # that rates may differ by
TRIMMED = 8  # one joint in so many is left out


class Neighbours(Portable):
    """The K nearest words of every word; fewer where there are no more, then clip −1, distance inf.

    **Fields:** ``starts``: i32[W], the frame that each word begins at; ``clip``: i32[W, K], 0 for
    the word's own clip, from 1 on the context's; ``frame``: i32[W, K], where the neighbour begins
    in it; ``distance``: f[W, K], mean D along the path, squared half-angle radians; ``warp``:
    i32[W, K, N], the clip's frame beside each frame of the word, the middle one of several;
    ``left_out``: f[W], the least that a pair can be that was not warped, above every distance of
    the word: why the answer is exact; inf where all were; ``warped``: the share of all pairs that
    were; ``joints``: their numbers, static.
    """

    starts: Int[AnyArray, " word"]
    clip: Int[AnyArray, "word k"]
    frame: Int[AnyArray, "word k"]
    distance: Float[AnyArray, "word k"]
    warp: Int[AnyArray, "word k frame"]
    left_out: Float[AnyArray, " word"]
    warped: float
    joints: tuple[int, ...] = eqx.field(static=True)

    def _words(self) -> Iterator[str]:
        yield some(self.clip.shape[0], "word")
        yield f"{self.clip.shape[1]} neighbours"
        yield f"{100 * self.warped:.3g} % of pairs warped"


@static("k", "length", "stride", "target", "joints", "trim", "own", "pairs", "metric")
def nearest_words(
    motion: Motion,
    context: Motion | Sequence[Motion] = (),
    *,
    k: int = 8,
    length: int = 15,
    stride: int = 5,
    target: int = 20,
    joints: str | Sequence[int | str] | None = "whole",
    trim: int | None = None,
    own: bool = True,
    pairs: Tried = "bounded",
    metric: Metric = "pose",
    progress: Progress | None = None,
) -> Neighbours:
    """The nearest words of every word of a clip, in the clip itself and in others. Exact.

    On the host; not differentiable, not under ``jit``. O(W·P·J) for P frames in all, of which few
    pairs are warped.

    **Arguments:**

    - ``motion``: the clip whose words are asked for.
    - ``context``: clips of the same joints at the same rate, to a hundredth.
    - ``k``: K, how many neighbours.
    - ``length``: N, frames of a word; ``stride``: frames from word to word; ``target``: M ≥ N,
      frames of what a word is compared with.
    - ``joints``: as :func:`motion_words`.
    - ``trim``: how many of the largest joint terms are left out of a pair of frames, by default one
      of eight joints (3 of 24).
    - ``own``: whether the clip itself is searched as well.
    - ``pairs``: "all" warps every pair, for tests.
    - ``metric``: "pose" compares rotations; "points" joints' positions and velocities (a tenth of a
      second of them), as seen from the body's place on the ground and its yaw, D in squared file
      units and nothing trimmed by default: the distance of Chai & Hodgins 2005.
    - ``progress``: called with how many words are done, and how many there are.

    **Returns:** :class:`Neighbours`; no words of a clip of fewer than N frames.
    **Raises:** ``ValueError`` for what is traced or not finite, clips of other joints or rates,
    numbers that make no words, a ``trim`` that leaves no joint.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk", fps=24.0, num_frames=96).motion
        >>> found = jm.cleaning.nearest_words(walk, k=2)
        >>> found.clip.shape, bool(found.distance[0, 0] < 0.01)
        ((18, 2), True)
    """
    caller = "nearest_words"
    one_of(f"{caller}: pairs", pairs, ("bounded", "all"))
    check_sizes(caller, length, stride)
    others = as_clips(context)
    clips = one_skeleton(caller, [motion, *others])
    _check_rates(caller, clips)
    shape = WordShape(length, target, _RUN, target // 2 + 1)
    if not (isinstance(k, (int, np.integer)) and k >= 1 and target >= length):
        raise ValueError(f"{caller}: k={k}, target={target}; expected 1 and {length} at least")
    chosen = chosen_joints(caller, motion, joints)
    one_of(f"{caller}: metric", metric, ("pose", "points"))
    trim = (len(chosen) // TRIMMED if metric == "pose" else 0) if trim is None else trim
    if not 0 <= trim < len(chosen):
        raise ValueError(f"{caller}: trim={trim}; expected less than the {len(chosen)} joints")
    stands = upright(motion)
    seen = texture if metric == "pose" else points
    textures = [seen(clip, chosen, stands) for clip in clips]
    pool = pooled(textures, shape, own=own)
    starts = word_starts(motion.num_frames, length, stride)
    search = partial(_search, textures[0], pool, int(k), shape, int(trim), pairs, own)
    found = _in_blocks(search, starts, progress)
    parts = [part for part, _ in found] or [_nothing(k, length, motion.dtype)]
    names = "clip", "frame", "distance", "warp", "left_out"
    columns = zip(names, zip(*parts, strict=True), strict=True)
    whole = {name: jnp.asarray(np.concatenate(part)) for name, part in columns}
    warped = sum(many for _, many in found) / max(len(starts) * int(pool.fits.sum()), 1)
    first = jnp.asarray(starts, jnp.int32)
    return Neighbours(starts=first, **whole, warped=warped, joints=chosen)


def _check_rates(caller: str, clips: Sequence[Motion]) -> None:
    """``ValueError`` for clips whose frames last longer or shorter than the first's."""
    times = np.array([float(clip.frame_time) for clip in clips])
    other = np.flatnonzero(np.abs(times / times[0] - 1) > _RATES)
    if other.size:
        rates = f"{1 / times[other[0]]:.4g} frames a second, the motion {1 / times[0]:.4g}"
        raise ValueError(
            f"{caller}: context[{other[0] - 1}] has {rates}; jaxmotion.resample brings them to one"
        )


def _in_blocks(search: Callable, starts: np.ndarray, progress: Progress | None) -> list:
    """What the search finds for the words, a block at a time, on every core there is."""
    blocks = [starts[i : i + _WORDS] for i in range(0, len(starts), _WORDS)]
    found, done = [], 0
    workers = ThreadPoolExecutor(_cores())
    try:
        for block, result in zip(blocks, workers.map(search, blocks), strict=True):
            found.append(result)
            done += len(block)
            if progress is not None:
                progress(done, len(starts))
    finally:
        workers.shutdown(cancel_futures=True)
    return found


def _cores() -> int:
    """How many there are for this process."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _search(
    words: Array,
    pool: Pool,
    k: int,
    shape: WordShape,
    trim: int,
    pairs: Tried,
    own: bool,
    starts: np.ndarray,
) -> tuple[tuple[np.ndarray, ...], int]:
    """Clip, frame, distance and warp of the neighbours of a block of words, what the least left out
    can be, and how many pairs were warped."""
    filled = np.append(starts, np.repeat(starts[-1:], _WORDS - len(starts)))
    rows = filled[0] + np.arange(_rows(filled, shape))
    d = frame_distances(words[np.minimum(rows, len(words) - 1)], pool.poses, trim)
    places = filled - filled[0]
    known = Pairs(d, places, shape, len(starts), pool)
    apart = np.abs(2 * (pool.frame - starts[:, None]) + shape.target - shape.length)
    allowed = pool.fits & ~(own & (pool.clip == 0) & (apart < shape.length))
    if pairs == "all":
        known.warp(np.broadcast_to(pool.fits, allowed.shape))
    else:
        _warp_what_may_be_near(known, allowed, k)
    minima = allowed & known.minima()
    best = _least(np.where(minima, known.exact, np.inf), k)
    distance, there = (np.take_along_axis(x, best, axis=1) for x in (known.exact, minima))
    warp = known.paths(best) + pool.frame[best][..., None]
    return (
        np.where(there, pool.clip[best], -1).astype(np.int32),
        np.where(there, pool.frame[best], -1).astype(np.int32),
        np.where(there, distance, np.inf),
        np.where(there[..., None], warp, -1).astype(np.int32),
        np.where(allowed & ~known.done, known.least, np.inf).min(axis=1),
    ), known.warped


def _warp_what_may_be_near(known: Pairs, allowed: np.ndarray, k: int) -> None:
    """Warp pairs until the K least minima of every word are among them: those of least bound, until
    there are K minima at all, then whatever may still come before the last of them."""
    many = _FIRST
    known.warp(_least_bounded(np.where(allowed, known.least, np.inf), many))
    while True:
        minima = allowed & known.minima()
        worst = _kth(np.where(minima, known.exact, np.inf), k)[:, None]
        short = np.isinf(worst)
        wanted = allowed & ~known.done & ~short & (known.least <= worst)
        # A low target is a minimum when what stands beside it is known to be no lower.
        unsure = allowed & known.done & ~minima & (known.exact <= worst)
        wanted[:, 1:] |= unsure[:, :-1] & (known.least[:, 1:] <= known.exact[:, :-1])
        wanted[:, :-1] |= unsure[:, 1:] & (known.least[:, :-1] <= known.exact[:, 1:])
        if short.any():
            many *= 2
            left = np.where(allowed & ~known.done & short, known.least, np.inf)
            wanted |= _least_bounded(left, many)
        if not known.warp(wanted):
            return


def _rows(places: np.ndarray, shape: WordShape) -> int:
    """Rows of a block of words, one number for all full blocks."""
    return int(places[-1] - places[0]) + shape.length


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


def _nothing(k: int, length: int, dtype) -> tuple[np.ndarray, ...]:
    """Results of no words."""
    none = np.zeros((0, k), np.int32)
    far = np.zeros((0, k), dtype)
    return none, none, far, np.zeros((0, k, length), np.int32), far[:, 0]
