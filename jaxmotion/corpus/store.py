"""The clips of a corpus as shards in a folder: made when they are first asked for, then mapped.

A shard has some hundred neighbouring clips. It ends where a hash of a clip's name says so, and not
every n-th: so a file that is added or taken away changes one shard, and not all after it. It is
named by a hash of the settings and of its clips' identities (:mod:`.inputs`); so a shard that is
there is the right one, whoever made it, and one whose clips have changed has another name. Shards
are written whole or not at all (:mod:`jaxmotion.io.atomic`): processes that make the same one at
the same time write the same bytes, the last of them stays, and one that was killed leaves the
shards it had done.

A store that is pickled takes along where files and shards are, and no clip: motions in memory are
put into shards first.
"""

import hashlib
import json
import os
import shutil
import tempfile
import weakref
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxmotion._plain import printable, quoted
from jaxmotion.corpus.inputs import FileInput, Input, LeftBehind
from jaxmotion.corpus.matching import in_numpy, matched, reduced
from jaxmotion.corpus.shards import VERSION, Clip, DamagedShard, Row, Shard, write_shard
from jaxmotion.io.atomic import atomic_write, remove_abandoned
from jaxmotion.io.formats import Up
from jaxmotion.io.precision import float_type
from jaxmotion.io.soundness import trouble
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton
from jaxmotion.timing.resample import resample

SUFFIX = ".jmshard"
_MEAN = 128  # clips a shard
_MOST = 512
_MOST_BYTES = 64 << 20  # of files
_OPEN = 256  # shards at once
_TRIES = 3  # to read what was just written, where others empty the folder
_ALIKE = 1e-4  # of a frame time: what files round


class Settings(NamedTuple):
    """What every clip is brought to: ``skeleton`` (in NumPy), ``frame_time``, ``fps`` if it was
    given, ``dtype``, ``cast`` (whether motions of others are made it), ``may_drop`` (joints that
    may be left out, None for any), ``up`` of files, ``frame_time_text`` of the first file."""

    skeleton: Skeleton
    frame_time: float
    fps: float | None
    dtype: np.dtype
    cast: bool
    may_drop: frozenset[str] | None
    up: Up | None
    frame_time_text: str | None

    def text(self) -> str:
        """What a shard's contents depend on, but for its clips."""
        from jaxmotion import __version__

        s = self.skeleton
        ends = np.asarray(s.end_offsets, np.float64).tolist()
        about = (s.names, s.parents, s.end_joints, s.up, s.length_unit, ends)
        drop = self.may_drop is None or sorted(self.may_drop)
        rate = (float(self.frame_time), self.fps)
        return json.dumps([VERSION, __version__, about, rate, self.dtype.str, drop, self.up])


class Store:
    """The shards of a corpus. ``folder``: where they are, None for one that goes when the store
    does."""

    def __init__(self, inputs: Sequence[Input], settings: Settings, folder: Path | None):
        self.inputs, self.settings = list(inputs), settings
        self.names = tuple(x.name for x in self.inputs)
        self._lent = _Temporary() if folder is None else None
        self.folder = Path(os.path.abspath(self._lent.folder if self._lent else str(folder)))
        self.folder.mkdir(parents=True, exist_ok=True)
        remove_abandoned(self.folder)
        self.groups = _grouped(self.inputs)
        self._open: OrderedDict[int, Shard] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        if not all(isinstance(x, FileInput) for x in self.inputs):
            self.build()
        self.files  # noqa: B018  as the inputs are now
        return {k: x for k, x in vars(self).items() if k not in ("_open", "_lent")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _open=OrderedDict(), _lent=_folders.get(str(state["folder"])))

    @cached_property
    def identities(self) -> list[str]:
        """Of all inputs, as they were when first asked for."""
        return [x.identity() for x in self.inputs]

    @cached_property
    def files(self) -> list[Path]:
        """Where the shards are, or are to be."""
        settings, found = self.settings.text().encode(), []
        for start, stop in self.groups:
            seen = hashlib.blake2b(settings, digest_size=16)
            for name, identity in zip(
                self.names[start:stop], self.identities[start:stop], strict=True
            ):
                seen.update(f"\0{name}\0{identity}".encode("utf-8", "surrogateescape"))
            found.append(self.folder / f"{seen.hexdigest()}{SUFFIX}")
        return found

    @cached_property
    def lengths(self) -> np.ndarray:
        """Frames of every clip, i64[C]; 0 of those that have a fault. Makes all shards."""
        about = [clip for g in range(len(self.groups)) for clip in self.shard(g).clips]
        return np.array([clip["frames"] for clip in about], np.int64)

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Joints that are translated in one of the clips."""
        joints = {j for g in range(len(self.groups)) for j in self.shard(g).joints}
        return tuple(sorted(joints))

    def build(self, progress: Callable[[int, int], None] | None = None) -> None:
        """Make the shards that are not there; ``progress`` is told clips done and clips in all."""
        for g, (_, stop) in enumerate(self.groups):
            self.shard(g)
            if progress is not None:
                progress(stop, len(self.inputs))

    def fault(self, number: int) -> str | None:
        """What is wrong with a clip, in words."""
        group, row = self.place(number)
        return self.shard(group).clips[row].get("fault")

    def clip(self, number: int) -> Clip:
        """A clip, in the file.

        **Raises:** ``ValueError`` for one that cannot be used, or is damaged and gone.
        """
        group, row = self.place(number)
        try:
            return self._sound(group, row)
        except DamagedShard as error:
            self._remade(group, error)
            return self._sound(group, row)

    def moments(self, number: int) -> np.ndarray:
        """Σ q qᵀ of a clip, f64[J, 4, 4]."""
        group, row = self.place(number)
        return self.shard(group).moments[row]

    def place(self, number: int) -> tuple[int, int]:
        """Which shard a clip is in, and the how manieth of it."""
        group = bisect_right(self._ends, number)
        return group, number - self.groups[group][0]

    def shard(self, group: int) -> Shard:
        """A shard, made if it is not there."""
        found = self._open.get(group)
        if found is None:
            try:
                found = Shard(self.files[group])
            except FileNotFoundError:
                found = self._made(group)
            except DamagedShard as error:
                found = self._remade(group, error)
            self._open[group] = found
            while len(self._open) > _OPEN:
                with suppress(KeyError):  # another thread was faster
                    self._open.popitem(last=False)
        return found

    @cached_property
    def _ends(self) -> list[int]:
        return [stop for _, stop in self.groups]

    def _sound(self, group: int, row: int) -> Clip:
        shard = self.shard(group)
        if (fault := shard.clips[row].get("fault")) is not None:
            raise ValueError(f"Corpus: {fault}")
        return shard.clip(row)

    def _remade(self, group: int, error: DamagedShard) -> Shard:
        """A shard made again in the place of one that is damaged."""
        try:
            shard = self._made(group)
        except (OSError, ValueError) as why:
            raise ValueError(
                f"Corpus: {printable(error)}, and cannot be made again: {why}"
            ) from why
        self._open[group] = shard
        return shard

    def _made(self, group: int) -> Shard:
        start, stop = self.groups[group]
        rows = []
        for k in range(start, stop):
            source = self.inputs[k]
            rows.append(self._row(source))
            if source.identity() != self.identities[k]:
                raise ValueError(
                    f"Corpus: {quoted(source.name, 200)} has changed since the corpus was made; "
                    "make it again"
                )
        for _ in range(_TRIES):
            self._write(group, rows)
            with suppress(FileNotFoundError):  # whoever empties the cache was faster
                return Shard(self.files[group])
        self._write(group, rows)
        return Shard(self.files[group])

    def _write(self, group: int, rows: list[Row]) -> None:
        skeleton = self.settings.skeleton
        self.folder.mkdir(parents=True, exist_ok=True)  # whoever emptied the cache
        with atomic_write(self.files[group]) as file:
            write_shard(
                file, rows, skeleton.num_joints, len(skeleton.end_joints), self.settings.dtype
            )

    def _row(self, source: Input) -> Row:
        wanted = self.settings
        of_file = isinstance(source, FileInput)
        try:
            motion = source.read(wanted.dtype if of_file else None, wanted.up)
            return self._brought(source.name, motion)
        except LeftBehind:
            raise
        except ValueError as error:
            text = f"clip {quoted(source.name, 200)}: {error}"
            return Row(source.name, fault=printable(text))

    def _brought(self, name: str, motion: Motion) -> Row:
        """A clip as it is kept."""
        wanted, skeleton = self.settings, self.settings.skeleton
        if motion.dtype != wanted.dtype and not wanted.cast:
            raise ValueError(f"it is {motion.dtype}, the corpus {wanted.dtype}; give dtype=")
        if found := trouble(motion.skeleton.names, motion.translations, motion.rotations):
            raise ValueError(f"{found}; expected finite numbers and unit quaternions")
        if not motion.num_frames:
            raise ValueError("it has no frames")
        x = matched(motion, skeleton, wanted.may_drop)
        seconds = float(np.asarray(motion.frame_time))
        if abs(seconds - wanted.frame_time) > _ALIKE * wanted.frame_time:
            if wanted.fps is None:
                raise ValueError(
                    f"it is at {1 / seconds:.6g} frames a second, the corpus at "
                    f"{1 / wanted.frame_time:.6g}; give fps="
                )
            clip = Motion(
                skeleton, x.translations, x.rotations, seconds, translated_joints=x.translated
            )
            clip = resample(clip, fps=wanted.fps)
            t, q = np.asarray(clip.translations), np.asarray(clip.rotations)
            x = x._replace(translations=t, rotations=q)
        return Row(name, *x)


def settings_of(
    inputs: Sequence[Input],
    seconds: float | None,
    given: Skeleton | None,
    joints: Sequence[str] | None,
    dtype: Any,
    up: Up | None,
    skip: bool,
) -> Settings:
    """What every clip is brought to, of which the first decides what is not given; ``skip``: the
    first that can be read."""
    cast = dtype is not None
    wanted = float_type(dtype) if cast else None
    motion = _first(inputs, wanted, up, skip)
    kind = np.dtype(motion.dtype) if wanted is None else wanted
    whole = motion.skeleton if given is None else given
    skeleton = whole if joints is None else reduced(whole, joints)
    own = float(np.asarray(motion.frame_time))
    frame_time = own if seconds is None else seconds
    same = abs(own - frame_time) <= _ALIKE * frame_time and frame_time == own
    return Settings(
        skeleton=in_numpy(skeleton, kind),
        frame_time=frame_time,
        fps=None if seconds is None else 1.0 / seconds,
        dtype=kind,
        cast=cast,
        may_drop=frozenset(whole.names) - frozenset(skeleton.names),
        up=up,
        frame_time_text=motion.frame_time_text if same else None,
    )


def _first(inputs: Sequence[Input], dtype: np.dtype | None, up: Up | None, skip: bool) -> Motion:
    why = None
    for source in inputs:
        try:
            return source.read(dtype or float_type(), up)
        except ValueError as error:
            if not skip:
                raise
            why = why or error
    raise ValueError(f"Corpus: none of the clips can be used: {why}")


def _grouped(inputs: Sequence[Input]) -> list[tuple[int, int]]:
    """First clip, and that after the last, of every shard."""
    found, start, size = [], 0, 0
    for k, source in enumerate(inputs, 1):
        if isinstance(source, FileInput):
            with suppress(OSError):
                size += os.stat(source.path).st_size
        name = source.name.encode("utf-8", "surrogateescape")
        code = int.from_bytes(hashlib.blake2b(name, digest_size=4).digest(), "little")
        full = k - start >= _MOST or size >= _MOST_BYTES or code % _MEAN == 0
        if full or k == len(inputs):
            found.append((start, k))
            start, size = k, 0
    return found


class _Temporary:
    """A folder that goes when no store of this process has it."""

    def __init__(self):
        self.folder = tempfile.mkdtemp(prefix="jaxmotion-corpus-")
        weakref.finalize(self, _removed, self.folder, os.getpid())
        _folders[os.path.abspath(self.folder)] = self


_folders: weakref.WeakValueDictionary[str, _Temporary] = weakref.WeakValueDictionary()


def _removed(folder: str, owner: int) -> None:
    if os.getpid() == owner:  # and not a process that was forked from it
        shutil.rmtree(folder, ignore_errors=True)
