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

Words go in blocks, side by side on the host's cores, or its devices; clips in parts of some ten
minutes (:mod:`.parts`), each of which has no more to look for than what may come before what was
found so far. Memory O(block · part), whatever the number of clips. Source: Aristidou et al. 2018,
§3; the bounds are ours.
"""

from collections.abc import Iterator, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxmotion._checks import one_of, static
from jaxmotion._portable import Portable
from jaxmotion._posture import upright
from jaxmotion._stored import StoredClips
from jaxmotion._summary import some
from jaxmotion._types import AnyArray
from jaxmotion.cleaning.bound import WordShape
from jaxmotion.cleaning.groups import as_clips, one_skeleton
from jaxmotion.cleaning.parts import all_nearest, needs_corpus
from jaxmotion.cleaning.search import Metric, Progress, Query, Tried
from jaxmotion.cleaning.words import check_sizes, chosen_joints, points, texture, word_starts
from jaxmotion.motion import Motion

if TYPE_CHECKING:
    from distributed import Client

_RUN = 3  # of "slope3"
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
    client: "Client | str | None" = None,
    keep: str | PathLike | None = None,
    progress: Progress | None = None,
) -> Neighbours:
    """The nearest words of every word of a clip, in the clip itself and in others. Exact.

    On the host; not differentiable, not under ``jit``. O(W·P·J) for P frames in all, of which few
    pairs are warped. A corpus may be larger than memory, and searched by many machines; the answer
    is that of one machine with all clips in a list, bit for bit.

    **Arguments:**

    - ``motion``: the clip whose words are asked for.
    - ``context``: clips of the same joints at the same rate, to a hundredth, in a list; or a
      :class:`jaxmotion.corpus.Corpus`, whose clips are read when their turn comes.
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
    - ``client``: who searches a corpus: a ``dask.distributed.Client``, the address of a scheduler,
      or "local" (:func:`jaxmotion.corpus.map`), whose workers see the corpus's files and cache;
      "processes", those of ``jax.distributed``, each of which calls this with the same arguments
      and gets the same answer; None for this process.
    - ``keep``: a folder for what is found in every part of a corpus: who asks the same again goes
      on from there. Nothing is taken away from it.
    - ``progress``: called with how many words are done, and how many there are.

    **Returns:** :class:`Neighbours`; no words of a clip of fewer than N frames.
    **Raises:** ``ValueError`` for what is traced or not finite, clips of other joints or rates,
    numbers that make no words, a ``trim`` that leaves no joint, a ``client`` that is none, or one
    without a corpus; ``ConnectionError`` as :func:`jaxmotion.corpus.map`; ``RuntimeError`` for
    clips that cannot be searched by workers.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk", fps=24.0, num_frames=96).motion
        >>> found = jm.cleaning.nearest_words(walk, k=2)
        >>> found.clip.shape, bool(found.distance[0, 0] < 0.01)
        ((18, 2), True)
    """
    caller = "nearest_words"
    needs_corpus(caller, context, client, keep)
    clips, frames, dtype = _looked_at(caller, motion, context)
    options = {"k": k, "trim": trim, "own": own, "pairs": pairs, "metric": metric, "dtype": dtype}
    query = _query(caller, motion, joints, (length, stride, target), **options)
    found, many = all_nearest(query, clips, frames, client=client, keep=keep, progress=progress)
    there = found.clip[..., None] >= 0
    return Neighbours(
        *(jnp.asarray(x) for x in (query.starts.astype(np.int32), found.clip, found.frame)),
        distance=jnp.asarray(found.distance),
        warp=jnp.asarray(np.where(there, found.frame[..., None] + found.warp.astype(np.int32), -1)),
        left_out=jnp.asarray(found.left_out),
        warped=found.warped / max(many, 1),
        joints=query.joints,
    )


def _query(
    caller: str,
    motion: Motion,
    joints: str | Sequence[int | str] | None,
    sizes: tuple[int, int, int],
    *,
    k: int,
    trim: int | None,
    pairs: Tried,
    metric: Metric,
    **rest: Any,
) -> Query:
    """What is looked for, if it can be; ``sizes``: length, stride, target."""
    length, stride, target = sizes
    one_of(f"{caller}: pairs", pairs, ("bounded", "all"))
    one_of(f"{caller}: metric", metric, ("pose", "points"))
    check_sizes(caller, length, stride)
    if not (isinstance(k, (int, np.integer)) and k >= 1 and target >= length):
        raise ValueError(f"{caller}: k={k}, target={target}; expected 1 and {length} at least")
    chosen = chosen_joints(caller, motion, joints)
    trim = (len(chosen) // TRIMMED if metric == "pose" else 0) if trim is None else trim
    if not 0 <= trim < len(chosen):
        raise ValueError(f"{caller}: trim={trim}; expected less than the {len(chosen)} joints")
    stands = upright(motion)
    words = np.asarray((texture if metric == "pose" else points)(motion, chosen, stands))
    return Query(
        words,
        word_starts(len(words), length, stride),
        stride,
        np.asarray(stands),
        chosen,
        k=int(k),
        shape=WordShape(length, target, _RUN, target // 2 + 1),
        trim=int(trim),
        pairs=pairs,
        metric=metric,
        **rest,
    )


def _looked_at(
    caller: str, motion: Motion, context: Motion | Sequence[Motion]
) -> tuple[Sequence[Motion], np.ndarray, np.dtype]:
    """The context's clips, frames of the motion and of each of them, and the dtype of all."""
    if not isinstance(context, StoredClips):
        clips = one_skeleton(caller, [motion, *as_clips(context)])
        _check_rates(caller, clips)
        dtype = np.result_type(*(clip.dtype for clip in clips))
        return clips[1:], np.array([len(clip) for clip in clips]), _computed(dtype)
    one_skeleton(caller, [motion])
    if context.skeleton.names != motion.skeleton.names:
        raise ValueError(f"{caller}: the corpus has other joints than the motion")
    _check_rates(caller, [motion, context[0]])
    frames = np.append(len(motion), context.lengths)
    return context, frames, _computed(np.result_type(motion.dtype, context.dtype))


def _computed(dtype: np.dtype) -> np.dtype:
    return np.dtype(jax.dtypes.canonicalize_dtype(dtype))


def _check_rates(caller: str, clips: Sequence[Motion]) -> None:
    """``ValueError`` for clips whose frames last longer or shorter than the first's."""
    times = np.array([float(clip.frame_time) for clip in clips])
    other = np.flatnonzero(np.abs(times / times[0] - 1) > _RATES)
    if other.size:
        rates = f"{1 / times[other[0]]:.4g} frames a second, the motion {1 / times[0]:.4g}"
        raise ValueError(
            f"{caller}: context[{other[0] - 1}] has {rates}; jaxmotion.resample brings them to one"
        )
