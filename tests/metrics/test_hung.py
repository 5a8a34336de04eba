"""Files that put a joint above the hips, which stands still: the hips carry the body."""

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.metrics import difference, joint_position_error, root_bend
from tests.helpers import hung, no_shape_checks


@pytest.fixture(scope="module")
def walk():
    clip = jm.samples.load("walk").motion[:40]
    return clip.astype(np.float64)


def moved(motion, by, frames=slice(None), joint=0):
    p = np.array(motion.translations)
    p[frames, joint] += by
    return motion.with_transforms(p, motion.rotations)


def test_the_joint_that_carries_the_body(walk):
    below = hung(walk)
    assert (walk.body_joint, below.body_joint) == (0, 1)
    np.testing.assert_allclose(
        jm.forward_kinematics(below).positions[:, 1:],
        jm.forward_kinematics(walk).positions,
        atol=1e-12,
    )


def test_measures_are_those_of_the_body(walk):
    below = hung(walk)
    np.testing.assert_allclose(root_bend(below), root_bend(walk), atol=1e-12)
    other = moved(walk, [0, 0.1, 0.4], 7)
    want, found = difference(walk, other), difference(below, hung(other))
    assert (found.root.joint, found.root.frame) == (walk.skeleton.names[0], want.root.frame)
    np.testing.assert_allclose(found.root.value, want.root.value, rtol=1e-9)
    far = moved(walk, [10.0, 0, 0])
    error = joint_position_error(hung(far), below, relative=True)
    np.testing.assert_allclose(error[:, 1:], 0, atol=1e-12)
    assert joint_position_error(hung(far), below)[:, 1:].min() > 9.9
    with no_shape_checks():
        batch = jm.stack([below, below])[0]
        np.testing.assert_allclose(root_bend(batch)[1], root_bend(walk), atol=1e-12)


def test_a_body_that_is_out_for_a_frame_is_found(walk):
    jumped = hung(moved(walk, [0, 0.3, 0], 20))
    [found] = [problem for problem in jm.check(jumped) if problem.kind == "spike"]
    assert (found.joint, found.frame) == (walk.skeleton.names[0], 20)
    assert "position out by" in found.message
