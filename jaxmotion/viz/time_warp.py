"""Another timing: which time of the clip is shown when, and how fast the body then moves."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jaxmotion._types import ArrayLike, ScalarLike
from jaxmotion.cleaning.turns import angles_between
from jaxmotion.layers import time_warp
from jaxmotion.layers.time_warp import warped_frames
from jaxmotion.motion import Motion
from jaxmotion.viz.colours import BLACK, BLUE, GREY
from jaxmotion.viz.given import known_clip, known_only

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_time_warp(
    motion: Motion,
    *,
    amount: ScalarLike | None = None,
    pairs: ArrayLike | None = None,
    ease: Sequence[ScalarLike] = (0.0, 0.0),
    num_frames: int | None = None,
) -> "Figure":
    """Draw what :func:`jaxmotion.time_warp` does to a clip's timing.

    Above, the time of the clip that is shown at each time of the result; below, how fast joints
    turn in both, the mean over joints. Source: Eom et al. 2019, Fig. 9.

    **Arguments:** ``motion``: one clip; ``amount``, ``pairs``, ``ease``, ``num_frames``: as
    :func:`jaxmotion.time_warp`.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("warp.png")``), outside pyplot, of
    two rows; notebooks show it.
    **Raises:** ``ValueError`` for what is not one known clip, traced arguments, as
    :func:`jaxmotion.time_warp`; ``ImportError`` without Matplotlib.

    **Example:**

        >>> import jaxmotion as jm
        >>> figure = jm.viz.plot_time_warp(jm.samples.load("kick").motion[:24], amount=0.5)
        >>> [axes.get_ylabel() for axes in figure.axes]
        ['seconds of the clip', 'mean turn, degrees a second']
    """
    from jaxmotion.viz.picture import Picture

    known_clip("plot_time_warp", motion)
    known_only("plot_time_warp", amount=amount, pairs=pairs, ease=ease)
    options = {"amount": amount, "pairs": pairs, "ease": ease, "num_frames": num_frames}
    read = np.asarray(warped_frames(motion, **options), np.float64)
    result = time_warp(motion, **options)
    second = float(motion.frame_time)
    figure = Picture(figsize=(7.0, 6.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    times = second * np.arange(len(read))
    end = second * (motion.num_frames - 1)
    above.plot((0, end), (0, end), color=GREY, ls="--", lw=1.5, label="as it was")
    above.plot(times, second * read, color=BLUE, lw=2, label="warped")
    if pairs is not None:
        # Where they are shown: easing and num_frames move them.
        source = np.asarray(pairs, np.float64)[:, 0]
        shown = np.interp(source, second * read, times)
        above.plot(shown, source, "o", color=BLACK, ms=5, label="pairs")
    looks = {"color": GREY, "lw": 1.5, "ls": "--"}, {"color": BLUE, "lw": 2}
    for clip, look in zip((motion, result), looks, strict=True):
        speed = _mean_turn(clip)
        below.plot(second * (np.arange(len(speed)) + 0.5), speed, **look)
    above.set_ylabel("seconds of the clip")
    below.set_ylabel("mean turn, degrees a second")
    below.set_xlabel("seconds of the result")
    below.set_ylim(bottom=0)
    above.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, frameon=False)
    for axes in (above, below):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _mean_turn(motion: Motion) -> np.ndarray:
    """Degrees a second from frame to frame, the mean over joints: f[T − 1]."""
    q = np.asarray(motion.rotations)
    if len(q) < 2:
        return np.zeros(0)
    return np.degrees(angles_between(q[:-1], q[1:]).mean(axis=1)) / float(motion.frame_time)
