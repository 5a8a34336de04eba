"""A row of poses, one after another in time, as seen from the side or from in front."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np

from jaxmotion._checks import counted, one_of
from jaxmotion.kinematics import facing_direction, forward_kinematics, mirrored_pairs
from jaxmotion.motion import Motion
from jaxmotion.viz.body import body_of
from jaxmotion.viz.colours import BLUE, GREY, ORANGE, SERIES
from jaxmotion.viz.given import named_clips, unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_GAP = 0.15  # of a pose's width
_WIDEST = 14.0  # inches


def plot_poses(
    motions: Motion | Mapping[str, Motion],
    *,
    count: int = 10,
    view: Literal["side", "front"] = "side",
) -> "Figure":
    """Draw poses side by side, evenly spaced in time: a strip.

    Each pose is drawn above the place on the ground where its root is (the hips, where a root stays
    and they go), in parallel projection, by
    the way the body faces on average (:func:`jaxmotion.facing_direction`; where left and right have
    no names, by the way the root goes, or the first ground axis). One clip has its left limbs blue
    and its right ones orange; several are drawn over each other, each in its colour.

    **Arguments:** ``motions``: one clip, or clips by name, such as before and after, of one number
    of frames and one frame time; ``count``: how many poses, at most one a frame; ``view``: "side",
    from the body's right, so that it faces to the right, or "front".
    **Returns:** a Matplotlib figure of its own (``figure.savefig("strip.png")``), outside pyplot;
    notebooks show it.
    **Raises:** ``ValueError`` for what is not one known clip, clips of different lengths, a count
    below 1, another view; ``ImportError`` without Matplotlib.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk").motion[:61]
        >>> both = {"as it was": walk, "lively": jm.stylize(walk, 2.0)}
        >>> figure = jm.viz.plot_poses(both, count=5)
        >>> [label.get_text() for label in figure.axes[0].get_xticklabels()]
        ['0', '0.25', '0.5', '0.75', '1']
    """
    from matplotlib.collections import LineCollection

    from jaxmotion.viz.picture import Picture

    clips = named_clips("plot_poses", motions)
    first = _checked(clips, count, view)
    count = min(count, first.num_frames)
    frames = np.round(np.linspace(0, first.num_frames - 1, count)).astype(int)
    directions = _across(first, view)
    drawn = {name: _bones(clip, frames, directions) for name, clip in clips.items()}
    every = np.concatenate([bones.reshape(-1, 2) for bones in drawn.values()])
    low, high = every.min(axis=0), every.max(axis=0)
    apart = max((1 + _GAP) * (high[0] - low[0]), 0.3 * (high[1] - low[1])) or 1.0
    places = apart * np.arange(count)
    inch = min(_WIDEST / (apart * count), 2.4 / max(high[1] - low[1], apart / 10))
    size = max(inch * apart * count + 0.8, 3.0), inch * (high[1] - low[1]) + 1.2
    figure = Picture(figsize=size, layout="constrained")
    axes = figure.add_subplot()
    for (name, bones), colour in zip(drawn.items(), _colours(clips), strict=True):
        moved = bones + np.stack([places, np.zeros(count)], -1)[:, None, None]
        lines = moved.reshape(-1, 2, 2)
        colours = [*colour] * count if isinstance(colour, tuple) else colour
        axes.add_collection(
            LineCollection(
                list(lines), colors=colours, linewidths=2.0, capstyle="round", label=name
            )
        )
    axes.set_xlim(low[0] - 0.1 * apart, places[-1] + high[0] + 0.1 * apart)
    margin = 0.03 * max(high[1] - low[1], apart / 10)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.set_aspect("equal")
    second = float(first.frame_time)
    axes.set_xticks(places, [f"{round(second * t, 2):g}" for t in frames])
    axes.set_xlabel("seconds")
    axes.set_ylabel(f"height, {unit_of(first.skeleton)}")
    axes.spines[["top", "right"]].set_visible(False)
    _legend(axes, clips)
    return figure


def _checked(clips: dict[str, Motion], count: int, view: str) -> Motion:
    one_of("plot_poses: view", view, ("side", "front"))
    counted("plot_poses: count", count, 10**6)
    first, *others = clips.values()
    for clip in others:
        if clip.num_frames != first.num_frames or clip.skeleton.up != first.skeleton.up:
            raise ValueError(
                f"plot_poses: clips of {first.num_frames} and {clip.num_frames} frames, "
                f"{first.skeleton.up} and {clip.skeleton.up} up; expected clips that are alike"
            )
    return first


def _across(motion: Motion, view: str) -> np.ndarray:
    """Unit vectors f[2, 3]: what goes to the right in the picture, and up."""
    up = np.eye(3)[motion.skeleton.up_axis]
    ahead = np.zeros(3)
    if mirrored_pairs(motion):
        ahead = np.asarray(facing_direction(motion), np.float64).mean(axis=0)
    if np.linalg.norm(ahead) < 1e-6:
        positions = forward_kinematics(motion).positions
        path = np.asarray(positions, np.float64)[:, motion.body_joint]
        ahead = (path[-1] - path[0]) * (1 - up)
    if np.linalg.norm(ahead) < 1e-6:
        ahead = np.roll(up, 1)
    ahead = ahead / np.linalg.norm(ahead)
    return np.stack([ahead if view == "side" else np.cross(up, ahead), up])


def _bones(motion: Motion, frames: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """f[count, bone, 2, 2]: both ends of every bone, to the right and up in the picture."""
    # One program for any count: kinematics of the whole clip.
    pose = forward_kinematics(motion)
    joints, ends = (np.asarray(x, np.float64)[frames] for x in (pose.positions, pose.end_positions))
    skeleton, up = motion.skeleton, directions[1]
    parents = [*skeleton.parents, *skeleton.end_joints]
    body = body_of(np.concatenate([pose.positions, pose.end_positions], axis=1), parents)
    place = joints[:, body.first, None] * (1 - up)
    joints, ends = (joints - place) @ directions.T, (ends - place) @ directions.T
    if len(parents) == 1:  # a single joint is a point
        return np.stack([joints, joints], axis=2)
    points = np.concatenate([joints, ends], axis=1)
    tips = np.arange(1, len(parents))
    # Of what is not to be seen a bone of no length.
    starts = np.where(body.drawn(parents)[1:], np.array(parents)[1:], tips)
    return np.stack([points[:, starts], points[:, tips]], axis=2)


def _colours(clips: dict[str, Motion]) -> list:
    if len(clips) > 1:
        return [GREY, *(SERIES * len(clips))][: len(clips)]
    (clip,) = clips.values()
    sides = dict.fromkeys(range(clip.num_joints), GREY)
    for left, right in mirrored_pairs(clip):
        sides[left], sides[right] = BLUE, ORANGE
    ends = [sides[j] for j in clip.skeleton.end_joints]
    return [tuple([sides[j] for j in range(1, clip.num_joints)] + ends) or GREY]


def _legend(axes, clips: dict[str, Motion]) -> None:
    from matplotlib.lines import Line2D

    if len(clips) > 1:
        looks = dict(zip(clips, _colours(clips), strict=True))
    elif mirrored_pairs(next(iter(clips.values()))):
        looks = {"left": BLUE, "right": ORANGE}
    else:
        return
    handles = [Line2D([], [], color=colour, lw=2) for colour in looks.values()]
    labels = [name.replace("$", r"\$") for name in looks]
    place = {"loc": "lower right", "bbox_to_anchor": (1, 1)}
    axes.legend(handles, labels, frameon=False, ncols=len(looks), borderpad=0.2, **place)
