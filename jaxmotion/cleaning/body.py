"""Rotations as repairs see them: those of the joint that the body hangs from without its yaw."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxmotion import quaternion
from jaxmotion._checks import known
from jaxmotion._posture import axes_of, pose_in_world, posture, upright
from jaxmotion._room import room_for
from jaxmotion._types import Vector3
from jaxmotion.cleaning.missing import bridged
from jaxmotion.cleaning.words import texture
from jaxmotion.motion import Motion
from jaxmotion.quaternion.arcs import shortest_arc


def as_lean(motion: Motion) -> Float[np.ndarray, "time joint 4"]:
    """Local rotations, the body's as it leans (:func:`texture` of all joints)."""
    return np.array(texture(motion, tuple(range(motion.num_joints))))


def from_lean(
    motion: Motion,
    leans: Float[np.ndarray, "time joint 4"],
    wrong: Bool[np.ndarray, "time joint"],
    *,
    yaw_holds: bool = False,
) -> Float[np.ndarray, "time joint 4"]:
    """Local rotations again. The body's yaw is the motion's; where its rotation is wrong, unless
    the yaw holds all the same, the short way between the frames beside."""
    body = motion.body_joint
    rotations = leans.copy()
    if not wrong[:, body].any():
        rotations[:, body] = known(motion.rotations)[:, body]
        return rotations
    stands, room = upright(motion), room_for(motion)
    whole = room.fill(motion)
    yaw = np.asarray(room.cut(_yaw(whole, stands)))
    if not yaw_holds:
        yaw = bridged(yaw[:, None], ~wrong[:, body : body + 1])[:, 0]
    back = _back(whole, room.fill(yaw), room.fill(leans[:, body]), stands)
    rotations[:, body] = np.asarray(room.cut(back))
    return rotations


@eqx.filter_jit
def _yaw(motion: Motion, stands: Vector3) -> Float[Array, "time 4"]:
    return posture(motion, stands)[1]


@eqx.filter_jit
def _back(motion: Motion, yaw, lean, stands: Vector3) -> Float[Array, "time 4"]:
    """The body's local rotation, that faces and leans so."""
    up = jnp.asarray(axes_of(motion).up, motion.dtype)
    standing = quaternion.multiply(lean, shortest_arc(stands, up))
    turned = quaternion.multiply(yaw, standing)
    body = motion.body_joint
    if not body:
        return turned
    _, above = pose_in_world(motion, motion.skeleton.parents[body])
    return quaternion.between(above, turned)
