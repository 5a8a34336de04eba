"""Measures of a clip, and of the difference between two.

    rotation_rates      ‖log(q̄_{t-1} q_t)‖ / Δt                         radians a second
    bend                angle from the midpoint of q_{t-1} and q_{t+1} to q_t        radians
    gimbal_margin       |π/2 − |θ₂||, θ₂ the middle of a joint's three Euler angles (proper Euler
                        orders: distance of θ₂ from 0 and π)                         radians
    difference          how much two clips differ: mean, 95th percentile and largest, and in how
                        many frames one sees it

T frames, J joints. For reports and checks: NumPy in float64 on the host, nothing is traced, nothing
waits for a compiler but what needs world positions. O(T·J).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from jaxmotion._asf_bone import AsfBone
from jaxmotion._checks import no_module
from jaxmotion._entry import for_people, one_clip, skeleton_of
from jaxmotion._summary import brief, called, line
from jaxmotion._types import ArrayLike
from jaxmotion.kinematics import forward_kinematics
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton

_BLOCK = 512  # frames at a time for world positions: one compiled function for all clips
_EXACT = 1e-8  # radians, and share of the figure's size: less is rounding
# What one sees: a turn of 0.05° at the hips moves the feet by a thousandth of the figure, some
# millimetre of a person.
VISIBLE_TURN = np.radians(0.05)
VISIBLE_SHIFT = 1e-3  # of the figure's size


@dataclass(frozen=True)
class Peak:
    """The largest of some values and where it is, beside what is usual.

    **Fields:** ``value``: in the unit of what it is the largest of; ``frame``: from 0; ``joint``:
    by name; ``mean``, ``p95``: mean and 95th percentile of all values; ``end_site``: whether it is
    the end site of that joint, not the joint.
    """

    value: float
    frame: int
    joint: str
    mean: float
    p95: float
    end_site: bool = False

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield f"{brief(self.value)} in frame {self.frame} of {self._place()}"
        yield f"mean {brief(self.mean)}"
        yield f"95 % below {brief(self.p95)}"

    def _place(self) -> str:
        return f"{called([self.joint])}{', its end site' * self.end_site}"


@dataclass(frozen=True)
class Difference:
    """How two clips of one shape differ.

    **Fields:** ``frames``: how many there are; ``frames_changed``: in how many of them one sees it:
    a joint turns by over 0.05° or shifts by over a thousandth of :func:`figure_size`; ``angle``:
    turns of joints in their parents' frames, radians; ``shift``: changes of local translations,
    file unit; ``root``: moves of the body, ``before.body_joint``, in the world, file unit;
    ``distance``: moves of joints and end sites in the world, file unit, None if not asked for. Each
    of them over all frames and joints.
    """

    frames: int
    frames_changed: int
    angle: Peak
    shift: Peak
    root: Peak
    distance: Peak | None

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield f"{self.frames_changed} of {self.frames} frames"
        for name in ("angle", "shift", "root", "distance"):
            if (peak := getattr(self, name)) is not None:
                yield f"{name} {brief(peak.value)} of {peak._place()}"


def turn(a: ArrayLike, b: ArrayLike) -> Float[np.ndarray, "..."]:
    """Angle between unit quaternions, exact for tiny angles.

    **Arguments:** ``a``, ``b``: f[..., 4], of shapes that broadcast.
    **Returns:** f64[...], radians, in [0, π].
    """
    for name, value in (("a", a), ("b", b)):
        no_module(f"turn: {name}", value, "metrics.difference takes motions")
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    chord = np.minimum(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
    return 4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))


def rotation_rates(motion: Motion) -> Float[np.ndarray, "*batch step joint"]:
    """Speed of every joint's rotation from frame to frame.

    **Arguments:** ``motion``: T frames, J joints; leading batch axes allowed.
    **Returns:** f64[T − 1, J], radians a second.
    **Raises:** ``ValueError`` for what is no motion.
    """
    for_people("rotation_rates", motion)
    q = np.asarray(motion.rotations)
    return turn(q[..., 1:, :, :], q[..., :-1, :, :]) / _seconds(motion)


def sign_flips(motion: Motion) -> Bool[np.ndarray, "*batch step joint"]:
    """Where a quaternion lies in the other hemisphere from the one before.

    The rotation is the same, but a filter that does not know would go the long way round. Read from
    Euler angles, it is a jump of a whole turn.

    **Arguments:** ``motion``: T frames, J joints; leading batch axes allowed.
    **Returns:** bool[T − 1, J].
    **Raises:** ``ValueError`` for what is no motion.
    """
    for_people("sign_flips", motion)
    q = np.asarray(motion.rotations, np.float64)
    return np.sum(q[..., 1:, :, :] * q[..., :-1, :, :], axis=-1) < 0


def bend(motion: Motion) -> Float[np.ndarray, "*batch inner joint"]:
    """How far each rotation is from half way between its neighbours in time.

    A rotation that is out for one frame has a bend of its error, and its neighbours of half that.

    **Arguments:** ``motion``: T frames, J joints; leading batch axes allowed.
    **Returns:** f64[T − 2, J], radians; no rows for fewer than three frames.
    **Raises:** ``ValueError`` for what is no motion.
    """
    for_people("bend", motion)
    q = np.asarray(motion.rotations, np.float64)
    before, after = q[..., :-2, :, :], q[..., 2:, :, :]
    same = np.sum(before * after, axis=-1, keepdims=True) >= 0
    middle = before + np.where(same, after, -after)
    return turn(q[..., 1:-1, :, :], middle / np.linalg.norm(middle, axis=-1, keepdims=True))


def root_bend(motion: Motion) -> Float[np.ndarray, "*batch inner"]:
    """How far the body, ``motion.body_joint``, is from half way between its places in the frames
    before and after.

    **Arguments:** ``motion``: T frames; leading batch axes allowed.
    **Returns:** f64[T − 2], file unit; empty for fewer than three frames.
    **Raises:** ``ValueError`` for what is no motion.
    """
    for_people("root_bend", motion)
    p = body_positions(motion, motion.body_joint)
    middle = 0.5 * (p[..., :-2, :] + p[..., 2:, :])
    return np.linalg.norm(p[..., 1:-1, :] - middle, axis=-1)


def duplicate_frames(motion: Motion) -> Bool[np.ndarray, "*batch time"]:
    """Which frames repeat the one before in every joint.

    Turns of up to 1e-8 radians, and shifts of as large a share of the figure's size, are rounding.

    **Arguments:** ``motion``: T frames; leading batch axes allowed.
    **Returns:** bool[T], the first False.
    **Raises:** ``ValueError`` for what is no motion.
    """
    for_people("duplicate_frames", motion)
    q, p = np.asarray(motion.rotations), np.asarray(motion.translations, np.float64)
    angle = turn(q[..., 1:, :, :], q[..., :-1, :, :]).max(axis=-1, initial=0.0)
    shift = np.abs(np.diff(p, axis=-3)).max(axis=(-2, -1), initial=0.0)
    same = (angle <= _EXACT) & (shift <= _EXACT * figure_size(motion.skeleton))
    return np.concatenate([np.zeros((*same.shape[:-1], 1), bool), same], axis=-1)


def gimbal_margin(motion: Motion) -> Float[np.ndarray, "*batch time joint"]:
    """How far each joint's Euler angles are from gimbal lock.

    In the joint's own order of rotation channels; infinite for joints with fewer than three. At
    lock the first and the last angle turn about one axis and may jump.

    **Arguments:** ``motion``: T frames, J joints; leading batch axes allowed.
    **Returns:** f64[T, J], radians.
    **Raises:** ``ValueError`` for what is no motion.
    """
    for_people("gimbal_margin", motion)
    q = np.asarray(motion.rotations, np.float64)
    margin = np.full(q.shape[:-1], np.inf)
    for j in range(motion.num_joints):
        outer, inner = _gimbal_axes(motion.skeleton, j)
        if inner is not None:
            # Their product is sin θ₂ (proper Euler: cos θ₂), up to its sign.
            cosine = _rotated(q[..., j, :], inner) @ outer
            margin[..., j] = np.arccos(np.minimum(np.abs(cosine), 1.0))
    return margin


def figure_size(skeleton: Skeleton | Motion) -> float:
    """Size of the figure: its longest chain of bones, end sites not counted.

    **Arguments:** ``skeleton``: J joints, or a motion of them.
    **Returns:** a float, file unit, the largest of a batch; 1 where all bones have length 0.
    """
    skeleton = skeleton_of("figure_size", skeleton)
    lengths = np.linalg.norm(np.asarray(skeleton.offsets, np.float64), axis=-1)
    reach = np.zeros_like(lengths)
    for j, parent in enumerate(skeleton.parents[1:], 1):
        reach[..., j] = reach[..., parent] + lengths[..., j]
    return float(reach.max()) or 1.0


def world_positions(motion: Motion) -> Float[np.ndarray, "*batch time point 3"]:
    """World positions of joints, then end sites.

    Forward kinematics a block of frames at a time, so that clips of all lengths share one
    compilation.

    **Arguments:** ``motion``: T frames, J joints, E end sites; leading batch axes allowed.
    **Returns:** f64[T, J + E, 3], file unit.
    **Raises:** ``ValueError`` for what is no motion.
    """
    for_people("world_positions", motion)
    translations, rotations = np.asarray(motion.translations), np.asarray(motion.rotations)
    pieces = []
    for start in range(0, motion.num_frames, _BLOCK):
        index = np.minimum(np.arange(start, start + _BLOCK), motion.num_frames - 1)
        block = motion.with_transforms(translations[..., index, :, :], rotations[..., index, :, :])
        pose = forward_kinematics(block)
        points = [np.asarray(pose.positions), np.asarray(pose.end_positions)]
        pieces.append(np.concatenate(points, axis=-2)[..., : motion.num_frames - start, :, :])
    return np.concatenate(pieces, axis=-3).astype(np.float64)


def body_positions(motion: Motion, joint: int) -> Float[np.ndarray, "*batch time 3"]:
    """World positions of the joint that a body hangs from; those of the root are there."""
    if joint == 0:
        return np.asarray(motion.translations, np.float64)[..., 0, :]
    return world_positions(motion)[..., joint, :]


def _seconds(motion: Motion) -> np.ndarray:
    """Frame time of each clip, f[..., 1, 1], to go with what is told of steps and joints."""
    return np.asarray(motion.frame_time, np.float64)[..., None, None]


def difference(before: Motion, after: Motion, *, world: bool = False) -> Difference:
    """How ``after`` differs from ``before``.

    **Arguments:** ``before``, ``after``: single clips of one shape; ``world``: whether to compare
    world positions too, of joints and end sites.
    **Returns:** :class:`Difference`.
    **Raises:** ``ValueError`` for what is not one clip, or when the shapes differ.
    """
    one_clip("difference", before, "before", on_host=True)
    one_clip("difference", after, "after", on_host=True)
    if before.rotations.shape != after.rotations.shape:
        raise ValueError(
            f"difference: the clips have shapes {before.rotations.shape} and "
            f"{after.rotations.shape} (time, joint, 4); they must agree"
        )
    names, body = before.skeleton.names, before.body_joint
    gone = body_positions(after, body) - body_positions(before, body)
    angle = turn(before.rotations, after.rotations)
    moved = np.asarray(after.translations, np.float64) - np.asarray(before.translations, np.float64)
    shift = np.linalg.norm(moved, axis=-1)
    visible = VISIBLE_SHIFT * figure_size(before.skeleton)
    changed = (angle > VISIBLE_TURN).any(axis=1) | (shift > visible).any(axis=1)
    distance = None
    if world:
        apart = np.linalg.norm(world_positions(after) - world_positions(before), axis=-1)
        hung = tuple(names[joint] for joint in before.skeleton.end_joints)
        distance = _peak(apart, names + hung, joints=len(names))
    return Difference(
        before.num_frames,
        int(changed.sum()),
        _peak(angle, names),
        _peak(shift, names),
        _peak(np.linalg.norm(gone, axis=-1)[:, None], names[body : body + 1]),
        distance,
    )


def _peak(values: np.ndarray, names: tuple[str, ...], *, joints: int | None = None) -> Peak:
    """Of values f[T, points]: ``joints`` of them, then their end sites."""
    frame, point = np.unravel_index(np.argmax(values), values.shape)
    largest, mean, p95 = values[frame, point], values.mean(), np.percentile(values, 95)
    end_site = joints is not None and point >= joints
    place = int(frame), names[point]
    return Peak(float(largest), *place, float(mean), float(p95), bool(end_site))


def _axis(channel: str) -> int | None:
    """The axis that a rotation channel turns about (BVH "Zrotation", ASF "rz"), else None."""
    name = channel.lower()
    if name.endswith("rotation") and name[0] in "xyz":
        return "xyz".index(name[0])
    if len(name) == 2 and name[0] == "r" and name[1] in "xyz":
        return "xyz".index(name[1])
    return None


def _gimbal_axes(skeleton: Skeleton, joint: int):
    """The outermost and, in the turned joint, the innermost axis of three rotation channels, which
    are parallel at lock; (None, None) for fewer channels.

    An ASF bone turns about axes C of its own, q = C R C⁻¹ (the root's: R C), and lists the
    innermost first.
    """
    axes = [axis for axis in map(_axis, skeleton.channels[joint]) if axis is not None]
    if len(axes) != 3:
        return None, None
    unit = np.eye(3)
    if not skeleton.asf:
        return unit[axes[0]], unit[axes[2]]
    own = _asf_axes(skeleton.asf[joint])
    if joint == 0:
        return unit[axes[2]], own.T @ unit[axes[0]]
    return own @ unit[axes[2]], own @ unit[axes[0]]


def _asf_axes(bone: AsfBone) -> np.ndarray:
    """C as a matrix: turns about x, y, z in the bone's order, the first innermost."""
    result = np.eye(3)
    for letter in bone.axis_order.lower():
        axis = "xyz".index(letter)
        angle = np.radians(bone.axis[axis])
        i, j = (axis + 1) % 3, (axis + 2) % 3
        step = np.eye(3)
        step[[i, j], [i, j]] = np.cos(angle)
        step[j, i], step[i, j] = np.sin(angle), -np.sin(angle)
        result = step @ result
    return result


def _rotated(q: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """One vector turned by every quaternion [..., 4]."""
    twice = 2.0 * np.cross(q[..., 1:], vector)
    return vector + q[..., :1] * twice + np.cross(q[..., 1:], twice)
