"""Safe roots, arctangents and the Taylor switches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import _numerics as num
from jaxmotion import quaternion as qt
from tests.helpers import assert_finite_derivatives, check_gradients, random_quaternions


def test_safe_sqrt_and_norm():
    x = jnp.array([0.0, 1e-300, 4.0])
    np.testing.assert_allclose(num.safe_sqrt(x), np.sqrt(x))
    np.testing.assert_array_equal(num.safe_sqrt(x, 1e-200), [0, 0, 2])
    slope = jax.vmap(jax.grad(num.safe_sqrt))(x)
    np.testing.assert_allclose(slope, [0, 0.5e150, 0.25])
    v = jnp.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(num.safe_norm(v), [5, 0])
    assert num.safe_norm(v, axis=0, keepdims=True).shape == (1, 3)
    (jacobian,) = assert_finite_derivatives(num.safe_norm, v)
    np.testing.assert_allclose(jacobian[0, 0], [0.6, 0.8, 0])
    np.testing.assert_array_equal(jacobian[1, 1], [0, 0, 0])


def test_safe_arctan2():
    rng = np.random.default_rng(0)
    y, x = jnp.asarray(rng.standard_normal((2, 20)))
    np.testing.assert_allclose(num.safe_arctan2(y, x), np.arctan2(y, x))
    by_y, by_x = assert_finite_derivatives(num.safe_arctan2, np.zeros(2), np.array([0.0, 1.0]))
    np.testing.assert_array_equal(by_y, [[0, 0], [0, 1]])
    np.testing.assert_array_equal(by_x, np.zeros((2, 2)))


def _around_the_switch(dtype):
    switch = num.series_switch(dtype)
    return np.array([0, 1e-30, 1e-3 * switch, 0.99 * switch, 1.01 * switch, 0.1, 4, 30], dtype)


@pytest.mark.parametrize(
    ("ours", "exact"),
    [
        (num.cos_half, lambda theta: np.cos(theta / 2)),
        (num.sin_half_over, lambda theta: 0.5 * np.sinc(theta / (2 * np.pi))),
    ],
)
def test_series_meet_the_functions(ours, exact, dtype):
    x = _around_the_switch(dtype)
    value = ours(jnp.asarray(x))
    assert value.dtype == dtype
    eps = np.finfo(dtype).eps
    np.testing.assert_allclose(value, exact(np.sqrt(x.astype(np.float64))), 8 * eps, 8 * eps)


def test_series_have_the_functions_derivatives():
    """Either side of the switch, first and second derivatives agree with the other side's."""
    switch = num.series_switch(np.float64)
    near, far = jnp.asarray(0.999999 * switch), jnp.asarray(1.000001 * switch)
    for f in (num.cos_half, num.sin_half_over, lambda x: num.angle_over_sine(x, jnp.sqrt(1 - x))):
        for derivative in (f, jax.grad(f), jax.grad(jax.grad(f))):
            np.testing.assert_allclose(derivative(near), derivative(far), 1e-3)
    x = jnp.asarray([1e-9, 0.3, 2.0])
    check_gradients(lambda x: (num.cos_half(x), num.sin_half_over(x)), x, eps=1e-10, rtol=1e-4)


def test_angle_over_sine(dtype):
    half = np.array([0, 1e-12, 1e-4, 0.01, 0.05, 0.08, 0.5, 1.5, np.pi / 2])
    for scale in (1.0, 1e-3, 1e3):
        s, w = (scale * np.sin(half)).astype(dtype), (scale * np.cos(half)).astype(dtype)
        value = num.angle_over_sine(jnp.asarray(s * s), jnp.asarray(np.abs(w)))
        assert value.dtype == dtype
        wide_s, wide_w = s.astype(np.float64), np.abs(w).astype(np.float64)
        safe = np.where(wide_s > 0, wide_s, 1)
        exact = np.where(wide_s > 0, 2 * np.arctan2(wide_s, wide_w) / safe, 2 / wide_w)
        np.testing.assert_allclose(value, exact, 20 * np.finfo(dtype).eps)
    nothing = jnp.zeros((), dtype)
    assert num.angle_over_sine(nothing, nothing) == 2
    for slope in jax.grad(num.angle_over_sine, (0, 1))(nothing, nothing):
        assert np.isfinite(slope)


def test_rounding_angle_bounds_what_rounding_leaves(dtype):
    q = random_quaternions(np.random.default_rng(1), (2000,), dtype)
    leftover = jax.jit(lambda q: num.safe_norm(qt.log(qt.between(q, q))))(q)
    assert np.max(leftover) < num.rounding_angle(dtype)
