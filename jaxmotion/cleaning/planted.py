"""Limbs that were repaired, brought back to where their planted points are held.

For each point c of a limb, in frames where joints that carry it were repaired, the limb's end is to
move by d(t) = target − position while c is planted (the mean, of several points), and fades to it
within 0.15 s on both sides where repaired. :func:`jaxmotion.contacts.limb_ik` turns the limb's root
and middle so; the end and what hangs from it keep their turns in the world. O(T·J).
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jaxmotion import quaternion
from jaxmotion._checks import known
from jaxmotion._file_facts import compiled
from jaxmotion._room import room_for
from jaxmotion.contacts import Contacts, limb_ik
from jaxmotion.contacts.contact import Limb, check_frames, over_time
from jaxmotion.frames.runs import spread
from jaxmotion.kinematics import forward_kinematics
from jaxmotion.motion import Motion

_FADE = 0.15  # seconds


def planted_again(
    motion: Motion,
    contacts: Contacts,
    mask: Bool[np.ndarray, "time joint"],
    free: Bool[np.ndarray, " joint"],
) -> tuple[Motion, Bool[np.ndarray, "time joint"]]:
    """The motion with its limbs brought back, and the mask with what was turned for it; joints that
    are not ``free`` stay as they are."""
    check_frames(motion, contacts, "repair")
    mask = mask.copy()
    for limb in dict.fromkeys(limb for limb in contacts.limbs if limb is not None):
        chain = _above(motion, limb[2])
        carried = np.asarray(mask[:, chain].any(axis=1))
        points = np.array([other == limb for other in contacts.limbs])
        held = known(contacts.mask) & carried[:, None] & points
        if not held.any() or not free[list(limb)].all():
            continue
        room = room_for(motion, contacts)
        filled = room.fill(motion), room.fill(contacts, over_time)
        given: Any = room.fill(held), room.fill(carried)  # type: ignore[arg-type]
        rotations, changed = (room.cut(x) for x in _brought_back(*filled, *given, limb))
        changed = np.asarray(changed)
        for joint in limb:
            mask[:, joint] |= changed
        motion = motion.with_transforms(rotations=jax.device_put(np.asarray(rotations)))
    return motion, mask


def _above(motion: Motion, joint: int) -> list[int]:
    """The joint and all that carry it."""
    chain = [joint]
    while chain[-1]:
        chain.append(motion.skeleton.parents[chain[-1]])
    return chain


@compiled
def _brought_back(
    motion,
    contacts,
    held: Bool[Array, "time point"],
    carried: Bool[Array, " time"],
    limb: Limb,
):
    """Rotations with the limb turned, and in which frames it was."""
    root, middle, end = limb
    pose = forward_kinematics(motion)
    away = contacts.target.astype(motion.dtype) - contacts.points.positions(motion)
    share = held.astype(motion.dtype)
    total = jnp.sum(share, axis=1, keepdims=True)
    shift = jnp.sum(share[..., None] * away, axis=1) / jnp.where(total > 0, total, 1)
    reach = (_FADE / motion.frame_time).astype(motion.dtype)
    shift = spread(shift[:, None], total > 0, reach)[:, 0]
    changed = carried & jnp.any(shift != 0, axis=-1)
    shift = jnp.where(changed[:, None], shift, 0)
    a, b, c = (pose.positions[:, j] for j in limb)
    turn = limb_ik(a, b, c, c + shift)
    parents, turned = motion.skeleton.parents, pose.rotations
    above = {
        # Of each joint of the limb how it and its parent turn, bones between them with their root.
        root: (turn.root, None),
        middle: (turn.middle, turn.root),
        end: (None, turn.middle),
    }
    rotations = motion.rotations
    for joint, (own, carrying) in above.items():
        world = turned[:, joint] if own is None else quaternion.multiply(own, turned[:, joint])
        if joint:
            parent = turned[:, parents[joint]]
            parent = parent if carrying is None else quaternion.multiply(carrying, parent)
            world = quaternion.between(parent, world)
        kept = jnp.where(changed[:, None], world, rotations[:, joint])
        rotations = rotations.at[:, joint].set(kept)
    return rotations, changed
