"""How a body stands in the world: which way the joint goes that it hangs from, how it leans.

With n up and U a constant turn, the body's rotation is q = yaw ⊗ swing ⊗ U: yaw turns about n, the
swing about a horizontal axis (``quaternion.arcs``). U takes to n the axis of the body that points
up most of the time (:func:`upright`), so that a body whose own axes lie otherwise, or that crawls,
stays far from the half turn where yaw has no meaning.

The body hangs from one joint, :attr:`jaxmotion.Motion.body_joint`. O(T).
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxmotion import quaternion
from jaxmotion._types import Vector3
from jaxmotion.frames.count import frame_mask
from jaxmotion.motion import Motion
from jaxmotion.quaternion.arcs import shortest_arc, twist


def pose_in_world(
    motion: Motion, joint: int
) -> tuple[Float[Array, "time 3"], Float[Array, "time 4"]]:
    """World position and rotation of a joint near the root."""
    translations, rotations = jnp.asarray(motion.translations), jnp.asarray(motion.rotations)
    position, turned = translations[:, joint], rotations[:, joint]
    while joint:
        joint = motion.skeleton.parents[joint]
        above = rotations[:, joint]
        position = translations[:, joint] + quaternion.rotate(above, position)
        turned = quaternion.multiply(above, turned)
    return position, turned


def hung(motion: Motion, body: int, position: Array, turned: Array) -> Motion:
    """The motion with a joint near the root at f[T, 3] and turned by f[T, 4] in the world; those
    above it stay."""
    if body:
        place, above = pose_in_world(motion, motion.skeleton.parents[body])
        back = quaternion.conjugate(above)
        position = quaternion.rotate(back, position - place)
        turned = quaternion.multiply(back, turned)
    other = jnp.sum(turned[:1] * motion.rotations[:1, body], axis=-1, keepdims=True) < 0
    return motion.with_transforms(
        jnp.asarray(motion.translations).at[:, body].set(position),
        jnp.asarray(motion.rotations).at[:, body].set(jnp.where(other, -turned, turned)),
    )


class Axes(NamedTuple):
    """Unit vectors f[3] along the ground and up, right-handed."""

    ahead: np.ndarray
    aside: np.ndarray
    up: np.ndarray


def axes_of(motion: Motion) -> Axes:
    """The world's."""
    up = motion.skeleton.up_axis
    ahead, aside = np.eye(3)[[(up + 1) % 3, (up + 2) % 3]]
    return Axes(ahead, aside, np.eye(3)[up])


@eqx.filter_jit
def upright(motion: Motion, count: Int[Array, ""] | None = None) -> Vector3:
    """Which of the body's own axes, or their opposites, points up most of the time: f[3]."""
    up = jnp.asarray(axes_of(motion).up, motion.dtype)
    _, turned = pose_in_world(motion, motion.body_joint)
    own = quaternion.rotate(quaternion.conjugate(turned), up)
    own = jnp.mean(own, axis=0, where=counting(count, len(own))[:, None])
    most = jnp.argmax(jnp.abs(own))
    return jnp.sign(own[most]) * jnp.eye(3, dtype=own.dtype)[most]


def counting(count: Int[Array, ""] | None, frames: int) -> Bool[Array, " time"]:
    """Which of the frames count."""
    return frame_mask(jnp.asarray(frames if count is None else count, jnp.int32), frames)


def posture(
    motion: Motion, upright: Vector3
) -> tuple[Float[Array, "time 3"], Float[Array, "time 4"], Float[Array, "time 3"]]:
    """The body's position, yaw, and lean, the rotation vector of its swing."""
    up = jnp.asarray(axes_of(motion).up, motion.dtype)
    position, turned = pose_in_world(motion, motion.body_joint)
    turned = quaternion.multiply(turned, quaternion.conjugate(shortest_arc(upright, up)))
    yaw = twist(turned, up)
    return position, yaw, quaternion.log(quaternion.between(yaw, turned))
