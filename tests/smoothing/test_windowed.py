"""The windowed mode against a loop over dense solves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.smoothing import lgs, smooth_motion, smooth_quaternions, windowed_lgs
from tests.helpers import (
    assert_jit_and_vmap_agree,
    assert_same_rotation,
    check_gradients,
    random_motion,
    random_quaternions,
)


def dense(y, product, weights):
    """Minimiser of the weighted misfit plus product^2 |Lx|^2, L of rows (1, -2, 1)."""
    bend = np.diff(np.eye(len(y)), n=2, axis=0)
    system = product**2 * bend.T @ bend + np.diag(weights)
    return np.linalg.solve(system, weights[:, None] * y)


def loop(y, product, window, stride, weights=None):
    """Windows solved one after the other, each faded over what is there; the last one cut off."""
    weights = np.ones(len(y)) if weights is None else weights
    out = dense(y[:window], product, weights[:window])
    start = stride
    while len(out) < len(y):
        piece = dense(y[start : start + window], product, weights[start : start + window])
        rise = 1 / (1 + np.exp(-np.linspace(-6, 6, window - stride)))[:, None]
        shared = (1 - rise) * out[start:] + rise * piece[: window - stride]
        out = np.concatenate([out[:start], shared, piece[window - stride :]])
        start += stride
    return out


@pytest.mark.parametrize(
    ("frames", "window", "stride"),
    [(1, 12, 6), (2, 12, 6), (3, 12, 6), (13, 12, 6), (18, 12, 6), (40, 9, None), (33, 10, 8)],
)
def test_matches_a_loop_over_dense_solves(frames, window, stride, dtype):
    y = np.random.default_rng(frames).standard_normal((frames, 2)).astype(dtype)
    got = windowed_lgs(y, 2.0, 1.5, window=window, stride=stride, scale="unit")
    assert got.dtype == dtype
    want = loop(y.astype(float), 3.0, window, stride or -(-window // 2)) if frames > 2 else y
    np.testing.assert_allclose(got, want, atol=1e-12 if dtype == np.float64 else 2e-5)


def test_missing_frames():
    rng = np.random.default_rng(0)
    y, weights = rng.standard_normal((30, 2)), rng.uniform(0.5, 2, 30)
    weights[[3, 4, 11, 29]] = 0
    want = loop(y, 3.0, 12, 6, weights)
    y[weights == 0] = np.nan
    for given in (weights, jnp.asarray(weights), weights[:, None]):
        got = windowed_lgs(y, 3.0, 1.0, window=12, weights=given, scale="unit")
        np.testing.assert_allclose(got, want, atol=1e-12)


def test_distance_from_the_full_solve():
    """Close while the smoother's reach, sqrt(lam sigma) frames, is short beside the overlap."""
    t = np.arange(600) / 24
    x = np.sin(np.pi * t) + 0.3 * np.sin(2.2 * np.pi * t + 1)
    y = x + 0.15 * np.random.default_rng(7).standard_normal(600)
    for product, bound in ((1.0, 5e-4), (10.0, 1e-3), (100.0, 0.1)):
        whole = lgs(y, product, 1.0, scale="unit").mean
        assert jnp.max(jnp.abs(windowed_lgs(y, product, 1.0, scale="unit") - whole)) < bound


def test_straight_lines_and_parameters_per_channel():
    ramp = np.arange(50)[:, None] * np.array([0.5, -2.0]) + 3
    np.testing.assert_allclose(windowed_lgs(ramp, 20.0, 1.0, window=16), ramp, atol=1e-10)
    y, lam = np.random.default_rng(1).standard_normal((31, 2)), np.array([0.5, 4.0])
    together = windowed_lgs(y, lam, 0.7, window=12)
    for c in range(2):
        alone = windowed_lgs(y[:, c], lam[c], 0.7, window=12)
        np.testing.assert_allclose(together[:, c], alone, atol=1e-12)


def test_order_1_keeps_constants():
    still = np.full((40, 1), 3.0)
    np.testing.assert_allclose(windowed_lgs(still, 5.0, 1.0, window=12, order=1), still, 1e-12)


def test_jit_vmap_and_derivatives():
    y = np.random.default_rng(2).standard_normal((21, 2))

    def smooth(y, lam):
        return windowed_lgs(y, lam, 0.8, window=8)

    assert_jit_and_vmap_agree(smooth, y, np.float64(1.3), rtol=1e-11, atol=1e-12)
    check_gradients(smooth, y, np.float64(1.3))


def turning(rng, frames, joints):
    steps = random_quaternions(rng, (frames, joints), angle=0.3)
    base = random_quaternions(rng, (1, joints))
    q = np.asarray(base + 0.3 * np.cumsum(np.asarray(steps)[..., [1, 2, 3, 0]] - [0, 0, 0, 1], 0))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def test_quaternions_are_aligned_faded_and_renormalised():
    rng = np.random.default_rng(3)
    q = turning(rng, 40, 2)
    want = np.stack([loop(q[:, j], 1.0, 12, 6) for j in range(2)], 1)
    want /= np.linalg.norm(want, axis=-1, keepdims=True)
    flipped = q * rng.choice([-1.0, 1.0], (40, 2, 1))
    got = smooth_quaternions(flipped, 2.0, 1.0, window=12)
    assert_same_rotation(got, want, atol=1e-12)
    short = smooth_quaternions(flipped[:9], 2.0, 1.0, window=12)
    assert_same_rotation(short, smooth_quaternions(flipped[:9], 2.0, 1.0))


def test_motion():
    motion = random_motion(np.random.default_rng(4), frames=30, skeleton=3)
    got = smooth_motion(motion, 2.0, 1.0, window=12)
    assert_same_rotation(
        got.rotations, smooth_quaternions(motion.rotations, 2.0, 1.0, window=12), atol=1e-12
    )
    want = windowed_lgs(motion.translations, 2.0, 1.0, window=12)
    np.testing.assert_allclose(got.translations, want, atol=1e-12)


Y = np.ones((20, 2))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (dict(window=3), "window=3"),
        (dict(window=12, stride=5), "stride=5"),
        (dict(window=12, stride=11), "stride=11"),
        (dict(window=12, steepness=0.0), "steepness=0.0"),
        (dict(window=12, lam=np.ones((2, 2))), r"lam has shape \(2, 2\)"),
        (dict(window=12, weights=np.ones(19)), r"weights have shape \(19,\)"),
        (dict(window=12, weights=-np.ones(20)), "weights must be finite"),
        (dict(window=6, weights=np.r_[np.zeros(6), np.ones(14)]), "2 or more distinct"),
        (dict(window=12, y=np.float64(1.0)), "y is a scalar"),
    ],
)
def test_bad_arguments(options, message):
    options = {"y": Y, "lam": 1.0, **options}
    with pytest.raises(ValueError, match=message):
        windowed_lgs(options.pop("y"), options.pop("lam"), 1.0, **options)


def test_windows_do_not_resample():
    q = jnp.tile(jnp.array([1.0, 0, 0, 0]), (9, 1))
    with pytest.raises(ValueError, match="windows do not resample"):
        smooth_quaternions(q, 1.0, 1.0, window=6, index=np.arange(9), num_frames=9)
    with pytest.raises(ValueError, match="num_frames=12"):
        smooth_quaternions(q, 1.0, 1.0, window=6, num_frames=12)


def test_nan_data_raise():
    y = jnp.ones((20, 2)).at[13, 1].set(jnp.nan)
    with pytest.raises(Exception, match="y holds NaN"):
        jax.block_until_ready(windowed_lgs(y, 1.0, 1.0, window=8))
