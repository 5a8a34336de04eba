"""A joint at every level of detail, and what each level adds."""

from typing import TYPE_CHECKING, Literal

import numpy as np

from jaxmotion._plain import printable
from jaxmotion.multiresolution import Pyramid, level_of_detail
from jaxmotion.multiresolution.pyramid import check_pyramid
from jaxmotion.viz.colours import BLUE, GREY
from jaxmotion.viz.given import axis_number, joint_number, known_only
from jaxmotion.viz.turns import from_middle, middle_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_pyramid(
    pyramid: Pyramid, joint: int | str, *, axis: Literal["x", "y", "z"] | None = None
) -> "Figure":
    """Draw a joint's rotation at every level of detail, and the details that each level adds.

    Degrees from the joint's mean pose, a component of the rotation vector in the joint's own axes;
    details are whole angles of the displacement in the body sense, the same component. Levels go
    from the base to the clip itself. Source: Lee & Shin 2001, Fig. 5.

    **Arguments:** ``pyramid``: of :func:`jaxmotion.multiresolution.build_pyramid`, one clip, N
    levels, not traced; ``joint``: its number or name; ``axis``: "x", "y" or "z", by default the
    component that moves most.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("levels.png")``), outside pyplot,
    of N + 1 rows and two columns; notebooks show it.
    **Raises:** ``ValueError`` for what is no known pyramid of one clip, unknown joints and axes;
    ``ImportError`` without Matplotlib.

    **Example:**

        >>> import jaxmotion as jm
        >>> pyramid = jm.multiresolution.build_pyramid(jm.samples.load("walk").motion[:33], 2)
        >>> len(jm.viz.plot_pyramid(pyramid, "LeftLeg").axes)
        6
    """
    from jaxmotion.viz.picture import Picture

    check_pyramid(pyramid, "plot_pyramid")
    known_only("plot_pyramid", pyramid=pyramid)
    number = joint_number("plot_pyramid", pyramid.base.skeleton, joint)
    levels = pyramid.levels
    frames = pyramid.frames[-1] if pyramid.length is None else int(pyramid.length)
    clips = [level_of_detail(pyramid, level) for level in range(levels + 1)]
    rotations = [np.asarray(clip.rotations)[:frames, number] for clip in clips]
    middle = middle_of(rotations[-1])
    curves = [from_middle(q, middle) for q in rotations]
    along = axis_number("plot_pyramid", axis, np.ptp(curves[-1], axis=0))
    times, unit = _times(pyramid, frames, float(clips[-1].frame_time))
    figure = Picture(figsize=(9.0, 1.0 + 1.25 * (levels + 1)), layout="constrained")
    grid = figure.subplots(levels + 1, 2, sharex=True, squeeze=False)
    for level, (left, right) in enumerate(grid):
        if level < levels:
            left.plot(times, curves[-1][:, along], color=GREY, lw=3, alpha=0.7)
        left.plot(times, curves[level][:, along], color=BLUE, lw=1.8)
        left.set_title(_title(level, levels), fontsize="small", loc="left", pad=3)
        for axes in (left, right):
            axes.margins(x=0)
            axes.spines[["top", "right"]].set_visible(False)
        if not level:
            right.set_axis_off()
            continue
        right.axhline(0, color=GREY, lw=0.8)
        size, detail = pyramid.frames[level], pyramid.details[level - 1]
        places, values = _detail(pyramid, level, np.asarray(detail.rotations)[:, number, along])
        inside = places * 2 ** (levels - level) < frames
        at = times[(places * 2 ** (levels - level))[inside]]
        right.plot(at, values[inside], ".-", color=BLUE, lw=1, ms=3)
        right.set_title(f"detail {level} of {levels}: {size} frames", fontsize="small", loc="left")
    for axes in grid[1:, 0]:
        axes.sharey(grid[0, 0])
    for axes in grid[-1]:
        axes.set_xlabel(unit)
    grid[0, 1].tick_params(labelbottom=False)
    name = printable(pyramid.base.skeleton.names[number]).replace("$", r"\$")
    figure.supylabel(f"{name} about {'xyz'[along]}, degrees", fontsize="medium")
    return figure


def _title(level: int, levels: int) -> str:
    if not level:
        return "base"
    return f"level {level}" if level < levels else f"level {level}: the clip"


def _times(pyramid: Pyramid, frames: int, second: float) -> tuple[np.ndarray, str]:
    """Of the finest frames, and their unit."""
    if pyramid.times is None:
        return second * np.arange(frames), "seconds"
    return np.asarray(pyramid.times)[:frames], "time, unit of the pyramid's"


def _detail(pyramid: Pyramid, level: int, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frames of the level that have stored details, counted from the clip's first, and these."""
    offset = sum(
        skip * 2 ** (n + 1 - level) for n, skip in enumerate(pyramid.skips) if n + 1 > level
    )
    frames = np.arange(pyramid.frames[level])
    frames = frames[1::2] if pyramid.lazy else frames
    places = frames[: len(half)] - offset
    kept = places >= 0
    return places[kept], 2 * np.degrees(half[: len(places)][kept])
