"""Where joints go over the ground, seen from above."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from jaxmotion._plain import printable
from jaxmotion._posture import axes_of
from jaxmotion.kinematics import facing_direction, forward_kinematics, mirrored_pairs
from jaxmotion.motion import Motion
from jaxmotion.viz.body import body_of
from jaxmotion.viz.colours import SERIES
from jaxmotion.viz.given import joint_numbers, named_clips, unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLES = ("-", "--", ":", "-.")
_LARGEST = 6.0  # inches of a side


def plot_trajectories(
    motions: Motion | Mapping[str, Motion], *, joints: Sequence[int | str] | None = None
) -> "Figure":
    """Draw the paths of joints over the ground, from above.

    A ring is where a path begins. The root (the hips, where a root stays and they go) has an arrow
    each second, which way the body faces, where left and right have names. Both axes have the
    file's unit and one scale; seen from above, the second is a quarter turn to the left of the
    first, so that turns to the left look so.

    **Arguments:** ``motions``: one clip, or clips by name, with one axis up; ``joints``: numbers or
    names, by default the root.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("paths.png")``), outside pyplot;
    notebooks show it.
    **Raises:** ``ValueError`` for what is not one known clip, clips of different axes up, unknown
    joints; ``ImportError`` without Matplotlib.

    **Example:**

        >>> import jaxmotion as jm
        >>> figure = jm.viz.plot_trajectories(jm.samples.load("walk").motion[:61])
        >>> figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()
        ('z, metres', 'x, metres')
    """
    from jaxmotion.viz.picture import Picture

    clips = named_clips("plot_trajectories", motions)
    first, *others = clips.values()
    for clip in others:
        if clip.skeleton.up != first.skeleton.up:
            raise ValueError(
                f"plot_trajectories: clips with {first.skeleton.up} and {clip.skeleton.up} up; "
                "expected one axis (jaxmotion.reorient)"
            )
    ahead, aside = (int(np.argmax(axis)) for axis in axes_of(first)[:2])
    paths = {}
    for name, clip in clips.items():
        where = np.asarray(forward_kinematics(clip).positions, np.float64)
        root = body_of(where, clip.skeleton.parents).first
        chosen = joint_numbers("plot_trajectories", clip.skeleton, joints, [root])
        paths[name] = chosen, where[:, :, [ahead, aside]], root
    figure = Picture(figsize=_size(paths), layout="constrained")
    axes = figure.add_subplot()
    lines = {}  # Matplotlib's own legend leaves out names that begin with "_"
    for number, (name, (chosen, where, root)) in enumerate(paths.items()):
        clip = clips[name]
        for k, joint in enumerate(chosen):
            colour = SERIES[(number if len(clips) > 1 else k) % len(SERIES)]
            style = _STYLES[(k if len(clips) > 1 else 0) % len(_STYLES)]
            words = [name] * (len(clips) > 1) + [printable(clip.skeleton.names[joint])]
            label = ", ".join(words[: 1 + (len(chosen) > 1 or len(clips) == 1)])
            path = where[:, joint]
            (line,) = axes.plot(*path.T, color=colour, ls=style, lw=1.8)
            lines[line] = label.replace("$", r"\$")
            axes.plot(*path[:1].T, "o", color=colour, ms=8, mfc="white", mew=1.8)
            if joint == root:
                _arrows(axes, clip, path, (ahead, aside), colour)
    unit = unit_of(first.skeleton)
    axes.set_xlabel(f"{'xyz'[ahead]}, {unit}")
    axes.set_ylabel(f"{'xyz'[aside]}, {unit}")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(color="0.9", lw=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    columns = min(len(lines), 4)
    place = {"loc": "outside upper center", "ncols": columns, "frameon": False}
    figure.legend([*lines], [*lines.values()], **place)
    return figure


def _size(paths: dict[str, tuple[list[int], np.ndarray, int]]) -> tuple[float, float]:
    """Inches for what is drawn, at most three times as wide as it is high and the other way."""
    drawn = np.concatenate([where[:, chosen].reshape(-1, 2) for chosen, where, _ in paths.values()])
    extent = np.ptp(drawn, axis=0)
    extent = np.maximum(extent, max(extent.max(), 1e-9) / 3)
    wide, high = _LARGEST * extent / extent.max()
    return wide + 1.0, high + 1.0


def _arrows(axes, motion: Motion, path: np.ndarray, ground: tuple[int, int], colour: str) -> None:
    """Which way the body faces, each second."""
    if not mirrored_pairs(motion):
        return
    step = max(round(1 / float(motion.frame_time)), 1)
    facing = np.asarray(facing_direction(motion))[::step][:, list(ground)]
    axes.quiver(*path[::step].T, *facing.T, color=colour, angles="xy", scale=16, width=0.004)
