"""Many clips as one value: of one skeleton, at one rate, in files that are mapped into memory.

    corpus = jm.corpus.Corpus("captures/", fps=30, cache="captures.cache")
    corpus[3]                                   a Motion; corpus.names, .lengths, .skeleton
    train, test = corpus.split([0.9, 0.1])      by clip; also corpus.select("walk*"), .subset([...])
    corpus.windows(64, batch=32)                batches for training (:mod:`.windows`)
    corpus.batches(16)                          whole clips, padded into buckets
    corpus.statistics(), corpus.style()         one clip in memory at a time

Nothing is read before it is asked for, but for the first clip, whose skeleton is the corpus's, and
no more of the clips is in memory than what is in use. What was read once is kept in the folder
``cache`` in shards (:mod:`.shards` has the layout, :mod:`.store` says when they are made): 376
bytes a frame of 22 joints in float32, two of which are translated.

A corpus is a sequence of motions, for whatever takes a list of them: the ``context`` of
:func:`jaxmotion.cleaning.detect_errors`, :func:`jaxmotion.smoothing.motion_prior`.
"""

import fnmatch
import operator
from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal, SupportsIndex, TypeAlias, overload

import numpy as np

from jaxmotion._checks import one_of, warn
from jaxmotion._entry import skeleton_of
from jaxmotion._plain import quoted
from jaxmotion._stored import StoredClips
from jaxmotion._summary import line, some
from jaxmotion._types import Key
from jaxmotion.corpus.draws import entropy_of, generator
from jaxmotion.corpus.inputs import Clips, inputs_of
from jaxmotion.corpus.manner import corpus_style
from jaxmotion.corpus.statistics import CorpusStatistics, corpus_statistics
from jaxmotion.corpus.store import Store, settings_of
from jaxmotion.corpus.view import View
from jaxmotion.corpus.windows import Batches, PaddedClips, WindowSource, boxed
from jaxmotion.io.conventions import seconds_of
from jaxmotion.io.formats import Up
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton
from jaxmotion.style import MotionStyle

ExtraJoints: TypeAlias = Literal["refuse", "drop"]
OnError: TypeAlias = Literal["raise", "skip"]
_SMALLEST = 16


class Corpus(StoredClips):
    """Many clips as one value: of one skeleton, at one rate, read when they are asked for.

    ``corpus[i]`` is a :class:`~jaxmotion.Motion`, as :func:`jaxmotion.load` gives it;
    ``corpus[2:5]`` is a corpus of some. Pickled, a corpus takes along where its clips are and no
    clip: another process on the same machine opens the files again.

    **Arguments:**

    - ``clips``: a folder, of which all motion files are taken, and those of folders below it; a
      pattern (``"takes/*.bvh"``); or files and motions, in a list, or in a dictionary by name.
    - ``fps``: frames a second of the corpus; clips at another rate are resampled
      (:func:`jaxmotion.resample`, without smoothing), those at it to a rounding stay as they are.
      By default that of the first clip, which all must have.
    - ``cache``: a folder for what was read; by default a temporary one, gone with the corpus.
    - ``skeleton``: the corpus's, or a motion that has it; by default the first clip's. Joints are
      found by name, in any order, and must hang together alike; the bones' lengths are each clip's
      own.
    - ``joints``: patterns of names (``"Left*"``), for some of the skeleton's joints. What hangs
      from one that is left out stays in the world where it is.
    - ``extra_joints``: "refuse" a clip with joints that the skeleton lacks, or "drop" them
      likewise.
    - ``dtype``: float32 or float64; by default what :func:`jaxmotion.load` gives, or the first
      motion's.
    - ``up``: the axis that points up in the files, as in :func:`jaxmotion.load`.
    - ``on_error``: "raise" when a clip that cannot be used is asked for; or "skip" such clips, with
      a warning that counts them: then all are read at once.

    A cached clip is used again if its file's place, size and time of change are the same, and those
    options. Shards of clips that have changed stay in the folder until it is removed.

    **Raises:** ``ValueError`` for no clips, what is neither file nor clip, options that do not fit,
    and a first clip that cannot be read; ``OSError`` for files that are not there. When a clip is
    asked for, ``ValueError`` if it has other joints, another rate, up axis or dtype, or is damaged.

    **Example:**

        >>> import jaxmotion as jm
        >>> takes = {name: jm.samples.load(name).motion for name in ("walk", "run", "kick")}
        >>> corpus = jm.corpus.Corpus(takes, fps=30)
        >>> corpus.names, corpus.lengths.tolist(), corpus[0].rotations.shape
        (('walk', 'run', 'kick'), [120, 120, 75], (120, 22, 4))
        >>> train, test = corpus.split([2 / 3, 1 / 3], seed=0)
        >>> for batch in train.windows(16, batch=4, seed=0):
        ...     assert batch.rotations.shape[1:] == (16, 22, 4)
        >>> corpus.statistics().rotation_mean.shape
        (22, 4)
    """

    _fields = ("fps",)

    def __init__(
        self,
        clips: Clips,
        *,
        fps: float | int | None = None,
        cache: str | PathLike | None = None,
        skeleton: Skeleton | Motion | None = None,
        joints: Sequence[str] | None = None,
        extra_joints: ExtraJoints = "refuse",
        dtype: Any = None,
        up: Up | None = None,
        on_error: OnError = "raise",
    ):
        one_of("Corpus: extra_joints", extra_joints, ("refuse", "drop"))
        one_of("Corpus: on_error", on_error, ("raise", "skip"))
        if isinstance(joints, str):
            joints = [joints]
        inputs = inputs_of(clips)
        given = None if skeleton is None else skeleton_of("Corpus", skeleton)
        rate, skip = seconds_of(fps, "Corpus"), on_error == "skip"
        settings = settings_of(inputs, rate, given, joints, dtype, up, skip)
        if extra_joints == "drop":
            settings = settings._replace(may_drop=None)
        store = Store(inputs, settings, None if cache is None else Path(cache))
        self._view = View(store, np.arange(len(inputs)))
        if skip:
            self._view = _sound(self._view)

    @classmethod
    def _of(cls, view: View) -> "Corpus":
        new = object.__new__(cls)
        new._view = view
        return new

    @property
    def names(self) -> tuple[str, ...]:
        """Of each clip: its place below the folder that all are in, without the suffix."""
        return self._view.names

    @property
    def skeleton(self) -> Skeleton:
        """Names, tree and end sites of all clips, and the bones of the one they are from."""
        return self._view.store.settings.skeleton

    @property
    def fps(self) -> float:
        """Frames a second."""
        return 1.0 / self._view.store.settings.frame_time

    @property
    def dtype(self) -> np.dtype:
        """dtype of all clips."""
        return self._view.store.settings.dtype

    @property
    def lengths(self) -> np.ndarray:
        """Frames of each clip, i64[C]. Reads what is not yet cached."""
        return self._view.lengths

    def build(self, progress: Callable[[int, int], None] | None = None) -> None:
        """Read all clips that are not yet cached.

        **Arguments:** ``progress``: called with how many clips are done, and how many there are.
        **Raises:** ``ValueError`` that tells of the clips that cannot be used; all others are
        cached then.
        """
        store = self._view.store
        store.build(progress)
        faults = [x for x in map(store.fault, self._view.numbers.tolist()) if x]
        if faults:
            more = f"; and {len(faults) - 3} more" if faults[3:] else ""
            raise ValueError(f"Corpus: {'; '.join(faults[:3])}{more}")

    def subset(self, indices: Any) -> "Corpus":
        """Some of the clips.

        **Arguments:** ``indices``: numbers of clips, in the order wanted; or bool[C].
        **Returns:** a corpus on the same files.
        **Raises:** ``ValueError`` for none, and numbers that are no clip's.
        """
        chosen = np.asarray(indices)
        count = len(self)
        if chosen.dtype == bool and chosen.shape == (count,):
            chosen = np.flatnonzero(chosen)
        whole = chosen.dtype.kind in "iu" and chosen.ndim == 1
        if not whole or not ((chosen >= -count) & (chosen < count)).all() or not chosen.size:
            raise ValueError(
                f"subset: indices={quoted(str(indices))}; expected one or more of 0..{count - 1}"
            )
        return Corpus._of(View(self._view.store, self._view.numbers[chosen]))

    def select(self, *patterns: str) -> "Corpus":
        """The clips whose names match one of the shell patterns, such as ``"walk*"`` (any case).

        **Arguments:** ``patterns``: as of :mod:`fnmatch`, one or more.
        **Returns:** a corpus on the same files.
        **Raises:** ``ValueError`` if none matches.
        """
        found = [
            k
            for k, name in enumerate(self.names)
            if any(fnmatch.fnmatchcase(name.lower(), p.lower()) for p in patterns)
        ]
        if not found:
            listed = ", ".join(map(quoted, self.names[:6])) + (", …" if self.names[6:] else "")
            raise ValueError(f"select: no clip matches {', '.join(map(repr, patterns))}; {listed}")
        return self.subset(found)

    def split(self, fractions: Sequence[float], *, seed: int | Key = 0) -> tuple["Corpus", ...]:
        """Parts by clip, drawn at random: no clip is in two of them, and each is in one.

        **Arguments:** ``fractions``: of each part, of the number of clips; they sum to 1; ``seed``:
        a whole number or a key of JAX's.
        **Returns:** a corpus for each, its clips in their order here.
        **Raises:** ``ValueError`` for fractions that are none, and a part without clips.
        """
        share = np.asarray(fractions, np.float64)
        if share.ndim != 1 or not (share > 0).all() or abs(share.sum() - 1) > 1e-6:
            raise ValueError(f"split: fractions={fractions}; expected numbers above 0 with sum 1")
        ends = np.round(np.cumsum(share) * len(self)).astype(int)
        order = generator(entropy_of("split", seed)).permutation(len(self))
        parts = np.split(order, ends[:-1])
        if empty := [k for k, part in enumerate(parts) if not len(part)]:
            which, clips = empty[0], some(len(self), "clip")
            raise ValueError(f"split: part {which}, {share[which]:.3g} of {clips}, is empty")
        return tuple(self.subset(np.sort(part)) for part in parts)

    def shards(self) -> tuple["Corpus", ...]:
        """The corpus in parts, each of the clips that lie in one file of the cache: for workers
        that take a part each, as nothing is read for it and a part can be pickled.

        **Returns:** a corpus for each file, its clips in their order here.
        """
        places = np.array([self._view.store.place(k)[0] for k in self._view.numbers.tolist()])
        return tuple(self.subset(places == group) for group in dict.fromkeys(places.tolist()))

    def digest(self) -> str:
        """A text that only these clips have, in this order and brought to these options: of files
        their places, sizes and times of change, as for the cache; wherever that is.

        **Returns:** 32 letters.
        """
        return self._view.digest()

    def windows(
        self,
        length: int,
        batch: int,
        *,
        stride: int | None = None,
        shuffle: bool = True,
        seed: int | Key = 0,
        drop_last: bool = False,
        epochs: int | None = 1,
        prefetch: int = 2,
        device: Any = None,
        start: int = 0,
    ) -> Batches:
        """Windows of all clips in batches, for training.

        **Arguments:** ``length``: frames of a window (clips that are shorter have none); ``batch``:
        windows in one; ``stride``: frames from one window to the next, by default ``length``;
        ``shuffle``: in another order every epoch; ``seed``: of it, a whole number or a key of
        JAX's; ``drop_last``: without the last batch of an epoch if it is not full; ``epochs``: how
        often each window comes, None for endlessly; ``prefetch``: batches made ahead in a thread, 0
        for none and no thread; ``device``: a device or sharding to which the thread brings them,
        None for arrays of NumPy, which ``jax.jit`` takes; ``start``: batches to leave out, to go on
        where a training run ended.
        **Returns:** :class:`Batches` of motions f[B, length, J, ...], all arrays with the windows
        in front, ready for ``jax.vmap``.
        **Raises:** ``ValueError`` if no clip is so long, or no batch full with ``drop_last``.
        """
        options: dict[str, Any] = {"shuffle": shuffle, "seed": seed, "drop_last": drop_last}
        options |= {"epochs": epochs, "prefetch": prefetch, "device": device, "start": start}
        return Batches(self.window_source(length, stride), batch, **options)

    def window_source(self, length: int, stride: int | None = None) -> WindowSource:
        """Windows of all clips by number, for other loaders: a random-access source for grain, a
        map-style dataset for torch.

        **Arguments:** ``length``: frames of a window; ``stride``: from one to the next, by default
        ``length``.
        **Returns:** :class:`WindowSource`.
        **Raises:** ``ValueError`` if no clip is so long.
        """
        return WindowSource(self._view, length, stride)

    def batches(
        self,
        batch: int,
        *,
        smallest: int = _SMALLEST,
        shuffle: bool = True,
        seed: int | Key = 0,
        drop_last: bool = False,
        epochs: int | None = 1,
        prefetch: int = 2,
        device: Any = None,
        start: int = 0,
    ) -> Batches:
        """Whole clips in batches, those of one bucket together, so that few shapes are compiled.

        **Arguments:** ``batch``: clips in one; ``smallest``: the least bucket, even (then 1½, 2, 3,
        4, 6 times it, and so on); ``shuffle``, ``seed``, ``drop_last``, ``epochs``, ``prefetch``,
        ``device``, ``start``: as in :meth:`windows`, ``drop_last`` for every bucket.
        **Returns:** :class:`Batches` of a motion f[B, T, J, ...], clips padded by their last frame,
        and of their lengths, i32[B], for ``length=``: what :func:`jaxmotion.stack` gives.
        **Raises:** ``ValueError`` if no batch is full with ``drop_last``.
        """
        options: dict[str, Any] = {"shuffle": shuffle, "seed": seed, "drop_last": drop_last}
        options |= {"epochs": epochs, "prefetch": prefetch, "device": device, "start": start}
        return Batches(PaddedClips(self._view, smallest), batch, **options)

    def statistics(self) -> CorpusStatistics:
        """What is usual in the corpus, joint by joint: means, deviations, ranges, limits, speeds.

        One pass over the frames; memory for a few thousand frames. O(frames · J).

        **Returns:** :class:`CorpusStatistics`, in the corpus's dtype.
        """
        return corpus_statistics(self._view)

    def style(self) -> MotionStyle:
        """The manner of all clips together, for :func:`jaxmotion.style.apply_style`.

        :func:`jaxmotion.style.motion_style` of all of them with ``mean="chordal"``, one clip in
        memory at a time. O(frames · J). Source: Wu et al. 2006, §5.

        **Returns:** :class:`~jaxmotion.style.MotionStyle`, in the corpus's dtype.
        """
        return corpus_style(self._view)

    def __len__(self) -> int:
        return len(self._view.numbers)

    @overload
    def __getitem__(self, index: SupportsIndex) -> Motion:
        """A clip."""

    @overload
    def __getitem__(self, index: slice) -> "Corpus":
        """Some of the clips."""

    def __getitem__(self, index: SupportsIndex | slice) -> "Motion | Corpus":
        """A clip by its number, or a corpus of those in a slice."""
        if isinstance(index, slice):
            return self.subset(np.arange(len(self))[index])
        number = operator.index(index)
        if not -len(self) <= number < len(self):
            raise IndexError(f"clip {number} of a corpus of {len(self)}")
        return self._view.motion(number % len(self))

    def __iter__(self) -> Iterator[Motion]:
        return (self._view.motion(k) for k in range(len(self)))

    def __eq__(self, other) -> bool:
        return isinstance(other, Corpus) and self._view.key() == other._view.key()

    def __hash__(self) -> int:
        return hash(self._view.key())

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        return boxed(self)

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield some(len(self), "clip")
        yield f"{self.fps:.6g} fps"
        yield from self.skeleton._figure()
        yield f"{self.dtype}"


def _sound(view: View) -> View:
    """Without the clips that cannot be used, of which a warning tells."""
    view.store.build()
    faults = [view.store.fault(int(k)) for k in view.numbers]
    left = view.numbers[[fault is None for fault in faults]]
    told = [fault for fault in faults if fault is not None]
    if not len(left):
        raise ValueError(f"Corpus: none of the clips can be used: {told[0]}")
    if told:
        warn("Corpus", f"{some(len(told), 'clip')} of {len(faults)} left out; the first: {told[0]}")
    return View(view.store, left)
