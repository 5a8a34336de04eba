"""Where one clip becomes the next: put end to end, and stitched."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jaxmotion._plain import printable
from jaxmotion.cleaning.turns import angles_between
from jaxmotion.motion import Motion
from jaxmotion.multiresolution.stitching import Stitched, stitched
from jaxmotion.viz.colours import BLUE, GREY, ORANGE
from jaxmotion.viz.given import joint_numbers, known_clip
from jaxmotion.viz.turns import from_middle, middle_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 4  # joints
_AROUND = 0.75  # seconds


def plot_seam(
    motions: Sequence[Motion],
    levels: int | None = None,
    *,
    align: bool = True,
    search: int = 0,
    seam: int = 0,
    joints: Sequence[int | str] | None = None,
) -> "Figure":
    """Draw how joints turn about a seam, with the clips end to end and with them stitched.

    Degrees from the mean pose about the seam, the component of the rotation vector that jumps most,
    in the joint's own axes, from three quarters of a second before the seam to as long after it.
    Source: Lee & Shin 2001, Fig. 9.

    **Arguments:** ``motions``: two or more clips of one skeleton and frame time; ``levels``,
    ``align``, ``search``: as :func:`jaxmotion.multiresolution.stitch`; ``seam``: which of the
    seams; ``joints``: numbers or names, by default the four that jump most.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("seam.png")``), outside pyplot,
    with a row a joint; notebooks show it.
    **Raises:** ``ValueError`` for fewer than two clips, what is not one known clip, a seam that
    there is not, unknown joints, as ``stitch``; ``ImportError`` without Matplotlib.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk, run = (jm.samples.load(name).motion[:40] for name in ("walk", "run"))
        >>> figure = jm.viz.plot_seam([walk, run], joints=["LeftLeg"])
        >>> figure.axes[0].get_title(loc="left")
        'LeftLeg'
    """
    from jaxmotion.viz.picture import Picture

    if not isinstance(motions, Sequence) or len(motions) < 2:
        raise ValueError("plot_seam: motions must be a list of two clips at least")
    for i, motion in enumerate(motions):
        known_clip("plot_seam", motion, f"motions[{i}]")
    if not -len(motions) < seam < len(motions) - 1:
        raise ValueError(f"plot_seam: seam={seam}; there are {len(motions) - 1} seams")
    found = stitched(motions, levels, align=align, search=search)
    at, second = found.seams[seam], float(found.motion.frame_time)
    skeleton = found.motion.skeleton
    chosen = joint_numbers("plot_seam", skeleton, joints, _jump_most(found, at))
    around = max(round(_AROUND / second), 1)
    first, last = max(0, at - around), min(found.motion.num_frames, at + around + 1)
    times = second * (np.arange(first, last) - at)
    figure = Picture(figsize=(7.0, 1.2 + 1.2 * len(chosen)), layout="constrained")
    grid = figure.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
    for axes, joint in zip(grid, chosen, strict=True):
        old, new = (
            np.asarray(clip.rotations)[first:last, joint]
            for clip in (found.end_to_end, found.motion)
        )
        middle = middle_of(new)
        before, after = from_middle(old, middle), from_middle(new, middle)
        jump = np.abs(np.diff(before[max(at - first - 1, 0) :][:2], axis=0)).sum(axis=0)
        along = int(np.argmax(jump))
        axes.axvline(0, color=GREY, lw=1)
        # The clips meet between two frames: no line is drawn there.
        for part in (slice(None, at - first), slice(at - first, None)):
            label = "end to end" if part.start is None else None
            axes.plot(times[part], before[part, along], color=ORANGE, ls="--", lw=1.6, label=label)
        axes.plot(times, after[:, along], color=BLUE, lw=1.8, label="stitched")
        axes.set_title(
            printable(skeleton.names[joint]), fontsize="small", loc="left", pad=3, parse_math=False
        )
        axes.set_ylabel(f"about {'xyz'[along]}", fontsize="small")
        axes.margins(x=0)
        axes.spines[["top", "right"]].set_visible(False)
    grid[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, frameon=False, borderpad=0.2)
    grid[-1].set_xlabel("seconds from the seam")
    figure.supylabel("degrees from mean", fontsize="medium")
    return figure


def _jump_most(found: Stitched, seam: int) -> list[int]:
    """The joints that turn furthest between the clips, beyond their own steps, in order."""
    q = np.asarray(found.end_to_end.rotations)
    jump = angles_between(q[seam - 1 : seam], q[seam : seam + 1])[0] if seam else 0 * q[0, :, 0]
    return sorted(np.argsort(-jump, kind="stable")[:_MOST].tolist())
