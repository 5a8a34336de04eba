"""What is read between sparse keys: which way round a joint turns."""

from typing import TYPE_CHECKING, Literal

import numpy as np

from jaxmotion._checks import traced
from jaxmotion._plain import printable
from jaxmotion._types import ArrayLike
from jaxmotion.motion import Motion
from jaxmotion.timing import resample
from jaxmotion.timing.resample import Signs
from jaxmotion.viz.colours import BLACK, BLUE, GREEN, GREY, ORANGE
from jaxmotion.viz.given import axis_number, joint_number, known_clip
from jaxmotion.viz.turns import turned_since_first

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LOOKS = {
    "truth": {"color": GREY, "lw": 5.0, "zorder": 1},
    "smooth, least energy": {"color": BLUE, "lw": 2.0},
    "smooth, nearest signs": {"color": ORANGE, "lw": 1.8, "ls": "--"},
    "SLERP": {"color": GREEN, "lw": 1.5, "ls": ":"},
}


def plot_key_interpolation(
    keys: Motion,
    index: ArrayLike,
    joint: int | str,
    *,
    num_frames: int | None = None,
    axis: Literal["x", "y", "z"] | None = None,
    truth: Motion | None = None,
) -> "Figure":
    """Draw how a joint turns between keys: smoothly by the signs of least energy, smoothly by
    nearest signs, and by SLERP.

    What is drawn are the steps from frame to frame about one of the joint's own axes, added up, so
    that turns of more than 180° are seen as such. Source: Eom et al. 2019, Fig. 8.

    **Arguments:** ``keys``: one clip of a pose a key; ``index``: f[T], the frame of each, strictly
    increasing, the first 0; ``joint``: its number or name; ``num_frames``: of the result, by
    default up to the last key; ``axis``: "x", "y" or "z", by default that about which most is
    turned; ``truth``: the motion that the keys are of, from frame 0 on, if it is known.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("keys.png")``), outside pyplot;
    notebooks show it.
    **Raises:** ``ValueError`` for what is not one known clip, unknown joints and axes, an index
    that does not begin at 0, as :func:`jaxmotion.resample`; ``ImportError`` without Matplotlib.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk").motion[:41]
        >>> figure = jm.viz.plot_key_interpolation(
        ...     walk[::10], [0, 10, 20, 30, 40], "LeftLeg", truth=walk
        ... )
        >>> figure.axes[0].get_ylabel()
        'turned about x, degrees'
    """
    from jaxmotion.viz.picture import Picture

    known_clip("plot_key_interpolation", keys)
    if traced(index) or np.shape(index) != (keys.num_frames,) or np.asarray(index)[0] != 0:
        raise ValueError(
            f"plot_key_interpolation: index={index}; expected {keys.num_frames} known frames, one "
            "a key, the first 0"
        )
    number = joint_number("plot_key_interpolation", keys.skeleton, joint)

    def read(method: Literal["lgs", "slerp"] = "lgs", signs: Signs = "nearest") -> np.ndarray:
        found = resample(keys, index=index, num_frames=num_frames, method=method, signs=signs)
        return _turned(found, number)

    turns = {
        "smooth, least energy": read(signs="min_energy"),
        "smooth, nearest signs": read(),
        "SLERP": read("slerp"),
    }
    if truth is not None:
        known_clip("plot_key_interpolation", truth, "truth")
        there = joint_number("plot_key_interpolation", truth.skeleton, joint)
        turns["truth"] = _turned(truth, there)
    first = turns["smooth, least energy"]
    along = axis_number("plot_key_interpolation", axis, np.ptp(first, axis=0))
    second = _seconds_a_frame(keys, truth)
    figure = Picture(figsize=(8.0, 4.0), layout="constrained")
    axes = figure.add_subplot()
    for name, look in _LOOKS.items():
        if name in turns:
            curve = turns[name][:, along]
            axes.plot(second * np.arange(len(curve)), curve, label=name, **look)
    at = np.asarray(index, np.float64)
    heights = np.interp(at, np.arange(len(first)), first[:, along])
    axes.plot(second * at, heights, "o", color=BLACK, ms=5, zorder=4, label="keys")
    axes.set_xlabel("seconds")
    axes.set_ylabel(f"turned about {'xyz'[along]}, degrees")
    axes.set_title(printable(keys.skeleton.names[number]), loc="left", parse_math=False)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=5, frameon=False)
    return figure


def _turned(motion: Motion, joint: int) -> np.ndarray:
    return turned_since_first(np.asarray(motion.rotations)[:, joint])


def _seconds_a_frame(keys: Motion, truth: Motion | None) -> float:
    """Of the result, as :func:`jaxmotion.resample` has it, unless the truth tells."""
    return float(keys.frame_time if truth is None else truth.frame_time)
