"""Which joints tell of a motion, and the groups of them that are searched for by themselves.

A joint tells nothing of its own if

    still       it turns by less than half a degree about its mean
    small       it hangs from a joint that has several such, none of whose chains is longer than
                0.15 of the figure: fingers, the face
    copied      its rotation vector is a fixed share of that of a joint whose bone it lies along
                (its parent, its child, or a child of its parent that goes the same way), or its
                name says twist, roll or share, and that of all below it: what a rig adds to a body

Groups, which overlap: "whole"; "lower", what hangs from the joint of the hips and ends in a foot;
"upper", all else; "left" and "right", all but the other side. NumPy on the host, O(T·J).
"""

import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from jaxmotion._checks import known, traced
from jaxmotion._entry import finite_clip
from jaxmotion._posture import body_of
from jaxmotion.cleaning.turns import mean_rotation, vectors_between
from jaxmotion.contacts import find_feet
from jaxmotion.kinematics import mirrored_pairs
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton

GROUPS = ("whole", "upper", "lower", "left", "right")
_STILL = np.radians(0.5)
_SMALL = 0.15
_COPIED = 0.01  # of the variance, that the share of another leaves
_ADDED = re.compile(r"twist|roll|share")
_ALONG = 0.98  # cosine of two bones that lie along each other


def joint_groups(motions: Motion | Sequence[Motion]) -> dict[str, tuple[int, ...]]:
    """The joints that tell of a motion: all of them, upper and lower body, left and right.

    **Arguments:** ``motions``: one or more clips, T frames, of one skeleton.
    **Returns:** joint numbers by name of the group: "whole", "upper", "lower", "left", "right";
    groups without joints, or the same as one before, are left out.
    **Raises:** ``ValueError`` for no clips, clips of other joints, what is traced or not finite.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk").motion
        >>> groups = jm.cleaning.joint_groups(walk)
        >>> sorted(walk.skeleton.names[j] for j in groups["lower"])[:3]
        ['Hips', 'LeftFoot', 'LeftLeg']
    """
    clips = one_skeleton("joint_groups", motions)
    skeleton = clips[0].skeleton
    body = body_of(clips[0])
    telling = informative(clips)
    telling[:body] = False
    lower = _under_feet(clips[0], body)
    sides = np.array(mirrored_pairs(skeleton), int).reshape(-1, 2)
    of_side = [_with_descendants(skeleton, side) for side in sides.T]
    wanted = {
        "whole": np.ones(len(lower), bool),
        "upper": ~lower,
        "lower": lower,
        "left": ~of_side[1],
        "right": ~of_side[0],
    }
    wanted["lower"][body] = True
    groups: dict[str, tuple[int, ...]] = {}
    for name, chosen in wanted.items():
        joints = tuple(np.flatnonzero(chosen & telling).tolist())
        if joints and joints not in groups.values():
            groups[name] = joints
    return groups


def as_clips(motions: Motion | Sequence[Motion]) -> list[Motion]:
    """One clip, or several, as several."""
    return [motions] if isinstance(motions, Motion) else list(motions)


def one_skeleton(caller: str, motions: Motion | Sequence[Motion]) -> list[Motion]:
    """The clips, finite and known, of the same joints."""
    clips = as_clips(motions)
    if not clips:
        raise ValueError(f"{caller}: no clips; expected one at least")
    for k, clip in enumerate(clips):
        finite_clip(caller, clip, f"motions[{k}]", on_host=True)
        if traced(clip.rotations):
            raise ValueError(f"{caller}: motions[{k}] is traced; call it outside of jit and vmap")
        if clip.skeleton.names != clips[0].skeleton.names:
            raise ValueError(f"{caller}: motions[{k}] has other joints than the first")
    return clips


def informative(clips: Sequence[Motion]) -> Bool[np.ndarray, " joint"]:
    """Which joints are none of still, small and copied."""
    skeleton = clips[0].skeleton
    q = np.concatenate([known(clip.rotations) for clip in clips])
    one = np.broadcast_to(np.array([1, 0, 0, 0], q.dtype), q.shape)
    middle = np.broadcast_to(mean_rotation(q), q.shape)
    turns = vectors_between(middle, q).astype(np.float64)
    squared = np.einsum("tja,tja->j", turns, turns)
    still = squared <= len(q) * _STILL**2
    # Copies show in the turns themselves, not in those about their means.
    turns = vectors_between(one, q).astype(np.float64)
    bones = _bones(clips)
    copied = _copied(skeleton, bones, turns, ~still)
    return ~(still | _small(skeleton, bones) | _added(skeleton) | copied)


def _bones(clips: Sequence[Motion]) -> Float[np.ndarray, "joint 3"]:
    """From each joint's parent to it, as most of the time: files may move every joint. 0 down to
    the joint that the body hangs from."""
    every = np.concatenate([np.asarray(known(clip.translations), np.float64) for clip in clips])
    bones = np.median(every, axis=0)
    bones[: body_of(clips[0]) + 1] = 0
    return bones


def _small(skeleton: Skeleton, bones: Float[np.ndarray, "joint 3"]) -> Bool[np.ndarray, " joint"]:
    """Fingers and faces, by where they are."""
    length = np.linalg.norm(bones, axis=-1)
    reach = np.zeros(skeleton.num_joints)
    for joint, tip in zip(
        skeleton.end_joints, np.asarray(known(skeleton.end_offsets)), strict=True
    ):
        reach[joint] = max(reach[joint], float(np.linalg.norm(tip)))
    for j in range(skeleton.num_joints - 1, 0, -1):
        parent = skeleton.parents[j]
        reach[parent] = max(reach[parent], length[j] + reach[j])
    size = reach[0]
    small = np.zeros(skeleton.num_joints, bool)
    for children in skeleton.children:
        if len(children) > 1 and all(length[j] + reach[j] < _SMALL * size for j in children):
            small[list(children)] = True
    return _with_descendants(skeleton, np.flatnonzero(small))


def _added(skeleton: Skeleton) -> Bool[np.ndarray, " joint"]:
    """Twist bones and their like, by name."""
    added = np.array([bool(_ADDED.search(name.lower())) for name in skeleton.names])
    for j in range(skeleton.num_joints - 1, 0, -1):
        added[skeleton.parents[j]] &= added[j]
    return added


def _copied(
    skeleton: Skeleton,
    bones: Float[np.ndarray, "joint 3"],
    turns: Float[np.ndarray, "time joint 3"],
    moves: Bool[np.ndarray, " joint"],
) -> Bool[np.ndarray, " joint"]:
    """The one of two that turns less, of those that turn together; of equals the later."""
    length = np.linalg.norm(bones, axis=-1)
    squared = np.einsum("tja,tja->j", turns, turns)
    copied = np.zeros(skeleton.num_joints, bool)
    for parent, children in enumerate(skeleton.children):
        related = [(parent, j) for j in children] if parent else []
        related += [
            (a, b)
            for n, a in enumerate(children)
            for b in children[n + 1 :]
            if bones[a] @ bones[b] > _ALONG * length[a] * length[b]
        ]
        for a, b in related:
            if not (moves[a] and moves[b]):
                continue
            together = np.sum(turns[:, a] * turns[:, b])
            if together**2 >= (1 - _COPIED) * squared[a] * squared[b]:
                copied[b if squared[b] <= squared[a] else a] = True
    return copied


def _under_feet(motion: Motion, body: int) -> Bool[np.ndarray, " joint"]:
    """Joints of the limbs that end in feet."""
    skeleton = motion.skeleton
    tops = set()
    for joint in find_feet(motion).joints:
        while skeleton.parents[joint] > body:
            joint = skeleton.parents[joint]
        tops.add(joint)
    return _with_descendants(skeleton, np.array(sorted(tops), int))


def _with_descendants(skeleton: Skeleton, joints: np.ndarray) -> Bool[np.ndarray, " joint"]:
    below = np.zeros(skeleton.num_joints, bool)
    below[joints] = True
    for j, parent in enumerate(skeleton.parents):
        below[j] |= parent >= 0 and below[parent]
    return below
