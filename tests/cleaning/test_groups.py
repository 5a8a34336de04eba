"""Which joints tell of a motion, and in which groups they are."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.cleaning import joint_groups
from tests.helpers import no_shape_checks
from tests.style.clips import quaternions


def body(extra=(), seed=0, frames=60):
    """A walker of nine joints, and ``extra`` ones: (name, parent, offset)."""
    joints = [
        ("Hips", None, (0, 9, 0)),
        ("Spine", "Hips", (0, 3, 0)),
        ("LeftArm", "Spine", (2, 3, 0)),
        ("RightArm", "Spine", (-2, 3, 0)),
        ("LeftUpLeg", "Hips", (1, 0, 0)),
        ("LeftLeg", "LeftUpLeg", (0, -4, 0)),
        ("LeftFoot", "LeftLeg", (0, -4, 0)),
        ("RightUpLeg", "Hips", (-1, 0, 0)),
        ("RightLeg", "RightUpLeg", (0, -4, 0)),
        ("RightFoot", "RightLeg", (0, -4, 0)),
        *extra,
    ]
    names = [name for name, *_ in joints]
    parents = [-1 if parent is None else names.index(parent) for _, parent, _ in joints]
    skeleton = jm.Skeleton(names, parents, np.array([offset for *_, offset in joints], float))
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None, None] / 30
    v = 0.4 * np.sin(rng.uniform(3, 8, (1, len(names), 3)) * t + rng.uniform(0, 6, (1, 1, 3)))
    q = quaternions(Rotation.from_rotvec(v.reshape(-1, 3))).reshape(frames, -1, 4)
    root = np.stack([0 * t[:, 0, 0], 9 + 0 * t[:, 0, 0], t[:, 0, 0]], -1)
    return jm.Motion.from_root(skeleton, root, q, 1 / 30)


def named(motion, group):
    return {motion.skeleton.names[j] for j in joint_groups(motion)[group]}


def turned(motion, name, vectors):
    """The motion with another turn of a joint, f[T, 3] or f[3]."""
    q = np.array(motion.rotations)
    vectors = np.array(np.broadcast_to(vectors, (len(q), 3)))
    q[:, motion.skeleton.index(name)] = quaternions(Rotation.from_rotvec(vectors))
    return motion.with_transforms(rotations=q)


def test_parts_of_a_body():
    motion = body()
    every = set(motion.skeleton.names)
    legs = {name for name in every if "Leg" in name or "Foot" in name}
    assert named(motion, "whole") == every
    assert named(motion, "lower") == legs | {"Hips"}
    assert named(motion, "upper") == every - legs
    assert named(motion, "left") == {name for name in every if "Right" not in name}
    assert named(motion, "right") == {name for name in every if "Left" not in name}


def test_still_joints_tell_nothing():
    motion = turned(body(), "LeftArm", [0.3, 0.1, 0])
    assert "LeftArm" not in named(motion, "whole")
    swing = np.radians(1.0) * np.sin(np.arange(60))[:, None] * np.array([1.0, 0, 0])
    assert "LeftArm" in named(turned(motion, "LeftArm", swing), "whole")
    # What moves in one clip of several counts.
    assert motion.skeleton.index("LeftArm") in joint_groups([motion, body()])["whole"]


def test_fingers_and_faces_tell_nothing():
    extra = [
        ("LeftHand", "LeftArm", (4, 0, 0)),
        ("LeftIndex", "LeftHand", (0.5, 0, 0.1)),
        ("LeftIndex2", "LeftIndex", (0.4, 0, 0)),
        ("LeftThumb", "LeftHand", (0.3, 0, 0.3)),
        ("Head", "Spine", (0, 4, 0)),
        ("Jaw", "Head", (0, 0.2, 0.5)),
        ("Eye", "Head", (0.2, 0.6, 0.5)),
    ]
    found = named(body(extra), "whole")
    assert {"LeftHand", "Head"} <= found
    assert not found & {"LeftIndex", "LeftIndex2", "LeftThumb", "Jaw", "Eye"}


def test_twist_bones_tell_nothing_of_their_own():
    extra = [("LeftElbow", "LeftArm", (2, 0, 0)), ("LeftHand", "LeftArm", (4, 0, 0))]
    motion = body(extra)
    v = np.asarray(jm.quaternion.log(motion.rotations))
    of = motion.skeleton.index
    half = turned(motion, "LeftElbow", 0.5 * v[:, of("LeftHand")])
    assert "LeftElbow" not in named(half, "whole")
    assert {"LeftArm", "LeftHand"} <= named(half, "whole")
    assert "LeftElbow" in named(motion, "whole")


def test_twist_bones_are_known_by_name():
    """But not a neck that is called so, with a head on it."""
    extra = [
        ("LeftArmTwist1", "LeftArm", (2, 0, 0)),
        ("LeftArmTwist2", "LeftArmTwist1", (2, 0, 0)),
        ("NeckTwist", "Spine", (0, 4, 0)),
        ("Head", "NeckTwist", (0, 2, 0)),
    ]
    found = named(body(extra), "whole")
    assert not {"LeftArmTwist1", "LeftArmTwist2"} & found
    assert {"NeckTwist", "Head"} <= found


def test_real_skeletons(data_dir):
    """The 100 joints of a character come down to those of a body; a walker loses but its root."""
    path = sorted(data_dir.glob("cmu_dance/*.bvh"))[0]
    dancer = jm.load(path)
    found = named(dancer[:600], "whole")
    assert 15 <= len(found) <= 30
    told = ("thumb", "index", "jaw", "armtwist", "calftwist", "sharebone")
    assert not [name for name in found if any(word in name.lower() for word in told)]
    walker = jm.load(data_dir / "bandai" / "walk_normal_001.bvh")
    assert named(walker, "whole") == set(walker.skeleton.names) - {"joint_Root"}
    legs = {n for n in walker.skeleton.names if any(w in n for w in ("Leg", "Foot", "Toe"))}
    assert named(walker, "lower") == legs | {"Hips"}


def test_what_is_wrong_is_said():
    with pytest.raises(ValueError, match="no clips"):
        joint_groups([])
    with pytest.raises(ValueError, match="other joints"):
        joint_groups([body(), body([("Tail", "Hips", (0, 0, -2))])])
    with no_shape_checks(), pytest.raises(ValueError, match="Motion"):
        joint_groups(["walk"])


def test_bones_are_where_frames_have_them():
    """Files that move every joint may say nothing in their offsets."""
    motion = body([("LeftHand", "LeftArm", (4, 0, 0)), ("LeftThumb", "LeftHand", (0.3, 0, 0.3))])
    names = motion.skeleton.names
    bare = jm.Skeleton(names, motion.skeleton.parents, np.zeros((len(names), 3)))
    moved = jm.Motion(bare, motion.translations, motion.rotations, motion.frame_time)
    assert joint_groups(moved)["whole"] == joint_groups(motion)["whole"]
