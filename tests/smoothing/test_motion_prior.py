"""Directions in which joints turn together: learned, kept in files, and smoothed along.

The oracles are SciPy's rotations and dense NumPy.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.io import MotionFileError
from jaxmotion.smoothing import MotionPrior, motion_prior
from jaxmotion.smoothing.together import smoothed_together
from jaxmotion.smoothing.tuning import tune_signal
from tests.helpers import assert_same_rotation, no_shape_checks, random_skeleton

FRAMES, JOINTS = 40, 4
FLAT = 1e-4  # radians at which rotation vectors simply add


def clip_of(vectors, names=None):
    """Rotation vectors f[T, J, 3] as a clip."""
    turns = Rotation.from_rotvec(np.reshape(vectors, (-1, 3))).as_quat()
    rotations = np.roll(turns, 1, axis=-1).reshape(*vectors.shape[:2], 4)
    skeleton = random_skeleton(np.random.default_rng(0), vectors.shape[1])
    if names is not None:
        skeleton = jm.Skeleton(names, skeleton.parents, skeleton.offsets)
    return jm.Motion(skeleton, np.zeros(vectors.shape), rotations, 0.01)


def vectors_of(motion):
    turns = Rotation.from_quat(np.roll(np.asarray(motion.rotations), -1, axis=-1).reshape(-1, 4))
    return turns.as_rotvec().reshape(*motion.rotations.shape[:2], 3)


def curve(seed, frames=FRAMES, joints=JOINTS, smooth=7.0):
    """Smooth random rotation vectors, of size 1, every axis by itself."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None, None, None]
    phase = rng.uniform(0, 2 * np.pi, (1, joints, 3, 3))
    rate = rng.uniform(0.5, 1, phase.shape) / smooth
    return np.mean(np.sin(rate * t + phase), axis=-1)


def bends_of(vectors):
    """Differences of angular velocities by SciPy, f[T-2, 3J]."""
    frames, joints = vectors.shape[:2]
    turns = [Rotation.from_rotvec(vectors[:, j]) for j in range(joints)]
    speed = np.stack([(r[:-1].inv() * r[1:]).as_rotvec() for r in turns], axis=1)
    return np.diff(speed, axis=0).reshape(frames - 2, -1)


def test_covariance_of_several_clips():
    clips = [curve(1), 0.3 * curve(2, frames=25)]
    total = np.zeros((3 * JOINTS, 3 * JOINTS))
    for vectors in clips:
        bends = bends_of(vectors)
        square = np.sum(bends**2, axis=1)
        soft = 0.1 * np.median(square)
        total += sum(np.outer(a, a) / (s + soft) for a, s in zip(bends, square, strict=True))
    prior = motion_prior([clip_of(vectors) for vectors in clips])
    np.testing.assert_allclose(prior.covariance, total / np.trace(total), rtol=1e-9, atol=1e-12)
    assert prior.frames == FRAMES + 25
    assert prior.joints == clip_of(clips[0]).skeleton.names


def test_joints_are_found_by_name():
    vectors = curve(3)
    names = ("a", "b", "c", "d")
    order = [2, 0, 3, 1]
    prior = motion_prior(clip_of(vectors, names))
    other = clip_of(vectors[:, order], tuple(names[j] for j in order))
    np.testing.assert_allclose(
        motion_prior(other).covariance, prior.of(other), rtol=1e-9, atol=1e-15
    )
    both = motion_prior([clip_of(vectors, names), other])
    assert both.joints == prior.joints
    np.testing.assert_allclose(both.covariance, prior.covariance, rtol=1e-9, atol=1e-15)
    some = clip_of(vectors[:, [3, 0]], ("d", "a"))
    axes = [9, 10, 11, 0, 1, 2]
    np.testing.assert_array_equal(prior.of(some.skeleton), prior.covariance[np.ix_(axes, axes)])


def test_size_of_a_move_does_not_count():
    # Slow and fast clips of one direction say the same.
    rng = np.random.default_rng(0)
    direction = rng.standard_normal((1, JOINTS, 3))
    move = np.sin(np.arange(FRAMES) / 4)[:, None, None]
    slow, fast = (motion_prior(clip_of(k * direction * move)) for k in (FLAT, 20 * FLAT))
    np.testing.assert_allclose(slow.covariance, fast.covariance, atol=1e-4)
    alone = direction.ravel() / np.linalg.norm(direction)
    np.testing.assert_allclose(fast.covariance, np.outer(alone, alone), atol=1e-3)


def test_kept_in_a_file(tmp_path):
    prior = motion_prior(clip_of(curve(4), ("hüfte", "b/c", "d e", "")))
    for dtype in (np.float32, np.float64):
        kept = MotionPrior(prior.joints, np.asarray(prior.covariance, dtype), prior.frames)
        kept.save(tmp_path / "prior.npz")
        read = MotionPrior.load(tmp_path / "prior.npz")
        assert read.covariance.dtype == dtype
        np.testing.assert_array_equal(read.covariance, kept.covariance)
        assert (read.joints, read.frames) == (prior.joints, FRAMES)
    with pytest.raises(FileExistsError):
        prior.save(tmp_path / "prior.npz", overwrite=False)
    np.load(tmp_path / "prior.npz", allow_pickle=False)["covariance"]
    assert "4 joints" in repr(prior)


def test_files_that_hold_no_prior(tmp_path):
    clip = clip_of(curve(4))
    jm.save(clip, tmp_path / "clip.npz")
    with pytest.raises(MotionFileError, match="jaxmotion_motion_prior"):
        MotionPrior.load(tmp_path / "clip.npz")
    good = {
        "jaxmotion_motion_prior": np.array(1),
        "joints": np.array('["a"]'),
        "covariance": np.eye(3),
        "frames": np.array(5),
    }
    wrong = {
        "jaxmotion_motion_prior": np.array(2),
        "joints": np.array('["a", 3]'),
        "covariance": np.full((3, 3), np.nan),
        "frames": np.array([1, 2]),
    }
    np.savez(tmp_path / "prior.npz", **good)
    assert MotionPrior.load(tmp_path / "prior.npz").joints == ("a",)
    for name, value in [*wrong.items(), ("covariance", np.eye(2)), ("joints", np.array("["))]:
        np.savez(tmp_path / "prior.npz", **good | {name: value})
        with pytest.raises(MotionFileError):
            MotionPrior.load(tmp_path / "prior.npz")
    (tmp_path / "prior.npz").write_bytes(b"text")
    with pytest.raises(MotionFileError):
        MotionPrior.load(tmp_path / "prior.npz")


@no_shape_checks()
def test_what_cannot_be_learned():
    clip = clip_of(curve(5))
    with pytest.raises(ValueError, match="no clips"):
        motion_prior([])
    with pytest.raises(ValueError, match="nothing turns"):
        motion_prior(clip_of(np.zeros((5, JOINTS, 3))))
    with pytest.raises(ValueError, match="joint named 'b'"):
        motion_prior([clip_of(curve(5, joints=1), ("a",)), clip_of(curve(5, joints=2), ("a", "b"))])
    with pytest.raises(ValueError, match="finite"):
        motion_prior(clip_of(np.where(np.arange(5)[:, None, None] == 2, np.nan, curve(5, 5))))
    with pytest.raises(ValueError, match="batch"):
        motion_prior(jm.stack([clip, clip]))
    with pytest.raises(TypeError, match="jit"):
        jax.jit(motion_prior)(clip)
    prior = motion_prior(clip_of(curve(5, joints=1), ("a",)))
    with pytest.raises(ValueError, match=r"no joint named 'z'.*'a'"):
        jm.denoise(clip_of(curve(5, joints=1), ("z",)), prior=prior)
    for given in ({"tune": False}, {"lam": 2.0}):
        with pytest.raises(ValueError, match="MotionPrior"):
            jm.denoise(clip_of(curve(5, joints=1), ("a",)), prior=prior, **given)
    with pytest.raises(ValueError, match="prior"):
        jm.denoise(clip, prior="Student")


def dense_smoother(frames, lam, sigma, stiffness):
    """H, so that x = H y, of one column."""
    bends = np.diff(np.eye(frames), n=2, axis=0)
    firm = 0.25 * (lam * sigma * stiffness[1:-1, None]) ** 2
    return np.linalg.inv(np.eye(frames) + bends.T @ (firm * bends))


def test_smoothed_along_the_directions():
    """Rotations so small that they add have a linear smoother: turned, smoothed, turned back."""
    rng = np.random.default_rng(6)
    clean = FLAT * curve(7)
    y = clean + 0.02 * FLAT * rng.standard_normal(clean.shape)
    sigma = 0.02 * FLAT * np.array([1.0, 2.0, 0.5, 1.0])
    first = clip_of(clean)
    covariance = np.cov(rng.standard_normal((12, 40)) ** 3)
    got = vectors_of(smoothed_together(clip_of(y), first, sigma, covariance, None))

    unit = np.repeat(np.maximum(sigma, sigma.max() / 3), 3)
    bends = np.diff(clean, n=2, axis=0).reshape(-1, 12) / unit
    shared, own = covariance / unit / unit[:, None], bends.T @ bends
    both = shared / np.trace(shared) + 0.1 * own / np.trace(own)
    along = np.linalg.eigh(both)[1]
    columns = y.reshape(FRAMES, -1) / unit @ along
    learned = tune_signal(jnp.asarray(columns - columns.mean(0)), prior="student", most=3.0)
    smoothers = [
        dense_smoother(FRAMES, float(a), float(b), np.asarray(c))
        for a, b, c in zip(learned.lam, learned.sigma, learned.stiffness.T, strict=True)
    ]
    smooth = np.stack([h @ c for h, c in zip(smoothers, columns.T, strict=True)], axis=1)
    expected = (smooth @ along.T * unit).reshape(clean.shape)
    np.testing.assert_allclose(got, expected, atol=2e-4 * FLAT)
    assert np.abs(got - y).max() > 0.02 * FLAT


def together(seed, frames=60):
    """A clip all of whose joints turn as one, about other axes and by other amounts."""
    direction = np.random.default_rng(8).standard_normal((1, JOINTS, 3))
    return curve(seed, frames, 1, 4.0)[:, :, :1] * direction * 0.3


def noisy_clip(vectors, amount=0.05, seed=9):
    noise = amount * np.random.default_rng(seed).standard_normal(vectors.shape)
    clean = clip_of(vectors)
    return clean, jm.displacement.plus(clean, jm.displacement.Displacement(0 * noise, noise))


def errors(result, clean):
    return np.asarray(jm.quaternion.distance(result.rotations, clean.rotations))


def test_joints_that_turn_together_are_denoised_together():
    prior = motion_prior(clip_of(together(10)))
    clean, noisy = noisy_clip(together(11))
    alone = errors(jm.denoise(noisy), clean)
    found = errors(jm.denoise(noisy, prior=prior), clean)
    # Each of the other eleven directions keeps its level and slope, half of this error.
    assert found.mean() < 0.65 * alone.mean()
    # With no other directions than its own a clip is no worse off.
    own = motion_prior(clip_of(curve(12, 60)))
    assert errors(jm.denoise(noisy, prior=own), clean).mean() < 1.1 * alone.mean()


def test_whoever_stands_wherever():
    """The prior is in every joint's own frame: a turned world has turned results."""
    prior = motion_prior(clip_of(together(10)))
    _, noisy = noisy_clip(together(11))
    turn = np.array([0.6, 0.0, 0.8, 0.0])
    turned = noisy.with_transforms(
        rotations=noisy.rotations.at[:, 0].set(jm.quaternion.multiply(turn, noisy.rotations[:, 0]))
    )
    here, there = (jm.denoise(clip, prior=prior).rotations for clip in (noisy, turned))
    assert_same_rotation(there[:, 0], jm.quaternion.multiply(turn, here[:, 0]), 1e-6)
    assert_same_rotation(there[:, 1:], here[:, 1:], 1e-6)


def test_still_joints_stay():
    vectors = together(11)
    vectors[:, 2] = [0.1, 0.2, -0.4]
    clean, noisy = noisy_clip(vectors)
    rotations = noisy.rotations.at[:, 2].set(clean.rotations[:, 2])
    noisy = noisy.with_transforms(rotations=rotations)
    found = jm.denoise(noisy, prior=motion_prior(clip_of(together(10))))
    assert errors(found, clean)[:, 2].max() < 1e-7
    assert errors(found, noisy)[:, 1].max() > 0.02


@pytest.mark.parametrize("by_joint", [False, True])
def test_missing_samples_say_nothing(by_joint):
    prior = motion_prior(clip_of(together(10)))
    clean, noisy = noisy_clip(together(11))
    weights = np.ones((60, JOINTS))
    weights[20:24, 1 if by_joint else slice(None)] = 0
    gone = weights[:, :, None] == 0
    weights = weights if by_joint else weights[:, 0]
    results = [
        jm.denoise(
            noisy.with_transforms(rotations=np.where(gone, junk, noisy.rotations)),
            weights=weights,
            prior=prior,
        )
        for junk in (np.array([1.0, 0, 0, 0]), np.array([0.0, 0, 1, 0]))
    ]
    assert_same_rotation(results[0].rotations, results[1].rotations, 1e-7)
    found = errors(results[0], clean)
    assert found[20:24].max() < 0.3
    assert found.mean() < errors(noisy, clean).mean()


def test_padding_changes_nothing_that_counts():
    prior = motion_prior(clip_of(together(10)))
    _, noisy = noisy_clip(together(11))
    whole = jm.denoise(noisy, prior=prior)
    rotations = np.concatenate([noisy.rotations, np.full((7, JOINTS, 4), 0.5)])
    padded = noisy.with_transforms(np.zeros((67, JOINTS, 3)), rotations)
    found = jm.denoise(padded, prior=prior, length=60)
    assert_same_rotation(found.rotations[:60], whole.rotations, 1e-5)


def test_transformations_and_precisions():
    prior = motion_prior(clip_of(together(10)))
    clips = [noisy_clip(together(seed))[1] for seed in (11, 12)]
    one_by_one = [jm.denoise(clip, prior=prior).rotations for clip in clips]
    mapped = jax.jit(jax.vmap(lambda clip: jm.denoise(clip, prior=prior)))(jm.stack(clips)[0])
    for got, want in zip(mapped.rotations, one_by_one, strict=True):
        assert_same_rotation(got, want, 1e-6)
    single = jm.denoise(clips[0].astype(np.float32), prior=prior)
    assert single.rotations.dtype == np.float32
    assert_same_rotation(single.rotations, one_by_one[0], 5e-3)

    def sharpness(clip):
        return (jm.denoise(clip, prior=prior).rotations ** 3).sum()

    slope = jax.grad(sharpness)(clips[0]).rotations
    assert np.isfinite(slope).all()
    assert np.abs(slope).max() > 1e-3


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_short_clips(frames):
    prior = motion_prior(clip_of(together(10)))
    clip = noisy_clip(together(11))[1][:frames]
    found = jm.denoise(clip, prior=prior)
    assert np.isfinite(found.rotations).all()
    if frames < 3:
        assert_same_rotation(found.rotations, clip.rotations, 1e-6)
