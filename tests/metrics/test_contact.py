"""Measures of contacts, smoothness and accuracy against loops and matrices."""

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.contacts import ContactPoints, Contacts
from jaxmotion.metrics import (
    contact_scores,
    foot_skate,
    jerk,
    joint_position_error,
    penetration,
    slides,
)
from tests.helpers import no_shape_checks, random_motion, world_by_matrices


@pytest.fixture
def motion(dtype):
    return random_motion(np.random.default_rng(0), 9, 5, dtype)


def test_slides_and_skate(motion):
    rng = np.random.default_rng(1)
    offsets = rng.standard_normal((2, 3))
    points = ContactPoints(motion.skeleton, [2, 4], offsets)
    mask = rng.uniform(size=(9, 2)) < 0.7
    contacts = Contacts(points, mask, np.zeros((9, 2, 3)))
    positions, turns, _ = world_by_matrices(motion)
    total, steps = 0.0, 0
    for c, joint in enumerate(points.joints):
        y = positions[:, joint] + turns[:, joint] @ offsets[c]
        for t in range(8):
            if mask[t, c] and mask[t + 1, c]:
                total += np.linalg.norm(y[t + 1] - y[t])
                steps += 1
    np.testing.assert_allclose(slides(motion, contacts).sum(), total, rtol=1e-5)
    np.testing.assert_allclose(foot_skate(motion, contacts), total / steps * 30, rtol=1e-5)
    never = Contacts(points, np.zeros((9, 2), bool), np.zeros((9, 2, 3)))
    assert foot_skate(motion, never) == 0.0
    with no_shape_checks(), pytest.raises(ValueError, match="contacts have 9 frames, the motion 4"):
        slides(motion[:4], contacts)


def test_penetration(motion):
    points = ContactPoints(motion.skeleton, [0, 3])
    heights = world_by_matrices(motion)[0][:, [0, 3], 1]
    got = penetration(motion, points, floor=0.2)
    np.testing.assert_allclose(got, np.maximum(0.2 - heights, 0), atol=1e-5)


def test_contact_scores():
    truth = np.array([[1, 1, 0, 0, 1]], bool)
    found = np.array([[1, 0, 1, 0, 1]], bool)
    assert contact_scores(found, truth) == (2 / 3, 2 / 3)
    assert contact_scores(found, truth, [[1, 0, 1, 1, 1]]) == (2 / 3, 1.0)
    assert contact_scores(np.zeros((3, 0)), np.zeros((3, 0))) == (1.0, 1.0)
    with pytest.raises(ValueError, match="they must agree"):
        contact_scores(found, truth[:, :3])


def test_jerk_of_a_cubic_and_errors_of_a_shift(motion):
    t = np.arange(9) / 30
    skeleton = jm.Skeleton(["a", "b"], [-1, 0], np.array([[0.0, 0, 0], [1, 2, 3]]))
    root = np.stack([2 * t**3, t**2, 0 * t], -1)
    still = np.tile([1.0, 0, 0, 0], (9, 2, 1))
    np.testing.assert_allclose(
        jerk(jm.Motion.from_root(skeleton, root, still, 1 / 30)), 12.0, rtol=1e-6
    )
    assert jerk(motion[:2]).shape == (0, 5)
    shift = np.zeros(motion.translations.shape, motion.dtype)
    shift[:, 0] = [3, 0, 4]
    moved = motion.with_transforms(motion.translations + jax.numpy.asarray(shift))
    np.testing.assert_allclose(joint_position_error(moved, motion), 5.0, rtol=1e-5)
    np.testing.assert_allclose(joint_position_error(moved, motion, relative=True), 0, atol=1e-5)
    with no_shape_checks(), pytest.raises(ValueError, match="they must agree"):
        joint_position_error(moved, motion[:3])


def test_errors_name_the_measure_that_was_called():
    motion = jm.samples.walk(9, fps=30.0).motion
    contacts = jm.contacts.detect(motion)
    for measure in (slides, foot_skate):
        name = f"{measure.__name__}: contacts have 9 frames, the motion 4"
        with no_shape_checks(), pytest.raises(ValueError, match=name):
            measure(motion[:4], contacts)


@pytest.mark.parametrize("name", ["foot_skate", "slides", "jerk", "joint_position_error", "bend"])
def test_what_numpy_measures_is_not_traced(name):
    motion = random_motion(np.random.default_rng(0), 9, 5)
    points = ContactPoints(motion.skeleton, [2], np.zeros((1, 3)))
    standing = Contacts(points, np.ones((9, 1), bool), np.zeros((9, 1, 3)))
    others = {"joint_position_error": motion, "foot_skate": standing, "slides": standing}
    others = [others[name]] if name in others else []
    measure = getattr(jm.metrics, name)
    with pytest.raises(TypeError, match=f"{name}: NumPy measures it, .*forward_kinematics"):
        jax.jit(lambda motion: measure(motion, *others))(motion)
