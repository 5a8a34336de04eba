"""Runs of errors in rows for a report and in lines for people; seconds and degrees."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from jaxmotion._plain import printable, some

if TYPE_CHECKING:
    from jaxmotion.cleaning import DetectedErrors, ErrorRun, Repaired, RepairedRun

_NAMED = 4

Row: TypeAlias = dict[str, Any]


def of_errors(errors: "DetectedErrors") -> list[Row]:
    """A row a run that was found."""
    second = float(errors.motion.frame_time)
    return [_where(run, second) | _found([run]) for run in errors.runs]


def of_repair(repaired: "Repaired") -> list[Row]:
    """A row a run that was repaired, with what was found in it."""
    second = float(repaired.motion.frame_time)
    found = repaired.errors.runs if repaired.errors is not None else ()
    rows = []
    for run in repaired.runs:
        inside = [x for x in found if x.start < run.stop and run.start < x.stop]
        turns = {"change": run.change, "jump_before": run.jump_before, "jump_after": run.jump_after}
        degrees = {name: math.degrees(angle) for name, angle in turns.items()}
        rows.append(_where(run, second) | _found(inside) | degrees)
    return rows


def _where(run: "ErrorRun | RepairedRun", second: float) -> Row:
    return {
        "start": run.start,
        "stop": run.stop,
        "seconds": second * run.start,
        "lasts": second * (run.stop - run.start),
        "joints": list(run.joints),
    }


def _found(runs: "Sequence[ErrorRun]") -> Row:
    detectors = dict.fromkeys(name for run in runs for name in run.detectors)
    return {
        "size": math.degrees(max((run.size for run in runs), default=0.0)),
        "detectors": list(detectors),
        "confidence": max((run.confidence for run in runs), default=None),
    }


def counted(rows: Sequence[Row], share: float, done: str) -> str:
    """How many runs, and of how much of the clip that was ``done``."""
    return f"{some(len(rows), 'run')}, {100 * share:.2g} % of joint-frames {done}"


def largest(rows: Sequence[Row]) -> str:
    """The run that was changed most, in a line; "" for none."""
    if not rows:
        return ""
    row = max(rows, key=lambda row: row["change"])
    return f"largest, in {_frames(row)}: {_joints(row)} by {row['change']:.3g}°"


def told(rows: Sequence[Row], share: float, done: str, left: Sequence[Row], least: float) -> str:
    """:func:`counted`, and how many runs were ``left`` for want of confidence."""
    parts = [counted(rows, share, done)] if rows else []
    parts += [f"{some(len(left), 'run')} of confidence below {least:g} left"] if left else []
    return "; ".join(parts) or "nothing found"


def surest(rows: Sequence[Row]) -> str:
    """Of runs that were left that of the greatest confidence, in a line; "" for none."""
    if not rows:
        return ""
    row = max(rows, key=lambda row: row["confidence"])
    return f"left, in {_frames(row)}: {_joints(row)}, confidence {row['confidence']:.2f}"


def listed(rows: Sequence[Row], left: Sequence[Row] = ()) -> list[str]:
    """A line a run that was found, in order; those that are ``left`` are marked."""
    marked = [(row, "") for row in rows] + [(row, ", left") for row in left]
    marked.sort(key=lambda pair: pair[0]["start"])
    frames = [_frames(row) for row, _ in marked]
    width = max(map(len, frames), default=0)
    return [
        f"  {text:<{width}}  {row['seconds']:6.2f} to {row['seconds'] + row['lasts']:.2f} s  "
        f"{_joints(row)}, {row['size']:.3g}°, {', '.join(row['detectors'])}, "
        f"confidence {row['confidence']:.2f}{mark}"
        for text, (row, mark) in zip(frames, marked, strict=True)
    ]


def _frames(row: Row) -> str:
    first, last = row["start"], row["stop"] - 1
    return f"frame {first}" if first == last else f"frames {first}-{last}"


def _joints(row: Row) -> str:
    names = [printable(name) for name in row["joints"]]
    more = f" and {len(names) - _NAMED} more joints" if len(names) > _NAMED else ""
    return f"{', '.join(names[:_NAMED])}{more}"
