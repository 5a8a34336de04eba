"""Jumps, pairs of them, and holds, against plain loops."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmotion.cleaning.jumps import held, jumps, leaps, paired, turns
from jaxmotion.frames.runs import spans
from tests.cleaning.oracles import jumps_by_hand, leaps_by_hand, paired_by_hand
from tests.helpers import angle_between, quaternions_by, random_quaternions
from tests.style.clips import rotations, swaying


def walk(frames, dtype=np.float64, jitter=0.2):
    q = np.asarray(swaying(0, frames).rotations)
    rng = np.random.default_rng(1)
    rough = rotations(q) * Rotation.from_rotvec(jitter * rng.standard_normal((q[..., 0].size, 3)))
    return np.roll(rough.as_quat(), 1, axis=-1).reshape(q.shape).astype(dtype)


def test_turns_and_jumps_in_plain_loops(dtype):
    q = walk(40, dtype)
    atol = 1e-10 if dtype == np.float64 else 1e-5
    np.testing.assert_allclose(turns(q), angle_between(q[:-1], q[1:]), atol=atol)
    np.testing.assert_allclose(jumps(q), jumps_by_hand(q), atol=atol)
    np.testing.assert_allclose(leaps(q), leaps_by_hand(q), atol=atol)


def test_what_goes_on_at_its_pace_does_not_jump():
    v = np.zeros((20, 1, 3))
    v[:, 0, 1] = 0.4 * np.arange(20)
    q = quaternions_by(v)
    np.testing.assert_allclose(jumps(q), 0, atol=1e-7)
    # Nor what gains speed, or begins to move.
    v[:, 0, 1] = 0.02 * np.arange(20) ** 2
    np.testing.assert_allclose(jumps(quaternions_by(v)), 0, atol=1e-7)
    v[:, 0, 1] = 0.5 * np.maximum(np.arange(20) - 9, 0)
    np.testing.assert_allclose(jumps(quaternions_by(v)), 0, atol=1e-7)
    v[12:, 0, 1] += 0.9
    np.testing.assert_allclose(
        jumps(quaternions_by(v))[:, 0], 0.9 * (np.arange(19) == 11), atol=1e-7
    )


def test_backwards_and_signs():
    q = walk(50)
    np.testing.assert_allclose(jumps(q[::-1]), jumps(q)[::-1], atol=1e-9)
    signs = np.random.default_rng(2).choice([-1.0, 1.0], (50, 5, 1))
    np.testing.assert_allclose(jumps(signs * q), jumps(q), atol=1e-9)


@pytest.mark.parametrize(("frames", "fps"), [(1, 30), (2, 30), (3, 30), (4, 30), (40, 5), (40, 30)])
def test_pairs_in_plain_loops(frames, fps, dtype):
    """1.3 seconds of 5 frames a second are 6 frames: they bind."""
    rng = np.random.default_rng(frames)
    q = np.asarray(random_quaternions(rng, (frames, 3))).astype(dtype)
    leap = rng.standard_normal((frames - 1, 3, 3)).astype(dtype)
    leap[rng.uniform(size=leap.shape[:2]) < 0.2] = 0
    found = paired(q, leap, float(fps))
    assert found.dtype == dtype
    atol = 1e-12 if dtype == np.float64 else 1e-6
    np.testing.assert_allclose(found, paired_by_hand(q, leap, round(1.3 * fps)), atol=atol)


def spoilt(error, before, size=0.6, begin=10, stop=15):
    """A joint that turns by 0.3 rad a step about x, off by a rotation about an axis from frame
    ``begin`` to ``stop``: of its own frame, or of its parent's."""
    v = np.zeros((30, 1, 3))
    v[:, 0, 0] = 0.3 * np.arange(30)
    q = rotations(quaternions_by(v))
    off = Rotation.from_rotvec(size * np.isin(np.arange(30), range(begin, stop))[:, None] * error)
    made = off * q if before else q * off
    return np.roll(made.as_quat(), 1, axis=-1)[:, None]


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_error_of_the_joint_or_of_its_parent_is_a_pair(axis, before):
    """Though it turns by 1.5 rad meanwhile."""
    q = spoilt(np.eye(3)[axis], before)
    for way in (q, q[::-1]):
        found = paired(way, leaps(way), 24.0)[:, 0]
        there = np.isin(np.arange(30), range(10, 15))[:: 1 if way is q else -1]
        np.testing.assert_allclose(found, 0.6 * there, atol=0.05)


def test_a_step_that_is_not_taken_back_is_no_pair():
    q, leap = spoilt(np.eye(3)[0], False, size=0), np.zeros((29, 1, 3))
    leap[9, 0, 0] = 1.0
    assert not paired(q, leap, 24.0).any()
    for degrees, back in ((0, False), (134, False), (136, True), (180, True), (226, False)):
        way = np.radians(degrees)
        leap[14, 0] = 0.6 * np.array([np.cos(way), np.sin(way), 0])
        found = paired(np.repeat(q[:1], 30, axis=0), leap, 24.0)[:, 0]
        np.testing.assert_allclose(found, back * 0.6 * np.isin(range(30), range(10, 15)))


def test_what_is_between_two_errors_is_none():
    """Of one joint, by the same turn about the same axis but for a tenth of a radian."""
    q = spoilt(np.eye(3)[0], False, size=0.6, begin=5, stop=8)
    more = spoilt(np.eye(3)[0], False, size=0.7, begin=17, stop=20)
    both = np.concatenate([q[:12], more[12:]])
    found = paired(both, leaps(both), 24.0)[:, 0] > 0.5
    np.testing.assert_array_equal(found, np.isin(np.arange(30), [5, 6, 7, 17, 18, 19]))


@pytest.mark.parametrize("gap", [8, 15, 25])
def test_two_errors_that_are_alike(gap):
    """But for a thousandth of a radian: neither takes the other's end for its own."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        v = 1e-3 * rng.standard_normal((90, 1, 3))
        wrong = np.isin(np.arange(90), [*range(20, 25), *range(25 + gap, 30 + gap)])
        v[wrong, 0, 0] += 0.8
        q = quaternions_by(v)
        np.testing.assert_array_equal(paired(q, leaps(q), 30.0)[:, 0] > 0.42, wrong)


@pytest.mark.parametrize("frames", [0, 1, 2, 3])
def test_few_frames(frames):
    q = np.asarray(random_quaternions(np.random.default_rng(0), (frames + 1, 2)))
    assert jumps(q).shape == (frames, 2)
    # The first and the last step have no step on one side.
    assert (jumps(q) > 0).any() == (frames == 3)
    assert not held(q, 30.0).any()


def holding(begin=10, stop=18, joint=2, frames=40):
    """A sway in which a joint stands still from frame ``begin`` on, until ``stop``."""
    q = np.array(swaying(3, frames).rotations)
    q[begin:stop, joint] = q[begin, joint]
    return q


def test_holds():
    """How many steps stand still; the frame that a hold begins from is not in error."""
    found = held(holding(), 30.0)
    assert found.shape == (40, 5)
    np.testing.assert_array_equal(found[:, 2], 7 * np.isin(np.arange(40), np.arange(11, 18)))
    assert not found[:, [0, 1, 3, 4]].any()
    # To the end, from the beginning, and with the other sign.
    np.testing.assert_array_equal(held(holding(30, 40), 30.0)[:, 2], 9 * (np.arange(40) > 30))
    q = holding(0, 6)
    q[3] *= -1
    np.testing.assert_array_equal(held(q, 30.0)[:, 2], 5 * np.isin(np.arange(40), range(1, 6)))
    # One step that stands still is none.
    assert not held(holding(10, 12), 30.0).any()
    assert held(holding(10, 13), 30.0).any()


def test_a_joint_that_never_moves_holds_nothing():
    """Nobody captured it; one that begins or ends to move does hold."""
    q = np.array(holding())
    q[:, 2] = q[0, 2]
    assert not held(q, 30.0).any()
    q[-1, 2] = q[-1, 1]
    assert held(q, 30.0)[1:-1, 2].all()


def test_slow_turns_are_no_holds():
    q = holding()
    still, turn = np.arange(8)[:, None], np.array([[1.0, 0, 0]])
    for size, found in ((0.9e-4, True), (1.1e-4, False)):
        drift = rotations(holding()[10:18, 2]) * Rotation.from_rotvec(size * still * turn)
        q[10:18, 2] = np.roll(drift.as_quat(), 1, axis=-1)
        assert held(q, 30.0).any() == found


def test_rest_is_no_hold():
    """Where the joint has that rotation at other times, here or elsewhere, to a thousandth."""
    pose = holding()[10, 2]
    for size, rests in ((0.9e-3, True), (1.1e-3, False)):
        near = (rotations(pose) * Rotation.from_rotvec([0, size, 0])).as_quat()[0]
        q = holding()
        q[30, 2] = -np.roll(near, 1)
        assert held(q, 30.0).any() != rests
        other = np.array(swaying(4, 12).rotations)
        assert held(holding(), 30.0, [other]).any()
        other[5, 2] = np.roll(near, 1)
        assert held(holding(), 30.0, [other[:0], other]).any() != rests


def test_a_body_that_stands_still_holds_nothing():
    """While at least half of the joints move, at 0.12 rad/s."""
    q = holding()
    q[10:18] = q[10]
    assert not held(q, 30.0).any()
    t = np.arange(40)[:, None, None] / 30 * np.array([[[1.0, 0, 0]]])
    for speed, found in ((0.13, True), (0.11, False)):
        q = quaternions_by(np.repeat(speed * t, 5, axis=1))
        q[10:18, 2] = q[10, 2]
        assert held(q, 30.0).any() == found


def test_runs():
    assert spans(np.zeros(4, bool)) == []
    assert spans(np.ones(4, bool)) == [(0, 4)]
    assert spans(np.array([1, 0, 1, 1, 0, 1], bool)) == [(0, 1), (2, 4), (5, 6)]
    assert spans(np.zeros(0, bool)) == []
