"""``jaxmotion check``: is anything wrong with a file?"""

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxmotion._plain import printable
from jaxmotion.cli._options import (
    Reading,
    Running,
    files_argument,
    reading_options,
    reading_report_options,
    running_options,
)
from jaxmotion.cli._terminal import say, say_json

if TYPE_CHECKING:
    from jaxmotion.metrics import Problem

_SHOWN = 6


@click.command(short_help="Look for problems; exit code 3 if there are any.")
@files_argument
@reading_options
@click.option("--json", "as_json", is_flag=True, help="As JSON, a list with one entry a file.")
@click.option(
    "--ignore", multiple=True, metavar="KIND", help="Leave out a kind of finding; may be repeated."
)
@click.option("--strict", is_flag=True, help="Let notes count as problems.")
@reading_report_options
@running_options
def command(
    files: tuple[str, ...],
    running: Running,
    reading: Reading,
    as_json: bool,
    ignore: tuple[str, ...],
    strict: bool,
    report: Path | None,
    overwrite: bool,
) -> None:
    """Look for problems, by frame and joint; exit code 3 if there are any.

    \b
    unreadable  the file cannot be understood     repaired   it could, after a repair
    nan         values that are not numbers       empty      fewer than two frames
    rate        an unusual frame rate             duplicate  frames that repeat the one before
    order, norm  rotations that are (x, y, z, w), or no unit quaternions
    dtype       arrays of other or mixed types    degrees    turns as fast as degrees for radians
    jump        a turn of over 120° in one frame  spike      a joint out for one frame
    first       a first frame (a rest pose) that stands apart
    up          the figure stands along another axis than points up (--up says which)
    Notes, which do not change the exit code:
    flip        Euler angles that jump by 360°    gimbal     Euler angles near gimbal lock

    \b
    jaxmotion check takes --ignore gimbal
    """
    from jaxmotion.cli._files import expand
    from jaxmotion.cli._reading import each, report_of
    from jaxmotion.metrics import KINDS, Problem, find_problems

    kinds = ("unreadable", "repaired", *KINDS)
    if unknown := set(ignore) - set(kinds):
        raise click.UsageError(f"--ignore {sorted(unknown)[0]}: the kinds are {', '.join(kinds)}")
    found = []
    bad = 0
    places: dict[tuple[bool, str], list[Path]] = {}
    inputs = expand(files)
    with report_of(inputs, report, overwrite) as record:
        for item in each(inputs, reading, running, complain=False):
            problems = [Problem("repaired", text) for text in item.warnings]
            if item.motion is None:
                problems.append(Problem("unreadable", item.error))
            else:
                problems += find_problems(item.motion)
            problems = [p for p in problems if p.kind not in ignore]
            bad += any(p.serious or strict for p in problems)
            for problem in problems:
                places.setdefault((not problem.serious, problem.kind), []).append(item.path)
            entries = [{**asdict(p), "serious": p.serious} for p in problems]
            found.append({"file": str(item.path), "problems": entries})
            record.add(item.outcome({"problems": entries}, _summary(problems)))
            if not as_json:
                say(*_as_text(item.path, problems))
    if as_json:
        say_json(found)
    elif len(found) > 1:
        say(f"{bad} of {len(found)} files have problems.", *_by_kind(places), err=True)
    raise click.exceptions.Exit(3 if bad else 0)


def _summary(problems: "list[Problem]") -> str:
    """How many of each kind."""
    counts = Counter(problem.kind for problem in problems)
    return ", ".join(f"{kind}: {count}" for kind, count in counts.items()) or "ok"


def _by_kind(places: dict[tuple[bool, str], list[Path]]) -> list[str]:
    """A line a kind of finding, notes last: how many there are, and in which files."""
    lines = []
    for (note, kind), paths in sorted(places.items()):
        files = [printable(path) for path in dict.fromkeys(paths)]
        more = f" and {len(files) - _SHOWN} more" if len(files) > _SHOWN else ""
        label = f"{kind} (note)" if note else kind
        lines.append(f"  {label:<13} {len(paths)} in {', '.join(files[:_SHOWN])}{more}")
    return lines


def _as_text(path: Path, problems: "list[Problem]") -> list[str]:
    """The findings of a file, those of one kind and joint on one line."""
    name = printable(path)
    if not problems:
        return [f"{name}: ok"]
    groups: dict[Any, list[Problem]] = {}
    for problem in problems:
        groups.setdefault((not problem.serious, problem.kind, problem.joint), []).append(problem)
    lines = [f"{name}:"]
    for (note, kind, joint), group in sorted(groups.items(), key=lambda item: item[0][0]):
        worded = group[0].message.removeprefix(f"{name}: found ").removeprefix(f"{name}: ")
        where = [_frames(p) for p in group if p.frame is not None]
        more = f" and {len(where) - _SHOWN} more" if len(where) > _SHOWN else ""
        place = f"frame {', '.join(where[:_SHOWN])}{more}: " if where else ""
        label = f"{kind} (note)" if note else kind
        lines.append(f"  {label:<13} {f'{joint}, ' if joint else ''}{place}{worded}")
    return lines


def _frames(problem: "Problem") -> str:
    last = problem.last_frame
    return str(problem.frame) if last in (None, problem.frame) else f"{problem.frame}-{last}"
