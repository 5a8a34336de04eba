"""Several clips into one file: what ``align``, ``blend`` and ``stitch`` share."""

import functools
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxmotion._plain import irregular
from jaxmotion.cli._options import (
    Reading,
    Running,
    out_up_option,
    reading_options,
    running_options,
)
from jaxmotion.cli._terminal import say

if TYPE_CHECKING:
    from jaxmotion import Motion


def a_file(**options: Any) -> Any:
    """The type of one file's name."""
    return click.Path(dir_okay=False, path_type=Path, **options)


@dataclass(frozen=True)
class Joining:
    """Several files in, one out: what the options of :func:`joining_options` say."""

    out: Path
    out_up: str | None
    overwrite: bool
    dry_run: bool
    reading: Reading
    running: Running


def join(
    combine: "Callable[[list[Motion]], tuple[Motion, str]]",
    sources: Sequence[Path],
    joining: Joining,
) -> None:
    """Read ``sources``, ``combine`` them, which also says what was done, and write the result."""
    from jaxmotion.cli import _files, _session

    out = joining.out
    check_targets([out], sources, overwrite=joining.overwrite)
    if joining.dry_run:
        say(out)
        return
    _files.clearing([out])()
    _session.start(cache=joining.running.cache, little=_session.is_little(sources))
    from jaxmotion.cli._work import finite, write

    with warned():
        motion, summary = combine(read_clips(sources, joining.reading, uses_up=True))
        write(finite(motion), out, overwrite=joining.overwrite, up=joining.out_up)
    say(f"{out}: {summary}", err=True)


def check_targets(targets: Sequence[Path], sources: Sequence[Path], *, overwrite: bool) -> None:
    """Refuse to write a motion, the first of ``targets``, in a format that is none, and any of them
    over a source or, unasked, over a file that exists."""
    from jaxmotion.cli import _files
    from jaxmotion.io.formats import SUFFIXES

    out = targets[0]
    if out.suffix.lower() not in SUFFIXES:
        raise click.UsageError(f"-o {out.name}: expected a {', '.join(SUFFIXES)} file")
    over = _files.overlaps(sources)
    for target in targets:
        if over(target):
            raise click.UsageError(f"{target} would be written over an input; give another name")
        if kind := irregular(target):
            raise click.ClickException(f"{target} cannot be written: {kind}, not a file")
        if target.exists() and not overwrite:
            raise click.ClickException(f"{target} exists; add --overwrite")


def read_clips(
    sources: Sequence[Path], reading: Reading, *, uses_up: bool = False
) -> "list[Motion]":
    """The clips."""
    from jaxmotion.cli._work import read

    return [read(source, reading, uses_up=uses_up) for source in sources]


@contextmanager
def warned() -> Iterator[None]:
    """Tell on stderr what had to be repaired or laid out anew inside the block."""
    from jaxmotion.cli._work import told

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for text in told(caught):
        say(f"warning: {text}", err=True)


def joining_options(function: Callable) -> Callable:
    """``-o --out-up --overwrite --dry-run`` and those of reading and running; the command is given
    ``joining``."""

    @click.option("-o", "--out", type=a_file(), required=True, help="The file to write.")
    @out_up_option
    @click.option("--overwrite", is_flag=True, help="Replace an output that exists.")
    @click.option("-n", "--dry-run", is_flag=True, help="Say what would be written, and stop.")
    @reading_options
    @running_options
    @functools.wraps(function)
    def command(*args, out, out_up, overwrite, dry_run, reading, running, **values):
        joining = Joining(out, out_up, overwrite, dry_run, reading, running)
        return function(*args, joining=joining, **values)

    return command
