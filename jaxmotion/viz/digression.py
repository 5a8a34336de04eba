"""Where a clip digresses from what its body does elsewhere, and which of it is in error."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool

from jaxmotion._plain import printable, some
from jaxmotion.cleaning import DetectedErrors, Digression
from jaxmotion.frames.runs import spans
from jaxmotion.motion import Motion
from jaxmotion.viz.colours import ORANGE, SIZES
from jaxmotion.viz.given import known_only

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MANY = 30  # joints
_EDGE = 1.2  # points: what lasts a frame is seen too


def plot_digression(
    found: DetectedErrors | Digression,
    *,
    motion: Motion | None = None,
    joints: Sequence[int | str] | None = None,
) -> "Figure":
    """Draw how far every joint digresses over time, and what is in error outlined.

    The colour is the MDM, from 0 to 1. Runs of errors have a bar above the map.

    **Arguments:** ``found``: of :func:`detect_errors` or :func:`digression_map`, not traced;
    ``motion``: the clip, T frames, for seconds and names of joints: errors know theirs, and without
    it frames and numbers are shown; ``joints``: numbers or names of those to show, by default all,
    of more than 30 those that digress or are in error.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("errors.png")``), outside pyplot;
    notebooks show it.
    **Raises:** ``ValueError`` for a motion of another shape, unknown joints, what is traced;
    ``ImportError`` without Matplotlib.
    """
    from matplotlib.collections import LineCollection

    from jaxmotion.viz.picture import Picture

    known_only("plot_digression", found=found, motion=motion)
    mdm = np.asarray(found.mdm)
    is_known = isinstance(found, DetectedErrors)
    mask = np.asarray(found.mask) if is_known else np.zeros(mdm.shape, bool)
    motion = found.motion if is_known and motion is None else motion
    if motion is not None and motion.rotations.shape[:2] != mdm.shape:
        frames, many = motion.rotations.shape[:2]
        raise ValueError(
            f"plot_digression: the motion has {frames} frames of {many} joints, the map "
            f"{mdm.shape[0]} of {mdm.shape[1]}"
        )
    shown = _shown(mdm, mask, motion, joints)
    second = 1.0 if motion is None else float(motion.frame_time)
    figure = Picture(figsize=(9.0, 1.6 + 0.19 * max(len(shown), 4)), layout="constrained")
    axes = figure.add_subplot()
    frames = len(mdm)
    # A frame lasts from half a frame before its time to half a frame after.
    ends = -0.5 * second, (frames - 0.5) * second
    image = axes.imshow(
        mdm[:, shown].T,
        vmin=0,
        vmax=1,
        cmap=SIZES,
        aspect="auto",
        interpolation="nearest",
        extent=(*ends, len(shown) - 0.5, -0.5),
    )
    edges = [
        [((t - 0.5) * second, row - 0.5), ((u - 0.5) * second, other - 0.5)]
        for (t, row), (u, other) in _outline(mask[:, shown])
    ]
    axes.add_collection(LineCollection(edges, colors=ORANGE, linewidths=_EDGE), autolim=False)
    above = axes.get_xaxis_transform()
    for start, stop in spans(np.any(mask, axis=1)):
        span = ((start - 0.5) * second, (stop - 0.5) * second)
        axes.plot(span, (1.012, 1.012), color=ORANGE, lw=3, transform=above, clip_on=False)
    axes.set_xlim(*ends)
    names = [str(j) if motion is None else printable(motion.skeleton.names[j]) for j in shown]
    axes.set_yticks(range(len(shown)), names, fontsize="small", parse_math=False)
    axes.set_xlabel("frame" if motion is None else "seconds")
    label = "digression, from none to certain" if is_known else "digression (MDM)"
    figure.colorbar(image, ax=axes, label=label, pad=0.015, aspect=30)
    if is_known:
        axes.set_title(_title(mask), fontsize="medium", loc="left", pad=10)
    return figure


def _title(mask: Bool[np.ndarray, "time joint"]) -> str:
    many = len(spans(np.any(mask, axis=1)))
    share = f"{100 * mask.mean():.2g} % of joint-frames"
    return f"{some(many, 'run')} of errors, {share}" if many else "no errors found"


def _shown(
    mdm: np.ndarray,
    mask: np.ndarray,
    motion: Motion | None,
    joints: Sequence[int | str] | None,
) -> list[int]:
    """The joints to show."""
    if joints is None:
        every = mdm.shape[1]
        telling = (mdm > 0).any(axis=0) | mask.any(axis=0)
        return np.flatnonzero(telling | (every <= _MANY)).tolist() or list(range(every))
    named = [j for j in joints if isinstance(j, str)]
    if named and motion is None:
        raise ValueError(f"plot_digression: joint {named[0]!r} is a name; give the motion too")
    found = [motion.skeleton.index(j) if isinstance(j, str) and motion else j for j in joints]
    if not found or not all(0 <= int(j) < mdm.shape[1] for j in found):
        raise ValueError(
            f"plot_digression: joints={joints}; expected some of {mdm.shape[1]} joints"
        )
    return [int(j) for j in found]


def _outline(mask: Bool[np.ndarray, "time row"]) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """The edges of what is set, from corner to corner; entry (t, row) has its first at (t, row)."""
    wide = np.pad(mask, 1)
    across = np.argwhere(wide[1:, 1:-1] != wide[:-1, 1:-1])
    along = np.argwhere(wide[1:-1, 1:] != wide[1:-1, :-1])
    return [((t, row), (t, row + 1)) for t, row in across.tolist()] + [
        ((t, row), (t + 1, row)) for t, row in along.tolist()
    ]
