"""Means and standard deviations of rotations."""

import functools
import logging

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from jaxmotion import quaternion as qt
from tests.helpers import (
    angle_between,
    assert_finite_derivatives,
    assert_same_rotation,
    check_gradients,
    random_quaternions,
    scipy_rotation,
)

METHODS = ["karcher", "chordal", "recursive"]


@functools.partial(jax.jit, static_argnames=("method", "axis"))
def _mean_and_std(q, weights=None, *, method, axis=0):
    return (
        qt.mean(q, weights, axis=axis, method=method),
        qt.std(q, weights=weights, axis=axis, method=method),
    )


def _cluster(rng, samples, spread, dtype=np.float64):
    """Samples about a random centre, a normal rotation vector of ``spread`` rad times it."""
    turns = Rotation.from_rotvec(spread * rng.standard_normal((samples, 3)) / np.sqrt(3))
    q = (scipy_rotation(random_quaternions(rng)) * turns).as_quat(scalar_first=True)
    return np.asarray(q * rng.choice([-1, 1], (samples, 1)), dtype)


def _brute_force_karcher(q, w):
    samples = scipy_rotation(q)
    start = samples[0]

    def cost(v):
        centre = start * Rotation.from_rotvec(v)
        return np.sum(w * (centre.inv() * samples).magnitude() ** 2)

    found = minimize(cost, np.zeros(3), method="Nelder-Mead", tol=1e-14, options={"maxfev": 4000})
    return (start * Rotation.from_rotvec(found.x)).as_quat(scalar_first=True), found.fun


@pytest.mark.parametrize("weighted", [False, True])
def test_karcher_mean_minimises_the_squared_angles(weighted):
    rng = np.random.default_rng(0)
    q = _cluster(rng, 12, 1.2)
    w = rng.uniform(0, 1, 12) if weighted else np.ones(12)
    expected, cost = _brute_force_karcher(q, w)
    mean, std = _mean_and_std(q, w, method="karcher")
    assert_same_rotation(mean, expected, 1e-6)
    np.testing.assert_allclose(std, np.sqrt(cost / w.sum()), 1e-9)


def test_chordal_mean_is_scipys(dtype):
    rng = np.random.default_rng(1)
    q, w = _cluster(rng, 12, 1.2, dtype), rng.uniform(0, 1, 12).astype(dtype)
    mean, std = _mean_and_std(q, w, method="chordal")
    assert mean.dtype == std.dtype == dtype
    expected = scipy_rotation(q).mean(w).as_quat(scalar_first=True)
    assert_same_rotation(mean, expected, 2e-6 if dtype == np.float32 else 1e-13)


def test_recursive_mean_is_wus_with_the_step_one_over_n():
    """Wu et al. 2006 print the step (n−1)/n; 1/n is the one whose result is near the mean."""
    rng = np.random.default_rng(3)
    for spread, right, wrong in ((0.1, 1e-4, 0.03), (0.6, 0.01, 0.2), (1.4, 0.05, 0.4)):
        q = _cluster(rng, 200, spread)
        karcher = _mean_and_std(q, method="karcher")[0]
        recursive = _mean_and_std(q, method="recursive")[0]
        step, printed = scipy_rotation(q[0]), scipy_rotation(q[0])
        for n, sample in enumerate(q[1:], 2):
            sample = scipy_rotation(sample)
            step = step * (step.inv() * sample) ** (1 / n)
            printed = printed * (printed.inv() * sample) ** ((n - 1) / n if n > 2 else 1 / n)
        assert_same_rotation(recursive, step.as_quat(scalar_first=True)[0], 1e-12)
        assert angle_between(recursive, karcher) < right
        assert angle_between(printed.as_quat(scalar_first=True)[0], karcher) > wrong
        backwards = _mean_and_std(q[::-1], method="recursive")[0]
        assert angle_between(backwards, recursive) < 2 * right


@pytest.mark.parametrize("method", METHODS)
def test_equivariance_repeats_and_signs(method):
    rng = np.random.default_rng(4)
    q, g, h = _cluster(rng, 12, 0.8), random_quaternions(rng), random_quaternions(rng)
    mean, std = _mean_and_std(q, method=method)
    moved = qt.multiply(qt.multiply(g, q), h)
    moved_mean, moved_std = _mean_and_std(moved, method=method)
    assert_same_rotation(moved_mean, qt.multiply(qt.multiply(g, mean), h), 1e-12)
    np.testing.assert_allclose(moved_std, std, 1e-12)
    assert np.asarray(mean) @ q[0] > 0
    # A sample of weight 0 does not count, and weights are relative.
    w = np.where(np.arange(12) < 7, 2.0, 0.0)
    for all_of, only in zip(
        _mean_and_std(q, w, method=method), _mean_and_std(q[:7], method=method), strict=True
    ):
        np.testing.assert_allclose(all_of, only, atol=1e-12)
    # No weight at all counts as equal weights.
    np.testing.assert_allclose(_mean_and_std(q, np.zeros(12), method=method)[0], mean, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_axes_and_weights_of_many_clips(method, dtype):
    rng = np.random.default_rng(5)
    q = np.asarray(random_quaternions(rng, (3, 6, 2), dtype, angle=1.5))
    w = rng.uniform(0.1, 1, 6).astype(dtype)
    mean, std = _mean_and_std(q, w, method=method, axis=1)
    assert mean.shape == (3, 2, 4)
    assert std.shape == (3, 2)
    assert mean.dtype == std.dtype == dtype
    full = np.broadcast_to(w[:, None], (3, 6, 2))
    mean_again, std_again = _mean_and_std(q, full, method=method, axis=-3)
    tolerance = 2e-5 if dtype == np.float32 else 1e-12
    np.testing.assert_allclose(mean_again, mean, atol=tolerance)
    np.testing.assert_allclose(std_again, std, atol=tolerance)
    one_mean, one_std = _mean_and_std(q[1, :, 1], w, method=method)
    np.testing.assert_allclose(mean[1, 1], one_mean, atol=tolerance)
    np.testing.assert_allclose(std[1, 1], one_std, atol=tolerance)


@pytest.mark.parametrize("method", METHODS)
def test_gradients(method):
    rng = np.random.default_rng(6)
    q, w = _cluster(rng, 5, 1.0), rng.uniform(0.5, 1, 5)

    def everything(q, w):
        centre = qt.mean(q, w, method=method)
        return centre, qt.std(q, centre, w)

    check_gradients(everything, q, w)


@pytest.mark.parametrize(
    ("method", "samples"), [("karcher", 1), ("karcher", 2), ("chordal", 3), ("recursive", 3)]
)
def test_equal_samples(method, samples):
    """Each sample moves the mean by its share; the deviation is 0 with gradient 0."""
    rng = np.random.default_rng(7)
    one = np.asarray(random_quaternions(rng))
    q = np.stack([one] * samples)
    mean, std = _mean_and_std(q, method=method)
    assert_same_rotation(mean, one, 1e-14)
    assert std == 0
    by_mean, by_std = (
        each[0]
        for each in assert_finite_derivatives(
            lambda q: (qt.mean(q, method=method), qt.std(q, method=method)), q
        )
    )
    tangent = np.eye(4) - np.outer(one, one)
    for n in range(samples):
        np.testing.assert_allclose(by_mean[:, n] @ tangent, tangent / samples, atol=1e-12)
    np.testing.assert_array_equal(by_std, np.zeros((samples, 4)))


@pytest.mark.parametrize("method", METHODS)
def test_samples_a_half_turn_apart_have_some_mean_and_finite_derivatives(method):
    half_turn = np.array([[1.0, 0, 0, 0], [0, 0.6, 0, 0.8]])
    pair_and_four = np.stack([np.concatenate([half_turn, half_turn]), np.eye(4)], 1)
    assert_finite_derivatives(lambda q: qt.mean(q, method=method), pair_and_four)
    mean = _mean_and_std(pair_and_four, method=method)[0]
    np.testing.assert_allclose(np.linalg.norm(mean, axis=-1), 1, atol=1e-12)


def test_mapped_over_clips_and_not_compiled():
    rng = np.random.default_rng(8)
    q = jnp.asarray(np.stack([_cluster(rng, 12, 1.0) for _ in range(3)]))
    for method in METHODS:
        single = functools.partial(_mean_and_std, method=method)
        mapped = jax.jit(jax.vmap(single))(q)
        for i in range(3):
            for a, b in zip(mapped, single(q[i]), strict=True):
                np.testing.assert_allclose(a[i], b, atol=1e-12)
        np.testing.assert_allclose(qt.mean(q[0], method=method), mapped[0][0], atol=1e-12)


def test_refusals():
    q = np.ones((5, 4))
    with pytest.raises(ValueError, match=r"no samples along axis 0"):
        qt.mean(q[:0])
    for axis in (1, -1, 2):
        with pytest.raises(ValueError, match=rf"axis={axis} of an array of shape \(5, 4\)"):
            qt.std(q, axis=axis)


@pytest.mark.parametrize("method", METHODS)
def test_a_second_call_compiles_nothing(method, caplog):
    """Outside of jit too."""
    q = random_quaternions(np.random.default_rng(6), (5, 3))
    qt.std(q, method=method)
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        qt.std(q, method=method)
    assert "Compiling" not in caplog.text
