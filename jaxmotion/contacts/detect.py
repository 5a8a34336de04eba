"""Find contacts in a motion: which points stand still, when, and where.

    "segments"     the rigid segment that carries the point has a fixed point near it, in some
                   window of 0.08 s          (:mod:`jaxmotion.contacts.rigid`)
    "thresholds"   the point is low and slow          (:mod:`jaxmotion.contacts.height_speed`)

Thresholds are shares of the limb's length, and rates use the clip's frame time: nothing depends on
the unit of length or on the frame rate. In both methods a point must also be near its own lowest
level (unless ``floor=None``: hands on a table, feet on stairs), short gaps are closed, and short
contacts are dropped. The target is the mean position over a contact.

The mask passes no gradient; ``confidence`` is its soft twin, a product of logistic functions of how
far each measure is from its threshold, differentiable in the motion. T frames, C points, O(T·C).
"""

from collections.abc import Sequence
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxmotion import quaternion
from jaxmotion._checks import counted, one_number, one_of, require, static, traced
from jaxmotion._entry import finite_clip, one_clip
from jaxmotion._numerics import safe_norm
from jaxmotion._program import keepable
from jaxmotion._room import room_for
from jaxmotion._types import ScalarLike
from jaxmotion.contacts import height_speed, rigid
from jaxmotion.contacts.contact import (
    FREE,
    PLANE,
    POINT,
    ContactPoints,
    Contacts,
    check_frames,
    check_points,
    over_time,
)
from jaxmotion.contacts.feet import find_feet
from jaxmotion.contacts.nearby import floor_near, motion_near, origin_of
from jaxmotion.frames.count import frame_mask
from jaxmotion.frames.runs import hysteresis, mean_over_runs, without_gaps, without_short
from jaxmotion.kinematics import forward_kinematics
from jaxmotion.motion import Motion

_WINDOW = 0.08  # seconds
_SHORT = 0.05  # seconds: of contacts and of gaps between them
_NEAR = 0.02  # of the limb's length: heights over the level that a segment at rest may have
_SHARPNESS = 8.0


@static("window")
def detect(
    motion: Motion,
    *,
    method: Literal["segments", "thresholds"] = "segments",
    points: ContactPoints | None = None,
    joints: Sequence[int | str] | None = None,
    floor: ScalarLike | Literal["auto"] | None = "auto",
    window: int | None = None,
    tolerance: ScalarLike = 1.0,
    length: ScalarLike | None = None,
) -> Contacts:
    """Find the contacts of a motion.

    **Arguments:** ``motion``: one clip, T frames, J joints; ``method``: "segments" (a fixed point
    in the segment that carries it) or "thresholds" (low and slow); ``points``: which points may
    touch, by default the heels and balls of the feet (:func:`find_feet`); ``joints``: names or
    numbers of joints whose origins may touch, instead of ``points``; ``floor``: "auto" asks that a
    point be near its own lowest level, a number (file unit) that it be near this height, None
    nothing; ``window``: frames in 0.08 s, static, by default from the frame time and at least 3;
    ``tolerance``: what every threshold is multiplied by; ``length``: number of frames that count,
    the first ones, for padded clips; of fewer than a window "segments" finds no contacts.
    **Returns:** :class:`Contacts` of T frames and C points, C = 0 for a skeleton without feet. A
    clip of one frame has no motion: what is low touches.
    **Raises:** ``ValueError`` for an unknown method or floor, both points and joints, a joint that
    the skeleton does not have, a window of fewer than 2 frames, a tolerance that is not above 0 or
    a length outside 1 to T; under ``jit`` or ``vmap`` when the window, or both points and joints,
    are left out; at run time for such a tolerance or length that is traced.
    """
    one_clip("detect", motion)
    one_of("detect: method", method, ("segments", "thresholds"))
    if points is not None and joints is not None:
        raise ValueError("detect: points and joints are both given; expected one of them")
    if isinstance(floor, str) and floor != "auto":
        raise ValueError(f"detect: floor={floor!r}; expected 'auto', a number or None")
    if joints is not None:
        points = ContactPoints(motion.skeleton, joints)
    scale = one_number("detect: tolerance", tolerance)
    motion = require(motion, ~(scale > 0), "detect: tolerance must be above 0", got=tolerance)
    count, motion = counted("detect: length", length, motion.num_frames, motion)
    finite_clip("detect", motion, length=length)
    if points is None:
        points = find_feet(motion, length=length)
    check_points(points, "detect")
    kind = motion.dtype
    level = floor if floor is None or isinstance(floor, str) else jnp.asarray(floor, kind)
    scale = jnp.asarray(tolerance, kind)
    frames = _window(motion, window)
    if frames > motion.num_frames:
        return _detect(motion, points, method, level, motion.num_frames, scale, count)
    room = room_for(motion, points, level, tolerance, length=length)
    found = _detect(room.fill(motion), points, method, level, frames, scale, count)
    return room.cut(found, over_time)


def _window(motion: Motion, window: int | None) -> int:
    if window is None:
        if traced(motion.frame_time):
            raise ValueError(
                "detect: the motion is traced, so its frame rate is unknown; pass window=..., "
                "the number of frames in 0.08 s"
            )
        return max(3, round(_WINDOW / float(motion.frame_time)) + 1)
    if window < 2:
        raise ValueError(f"detect: window={window}; expected at least 2 frames")
    return window


@keepable
@eqx.filter_jit
def _detect(
    motion: Motion,
    points: ContactPoints,
    method: str,
    floor: Array | str | None,
    window: int,
    tolerance: Float[Array, ""],
    count: Int[Array, ""],
) -> Contacts:
    counts = frame_mask(count, motion.num_frames)
    origin = origin_of(motion)
    motion, floor = motion_near(motion, origin), floor_near(motion, origin, floor)
    pose = forward_kinematics(motion)
    index = np.asarray(points.joints, int)
    turns = pose.rotations[:, index]
    offset = quaternion.rotate(turns, jnp.asarray(points.point, motion.dtype))
    positions = pose.positions[:, index] + offset
    size = mean_limb_lengths(motion, points, counts)
    smoothed = height_speed.smooth(positions, counts, motion.frame_time)
    heights = _heights(smoothed, motion.skeleton.up_axis, floor, size, counts, window)
    short = jnp.round(_SHORT / motion.frame_time).astype(jnp.int32)
    if method == "segments":
        found = rigid.rest(positions, quaternion.to_matrix(turns), size, counts, window, tolerance)
        mask, confidence, kinds = found.ratio < 1, _soft(found.ratio), found.kind
        if heights is not None:
            near = heights / (_NEAR * jnp.where(size > 0, size, 1) * tolerance)
            mask, confidence = mask & (near < 1), confidence * _soft(near)
        short = jnp.minimum(short, window)
    else:
        low = height_speed.low_and_slow(
            heights, smoothed, size, counts, motion.frame_time, tolerance
        )
        weak = (low.speed < 1) & (low.height < 1)
        strong = (low.speed < 0.5) & (low.height < 0.5)
        mask = hysteresis(strong & counts[:, None], weak & counts[:, None])
        confidence = _soft(low.speed) * _soft(low.height)
        kinds = jnp.full(mask.shape, POINT, jnp.int8)
    confidence = jnp.where(counts[:, None], confidence, 0)
    mask = _tidied(mask & counts[:, None], short, counts)
    target = mean_over_runs(mask, positions, confidence) + origin
    kinds = jnp.where(mask, jnp.clip(kinds, POINT, PLANE), FREE).astype(jnp.int8)
    return Contacts(points, mask, target, kind=kinds, confidence=confidence)


def _tidied(mask: Bool[Array, "time point"], short: Array, counts: Array) -> Array:
    closed = without_gaps(mask, short, counts)
    return without_short(closed, jnp.maximum(short, 2), counts)


def _heights(smoothed: Array, up: int, floor, size, counts, window: int) -> Array | None:
    if floor is None:
        return None
    height = smoothed[..., up]
    if isinstance(floor, str):
        return height - height_speed.levels(height, size, counts, window)
    return height - floor


def _soft(ratio: Float[Array, "time point"]) -> Float[Array, "time point"]:
    """1 far below the threshold, ½ at it, 0 far above."""
    return jax.nn.sigmoid(_SHARPNESS * (1 - jnp.minimum(ratio, 4)))


def limb_lengths(
    motion: Motion, points: ContactPoints, *, length: ScalarLike | None = None
) -> Float[Array, " point"]:
    """Length of the limb that carries each point: both bones, means over the frames.

    For points without a limb it is half of the skeleton's longest chain.

    **Arguments:** ``motion``: one clip, T frames; ``points``: C points of its skeleton; ``length``:
    number of frames that count, the first ones, for padded clips.
    **Returns:** f[C], file unit.
    **Raises:** ``ValueError`` for a length outside 1 to T; at run time for one that is traced.
    """
    one_clip("limb_lengths", motion)
    check_points(points, "limb_lengths")
    count, motion = counted("limb_lengths: length", length, motion.num_frames, motion)
    finite_clip("limb_lengths", motion, length=length)
    return mean_limb_lengths(motion, points, frame_mask(count, motion.num_frames))


def mean_limb_lengths(
    motion: Motion, points: ContactPoints, counts: Bool[Array, " time"]
) -> Float[Array, " point"]:
    """:func:`limb_lengths` over the frames that count, for callers who know them."""
    lengths = safe_norm(motion.translations)
    total = jnp.sum(jnp.where(counts[:, None], lengths, 0), axis=0)
    moving = np.isin(np.arange(motion.num_joints), motion.translated_joints)
    bones = jnp.where(moving, total / jnp.sum(counts).astype(motion.dtype), lengths[0])
    reach = [jnp.zeros((), motion.dtype)]
    for j, parent in enumerate(motion.skeleton.parents[1:], 1):
        reach.append(reach[parent] + bones[j])
    half = 0.5 * jnp.max(jnp.stack(reach))
    sizes = [half if limb is None else bones[limb[1]] + bones[limb[2]] for limb in points.limbs]
    return jnp.stack(sizes) if sizes else jnp.zeros((0,), motion.dtype)


def replant(motion: Motion, contacts: Contacts) -> Contacts:
    """The same contacts, with targets where ``motion`` has the points.

    Means over each contact, weighted by confidence. For contacts that were found on another clip,
    or drawn by hand.

    **Arguments:** ``motion``: one clip, T frames; ``contacts``: of T frames.
    **Returns:** :class:`Contacts`; only targets differ.
    **Raises:** ``ValueError`` when the contacts have another number of frames.
    """
    check_frames(motion, contacts, "replant")
    finite_clip("replant", motion)
    room = room_for(motion, contacts)
    target = room.cut(_targets(room.fill(motion), room.fill(contacts, over_time), room.count))
    return eqx.tree_at(lambda c: c.target, contacts, target)


@eqx.filter_jit
def _targets(
    motion: Motion, contacts: Contacts, count: Int[Array, ""]
) -> Float[Array, "time point 3"]:
    """Where the motion has the points, means over the contacts among the frames that count."""
    origin = origin_of(motion)
    positions = contacts.points.positions(motion_near(motion, origin))
    mask = contacts.mask & frame_mask(count, motion.num_frames)[:, None]
    return mean_over_runs(mask, positions, contacts.confidence) + origin
