"""Clips side by side and one after the other."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import Motion
from tests.helpers import (
    assert_trees_close,
    no_shape_checks,
    random_motion,
    random_skeleton,
    world_by_matrices,
)


@pytest.fixture
def skeleton():
    return random_skeleton(np.random.default_rng(0), 5)


def clips_of(skeleton, *frames, **options):
    rng = np.random.default_rng(1)
    return [random_motion(rng, n, skeleton, **options) for n in frames]


def test_stacked_clips_are_padded_by_their_last_frame(skeleton):
    clips = clips_of(skeleton, 4, 6, 1)
    batch, lengths = jm.stack(clips)
    assert lengths.tolist() == [4, 6, 1]
    assert lengths.dtype == jnp.int32
    assert batch.rotations.shape == (3, 6, 5, 4)
    for i, clip in enumerate(clips):
        one = jax.tree.map(lambda x, i=i: x[i], batch)
        assert_trees_close(one[: len(clip)], clip, 0, 0)
        for frame in range(len(clip), 6):
            np.testing.assert_array_equal(one.rotations[frame], clip.rotations[-1])
            np.testing.assert_array_equal(one.translations[frame], clip.translations[-1])


def test_a_batch_is_what_vmap_takes_and_gives(skeleton):
    clips = clips_of(skeleton, 3, 3)
    batch, _ = jm.stack(clips)
    assert {x.shape[0] for x in jax.tree.leaves(batch)} == {2}
    assert_trees_close(jax.tree.map(lambda *x: jnp.stack(x), *clips), batch, 0, 0)
    again = jax.vmap(lambda clip: clip[::-1])(batch)
    assert jax.tree.structure(again) == jax.tree.structure(batch)
    np.testing.assert_array_equal(again.rotations[1], clips[1].rotations[::-1])
    ends = jax.vmap(lambda clip, n: clip.rotations[n - 1])(*jm.stack(clips_of(skeleton, 2, 4)))
    assert ends.shape == (2, 5, 4)


def test_bodies_of_other_sizes_and_rates_stand_in_one_batch(skeleton):
    """Bones and frame times are arrays, one for each clip."""
    clip = random_motion(np.random.default_rng(2), 3, skeleton)
    tall = eqx.tree_at(
        lambda s: (s.offsets, s.end_offsets),
        skeleton,
        (2 * skeleton.offsets, 2 * skeleton.end_offsets),
    )
    other = Motion(tall, 2 * clip.translations, clip.rotations, 1 / 60)
    batch, _ = jm.stack([clip, other])
    np.testing.assert_allclose(batch.frame_time, [1 / 30, 1 / 60])
    pose = jm.forward_kinematics(batch)
    for i, one in enumerate((clip, other)):
        positions, _, tips = world_by_matrices(one)
        np.testing.assert_allclose(pose.positions[i], positions, atol=1e-12)
        np.testing.assert_allclose(pose.end_positions[i], tips, atol=1e-12)
    linear = jm.velocities(batch).linear
    np.testing.assert_allclose(linear[1], 4 * linear[0], atol=1e-9)


def test_a_joint_is_translated_that_is_in_one_of_the_clips(skeleton):
    still = clips_of(skeleton, 3, translated=False)
    moved = clips_of(skeleton, 3)
    for clips in (still + moved, moved + still):
        assert jm.stack(clips)[0].translated_joints == (0, 1, 2, 3, 4)
        assert jm.concatenate(clips).translated_joints == (0, 1, 2, 3, 4)
    assert jm.stack(still)[0].translated_joints == (0,)


def test_clips_one_after_the_other(skeleton):
    first, second, third = clips_of(skeleton, 3, 1, 2)
    joined = jm.concatenate([first.replace(frame_time_text=".03333"), second, third])
    assert len(joined) == 6
    assert joined.frame_time_text == ".03333"
    assert_trees_close(joined[:3], first, 0, 0)
    assert_trees_close(joined[3:4], second, 0, 0)
    assert_trees_close(joined[4:], third, 0, 0)
    rounded = third.replace(frame_time=0.033333)
    assert float(jm.concatenate([first, rounded]).frame_time) == float(first.frame_time)


def test_files_of_a_batch_come_back(skeleton, tmp_path):
    batch, _ = jm.stack(clips_of(skeleton, 2, 2))
    jm.save(batch, tmp_path / "batch.npz")
    assert_trees_close(jm.load(tmp_path / "batch.npz"), batch, 0, 0)


def test_arrays_of_any_kind(skeleton, dtype):
    clips = clips_of(skeleton, 2, 3, dtype=dtype)
    on_host = [jax.tree.map(np.asarray, clip) for clip in clips]
    batch, lengths = jm.stack(on_host)
    assert all(isinstance(x, jax.Array) for x in jax.tree.leaves(batch))
    assert batch.dtype == dtype
    traced, counts = jax.jit(lambda *c: jm.stack(c))(*clips)
    assert_trees_close(traced, batch, 0, 0)
    np.testing.assert_array_equal(counts, lengths)
    whole = jax.jit(lambda *c: jm.concatenate(c))(*clips)
    assert_trees_close(whole, jm.concatenate(on_host), 0, 0)


def test_clips_that_do_not_fit_together(skeleton):
    clip, slow = clips_of(skeleton, 3, 3)
    others = {
        r"clips\[1\] has another skeleton than clips\[0\]: names": random_motion(
            np.random.default_rng(3), 3, 4
        ),
        r"clips\[1\] is float32, clips\[0\] float64": clip.astype(np.float32),
        r"clips\[1\] has another skeleton than clips\[0\]: up z; expected y": jm.reorient(
            clip, "z"
        ),
        r"one clip at a time for clips\[1\], got batch axes \(1,\)": jm.stack([clip])[0],
    }
    for name, function in {"stack": jm.stack, "concatenate": jm.concatenate}.items():
        for message, other in others.items():
            with pytest.raises(ValueError, match=f"^{name}: {message}"):
                function([clip, other])
        with pytest.raises(ValueError, match=f"^{name}: clips is empty"):
            function([])
        with no_shape_checks():
            with pytest.raises(ValueError, match=f"^{name}: clips is a Motion; expected a list"):
                function(clip)
            with pytest.raises(ValueError, match=rf"^{name}: clips\[1\] is a str; expected a jax"):
                function([clip, "walk.bvh"])
    tall = eqx.tree_at(lambda m: m.skeleton.offsets, slow, 1.01 * skeleton.offsets)
    with pytest.raises(ValueError, match=r"concatenate: .* bones of different lengths"):
        jm.concatenate([clip, tall])
    with pytest.raises(ValueError, match=r"concatenate: .* one frame time; .*got 0\.03.* and 0\.1"):
        jm.concatenate([clip, slow.replace(frame_time=0.1)])
