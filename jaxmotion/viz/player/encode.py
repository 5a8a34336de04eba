"""What a page holds of a clip: numbers in a few bytes each, as text.

    middle   f32[T, 3]      where the figure is, from the page's origin: the median of its points
    places   i16[T, P, 3]   from the middle to joint or end site p, in steps of reach[p]
    reach    f32[P]         the largest component of any of them / 32767
    angles   u16[T, J]      of local rotations, in steps of π / 65534

P points: the joints, then the end sites. A place is good to reach/2, 15 µm of a metre; how far a
clip travels does not matter. The page's world has Y up (turned as :func:`jaxmotion.reorient` does),
the floor at 0 and the first pose above its origin; its unit is the file's. What is not finite is
−32768, and 65535 where numbers have no sign. 6 bytes a point and frame, a third more as text.
O(T·P), NumPy, forward kinematics too: a notebook shows a clip without waiting for a compiler.
"""

from base64 import b64encode
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxmotion._plain import printable
from jaxmotion.contacts import Contacts, intervals
from jaxmotion.kinematics import mirrored_pairs
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton
from jaxmotion.viz.body import Body, body_of, some_poses

_STEPS, _MISSING = 32767, -32768
_LEVELS, _NONE = 65534, 65535
_NEAR = 0.2  # of the figure's size: a floor so near is the one at height 0


class Figure(NamedTuple):
    """A clip in the world of the page, but for its origin. ``points``: f64[T, P, 3], Y up, those
    of its ``body`` among them; ``size``: of the figure; ``floor``: its height; ``facing``: the
    angle about Y it first faces, from Z to X, radians, None where its joints do not tell."""

    motion: Motion
    points: Float[np.ndarray, "time point 3"]
    body: Body
    size: float
    floor: float
    facing: float | None


def figure_of(motion: Motion) -> Figure:
    """A known clip in the world."""
    with np.errstate(invalid="ignore", over="ignore"):  # of what is not finite
        points = _world(motion)
    points[~np.isfinite(points).all(axis=-1)] = np.nan
    points = upright(points, motion.skeleton)
    body = body_of(points, [*motion.skeleton.parents, *motion.skeleton.end_joints])
    own = points[:, body.points]
    size = _size(own)
    return Figure(motion, points, body, size, _floor(own, size), _facing(points, motion.skeleton))


def upright(points: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Points f[..., 3] of the file's world in one with Y up."""
    up = skeleton.up_axis
    if up == 1:
        return points
    order, signs = [0, 1, 2], np.ones(3)
    order[up], order[1], signs[up] = 1, up, -1
    return points[..., order] * signs


def encoded(figure: Figure, origin: Float[np.ndarray, "3"]) -> dict[str, Any]:
    """What the page holds of a clip, but for its name and marks; ``origin``: the page's."""
    motion, skeleton = figure.motion, figure.motion.skeleton
    parents = [*skeleton.parents, *skeleton.end_joints]
    points = figure.points - origin
    middle = middle_of(points)
    places = points - middle[:, None]
    largest = np.max(np.abs(places), axis=(0, 2), initial=0, where=np.isfinite(places))
    reach = (np.where(largest > 0, largest, 1) / _STEPS).astype(np.float32)
    steps = np.nan_to_num(np.rint(places / reach[:, None]), nan=_MISSING)
    return {
        "frames": motion.num_frames,
        "frameTime": float(motion.frame_time),
        "joints": [printable(name) for name in skeleton.names],
        "parents": parents,
        "loose": np.flatnonzero(figure.body.loose).tolist(),
        "apart": np.flatnonzero(~figure.body.points).tolist(),
        "size": figure.size,
        "facing": figure.facing,
        "middle": text_of(middle, np.float32),
        "reach": text_of(reach, np.float32),
        "places": text_of(np.clip(steps, _MISSING, _STEPS), np.int16),
        "angles": text_of(_angles(np.asarray(motion.rotations)), np.uint16),
    }


def middle_of(points: Float[np.ndarray, "time point 3"]) -> Float[np.ndarray, "time 3"]:
    """The median over the points, axis by axis: a root that stays while the body goes is none of
    it. NaN where no point is finite."""
    finite = np.asarray(np.isfinite(points).all(axis=-1))
    middle = np.full((len(points), 3), np.nan)
    whole = np.asarray(finite.all(axis=-1))
    middle[whole] = np.median(points[whole], axis=1)
    for frame in np.flatnonzero(np.sum(finite, axis=-1) * ~whole):
        middle[frame] = np.median(points[frame, finite[frame]], axis=0)
    return middle


def encoded_contacts(figure: Figure, contacts: Contacts, origin: np.ndarray) -> dict[str, Any]:
    """Names and joints of the points, and (point, first frame, last frame, x, y, z) of every
    contact, at its place."""
    number = {}
    for c, (name, joint) in enumerate(zip(contacts.names, contacts.joints, strict=True)):
        number.setdefault((name, joint), c)
    spans = []
    for found in intervals(contacts):
        place = upright(np.array(found.target), figure.motion.skeleton) - origin
        if np.isfinite(place).all():
            c = number[found.point, found.joint]
            spans.append([c, found.first, found.last, *np.round(place, 6).tolist()])
    return {
        "names": [printable(name) for name in contacts.names],
        "joints": list(contacts.joints),
        "spans": spans,
    }


def encoded_mask(mask: Bool[np.ndarray, "time joint"]) -> str:
    """A mask as text, eight entries a byte."""
    return b64encode(np.packbits(mask, axis=None, bitorder="little").tobytes()).decode("ascii")


def encoded_curve(values: np.ndarray) -> dict[str, Any]:
    """Numbers f[T] or f[T, J] in 65 534 steps between their least and greatest."""
    finite = np.isfinite(values)
    low = float(np.min(values, initial=np.inf, where=finite)) if finite.any() else 0.0
    high = float(np.max(values, initial=-np.inf, where=finite)) if finite.any() else 1.0
    wide = high - low or 1.0
    steps = np.where(finite, np.rint((values - low) / wide * _LEVELS), _NONE)
    return {
        "low": low,
        "high": low + wide,
        "perJoint": values.ndim == 2,
        "values": text_of(steps, np.uint16),
    }


def text_of(values: np.ndarray, dtype: Any) -> str:
    """Numbers as base64, little-endian."""
    kept = np.ascontiguousarray(values, np.dtype(dtype).newbyteorder("<"))
    return b64encode(kept.tobytes()).decode("ascii")


def _world(motion: Motion) -> Float[np.ndarray, "time point 3"]:
    """What :func:`jaxmotion.forward_kinematics` makes, joints and then end sites, in float64."""
    skeleton, frames = motion.skeleton, motion.num_frames
    local = np.moveaxis(np.asarray(motion.rotations, np.float64), 0, -1)  # joint, component, time
    offsets = np.moveaxis(np.asarray(motion.translations, np.float64), 0, -1)
    places = np.empty((skeleton.num_joints, 3, frames))
    turns = np.empty((skeleton.num_joints, 3, 3, frames))
    for j, parent in enumerate(skeleton.parents):
        own = _matrices(local[j])
        moves = j in motion.translated_joints
        offset = offsets[j] if moves else np.broadcast_to(offsets[j, :, :1], (3, frames))
        if parent < 0:
            turns[j], places[j] = own, offset
        else:
            turns[j] = np.einsum("ikt,kjt->ijt", turns[parent], own)
            places[j] = places[parent] + np.einsum("ikt,kt->it", turns[parent], offset)
    joints = list(skeleton.end_joints)
    ends = np.einsum("eikt,ek->eit", turns[joints], np.asarray(skeleton.end_offsets, np.float64))
    return np.moveaxis(np.concatenate([places, places[joints] + ends]), -1, 0)


def _matrices(q: Float[np.ndarray, "4 time"]) -> Float[np.ndarray, "3 3 time"]:
    """Rotation matrices of quaternions of any length; of zero, the identity."""
    squared = np.sum(q * q, axis=0)
    w, x, y, z = q * np.sqrt(2 / np.where(squared > 0, squared, 1))
    one = np.ones_like(w)
    rows = [
        [one - y * y - z * z, x * y - w * z, x * z + w * y],
        [x * y + w * z, one - x * x - z * z, y * z - w * x],
        [x * z - w * y, y * z + w * x, one - x * x - y * y],
    ]
    return np.array(rows)


def _angles(q: Float[np.ndarray, "time joint 4"]) -> Float[np.ndarray, "time joint"]:
    """2 atan2(‖v‖, |w|), in steps."""
    finite = np.isfinite(q).all(axis=-1)
    angle = 2 * np.arctan2(np.linalg.norm(q[..., 1:], axis=-1), np.abs(q[..., 0]))
    return np.where(finite, np.rint(angle / np.pi * _LEVELS), _NONE)


def _size(points: np.ndarray) -> float:
    """The largest extent of the figure, the median over poses."""
    poses = some_poses(points)
    if not len(poses):
        return 1.0
    return float(np.median(np.ptp(poses, axis=1).max(axis=-1))) or 1.0


def _floor(points: np.ndarray, size: float) -> float:
    """Where the lowest point is in most poses; 0 where that is near."""
    poses = some_poses(points)
    if not len(poses):
        return 0.0
    lowest = float(np.percentile(poses[..., 1].min(axis=1), 10))
    return 0.0 if -0.05 * size < lowest < _NEAR * size else lowest


def _facing(points: np.ndarray, skeleton: Skeleton) -> float | None:
    """Left minus right × up of the first whole pose, summed over mirrored joints of one parent
    (hips, shoulders)."""
    poses, parents = some_poses(points), skeleton.parents
    pairs = [(a, b) for a, b in mirrored_pairs(skeleton) if parents[a] == parents[b]]
    if not len(poses) or not pairs:
        return None
    left, right = (poses[0][list(side)] for side in zip(*pairs, strict=True))
    x, _, z = np.cross(np.sum(left - right, axis=0), [0, 1, 0])
    return float(np.arctan2(x, z)) if np.hypot(x, z) > 0 else None
