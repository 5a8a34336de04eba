import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.spacetime import JointLimits, learn_limits
from tests.helpers import no_shape_checks, random_motion, random_quaternions, scipy_rotation


def test_excess_against_scipy(dtype):
    rng = np.random.default_rng(0)
    centre, q = random_quaternions(rng, (3,), dtype), random_quaternions(rng, (5, 3), dtype)
    lower, upper = -rng.uniform(0, 2, (3, 3)), rng.uniform(0, 2, (3, 3))
    lower[0, 0], upper[0, 0] = -np.inf, np.inf
    limits = JointLimits(lower, upper, centre).astype(dtype)
    turn = scipy_rotation(np.broadcast_to(centre, q.shape)).inv() * scipy_rotation(q)
    v = turn.as_rotvec().reshape(5, 3, 3)
    excess = limits.excess(q)
    assert excess.dtype == dtype
    np.testing.assert_allclose(excess, v - np.clip(v, lower, upper), atol=1e-5)


def near(rng, frames, skeleton=4):
    motion = random_motion(rng, frames, skeleton)
    q = random_quaternions(rng, motion.rotations.shape[:2], angle=1.0)
    return motion.with_transforms(rotations=q)


def test_learned_limits_hold_the_clips_and_no_more_than_the_margin():
    rng = np.random.default_rng(1)
    first = near(rng, 20)
    second = near(rng, 9, first.skeleton)
    limits = learn_limits([first, second], margin=0.0)
    for clip in (first, second):
        assert np.abs(limits.excess(clip.rotations)).max() < 1e-12
    v = limits.turns(jnp.concatenate([first.rotations, second.rotations]))
    np.testing.assert_allclose(limits.upper[1:], v.max(0)[1:], atol=1e-12)
    np.testing.assert_allclose(limits.lower[1:], v.min(0)[1:], atol=1e-12)
    assert np.all(np.isinf(limits.upper[0]))
    wider = learn_limits([first, second], margin=0.1)
    np.testing.assert_allclose(wider.upper[1:] - limits.upper[1:], 0.1)
    fewer = learn_limits(first, margin=0.0, coverage=0.8)
    beyond = np.any(np.abs(fewer.excess(first.rotations)) > 1e-9, axis=0)[1:]
    assert beyond.all()


def test_limits_of_some_joints():
    upper = jnp.arange(12.0).reshape(4, 3)
    part = JointLimits(-upper, upper).of((2, 0))
    np.testing.assert_array_equal(part.upper, upper[np.array([2, 0])])
    np.testing.assert_array_equal(part.centre, [[1, 0, 0, 0]] * 2)


def test_what_does_not_fit_is_refused():
    with no_shape_checks():
        with pytest.raises(ValueError, match=r"upper has shape \(2, 3\); expected \(4, 3\)"):
            JointLimits(np.zeros((4, 3)), np.zeros((2, 3)))
        with pytest.raises(ValueError, match="0 clips"):
            learn_limits([])
        with pytest.raises(ValueError, match="coverage=0"):
            learn_limits(random_motion(np.random.default_rng(0), 3, 3), coverage=0)
