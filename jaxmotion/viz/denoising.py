"""How far smoothing is from the truth, by where it cuts off."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxmotion._plain import printable
from jaxmotion._types import ArrayLike
from jaxmotion.kinematics import forward_kinematics
from jaxmotion.motion import Motion
from jaxmotion.smoothing import smooth_motion
from jaxmotion.viz.colours import BLACK, BLUE, GREY, SERIES
from jaxmotion.viz.given import known_clip, known_only, unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LOOKS = 16
_STYLES = ("--", ":", "-.")


def plot_denoising_error(
    truth: Motion,
    noisy: Motion,
    *,
    cutoffs: ArrayLike | None = None,
    filters: Mapping[str, Callable[[Motion, float], Motion]] | None = None,
    denoised: Mapping[str, Motion] | None = None,
) -> "Figure":
    """Draw the error of smoothing by its cut-off, beside other filters and other results.

    An error is the mean distance of joints from where the truth has them, over all joints and
    frames, in the file's unit. The smoother is that of Eq. 11 with one λσ for all, 1/(2 sin²(πf/r))
    for the cut-off f (half amplitude) and the frame rate r. Source: Eom et al. 2019, Fig. 5.

    **Arguments:** ``truth``: one clip; ``noisy``: the same with noise; ``cutoffs``: Hz, above 0
    and below half the frame rate, by default 16 from a hundredth of the rate on; ``filters``: by
    name, functions of the noisy clip and a cut-off in Hz that give a motion, such as a Butterworth
    filter; ``denoised``: by name, results without a cut-off, such as ``jaxmotion.denoise(noisy)``.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("error.png")``), outside pyplot;
    notebooks show it.
    **Raises:** ``ValueError`` for what is not one known clip, clips of different shapes, cut-offs
    out of range; ``ImportError`` without Matplotlib.

    **Example:**

        >>> import jax, jaxmotion as jm
        >>> clean = jm.samples.load("walk").motion[:16]
        >>> noisy = jm.samples.add_noise(clean, jax.random.key(0), rotation=0.05).motion
        >>> figure = jm.viz.plot_denoising_error(clean, noisy, cutoffs=[4.0, 8.0])
        >>> figure.axes[0].get_ylabel()
        'mean joint error, metres'
    """
    from jaxmotion.viz.picture import Picture

    known_clip("plot_denoising_error", truth, "truth")
    known_only("plot_denoising_error", cutoffs=cutoffs)
    _check_alike(truth, noisy, "noisy")
    rate = float(truth.fps)
    at = _checked_cutoffs(cutoffs, rate)
    where = np.asarray(forward_kinematics(truth).positions, np.float64)

    def error(motion: Any, name: str) -> float:
        _check_alike(truth, motion, name)
        found = np.asarray(forward_kinematics(motion).positions, np.float64)
        return float(np.linalg.norm(found - where, axis=-1).mean())

    figure = Picture(figsize=(7.0, 4.8), layout="constrained")
    axes = figure.add_subplot()
    products = np.asarray(1 / (2 * np.sin(np.pi * at / rate) ** 2), truth.dtype)
    smooth = [error(smooth_motion(noisy, x, 1.0), "smooth_motion") for x in products]
    axes.plot(at, smooth, "o-", color=BLUE, ms=4, label="LGS, one λσ")
    for (name, filtered), colour in zip((filters or {}).items(), _cycle(1), strict=False):
        curve = [error(filtered(noisy, float(f)), f"filters[{name!r}]") for f in at]
        axes.plot(at, curve, "s--", color=colour, ms=4, label=printable(name))
    axes.axhline(error(noisy, "noisy"), color=GREY, lw=1.5, label="noisy")
    for k, (name, motion) in enumerate((denoised or {}).items()):
        height = error(motion, f"denoised[{name!r}]")
        style = _STYLES[k % len(_STYLES)]
        axes.axhline(height, color=BLACK, lw=1.5, ls=style, label=printable(name))
    axes.set_xscale("log")
    axes.set_yscale("log")
    _plain_numbers(axes)
    axes.set_xlabel("cut-off, Hz")
    axes.set_ylabel(f"mean joint error, {unit_of(truth.skeleton)}")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(*_plain_labels(axes), loc="outside upper center", ncols=2, frameon=False)
    return figure


def _plain_labels(axes) -> tuple[list, list[str]]:
    """Handles and labels; a dollar sign is one."""
    handles, labels = axes.get_legend_handles_labels()
    return handles, [label.replace("$", r"\$") for label in labels]


def _plain_numbers(axes) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator

    for side in (axes.xaxis, axes.yaxis):
        side.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 5, 7)))
        side.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        side.set_minor_formatter(FuncFormatter(lambda value, _: ""))


def _cycle(start: int):
    while True:
        yield SERIES[start % len(SERIES)]
        start += 1


def _check_alike(truth: Motion, motion: Any, name: str) -> None:
    known_clip("plot_denoising_error", motion, name)
    if motion.rotations.shape != truth.rotations.shape:
        frames, joints = motion.rotations.shape[:2]
        raise ValueError(
            f"plot_denoising_error: {name} has {frames} frames of {joints} joints, the truth "
            f"{truth.num_frames} of {truth.num_joints}"
        )


def _checked_cutoffs(cutoffs: ArrayLike | None, rate: float) -> np.ndarray:
    if cutoffs is None:
        return np.geomspace(0.01 * rate, 0.48 * rate, _LOOKS)
    at = np.asarray(cutoffs, np.float64)
    if at.ndim != 1 or not at.size or not np.all((at > 0) & (at < rate / 2)):
        raise ValueError(
            f"plot_denoising_error: cutoffs={cutoffs}; expected Hz above 0 and below {rate / 2:g}, "
            "half the frame rate"
        )
    return at
