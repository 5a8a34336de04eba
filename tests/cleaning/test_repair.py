"""Errors repaired: by hand, and what is left of those that were put into sound clips."""

import sys

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import jaxmotion as jm
from jaxmotion.cleaning import DetectedErrors, detect_errors, repair
from jaxmotion.cleaning.jumps import jumps
from jaxmotion.cleaning.levels import examined
from jaxmotion.cleaning.repair import _grown
from jaxmotion.cleaning.repair import repaired as repaired_of
from jaxmotion.cleaning.shown import METHODS
from tests.cleaning.clips import pacing, turned
from tests.cleaning.oracles import ShownByHand, median_by_hand
from tests.helpers import angle_between, assert_same_rotation, no_shape_checks
from tests.style.clips import quaternions, rotations, swaying

K = 3
RUN = np.arange(40, 52)


@pytest.fixture(scope="module")
def clean():
    return pacing(0, 90)


@pytest.fixture(scope="module")
def context():
    return [pacing(1, 60), pacing(2, 60)]


@pytest.fixture(scope="module")
def broken(clean):
    return turned(clean, 2, RUN, [1.0, 0.3, 0])


@pytest.fixture(scope="module")
def repaired(broken, context):
    return repair(broken, context)


def masked(*runs, frames=90, joints=5):
    mask = np.zeros((frames, joints), bool)
    for start, stop, joint in runs:
        mask[start:stop, joint] = True
    return mask


def same_outside(result, motion):
    """Bit for bit, in the motion's dtype."""
    keep = ~np.asarray(result.mask)
    assert result.motion.dtype == motion.dtype
    for name in ("rotations", "translations"):
        new, old = (np.asarray(getattr(x, name)) for x in (result.motion, motion))
        np.testing.assert_array_equal(new[keep], old[keep])
    np.testing.assert_array_equal(result.motion.translations, motion.translations)
    assert float(result.motion.frame_time) == float(motion.frame_time)


def test_found_and_repaired(clean, broken, repaired):
    before = angle_between(broken.rotations, clean.rotations)[RUN, 2]
    after = angle_between(repaired.motion.rotations, clean.rotations)
    assert after[RUN, 2].mean() < 0.12 * before.mean()
    assert after.max() < 0.2
    mask = np.asarray(repaired.mask)
    np.testing.assert_array_equal(np.flatnonzero(mask[:, 2]), RUN)
    assert mask.sum() == len(RUN)
    same_outside(repaired, broken)
    assert repaired.before is broken
    assert np.asarray(repaired.errors.mask)[RUN, 2].all()
    np.testing.assert_allclose(np.linalg.norm(repaired.motion.rotations, axis=-1), 1, atol=1e-9)


def test_runs(broken, repaired):
    (run,) = repaired.runs
    assert (run.start, run.stop, run.joints) == (40, 52, ("arm",))
    change = angle_between(broken.rotations, repaired.motion.rotations)
    assert run.change == pytest.approx(change.max())
    leap = jumps(np.asarray(broken.rotations))[:, 2]
    assert run.jump_before == pytest.approx(leap[39:52].max())
    assert run.jump_before > 0.8
    assert run.jump_after < 0.2
    assert repr(repaired).startswith("Repaired(90 frames, 3.75 s at 24 fps, 5 joints")


def test_nothing_in_error(clean, context):
    """Gives the same clip."""
    result = repair(clean, context)
    assert result.motion is clean
    assert not result.mask.any()
    assert result.runs == ()
    result = repair(clean, mask=np.zeros((90, 5), bool))
    assert result.motion is clean
    assert result.errors is None


def put_back_by_hand(motion, by_hand, joint, start, stop):
    """What all neighbours show, turned to meet the frames beside; of a joint that is not the
    body's, whose lean and rotation are the same."""
    there = range(max(start - 1, 0), min(stop + 1, motion.num_frames))
    shown = {t: median_by_hand(by_hand(t, joint)) for t in there}
    q = np.asarray(motion.rotations)[:, joint]
    ends = [
        (rotations(shown[t]).inv() * rotations(q[t])).as_rotvec()[0]
        for t, inside in ((start - 1, start > 0), (stop, stop < motion.num_frames))
        if inside
    ]
    made = []
    for t in range(start, stop):
        e = np.zeros(3)
        if len(ends) == 2:
            e = ends[0] + (t - start + 1) / (stop - start + 1) * (ends[1] - ends[0])
        elif ends:
            e = ends[0]
        made.append(quaternions(rotations(shown[t]) * Rotation.from_rotvec(e))[0])
    return np.array(made)


def test_put_back_by_hand(broken, context):
    """In a run, at both ends of the clip, and of all of it; its own entries in error left out."""
    for runs in [(40, 52, 2), (0, 5, 3), (84, 90, 1)], [(0, 90, 4)]:
        wrong = masked(*runs)
        result = repair(broken, context, mask=wrong, k=K)
        np.testing.assert_array_equal(result.mask, wrong)
        same_outside(result, broken)
        assert result.errors is None
        by_hand = ShownByHand(broken, context, K, wrong)
        for start, stop, joint in runs:
            wanted = put_back_by_hand(broken, by_hand, joint, start, stop)
            assert_same_rotation(result.motion.rotations[start:stop, joint], wanted, 1e-6)


@pytest.mark.parametrize("method", ["median", "medoid", "nearest_end"])
@pytest.mark.parametrize("blend", ["residual", "savgol"])
def test_methods_and_blends(clean, broken, context, method, blend):
    """All come near to what was; the filter takes four frames more on either side."""
    mask = masked((40, 52, 2))
    given = np.array(mask)
    result = repair(broken, context, mask=mask, method=method, blend=blend)
    wide = masked((36, 56, 2)) if blend == "savgol" else mask
    np.testing.assert_array_equal(result.mask, wide)
    np.testing.assert_array_equal(mask, given)
    same_outside(result, broken)
    after = angle_between(result.motion.rotations, clean.rotations)
    assert after[RUN, 2].mean() < 0.15
    assert after.max() < 0.3
    if blend == "residual":
        assert jumps(np.asarray(result.motion.rotations))[36:56, 2].max() < 0.2


def test_float32_and_what_was_given(broken, context, repaired):
    single = broken.astype(np.float32)
    before = np.array(single.rotations)
    result = repair(single, [x.astype(np.float32) for x in context])
    same_outside(result, single)
    np.testing.assert_array_equal(single.rotations, before)
    np.testing.assert_array_equal(result.mask, repaired.mask)
    assert_same_rotation(result.motion.rotations, repaired.motion.rotations, 1e-3)


def test_place_yaw_and_signs_do_not_matter(broken, context):
    mask = masked((40, 52, 2), (40, 48, 0))
    wanted = repair(broken, context, mask=mask).motion
    turn = Rotation.from_rotvec([0, 1.2, 0])
    q = np.array(broken.rotations)
    q[:, 0] = quaternions(turn * rotations(q[:, 0]))
    q[::3] *= -1
    there = np.asarray(broken.translations) + np.array([4.0, 0, 1])
    moved = broken.with_transforms(there, q)
    found = np.array(repair(moved, context, mask=mask).motion.rotations)
    found[:, 0] = quaternions(turn.inv() * rotations(found[:, 0]))
    assert_same_rotation(found, np.asarray(wanted.rotations), 1e-6)


def test_the_body_faces_between(clean, context):
    """Its lean is put back, its yaw goes from the frame before to the one after."""
    yaw = Rotation.from_rotvec(np.linspace(0, 2, 90)[:, None] * np.array([0, 1, 0]))
    q = np.array(clean.rotations)
    q[:, 0] = quaternions(yaw * rotations(q[:, 0]))
    sound = clean.with_transforms(rotations=q)
    wrong = turned(sound, 0, RUN, [0.7, 0.9, 0])
    result = repair(wrong, context, mask=masked((40, 52, 0)))
    after = angle_between(result.motion.rotations, sound.rotations)
    assert angle_between(wrong.rotations, sound.rotations)[RUN, 0].min() > 1
    assert after[RUN, 0].max() < 0.45
    same_outside(result, wrong)


def test_joint_mask(broken, context):
    """What may not be changed is not, found or given."""
    free = np.arange(5) != 2
    result = repair(broken, context, joint_mask=free)
    assert result.motion is broken
    assert result.errors.mask.any()
    result = repair(broken, context, mask=masked((40, 52, 2), (60, 66, 3)), joint_mask=free)
    np.testing.assert_array_equal(result.mask, masked((60, 66, 3)))
    same_outside(result, broken)


def test_frames_that_are_not_there(clean, broken, context):
    """Come back, whether the mask says so or not; where they may not, they stay away."""
    q, there = np.array(broken.rotations), np.array(broken.translations)
    q[20:26, 3] = np.nan
    there[70, 1] = np.inf
    gaps = broken.with_transforms(there, q)
    result = repair(gaps, context, mask=masked((40, 52, 2)))
    np.testing.assert_array_equal(result.mask, masked((40, 52, 2), (20, 26, 3), (70, 71, 1)))
    assert np.isfinite(result.motion.rotations).all()
    np.testing.assert_allclose(result.motion.translations, clean.translations, atol=1e-6)
    assert angle_between(result.motion.rotations, clean.rotations).max() < 0.2
    assert len(result.runs) == 3
    found = repair(gaps, context)
    assert np.isfinite(found.motion.rotations).all()
    assert np.asarray(found.mask)[20:26, 3].all()
    held = repair(gaps, context, mask=masked((40, 52, 2)), joint_mask=np.arange(5) != 3)
    lost = np.isnan(np.asarray(held.motion.rotations))
    np.testing.assert_array_equal(lost.any(axis=-1), masked((20, 26, 3)))


def test_joints_that_tell_nothing(context):
    """And what nothing is shown of go the short way between the run's ends."""
    fixed = pacing(0, 90).rotations[:1]
    still, *others = (
        x.with_transforms(
            rotations=np.where(np.arange(5)[:, None] == 3, fixed, np.asarray(x.rotations))
        )
        for x in (pacing(0, 90), *context)
    )
    wrong = turned(still, 3, RUN, [1.0, 0, 0])
    result = repair(wrong, others, mask=masked((40, 52, 3)))
    assert_same_rotation(result.motion.rotations[:, 3], still.rotations[:, 3], 1e-7)
    short = swaying(0, 12)
    result = repair(short, mask=masked((4, 8, 2), frames=12))
    line = Slerp([3, 8], rotations(short.rotations[[3, 8], 2]))
    assert_same_rotation(result.motion.rotations[3:9, 2], quaternions(line(range(3, 9))), 1e-7)
    same_outside(result, short)


def test_a_clip_that_stands_still():
    stands = pacing(0, 40)
    stands = stands.with_transforms(rotations=np.repeat(stands.rotations[:1], 40, axis=0))
    wrong = turned(stands, 2, np.arange(10, 20), [0.001, 0, 0])
    for method in ("median", "nearest_end"):
        result = repair(wrong, mask=masked((10, 20, 2), frames=40), method=method)
        assert_same_rotation(result.motion.rotations, np.asarray(stands.rotations), 1e-7)


def test_other_rates(context):
    """A clip at 120 frames a second beside a context at 24."""
    clean = pacing(0, 400, rate=120.0)
    wrong = turned(clean, 2, np.arange(200, 250), [1.0, 0, 0])
    result = repair(wrong, context)
    mask = np.asarray(result.mask)
    np.testing.assert_array_equal(mask, masked((200, 250, 2), frames=400))
    same_outside(result, wrong)
    assert angle_between(result.motion.rotations, clean.rotations).max() < 0.2
    assert jumps(np.asarray(result.motion.rotations))[:, 2].max() < 0.05


@pytest.mark.parametrize("frames", [1, 2, 3, 14, 20])
@pytest.mark.parametrize("blend", ["residual", "savgol"])
def test_few_frames(frames, blend):
    motion = swaying(1, frames)
    mask = masked((frames // 2, frames // 2 + 1, 2), frames=frames)
    for method in ("median", "nearest_end"):
        result = repair(motion, mask=mask, method=method, blend=blend)
        assert np.isfinite(result.motion.rotations).all()
        same_outside(result, motion)
        everything = repair(motion, mask=~masked(frames=frames), method=method, blend=blend)
        np.testing.assert_allclose(np.linalg.norm(everything.motion.rotations, axis=-1), 1)
    if frames < 20:
        assert repair(motion).motion is motion


def test_ends_of_runs_move_to_the_jumps_near_by(clean):
    """To the largest within a tenth of a second, if that is above 0.1 rad; else by a frame."""
    leap = jumps(np.asarray(turned(clean, 2, RUN, [1.0, 0, 0]).rotations))
    grown = _grown(masked((41, 50, 2)), leap, 24.0)
    np.testing.assert_array_equal(grown, masked((40, 52, 2)))
    # Too far away: two frames at 24 frames a second.
    np.testing.assert_array_equal(_grown(masked((43, 49, 2)), leap, 24.0), masked((42, 50, 2)))
    # A mask does not shrink, and stays within the clip.
    np.testing.assert_array_equal(_grown(masked((39, 53, 2)), leap, 24.0), masked((39, 53, 2)))
    ends = masked((0, 3, 1), (88, 90, 1))
    np.testing.assert_array_equal(_grown(ends, leap, 24.0), masked((0, 4, 1), (87, 90, 1)))


def test_planted_points_come_back():
    """Within a thousandth of the figure; a joint that may not move does not, nor what is lost."""
    walk = jm.samples.load("walk", fps=24.0, num_frames=72).motion.astype(np.float64)
    contacts = jm.contacts.detect(walk, joints=["LeftFoot", "RightFoot"])
    leg = walk.skeleton.index("LeftUpLeg")
    held = np.flatnonzero(np.asarray(contacts.mask)[:, 0])
    frames = held[(held > 12) & (held < 64)][:8]
    frames = np.arange(frames[0] - 3, frames[-1] + 1)
    mask = masked((frames[0], frames[-1] + 1, leg), frames=72, joints=22)
    broken = turned(walk, leg, frames, [0.8, 0, 0])
    plain = repair(broken, mask=mask).motion
    result = repair(broken, mask=mask, contacts=contacts)
    same_outside(result, broken)
    planted = np.asarray(contacts.mask) & mask.any(axis=1)[:, None] & np.array([True, False])
    away = [
        np.linalg.norm(np.asarray(contacts.points.positions(x) - contacts.target), axis=-1)[planted]
        for x in (plain, result.motion)
    ]
    size = float(np.linalg.norm(walk.skeleton.offsets, axis=-1).sum())
    assert planted.sum() >= 4
    assert away[1].max() < 1e-3 * size
    assert away[1].max() < 0.1 * away[0].max()
    extra = np.asarray(result.mask) & ~mask
    assert set(np.flatnonzero(extra.any(axis=0))) <= {leg + 1, leg + 2}
    # The hips are lost for a while, and may not be changed: legs stay finite.
    q = np.array(broken.rotations)
    q[frames[2:4], 0] = np.nan
    lost = broken.with_transforms(rotations=q)
    free = np.arange(22) != 0
    result = repair(lost, mask=mask, contacts=contacts, joint_mask=free)
    gone = np.isnan(np.asarray(result.motion.rotations)).any(axis=-1)
    np.testing.assert_array_equal(gone, masked((frames[2], frames[4], 0), frames=72, joints=22))


def test_the_method_that_stands_best(monkeypatch):
    """Before the limb is brought back."""
    walk = jm.samples.load("walk", fps=24.0, num_frames=72).motion.astype(np.float64)
    contacts = jm.contacts.detect(walk, joints=["LeftFoot", "RightFoot"])
    leg = walk.skeleton.index("LeftUpLeg")
    mask = masked((30, 48, leg), frames=72, joints=22)
    broken = turned(walk, leg, np.arange(30, 48), [0.8, 0, 0])
    made = {x: repair(broken, mask=mask, method=x).motion for x in METHODS}
    held = np.asarray(contacts.mask) & mask.any(axis=1)[:, None] & np.array([True, False])
    assert held.any()
    away = {
        name: np.linalg.norm(contacts.points.positions(x) - contacts.target, axis=-1)[held].sum()
        for name, x in made.items()
    }
    best = min(away, key=lambda name: away[name])
    assert len(set(away.values())) == 3
    room = sys.modules["jaxmotion.cleaning.repair"]
    monkeypatch.setattr(room, "planted_again", lambda motion, contacts, mask, free: (motion, mask))
    for method in METHODS:
        found = repair(broken, mask=mask, contacts=contacts, method=method)
        np.testing.assert_array_equal(found.motion.rotations, made[best].rotations)


def test_progress(clean):
    told = []
    repair(clean, mask=masked((40, 52, 2)), progress=lambda *x: told.append(x))
    assert told[-1][0] == told[-1][1]
    assert told == sorted(told)


def test_what_is_wrong_is_said(clean, broken):
    for mask in (np.zeros((90, 4), bool), np.zeros(90, bool), np.zeros((89, 5), bool)):
        with pytest.raises(ValueError, match="repair: mask has shape"):
            repair(clean, mask=mask)
    with pytest.raises(ValueError, match="repair: joint_mask has shape"):
        repair(clean, joint_mask=np.ones(4, bool))
    with no_shape_checks():
        with pytest.raises(ValueError, match="method"):
            repair(clean, method="mean")
        with pytest.raises(ValueError, match="blend"):
            repair(clean, blend="none")
        with pytest.raises(ValueError, match="repair: motion is a str"):
            repair("walk")
    with pytest.raises(ValueError, match="other joints"):
        repair(clean, swaying(0, names=("a", "b", "c", "d", "e")))
    with pytest.raises(ValueError, match="repair: motion is traced"):
        jax.jit(lambda m: repair(m).motion.rotations)(clean)
    with pytest.raises(ValueError, match="one clip at a time"):
        repair(jm.stack([clean, clean])[0])
    contacts = jm.contacts.detect(clean[:40], joints=["foot"])
    with pytest.raises(ValueError, match="repair"):
        repair(broken, mask=masked((40, 52, 2)), contacts=contacts)


def test_errors_of_little_confidence_stay(broken, context):
    """Bit for bit; the others are repaired as if those had not been found."""
    both = turned(broken, 3, np.arange(62, 72), [0.5, 0, 0])
    arm, leg = sorted(detect_errors(both, context).runs, key=lambda run: run.start)
    assert (arm.joints, leg.joints) == (("arm",), ("leg",))
    assert leg.confidence < arm.confidence
    done = repair(both, context, confidence=(leg.confidence + arm.confidence) / 2)
    np.testing.assert_array_equal(done.mask, masked((40, 52, 2)))
    same_outside(done, both)
    every = repair(both, context)
    assert np.asarray(every.mask)[62:72, 3].all()
    for name in ("mask", "mdm"):  # all that was found is told
        np.testing.assert_array_equal(getattr(done.errors, name), getattr(every.errors, name))
    for least in (0.0, leg.confidence):
        again = repair(both, context, confidence=least)
        np.testing.assert_array_equal(again.motion.rotations, every.motion.rotations)
    assert repair(both, context, confidence=1.0).motion is both


def test_what_is_repaired_does_not_grow_into_what_stays(clean, context):
    """The jump at the end of the error lies beyond a frame that is left."""
    motion = turned(clean, 2, np.arange(40, 54), [1.0, 0.3, 0])
    mask, mdm = masked((40, 52, 2), (53, 56, 2)), np.full((90, 5), 0.4)
    mdm[45, 2], mdm[54, 2] = 0.9, 0.6
    errors = DetectedErrors(mask, mdm, mdm, {"jump": mask}, motion)
    evidence = examined("repair", motion, context, K, None)
    ways = evidence, motion, errors, None, np.ones(5, bool)
    np.testing.assert_array_equal(
        np.flatnonzero(_grown(masked((40, 52, 2)), evidence.jump, 24.0)[:, 2]), np.arange(40, 54)
    )
    done = repaired_of(*ways, confidence=0.8)
    np.testing.assert_array_equal(done.mask, masked((40, 53, 2)))
    same_outside(done, motion)
    assert np.asarray(repaired_of(*ways).mask)[40:56, 2].all()
