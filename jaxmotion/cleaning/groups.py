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
from jaxmotion.cleaning.turns import vectors_between
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
    return groups_of(one_skeleton("joint_groups", motions))


def groups_of(clips: Sequence[Motion]) -> dict[str, tuple[int, ...]]:
    """The groups of clips that are known to be sound; they are gone through twice, one clip in
    memory at a time."""
    skeleton = clips[0].skeleton
    body = clips[0].body_joint
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
    first = clips[0]
    skeleton, kind = first.skeleton, first.dtype
    moments = np.zeros((skeleton.num_joints, 4, 4))
    usual, lengths = [], []
    for clip in clips:
        q = np.asarray(known(clip.rotations), np.float64).transpose(1, 0, 2)
        moments += q.transpose(0, 2, 1) @ q
        usual.append(np.median(np.asarray(known(clip.translations), np.float64), axis=0))
        lengths.append(clip.num_frames)
    middle = np.linalg.eigh(moments)[1][..., -1].astype(kind)
    bones = _middle(np.stack(usual), np.array(lengths))
    bones[: first.body_joint + 1] = 0
    related = _related(skeleton, bones)
    one = np.array([1, 0, 0, 0], kind)
    away, squared = np.zeros((2, skeleton.num_joints))
    together = np.zeros(len(related))
    for clip in clips:
        q = np.asarray(known(clip.rotations))
        turns = _turns_from(middle, q)
        away += np.einsum("tja,tja->j", turns, turns)
        # Copies show in the turns themselves, not in those about their means.
        turns = _turns_from(one, q)
        squared += np.einsum("tja,tja->j", turns, turns)
        together += [np.sum(turns[:, a] * turns[:, b]) for a, b in related]
    still = away <= sum(lengths) * _STILL**2
    copied = _copied(related, together, squared, ~still)
    return ~(still | _small(skeleton, bones) | _added(skeleton) | copied)


def _turns_from(
    rest: Float[np.ndarray, "*joint 4"], q: Float[np.ndarray, "time joint 4"]
) -> Float[np.ndarray, "time joint 3"]:
    return vectors_between(np.broadcast_to(rest, q.shape), q).astype(np.float64)


def _middle(
    usual: Float[np.ndarray, "clip joint 3"], lengths: np.ndarray
) -> Float[np.ndarray, "joint 3"]:
    """Where each joint is most of the time: files may move every one. The median of the clips'
    medians, each as often as the clip has frames."""
    order = np.argsort(usual, axis=0, kind="stable")
    ordered = np.take_along_axis(usual, order, axis=0)
    frames = 2 * np.cumsum(lengths[order], axis=0)
    low, high = (
        np.take_along_axis(ordered, (x).argmax(axis=0)[None], axis=0)[0]
        for x in (frames >= lengths.sum(), frames > lengths.sum())
    )
    return (low + high) / 2


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


def _related(skeleton: Skeleton, bones: Float[np.ndarray, "joint 3"]) -> list[tuple[int, int]]:
    """Joints of which one may be a copy of the other."""
    length = np.linalg.norm(bones, axis=-1)
    related = []
    for parent, children in enumerate(skeleton.children):
        related += [(parent, j) for j in children] if parent else []
        related += [
            (a, b)
            for n, a in enumerate(children)
            for b in children[n + 1 :]
            if bones[a] @ bones[b] > _ALONG * length[a] * length[b]
        ]
    return related


def _copied(
    related: list[tuple[int, int]],
    together: Float[np.ndarray, " pair"],
    squared: Float[np.ndarray, " joint"],
    moves: Bool[np.ndarray, " joint"],
) -> Bool[np.ndarray, " joint"]:
    """The one of two that turns less, of those that turn together; of equals the later."""
    copied = np.zeros(len(moves), bool)
    for (a, b), both in zip(related, together, strict=True):
        if moves[a] and moves[b] and both**2 >= (1 - _COPIED) * squared[a] * squared[b]:
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
