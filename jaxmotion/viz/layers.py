"""The layers of one channel: what was captured, its base, what is left of it without noise."""

from typing import TYPE_CHECKING, Literal

import numpy as np

from jaxmotion._checks import instance_of, one_of
from jaxmotion._plain import printable
from jaxmotion._types import ArrayLike
from jaxmotion.cleaning.turns import turned
from jaxmotion.layers import MotionLayers
from jaxmotion.smoothing import lgs
from jaxmotion.viz.colours import BLUE, GREY, ORANGE
from jaxmotion.viz.given import axis_number, joint_number, known_only, unit_of
from jaxmotion.viz.turns import from_middle, middle_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BAND = 2.0  # standard deviations


def plot_layers(
    layers: MotionLayers,
    joint: int | str,
    *,
    channel: Literal["rotation", "translation"] = "rotation",
    axis: Literal["x", "y", "z"] | None = None,
    weights: ArrayLike | None = None,
    order: Literal[1, 2] = 2,
) -> "Figure":
    """Draw the layers of one channel: capture, base and what is denoised; control; residual.

    Rotations are degrees from the joint's mean pose, components of the rotation vector in the
    joint's own axes; translations have the file's unit. Layers that know the noise, by ``tune=`` of
    ``decompose``, have a band of two posterior standard deviations about what is denoised
    (:class:`~jaxmotion.smoothing.Posterior`; angles are twice the components' half angles); others
    have none, as their σ is chosen and not learned. Source: Eom et al. 2019, Figs. 1 and 2.

    **Arguments:** ``layers``: of :func:`jaxmotion.decompose`, one clip, not traced; ``joint``: its
    number or name; ``channel``: "rotation" or "translation"; ``axis``: "x", "y" or "z", by default
    the component whose control is largest; ``weights``, ``order``: as ``decompose`` was given them,
    f[T] or f[T, J], for the band.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("layers.png")``), outside pyplot,
    of three rows; notebooks show it.
    **Raises:** ``ValueError`` for what are no layers of one known clip, unknown joints, channels
    and axes, weights of another shape; ``ImportError`` without Matplotlib.

    **Example:**

        >>> import jaxmotion as jm
        >>> layers = jm.decompose(jm.samples.load("walk").motion[:16])
        >>> figure = jm.viz.plot_layers(layers, "LeftLeg")
        >>> figure.get_supylabel(), figure.axes[-1].get_xlabel()
        ('about x, degrees', 'seconds')
    """
    from jaxmotion.viz.picture import Picture

    _check(layers, channel)
    skeleton, second = layers.base.skeleton, float(layers.base.frame_time)
    number = joint_number("plot_layers", skeleton, joint)
    curves, deltas = _curves(layers, number, channel)
    along = axis_number("plot_layers", axis, np.ptp(deltas["control"], axis=0))
    deviation = _deviation(layers, number, channel, weights, order)
    times = second * np.arange(layers.base.num_frames)
    figure = Picture(figsize=(8.0, 5.6), layout="constrained")
    whole, *parts = figure.subplots(3, 1, sharex=True, height_ratios=(2, 1, 1))
    looks = {
        "captured": {"color": GREY, "lw": 1.2},
        "base": {"color": ORANGE, "lw": 1.8, "ls": "--"},
        "denoised": {"color": BLUE, "lw": 1.8},
    }
    for name, curve in curves.items():
        whole.plot(times, curve[:, along], label=name, **looks[name])
    if deviation is not None:
        middle, reach = curves["denoised"][:, along], _BAND * deviation
        ends = middle - reach, middle + reach
        label = f"± {_BAND:g} std of the posterior"
        whole.fill_between(times, *ends, color=BLUE, alpha=0.25, lw=0, label=label)
    for axes, (name, delta) in zip(parts, deltas.items(), strict=True):
        axes.axhline(0, color=GREY, lw=0.8)
        axes.plot(times, delta[:, along], color=BLUE, lw=1.4)
        axes.set_title(name, fontsize="small", loc="left", pad=3)
    for axes in (whole, *parts):
        axes.margins(x=0)
        axes.spines[["top", "right"]].set_visible(False)
    whole.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=4, frameon=False)
    name = printable(skeleton.names[number])
    whole.set_title(name, fontsize="medium", loc="left", parse_math=False)
    unit = "degrees" if channel == "rotation" else unit_of(skeleton)
    way = "about" if channel == "rotation" else "along"
    figure.supylabel(f"{way} {'xyz'[along]}, {unit}", fontsize="medium")
    parts[-1].set_xlabel("seconds")
    return figure


def _check(layers: MotionLayers, channel: str) -> None:
    expected = "MotionLayers (jaxmotion.decompose makes them)"
    instance_of("plot_layers: layers", layers, MotionLayers, expected)
    known_only("plot_layers", layers=layers)
    one_of("plot_layers: channel", channel, ("rotation", "translation"))
    if axes := np.shape(layers.base.rotations)[:-3]:
        raise ValueError(f"plot_layers: one clip at a time, got batch axes {axes}")


def _curves(
    layers: MotionLayers, joint: int, channel: str
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """f[T, 3] each of the motions, and of the displacements between them."""
    parts = {"control": layers.control, "residual": layers.residual}
    if channel == "translation":
        base = np.asarray(layers.base.translations)[:, joint]
        deltas = {name: np.asarray(part.translations)[:, joint] for name, part in parts.items()}
        denoised = base + deltas["control"]
        whole = {"captured": denoised + deltas["residual"], "base": base, "denoised": denoised}
        return whole, deltas
    vectors = {name: np.asarray(part.rotations)[:, joint] for name, part in parts.items()}
    base = np.asarray(layers.base.rotations)[:, joint]
    denoised = turned(base, vectors["control"])
    motions = {"captured": turned(denoised, vectors["residual"]), "base": base}
    motions["denoised"] = denoised
    middle = middle_of(denoised)
    whole = {name: from_middle(q, middle) for name, q in motions.items()}
    return whole, {name: np.degrees(vector) for name, vector in vectors.items()}


def _deviation(
    layers: MotionLayers, joint: int, channel: str, weights: ArrayLike | None, order: Literal[1, 2]
) -> np.ndarray | None:
    """Of the denoised channel, degrees or the file's unit; None where the noise is not known."""
    frames, joints = layers.base.rotations.shape[:2]
    if weights is not None and np.shape(weights) not in ((frames,), (frames, joints)):
        raise ValueError(
            f"plot_layers: weights have shape {np.shape(weights)}; expected ({frames},) or "
            f"({frames}, {joints})"
        )
    if layers.tuning is None:
        return None
    moves = joint in layers.base.translated_joints
    if channel == "translation" and not moves:
        return None
    turning = channel == "rotation"
    learned = layers.tuning.rotations if turning else layers.tuning.translations
    lam, sigma = (np.broadcast_to(x, (joints,))[joint] for x in (learned.lam, learned.sigma))

    def of_joint(x):
        return None if x is None else np.asarray(x) if np.ndim(x) == 1 else np.asarray(x)[:, joint]

    nothing = np.zeros((frames,), np.asarray(layers.base.rotations).dtype)
    posterior = lgs(
        nothing,
        lam,
        sigma,
        order=order,
        weights=of_joint(weights),
        stiffness=of_joint(learned.stiffness),
    )
    deviation = np.sqrt(np.asarray(posterior.variance))
    return np.degrees(2 * deviation) if turning else deviation
