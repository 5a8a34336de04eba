"""The manner of clips: against plain NumPy and SciPy, mixed, and kept in files."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.io import MotionFileError
from jaxmotion.style import MotionStyle, interpolate, motion_style
from jaxmotion.style.statistics import deviations
from tests.helpers import assert_same_rotation, check_gradients, no_shape_checks
from tests.style.clips import JOINTS, quaternions, recursive_mean, rotations, swaying

style_of = jax.jit(motion_style, static_argnames="mean")


def by_hand(clips, weights, middle):
    """Covariance f[J, 3, 3] about means f[J, 4]."""
    total = np.zeros((JOINTS, 3, 3))
    for j in range(JOINTS):
        for clip, w in zip(clips, weights, strict=True):
            v = (rotations(middle[j]).inv() * rotations(clip.rotations[:, j])).as_rotvec()
            total[j] += np.einsum("t,ta,tb->ab", w, v, v)
    return total / sum(w.sum() for w in weights)


def test_the_paper_s_mean_and_deviation():
    motion = swaying(0)
    style = style_of(motion)
    middle = np.stack([recursive_mean(motion.rotations[:, j]) for j in range(JOINTS)])
    assert_same_rotation(style.mean, middle, 1e-12)
    covariance = by_hand([motion], [np.ones(40)], middle)
    np.testing.assert_allclose(style.covariance, covariance, atol=1e-12)
    np.testing.assert_allclose(style.deviation**2, np.trace(covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(
        style.deviation[1], jm.quaternion.std(motion.rotations[:, 1], style.mean[1])
    )


@pytest.mark.parametrize("mean", ["karcher", "chordal"])
def test_other_means(mean):
    motion = swaying(1)
    weights = np.random.default_rng(0).uniform(0, 1, 40)
    style = style_of(motion, weights, mean=mean)
    wanted = jm.quaternion.mean(motion.rotations, weights, method=mean)
    assert_same_rotation(style.mean, wanted, 1e-12)
    covariance = by_hand([motion], [weights], np.asarray(wanted))
    np.testing.assert_allclose(style.covariance, covariance, atol=1e-12)


def test_several_clips_are_one_long_one():
    clips = [swaying(seed, frames) for seed, frames in ((2, 40), (2, 25), (3, 31))]
    style = style_of(clips, mean="karcher")
    joined = np.concatenate([clip.rotations for clip in clips])
    assert_same_rotation(style.mean, jm.quaternion.mean(joined), 1e-12)
    weighted = style_of(clips, np.array([0.0, 2.0, 0.0]), mean="karcher")
    alone = style_of(clips[1], mean="karcher")
    for got, wanted in zip(jax.tree.leaves(weighted), jax.tree.leaves(alone), strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-9)
    shares = style_of(clips, np.array([40.0, 25.0, 31.0]), mean="karcher")
    np.testing.assert_allclose(shares.covariance, style.covariance, atol=1e-12)
    assert motion_style(iter(clips[:1])).joints == clips[0].skeleton.names


def test_turns_past_half_a_circle_do_not_jump():
    angle = np.linspace(-0.8, 5.0, 60)
    q = quaternions(Rotation.from_rotvec(angle[:, None] * np.array([0, 0, 1.0])))[:, None]
    q[30:] *= -1  # as a file may have it
    v = deviations(jnp.array([[1.0, 0, 0, 0]]), q)
    np.testing.assert_allclose(v[:, 0, 2], angle, atol=1e-12)
    np.testing.assert_allclose(deviations(jnp.array([[1.0, 0, 0, 0]]), -q), v, atol=1e-12)
    assert np.isfinite(jax.jacobian(lambda q: deviations(jnp.array([[1.0, 0, 0, 0]]), q))(q)).all()
    whole = quaternions(Rotation.from_rotvec(np.array([[0.0, 0, 3], [0, 0, 2 * np.pi]])))[:, None]
    np.testing.assert_allclose(deviations(jnp.array([[1.0, 0, 0, 0]]), whole)[1], 0, atol=1e-6)


def test_between_and_beyond():
    first, second = (style_of(swaying(seed), mean="karcher") for seed in (4, 5))
    for share in (0.0, 0.3, 1.0, 1.7):
        mixed = interpolate([first, second], [1 - share, share])
        for j in range(JOINTS):
            a, b = rotations(first.mean[j]), rotations(second.mean[j])
            away = (a.inv() * b).as_rotvec()
            wanted = quaternions(a * Rotation.from_rotvec(share * away))
            assert_same_rotation(mixed.mean[j : j + 1], wanted, 1e-9)
        wanted = (1 - share) * first.root_mean + share * second.root_mean
        np.testing.assert_allclose(mixed.root_mean, wanted, atol=1e-12)
        assert (np.linalg.eigvalsh(mixed.covariance) > -1e-12).all()
        assert (np.asarray(mixed.root_deviation) >= 0).all()
    half = interpolate([first, second], [2.0, 2.0])
    roots = [np.linalg.cholesky(np.asarray(s.covariance[2])) for s in (first, second, half)]
    sums = [u @ np.diag(w**0.5) @ u.T for w, u in (np.linalg.eigh(r @ r.T) for r in roots)]
    np.testing.assert_allclose(sums[2], 0.5 * (sums[0] + sums[1]), atol=1e-9)


def test_a_mean_of_three_is_the_karcher_mean():
    styles = [style_of(swaying(seed), mean="karcher") for seed in (4, 5, 6)]
    share = np.array([0.2, 0.5, 0.3])
    mixed = interpolate(styles, share)
    wanted = jm.quaternion.mean(np.stack([s.mean for s in styles]), share)
    assert_same_rotation(mixed.mean, wanted, 1e-9)


def test_derivatives():
    motion = swaying(7, frames=12)

    def numbers(rotations, translations):
        style = motion_style(motion.with_transforms(translations, rotations), mean="karcher")
        return style.mean, style.covariance, style.root_mean, style.root_deviation

    check_gradients(
        jax.jit(numbers),
        jnp.asarray(motion.rotations),
        jnp.asarray(motion.translations),
        rtol=1e-5,
        eps=1e-6,
    )


def test_still_bodies_and_single_frames():
    single = swaying(8, frames=1)
    still = single.with_transforms(
        np.repeat(single.translations, 9, 0), np.repeat(single.rotations, 9, 0)
    )
    for clip in (single, still):
        style = style_of(clip)
        np.testing.assert_allclose(style.deviation, 0, atol=1e-12)

        def numbers(q, clip=clip):
            style = motion_style(clip.with_transforms(rotations=q))
            return style.deviation.sum() + style.root_deviation.sum() + style.mean.sum()

        assert jnp.isfinite(jax.grad(numbers)(jnp.asarray(clip.rotations))).all()


def test_float32_and_vmap():
    clips = [swaying(seed) for seed in (9, 10)]
    batch, _ = jm.stack(clips)
    many = jax.jit(jax.vmap(motion_style))(batch)
    alone = style_of(clips[1])
    np.testing.assert_allclose(many.covariance[1], alone.covariance, atol=1e-12)
    low = style_of(jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), clips[1]))
    assert {x.dtype for x in jax.tree.leaves(low)} == {np.dtype("float32")}
    np.testing.assert_allclose(low.root_mean, alone.root_mean, rtol=1e-3, atol=1e-3)


def test_files(tmp_path):
    style = style_of(swaying(11))
    style.save(tmp_path / "calm.npz")
    again = MotionStyle.load(tmp_path / "calm.npz")
    assert again.joints == style.joints
    for got, wanted in zip(jax.tree.leaves(again), jax.tree.leaves(style), strict=True):
        np.testing.assert_array_equal(got, wanted)
    with pytest.raises(FileExistsError):
        style.save(tmp_path / "calm.npz", overwrite=False)
    with np.load(tmp_path / "calm.npz") as file:
        fields = dict(file)
    for name, value in (
        ("mean", fields["mean"][:2]),
        ("joints", np.array("[1, 2]")),
        ("up", np.array("sideways")),
        ("covariance", fields["covariance"] * np.nan),
        ("jaxmotion_motion_style", np.array(9)),
    ):
        np.savez(tmp_path / "damaged.npz", **fields | {name: value})
        with pytest.raises(MotionFileError):
            MotionStyle.load(tmp_path / "damaged.npz")
    jm.save(swaying(11), tmp_path / "motion.npz")
    with pytest.raises(MotionFileError, match="MotionStyle"):
        MotionStyle.load(tmp_path / "motion.npz")


def test_what_is_wrong_is_said():
    motion = swaying(12)
    with pytest.raises(ValueError, match="no clips"):
        motion_style([])
    with pytest.raises(ValueError, match="clips of other joints"):
        motion_style([motion, swaying(12, names=("a", "b", "c", "d", "e"))])
    with pytest.raises(ValueError, match=r"weights have shape \(3,\)"):
        motion_style(motion, np.ones(3))
    for weights in (np.zeros(40), -np.ones(40)):
        with pytest.raises(ValueError, match="weights must be 0 or more"):
            motion_style(motion, weights)
    with no_shape_checks(), pytest.raises(ValueError, match="mean"):
        motion_style(motion, mean="median")
    spoiled = np.array(motion.rotations)
    spoiled[3, 2] = np.nan
    with pytest.raises(ValueError, match="'arm' at frame 3"):
        motion_style(motion.with_transforms(rotations=spoiled))
    style = style_of(motion)
    with pytest.raises(ValueError, match="no styles"):
        interpolate([], [])
    with pytest.raises(ValueError, match="weights sum to 0"):
        interpolate([style, style], [1.0, -1.0])
    with pytest.raises(ValueError, match="weights have shape"):
        interpolate([style], [1.0, -1.0])
    other = style_of(swaying(12, names=("a", "b", "c", "d", "e")))
    with pytest.raises(ValueError, match="styles of other joints"):
        interpolate([style, other], [0.5, 0.5])
