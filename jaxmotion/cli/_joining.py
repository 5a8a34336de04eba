"""Several clips into one file: what ``align``, ``blend`` and ``stitch`` share."""

import functools
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxmotion._plain import irregular
from jaxmotion.cli._options import (
    Reading,
    Running,
    out_up_option,
    reading_options,
    report_option,
    running_options,
)
from jaxmotion.cli._showing import names_of
from jaxmotion.cli._terminal import say
from jaxmotion.io.formats import files_of

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion.cli._feet import Skate
    from jaxmotion.cli._work import Effect, Learned, Outcome


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
    report: Path | None
    reading: Reading
    running: Running


@dataclass(frozen=True)
class Joined:
    """What a command makes of several clips: a motion; a message; the same frames before they were
    joined, to tell how they changed, None where there are no such; how the feet slide, None if none
    touch; what was learned on the way; ``then`` writes what goes with the motion."""

    motion: "Motion"
    message: str
    original: "Motion | None" = None
    skate: "Skate | None" = None
    learned: "Learned" = field(default_factory=dict)
    then: Callable[[], object] = lambda: None


def join(
    combine: "Callable[[list[Motion]], Joined]",
    sources: Sequence[Path],
    joining: Joining,
    *,
    edited: int = 0,
    also: Sequence[Path] = (),
) -> None:
    """Read ``sources``, ``combine`` them and write the result.

    **Arguments:** ``edited``: which of them a report is about, with the others; ``also``: other
    files that ``combine`` writes.
    """
    from jaxmotion.cli import _files, _session
    from jaxmotion.cli._progress import line_about
    from jaxmotion.cli._report import Report

    out, targets = joining.out, [joining.out, *also]
    check_targets(targets, sources, overwrite=joining.overwrite)
    job = _files.Job(sources[edited], out)
    others = [*sources[:edited], *sources[edited + 1 :]]
    report = Report(
        joining.report,
        [job],
        writes=lambda target: [*files_of(target), *also],
        others=others,
        overwrite=joining.overwrite,
    )
    if joining.dry_run:
        say(*targets)
        return
    _files.clearing([*targets, *([joining.report] if joining.report else [])])()
    _session.start(cache=joining.running.cache, little=_session.is_little(sources))
    with report, report.attempt(job) as outcome, told_by(outcome):
        from jaxmotion.cli._work import finite, write

        clips = read_clips(sources, joining.reading)
        joined = combine(clips)
        write(finite(joined.motion), out, overwrite=joining.overwrite, up=joining.out_up)
        joined.then()
        clips.insert(0, clips.pop(edited))
        named = dict(zip(names_of([job.source, *others]), clips, strict=True))
        outcome.effect = _effect(joined, named, joining.report)
    say(line_about(outcome), err=True)


def _effect(joined: Joined, clips: "dict[str, Motion]", report: Path | None) -> "Effect":
    from jaxmotion.cli._compared import compared
    from jaxmotion.cli._work import Clip, Effect
    from jaxmotion.metrics import difference

    change = None
    if report is not None and joined.original is not None:
        change = difference(joined.original, joined.motion, world=True)
    read = tuple(map(Clip.of, clips.values()))
    made = Clip.of(joined.motion)
    beside = compared(clips | {"result": joined.motion}, report, next(iter(clips)))
    return Effect(read, made, joined.message, change, joined.skate, joined.learned, compared=beside)


def check_targets(targets: Sequence[Path], sources: Sequence[Path], *, overwrite: bool) -> None:
    """Refuse to write a motion, the first of ``targets``, in a format that is none, and any of them
    over a source or, unasked, over a file that exists."""
    from jaxmotion.cli import _files
    from jaxmotion.io.formats import WRITTEN

    out = targets[0]
    if out.suffix.lower() not in WRITTEN:
        raise click.UsageError(f"-o {out.name}: expected a {', '.join(WRITTEN)} file")
    over = _files.overlaps(sources)
    for target in targets:
        if over(target):
            raise click.UsageError(f"{target} would be written over an input; give another name")
        if kind := irregular(target):
            raise click.ClickException(f"{target} cannot be written: {kind}, not a file")
        if target.exists() and not overwrite:
            raise click.ClickException(f"{target} exists; add --overwrite")


def read_clips(sources: Sequence[Path], reading: Reading) -> "list[Motion]":
    """The clips."""
    from jaxmotion.cli._work import read

    return [read(source, reading, uses_up=True) for source in sources]


@contextmanager
def told_by(outcome: "Outcome") -> Iterator[None]:
    """Note with an outcome, and tell on stderr, what had to be repaired or laid out anew inside the
    block."""
    from jaxmotion.cli._work import told

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            yield
        finally:
            outcome.warnings = told(caught)
    for text in outcome.warnings:
        say(f"warning: {text}", err=True)


def joining_options(function: Callable) -> Callable:
    """``-o --out-up --overwrite --dry-run --report`` and those of reading and running; the command
    is given ``joining``."""

    @click.option("-o", "--out", type=a_file(), required=True, help="The file to write.")
    @out_up_option
    @click.option("--overwrite", is_flag=True, help="Replace an output that exists.")
    @click.option("-n", "--dry-run", is_flag=True, help="Say what would be written, and stop.")
    @report_option
    @reading_options
    @running_options
    @functools.wraps(function)
    def command(*args, out, out_up, overwrite, dry_run, report, reading, running, **values):
        joining = Joining(out, out_up, overwrite, dry_run, report, reading, running)
        return function(*args, joining=joining, **values)

    return command
