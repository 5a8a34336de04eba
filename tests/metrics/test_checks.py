"""Every kind of finding on clips made to have it, and none on clips that are clean."""

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.metrics.checks import KINDS, find_problems
from tests.helpers import quaternions_by, random_motion, scipy_rotation


def swinging(frames=60, fps=60.0, channels=None):
    """Three joints swinging smoothly; the root glides."""
    skeleton = jm.Skeleton(
        ["Hips", "Arm", "Hand"],
        [-1, 0, 1],
        np.array([[0.0, 0, 0], [0, 5, 0], [3, 0, 0]]),
        channels=channels,
    )
    t = np.arange(frames)[:, None, None] / fps
    vectors = 0.5 * np.sin(4 * t + np.arange(9).reshape(3, 3))
    root = np.stack([t[:, 0, 0], 9 + 0 * t[:, 0, 0], 2 * t[:, 0, 0]], -1)
    return jm.Motion.from_root(skeleton, root, quaternions_by(vectors), 1 / fps)


def changed(motion, change):
    rotations, translations = np.array(motion.rotations), np.array(motion.translations)
    change(rotations, translations)
    return motion.with_transforms(translations, rotations)


def found(motion):
    return [(p.kind, p.frame, p.last_frame, p.joint) for p in find_problems(motion)]


@pytest.mark.parametrize("fps", [24, 23.976, 30, 1 / 0.0333333, 1 / 0.0083333, 120])
def test_clean_clips_have_no_problems(fps):
    assert found(swinging(fps=fps)) == []


def test_samples_have_no_problems():
    for name in ("walk", "idle", "kick"):
        assert [p for p in find_problems(jm.samples.load(name).motion) if p.serious] == []


def test_not_a_number():
    def spoil(q, p):
        q[3:5, 1] = np.nan
        p[7, 0, 0] = np.inf

    assert found(changed(swinging(), spoil)) == [("nan", 7, 7, "Hips"), ("nan", 3, 4, "Arm")]


def test_too_short():
    assert found(swinging()[:1]) == [("empty", None, None, None)]
    assert found(swinging()[:2]) == []


@pytest.mark.parametrize("fps", [1.0, 27.0, 5000.0])
def test_unusual_rates(fps):
    motion = swinging()
    odd = jm.Motion(motion.skeleton, motion.translations, motion.rotations, 1 / fps)
    assert ("rate", None, None, None) in found(odd)


@pytest.mark.parametrize(
    ("frame_time", "words"),
    [
        (100.0, "frame time is 100 seconds; is it a rate, 100 frames a second? (--fps"),
        (29.97, "frame time is 29.97 seconds; is it a rate, 29.97 frames a second?"),
        (33.3333, "frame time is 33.3333 seconds; is it milliseconds, 30 frames a second?"),
        (8.33, "frame time is 8.33 seconds; is it milliseconds, 120.05 frames a second?"),
        (1.0, "1 frames a second is unusual (--fps"),
        (1 / 27, "27 frames a second is unusual; is it 25? (--fps"),
    ],
)
def test_the_likely_rate_is_what_the_number_in_the_file_says(frame_time, words):
    motion = swinging()
    odd = jm.Motion(motion.skeleton, motion.translations, motion.rotations, frame_time)
    [message] = [p.message for p in find_problems(odd) if p.kind == "rate"]
    assert words in message


def test_duplicates_and_still_clips():
    index = np.r_[0:10, 9, 9, 9, 10:30, 29, 30:50]
    motion = swinging()
    held = motion.with_transforms(motion.translations[index], motion.rotations[index])
    assert found(held) == [("duplicate", 10, 12, None), ("duplicate", 33, 33, None)]
    still = motion.with_transforms(motion.translations[index * 0], motion.rotations[index * 0])
    assert "nothing moves" in find_problems(still)[0].message


def test_flips_are_notes():
    def negate(q, p):
        q[20:40, 2] *= -1

    motion = changed(swinging(), negate)
    assert found(motion) == [("flip", 20, 20, "Hand"), ("flip", 40, 40, "Hand")]
    assert not any(p.serious for p in find_problems(motion))


def test_jumps():
    half_turn = np.array([0.0, 0.0, 1.0, 0.0])

    def turn(q, p):
        q[30:, 1] = np.asarray(jm.quaternion.multiply(q[30:, 1], half_turn))

    problems = [p for p in find_problems(changed(swinging(), turn)) if p.kind == "jump"]
    assert [(p.frame, p.joint) for p in problems] == [(30, "Arm")]
    assert "turns 17" in problems[0].message


def test_spikes_of_rotation_and_root():
    def spike(q, p):
        q[25, 2] = np.asarray(jm.quaternion.multiply(q[25, 2], jm.quaternion.exp(np.eye(3)[1])))
        p[40, 0, 1] += 1.0

    motion = changed(swinging(), spike)
    assert found(motion) == [("spike", 25, 25, "Hand"), ("spike", 40, 40, "Hips")]
    assert "57°" in find_problems(motion)[0].message


def test_a_rest_pose_in_front():
    def rest(q, p):
        q[0] = [1, 0, 0, 0]
        q[0, 1] = np.asarray(jm.quaternion.exp(np.array([0.0, 0.0, 1.5])))

    [problem] = find_problems(changed(swinging(), rest))
    assert (problem.kind, problem.frame) == ("first", 0)
    assert "Arm" in problem.message


def test_gimbal_lock_is_a_note():
    angles = np.zeros((60, 3, 3))
    angles[:, 2, 1] = np.radians(np.linspace(60, 100, 60))
    motion = swinging(channels=[["Zrotation", "Xrotation", "Yrotation"]] * 3)
    rotations = jm.quaternion.from_euler(angles, "ZXY")
    locked = find_problems(motion.with_transforms(rotations=rotations))
    [gimbal] = [p for p in locked if p.kind == "gimbal"]
    assert gimbal.joint == "Hand"
    frames = np.flatnonzero(np.abs(angles[:, 2, 1] - np.pi / 2) < np.radians(2))
    assert (gimbal.frame, gimbal.last_frame) == (frames[0], frames[-1])
    assert not gimbal.serious


def test_kinds_are_listed():
    assert set(KINDS) >= {"nan", "empty", "rate", "duplicate", "flip", "jump", "spike", "gimbal"}
    assert "first" in KINDS


def test_float32():
    assert found(swinging().astype(np.float32)) == []


def kinds(motion):
    return jm.check(motion).kinds


def test_check_names_wrong_conventions():
    walk = jm.samples.load("walk", num_frames=60).motion
    q = np.asarray(walk.rotations)
    assert not jm.check(walk)
    assert str(jm.check(walk)) == "nothing found"

    def turned(rotations):
        return walk.with_transforms(rotations=jax.numpy.asarray(rotations))

    assert kinds(turned(np.roll(q, -1, -1))) == ("order",)
    assert kinds(turned(2 * q)) == ("norm",)
    assert kinds(walk.replace(frame_time=jax.numpy.asarray(30.0))) == ("rate",)
    angles = scipy_rotation(q).as_euler("ZXY", degrees=True)
    wild = jm.quaternion.from_euler(angles.reshape(*q.shape[:-1], 3))
    assert "degrees" in kinds(turned(wild))
    assert kinds(walk.astype(jax.numpy.bfloat16))[0] == "dtype"
    mixed = walk.with_transforms(rotations=q.astype(np.float32))
    assert kinds(mixed) == ("dtype",)
    assert kinds(turned(np.roll(q, -1, -1))[:1]) == ("order", "empty")


def test_single_rotations_that_are_none_are_told_by_joint_and_frame():
    def spoil(q, p):
        q[10:13, 1] *= 3
        q[40, 2] = 0

    [three, none] = jm.check(changed(swinging(), spoil))
    assert (three.kind, three.joint, three.frame, three.last_frame) == ("norm", "Arm", 10, 12)
    assert (none.kind, none.joint, none.frame, none.last_frame) == ("norm", "Hand", 40, 40)
    assert "norm 3" in three.message


def test_notes_are_left_out_unless_asked_for():
    def negate(q, p):
        q[20:40, 2] *= -1

    motion = changed(swinging(), negate)
    assert jm.check(motion) == ()
    assert jm.check(motion, notes=True).kinds == ("flip",)


def test_findings_print_a_line_a_kind():
    def spoil(q, p):
        q[3:5, 1] = np.nan
        q[9, 2] = np.nan
        p[7, 0, 0] = np.inf

    text = "nan: Hips, frame 7: values that are not numbers; 2 more, in 3 joints in all"
    found = jm.check(changed(swinging(), spoil))
    assert str(found) == repr(found) == text
    assert len(found) == 3
    assert bool(found)


def test_check_takes_one_clip_that_is_known():
    batch = random_motion(np.random.default_rng(0), 4, 3, batch=(2,))
    with pytest.raises(ValueError, match=r"check: one clip at a time, got batch axes \(2,\)"):
        jm.check(batch)
    with pytest.raises(ValueError, match="check: the motion is traced"):
        jax.jit(lambda m: len(jm.check(m)))(swinging())
    with pytest.raises(ValueError, match="find_problems: the motion is traced"):
        jax.jit(lambda m: len(find_problems(m)))(swinging())
