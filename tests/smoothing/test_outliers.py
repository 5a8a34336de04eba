"""Outlier weights: spikes found, good samples kept, against a plain numpy reweighting."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import quaternion
from jaxmotion.smoothing import outlier_weights, smooth_motion, tune
from tests.helpers import assert_same_rotation, no_shape_checks, random_motion


def wave(frames=120, channels=3, noise=0.05, seed=0):
    """A smooth signal f[T, 2, C], the same with noise, and which samples to spoil."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None, None]
    phase = rng.uniform(0, 6, (2, channels))
    truth = np.sin(t / 9 + phase)
    hit = rng.random((frames, 2)) < 0.05
    return truth, truth + noise * rng.standard_normal(truth.shape), hit, rng


def by_hand(y, rounds, loss, learn):
    """The reweighting in numpy, one group f[T, C]; the smoother by its normal equations."""
    frames, channels = y.shape
    bends = np.zeros((frames - 2, frames))
    for j in range(frames - 2):
        bends[j, j : j + 3] = -0.5, 1.0, -0.5
    w = np.ones(frames)
    for _ in range(rounds):
        product = learn(w)
        hat = np.linalg.inv(np.diag(w) + product**2 * bends.T @ bends) @ np.diag(w)
        fitted = hat @ y
        distance = np.linalg.norm(y - fitted, axis=1) / np.sqrt(1 - np.diag(hat))
        step = np.linalg.norm(np.diff(fitted, axis=0, prepend=fitted[:1]), axis=1)
        used = np.where(w > 0, distance, np.nan)
        around = [np.arange(max(t - 7, 0), min(t + 8, frames)) for t in range(frames)]
        usual = np.array([max(np.nanmedian(used), np.nanmedian(used[n])) for n in around])
        usual /= {1: 0.6745, 3: 1.5382}[channels]
        scale = np.maximum(usual, [np.median(step[n]) / 7 for n in around])
        u = distance / scale
        w = 1 / (1 + (u / 2.385) ** 2) if loss == "cauchy" else np.minimum(1, 1.345 / u)
        w[w < 0.1] = 0
    return w


@pytest.mark.parametrize("loss", ["huber", "cauchy"])
def test_weights_are_those_of_plain_reweighting(loss):
    _, y, hit, rng = wave()
    y[hit] += 2 * rng.standard_normal((hit.sum(), 3))
    got = outlier_weights(y, loss=loss)
    for j in range(2):

        def learn(w, y=y[:, j : j + 1]):
            found = tune(y, weights=w)
            return float(found.lam[0] * found.sigma[0])

        np.testing.assert_allclose(got[:, j], by_hand(y[:, j], 4, loss, learn), atol=1e-6)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_spikes_are_found_and_good_samples_kept(dtype):
    _, y, hit, rng = wave()
    y[hit] += 3 * rng.choice([-1, 1], (hit.sum(), 1))
    w = np.asarray(outlier_weights(y.astype(dtype)))
    assert w.dtype == dtype
    assert np.all(w[hit] == 0)
    assert np.mean(w[~hit] == 0) < 0.01
    assert np.mean(w[~hit]) > 0.6


def test_a_clean_fast_signal_is_left_alone():
    t = np.arange(200)
    burst = np.exp(-(((t - 100) / 12) ** 2)) * np.sin(t / 2.5)
    w = np.asarray(outlier_weights(burst))
    assert w.shape == (200,)
    assert np.mean(w) > 0.9


def test_spikes_of_a_motion_are_bridged_whatever_their_signs():
    rng = np.random.default_rng(1)
    motion = jm.samples.load("walk").motion[:90]
    noisy = quaternion.multiply(
        motion.rotations,
        quaternion.exp(0.02 * rng.standard_normal((*motion.rotations.shape[:2], 3))),
    )
    hit = rng.random(noisy.shape[:2]) < 0.03
    away = rng.standard_normal((*hit.shape, 3))
    away *= rng.uniform(1, 3.1, (*hit.shape, 1)) / np.linalg.norm(away, axis=-1, keepdims=True)
    spoilt = jnp.where(hit[..., None], quaternion.multiply(noisy, quaternion.exp(away)), noisy)
    spoilt = spoilt * rng.choice([-1.0, 1.0], (*hit.shape, 1))
    spoilt = motion.with_transforms(rotations=spoilt)
    w = np.asarray(outlier_weights(spoilt))
    assert np.mean(w[hit] == 0) > 0.97
    assert np.mean(w[~hit] == 0) < 0.03
    robust = jm.denoise(spoilt, robust=True)
    plain = jm.denoise(motion.with_transforms(rotations=noisy))
    error, unspoilt = (
        float(jnp.mean(quaternion.distance(m.rotations, motion.rotations))) for m in (robust, plain)
    )
    assert error < 1.15 * unspoilt
    found = tune(spoilt, weights=w).rotations
    alone = smooth_motion(spoilt, found.lam, found.sigma, weights=w)
    assert float(jnp.mean(quaternion.distance(alone.rotations, motion.rotations))) < 1.15 * unspoilt


def test_a_jump_of_a_moving_joint_counts_for_it_alone():
    motion = jm.samples.load("walk").motion[:90]
    assert 0 in motion.translated_joints
    jumping = motion.with_transforms(motion.translations.at[40, 0, 1].add(0.5))
    w, before = (np.asarray(outlier_weights(m)) for m in (jumping, motion))
    assert w[40, 0] == 0 < before[40, 0]
    np.testing.assert_array_equal(w[:, 1:], before[:, 1:])


def test_what_is_known_beforehand_counts():
    _, y, _, _ = wave()
    given = np.ones(len(y))
    given[10:14] = 0
    broken = np.where(given[:, None, None] > 0, y, 50.0)
    w = np.asarray(outlier_weights(broken, weights=given))
    assert np.all(w[10:14] == 0)
    assert np.all(w[:10] + w[14:24] > 0)


def test_padding_does_not_matter():
    rng = np.random.default_rng(3)
    motion = jm.samples.load("walk").motion[:81]
    tail = random_motion(rng, 9, motion.skeleton)  # 90 frames, as others in this file
    padded = motion.with_transforms(
        jnp.concatenate([motion.translations, tail.translations]),
        jnp.concatenate([motion.rotations, tail.rotations]),
    )
    w = outlier_weights(padded, weights=np.arange(90) < 81)
    np.testing.assert_allclose(w[:81], outlier_weights(motion), atol=1e-8)
    np.testing.assert_array_equal(w[81:], 0)


@pytest.mark.parametrize("dtype", [np.float32, pytest.param(np.float64, marks=pytest.mark.sweep)])
@pytest.mark.parametrize("frames", [1, 2])
def test_what_no_other_sample_contradicts_is_trusted(frames, dtype):
    """A line goes through any two samples: whatever rounding leaves of them is no error."""
    motion = random_motion(np.random.default_rng(1), frames, 3, dtype)
    for loss in ("huber", "cauchy"):
        got = outlier_weights(motion, loss=loss)
        assert got.dtype == dtype
        np.testing.assert_array_equal(got, np.ones((frames, 3)))
    robust = jm.denoise(motion, robust=True)
    assert_same_rotation(robust.rotations, motion.rotations, 1e-5)
    np.testing.assert_allclose(robust.translations, motion.translations, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("order", [1, 2])
def test_of_one_sample_too_many_none_is_the_wrong_one(order, dtype):
    """Any of three points off a line may be the one that is wrong, near each other or apart."""
    y = np.random.default_rng(2).standard_normal((20, 2, 3)).astype(dtype)
    few = np.zeros((20, 2), dtype)
    few[[2, 3, 17][: order + 1]] = 1
    np.testing.assert_array_equal(outlier_weights(y, weights=few, order=order), few)
    few[9, 1] = 1
    assert np.all(outlier_weights(y, weights=few, order=order)[:, 0] == few[:, 0])
    assert np.any(outlier_weights(y, weights=few, order=order)[:, 1] < few[:, 1])


@pytest.mark.parametrize("frames", [1, 2, 3, 4])
def test_short_and_still_clips_give_finite_weights(frames):
    motion = random_motion(np.random.default_rng(0), frames, 3)
    still = jax.tree.map(lambda x: x, motion).with_transforms(
        jnp.broadcast_to(motion.translations[:1], motion.translations.shape),
        jnp.broadcast_to(motion.rotations[:1], motion.rotations.shape),
    )
    assert np.all(np.isfinite(outlier_weights(motion)))
    np.testing.assert_allclose(outlier_weights(still), 1, atol=1e-6)


def test_no_gradient_passes_and_mistakes_are_named():
    _, y, _, _ = wave(30)
    slope = jax.grad(lambda y: jnp.sum(outlier_weights(y)))(jnp.asarray(y))
    np.testing.assert_array_equal(slope, 0)
    with no_shape_checks(), pytest.raises(ValueError, match="loss='l1'"):
        outlier_weights(y, loss="l1")
    with pytest.raises(ValueError, match=r"expected \(T, J, C\)"):
        outlier_weights(y[:, 0])
