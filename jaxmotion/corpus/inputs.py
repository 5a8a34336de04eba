"""What a corpus is made of: files and motions, each with a name and an identity.

The identity tells whether a clip is still the one that was cached: of a file its place, size and
time of change, and those of the files that are read with it; of a motion a hash of what it holds.
"""

import glob
import hashlib
import os
from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import TypeAlias

import jax
import numpy as np

from jaxmotion._entry import one_clip
from jaxmotion._plain import quoted
from jaxmotion.corpus import places
from jaxmotion.io import formats, load
from jaxmotion.io.formats import Up
from jaxmotion.motion import Motion

Clips: TypeAlias = (
    str
    | PathLike
    | Motion
    | Iterable[str | PathLike | Motion]
    | Mapping[str, str | PathLike | Motion]
)


class LeftBehind(ValueError):
    """A motion that did not travel with a pickled corpus."""


class FileInput:
    """A clip in a file."""

    def __init__(self, name: str, path: Path):
        self.name, self.path = name, path

    def identity(self) -> str:
        """**Raises:** ``OSError`` for a file that is not there."""
        told = []
        for path in (self.path, *formats.read_with(self.path)):
            about = os.stat(path)
            told.append(f"{path}\0{about.st_size}\0{about.st_mtime_ns}")
        return "\0".join(told)

    def read(self, dtype, up: Up | None) -> Motion:
        """The clip."""
        motion = load(self.path, dtype=dtype, up=up)
        one_clip("Corpus", motion, quoted(self.name), on_host=True)
        return motion


class MotionInput:
    """A clip in memory."""

    def __init__(self, name: str, motion: Motion):
        self.name = name
        self.motion: Motion | None = motion
        self._identity: str | None = None

    def identity(self) -> str:
        if self._identity is None and self.motion is not None:
            seen = hashlib.blake2b(repr(_static(self.motion)).encode(), digest_size=16)
            for x in jax.tree.leaves(self.motion):
                array = np.ascontiguousarray(x)
                seen.update(f"{array.dtype}{array.shape}".encode())
                seen.update(array.tobytes())
            self._identity = seen.hexdigest()
        return self._identity or ""

    def read(self, dtype, up: Up | None) -> Motion:
        if self.motion is None:
            raise LeftBehind("the motion was left behind when the corpus was pickled")
        return self.motion

    def __getstate__(self):
        """Without the motion, which is in a shard by then."""
        return {"name": self.name, "motion": None, "_identity": self.identity()}


Input: TypeAlias = FileInput | MotionInput


def inputs_of(clips: Clips) -> list[Input]:
    """The clips, each with a name.

    **Raises:** ``ValueError`` for none, a folder without motion files, and what is neither a file
    nor one clip; ``OSError`` for what is not there, a pattern of no motion file too.
    """
    if isinstance(clips, Motion):
        clips = [clips]
    if isinstance(clips, (str, PathLike)):
        clips = _files_at(Path(clips))
    named = dict(clips) if isinstance(clips, Mapping) else None
    items = list(clips.values() if isinstance(clips, Mapping) else clips)
    if not items:
        raise ValueError("Corpus: clips is empty; expected at least one file or motion")
    found: list[Input] = []
    paths = [Path(os.path.abspath(x)) for x in items if isinstance(x, (str, PathLike))]
    names = iter(_names(items, paths) if named is None else [str(name) for name in named])
    left = iter(paths)
    for k, item in enumerate(items):
        name = next(names)
        if isinstance(item, Motion):
            one_clip("Corpus", item, f"clips[{k}]", on_host=True)
            found.append(MotionInput(name, item))
        elif isinstance(item, (str, PathLike)):
            found.append(FileInput(name, next(left)))
        else:
            kind = type(item).__name__
            raise ValueError(f"Corpus: clips[{k}] is a {kind}; expected a file or a Motion")
    return found


def _files_at(path: Path) -> list[Path]:
    """The motion files of a folder and of those below it, or of a pattern; or a file."""
    if not path.is_dir():
        pattern = glob.has_magic(str(path)) and not path.exists()
        return [Path(item.name) for item in places.found([path])] if pattern else [path]
    found = sorted(x for x in path.rglob("*") if x.is_file() and formats.may_hold_a_motion(x))
    if not found:
        raise ValueError(f"Corpus: no motion file in the folder {quoted(str(path))}")
    return found


def _names(items: list, paths: list[Path]) -> list[str]:
    """Places of files below the folder that all are in, without suffixes if that tells them apart;
    "clip 3" for motions."""
    top = Path(os.path.commonpath([str(x.parent) for x in paths])) if paths else Path()
    below = [str(x.relative_to(top).with_suffix("").as_posix()) for x in paths]
    if len(set(below)) < len(below):
        below = [x.relative_to(top).as_posix() for x in paths]
    left = iter(below)
    return [
        f"clip {k}" if isinstance(item, Motion) or not paths else next(left)
        for k, item in enumerate(items)
    ]


def _static(motion: Motion) -> tuple:
    skeleton = motion.skeleton
    return (
        *(skeleton.names, skeleton.parents, skeleton.end_joints, skeleton.up),
        *(skeleton.length_unit, motion.translated_joints),
    )
