"""What a repair did to the joints of a run: before and after."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from jaxmotion._plain import printable, some
from jaxmotion.cleaning import Repaired, RepairedRun
from jaxmotion.cleaning.turns import angles_between, mean_rotation
from jaxmotion.viz.colours import BLUE, ORANGE, PALE
from jaxmotion.viz.given import known_only

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 6  # joints
_AROUND = 1.0  # seconds


def plot_repair(repaired: Repaired, *, run: int = 0) -> "Figure":
    """Draw how the joints of a repaired run turned before and after.

    Each joint's angle from its mean pose over the clip, degrees over seconds, from a second before
    the run to a second after it; repaired frames are shaded. Of more than six joints those changed
    most.

    **Arguments:** ``repaired``: of :func:`jaxmotion.cleaning.repair`, not traced; ``run``: which of
    its runs.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("run.png")``), outside pyplot;
    notebooks show it.
    **Raises:** ``ValueError`` for a run that there is not, what is traced; ``ImportError`` without
    Matplotlib.
    """
    from jaxmotion.viz.picture import Picture

    known_only("plot_repair", repaired=repaired)
    every = repaired.runs
    if not -len(every) <= run < len(every):
        raise ValueError(f"plot_repair: run={run}; there are {len(every)} runs")
    chosen = every[run]
    motion, second = repaired.motion, float(repaired.motion.frame_time)
    joints = _changed_most(repaired, chosen)
    around = round(_AROUND / second)
    first, last = max(0, chosen.start - around), min(motion.num_frames, chosen.stop + around)
    times = second * np.arange(first, last)
    old, new = _angles(repaired, joints)
    mask = np.asarray(repaired.mask)
    figure = Picture(figsize=(7.5, 1.2 + 1.2 * len(joints)), layout="constrained")
    grid = figure.subplots(len(joints), 1, sharex=True, squeeze=False)[:, 0]
    for axes, column, joint in zip(grid, range(len(joints)), joints, strict=True):
        for t in np.flatnonzero(mask[first:last, joint]) + first:
            span = second * (t - 0.5), second * (t + 0.5)
            axes.axvspan(*span, color=PALE, lw=0, zorder=0)
        before, after = (x[first:last, column] for x in (old, new))
        axes.plot(times, before, color=ORANGE, ls="--", lw=1.4, label="before")
        axes.plot(times, after, color=BLUE, lw=1.8, label="after")
        name = printable(motion.skeleton.names[joint])
        axes.set_title(name, fontsize="small", loc="left", parse_math=False, pad=3)
        axes.margins(x=0)
        axes.set_ylim(bottom=0)
        axes.spines[["top", "right"]].set_visible(False)
    grid[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, frameon=False, borderpad=0.2)
    grid[-1].set_xlabel("seconds")
    figure.supylabel("degrees from mean", fontsize="medium")
    figure.suptitle(_title(chosen, len(joints)), fontsize="medium")
    return figure


def _title(run: RepairedRun, shown: int) -> str:
    frames = f"frame {run.start}" if run.stop - run.start == 1 else f"frames {run.start}"
    frames += "" if run.stop - run.start == 1 else f" to {run.stop - 1}"
    more = len(run.joints) - shown
    others = f"; and {some(more, 'more joint')}" if more else ""
    return f"{frames}, by up to {np.degrees(run.change):.3g}°{others}"


def _changed_most(repaired: Repaired, run: RepairedRun) -> list[int]:
    """The joints of a run that were turned furthest in it, in the skeleton's order."""
    joints = np.array([repaired.motion.skeleton.index(name) for name in run.joints])
    here = slice(run.start, run.stop)
    clips = (np.asarray(x.rotations)[here][:, joints] for x in (repaired.before, repaired.motion))
    change = np.nan_to_num(angles_between(*clips), nan=np.inf).max(axis=0)
    return sorted(joints[np.argsort(-change, kind="stable")[:_MOST]].tolist())


def _angles(repaired: Repaired, joints: list[int]) -> list[Float[np.ndarray, "time joint"]]:
    """How far the joints are from their mean in the repaired clip, before and after, degrees."""
    clips = [np.asarray(x.rotations)[:, joints] for x in (repaired.before, repaired.motion)]
    middle = mean_rotation(clips[1])
    return [np.degrees(angles_between(np.broadcast_to(middle, q.shape), q)) for q in clips]
