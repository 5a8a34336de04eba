"""Scores of what was found and repaired, by plain loops."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.metrics import detection_scores, pose_error
from tests.helpers import no_shape_checks, random_motion, scipy_rotation


def masks(frames, joints=3, seed=0):
    """Runs, and what was found of them: late, and elsewhere too."""
    rng = np.random.default_rng(seed)
    truth, found = np.zeros((2, frames, joints), bool)
    for _ in range(max(frames // 25, 1)):
        start, joint = rng.integers(frames), rng.integers(joints)
        truth[start : start + 6, joint] = True
        found[start + 2 : start + 9, joint] = rng.random() < 0.7
    found[rng.random((frames, joints)) < 0.02] = True
    return found, truth


def starts_by_hand(frames, length, stride):
    starts = [t for t in range(0, frames, stride) if t + length <= frames]
    if frames >= length and starts[-1] + length < frames:
        starts.append(frames - length)
    return starts


def by_hand(found, truth, length, stride):
    count = dict.fromkeys(["hit", "miss", "false", "right"], 0)
    for t in starts_by_hand(len(found), length, stride):
        a, b = (bool(x[t : t + length].any()) for x in (found, truth))
        count[{(1, 1): "hit", (0, 1): "miss", (1, 0): "false", (0, 0): "right"}[a, b]] += 1
    return count


@pytest.mark.parametrize(("length", "stride"), [(15, 5), (10, 7), (2, 1)])
def test_words_and_entries(length, stride):
    for seed in range(4):
        found, truth = masks(123, seed=seed)
        scores = detection_scores(found, truth, length=length, stride=stride)
        n = by_hand(found, truth, length, stride)
        assert scores.words == sum(n.values())
        assert scores.in_error == n["hit"] + n["miss"]
        assert scores.recall == pytest.approx(n["hit"] / (n["hit"] + n["miss"]))
        assert scores.precision == pytest.approx(n["hit"] / (n["hit"] + n["false"]))
        wrong = n["false"] / (n["false"] + n["right"]) if n["false"] + n["right"] else np.nan
        assert scores.false_alarms == pytest.approx(wrong, nan_ok=True)
        both = sum(bool(a and b) for a, b in zip(found.flat, truth.flat, strict=True))
        assert scores.entry_recall == pytest.approx(both / truth.sum())
        assert scores.entry_precision == pytest.approx(both / found.sum())


def test_precision_at_another_share_of_errors():
    """At the clip's own it is the precision; at none 0, at all 1."""
    found, truth = masks(300, seed=2)
    scores = detection_scores(found, truth)
    share = scores.in_error / scores.words
    assert scores.precision_at(share) == pytest.approx(scores.precision)
    assert 0 < scores.precision_at(0.01) < scores.precision_at(0.1) < 1
    assert (scores.precision_at(0.0), scores.precision_at(1.0)) == (0, 1)
    # A hundred words, of which ten are in error: nine found, and 20 % of the others.
    scores = scores._replace(recall=0.9, false_alarms=0.2)
    assert scores.precision_at(0.1) == pytest.approx(9 / (9 + 18))
    assert np.isnan(scores._replace(recall=0.0, false_alarms=0.0).precision_at(0.1))


def test_shares_of_nothing():
    truth = np.zeros((40, 2), bool)
    scores = detection_scores(truth, truth)
    assert np.isnan([scores.recall, scores.precision, scores.entry_recall]).all()
    assert np.isnan(scores.entry_precision)
    assert (scores.false_alarms, scores.words, scores.in_error) == (0, 6, 0)
    scores = detection_scores(~truth, ~truth)
    assert (scores.recall, scores.precision, scores.entry_precision) == (1, 1, 1)
    assert np.isnan(scores.false_alarms)


@pytest.mark.parametrize("frames", [1, 2, 3, 14, 15])
def test_short_clips(frames):
    """Have entries, but no words."""
    truth = np.ones((frames, 2), bool)
    scores = detection_scores(truth, truth)
    assert scores.words == int(frames >= 15)
    assert scores.entry_recall == 1
    assert np.isnan(scores.recall) == (frames < 15)


def pose_error_by_hand(motion, result):
    """Half of SciPy's rotation vector, squared and summed."""
    turn = scipy_rotation(motion.rotations).inv() * scipy_rotation(result.rotations)
    return np.sum((turn.magnitude() / 2).reshape(motion.rotations.shape[:2]) ** 2, axis=-1)


def test_pose_error(dtype):
    rng = np.random.default_rng(0)
    motion, result = (random_motion(rng, 9, 4, dtype) for _ in range(2))
    result = result.replace(skeleton=motion.skeleton)
    found = pose_error(motion, result)
    assert found.dtype == np.float64
    atol = 1e-12 if dtype == np.float64 else 1e-5
    np.testing.assert_allclose(found, pose_error_by_hand(motion, result), atol=atol)
    signed = result.with_transforms(rotations=-np.asarray(result.rotations))
    np.testing.assert_allclose(pose_error(motion, signed), found, atol=atol)
    np.testing.assert_allclose(pose_error(result, motion), found, atol=atol)
    np.testing.assert_allclose(pose_error(motion, motion), 0, atol=1e-9)


def test_pose_error_of_one_joint():
    motion = random_motion(np.random.default_rng(1), 3, 4)
    q = np.array(motion.rotations)
    turned = scipy_rotation(q[1, 2]) * Rotation.from_rotvec([0, 0.6, 0])
    q[1, 2] = turned.as_quat(scalar_first=True)[0]
    found = pose_error(motion, motion.with_transforms(rotations=q))
    np.testing.assert_allclose(found, [0, 0.09, 0], atol=1e-9)


def test_what_is_wrong_is_said():
    mask = np.zeros((20, 2), bool)
    with no_shape_checks():
        for found, truth in ((mask, mask[:10]), (mask[:, :1], mask), (mask[0], mask[0])):
            with pytest.raises(ValueError, match="detection_scores: found has shape"):
                detection_scores(found, truth)
        for wrong in ({"length": 1}, {"stride": 0}, {"length": 15.0}):
            with pytest.raises(ValueError, match=next(iter(wrong))):
                detection_scores(mask, mask, **wrong)
    motion = random_motion(np.random.default_rng(2), 6, 4)
    with pytest.raises(ValueError, match="result has rotations"):
        pose_error(motion, motion[:3])
    with pytest.raises(TypeError, match="inside of jit"):
        jax.jit(lambda m: pose_error(m, m))(motion)
    with pytest.raises(ValueError, match="one clip at a time"):
        pose_error(jm.stack([motion, motion])[0], motion)
