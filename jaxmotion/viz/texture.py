"""The motion texture: how every joint turns over time, as a picture."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jaxmotion._plain import printable
from jaxmotion.cleaning.turns import mean_rotation, vectors_between
from jaxmotion.cleaning.words import texture
from jaxmotion.motion import Motion
from jaxmotion.viz.colours import SIGNS
from jaxmotion.viz.given import joint_numbers, known_clip

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_texture(motion: Motion, *, joints: Sequence[int | str] | None = None) -> "Figure":
    """Draw the motion texture: one row a joint, one column a frame, its colour how it is turned.

    Degrees from the joint's mean pose, about the axis that it turns about most, which points along
    the positive side of its largest component. Of the joint that the body hangs from the yaw is
    removed and the place dropped, as motion words have it. What repeats itself looks so. Source:
    Aristidou et al. 2018, §3.

    **Arguments:** ``motion``: one clip; ``joints``: numbers or names, by default all from the one
    that the body hangs from.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("texture.png")``), outside pyplot;
    notebooks show it.
    **Raises:** ``ValueError`` for what is not one known clip, unknown joints; ``ImportError``
    without Matplotlib.

    **Example:**

        >>> import jaxmotion as jm
        >>> figure = jm.viz.plot_texture(jm.samples.load("walk").motion[:32])
        >>> figure.axes[0].images[0].get_array().shape
        (22, 32)
    """
    from jaxmotion.viz.picture import Picture

    known_clip("plot_texture", motion)
    skeleton = motion.skeleton
    every = range(motion.body_joint, skeleton.num_joints)
    chosen = joint_numbers("plot_texture", skeleton, joints, every)
    turns = _about_main_axis(np.asarray(texture(motion, tuple(chosen))))
    second, frames = float(motion.frame_time), motion.num_frames
    figure = Picture(figsize=(9.0, 1.4 + 0.19 * max(len(chosen), 4)), layout="constrained")
    axes = figure.add_subplot()
    most = max(float(np.abs(turns).max()), 1e-3)
    image = axes.imshow(
        turns.T,
        vmin=-most,
        vmax=most,
        cmap=SIGNS,
        aspect="auto",
        interpolation="nearest",
        # A frame lasts from half a frame before its time to half a frame after.
        extent=(-0.5 * second, (frames - 0.5) * second, len(chosen) - 0.5, -0.5),
    )
    names = [printable(skeleton.names[j]) for j in chosen]
    axes.set_yticks(range(len(chosen)), names, fontsize="small", parse_math=False)
    axes.set_xlabel("seconds")
    figure.colorbar(image, ax=axes, label="degrees from mean pose", pad=0.015, aspect=30)
    return figure


def _about_main_axis(q: np.ndarray) -> np.ndarray:
    """f[T, J], degrees about the axis that each joint turns about most."""
    middle = np.broadcast_to(mean_rotation(q).astype(q.dtype), q.shape)
    vectors = np.degrees(vectors_between(middle, q)).astype(np.float64)
    spread = np.einsum("tji,tjk->jik", vectors, vectors)
    axes = np.linalg.eigh(spread)[1][..., -1]
    largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=1)[:, None], axis=1)
    return np.einsum("tji,ji->tj", vectors, np.where(largest < 0, -1, 1) * axes)
