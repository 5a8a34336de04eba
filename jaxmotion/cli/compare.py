"""``jaxmotion compare``: how two clips differ, by joint and by frame, and both in a player."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxmotion._plain import printable
from jaxmotion.cli._options import Reading, Running, reading_options, running_options
from jaxmotion.cli._showing import Showing, names_of, showing_options
from jaxmotion.cli._terminal import say, say_json

if TYPE_CHECKING:
    import numpy as np

    from jaxmotion import Motion

_SHOWN = 12
_RATES = 1e-5  # that rates may differ by

_OF_JOINTS = (
    *("joint", "turned, mean, degrees", "turned most", "at frame"),
    *("moved, mean, length units", "moved most", "at frame"),
)
_OF_FRAMES = "frame", "turned most, degrees", "joint", "moved most, length units", "joint"
_NOTES = {
    "joints": "only in one: {}",
    "unit": "lengths of {} are told in units of {:g} m",
    "rate": "{} was resampled to {:.6g} frames a second",
    "frames": "{} goes on for {} frames more",
    "up": "{} was turned to stand along {}",
}


@dataclass(frozen=True)
class Pair:
    """Two clips in frames and joints that both have, and what was done for that. ``angle``,
    ``distance``: f[T, J] of these joints, radians and length units of the first."""

    first: "Motion"
    second: "Motion"
    joints: list[str]
    angle: "np.ndarray"
    distance: "np.ndarray"
    notes: list[str]

    @property
    def seen(self) -> bool:
        """Whether one sees that they differ."""
        from jaxmotion.metrics.measures import VISIBLE_SHIFT, VISIBLE_TURN, figure_size

        far = VISIBLE_SHIFT * figure_size(self.first)
        return bool(self.angle.max() > VISIBLE_TURN or self.distance.max() > far)


@click.command(short_help="How two clips differ; both in a player.")
@click.argument("first", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("second", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@reading_options
@click.option("--frames", is_flag=True, help="List all frames as well, with what differs most.")
@click.option("--json", "as_json", is_flag=True, help="As JSON: by joint and by frame.")
@showing_options
@running_options
def command(
    first: Path,
    second: Path,
    running: Running,
    reading: Reading,
    frames: bool,
    as_json: bool,
    showing: Showing,
) -> None:
    """How two clips differ, by joint and by frame; and both in a player, one over the other, with
    curves of what differs.

    Joints are matched by name. A clip of another rate is resampled, and turned if it stands along
    another axis.

    \b
    jaxmotion compare take.bvh clean/take.bvh
    jaxmotion compare take.bvh clean/take.bvh -o difference.html
    jaxmotion compare take.bvh clean/take.bvh --no-open --json
    """
    from jaxmotion.cli import _session
    from jaxmotion.cli._joining import read_clips

    showing.check([first, second])
    _session.start(cache=running.cache, little=_session.is_little([first, second]))
    clips = read_clips([first, second], reading)
    found = paired(*clips, names=(first.name, second.name))
    by_joint, by_frame = rows_of_joints(found), rows_of_frames(found)
    if as_json:
        told = {"first": str(first), "second": str(second), "notes": found.notes}
        say_json({**told, "joints": by_joint, "frames": by_frame})
    else:
        say(*_as_text(found, by_joint))
        say(*(map(_frame, by_frame) if frames else ()))
    if showing.out is not None or showing.opens:
        title = f"{first.name} and {second.name}"
        showing.show(_page(title, found, by_joint, by_frame, (first, second)), first.stem)


def paired(first: "Motion", second: "Motion", names: tuple[str, str]) -> Pair:
    """The clips beside each other; ``names``: what to call them."""
    import numpy as np

    import jaxmotion as jm
    from jaxmotion import metrics
    from jaxmotion.axes import reorient

    notes = []
    both = [name for name in first.skeleton.names if name in set(second.skeleton.names)]
    if not both:
        raise click.ClickException("no joint of one clip has the name of one of the other")
    only = sorted(set(first.skeleton.names) ^ set(second.skeleton.names))
    if only:
        notes.append(_NOTES["joints"].format(", ".join(map(printable, only))))
    if second.skeleton.up != first.skeleton.up:
        second = reorient(second, first.skeleton.up)
        notes.append(_NOTES["up"].format(printable(names[1]), first.skeleton.up))
    units = [clip.skeleton.conventions.metres for clip in (first, second)]
    if units[0] and units[1] and units[0] != units[1]:
        second = _scaled(second, units[1] / units[0])
        notes.append(_NOTES["unit"].format(printable(names[1]), units[0]))
    rates = float(first.fps), float(second.fps)
    if abs(rates[1] / rates[0] - 1) > _RATES:
        second = jm.resample(second, fps=rates[0])
        notes.append(_NOTES["rate"].format(printable(names[1]), rates[0]))
    frames = min(first.num_frames, second.num_frames)
    for name, clip in zip(names, (first, second), strict=True):
        if clip.num_frames > frames:
            notes.append(_NOTES["frames"].format(printable(name), clip.num_frames - frames))
    first, second = first[:frames], second[:frames]
    at = [[clip.skeleton.index(name) for name in both] for clip in (first, second)]
    clips = list(zip((first, second), at, strict=True))
    places = [metrics.world_positions(clip)[:, joints] for clip, joints in clips]
    turns = [np.asarray(clip.rotations)[:, joints] for clip, joints in clips]
    distance = np.linalg.norm(np.subtract(*places), axis=-1)
    return Pair(first, second, both, metrics.turn(*turns), distance, notes)


def _scaled(motion: "Motion", scale: float) -> "Motion":
    """The motion with all its lengths times ``scale``."""
    import equinox as eqx

    def lengths(motion: "Motion") -> tuple:
        skeleton = motion.skeleton
        return motion.translations, skeleton.offsets, skeleton.end_offsets

    return eqx.tree_at(lengths, motion, tuple(scale * x for x in lengths(motion)))


def rows_of_joints(pair: Pair) -> list[dict[str, Any]]:
    """How each joint differs, that which is turned most first: degrees, length units."""
    import numpy as np

    rows = []
    for j in np.argsort(-pair.angle.max(axis=0), kind="stable").tolist():
        angle, distance = np.degrees(pair.angle[:, j]), pair.distance[:, j]
        rows.append(
            {
                "joint": pair.joints[j],
                "degrees_mean": float(angle.mean()),
                "degrees_most": float(angle.max()),
                "degrees_frame": int(angle.argmax()),
                "distance_mean": float(distance.mean()),
                "distance_most": float(distance.max()),
                "distance_frame": int(distance.argmax()),
            }
        )
    return rows


def rows_of_frames(pair: Pair) -> list[dict[str, Any]]:
    """What differs most in each frame."""
    import numpy as np

    rows = []
    for frame, (angle, distance) in enumerate(zip(pair.angle, pair.distance, strict=True)):
        turned, moved = int(angle.argmax()), int(distance.argmax())
        rows.append(
            {
                "frame": frame,
                "degrees": float(np.degrees(angle[turned])),
                "turned": pair.joints[turned],
                "distance": float(distance[moved]),
                "moved": pair.joints[moved],
            }
        )
    return rows


def _as_text(pair: Pair, rows: list[dict[str, Any]]) -> list[str]:
    angle, distance = math.degrees(pair.angle.max()), float(pair.distance.max())
    same = not pair.seen
    words = ""
    if same and (angle or distance):
        words = f": the same, to {angle:.2g}° and {distance:.2g} length units"
    elif same:
        words = ": all the same"
    lines = [f"{pair.first.num_frames} frames, {len(pair.joints)} joints{words}"]
    lines += [f"  {note}" for note in pair.notes]
    if same:
        return lines
    lines.append("  turned: mean      most  at frame   moved: mean    most  at frame  joint")
    for row in rows[:_SHOWN]:
        lines.append(
            f"  {row['degrees_mean']:11.3g}° {row['degrees_most']:8.3g}° {row['degrees_frame']:9}"
            f" {row['distance_mean']:13.3g} {row['distance_most']:7.3g} {row['distance_frame']:9}"
            f"  {printable(row['joint'])}"
        )
    if len(rows) > _SHOWN:
        lines.append(f"  and {len(rows) - _SHOWN} joints that turned less (--json has all)")
    return lines


def _frame(row: dict[str, Any]) -> str:
    turned, moved = printable(row["turned"]), printable(row["moved"])
    return (
        f"  frame {row['frame']:5}: {row['degrees']:8.3g}° {turned}, {row['distance']:8.3g} {moved}"
    )


def _page(
    title: str,
    pair: Pair,
    by_joint: list[dict[str, Any]],
    by_frame: list[dict[str, Any]],
    paths: tuple[Path, Path],
) -> str:
    """The player, and the tables."""
    import numpy as np

    from jaxmotion.cli._compared import shown
    from jaxmotion.cli._page import PLAYER, document, listed, table_of
    from jaxmotion.viz import player
    from jaxmotion.viz.player.page import framed

    skeleton = pair.first.skeleton
    at = [skeleton.index(name) for name in pair.joints]
    # What only one of them has is not known to be the same.
    angle, distance = np.full((2, pair.first.num_frames, skeleton.num_joints), np.nan)
    angle[:, at], distance[:, at] = pair.angle, pair.distance
    clips = dict(zip(names_of(list(paths)), (pair.first, pair.second), strict=True))
    marks = shown(skeleton.names, angle, distance, seen=pair.seen)
    page = player(clips, title=title, **marks)
    parts = [
        framed(page.html, PLAYER),
        listed(pair.notes),
        table_of("By joint", by_joint, _OF_JOINTS),
        table_of("By frame", by_frame, _OF_FRAMES, folded=True),
    ]
    return document(title, parts)
