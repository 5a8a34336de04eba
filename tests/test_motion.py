"""Clips: slicing, copies with other arrays, and their life as pytrees."""

import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import Motion, Skeleton, joint_weights
from tests.helpers import (
    assert_trees_close,
    no_shape_checks,
    random_motion,
    random_skeleton,
    single_precision,
)


@pytest.fixture
def motion():
    rng = np.random.default_rng(0)
    skeleton = random_skeleton(rng, 4)
    clip = random_motion(rng, 10, skeleton)
    return Motion(
        skeleton,
        clip.translations,
        clip.rotations,
        0.04,
        translated_joints=(0, 2),
        frame_time_text=".0400",
    )


def test_views(motion):
    assert len(motion) == motion.num_frames == 10
    assert motion.num_joints == 4
    assert motion.dtype == np.float64
    np.testing.assert_array_equal(motion.root_positions, motion.translations[:, 0])
    np.testing.assert_allclose(motion.fps, 25)
    np.testing.assert_allclose(motion.times, 0.04 * np.arange(10))
    np.testing.assert_allclose(motion.duration, 0.4)


@pytest.mark.parametrize(
    ("frames", "factor"),
    [
        (slice(2, 7), 1),
        (slice(None), 1),
        (slice(-3, None), 1),
        (slice(None, 100), 1),
        (slice(None, None, 3), 3),
        (slice(8, 1, -2), 2),
        (slice(None, None, -1), 1),
        (slice(4, 5), 1),
    ],
)
def test_slices_run_along_time_and_keep_the_rate(motion, frames, factor):
    part = motion[frames]
    np.testing.assert_array_equal(part.rotations, motion.rotations[frames])
    np.testing.assert_array_equal(part.translations, motion.translations[frames])
    np.testing.assert_allclose(part.frame_time, 0.04 * factor, 1e-15)
    assert part.frame_time_text == (".0400" if factor == 1 else None)
    assert part.translated_joints == (0, 2)
    assert part.skeleton is motion.skeleton


def test_one_frame_by_number(motion):
    for frame in (0, 3, -1, -10, np.int64(4)):
        part = motion[frame]
        assert part.num_frames == 1
        np.testing.assert_array_equal(part.rotations[0], motion.rotations[frame])
        np.testing.assert_allclose(part.frame_time, 0.04)
    for frame in (10, -11):
        with pytest.raises(IndexError, match=f"frame {frame} of a motion of 10 frames"):
            motion[frame]


def test_slices_that_are_refused(motion):
    for frames in (slice(5, 5), slice(20, 30), slice(7, 2)):
        with pytest.raises(ValueError, match="leaves none of the motion's 10 frames"):
            motion[frames]
    for frames in ((0, 1), "3", [1, 2], np.arange(3), 1.0, None):
        with (
            no_shape_checks(),
            pytest.raises(ValueError, match=r"sliced along time, motion\[10:90\]; got"),
        ):
            motion[frames]


def test_iteration_gives_single_frames_and_ends(motion):
    frames = list(motion)
    assert len(frames) == 10
    assert all(frame.num_frames == 1 for frame in frames)


def test_slices_of_many_clips():
    batch = random_motion(np.random.default_rng(1), 6, 3, batch=(2,))
    part = batch[1:5:2]
    assert part.rotations.shape == (2, 2, 3, 4)
    np.testing.assert_array_equal(part.rotations, batch.rotations[:, 1:5:2])
    np.testing.assert_allclose(part.frame_time, batch.frame_time * 2)
    np.testing.assert_allclose(batch.times, np.arange(6) / 30 * np.ones((2, 1)), 1e-14)


def test_with_transforms_and_astype(motion):
    other = motion.with_transforms(
        rotations=motion.rotations[:3], translations=motion.translations[:3]
    )
    assert other.num_frames == 3
    assert other.frame_time_text == ".0400"
    assert other.translated_joints == (0, 2)
    assert_trees_close(motion.with_transforms(), motion, 0, 0)
    single = motion.astype(np.float32)
    assert {leaf.dtype for leaf in jax.tree.leaves(single)} == {np.dtype(np.float32)}
    assert_trees_close(single.astype(np.float64), motion, 1e-6, 1e-6)
    with pytest.raises(ValueError, match=r"translations must have shape \(3, 4, 3\)"):
        motion.with_transforms(rotations=motion.rotations[:3])


def test_from_root_keeps_offsets(dtype):
    rng = np.random.default_rng(2)
    skeleton = random_skeleton(rng, 4, dtype=dtype)
    q = np.tile(np.eye(4, dtype=dtype)[0], (5, 4, 1))
    root = rng.standard_normal((5, 3)).astype(dtype)
    motion = Motion.from_root(skeleton, root, q, 0.1)
    assert motion.translated_joints == (0,)
    assert motion.dtype == motion.translations.dtype == motion.frame_time.dtype == dtype
    np.testing.assert_array_equal(motion.root_positions, root)
    np.testing.assert_array_equal(
        motion.translations[:, 1:], np.broadcast_to(skeleton.offsets[1:], (5, 3, 3))
    )


def test_by_default_every_joint_may_be_translated():
    motion = random_motion(np.random.default_rng(3), 2, 3)
    assert motion.translated_joints == (0, 1, 2)


def test_shapes_that_do_not_fit(motion):
    q, t = motion.rotations, motion.translations
    for wrong in (q[:, :3], q[..., :3], q[0]):
        with pytest.raises(ValueError, match=r"rotations must have shape \(T, 4, 4\), got"):
            Motion(motion.skeleton, t, wrong, 0.04)
    with pytest.raises(ValueError, match=r"translations must have shape \(10, 4, 3\) like the rot"):
        Motion(motion.skeleton, t[:9], q, 0.04)
    for joints in ((4,), (-1,)):
        with pytest.raises(ValueError, match="translated_joints"):
            Motion(motion.skeleton, t, q, 0.04, translated_joints=joints)


def test_numpy_arrays_do(motion):
    on_host = Motion(
        motion.skeleton, np.asarray(motion.translations), np.asarray(motion.rotations), 0.04
    )
    assert on_host[2:4].num_frames == 2
    assert len(jax.tree.leaves(on_host)) == 5


def test_pytree_round_trip_and_equality(motion):
    leaves, structure = jax.tree.flatten(motion)
    again = jax.tree.unflatten(structure, leaves)
    assert eqx.tree_equal(again, motion)
    assert not eqx.tree_equal(motion[1:], motion)
    assert not eqx.tree_equal(eqx.tree_at(lambda m: m.rotations, motion, -motion.rotations), motion)
    mapped = jax.tree.map(lambda x: x, motion)
    assert mapped.frame_time_text == ".0400"


def test_topology_is_static_under_jit(motion):
    traces = []

    @jax.jit
    def shifted(motion):
        traces.append(motion.skeleton.names)
        return motion.with_transforms(motion.translations + 1.0)[2:]

    moved = shifted(motion)
    assert isinstance(moved, Motion)
    assert moved.skeleton.parents == motion.skeleton.parents
    np.testing.assert_array_equal(moved.translations, motion.translations[2:] + 1)
    shifted(motion.with_transforms(motion.translations * 2))
    assert len(traces) == 1


def test_vmap_over_clips(motion):
    stacked = jax.tree.map(lambda x: jnp.stack([x, 2 * x]), motion)
    ends = jax.vmap(lambda m: m[-1].root_positions)(stacked)
    np.testing.assert_array_equal(ends[1], 2 * motion.root_positions[-1:])


def test_replace_changes_what_it_is_told_and_nothing_else():
    motion = random_motion(np.random.default_rng(0), 5)
    spelt = motion.replace(frame_time_text="0.0333")
    assert (spelt.frame_time_text, spelt.translated_joints) == ("0.0333", motion.translated_joints)
    faster = spelt.replace(frame_time=1 / 60)
    assert faster.frame_time == 1 / 60
    assert faster.frame_time.dtype == motion.dtype
    assert faster.frame_time_text is None
    np.testing.assert_array_equal(faster.rotations, motion.rotations)
    assert spelt.with_transforms(rotations=-motion.rotations).frame_time_text == "0.0333"
    with pytest.raises(ValueError, match=r"Motion\.replace: fps; expected of"):
        motion.replace(fps=60)
    with pytest.raises(ValueError, match="rotations must have shape"):
        motion.replace(rotations=np.ones((5, 1, 4)))


def test_frame_times_are_positive_where_they_are_known(motion):
    """Once only the writers looked."""
    for wrong in (0.0, -1.0, np.nan, np.inf, jnp.asarray(-1.0), np.array([0.1, 0.0])):
        with pytest.raises(ValueError, match=r"Motion: frame_time must be a time above 0, got"):
            motion.replace(frame_time=wrong)
    with pytest.raises(ValueError, match="Motion: frame_time"):
        Motion.from_root(motion.skeleton, motion.root_positions, motion.rotations, 0.0)
    traced = jax.jit(lambda seconds: motion.replace(frame_time=seconds).frame_time)
    assert traced(-1.0) == -1.0
    many = jax.vmap(lambda seconds: motion.replace(frame_time=seconds))(jnp.array([0.1, 0.2]))
    np.testing.assert_array_equal(many[:3].frame_time, many.frame_time)
    shapes = jax.tree.map(np.shape, motion)
    assert shapes.frame_time == ()
    change = jax.tree.map(lambda x: -x, motion)  # as a derivative may be
    assert change.with_transforms(change.translations).frame_time < 0


def test_whole_numbers_are_refused(motion):
    q, t = np.asarray(motion.rotations), np.asarray(motion.translations)
    whole = r"rotations must be float32 or float64, got int64"
    with pytest.raises(ValueError, match=f"Motion: {whole}"):
        Motion(motion.skeleton, t, q.astype(int), 0.04)
    with pytest.raises(ValueError, match=f"Motion: {whole}"):
        motion.replace(rotations=jnp.asarray(q.astype(int)))
    with pytest.raises(ValueError, match=rf"Motion\.from_root: {whole}"):
        Motion.from_root(motion.skeleton, t[:, 0], q.astype(int), 0.04)
    with pytest.raises(ValueError, match="Motion: translations must be float32 or float64, got in"):
        Motion(motion.skeleton, t.astype(int), q, 0.04)
    with pytest.raises(ValueError, match="Skeleton: offsets must be float32 or float64, got int64"):
        Skeleton(["root", "tip"], [-1, 0], np.array([[0, 0, 0], [0, 1, 0]]))
    with pytest.raises(ValueError, match=r"got \(10, 4, 3\); quaternion.from_euler takes angles"):
        Motion(motion.skeleton, t, q[..., :3], 0.04)


def test_numbers_of_another_convention_are_doubted_where_the_motion_is_made(motion):
    t = np.asarray(motion.translations)
    still = np.tile(np.eye(4)[0], (10, 4, 1))
    for rotations, seconds, words in (
        (np.roll(still, -1, -1), 0.04, r"are they \(x, y, z, w\)\?"),
        (2 * still, 0.04, "norms of about 2"),
        (still, 30, "is it a rate, 30 frames a second"),
        (still, np.float64(33.3333), "is it milliseconds, 30 frames a second"),
    ):
        with pytest.warns(UserWarning, match=f"Motion: .*{words}") as told:
            Motion(motion.skeleton, t, rotations, seconds)
        assert [warning.filename for warning in told] == [__file__]
    with pytest.warns(UserWarning, match="norms of about 2"):
        Motion.from_root(motion.skeleton, t[:, 0], 2 * still, 0.04)
    with pytest.warns(UserWarning, match="a rate, 25 frames"):
        motion.replace(frame_time=25)


def test_what_is_computed_or_no_mistake_is_not_doubted(motion):
    """JAX's arrays may not be there yet; long frames come from slices."""
    q = motion.rotations
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Motion(motion.skeleton, motion.translations, 2 * jnp.asarray(q), jnp.asarray(30.0))
        jax.jit(lambda m: m.replace(rotations=2 * m.rotations, frame_time=m.times[-1] * 100))(
            motion
        )
        long = random_motion(np.random.default_rng(0), 900, 3)[::750]
        np.testing.assert_allclose(long.frame_time, 25)
        motion.replace(frame_time=7.0)
        Motion(motion.skeleton, np.zeros((0, 4, 3)), np.zeros((0, 4, 4)), 0.04)


def test_float64_where_jax_has_none_is_said_once():
    skeleton = random_skeleton(np.random.default_rng(0), 4)
    names, parents, offsets = skeleton.names, skeleton.parents, np.asarray(skeleton.offsets)
    q, t = np.tile(np.eye(4)[0], (6, 4, 1)), np.ones((6, 4, 3))
    with single_precision(), warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("default")
        skeleton = Skeleton(names, parents, offsets)
        motion = Motion(skeleton, t, q, 0.04)
        other = motion[::2].replace(rotations=q[::2], frame_time=np.float64(0.1))
        rooted = Motion.from_root(skeleton, t[:, 0], q, 0.04)
        leaves = jax.tree.leaves((motion, other, rooted, other.times, joint_weights(skeleton, {})))
    assert {leaf.dtype for leaf in leaves} == {np.dtype(np.float32)}
    [only] = [str(warning.message) for warning in told]
    assert "float64 arrays become float32" in only
    assert "jax_enable_x64" in only
