"""The root as channels that do not know where the body is, nor which way it goes.

    ahead, aside   ground velocity, in the yaw frame of the frame before, length a second
    yaw rate       radians a second
    height         above the ground, length
    lean           rotation vector of the swing, its two horizontal parts, radians

With n up and U a constant turn, the root's rotation is q = yaw ⊗ swing ⊗ U: yaw turns about n, the
swing about a horizontal axis (``quaternion.arcs``). U takes to n the axis of the root that points
up most of the time (``upright``), so that a root whose own axes lie otherwise, or a body that
crawls, stays far from the half turn where yaw has no meaning. The first frame has the velocities of
the second. Decoding walks on from a place and a yaw: O(T), exact.

The body hangs from one joint: the root, or, where a file puts a joint of its own above the hips,
the last one down a chain of only children that are translated. Its channels are of the world, and
what stands above it keeps still.

The ground is where the lowest joint is in the lowest tenth of the frames.

``count``: how many frames count, the first ones, None for all.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxmotion import quaternion
from jaxmotion._numerics import rounding_angle
from jaxmotion._types import AnyArray, Quaternion, Vector3
from jaxmotion.frames.count import frame_mask
from jaxmotion.kinematics import forward_kinematics
from jaxmotion.motion import Motion
from jaxmotion.quaternion.arcs import shortest_arc, twist

CHANNELS = ("ahead", "aside", "yaw rate", "height", "lean ahead", "lean aside")
HEIGHT = CHANNELS.index("height")
RATES = np.arange(len(CHANNELS)) < HEIGHT  # those that are a second
_LOWEST = 0.1


class Start(NamedTuple):
    """Where a path begins: the body's position f[3], yaw f[4]; ``ground``: its height f[]."""

    position: Vector3
    yaw: Quaternion
    ground: Float[Array, ""]


class _Axes(NamedTuple):
    """Unit vectors f[3] along the ground and up, right-handed."""

    ahead: np.ndarray
    aside: np.ndarray
    up: np.ndarray


def body_of(motion: Motion) -> int:
    """The joint that the body hangs from."""
    joint, children = 0, motion.skeleton.children
    while len(children[joint]) == 1 and children[joint][0] in motion.translated_joints:
        joint = children[joint][0]
    return joint


@eqx.filter_jit
def upright(motion: Motion, count: Int[Array, ""] | None = None) -> Vector3:
    """Which of the body's own axes, or their opposites, points up most of the time: f[3]."""
    up = jnp.asarray(_axes(motion).up, motion.dtype)
    _, turned = _pose(motion, body_of(motion))
    own = quaternion.rotate(quaternion.conjugate(turned), up)
    own = jnp.mean(own, axis=0, where=counting(count, len(own))[:, None])
    most = jnp.argmax(jnp.abs(own))
    return jnp.sign(own[most]) * jnp.eye(3, dtype=own.dtype)[most]


def counting(count: Int[Array, ""] | None, frames: int) -> Bool[Array, " time"]:
    """Which of the frames count."""
    return frame_mask(jnp.asarray(frames if count is None else count, jnp.int32), frames)


def lean(motion: Motion, upright: Vector3) -> Float[Array, "time 2"]:
    """The last two of the channels."""
    return _posture(motion, upright)[2]


@eqx.filter_jit
def encode(
    motion: Motion, upright: Vector3, count: Int[Array, ""] | None = None
) -> tuple[Float[Array, "time 6"], Start]:
    """The channels of a clip's body, and where it begins."""
    ahead, aside, up = (jnp.asarray(axis, motion.dtype) for axis in _axes(motion))
    position, yaw, lean = _posture(motion, upright)
    turn = quaternion.log(quaternion.between(yaw[:-1], yaw[1:])) @ up
    step = quaternion.rotate(quaternion.conjugate(yaw[:-1]), jnp.diff(position, axis=0))
    rates = jnp.stack([step @ ahead, step @ aside, turn], axis=-1) / motion.frame_time
    rates = jnp.concatenate([rates[:1] if len(rates) else jnp.zeros((1, 3), rates.dtype), rates])
    level = _ground(motion, count)
    height = (position @ up - level)[:, None]
    return jnp.concatenate([rates, height, lean], axis=-1), Start(position[0], yaw[0], level)


def rounding(motion: Motion) -> Float[Array, "6"]:
    """What rounding alone may make of the channels."""
    size = jnp.max(jnp.abs(motion.translations[:, body_of(motion)]))
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
    ahead, aside, up = (jnp.asarray(axis, motion.dtype) for axis in _axes(motion))
    forward, sideways, rate, height, *lean = jnp.moveaxis(jnp.asarray(channels), -1, 0)
    angle = _walked(rate * motion.frame_time)
    yaw = quaternion.multiply(quaternion.exp(angle[:, None] * up), start.yaw)
    step = (forward[:, None] * ahead + sideways[:, None] * aside) * motion.frame_time
    before = jnp.concatenate([yaw[:1], yaw[:-1]])
    along = start.position + _walked(quaternion.rotate(before, step))
    position = along + (height + start.ground - along @ up)[:, None] * up
    swing = quaternion.exp(lean[0][:, None] * ahead + lean[1][:, None] * aside)
    turned = quaternion.multiply(quaternion.multiply(yaw, swing), shortest_arc(upright, up))
    moved = _hung(motion, position, turned)
    return _hung(motion, position + (start.ground - _ground(moved, count)) * up, turned)


def _hung(motion: Motion, position: Array, turned: Array) -> Motion:
    """The motion with its body there, in the world."""
    body = body_of(motion)
    if body:
        place, above = _pose(motion, motion.skeleton.parents[body])
        back = quaternion.conjugate(above)
        position = quaternion.rotate(back, position - place)
        turned = quaternion.multiply(back, turned)
    other = jnp.sum(turned[:1] * motion.rotations[:1, body], axis=-1, keepdims=True) < 0
    return motion.with_transforms(
        jnp.asarray(motion.translations).at[:, body].set(position),
        jnp.asarray(motion.rotations).at[:, body].set(jnp.where(other, -turned, turned)),
    )


def _pose(motion: Motion, joint: int) -> tuple[Float[Array, "time 3"], Float[Array, "time 4"]]:
    """World position and rotation of a joint near the root."""
    translations, rotations = jnp.asarray(motion.translations), jnp.asarray(motion.rotations)
    position, turned = translations[:, joint], rotations[:, joint]
    while joint:
        joint = motion.skeleton.parents[joint]
        above = rotations[:, joint]
        position = translations[:, joint] + quaternion.rotate(above, position)
        turned = quaternion.multiply(above, turned)
    return position, turned


def _posture(
    motion: Motion, upright: Vector3
) -> tuple[Float[Array, "time 3"], Float[Array, "time 4"], Float[Array, "time 2"]]:
    """The body's position, yaw and lean."""
    ahead, aside, up = (jnp.asarray(axis, motion.dtype) for axis in _axes(motion))
    position, turned = _pose(motion, body_of(motion))
    turned = quaternion.multiply(turned, quaternion.conjugate(shortest_arc(upright, up)))
    yaw = twist(turned, up)
    swing = quaternion.log(quaternion.between(yaw, turned))
    return position, yaw, jnp.stack([swing @ ahead, swing @ aside], axis=-1)


def _ground(motion: Motion, count: Int[Array, ""] | None) -> Float[Array, ""]:
    """The height of what the body stands on."""
    positions = forward_kinematics(motion).positions[:, body_of(motion) :]
    heights = positions[..., motion.skeleton.up_axis]
    counts = counting(count, motion.num_frames)
    lowest = jnp.where(counts, jnp.min(heights, axis=1), jnp.nan)
    return jnp.nanquantile(lowest, jnp.asarray(_LOWEST, heights.dtype))


def _walked(steps: Array) -> Array:
    """Where the steps lead, of which the first is none."""
    return jnp.cumsum(steps.at[0].set(0), axis=0)


def _axes(motion: Motion) -> _Axes:
    up = motion.skeleton.up_axis
    ahead, aside = np.eye(3)[[(up + 1) % 3, (up + 2) % 3]]
    return _Axes(ahead, aside, np.eye(3)[up])
