"""Clips as batches for training: windows of one length, or whole clips in buckets.

    windows   every ``stride``-th window of ``length`` frames of every clip that is so long
    buckets   whole clips, each padded by its last frame to the next of 16, 24, 32, 48, 64, …
              (:func:`jaxmotion.frames.padding.bucket_size`); a batch has clips of one bucket

Shuffled, every window (or clip) comes once an epoch, in an order that the seed and the epoch alone
decide: permutations are NumPy's, 4 bytes a window. Batches are made in a thread while the training
step runs, by copying rows of files that are mapped into memory: O(frames of the batch).

Everything here is NumPy's and can be pickled: a process that gets it opens the files again, and no
clip travels. So other loaders take a :class:`WindowSource`, with worker processes too (grain's want
``absl.flags.FLAGS([""])`` before; torch's, ``multiprocessing_context="spawn"``, or JAX warns):

    grain.MapDataset.source(source).shuffle(seed=0).batch(32)
    torch.utils.data.DataLoader(source, 32, shuffle=True, collate_fn=source.collate)
"""

import operator
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any

import jax
import numpy as np

from jaxmotion._summary import line, some
from jaxmotion._types import Key
from jaxmotion.corpus.draws import entropy_of, generator
from jaxmotion.corpus.prefetch import prefetched
from jaxmotion.corpus.view import View
from jaxmotion.frames.padding import bucket_size
from jaxmotion.motion import Motion


class WindowSource(Sequence[Motion]):
    """Every window of some length of a corpus, by number: what grain and torch's DataLoader take.

    ``source[i]`` is a motion of NumPy arrays, ``len(source)`` how many there are, ``gather`` makes
    a batch of some. Clips that are shorter than the windows have none.

    **Fields:** ``length``: frames of a window; ``stride``: frames from one to the next; ``batch``,
    ``drop_last``, ``seed`` and others are those of :meth:`batches`.
    """

    _fields = ("length", "stride")

    def __init__(self, view: View, length: int, stride: int | None = None):
        self.length = _whole("length", length, 1)
        self.stride = self.length if stride is None else _whole("stride", stride, 1)
        self._view = view
        frames = view.lengths
        counts = np.maximum((frames - self.length) // self.stride + 1, 0)
        self._ends = np.cumsum(counts)
        if not len(self):
            raise ValueError(
                f"windows: length={self.length}; no clip is so long, the longest has "
                f"{frames.max(initial=0)} frames"
            )

    def __len__(self) -> int:
        return int(self._ends[-1])

    def __getitem__(self, index) -> Motion:
        number = operator.index(index)
        if not -len(self) <= number < len(self):
            raise IndexError(f"window {number} of {len(self)}")
        (clip,), (start,) = self._places(np.array([number % len(self)]))
        arrays = self._view.windows([clip], [start], self.length)
        return self._view.assembled([x[0] for x in arrays])

    def place(self, index: int) -> tuple[int, int]:
        """Where a window is from: the clip's number in the corpus, and its first frame."""
        (clip,), (start,) = self._places(np.array([range(len(self))[index]]))
        return int(clip), int(start)

    def gather(self, indices: Any) -> Motion:
        """A batch of windows by their numbers: a motion of NumPy arrays, clips in front."""
        clips, starts = self._places(np.asarray(indices, np.int64))
        return self._view.assembled(self._view.windows(clips, starts, self.length))

    @staticmethod
    def collate(windows: Sequence[Motion]) -> Motion:
        """Windows as a batch of NumPy arrays: the ``collate_fn`` of torch's DataLoader."""
        return jax.tree.map(lambda *x: np.stack(x), *windows)

    def batches(
        self,
        batch: int,
        *,
        shuffle: bool = True,
        seed: int | Key = 0,
        drop_last: bool = False,
        epochs: int | None = 1,
        prefetch: int = 2,
        device: Any = None,
        start: int = 0,
    ) -> "Batches":
        """The windows in batches; :meth:`Corpus.windows` says what the arguments are.

        **Arguments:** ``batch``, ``shuffle``, ``seed``, ``drop_last``, ``epochs``, ``prefetch``,
        ``device``, ``start``.
        **Returns:** :class:`Batches` of motions.
        **Raises:** ``ValueError`` for numbers that are none, and if no batch is full with
        ``drop_last``.
        """
        options: dict[str, Any] = {"shuffle": shuffle, "seed": seed, "drop_last": drop_last}
        options |= {"epochs": epochs, "prefetch": prefetch, "device": device, "start": start}
        return Batches(self, batch, **options)

    def chunks(
        self, batch: int, rng: np.random.Generator | None, drop_last: bool
    ) -> Iterator[np.ndarray]:
        """The numbers of the windows of every batch of an epoch."""
        count = len(self)
        order = None
        if rng is not None:
            order = np.arange(count, dtype=_least(count))
            rng.shuffle(order)  # pyright: ignore[reportArgumentType, reportCallIssue]
        for first in range(0, self.batches_an_epoch(batch, drop_last) * batch, batch):
            last = min(first + batch, count)
            yield np.arange(first, last) if order is None else order[first:last].astype(np.int64)

    def batches_an_epoch(self, batch: int, drop_last: bool) -> int:
        """How many batches an epoch has."""
        return len(self) // batch if drop_last else -(-len(self) // batch)

    def _places(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        clips = np.searchsorted(self._ends, numbers, side="right")
        before = np.where(clips > 0, self._ends[clips - 1], 0)
        return clips, (numbers - before) * self.stride

    def _key(self) -> tuple:
        return self._view.key(), self.length, self.stride

    def __eq__(self, other) -> bool:
        return isinstance(other, WindowSource) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        return boxed(self)

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield f"{some(len(self), 'window')} of {some(self.length, 'frame')}"
        yield f"stride {self.stride}"
        yield some(len(self._ends), "clip")


class PaddedClips:
    """Whole clips, by number, of which those of one bucket can be a batch."""

    _fields = ("smallest",)

    def __init__(self, view: View, smallest: int):
        self._view = view
        self._lengths = view.lengths
        self.buckets = np.array([bucket_size(int(n), smallest) for n in self._lengths])
        self.smallest = smallest

    def gather(self, indices: Any) -> tuple[Motion, np.ndarray]:
        """A batch of clips of one bucket, and how many frames of each count, i32."""
        clips = np.asarray(indices, np.int64)
        frames = int(self.buckets[clips].max())
        arrays = self._view.windows(clips, np.zeros_like(clips), frames)
        return self._view.assembled(arrays), self._lengths[clips].astype(np.int32)

    def chunks(
        self, batch: int, rng: np.random.Generator | None, drop_last: bool
    ) -> Iterator[np.ndarray]:
        """The numbers of the clips of every batch of an epoch."""
        found = []
        for size in np.unique(self.buckets):
            clips = np.flatnonzero(self.buckets == size)
            if rng is not None:
                rng.shuffle(clips)
            parts = [clips[k : k + batch] for k in range(0, len(clips), batch)]
            found += [part for part in parts if len(part) == batch or not drop_last]
        order = np.arange(len(found)) if rng is None else rng.permutation(len(found))
        return (found[k] for k in order)

    def batches_an_epoch(self, batch: int, drop_last: bool) -> int:
        """How many batches an epoch has."""
        return sum(1 for _ in self.chunks(batch, None, drop_last))

    def __eq__(self, other) -> bool:
        return isinstance(other, PaddedClips) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple:
        return self._view.key(), self.smallest

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        sizes = np.unique(self.buckets).tolist()
        yield some(len(self.buckets), "clip")
        yield f"padded to {', '.join(map(str, sizes[:6]))}{', …' * (len(sizes) > 6)} frames"


class Batches:
    """Batches of a corpus, an iterable that starts anew each time: of windows each is a motion, of
    whole clips a motion and the lengths of its clips.

    ``len()`` tells how many. A ``for`` loop that is left early ends the thread that makes them; the
    iterator can be closed too.

    **Fields:** ``source``: what they are made of; ``batch``: how many in one; ``epochs``, None for
    endless; ``shuffle``, ``drop_last``, ``prefetch``, ``device``, ``start``: as they were given.
    """

    _fields = ("source", "batch", "epochs", "shuffle")

    def __init__(
        self,
        source: "WindowSource | PaddedClips",
        batch: int,
        *,
        shuffle: bool = True,
        seed: int | Key = 0,
        drop_last: bool = False,
        epochs: int | None = 1,
        prefetch: int = 2,
        device: Any = None,
        start: int = 0,
    ):
        self.source, self.shuffle, self.drop_last, self.device = source, shuffle, drop_last, device
        self.batch = _whole("batch", batch, 1)
        self.epochs = None if epochs is None else _whole("epochs", epochs, 1)
        self.prefetch, self.start = _whole("prefetch", prefetch, 0), _whole("start", start, 0)
        self._entropy = entropy_of("batches", seed)
        self._each = source.batches_an_epoch(self.batch, drop_last)
        if not self._each:
            raise ValueError(
                f"batches: batch={batch} and drop_last leave none of {source!r}; give a smaller one"
            )

    def __len__(self) -> int:
        """How many batches there are, in all epochs.

        **Raises:** ``TypeError`` if they are endless.
        """
        if self.epochs is None:
            raise TypeError("batches: epochs=None is endless, and has no length")
        return max(self.epochs * self._each - self.start, 0)

    def __iter__(self) -> Iterator[Any]:
        return prefetched(self._made, self.prefetch)

    def _made(self) -> Iterator[Any]:
        for indices in self._indices():
            found = self.source.gather(indices)
            yield found if self.device is None else jax.device_put(found, self.device)

    def _indices(self) -> Iterator[np.ndarray]:
        epoch, skipped = divmod(self.start, self._each)
        while self.epochs is None or epoch < self.epochs:
            rng = generator(self._entropy, epoch) if self.shuffle else None
            yield from islice(self.source.chunks(self.batch, rng, self.drop_last), skipped, None)
            epoch, skipped = epoch + 1, 0

    def __eq__(self, other) -> bool:
        return isinstance(other, Batches) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash((self.source, self.batch, self.epochs, self._entropy))

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield f"{some(self._each, 'batch').replace('batchs', 'batches')} of {self.batch}"
        yield "endless" if self.epochs is None else some(self.epochs, "epoch")
        yield repr(self.source)


def boxed(thing: Any) -> np.ndarray:
    """What ``np.asarray`` makes of a sequence of motions: one object, and not all of their
    frames."""
    box = np.empty((), object)
    box[()] = thing
    return box


def _least(count: int) -> type[np.unsignedinteger]:
    return np.uint32 if count <= np.iinfo(np.uint32).max else np.uint64


def _whole(name: str, value: Any, least: int) -> int:
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if isinstance(value, bool) or number < least:
        raise ValueError(f"{name}={value!r}; expected a whole number of at least {least}")
    return number
