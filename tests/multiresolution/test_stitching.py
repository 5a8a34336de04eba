"""Clips joined: what stays, what meets, where the cut falls, and real walks without a seam."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion import quaternion
from jaxmotion.multiresolution import best_cut, follow, stitch
from tests.helpers import assert_same_rotation, hung, no_shape_checks, random_motion
from tests.multiresolution.oracles import swaying


@pytest.fixture(scope="module")
def clips():
    return swaying(23, seed=0), swaying(23, seed=1)


def test_only_the_seam_changes(clips):
    """33 + 33 frames, 2 levels: 5 frames of the base."""
    a, b = swaying(33, seed=0), swaying(33, seed=1)
    got = stitch([a, b], 2, align=False)
    assert got.num_frames == 65
    assert_same_rotation(got.rotations[:17], a.rotations[:17])
    assert_same_rotation(got.rotations[-17:], b.rotations[-17:])
    np.testing.assert_allclose(got.translations[:17], a.translations[:17], atol=1e-12)
    root = np.asarray(b.root_positions)
    np.testing.assert_allclose(got.root_positions[-17:], root[-17:], atol=1e-12)
    bare = stitch([a, b], 0, align=False)
    assert_same_rotation(bare.rotations[:32], a.rotations[:32])
    halfway = np.asarray(a.rotations[-1] + b.rotations[0] * np.sign(
        np.sum(a.rotations[-1] * b.rotations[0], -1, keepdims=True)))  # fmt: skip
    halfway = halfway / np.linalg.norm(halfway, axis=-1, keepdims=True)
    assert_same_rotation(bare.rotations[32], halfway)


def test_lengths_that_do_not_halve_and_several_clips(clips):
    a, b = clips
    got = stitch([a, b, a], 2)
    assert got.num_frames == 23 + 22 + 22
    assert_same_rotation(got.rotations[:6], a.rotations[:6])
    assert got.frame_time == a.frame_time
    assert_same_rotation(stitch([a]).rotations, a.rotations)


@pytest.mark.parametrize("frames", [39, 40, 332])
def test_what_is_far_from_the_seams_stays(frames):
    """Levels in a loop, and each compiled for its own size; 16 frames are four of the base."""
    a, b = swaying(frames, seed=0), swaying(frames, seed=1)
    got = stitch([a, b, a], 2, align=False).rotations
    assert len(got) == 3 * frames - 2
    assert_same_rotation(got[: frames - 16], a.rotations[: frames - 16])
    assert_same_rotation(got[frames + 15 : 2 * frames - 17], b.rotations[16 : frames - 16])


def test_the_second_clip_is_moved_over_the_ground(clips):
    a, b = clips
    moved = follow(a, b)
    start, end = np.asarray(moved.translations)[0, 0], np.asarray(a.translations)[-1, 0]
    np.testing.assert_allclose(start[[0, 2]], end[[0, 2]], atol=1e-13)
    np.testing.assert_allclose(
        np.asarray(moved.translations)[:, 0, 1], np.asarray(b.translations)[:, 0, 1], atol=1e-13
    )
    turn = Rotation.from_quat(np.asarray(moved.rotations)[:, 0], scalar_first=True)
    before = Rotation.from_quat(np.asarray(b.rotations)[:, 0], scalar_first=True)
    yaw = (turn * before.inv()).as_rotvec()
    np.testing.assert_allclose(yaw - yaw[0], 0, atol=1e-12)
    np.testing.assert_allclose(yaw[0][[0, 2]], 0, atol=1e-12)
    away = Rotation.from_euler("Y", 1.0)
    root = away.apply(np.array(b.translations)[:, 0]) + np.array([3.0, 0, -2])
    rotations = np.array(b.rotations)
    rotations[:, 0] = (away * before).as_quat(scalar_first=True)
    translations = np.array(b.translations)
    translations[:, 0] = root
    elsewhere = b.with_transforms(translations, rotations)
    here, there = stitch([a, b], 2), stitch([a, elsewhere], 2)
    assert_same_rotation(here.rotations, there.rotations)
    np.testing.assert_allclose(here.translations, there.translations, atol=1e-12)


@pytest.mark.parametrize("search", [0, 6])
def test_joints_above_the_hips_make_no_difference(clips, search):
    """What is stitched does not depend on coordinates, so neither on where such a joint is."""
    a, b = clips
    want = stitch([a, b], 2, search=search)
    got = stitch([hung(a), hung(b, tilt=-0.7)], 2, search=search)
    assert got.num_frames == want.num_frames
    np.testing.assert_allclose(got.rotations[:, :1] - got.rotations[:1, :1], 0, atol=1e-12)
    np.testing.assert_allclose(got.translations[:, 0] - got.translations[0, 0], 0, atol=1e-12)
    joints = jm.forward_kinematics(want).positions
    np.testing.assert_allclose(jm.forward_kinematics(got).positions[:, 1:], joints, atol=1e-9)


def test_the_cut_is_where_the_clips_agree():
    whole = swaying(40)
    first, second = whole[:25], whole[15:]
    end, start = best_cut(first, second, 9)
    assert (25 - end) - 1 == 15 + start
    assert best_cut(first, second, 0) == (0, 0)
    got = stitch([first, second], 1, align=False, search=9)
    assert got.num_frames == 40
    assert np.max(quaternion.distance(got.rotations, whole.rotations)) < 0.02
    assert best_cut(whole[:1], whole[:2], 3) in [(0, 0), (0, 1)]


def test_float32(clips):
    a, b = (jax.tree.map(lambda x: x.astype(np.float32), m) for m in clips)
    got = stitch([a, b], 2)
    assert got.rotations.dtype == got.translations.dtype == np.float32
    assert_same_rotation(got.rotations, stitch(clips, 2).rotations, 1e-5)


def test_wrong_arguments(clips):
    a, b = clips
    with pytest.raises(ValueError, match="motions is empty"):
        stitch([])
    other = random_motion(np.random.default_rng(0), 5, 2)
    with no_shape_checks(), pytest.raises(ValueError, match="different joints"):
        stitch([a, other])
    slow = jm.Motion(b.skeleton, b.translations, b.rotations, 1 / 24)
    with pytest.raises(ValueError, match="resample one"):
        stitch([a, slow])
    with pytest.raises(ValueError, match="search=-1"):
        best_cut(a, b, -1)
    with pytest.raises(ValueError, match="levels=9"):
        stitch([a, b], 9)


def rates(motion):
    """Angular speeds and accelerations, root mean squares over the joints, per frame."""
    q, h = np.asarray(motion.rotations), float(motion.frame_time)
    turns = Rotation.from_quat(q[:-1].reshape(-1, 4), scalar_first=True).inv() * Rotation.from_quat(
        q[1:].reshape(-1, 4), scalar_first=True
    )
    speed = turns.as_rotvec().reshape(len(q) - 1, -1, 3) / h
    return [np.sqrt(np.mean(np.sum(x**2, -1), -1)) for x in (speed, np.diff(speed, axis=0) / h)]


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("walk_normal", "walk_active"),
        ("walk_active", "walk_angry"),
        ("walk_happy", "walk_masculinity"),
        ("walk_old", "walk_proud"),
        ("walk_normal", "walk-left_normal"),
    ],
)
def test_real_walks_join_without_a_seam(data_dir, first, second):
    """Within ¼ s of the seam no faster and no more accelerated than the clips are in 95 frames of
    100; put end to end they are far more. Cropped about the cut, so that all pairs share a
    program."""
    a, b = (jm.load(data_dir / "bandai" / f"{name}_001.bvh") for name in (first, second))
    end, start = best_cut(a, b, 15)
    x, y = a[a.num_frames - end - 65 : a.num_frames - end], b[start : start + 65]
    got = stitch([x, y])
    moved = follow(a, b)
    apart = a.with_transforms(
        np.concatenate([a.translations, moved.translations]),
        np.concatenate([a.rotations, moved.rotations]),
    )
    pairs = zip(rates(got), rates(apart), rates(a), rates(b), strict=True)
    for smooth, rough, own, other in pairs:
        allowed = max(np.percentile(own, 95), np.percentile(other, 95))
        assert smooth[64 - 8 : 64 + 8].max() <= allowed
        assert rough[a.num_frames - 8 : a.num_frames + 8].max() > allowed
    paths = [jm.forward_kinematics(clip).positions[:, a.body_joint] for clip in (got, a, b)]
    steps = [np.linalg.norm(np.diff(path, axis=0), axis=-1) for path in paths]
    assert steps[0].max() <= 1.1 * max(steps[1].max(), steps[2].max())


def test_errors_name_the_function_that_was_called():
    clip, other = swaying(9), swaying(9, joints=2)
    batch = jax.tree.map(lambda x: np.stack([x, x]), clip)
    calls = {
        "stitch": lambda a, b: stitch([a, b]),
        "follow": follow,
        "best_cut": lambda a, b: best_cut(a, b, 1),
    }
    for name, call in calls.items():
        with no_shape_checks():
            with pytest.raises(ValueError, match=f"{name}: the clips have different joints"):
                call(clip, other)
            for pair in ((clip, batch), (batch, clip)):
                with pytest.raises(ValueError, match=f"{name}: one clip at a time for"):
                    call(*pair)
        with pytest.raises(ValueError, match=f"{name}: the clips must have one frame time"):
            call(clip, clip.replace(frame_time=2 * clip.frame_time))
    for bad in (-1, 1.5):
        with no_shape_checks():
            with pytest.raises(ValueError, match=f"best_cut: search={bad}; expected a whole"):
                best_cut(clip, clip, bad)
            for clips in ([clip], [clip, clip]):
                with pytest.raises(ValueError, match=f"stitch: search={bad}; expected a whole"):
                    stitch(clips, search=bad)
    with pytest.raises(ValueError, match="stitch: levels=9"):
        stitch([clip], 9)


def test_a_cut_is_not_searched_in_traced_clips():
    clip = swaying(9)

    def at(frame_time):
        return clip.replace(frame_time=frame_time)

    for name, run in {
        "best_cut": lambda h: best_cut(clip, at(h), 1),
        "stitch": lambda h: stitch([clip, at(h)], 1, search=1).rotations,
    }.items():
        with pytest.raises(ValueError, match=f"{name}: the clips are traced"):
            jax.eval_shape(run, clip.frame_time)


def test_contacts_are_those_of_the_result():
    walk = jm.samples.walk(17, fps=30.0).motion
    with pytest.raises(ValueError, match="stitch: contacts have 17 frames, the motion 33"):
        stitch([walk, walk], 1, keep_contacts=jm.contacts.detect(walk))
