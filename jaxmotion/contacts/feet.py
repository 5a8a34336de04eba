"""Feet of a skeleton: by name, and where names say nothing, by where limbs end.

By name a foot is the topmost joint of a chain called ankle, foot, paw or hoof. By geometry it is a
leaf that, in the median frame, is within a tenth of the figure's height of its lowest point; its
ankle is then the joint of its chain where the two bones above are longest together.

A foot has a heel and a ball. With f the ankle's frame and u the floor's normal in it, averaged over
the fifth of the frames in which the foot is lowest (the sole lies flat then),

    ball    the toe joint, or the tip of a foot that has none
    heel    (ball·u) u − ⅓ (ball − (ball·u) u)      in f: below the ankle, level with the ball, and
                                                     behind it by a third of the ankle's lead

A foot of one joint without a tip has one point, its ankle. NumPy in float64 on the host, O(T·J).
"""

from typing import NamedTuple

import numpy as np

from jaxmotion import quaternion
from jaxmotion._checks import counted, traced
from jaxmotion._entry import finite_clip, one_clip
from jaxmotion._room import room_for
from jaxmotion._types import ScalarLike
from jaxmotion.contacts.contact import ContactPoints, Limb, limb_above
from jaxmotion.contacts.nearby import motion_near, origin_of
from jaxmotion.kinematics import forward_kinematics
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton, feet_by_name

_FLAT = 0.2  # share of the frames in which a foot is lowest
_LOW = 0.1  # of the figure's height
_BEHIND = 1.0 / 3.0


class _Foot(NamedTuple):
    ankle: int
    limb: Limb | None


def find_feet(motion: Motion, *, length: ScalarLike | None = None) -> ContactPoints:
    """Heels and balls of the feet; no points for a skeleton without feet.

    **Arguments:** ``motion``: one clip, T frames, J joints, of known values (not traced): the
    floor's direction and the limbs that stand are read from it; ``length``: number of frames that
    count, the first ones.
    **Returns:** :class:`ContactPoints` in the order of the joints, heel before ball.
    **Raises:** ``ValueError`` under ``jit`` and ``vmap`` (find the points outside), and for a
    length outside 1 to T.
    """
    one_clip("find_feet", motion, on_host=True)
    if traced(motion.rotations, length):
        raise ValueError(
            "find_feet: the motion is traced; find the points outside of jit or vmap and pass "
            "points=..."
        )
    count = int(counted("find_feet: length", length, motion.num_frames)[0])
    finite_clip("find_feet", motion, length=length)
    skeleton = motion.skeleton
    motion = room_for(motion, length=length).fill(motion)
    pose = forward_kinematics(motion_near(motion, origin_of(motion)))
    turns = quaternion.to_matrix(pose.rotations)
    world, turns, tips = (
        np.asarray(a, np.float64)[:count] for a in (pose.positions, turns, pose.end_positions)
    )
    up = np.eye(3)[skeleton.up_axis]
    feet = _by_name(skeleton)
    feet += _by_geometry(skeleton, world, tips, up, {f.ankle for f in feet})
    joints, offsets, names, limbs = [], [], [], []
    for foot in sorted(feet):
        for name, joint, offset in _points(skeleton, foot.ankle, world, turns, tips, up):
            joints.append(joint)
            offsets.append(offset)
            names.append(name)
            limbs.append(foot.limb)
    return ContactPoints(skeleton, joints, np.reshape(offsets, (-1, 3)), names=names, limbs=limbs)


def _by_name(skeleton: Skeleton) -> list[_Foot]:
    limbs = {j: limb_above(skeleton.parents, j) for j in feet_by_name(skeleton)}
    return [_Foot(j, limb) for j, limb in limbs.items() if limb is not None]


def _by_geometry(skeleton, world, tips, up, known) -> list[_Foot]:
    points = np.concatenate([world, tips], axis=1) @ up
    tall = np.median(np.ptp(points, axis=1))
    height = np.median(points - points.min(axis=1, keepdims=True), axis=0)
    lengths = np.linalg.norm(np.asarray(skeleton.offsets, np.float64), axis=-1)
    # A limb that stands ends before the first joint that also carries something else.
    carries = set()
    leaves = [j for j in range(skeleton.num_joints) if not skeleton.children[j]]
    for leaf in leaves:
        if not height[leaf] <= _LOW * tall:
            carries |= set(_up_from(skeleton, leaf))
    feet = []
    for leaf in leaves:
        chain = set(_up_from(skeleton, leaf))
        limbs = {j: limb_above(skeleton.parents, j) for j in chain - carries}
        bones = {j: lengths[j] + lengths[limb[1]] for j, limb in limbs.items() if limb}
        if bones and tall > 0 and not known & chain:
            ankle = max(bones, key=lambda j: (bones[j], -j))
            known = known | {ankle}
            feet.append(_Foot(ankle, limbs[ankle]))
    return feet


def _up_from(skeleton: Skeleton, joint: int):
    while joint >= 0:
        yield joint
        joint = skeleton.parents[joint]


def _points(skeleton, ankle, world, turns, tips, up):
    """(name, joint, offset in the joint's frame) of heel and ball."""
    name = skeleton.names[ankle]
    children = skeleton.children[ankle]
    ends = [e for e, j in enumerate(skeleton.end_joints) if j == ankle]
    if children:
        ball_world = world[:, children].mean(axis=1)
    elif ends:
        ball_world = tips[:, ends].mean(axis=1)
    else:
        return [(name, ankle, np.zeros(3))]
    inverse = np.swapaxes(turns[:, ankle], -1, -2)
    to_ball = np.einsum("tij,tj->ti", inverse, ball_world - world[:, ankle])
    low = (ball_world + world[:, ankle]) @ up
    flat = low <= np.quantile(low, _FLAT)
    normal = (inverse @ up)[flat].mean(axis=0)
    normal /= np.linalg.norm(normal) or 1.0
    ball = to_ball[flat].mean(axis=0)
    level = (ball @ normal) * normal
    heel = level - _BEHIND * (ball - level)
    alone = len(children) == 1
    return [
        (f"{name}.heel", ankle, heel),
        (f"{name}.ball", children[0] if alone else ankle, np.zeros(3) if alone else ball),
    ]
