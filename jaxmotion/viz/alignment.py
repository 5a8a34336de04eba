"""How two clips were aligned: their pairs of frames, and the times that were read."""

from typing import TYPE_CHECKING

import numpy as np

from jaxmotion._plain import printable
from jaxmotion.timing import Alignment
from jaxmotion.viz.colours import BLUE, GREY
from jaxmotion.viz.given import known_only

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_alignment(
    alignment: Alignment, *, source: str = "source", reference: str = "reference"
) -> "Figure":
    """Draw the path of an alignment and the source time read for each frame of the reference.

    **Arguments:** ``alignment``: of one pair of clips, not traced; times are in frames; ``source``,
    ``reference``: what to call the clips.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("path.png")``), outside pyplot;
    notebooks show it.
    **Raises:** ``ValueError`` for one that is traced; ``ImportError`` without Matplotlib.
    """
    from jaxmotion.viz.picture import Picture

    known_only("plot_alignment", alignment=alignment)
    path = np.asarray(alignment.path)[: int(alignment.length)]
    times = np.asarray(alignment.source_frame)
    figure = Picture(figsize=(6.0, 5.0), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(path[:, 1], path[:, 0], ".", color=GREY, markersize=3, label="pairs of frames")
    axes.plot(np.arange(len(times)), times, color=BLUE, label="time that is read")
    axes.set_xlabel(f"frame of {printable(reference)}", parse_math=False)
    axes.set_ylabel(f"frame of {printable(source)}", parse_math=False)
    angle = np.degrees(float(alignment.distance))
    axes.set_title(f"joints differ by {angle:.3g}° (rms)", fontsize="medium")
    axes.legend(loc="upper left", frameon=False)
    return figure
