"""Feet by name and by where limbs end."""

import equinox as eqx
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.contacts import find_feet


def renamed(motion, names=None):
    skeleton = motion.skeleton
    names = names or [f"joint{j}" for j in range(skeleton.num_joints)]
    other = jm.Skeleton(
        names,
        skeleton.parents,
        skeleton.offsets,
        end_joints=skeleton.end_joints,
        end_offsets=skeleton.end_offsets,
    )
    return jm.Motion(other, motion.translations, motion.rotations, motion.frame_time)


@pytest.fixture(scope="module")
def walk():
    return jm.samples.walk(90, fps=30.0)


@pytest.mark.parametrize("named", [True, False])
def test_heels_and_balls_of_a_person(walk, named):
    """Within a centimetre of the sample's own heels; balls are the toe joints."""
    motion = walk.motion if named else renamed(walk.motion)
    points = find_feet(motion)
    assert points.joints == (16, 17, 20, 21)
    assert points.limbs == ((14, 15, 16),) * 2 + ((18, 19, 20),) * 2
    heels = np.asarray(walk.contact_offsets)[[0, 3]]
    np.testing.assert_allclose(points.point[::2], heels, atol=0.01)
    np.testing.assert_array_equal(points.point[1::2], 0)
    assert points.names[0] == ("LeftFoot.heel" if named else "joint16.heel")


def test_paws_by_geometry_where_names_speak_of_hands():
    motion = jm.samples.quadruped_walk(60, fps=30.0).motion
    points = find_feet(motion)
    names = motion.skeleton.names
    assert {names[j] for j in points.joints} == {
        side + part
        for side in ("Left", "Right")
        for part in ("Foot", "ToeBase", "Hand", "FingerBase")
    }
    assert find_feet(renamed(motion)).joints == points.joints


def test_feet_without_toes():
    """The tip of the ankle's bone is the ball; without a tip there is one point."""
    rng = np.random.default_rng(0)
    offsets = np.array([[0, 9, 0], [0, 3, 0], [1, 0, 0], [0, -4, 0], [0, -4, 0.0]])
    names = ["hips", "chest", "upleg", "leg", "ankle"]
    for tip in (True, False):
        skeleton = jm.Skeleton(
            names,
            [-1, 0, 0, 2, 3],
            offsets,
            end_joints=[4] if tip else [],
            end_offsets=np.array([[0, -0.5, 1.5]]) if tip else None,
        )
        turns = jm.quaternion.exp(0.1 * rng.standard_normal((5, 5, 3)))
        motion = jm.Motion.from_root(skeleton, np.tile(offsets[0], (5, 1)), turns, 1 / 30)
        points = find_feet(motion)
        assert points.joints == ((4, 4) if tip else (4,))
        if tip:
            np.testing.assert_allclose(points.point[1], [0, -0.5, 1.5], atol=1e-12)
        assert points.limbs[0] == (2, 3, 4)


def test_no_feet():
    skeleton = jm.Skeleton(["a", "b"], [-1, 0], np.ones((2, 3)))
    motion = jm.Motion.from_root(skeleton, np.zeros((3, 3)), np.tile([1.0, 0, 0, 0], (3, 2, 1)), 1)
    assert find_feet(motion).num_points == 0
    # A foot so near the root that no limb carries it.
    near = renamed(motion, ["hips", "foot"])
    assert find_feet(near).num_points == 0


def test_traced_motions_are_refused(walk):
    with pytest.raises(ValueError, match="find the points outside of jit"):
        eqx.filter_jit(find_feet)(walk.motion)
