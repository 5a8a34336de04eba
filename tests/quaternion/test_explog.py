"""Exponential and logarithm maps, powers and distances."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmotion import quaternion as qt
from tests.helpers import (
    assert_finite_derivatives,
    assert_jit_and_vmap_agree,
    assert_same_rotation,
    check_gradients,
    random_quaternions,
    random_vectors,
    scipy_rotation,
)

TOLERANCE = {"float32": 3e-6, "float64": 2e-14}
ANGLES = [0.0, 1e-12, 1e-8, 1e-6, 1e-4, 1e-3, 0.01, 0.069, 0.071, 0.2, 1.0, 2.0, 3.0, 3.14]


def test_exp_and_log_are_scipys(dtype):
    rng = np.random.default_rng(0)
    v = random_vectors(rng, (60,), dtype, scale=1.5)
    q = random_quaternions(rng, (60,), dtype)
    tolerance = TOLERANCE[dtype.name]
    e, ln = qt.exp(v), qt.log(q)
    assert e.dtype == ln.dtype == dtype
    assert_same_rotation(e, Rotation.from_rotvec(np.array(v)).as_quat(scalar_first=True), tolerance)
    np.testing.assert_allclose(ln, scipy_rotation(q).as_rotvec(), tolerance, tolerance)
    np.testing.assert_allclose(
        qt.distance(q, e), (scipy_rotation(q).inv() * scipy_rotation(e)).magnitude(), atol=4e-6
    )


def test_small_and_large_angles_keep_relative_accuracy(dtype):
    axis = np.array([2.0, -1, 2]) / 3
    v = np.asarray(ANGLES, np.float64)[:, None] * axis
    given = v.astype(dtype)
    half = 0.5 * np.linalg.norm(given.astype(np.float64), axis=-1, keepdims=True)
    sinc = np.sinc(half / np.pi) / 2
    tolerance = TOLERANCE[dtype.name]
    q = qt.exp(given)
    np.testing.assert_allclose(q[:, 1:], sinc * given, tolerance, 0)
    np.testing.assert_allclose(q[:, :1], np.cos(half), tolerance, tolerance)
    np.testing.assert_allclose(qt.log(q)[1:-1], given[1:-1], tolerance, 0)


def test_round_trips_conventions_and_signs(dtype):
    rng = np.random.default_rng(1)
    q = random_quaternions(rng, (50,), dtype)
    v = np.asarray(random_vectors(rng, (50,), dtype))
    v = (v * (0.99 * np.pi / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), np.pi))).astype(
        dtype
    )
    tolerance = 5 * TOLERANCE[dtype.name]

    @jax.jit
    def pairs(q, v):
        return {
            "log exp": (qt.log(qt.exp(v)), v),
            "log_half exp_half": (qt.log_half(qt.exp_half(0.5 * v)), 0.5 * v),
            "halves": (qt.exp_half(v), qt.exp(2 * v)),
            "log_half": (qt.log_half(q), 0.5 * qt.log(q)),
            "-q": (qt.log(-q), qt.log(q)),
            "inverse": (qt.log(qt.conjugate(q)), -qt.log(q)),
            "only the direction": (qt.log(1e-3 * q), qt.log(q)),
            "unit": (jnp.linalg.norm(qt.exp(3 * v), axis=-1), jnp.ones(50, dtype)),
        }

    for name, (left, right) in pairs(q, v).items():
        np.testing.assert_allclose(left, right, tolerance, tolerance, err_msg=name)
    assert_same_rotation(qt.exp(qt.log(q)), q, tolerance)
    assert np.all(np.linalg.norm(qt.log(q), axis=-1) <= np.pi * (1 + 1e-6))


def test_log_of_angle_pi_is_one_of_the_two_vectors(dtype):
    for axis in np.eye(3):
        for w in (0.0, -0.0):
            v = qt.log(np.array([w, *axis], dtype))
            np.testing.assert_allclose(np.abs(v), np.pi * axis, 1e-6)


def test_singular_points_have_finite_derivatives():
    axis = [0.6, 0.0, 0.8]
    points = {
        "identity": [1.0, 0, 0, 0],
        "minus identity": [-1.0, 0, 0, 0],
        "pi": [0.0, *axis],
        "nearly pi": [1e-17, *axis],
        "zero": [0.0, 0, 0, 0],
        "nearly identity": [1.0, 1e-170, 0, 0],
    }
    q = np.array(list(points.values()))

    def everything(q):
        return qt.log(q), qt.power(q, 0.3), qt.distance(q, qt.identity(dtype=q.dtype))

    jacobians = assert_finite_derivatives(everything, q)
    by_log, by_power, by_distance = (
        dict(zip(points, (each[0][i, ..., i, :] for i in range(len(q))), strict=True))
        for each in jacobians
    )
    xyz = np.eye(4)[1:]
    np.testing.assert_allclose(by_log["identity"], 2 * xyz, atol=1e-12)
    np.testing.assert_allclose(by_log["nearly identity"], 2 * xyz, atol=1e-12)
    np.testing.assert_allclose(by_log["minus identity"], -2 * xyz, atol=1e-12)
    np.testing.assert_allclose(by_power["identity"][1:], 0.3 * xyz, atol=1e-12)
    np.testing.assert_allclose(by_log["pi"][:, 0], np.array(axis) * -2, atol=1e-12)
    for place in ("identity", "minus identity"):
        np.testing.assert_array_equal(by_distance[place], np.zeros(4))


def test_exp_at_zero_is_the_half_identity():
    (jacobian,) = assert_finite_derivatives(qt.exp, np.zeros(3))
    np.testing.assert_allclose(jacobian, np.eye(4)[:, 1:] / 2, atol=1e-15)


def test_gradients():
    """Near the identity, where the series hand over, and far away."""
    rng = np.random.default_rng(2)
    v = random_vectors(rng, (9,)) * np.repeat([1e-3, 0.07, 1.0], 3)[:, None]
    q = qt.exp(v)
    b = random_quaternions(rng, (9,))
    t = jnp.asarray(rng.uniform(-2, 2, 9))

    def everything(v, q, b, t):
        return (
            qt.exp(v),
            qt.exp_half(v),
            qt.log(q),
            qt.log_half(q),
            qt.power(q, t),
            (qt.distance(q, b)),
        )

    check_gradients(everything, v, q, b, t, eps=1e-6)


def test_power(dtype):
    rng = np.random.default_rng(3)
    q = random_quaternions(rng, (5, 4), dtype)
    tolerance = 10 * TOLERANCE[dtype.name]
    assert_same_rotation(qt.power(q, 1.0), q, tolerance)
    assert_same_rotation(qt.power(q, -1), qt.conjugate(q), tolerance)
    np.testing.assert_allclose(qt.power(q, 0), qt.identity((5, 4), dtype), atol=tolerance)
    t = np.linspace(-1, 2, 5).astype(dtype)[:, None]
    powers = qt.power(q, t)
    assert powers.dtype == dtype
    for i in range(5):
        expected = scipy_rotation(q[i]) ** float(t[i, 0])
        assert_same_rotation(powers[i], expected.as_quat(scalar_first=True), tolerance)


def test_distance_is_a_metric_on_rotations():
    rng = np.random.default_rng(4)
    a, b, c, g = (random_quaternions(rng, (100,)) for _ in range(4))
    d = qt.distance
    np.testing.assert_allclose(d(a, b), d(b, a), atol=1e-14)
    np.testing.assert_allclose(d(a, -b), d(a, b), atol=1e-14)
    np.testing.assert_allclose(d(a, a), 0, atol=1e-14)
    np.testing.assert_allclose(d(qt.multiply(g, a), qt.multiply(g, b)), d(a, b), atol=1e-13)
    np.testing.assert_allclose(d(qt.multiply(a, g), qt.multiply(b, g)), d(a, b), atol=1e-13)
    assert np.all(d(a, c) <= d(a, b) + d(b, c) + 1e-13)


def test_jit_and_vmap():
    rng = np.random.default_rng(5)

    def everything(v, q, b):
        return qt.exp(v), qt.log(q), qt.power(q, 0.4), qt.distance(q, b), qt.log_half(b)

    assert_jit_and_vmap_agree(
        everything,
        random_vectors(rng, (4,)),
        random_quaternions(rng, (4,)),
        random_quaternions(rng, (4,)),
    )


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2, 1), (0,)])
def test_leading_axes(shape):
    rng = np.random.default_rng(6)
    q = random_quaternions(rng, shape)
    assert qt.log(q).shape == (*shape, 3)
    assert qt.exp(qt.log(q)).shape == qt.power(q, 0.5).shape == (*shape, 4)
    assert qt.distance(q, q).shape == shape
