"""``jaxmotion info``: what a file holds."""

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
    from jaxmotion import Motion, Skeleton

_HEADINGS = " frames     rate   seconds joints    height  up  file"


@click.command(short_help="What a file holds.")
@files_argument
@reading_options
@click.option("--json", "as_json", is_flag=True, help="As JSON, a list with one entry a file.")
@click.option("--tree", is_flag=True, help="Draw the skeleton.")
@reading_report_options
@running_options
def command(
    files: tuple[str, ...],
    running: Running,
    reading: Reading,
    as_json: bool,
    tree: bool,
    report: Path | None,
    overwrite: bool,
) -> None:
    """What a file holds: joints, frames, rate, channels, size; of several files, a row each.

    \b
    jaxmotion info walk.bvh --tree
    jaxmotion info takes
    jaxmotion info takes --json
    """
    from jaxmotion.cli._files import expand
    from jaxmotion.cli._reading import each, report_of

    found = []
    failed = False
    inputs = expand(files)
    in_rows = len(inputs) > 1 and not (as_json or tree)
    with report_of(inputs, report, overwrite) as record:
        if in_rows:
            say(_HEADINGS)
        for item in each(inputs, reading, running, uses_up=True):
            failed |= item.motion is None
            learned = describe(item.motion) if item.motion else {}
            record.add(item.outcome(learned))
            if item.motion is None:
                continue
            facts = {"file": str(item.path), **learned, "warnings": item.warnings}
            found.append(facts)
            if in_rows:
                say(_as_row(item.path, facts))
                say(*(f"  warning: {text}" for text in item.warnings), err=True)
            elif not as_json:
                say(*_as_text(item.path, facts))
                if tree:
                    _draw(item.motion.skeleton)
    if as_json:
        say_json(found)
    if in_rows:
        frames, seconds = (sum(facts[name] for facts in found) for name in ("frames", "seconds"))
        say(f"{len(found)} files, {frames} frames, {seconds:.6g} s", err=True)
    raise click.exceptions.Exit(1 if failed else 0)


def describe(motion: "Motion") -> dict[str, Any]:
    """What there is to know about a clip; lengths in the file's unit."""
    import numpy as np

    from jaxmotion import metrics
    from jaxmotion.cli._work import duration

    skeleton = motion.skeleton
    points = metrics.world_positions(motion)
    up = skeleton.up_axis
    height = np.median(np.ptp(points[:, :, up], axis=1))
    return {
        "frames": motion.num_frames,
        "fps": round(1.0 / float(motion.frame_time), 6),
        "frame_time": float(motion.frame_time),
        "seconds": duration(motion),
        "joints": list(skeleton.names),
        "parents": list(skeleton.parents),
        "end_sites": len(skeleton.end_joints),
        "channels": [list(names) for names in skeleton.channels],
        "translated_joints": [skeleton.names[j] for j in motion.translated_joints],
        "up": skeleton.up,
        "length_unit": skeleton.length_unit,
        "conventions": asdict(skeleton.conventions),
        "height": float(height),
        "bounding_box": [points.min((0, 1)).tolist(), points.max((0, 1)).tolist()],
    }


def _as_row(path: Path, facts: dict[str, Any]) -> str:
    """Figures in columns, and the name last: rows are shown as files are read."""
    figures = f"{facts['frames']:7} {facts['fps']:8.6g} {facts['seconds']:9.2f}"
    return f"{figures} {len(facts['joints']):6} {facts['height']:9.4g}  {facts['up']}   {path}"


def _as_text(path: Path, facts: dict[str, Any]) -> list[str]:
    low, high = (", ".join(f"{v:.4g}" for v in corner) for corner in facts["bounding_box"])
    channels = facts["channels"]
    moving = facts["translated_joints"]
    layouts = sorted({" ".join(names) for names in channels if names}, key=len)
    shown = "; ".join(layouts[:3]) + (f"; and {len(layouts) - 3} more" * (len(layouts) > 3))
    unit, metres = facts["length_unit"], facts["conventions"]["metres"]
    known = {
        name: "" if how == "told" else f" ({how})" for name, how in facts["conventions"].items()
    }
    if metres is None:
        length = "not told" if unit == 1.0 else f"{unit:g}"
    else:
        length = "metres" if metres == 1.0 else f"{metres:g} m"
    rows = [
        ("joints", f"{len(facts['joints'])}, and {facts['end_sites']} end sites"),
        (
            "frames",
            f"{facts['frames']} at {facts['fps']:.6g} a second{known['frame_time']}: "
            f"{facts['seconds']:.2f} s",
        ),
        ("channels", f"{sum(map(len, channels))} ({shown})"),
        (
            "translated",
            ", ".join(moving[:6]) + (f" and {len(moving) - 6} more" * (len(moving) > 6)),
        ),
        ("up", facts["up"] + known["up"]),
        *([("angles", "degrees (assumed)")] if known["angle"] else []),
        ("length unit", length),
        ("height", f"{facts['height']:.4g}, the median over frames"),
        ("moves within", f"({low}) to ({high})"),
        *(("warning", text) for text in facts["warnings"]),
    ]
    return [str(path), *(f"  {name:<13} {text}" for name, text in rows)]


def _draw(skeleton: "Skeleton") -> None:
    from rich.console import Console
    from rich.text import Text
    from rich.tree import Tree

    branches: list[Tree] = []
    for name, parent, channels in zip(
        skeleton.names, skeleton.parents, skeleton.channels, strict=True
    ):
        label = Text(printable(name))
        label.append(f"  {len(channels)}", style="dim")
        branches.append(Tree(label) if parent < 0 else branches[parent].add(label))
    for joint in skeleton.end_joints:
        branches[joint].add(Text("end site", style="dim"))
    Console(emoji=False).print(branches[0])
