"""Spherical linear interpolation."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from jaxmotion import quaternion as qt
from tests.helpers import (
    angle_between,
    assert_finite_derivatives,
    assert_jit_and_vmap_agree,
    assert_same_rotation,
    check_gradients,
    random_quaternions,
    scipy_rotation,
)


def test_slerp_is_scipys(dtype):
    rng = np.random.default_rng(0)
    a, b = random_quaternions(rng, (20,), dtype), random_quaternions(rng, (20,), dtype)
    t = np.linspace(0, 1, 7).astype(dtype)
    ours = jax.jit(qt.slerp)(a[:, None], b[:, None], t)
    assert ours.shape == (20, 7, 4)
    assert ours.dtype == dtype
    for i in range(20):
        ends = Rotation.concatenate([scipy_rotation(a[i]), scipy_rotation(b[i])])
        expected = Slerp([0, 1], ends)(t).as_quat(scalar_first=True)
        assert_same_rotation(ours[i], expected, 2e-6 if dtype == np.float32 else 1e-13)


def test_ends_speed_signs_and_extrapolation():
    rng = np.random.default_rng(1)
    a, b = random_quaternions(rng, (30,)), random_quaternions(rng, (30,))
    slerp = jax.jit(qt.slerp)
    np.testing.assert_allclose(slerp(a, b, 0.0), a, atol=1e-15)
    assert_same_rotation(slerp(a, b, 1.0), b, 1e-13)
    assert_same_rotation(slerp(a, -b, 0.3), slerp(a, b, 0.3), 1e-13)
    assert_same_rotation(slerp(b, a, 0.7), slerp(a, b, 0.3), 1e-13)
    total = angle_between(a, b)
    np.testing.assert_allclose(angle_between(a, slerp(a, b, 0.25)), total / 4, atol=1e-13)
    beyond = slerp(a, b, 1.5)
    assert_same_rotation(slerp(a, beyond, 2 / 3)[total < 2], b[total < 2], 1e-12)


def test_jit_and_vmap():
    rng = np.random.default_rng(2)
    assert_jit_and_vmap_agree(
        lambda a, b, t: qt.slerp(a, b, t),
        random_quaternions(rng, (5,)),
        random_quaternions(rng, (5,)),
        jnp.linspace(0, 1, 5),
    )


def test_gradients():
    rng = np.random.default_rng(3)
    a, b = random_quaternions(rng, (4,)), random_quaternions(rng, (4,))
    check_gradients(qt.slerp, a, b, jnp.asarray(rng.uniform(-1, 2, 4)))


def test_derivatives_where_the_ends_meet_or_are_opposite():
    rng = np.random.default_rng(4)
    q = np.asarray(random_quaternions(rng))
    half_turn = np.asarray(qt.multiply(q, np.array([0.0, 0.6, 0, 0.8])))
    a = np.stack([q, q, q])
    b = np.stack([q, -q, half_turn])
    by_a, by_b = assert_finite_derivatives(lambda a, b: qt.slerp(a, b, 0.25), a, b)
    for i, sign in ((0, 1), (1, -1)):
        tangent = np.eye(4) - np.outer(q, q)
        np.testing.assert_allclose(by_a[i, :, i] @ tangent, 0.75 * tangent, atol=1e-12)
        np.testing.assert_allclose(by_b[i, :, i] @ tangent, sign * 0.25 * tangent, atol=1e-12)
