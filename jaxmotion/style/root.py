"""The root as channels that do not know where the body is, nor which way it goes.

    ahead, aside   ground velocity, in the yaw frame of the frame before, length a second
    yaw rate       radians a second
    height         above the ground, length
    lean           rotation vector of the swing, its two horizontal parts, radians

Of the joint that the body hangs from, in the world (:mod:`jaxmotion._posture`); what stands above
it keeps still. The first frame has the velocities of the second. Decoding walks on from a place and
a yaw: O(T), exact.

The ground is where the lowest joint is in the lowest tenth of the frames.

``count``: how many frames count, the first ones, None for all.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmotion import quaternion
from jaxmotion._numerics import rounding_angle
from jaxmotion._posture import axes_of, counting, hung, posture
from jaxmotion._types import AnyArray, Quaternion, Vector3
from jaxmotion.kinematics import forward_kinematics
from jaxmotion.motion import Motion
from jaxmotion.quaternion.arcs import shortest_arc

CHANNELS = ("ahead", "aside", "yaw rate", "height", "lean ahead", "lean aside")
HEIGHT = CHANNELS.index("height")
_LOWEST = 0.1


class Start(NamedTuple):
    """Where a path begins: the body's position f[3], yaw f[4]; ``ground``: its height f[]."""

    position: Vector3
    yaw: Quaternion
    ground: Float[Array, ""]


def lean(motion: Motion, upright: Vector3) -> Float[Array, "time 2"]:
    """The last two of the channels."""
    return _horizontal(motion, posture(motion, upright)[2])


def _horizontal(motion: Motion, swing: Float[Array, "time 3"]) -> Float[Array, "time 2"]:
    """The parts of the swing's rotation vector; there is none about up."""
    ahead, aside, _ = (jnp.asarray(axis, motion.dtype) for axis in axes_of(motion))
    return jnp.stack([swing @ ahead, swing @ aside], axis=-1)


@eqx.filter_jit
def encode(
    motion: Motion, upright: Vector3, count: Int[Array, ""] | None = None
) -> tuple[Float[Array, "time 6"], Start]:
    """The channels of a clip's body, and where it begins."""
    ahead, aside, up = (jnp.asarray(axis, motion.dtype) for axis in axes_of(motion))
    position, yaw, swing = posture(motion, upright)
    lean = _horizontal(motion, swing)
    turn = quaternion.log(quaternion.between(yaw[:-1], yaw[1:])) @ up
    step = quaternion.rotate(quaternion.conjugate(yaw[:-1]), jnp.diff(position, axis=0))
    rates = jnp.stack([step @ ahead, step @ aside, turn], axis=-1) / motion.frame_time
    rates = jnp.concatenate([rates[:1] if len(rates) else jnp.zeros((1, 3), rates.dtype), rates])
    level = _ground(motion, count)
    height = (position @ up - level)[:, None]
    return jnp.concatenate([rates, height, lean], axis=-1), Start(position[0], yaw[0], level)


def rounding(motion: Motion) -> Float[Array, "6"]:
    """What rounding alone may make of the channels."""
    size = jnp.max(jnp.abs(motion.translations[:, motion.body_joint]))
    rate = 1 / jnp.asarray(motion.frame_time)
    one = jnp.ones_like(size)
    return rounding_angle(size.dtype) * jnp.stack([size * rate, size * rate, rate, size, one, one])


def decode(
    channels: Float[AnyArray, "time 6"],
    start: Start,
    upright: Vector3,
    motion: Motion,
    count: Int[Array, ""] | None = None,
) -> Motion:
    """The motion with a body that has these channels, and stands on the ground of the start."""
    ahead, aside, up = (jnp.asarray(axis, motion.dtype) for axis in axes_of(motion))
    forward, sideways, rate, height, *lean = jnp.moveaxis(jnp.asarray(channels), -1, 0)
    angle = _walked(rate * motion.frame_time)
    yaw = quaternion.multiply(quaternion.exp(angle[:, None] * up), start.yaw)
    step = (forward[:, None] * ahead + sideways[:, None] * aside) * motion.frame_time
    before = jnp.concatenate([yaw[:1], yaw[:-1]])
    along = start.position + _walked(quaternion.rotate(before, step))
    position = along + (height + start.ground - along @ up)[:, None] * up
    swing = quaternion.exp(lean[0][:, None] * ahead + lean[1][:, None] * aside)
    turned = quaternion.multiply(quaternion.multiply(yaw, swing), shortest_arc(upright, up))
    body = motion.body_joint
    moved = hung(motion, body, position, turned)
    return hung(motion, body, position + (start.ground - _ground(moved, count)) * up, turned)


def _ground(motion: Motion, count: Int[Array, ""] | None) -> Float[Array, ""]:
    """The height of what the body stands on."""
    positions = forward_kinematics(motion).positions[:, motion.body_joint :]
    heights = positions[..., motion.skeleton.up_axis]
    counts = counting(count, motion.num_frames)
    lowest = jnp.where(counts, jnp.min(heights, axis=1), jnp.nan)
    return jnp.nanquantile(lowest, jnp.asarray(_LOWEST, heights.dtype))


def _walked(steps: Array) -> Array:
    """Where the steps lead, of which the first is none."""
    return jnp.cumsum(steps.at[0].set(0), axis=0)
