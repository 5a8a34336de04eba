"""Contact phases against the heights of the points: whether what was found looks right."""

from typing import TYPE_CHECKING

import numpy as np

from jaxmotion._plain import printable
from jaxmotion.contacts import Contacts, intervals
from jaxmotion.contacts.contact import check_frames
from jaxmotion.motion import Motion
from jaxmotion.viz.colours import BLUE, ORANGE
from jaxmotion.viz.given import known_only, unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_contacts(motion: Motion, contacts: Contacts) -> "Figure":
    """Draw the height of every contact point over time, its contacts shaded.

    Heights are in the file's unit, times in seconds; the points share their axes.

    **Arguments:** ``motion``: one clip, T frames; ``contacts``: of T frames.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("contacts.png")``), outside
    pyplot, with one row a point (one empty row if there are none); notebooks show it.
    **Raises:** ``ValueError`` for contacts of another number of frames and what is traced;
    ``ImportError`` without Matplotlib.
    """
    from jaxmotion.viz.picture import Picture

    check_frames(motion, contacts, "plot_contacts", on_host=True)
    known_only("plot_contacts", motion=motion, contacts=contacts)
    seconds = float(motion.frame_time)
    up = motion.skeleton.up_axis
    heights = np.asarray(contacts.points.positions(motion))[..., up]
    found = intervals(contacts)
    rows = max(1, contacts.num_points)
    figure = Picture(figsize=(8.0, 1.0 + 1.3 * rows), layout="constrained")
    grid = figure.subplots(rows, 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axes, name, height in zip(grid, contacts.names, heights.T, strict=False):
        axes.plot(seconds * np.arange(len(height)), height, color=BLUE)
        axes.set_title(printable(name), fontsize="small", loc="left", parse_math=False)
        for touch in (interval for interval in found if interval.point == name):
            # A frame lasts from half a frame before its time to half a frame after.
            begin, end = seconds * (touch.first - 0.5), seconds * (touch.last + 0.5)
            axes.axvspan(begin, end, color=ORANGE, alpha=0.3)
    grid[-1].set_xlabel("seconds")
    figure.supylabel(f"height, {unit_of(motion.skeleton)}")
    return figure
