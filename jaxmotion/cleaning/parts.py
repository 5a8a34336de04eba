"""The search for the nearest words in clips of any number, a part of them at a time.

A part is some clips on end, of 16384 frames, or one that is longer: what is in memory at once. In
every part the K least of a word's local minima are found, and merged by (distance, clip, frame):
the answer for all, as a minimum depends on its own clip only, no clip is in two parts, and a pair's
distance is the same number whatever is computed beside it. The K-th distance so far bounds what is
looked for in later parts; a part that was searched with any such bound is done for good.

Parts are searched in this process, or by workers: of dask, through :mod:`jaxmotion._cluster.tasks`,
to which the clip goes once and each part as the numbers of its clips; or the processes of
``jax.distributed``, every one of which takes its share and has all answers in the end. Then words
go some hundreds at a time too, a tile of words and clips to a task. What is found in a tile may be
kept in a file: whoever asks the same again takes up from there.
"""

import hashlib
import io
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from importlib import metadata
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import jax
import numpy as np
from jax.experimental.multihost_utils import process_allgather

from jaxmotion._caller import Caller
from jaxmotion._cluster.connections import connected
from jaxmotion._cluster.tasks import Lost, stream
from jaxmotion._stored import StoredClips
from jaxmotion._width import wide
from jaxmotion.cleaning.pairs import Pool, devices, pooled
from jaxmotion.cleaning.search import Found, Query, nothing, search
from jaxmotion.cleaning.words import points, texture
from jaxmotion.frames.padding import program_size
from jaxmotion.io.atomic import atomic_write, remove_abandoned
from jaxmotion.motion import Motion

if TYPE_CHECKING:
    from distributed import Client

Told: TypeAlias = Callable[[int], None]

PROCESSES = "processes"
_FRAMES = 16384  # of a part
_WORDS = 128  # of a task
_LAYOUT = 1  # of kept files,
_SUM = 16  # which begin with so many bytes of a hash of the rest


class Tile(NamedTuple):
    """Words ``first`` to ``stop``, beside the clips of a part."""

    part: int
    first: int
    stop: int


class Work:
    """What is done to every tile, here or on a worker. ``clips``: the context; ``parts``: first
    clip and that after the last of each, in numbers of which 0 is the words' own clip."""

    def __init__(self, query: Query, clips: Sequence[Motion], lengths: np.ndarray):
        self.query, self.clips = query, clips
        self.parts = _parts(lengths, first=0 if query.own else 1)
        self._sizes = [int(lengths[slice(*part)].sum()) for part in self.parts]
        self._caller = Caller.here()
        self._pool: tuple[int, Pool] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_pool": None}

    def __call__(self, tile: Tile, bound: np.ndarray, told: Told = lambda done: None) -> Found:
        if misfit := self._caller.misfit():
            raise ValueError(misfit)
        self._caller.share()
        with self._caller.types():
            mesh = devices()
            if self._pool is None or self._pool[0] != tile.part:
                self._pool = None
                self._pool = tile.part, self._pooled(tile.part, mesh)
            words = slice(tile.first, tile.stop)
            return search(self.query, self._pool[1], mesh, words, bound, told)

    def frames(self, tile: Tile) -> int:
        """Of the tile's clips, times its words: how much there is to do."""
        return self._sizes[tile.part] * (tile.stop - tile.first)

    def _pooled(self, part: int, mesh: Any) -> Pool:
        query, numbers = self.query, range(*self.parts[part])
        seen = texture if query.metric == "pose" else points
        textures = [
            query.words
            if number == 0
            else np.asarray(seen(self.clips[number - 1], query.joints, query.stands))
            for number in numbers
        ]
        size = program_size(self._sizes[part])
        if len(self.parts) > 1:
            size = max(size, program_size(_FRAMES))
        return pooled(textures, numbers, query.shape, size=size, dtype=query.dtype, mesh=mesh)


def _parts(lengths: np.ndarray, first: int) -> list[tuple[int, int]]:
    """First clip and that after the last of every part."""
    found, frames = [], 0
    for number in range(first, len(lengths)):
        frames += int(lengths[number])
        if not found or frames > _FRAMES:
            found.append((number, number))
            frames = int(lengths[number])
        found[-1] = found[-1][0], number + 1
    return found


def all_nearest(
    query: Query,
    clips: Sequence[Motion],
    lengths: np.ndarray,
    *,
    client: "Client | str | None" = None,
    keep: str | PathLike | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Found, int]:
    """What is nearest to every word of a query in all clips, whose ``lengths`` i[C] begin with the
    own; and how many pairs there are."""
    work, many = Work(query, clips, lengths), len(query.starts)
    targets = np.maximum(lengths[0 if query.own else 1 :] - query.shape.target + 1, 0)
    step = max(many, 1) if client is None and keep is None else _WORDS
    tiles = [
        Tile(part, first, min(first + step, many))
        for part in range(len(work.parts))
        for first in range(0, many, step)
    ]
    if client == PROCESSES:
        tiles = tiles[jax.process_index() :: jax.process_count()]
    merged, told = _Merged(query), _Told(progress, work, tiles)
    kept = None if keep is None else _Kept(Path(keep), work)
    left = []
    for tile in tiles:
        found = None if kept is None else kept.read(tile)
        if found is None:
            left.append(tile)
        else:
            merged.add(tile, found)
            told.done(tile)
    here = client is None or client == PROCESSES
    results = _here(work, left, merged, told) if here else _there(client, work, left, merged)
    with closing(results):
        for tile, found in results:
            if kept is not None:
                kept.write(tile, found)
            merged.add(tile, found)
            told.done(tile)
    if client == PROCESSES:
        merged.gather()
    return merged.found, many * int(targets.sum())


def _here(
    work: Work, tiles: list[Tile], merged: "_Merged", told: "_Told"
) -> Generator[tuple[Tile, Found]]:
    for tile in tiles:
        yield tile, work(tile, merged.bound(tile), lambda words, tile=tile: told.words(tile, words))


def _there(
    client: Any, work: Work, tiles: list[Tile], merged: "_Merged"
) -> Generator[tuple[Tile, Found]]:
    """By dask's workers. **Raises:** ``RuntimeError`` for a tile that cannot be done."""
    with connection(client) as there:
        pairs = stream(
            there,
            work,
            tiles,
            name="jaxmotion-search",
            size=lambda tile: 1,
            group=1,
            along=merged.bound,
            alone=False,
        )
        with closing(pairs):
            for tile, found in pairs:
                if isinstance(found, Lost):
                    first, stop = work.parts[tile.part]
                    where = f"clips {max(first - 1, 0)} to {stop - 2} of the context"
                    raise RuntimeError(f"nearest_words: {where}: {found.reason}")
                yield tile, found


def needs_corpus(caller: str, context: Any, client: Any, keep: Any) -> None:
    """``ValueError`` for what is asked of a corpus where there is none."""
    if not (client is None and keep is None) and not isinstance(context, StoredClips):
        raise ValueError(
            f"{caller}: client= and keep= are for a jaxmotion.corpus.Corpus; the context is a "
            f"{type(context).__name__}"
        )


def connection(client: Any) -> AbstractContextManager[Any]:
    """A client where one is meant; what none is for, as it is."""
    return nullcontext(client) if client is None or client == PROCESSES else connected(client)


class _Merged:
    """What is nearest so far."""

    def __init__(self, query: Query):
        self.found, self._query = nothing(len(query.starts), query), query

    def bound(self, tile: Tile) -> np.ndarray:
        """The K-th distance of each of the tile's words, inf where there are fewer."""
        return self.found.distance[tile.first : tile.stop, -1].copy()

    def add(self, tile: Tile, new: Found) -> None:
        """What was found in a tile."""
        words = slice(tile.first, tile.stop)
        before = [x[words] for x in self.found[:4]]
        both = [np.concatenate(x, axis=1) for x in zip(before, new[:4], strict=True)]
        clip, frame, distance, _ = both
        best = np.lexsort((frame, clip, distance), axis=1)[:, : self._query.k]
        for whole, x in zip(self.found[:4], both, strict=True):
            order = best.reshape(*best.shape, *(1,) * (x.ndim - 2))
            whole[words] = np.take_along_axis(x, order, axis=1)
        self.found.left_out[words] = np.minimum(self.found.left_out[words], new.left_out)
        self.found = self.found._replace(warped=self.found.warped + new.warped)

    def gather(self) -> None:
        """What all processes of ``jax.distributed`` have found, in each of them."""
        own, self.found = self.found, nothing(len(self.found.clip), self._query)
        count = np.array(divmod(own.warped, 2**30), np.int32)
        every = [np.asarray(x) for x in process_allgather((*own[:5], count), tiled=False)]
        every = [x.reshape(-1, *y.shape) for x, y in zip(every, (*own[:5], count), strict=True)]
        whole = Tile(0, 0, len(own.left_out))
        for *arrays, (high, low) in zip(*every, strict=True):
            self.add(whole, Found._make([*arrays, int(high) * 2**30 + int(low)]))


class _Told:
    """Progress over all tiles, in words."""

    def __init__(self, progress: Callable[[int, int], None] | None, work: Work, tiles: list[Tile]):
        self._progress, self._work = progress, work
        self._all = sum(map(work.frames, tiles))
        self._many = max((tile.stop for tile in tiles), default=0)
        self._done, self._last = 0, -1

    def words(self, tile: Tile, words: int) -> None:
        """So many words of a tile are done."""
        self._tell(self._work.frames(tile._replace(stop=tile.first + words)))

    def done(self, tile: Tile) -> None:
        """A tile is done."""
        self._tell(self._work.frames(tile))
        self._done += self._work.frames(tile)

    def _tell(self, more: int) -> None:
        done = (self._done + more) * self._many // max(self._all, 1)
        if self._progress is not None and done > self._last:
            self._last = done
            self._progress(done, self._many)


class _Kept:
    """What was found in tiles, in files of a folder that are named by all that it depends on."""

    def __init__(self, folder: Path, work: Work):
        from jaxmotion import __version__

        query = work.query
        folder.mkdir(parents=True, exist_ok=True)
        remove_abandoned(folder)
        self._folder = folder
        options = [query.joints, query.k, query.shape, query.trim, query.pairs, query.metric]
        options += [query.own, str(query.dtype), work.parts, wide(), work.clips.digest()]  # type: ignore[union-attr]
        options += [_LAYOUT, __version__, metadata.version("jax")]
        seen = hashlib.blake2b(repr(options).encode(), digest_size=16)
        for x in (query.words, query.starts, query.stands):
            seen.update(f"{x.dtype}{x.shape}".encode() + np.ascontiguousarray(x).tobytes())
        self._mark = seen.hexdigest()

    def read(self, tile: Tile) -> Found | None:
        """What is there of a tile; None for nothing, or what is not what was written."""
        try:
            text = self._place(tile).read_bytes()
        except OSError:
            return None
        if text[:_SUM] != _sum(text[_SUM:]):
            return None
        with np.load(io.BytesIO(text[_SUM:]), allow_pickle=False) as file:
            *arrays, warped = (file[name] for name in Found._fields)
        return Found._make([*arrays, int(warped)])

    def write(self, tile: Tile, found: Found) -> None:
        """Keep what was found."""
        content = io.BytesIO()
        np.savez(content, **found._asdict())
        with atomic_write(self._place(tile)) as file:
            file.write(_sum(content.getvalue()) + content.getvalue())

    def _place(self, tile: Tile) -> Path:
        return self._folder / f"{self._mark}-{tile.part}-{tile.first}.jmfound"


def _sum(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_SUM).digest()
