"""Errors found: by hand, and those that were put into sound clips."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cleaning import DetectedErrors, Levels, clean_levels, detect_errors
from jaxmotion.cleaning.detect import _Usual
from tests.cleaning.clips import pacing, turned
from tests.cleaning.oracles import (
    digressing_by_hand,
    pairs_of,
    spread_by_hand,
)
from tests.helpers import no_shape_checks
from tests.style.clips import swaying

RAMP = np.concatenate([np.linspace(0, 1, 8), np.ones(9), np.linspace(1, 0, 8)])


@pytest.fixture(scope="module")
def context():
    return [pacing(1, 70), pacing(2, 60)]


@pytest.fixture(scope="module")
def drifting():
    """An error that comes and goes: none of its steps is a jump."""
    return turned(pacing(0, 100), 2, np.arange(40, 65), RAMP[:, None] * [1.2, 0, 0])


def levels_of(digression=0.0, foretold=0.0, jump=0.0):
    return Levels(*(jnp.full(5, x) for x in (digression, foretold, jump)))


@pytest.mark.parametrize("passes", [1, 2])
def test_digressions_by_hand(drifting, context, passes):
    """The score against each of its thresholds, of levels that differ."""
    levels = [levels_of(0.05, 0.1), levels_of(0.1, 0.12), levels_of(0.9, 0.2)]
    found = detect_errors(drifting, context, k=3, levels=levels, passes=passes)
    usual = np.full((2, 5), [[0.1], [0.12]])
    mask = np.zeros((100, 5), bool)
    for _ in range(passes):
        score, size = digressing_by_hand(drifting, context, 3, usual, mask)
        mask = spread_by_hand(score > 1.27, score > 0.635)
    assert 10 < mask.sum() < 100
    np.testing.assert_array_equal(found.mask, mask)
    np.testing.assert_array_equal(found.by["digression"], mask)
    np.testing.assert_allclose(found.digression, size, atol=1e-7)
    np.testing.assert_allclose(found.mdm, 1 - 0.5 ** ((score / 1.27) ** 2), atol=1e-7)
    for name in ("jump", "hold", "missing"):
        assert not found.by[name].any()


def test_levels_are_those_of_the_context(drifting, context):
    """Each clip beside the others; and the error is found with them."""
    found = detect_errors(drifting, context)
    levels = [clean_levels(context[0], context[1:]), clean_levels(context[1], context[:1])]
    given = detect_errors(drifting, context, levels=levels)
    for name in ("mask", "mdm", "digression"):
        np.testing.assert_array_equal(getattr(found, name), getattr(given, name))
    mask = np.asarray(found.mask)
    assert mask[46:59, 2].all()
    assert not np.delete(mask, 2, axis=1).any()
    assert not mask[:36].any()
    assert not mask[69:].any()
    assert not np.asarray(detect_errors(pacing(0, 100), context).mask).any()
    unlike = detect_errors(drifting, context, levels=[levels_of(9.0, 9.0, 9.0)])
    assert not np.asarray(unlike.mask).any()


def test_jumps_are_measured_by_what_is_usual():
    """Twice the second largest of the context, from 0.42 to 0.7 rad."""
    spike = turned(pacing(0, 60), 2, [30], [0.6, 0, 0])
    pair = pairs_of(spike)
    assert 0.5 < pair[30, 2] < 0.69
    for jumps, level in (
        ([0.1], 0.42),
        ([0.34], 0.68),
        ([0.9, 0.1], 0.42),
        ([0.9, 0.27, 0.1], 0.54),
        ([0.9, 0.9], 0.7),
    ):
        usual = [levels_of(9.0, 9.0, x) for x in jumps]
        found = detect_errors(spike, levels=usual)
        np.testing.assert_array_equal(found.by["jump"], pair > level)
        np.testing.assert_array_equal(found.mask, pair > level)
        wanted = 1 - 0.5 ** ((pair[30, 2] / level) ** 2)
        if pair[30, 2] > level:
            np.testing.assert_allclose(found.mdm[30, 2], wanted, atol=1e-3)


def test_steps_that_are_not_taken_back():
    """Of more than 0.7 rad, or both 0.42 rad and 40 rad/s: a tenth of a second about them."""
    silent = [levels_of(9.0, 9.0)]
    for size, rate, about in ((0.9, 24.0, 2), (0.5, 24.0, 0), (0.5, 120.0, 12), (0.4, 120.0, 0)):
        motion = pacing(0, 80, rate=rate)
        # The joint stays turned up to the end.
        broken = turned(motion, 2, np.arange(50, 80), [size, 0, 0])
        found = np.asarray(detect_errors(broken, levels=silent).by["jump"])
        wanted = np.zeros((80, 5), bool)
        wanted[50 - about : 50 + about, 2] = True
        np.testing.assert_array_equal(found, wanted)
    # Near the ends as much as there is; one that is taken back is a pair.
    for at in (2, 78):
        broken = turned(pacing(0, 80), 2, np.arange(at, 80), [1.5, 0, 0])
        found = np.asarray(detect_errors(broken, levels=silent).by["jump"])
        np.testing.assert_array_equal(
            np.flatnonzero(found[:, 2]), np.arange(at - 2, min(at + 2, 80))
        )
    back = turned(pacing(0, 80), 2, np.arange(50, 60), [1.5, 0, 0])
    found = np.asarray(detect_errors(back, levels=silent).by["jump"])
    np.testing.assert_array_equal(np.flatnonzero(found[:, 2]), np.arange(50, 60))


@pytest.mark.parametrize(
    ("rate", "steps", "found"), [(24.0, 3, 0), (24.0, 4, 4), (120.0, 15, 0), (120.0, 16, 16)]
)
def test_holds(rate, steps, found):
    """More than an eighth of a second; not the frame that it begins from."""
    motion = pacing(0, 80, rate=rate)
    q = np.array(motion.rotations)
    q[30 : 31 + steps, 2] = q[30, 2]
    held = detect_errors(motion.with_transforms(rotations=q), levels=[levels_of(9.0, 9.0, 9.0)])
    wanted = np.zeros((80, 5), bool)
    wanted[31 : 31 + found, 2] = True
    np.testing.assert_array_equal(held.by["hold"], wanted)


def test_frames_that_are_not_there(drifting, context):
    """Are errors, of confidence 1; other joints are judged as ever."""
    q = np.array(pacing(0, 100).rotations)
    q[20:24, 3] = np.nan
    motion = pacing(0, 100).with_transforms(rotations=q)
    found = detect_errors(motion, context)
    wanted = np.zeros((100, 5), bool)
    wanted[20:24, 3] = True
    np.testing.assert_array_equal(found.by["missing"], wanted)
    np.testing.assert_array_equal(found.mask, wanted)
    np.testing.assert_array_equal(np.asarray(found.mdm)[20:24, 3], 1)
    assert np.isfinite(found.mdm).all()
    assert np.isfinite(found.digression).all()
    (run,) = found.runs
    assert (run.start, run.stop, run.joints, run.confidence) == (20, 24, ("leg",), 1)
    assert run.detectors == ("missing",)
    assert found.motion is motion


def test_the_context_may_have_gaps(drifting, context):
    q = np.array(context[0].rotations)
    q[20:24, 3] = np.nan
    found = detect_errors(drifting, [context[0].with_transforms(rotations=q), context[1]])
    assert np.asarray(found.mask)[46:59, 2].all()


def test_runs():
    """Frames on end with any joint in error, and what was found in them."""
    motion = turned(pacing(0, 100), 2, np.arange(20, 26), [1.0, 0, 0])
    motion = turned(motion, 4, np.arange(24, 30), [0, 1.0, 0])
    motion = turned(motion, 1, [60], [0, 0, 1.0])
    found = detect_errors(motion, pacing(1, 70), levels=[levels_of()])
    one, two = found.runs
    assert (one.start, one.stop, one.joints) == (20, 30, ("arm", "foot"))
    assert (two.start, two.stop, two.joints) == (60, 61, ("spine",))
    assert one.detectors == ("digression", "jump")
    assert 0.8 < one.size < 1.4
    mask, mdm = np.asarray(found.mask), np.asarray(found.mdm)
    assert one.confidence == mdm[20:30][mask[20:30]].max()
    assert (mdm[mask].min(), mdm[~mask].max()) > (0, 0)
    assert 0.5 < two.confidence <= 1
    assert repr(found) == "DetectedErrors(100 frames, 5 joints)"


def test_where_it_faces_and_the_sign_do_not_matter(drifting, context):
    wanted = detect_errors(drifting, context, k=3)
    q = np.array(drifting.rotations)
    q[:, 0] = np.asarray(jm.quaternion.multiply(jm.quaternion.exp(np.array([0, 2.0, 0])), q[:, 0]))
    q[::3] *= -1
    there = np.asarray(drifting.translations) + np.array([4.0, 0, 4])
    found = detect_errors(drifting.with_transforms(there, q), context, k=3)
    np.testing.assert_array_equal(found.mask, wanted.mask)
    np.testing.assert_allclose(found.mdm, wanted.mdm, atol=1e-6)


def test_float32(drifting, context):
    wanted = detect_errors(drifting, context, k=3)
    single = [x.astype(np.float32) for x in (drifting, *context)]
    found = detect_errors(single[0], single[1:], k=3)
    assert found.mdm.dtype == found.digression.dtype == np.float32
    np.testing.assert_allclose(found.mdm, wanted.mdm, atol=1e-3)
    assert (np.asarray(found.mask) != np.asarray(wanted.mask)).sum() <= 1


def test_a_sample():
    """An offset that begins and ends at an edge: found, and next to nothing else."""
    walk = jm.samples.load("walk", fps=24.0, num_frames=96).motion
    assert not np.asarray(detect_errors(walk).mask).any()
    broken = jm.samples.offset_joints(walk, jax.random.key(0), runs=1)
    before = np.array(broken.motion.rotations)
    found = detect_errors(broken.motion)
    scores = jm.metrics.detection_scores(found.mask, broken.mask)
    assert scores.entry_recall > 0.95
    assert scores.entry_precision > 0.8
    np.testing.assert_array_equal(broken.motion.rotations, before)


@pytest.mark.parametrize("rate", [24.0, 120.0])
@pytest.mark.parametrize("frames", [1, 2, 3, 5, 14, 16])
def test_few_frames(frames, rate):
    """Nothing is found, and nothing fails."""
    motion = swaying(0, frames, rate=rate, size=0.1)
    found = detect_errors(motion, swaying(1, 40, rate=rate))
    assert found.mask.shape == (frames, 5)
    assert not found.mask.any()
    assert found.runs == ()
    q = np.array(motion.rotations)
    q[0, 1] = np.nan
    found = detect_errors(motion.with_transforms(rotations=q))
    np.testing.assert_array_equal(np.argwhere(found.mask), [[0, 1]])


def test_one_joint():
    motion = pacing(0, 80)
    single = jm.Skeleton(["hips"], [-1], np.zeros((1, 3)))
    alone = jm.Motion(single, motion.translations[:, :1], motion.rotations[:, :1], 1 / 24)
    assert not detect_errors(alone).mask.any()
    found = detect_errors(turned(alone, 0, np.arange(30, 36), [1.5, 0, 0]))
    np.testing.assert_array_equal(np.flatnonzero(found.mask), np.arange(30, 36))


def test_what_is_usual_of_no_clips():
    usual = _Usual.of([], 3)
    np.testing.assert_array_equal(usual, np.zeros((3, 3)))


def test_what_is_wrong_is_said(context):
    motion = pacing(0, 40)
    for passes in (0, -1):
        with pytest.raises(ValueError, match="detect_errors: passes="):
            detect_errors(motion, passes=passes)
    with no_shape_checks():
        with pytest.raises(ValueError, match=r"passes=1\.5"):
            detect_errors(motion, passes=1.5)
        with pytest.raises(ValueError, match="Motion"):
            detect_errors("walk")
    with pytest.raises(ValueError, match="k=0"):
        detect_errors(motion, k=0)
    with pytest.raises(ValueError, match="5 joints"):
        detect_errors(motion, levels=[Levels(*(jnp.zeros(3),) * 3)])
    with pytest.raises(ValueError, match="other joints"):
        detect_errors(motion, swaying(0, names=("a", "b", "c", "d", "e")))
    with pytest.raises(ValueError, match="traced"):
        jax.jit(lambda m: detect_errors(m).mask)(motion)
    with pytest.raises(ValueError, match="one clip at a time"):
        detect_errors(jm.stack([motion, motion])[0])


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_errors_of_some_confidence_by_hand(dtype):
    """A joint's frames on end stay whole or go whole, by the surest of them."""
    runs = {(2, 5, 0): 0.55, (4, 9, 1): 0.9, (9, 12, 0): 0.8, (20, 22, 1): 0.799, (30, 31, 3): 1.0}
    mask, mdm = np.zeros((40, 5), bool), np.full((40, 5), 0.3, dtype)
    for (start, stop, joint), sure in runs.items():
        mask[start:stop, joint] = True
        mdm[(start + stop) // 2, joint] = sure
    by = {"digression": mask & (np.arange(5) < 2), "jump": mask & (np.arange(5) > 0)}
    found = DetectedErrors(mask, mdm, mdm, by, pacing(0, 40))
    for least in (0, 0.3, 0.55, 0.6, 0.8, 0.85, 1):
        wanted = np.zeros((40, 5), bool)
        for (start, stop, joint), sure in runs.items():
            wanted[start:stop, joint] = np.asarray(sure, dtype) >= np.asarray(least, dtype)
        kept = found.at_least(least)
        np.testing.assert_array_equal(kept.mask, wanted)
        for name, told in by.items():
            np.testing.assert_array_equal(kept.by[name], told & wanted)
        np.testing.assert_array_equal(kept.mdm, mdm)
        assert kept.motion is found.motion
        assert all(run.confidence >= np.asarray(least, dtype) for run in kept.runs)
    assert found.mask is mask


@pytest.mark.parametrize("number", [-0.1, 1.1, float("nan"), np.ones(2)])
def test_a_confidence_that_is_none(drifting, number):
    none = np.zeros((40, 5))
    found = DetectedErrors(none > 0, none, none, {}, pacing(0, 40))
    with pytest.raises(ValueError, match="at_least: confidence"):
        found.at_least(number)
    with pytest.raises(ValueError, match="repair: confidence"):
        jm.cleaning.repair(drifting, confidence=number)
