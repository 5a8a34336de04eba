"""Which files go in, and where each one's output goes.

A folder is searched through for motion files, hidden files and the output folder apart, and the
output mirrors its tree. A pattern is taken relative to its part without wildcards. One input may
be given a file name for its output; otherwise the output is a folder.
"""

import glob
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import click

from jaxmotion._plain import in_words, irregular
from jaxmotion.io.formats import SUFFIXES, WRITTEN, files_of, may_hold_a_motion, read_with


@dataclass(frozen=True)
class Input:
    """A file to read, and its place below an output folder."""

    path: Path
    relative: Path
    named: bool  # given by its own name, not found in a folder


@dataclass(frozen=True)
class Job:
    """A file to read and a file (or folder) to write."""

    source: Path
    target: Path


def expand(given: Sequence[str], *, avoid: Path | None = None) -> list[Input]:
    """The motion files meant by names of files, folders and patterns, each once, in order.

    **Arguments:** ``avoid``: a folder whose contents are not taken from folders and patterns.
    **Raises:** ``click.UsageError`` for a name that is nothing, or a folder or pattern without a
    motion file.
    """
    folders = [name for name in given if Path(name).is_dir()]
    found: dict[Path, Input] = {}
    for name in given:
        path = Path(name)
        if path.is_file():
            group = [Input(path, Path(path.name), True)]
        elif path.is_dir():
            below = Path(real(path).name) if len(folders) > 1 else Path()
            group = list(_inside(path, path.rglob("*"), below, avoid))
        elif glob.has_magic(name):
            matches = (Path(p) for p in glob.iglob(name, recursive=True))
            group = list(_inside(_fixed_part(path), matches, Path(), avoid))
        else:
            raise click.UsageError(_why_not(path))
        if not group:
            what = "the folder" if path.is_dir() else "files that match"
            raise click.UsageError(f"no motion files ({', '.join(SUFFIXES)}) in {what} {name!r}")
        for item in group:
            # A link to a folder around it makes one file of many names, ever longer.
            place = real(item.path)
            if place not in found or len(item.path.parts) < len(found[place].path.parts):
                found[place] = item
    return list(found.values())


def plan(inputs: Sequence[Input], out: Path, *, to: str | None = None) -> list[Job]:
    """One output file for every input.

    **Arguments:** ``out``: a folder, or the file if there is one input; ``to``: suffix of the
    outputs in a folder, by default each input's own.
    **Raises:** ``click.UsageError`` when two inputs would get one output, or one its own input.
    """
    if out.suffix.lower() in WRITTEN and not out.is_dir():
        if len(inputs) != 1:
            raise click.UsageError(f"-o {out} is one file for {len(inputs)} inputs; give a folder")
        if to is not None and out.suffix.lower() != to:
            raise click.UsageError(f"--to {to[1:]} and -o {out.name} disagree")
        return checked([Job(inputs[0].path, out)])
    return checked([Job(i.path, out / i.relative.with_suffix(to or i.path.suffix)) for i in inputs])


def plan_folders(inputs: Sequence[Input], out: Path) -> list[Job]:
    """One output folder for every input: ``out`` itself for one, else below it by name."""
    if out.is_file() or (out.suffix.lower() in WRITTEN and not out.is_dir()):
        raise click.UsageError(f"-o {out} is a file; give a folder")
    if len(inputs) == 1 and inputs[0].named:
        return [Job(inputs[0].path, out)]
    return checked([Job(i.path, out / i.relative.with_suffix("")) for i in inputs])


def checked(jobs: list[Job]) -> list[Job]:
    """The jobs, if no output is an input and none is written twice; else ``UsageError``."""
    over = overlaps([job.source for job in jobs])
    targets: dict[Path, Path] = {}
    for job in jobs:
        target = real(job.target)
        if over(job.target):
            raise click.UsageError(f"{job.target} would be written over an input; give another -o")
        if target in targets:
            raise click.UsageError(
                f"{targets[target]} and {job.source} would both be written to {job.target}; "
                "process them one at a time"
            )
        targets[target] = job.source
    return jobs


def overlaps(sources: Iterable[Path]) -> Callable[[Path], bool]:
    """Whether writing a target would change one of ``sources``: the same file, by whatever name, or
    the .asf that is written beside an .amc, over the skeleton of an input."""
    sources = list(sources)
    paths = {real(source) for source in sources}
    files = {identity for source in sources if (identity := _identity(source)) is not None}

    def over(target: Path) -> bool:
        if real(target) in paths or _identity(target) in files:
            return True
        beside = [real(path) for path in files_of(target)[1:]]
        existing = [path for path in beside if path.exists()]
        read = {real(path) for source in sources for path in read_with(source)} if existing else ()
        return any(path in read for path in existing)

    return over


def real(path: Path) -> Path:
    """The absolute path, links followed as far as they lead somewhere."""
    return Path(os.path.realpath(path))


def clearing(outputs: Iterable[Path]) -> Callable[[], None]:
    """What takes away the files that killed processes left where ``outputs`` go."""
    from jaxmotion.io.atomic import remove_abandoned

    folders = {real(output).parent for output in outputs}

    def clear() -> None:
        for folder in folders:
            remove_abandoned(folder)

    return clear


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        facts = path.stat()
    except OSError:
        return None
    return facts.st_dev, facts.st_ino


def _why_not(path: Path) -> str:
    """Why a name stands neither for a file nor for a folder."""
    if ":/" in str(path)[2:]:  # of the slashes of a URL a path keeps one
        return f"{str(path)!r} is a URL; in Python, jaxmotion.corpus.map reads and writes those"
    try:
        path.stat()
    except FileNotFoundError:
        if not path.is_symlink():
            return f"there is no file or folder {str(path)!r}"
        return f"{str(path)!r} is a link to nothing"
    except OSError as error:
        return f"{str(path)!r}: {in_words(error)}"
    return f"{str(path)!r} is {irregular(path)}; expected a file or a folder"


def _inside(base: Path, paths: Iterable[Path], below: Path, avoid: Path | None) -> Iterable[Input]:
    away = real(avoid) if avoid is not None else None
    if away is not None and real(base) not in away.parents:
        away = None
    for path in sorted(paths):
        relative = path.relative_to(base)
        hidden = any(part.startswith(".") for part in relative.parts)
        if hidden or path.suffix.lower() not in SUFFIXES or not _may_be_file(path):
            continue
        if away is not None and away in real(path).parents:
            continue
        if not may_hold_a_motion(path):
            continue
        yield Input(path, below / relative, False)


def _may_be_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # in a folder that may be listed but not entered: reading it will tell
        return True


def _fixed_part(pattern: Path) -> Path:
    """The folders of a pattern before its first wildcard."""
    parts = []
    for part in pattern.parts[:-1]:
        if glob.has_magic(part):
            break
        parts.append(part)
    return Path(*parts)
