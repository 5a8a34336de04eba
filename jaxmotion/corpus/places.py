"""Files by name: of this machine, or wherever fsspec reaches (``s3://bucket/takes/walk.bvh``).

A URL is read by way of a copy in a temporary folder. What is written there is a whole local file
first; it is then put in place in fsspec's transaction, and by S3 as one object: nobody sees half.
"""

import glob
import os
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from os import PathLike, fspath
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple
from urllib.parse import urlsplit
from urllib.request import url2pathname

from jaxmotion._lazy import extra
from jaxmotion._plain import printable
from jaxmotion.io.formats import SUFFIXES, files_of, may_hold_a_motion, read_with

_COPIES = "jaxmotion-"  # how names of folders of copies begin


class Found(NamedTuple):
    """A file, and its place below an output folder."""

    name: str
    relative: str


def is_url(name: str) -> bool:
    """Whether a name is fsspec's to open."""
    return "://" in name


def plain(name: str | PathLike) -> str:
    """A name as it is used here: of a file of this machine without ``file://``."""
    text = fspath(name)
    return url2pathname(urlsplit(text).path) if text.startswith("file://") else text


def found(names: Sequence[str | PathLike]) -> list[Found]:
    """The motion files meant by names of files, folders and patterns, each once, in order; hidden
    files are left out of folders and patterns.

    **Raises:** ``FileNotFoundError`` for a name that is nothing, or holds no motion file.
    """
    files: dict[str, Found] = {}
    folders = 0
    listed = []
    for name in map(plain, names):
        group, is_folder = _at_url(name) if is_url(name) else _here(name)
        if not group:
            raise FileNotFoundError(
                f"there is no motion file ({', '.join(SUFFIXES)}) in or by the name of "
                f"{printable(name)}"
            )
        folders += is_folder
        listed.append((name, group, is_folder))
    for name, group, is_folder in listed:
        below = PurePosixPath(name.rstrip("/")).name if is_folder and folders > 1 else ""
        for item in group:
            files.setdefault(item.name, Found(item.name, str(PurePosixPath(below, item.relative))))
    return list(files.values())


def below(folder: str, relative: str) -> str:
    """The name of a file below a folder."""
    if is_url(folder):
        return f"{folder.rstrip('/')}/{relative}"
    return str(Path(folder, *PurePosixPath(relative).parts))


def within(folder: str, name: str) -> str:
    """A name as processes know it that are in another folder."""
    return name if is_url(name) else os.path.join(folder, name)


def full(name: str) -> str:
    """A URL as its file system spells it."""
    system, path = _system(name)
    return system.unstrip_protocol(path)


def size(name: str) -> int:
    """Bytes of a file; nought where nobody knows."""
    if is_url(name):
        return 0
    try:
        return Path(name).stat().st_size
    except OSError:  # reading it will tell
        return 0


def made(name: str) -> list[str]:
    """The files that a motion of that name is written to."""
    if not is_url(name):
        return [str(path) for path in files_of(Path(name))]
    base = PurePosixPath(name).name
    return [name[: -len(base)] + path.name for path in files_of(Path(base))]


def time_of(name: str) -> float | None:
    """When a file was changed last, in seconds; None if it is not there, nought if nobody knows."""
    if not is_url(name):
        try:
            return Path(name).stat().st_mtime
        except OSError:
            return None
    system, path = _system(name)
    if not system.exists(path):
        return None
    with suppress(RuntimeError, KeyError, AttributeError):  # not every system knows
        return system.modified(path).timestamp()
    return 0.0


@contextmanager
def at_hand(name: str) -> Iterator[Path]:
    """A file on this machine, a copy if it is elsewhere, with what is read with it."""
    if not is_url(name):
        yield Path(name)
        return
    system, path = _system(name)
    with tempfile.TemporaryDirectory(prefix=_COPIES) as folder:
        copy = Path(folder) / PurePosixPath(path).name
        system.get_file(path, str(copy))
        if [beside.suffix for beside in files_of(copy)[1:]]:
            kept = {beside.suffix for beside in files_of(copy)[1:]}
            for other in system.ls(PurePosixPath(path).parent.as_posix(), detail=False):
                if PurePosixPath(other).suffix.lower() in kept:
                    system.get_file(other, str(Path(folder) / PurePosixPath(other).name))
        yield copy


def put(write: Callable[[Path], Any], name: str) -> None:
    """Have ``write`` make the files of a motion, and put them in place, whole or not at all."""
    if not is_url(name):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        write(Path(name))
        return
    system, path = _system(name)
    with tempfile.TemporaryDirectory(prefix=_COPIES) as folder:
        local = Path(folder) / PurePosixPath(path).name
        write(local)
        parent = PurePosixPath(path).parent.as_posix()
        system.makedirs(parent, exist_ok=True)
        with system.transaction:
            for file in files_of(local):
                system.put_file(str(file), f"{parent}/{file.name}")


def of_the_original(text: str, name: str) -> str:
    """What is told of the copy of a file, told of the file."""
    if not is_url(name):
        return text
    folder, base = re.escape(os.path.join(tempfile.gettempdir(), _COPIES)), PurePosixPath(name).name
    copy = rf"{folder}\w+[/\\]{re.escape(base)}"
    return re.sub(copy, lambda _: name, text)


def _system(name: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it."""
    core = extra("fsspec.core", "distributed", "a URL", package="fsspec")
    return core.url_to_fs(name)


def _here(name: str) -> tuple[list[Found], bool]:
    path = Path(name)
    if path.is_file():
        return [Found(name, path.name)], False
    if path.is_dir():
        return [_below(path, p) for p in sorted(path.rglob("*")) if _is_taken(path, p)], True
    fixed = Path(_fixed_part(name))
    matches = sorted(map(Path, glob.iglob(name, recursive=True))) if glob.has_magic(name) else []
    return [_below(fixed, p) for p in matches if _is_taken(fixed, p)], False


def _below(folder: Path, path: Path) -> Found:
    return Found(str(path), path.relative_to(folder).as_posix())


def _is_taken(folder: Path, path: Path) -> bool:
    hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
    named = path.suffix.lower() in SUFFIXES
    return named and not hidden and path.is_file() and may_hold_a_motion(path)


def _at_url(name: str) -> tuple[list[Found], bool]:
    system, path = _system(name)
    if glob.has_magic(path):
        base, paths, is_folder = _fixed_part(path), system.glob(path), False
    elif PurePosixPath(path).suffix.lower() in SUFFIXES and system.exists(path):
        return [Found(name, PurePosixPath(path).name)], False
    else:
        base, paths, is_folder = path, system.find(path), True
    group = []
    for one in sorted(paths):
        relative = PurePosixPath(one).relative_to(PurePosixPath(base))
        hidden = any(part.startswith(".") for part in relative.parts)
        if relative.suffix.lower() in SUFFIXES and not hidden:
            group.append(Found(system.unstrip_protocol(one), relative.as_posix()))
    return group, is_folder


def _fixed_part(pattern: str) -> str:
    """The folders of a pattern before its first wildcard."""
    parts = []
    for part in PurePosixPath(pattern).parts[:-1]:
        if glob.has_magic(part):
            break
        parts.append(part)
    return str(PurePosixPath(*parts))


def skeletons_of(name: str) -> list[str]:
    """The files that are read along with one of this machine."""
    return [] if is_url(name) else [str(path) for path in read_with(Path(name))]
