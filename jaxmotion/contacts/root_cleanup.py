"""Footskate cleanup by the root alone (after Lyard & Magnenat-Thalmann 2008; our version).

What planted points slide from frame to frame, the root takes back, for good:

    S(t) = S(t − 1) − mean over points planted at t − 1 and t of (y(t) − y(t − 1))      on the floor
    H(t) = mean over the planted points of (target − y)·up,   across gaps from one side to the other

No joint turns, so the pose stays as it was performed, but the path becomes shorter or longer, and
of two feet that slide apart each keeps half. S and H are smoothed (half amplitude at 6 Hz), since
their speed jumps where one foot takes over from another; a steady slide is not touched by that.
T frames, C points, O(T·(J + C)). Differentiable in motion and targets.
"""

import jax.numpy as jnp

from jaxmotion._checks import counted
from jaxmotion._entry import finite_clip
from jaxmotion._file_facts import compiled
from jaxmotion._program import keepable
from jaxmotion._types import ScalarLike
from jaxmotion.contacts.contact import Contacts, check_frames
from jaxmotion.contacts.nearby import contacts_near, floor_near, motion_near, origin_of
from jaxmotion.frames.count import frame_mask
from jaxmotion.frames.runs import spread
from jaxmotion.motion import Motion
from jaxmotion.smoothing.low_pass import low_pass

_CUTOFF = 6.0


def cleanup_root(
    motion: Motion,
    contacts: Contacts,
    *,
    floor: ScalarLike | None = None,
    length: ScalarLike | None = None,
) -> Motion:
    """Stop planted points from sliding by moving the root only.

    After Lyard & Magnenat-Thalmann 2008; the module has the equations.

    **Arguments:** ``motion``: one clip, T frames, J joints; ``contacts``: of the motion; ``floor``:
    height below which no contact point may go, file unit; ``length``: number of frames that count,
    the first ones.
    **Returns:** a motion of the same shape, every rotation as it was; the one given if there are no
    points.
    **Raises:** ``ValueError`` when the contacts have another number of frames or the length is
    outside 1 to T; at run time for such a length that is traced.
    """
    check_frames(motion, contacts, "cleanup_root")
    if contacts.num_points == 0:
        return motion
    level = None if floor is None else jnp.asarray(floor, motion.dtype)
    count, motion = counted("cleanup_root: length", length, motion.num_frames, motion)
    finite_clip("cleanup_root", motion, length=length)
    return _cleanup(motion, contacts, level, count)


@keepable
@compiled
def _cleanup(motion: Motion, contacts: Contacts, floor, count) -> Motion:
    kind, up = motion.dtype, motion.skeleton.up_axis
    counts = frame_mask(count, motion.num_frames)
    planted = contacts.mask & counts[:, None]
    origin = origin_of(motion)
    points, floor = (
        contacts.points.positions(motion_near(motion, origin)),
        floor_near(motion, origin, floor),
    )
    target = contacts_near(contacts, origin).target
    both = (planted[1:] & planted[:-1]).astype(kind)[..., None]
    slide = jnp.sum(both * jnp.diff(points, axis=0), 1) / jnp.maximum(jnp.sum(both, 1), 1)
    shift = -jnp.cumsum(jnp.pad(slide, ((1, 0), (0, 0))), axis=0)
    on = planted.astype(kind)
    low = jnp.sum(on * (target - points)[..., up], 1, keepdims=True)
    low = low / jnp.maximum(jnp.sum(on, 1, keepdims=True), 1)
    anywhere = planted.any(1, keepdims=True)
    whole = jnp.asarray(motion.num_frames, kind)
    shift = shift.at[:, up].set(spread(low[..., None], anywhere, whole)[:, 0, 0])
    smooth = low_pass(shift, _CUTOFF, motion.frame_time, counts)
    shift = jnp.where(jnp.any(shift != 0), smooth, 0)
    if floor is not None:
        lowest = jnp.min(points[..., up], axis=1) + shift[:, up]
        shift = shift.at[:, up].add(jnp.maximum(floor - lowest, 0))
    moving = tuple(sorted({*motion.translated_joints, 0}))
    translations = motion.translations.at[:, 0].add(shift)
    return motion.replace(translations=translations, translated_joints=moving)
