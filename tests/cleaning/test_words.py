"""Motion words: where they begin, and what they do not know."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.cleaning import joint_groups, motion_words
from tests.helpers import assert_same_rotation, no_shape_checks
from tests.style.clips import quaternions, rotations, swaying


@pytest.mark.parametrize(
    ("frames", "starts"),
    [(14, []), (15, [0]), (16, [0, 1]), (25, [0, 5, 10]), (27, [0, 5, 10, 12])],
)
def test_where_words_begin(frames, starts):
    motion = swaying(0, 40)[:frames]
    words = motion_words(motion)
    assert words.starts.tolist() == starts
    assert words.rotations.shape == (len(starts), 15, 5, 4)
    for start, word in zip(starts, words.rotations, strict=True):
        assert_same_rotation(word[:, 1:], motion.rotations[start : start + 15, 1:])


def test_the_body_leans_and_nothing_else():
    """Its yaw is gone: what is left is the swing of SciPy's swing and twist."""
    motion = swaying(1)
    words = motion_words(motion, length=40)
    turned = rotations(motion.rotations[:, 0])
    q = turned.as_quat()
    q[:, [0, 2]] = 0
    yaw = Rotation.from_quat(q)
    assert_same_rotation(words.rotations[0, :, 0], quaternions(yaw.inv() * turned), 1e-9)


def test_place_and_yaw_do_not_matter():
    motion = swaying(2)
    turn = quaternions(Rotation.from_rotvec([0, 1.2, 0]))
    q = np.array(motion.rotations)
    q[:, 0] = quaternions(rotations(turn) * rotations(q[:, 0]))
    there = np.array(motion.translations)
    there[:, 0] += [5.0, 1.0, -3.0]
    moved = motion.with_transforms(there, q)
    one, other = motion_words(motion), motion_words(moved)
    assert_same_rotation(one.rotations, other.rotations, 1e-9)


def test_joints():
    walk = jm.samples.load("walk").motion[:40]
    lower = motion_words(walk, joints="lower")
    assert lower.joints == joint_groups(walk)["lower"]
    assert motion_words(walk, joints=["Head", 3]).joints == (walk.skeleton.index("Head"), 3)
    assert motion_words(walk).joints == tuple(range(walk.num_joints))


def test_jit_and_float32():
    motion = swaying(3)
    traced = jax.jit(lambda m: motion_words(m, stride=3).rotations)(motion)
    np.testing.assert_allclose(traced, motion_words(motion, stride=3).rotations, atol=1e-12)
    assert motion_words(motion.astype(np.float32)).rotations.dtype == np.float32


def test_what_is_wrong_is_said():
    motion = swaying(4)
    with pytest.raises(ValueError, match="length=1"):
        motion_words(motion, length=1)
    with pytest.raises(ValueError, match="stride=0"):
        motion_words(motion, stride=0)
    with pytest.raises(ValueError, match="motion_words: joints"):
        motion_words(motion, joints="tail")
    with pytest.raises(ValueError, match="no group 'left'"):
        motion_words(motion, joints="left")
    with pytest.raises(ValueError, match="no joint is called"):
        motion_words(motion, joints=["tail"])
    with pytest.raises(ValueError, match="one of 5 joints"):
        motion_words(motion, joints=[5])
    with no_shape_checks(), pytest.raises(ValueError, match="Motion"):
        motion_words("walk")
