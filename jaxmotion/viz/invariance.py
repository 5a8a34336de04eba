"""Whether a pyramid depends on the coordinates: that of motions, and one of Euler angles."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmotion import quaternion
from jaxmotion._types import ArrayLike
from jaxmotion.cleaning.turns import angles_between
from jaxmotion.motion import Motion
from jaxmotion.multiresolution import Pyramid, build_pyramid
from jaxmotion.skeleton import Skeleton
from jaxmotion.viz.colours import BLUE, SERIES
from jaxmotion.viz.given import known_clip, known_only

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STEP, _STEPS = 15.0, 9  # degrees: nine of π/12
_MARKS = "s^vDP*"


def plot_invariance(
    motion: Motion,
    levels: int | None = None,
    *,
    angles: ArrayLike | None = None,
    orders: Sequence[str] = ("XYZ", "ZXY", "YXZ"),
) -> "Figure":
    """Draw how wrong a motion comes out whose base alone was turned about the vertical.

    A pyramid's base is turned and put together with the details as they were, which should give the
    motion turned as a whole; an error is the largest angle between the two of the root, over
    frames. Beside it the same with pyramids of the root's unwrapped Euler angles, whose errors are
    large unless the vertical comes first in the order. Errors below rounding are drawn at it.
    Source: Lee & Shin 2001, Figs. 10 and 11, Eq. 22.

    **Arguments:** ``motion``: one clip; ``levels``: of the pyramids, as
    :func:`jaxmotion.multiresolution.build_pyramid`; ``angles``: degrees to turn by, by default nine
    steps of 15; ``orders``: of the Euler angles, as :func:`jaxmotion.quaternion.to_euler`.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("turned.png")``), outside pyplot;
    notebooks show it.
    **Raises:** ``ValueError`` for what is not one known clip, no angles, unknown orders, levels as
    ``build_pyramid``; ``ImportError`` without Matplotlib.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk").motion[:33]
        >>> figure = jm.viz.plot_invariance(walk, angles=[0.0, 90.0], orders=["XYZ"])
        >>> [line.get_label() for line in figure.axes[0].lines]
        ['this library', 'Euler angles, XYZ']
    """
    from jaxmotion.viz.picture import Picture

    known_clip("plot_invariance", motion)
    known_only("plot_invariance", angles=angles)
    by = np.arange(1, _STEPS + 1) * _STEP if angles is None else np.asarray(angles, np.float64)
    if by.ndim != 1 or not by.size or not np.isfinite(by).all():
        raise ValueError(f"plot_invariance: angles={angles}; expected some degrees")
    root = jnp.asarray(motion.rotations)[:, :1]
    up = np.eye(3)[motion.skeleton.up_axis]
    half = np.radians(by)[:, None] / 2
    turns = jnp.asarray(np.concatenate([np.cos(half), np.sin(half) * up], axis=1), root.dtype)
    wanted = [np.asarray(quaternion.multiply(turn, root)) for turn in turns]
    rounding = float(np.degrees(np.finfo(root.dtype).eps))

    def errors(results) -> np.ndarray:
        apart = [angles_between(a, b).max() for a, b in zip(wanted, results, strict=True)]
        return np.maximum(np.degrees(apart), rounding)

    figure = Picture(figsize=(6.5, 4.6), layout="constrained")
    axes = figure.add_subplot()
    own = build_pyramid(motion, levels)
    ours = errors(_turned_base(own, turn) for turn in turns)
    axes.plot(by, ours, "o-", color=BLUE, ms=5, label="this library")
    for k, order in enumerate(orders):
        pyramid = _of_euler(motion, order, levels)
        theirs = errors(_turned_euler(pyramid, turn, order) for turn in turns)
        look = {"color": SERIES[1 + k % 5], "marker": _MARKS[k % len(_MARKS)], "ms": 5}
        axes.plot(by, theirs, ls="--", label=f"Euler angles, {order}", **look)
    axes.set_yscale("log")
    axes.set_xlabel(f"turned about {motion.skeleton.up}, degrees")
    axes.set_ylabel("largest error of the root, degrees")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    return figure


def _turned_base(pyramid: Pyramid, turn: Array) -> np.ndarray:
    """Root rotations f[T, 1, 4] of what has the base turned."""
    base = pyramid.base
    rotations = jnp.asarray(base.rotations)
    turned = rotations.at[:, 0].set(quaternion.multiply(turn, rotations[:, 0]))
    whole = _together(pyramid, base.with_transforms(rotations=turned))
    return np.asarray(whole.rotations)[:, :1]


def _of_euler(motion: Motion, order: str, levels: int | None) -> Pyramid:
    """Of the root's Euler angles, as the positions of one joint that does not turn: the filters of
    positions are those of vectors."""
    q = jnp.asarray(motion.rotations)[:, :1]
    angles = quaternion.to_euler(q[:, 0], order, unwrap=True)
    skeleton = Skeleton(["angles"], [-1], np.zeros((1, 3), q.dtype))
    still = jnp.zeros_like(q).at[..., 0].set(1)
    return build_pyramid(Motion.from_root(skeleton, angles, still, motion.frame_time), levels)


def _turned_euler(pyramid: Pyramid, turn: Array, order: str) -> np.ndarray:
    base = pyramid.base
    q = quaternion.multiply(turn, quaternion.from_euler(base.translations[:, 0], order))
    angles = quaternion.to_euler(q, order, unwrap=True)
    whole = _together(pyramid, base.with_transforms(translations=angles[:, None]))
    return np.asarray(quaternion.from_euler(whole.translations, order))


def _together(pyramid: Pyramid, base: Motion) -> Motion:
    return replace(pyramid, base=base).reconstruct()
