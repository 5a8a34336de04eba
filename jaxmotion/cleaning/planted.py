"""Limbs that were repaired: of several ways the one that stands best, brought back to where it is
held.

A limb stands best, in a run of frames, where the sum of ‖target − position‖ over its planted points
is least. For each point c of a limb, in frames where joints that carry it were repaired, the limb's
end is to move by d(t) = target − position while c is planted (the mean, of several points), and
fades to it within 0.15 s on both sides where repaired. :func:`jaxmotion.contacts.limb_ik` turns the
limb's root and middle so; the end and what hangs from it keep their turns in the world. O(T·J).
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxmotion import quaternion
from jaxmotion._checks import known
from jaxmotion._file_facts import compiled
from jaxmotion._room import room_for
from jaxmotion.contacts import Contacts, limb_ik
from jaxmotion.contacts.contact import Limb, check_frames, over_time
from jaxmotion.frames.runs import spans, spread
from jaxmotion.kinematics import forward_kinematics
from jaxmotion.motion import Motion

_FADE = 0.15  # seconds


def nearest_to_contacts(
    candidates: Sequence[Motion],
    contacts: Contacts,
    mask: Bool[np.ndarray, "time joint"],
) -> Motion:
    """The first motion, but limbs as the candidate has them whose planted points are nearest to
    where they are held: of each limb one for a run of frames in which ``mask`` has its joints."""
    motion = candidates[0]
    check_frames(motion, contacts, "repair")
    for limb, points in _limbs(contacts).items():
        part = [j for j in range(motion.num_joints) if set(limb) & set(_above(motion, j))]
        runs = spans(mask[:, part].any(axis=1))
        held = np.asarray(known(contacts.mask)) & points
        runs = [(start, stop) for start, stop in runs if held[start:stop].any()]
        if not runs:
            continue
        inside = np.isin(np.arange(motion.num_joints), part)[:, None]
        tried = [
            motion.with_transforms(rotations=jnp.where(inside, x.rotations, motion.rotations))
            for x in candidates
        ]
        away = np.stack([_away(x, contacts, held) for x in tried])
        for start, stop in runs:
            best = tried[int(away[:, start:stop].sum(axis=1).argmin())]
            here = (np.arange(motion.num_frames) >= start) & (np.arange(motion.num_frames) < stop)
            put = jnp.where(inside & here[:, None, None], best.rotations, motion.rotations)
            motion = motion.with_transforms(rotations=put)
    return motion


def _limbs(contacts: Contacts) -> dict[Limb, Bool[np.ndarray, " point"]]:
    """Which points each limb carries."""
    every = dict.fromkeys(limb for limb in contacts.limbs if limb is not None)
    return {limb: np.array([other == limb for other in contacts.limbs]) for limb in every}


def _away(motion: Motion, contacts: Contacts, held: np.ndarray) -> Float[np.ndarray, " time"]:
    """How far planted points are from where they are held, in all."""
    room = room_for(motion, contacts)
    filled: Any = room.fill(motion), room.fill(contacts, over_time)
    positions = np.asarray(room.cut(_positions(*filled)))
    distance = np.linalg.norm(positions - np.asarray(known(contacts.target)), axis=-1)
    return np.where(held, distance, 0).sum(axis=1)


@compiled
def _positions(motion, contacts):
    return contacts.points.positions(motion)


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
    for limb, points in _limbs(contacts).items():
        chain = _above(motion, limb[2])
        carried = np.asarray(mask[:, chain].any(axis=1))
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
