"""Smoothed rotation vectors against smoothed quaternions, near where rotation vectors wrap."""

from typing import TYPE_CHECKING, Literal

import jax.numpy as jnp
import numpy as np

from jaxmotion._plain import printable
from jaxmotion._types import ScalarLike
from jaxmotion.cleaning.turns import angles_between, vectors_between
from jaxmotion.motion import Motion
from jaxmotion.smoothing import smooth_quaternions
from jaxmotion.viz.colours import BLUE, GREY, ORANGE
from jaxmotion.viz.given import axis_number, joint_number, known_clip

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_wrap(
    motion: Motion,
    joint: int | str,
    *,
    lam: ScalarLike = 1.0,
    sigma: ScalarLike = 1.0,
    truth: Motion | None = None,
    axis: Literal["x", "y", "z"] | None = None,
) -> "Figure":
    """Draw what smoothing makes of a joint by its rotation vectors and by its quaternions.

    Above, a component of the rotation vector, which jumps where a turn passes 180°; below, the
    angle between the joint as it is and as it was smoothed. Source: Eom et al. 2019, Fig. 6.

    **Arguments:** ``motion``: one clip; ``joint``: its number or name; ``lam``, ``sigma``: of the
    smoother (:func:`jaxmotion.smoothing.smooth_quaternions`), whose product counts; ``truth``: the
    clip without noise, to measure from, by default ``motion``; ``axis``: "x", "y" or "z", by
    default the component that moves most.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("wrap.png")``), outside pyplot, of
    two rows; notebooks show it.
    **Raises:** ``ValueError`` for what is not one known clip, a truth of another shape, unknown
    joints and axes, as the smoother; ``ImportError`` without Matplotlib.

    **Example:**

        >>> import jax.numpy as jnp, jaxmotion as jm
        >>> walk = jm.samples.load("walk").motion[:16]
        >>> turn = jnp.linspace(2.8, 3.4, 16)[:, None] * jnp.array([0.0, 1.0, 0.0])
        >>> spun = walk.with_transforms(
        ...     rotations=walk.rotations.at[:, 0].set(jm.quaternion.exp(turn))
        ... )
        >>> figure = jm.viz.plot_wrap(spun, "Hips")
        >>> len(figure.axes)
        2
    """
    from jaxmotion.viz.picture import Picture

    known_clip("plot_wrap", motion)
    right = motion if truth is None else known_clip("plot_wrap", truth, "truth")
    if right.rotations.shape != motion.rotations.shape:
        raise ValueError(
            f"plot_wrap: truth has rotations of shape {right.rotations.shape}; expected those of "
            f"motion, {motion.rotations.shape}"
        )
    number = joint_number("plot_wrap", motion.skeleton, joint)
    given, wanted = (np.asarray(clip.rotations)[:, [number]] for clip in (motion, right))
    smooth = {
        "by rotation vectors": smooth_quaternions(jnp.asarray(given), lam, sigma, method="rotvec"),
        "by quaternions": smooth_quaternions(jnp.asarray(given), lam, sigma),
    }
    looks = {"by rotation vectors": (ORANGE, "--"), "by quaternions": (BLUE, "-")}
    vectors = _vectors(given)
    along = axis_number("plot_wrap", axis, np.ptp(vectors, axis=0))
    times = float(motion.frame_time) * np.arange(motion.num_frames)
    figure = Picture(figsize=(8.0, 4.8), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(times, vectors[:, along], ".", color=GREY, ms=7, label="as given")
    worst = []
    for name, q in smooth.items():
        colour, style = looks[name]
        curve = _broken(_vectors(np.asarray(q))[:, along])
        above.plot(times, curve, color=colour, ls=style, lw=1.8, label=name)
        error = np.degrees(angles_between(wanted, np.asarray(q)))[:, 0]
        below.plot(times, error, color=colour, ls=style, lw=1.8, label=name)
        worst.append(f"{error.max():.3g}° {name}")
    above.set_ylabel(f"rotation vector, {'xyz'[along]}, degrees")
    below.set_ylabel("off the truth, degrees" if truth else "off what is given, degrees")
    below.set_xlabel("seconds")
    below.set_ylim(bottom=0)
    below.set_title(f"at most {' and '.join(worst)}", fontsize="small", loc="left")
    above.set_title(printable(motion.skeleton.names[number]), loc="left", parse_math=False)
    above.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, frameon=False)
    for axes in (above, below):
        axes.margins(x=0)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _vectors(q: np.ndarray) -> np.ndarray:
    """Rotation vectors f[T, 3], degrees, as they come: of 180° at most."""
    identity = np.broadcast_to(np.eye(4, dtype=q.dtype)[0], q.shape)
    return np.degrees(vectors_between(identity, q)[:, 0])


def _broken(curve: np.ndarray) -> np.ndarray:
    """The curve with gaps where it wraps: no line is drawn there."""
    curve = curve.astype(np.float64)
    jumps = np.flatnonzero(np.abs(np.diff(curve)) > 180.0)
    curve[jumps + 1] = np.nan
    return curve
