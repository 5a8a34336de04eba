"""Matrices, the 6-D representation, and Euler angles in all 24 orders."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

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

LOWER = ["".join(o) for o in itertools.product("xyz", repeat=3) if o[0] != o[1] and o[1] != o[2]]
ORDERS = LOWER + [order.upper() for order in LOWER]
SOME_ORDERS = ["ZXY", "xyz", "YZY", "zxz"]
TOLERANCE = {"float32": 2e-6, "float64": 2e-14}

_from_euler = jax.jit(qt.from_euler, static_argnums=1)
_to_euler = jax.jit(qt.to_euler, static_argnames=("order", "unwrap"))


def _proper(order):
    return order[0] == order[2]


def _middle_range(order):
    return (0.0, np.pi) if _proper(order) else (-np.pi / 2, np.pi / 2)


def test_there_are_24_orders():
    assert len(set(ORDERS)) == 24


def test_matrices_are_scipys(dtype):
    rng = np.random.default_rng(0)
    q = random_quaternions(rng, (50,), dtype)
    tolerance = 2 * TOLERANCE[dtype.name]
    m = qt.to_matrix(q)
    assert m.dtype == dtype
    np.testing.assert_allclose(m, scipy_rotation(q).as_matrix(), tolerance, tolerance)
    back = qt.from_matrix(m)
    assert back.dtype == dtype
    assert_same_rotation(back, q, 4 * tolerance)


def test_from_matrix_near_half_turns_and_the_identity():
    """Every one of Shepperd's four formulas, and the places where two of them tie."""
    axes = [v for v in itertools.product([-1.0, 0, 1], repeat=3) if any(v)]
    q = np.array([[w, *v] for v in axes for w in (0.0, 1e-9, 1e-3, 1.0)] + [[1.0, 0, 0, 0]])
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    m = scipy_rotation(q).as_matrix()
    assert_same_rotation(qt.from_matrix(m), q, 1e-14)
    (jacobian,) = assert_finite_derivatives(jax.vmap(qt.from_matrix), m[::5])
    assert np.max(np.abs(jacobian)) < 10


def test_rotation_6d():
    rng = np.random.default_rng(1)
    q = random_quaternions(rng, (40,))
    columns = qt.to_rotation_6d(q)
    m = scipy_rotation(q).as_matrix()
    np.testing.assert_allclose(columns[:, :3], m[:, :, 0], atol=1e-14)
    np.testing.assert_allclose(columns[:, 3:], m[:, :, 1], atol=1e-14)
    assert_same_rotation(qt.from_rotation_6d(columns), q, 1e-14)
    free = rng.standard_normal((40, 6))
    ours = qt.to_matrix(qt.from_rotation_6d(free))
    for column, r in zip(free, ours, strict=True):
        orthonormal, triangle = np.linalg.qr(column.reshape(2, 3).T)
        orthonormal = orthonormal * np.sign(np.diag(triangle))
        np.testing.assert_allclose(r[:, :2], orthonormal, atol=1e-12)
        np.testing.assert_allclose(r[:, 2], np.cross(*orthonormal.T), atol=1e-12)


def test_matrix_gradients_jit_and_vmap():
    rng = np.random.default_rng(2)
    q = random_quaternions(rng, (4,))
    m = qt.to_matrix(q)
    columns = rng.standard_normal((4, 6))

    def everything(q, m, columns):
        return (
            qt.to_matrix(q),
            qt.from_matrix(m),
            qt.to_rotation_6d(q),
            qt.from_rotation_6d(columns),
        )

    check_gradients(everything, q, m, columns)
    assert_jit_and_vmap_agree(everything, q, m, columns)


@pytest.mark.parametrize("order", ORDERS)
def test_euler_angles_are_scipys(order):
    rng = np.random.default_rng(3)
    angles = rng.uniform(-np.pi, np.pi, (40, 3))
    q = _from_euler(angles, order)
    expected = scipy_rotation(q).from_euler(order, angles)
    assert_same_rotation(q, expected.as_quat(scalar_first=True), 1e-14)
    back = _to_euler(q, order)
    np.testing.assert_allclose(back, expected.as_euler(order), atol=1e-12)
    np.testing.assert_allclose(_to_euler(-q, order), back, atol=1e-12)
    low, high = _middle_range(order)
    assert np.all((back[:, 1] >= low) & (back[:, 1] <= high))
    assert np.all(np.abs(back) <= np.pi)


@pytest.mark.parametrize("order", SOME_ORDERS)
def test_euler_in_float32_with_leading_axes(order):
    rng = np.random.default_rng(4)
    q = random_quaternions(rng, (3, 1, 2, 1), np.float32)
    angles = qt.to_euler(q, order)
    assert angles.shape == (3, 1, 2, 1, 3)
    assert angles.dtype == np.float32
    again = qt.from_euler(angles, order)
    assert again.dtype == np.float32
    assert_same_rotation(again, q, 4e-6)
    assert qt.to_euler(q[0, 0, 0, 0], order).shape == (3,)


@pytest.mark.parametrize("order", ORDERS)
def test_gimbal_lock_and_its_neighbourhood_keep_the_rotation(order):
    low, high = _middle_range(order)
    shifts = np.array([0.0, 1e-16, 1e-14, 1e-12, 1e-9, 1e-6, 1e-3])
    middles = np.concatenate([low + shifts, high - shifts])
    angles = np.stack([np.full(14, 0.7), middles, np.full(14, -2.1)], -1)
    q = _from_euler(angles, order)
    back = np.asarray(_to_euler(q, order))
    assert_same_rotation(_from_euler(back, order), q, 2e-14)
    free = 2 if order.isupper() else 0
    np.testing.assert_array_equal(back[[0, 7], free], [0, 0])


@pytest.mark.parametrize("order", SOME_ORDERS)
def test_euler_derivatives(order):
    rng = np.random.default_rng(5)
    low, high = _middle_range(order)
    angles = rng.uniform(-2.0, 2.0, (3, 3))
    angles[:, 1] = rng.uniform(low + 0.4, high - 0.4, 3)
    q = _from_euler(angles, order)

    def everything(angles, q):
        return qt.from_euler(angles, order), qt.to_euler(q, order)

    check_gradients(everything, angles, q)
    assert_jit_and_vmap_agree(everything, angles, q)
    locked = np.array([[0.3, low, 0.5], [0.3, high, 0.5], [0.0, high, 0.0]])
    assert_finite_derivatives(
        lambda q: (qt.to_euler(q, order), qt.to_euler(q, order, unwrap=True)),
        _from_euler(locked, order),
    )


def test_identity_and_half_turns_have_finite_euler_derivatives():
    q = np.concatenate([np.eye(4), -np.eye(4)])
    assert_finite_derivatives(lambda q: tuple(qt.to_euler(q, order) for order in ("ZXY", "ZXZ")), q)


@pytest.mark.parametrize("order", ORDERS)
def test_unwrapped_angles_follow_the_motion_over_both_branches(order):
    """Every angle turns several times over, so the middle one crosses the gimbal lock again and
    again; starting on the canonical branch, the path itself comes back."""
    t = np.linspace(0, 1, 401)[:, None]
    low, high = _middle_range(order)
    start = np.array([0.4, 0.5 * (low + high) + 0.1, -0.3])
    path = start + t * np.array([9.0, 14.0, -7.0]) + 0.2 * np.sin(11 * t)
    q = _from_euler(path, order)
    signs = np.random.default_rng(6).choice([-1.0, 1.0], (401, 1))
    unwrapped = _to_euler(signs * q, order, unwrap=True)
    np.testing.assert_allclose(unwrapped, path, atol=1e-9)


@pytest.mark.parametrize("order", ORDERS)
def test_unwrapped_angles_are_continuous_through_exact_gimbal_lock(order):
    """The middle angle stops exactly at the lock for a while; the free angle holds still there."""
    low, high = _middle_range(order)
    for lock, inward in ((high, -1.0), (low, 1.0)):
        middle = lock + inward * np.abs(np.linspace(-1, 1, 41))
        middle[15:26] = lock
        steady = np.stack([np.full(41, 0.8), middle, np.full(41, -1.9)], -1)
        q = _from_euler(steady, order)
        unwrapped = np.asarray(_to_euler(q, order, unwrap=True))
        np.testing.assert_allclose(unwrapped, steady, atol=1e-9)
        moving = steady + np.linspace(0, 1, 41)[:, None] * np.array([3.0, 0, 1.0])
        q = _from_euler(moving, order)
        unwrapped = np.asarray(_to_euler(q, order, unwrap=True))
        assert_same_rotation(_from_euler(unwrapped, order), q, 1e-13)
        assert np.max(np.abs(np.diff(unwrapped[15:26], axis=0))) < 0.11


@pytest.mark.parametrize("order", ["ZXY", "xzx"])
def test_unwrapping_a_random_walk_steps_no_further_than_its_alternatives(order):
    rng = np.random.default_rng(7)
    steps = random_quaternions(rng, (300, 2), angle=0.5)
    q = [np.asarray(random_quaternions(rng, (2,)))]
    for step in np.asarray(steps):
        q.append(np.asarray(qt.multiply(q[-1], step)))
    q = np.stack(q)
    unwrapped = np.asarray(_to_euler(q, order, unwrap=True))
    assert_same_rotation(_from_euler(unwrapped, order), q, 1e-12)
    shift = np.array([np.pi, 0, np.pi])
    mirrored = unwrapped.copy()
    mirrored[..., 1] = -mirrored[..., 1] if _proper(order) else np.pi - mirrored[..., 1]
    taken = np.linalg.norm(np.diff(unwrapped, axis=0), axis=-1)
    assert np.max(angle_between(q[1:], q[:-1])) < 0.51
    turns = np.array(list(itertools.product([-1, 0, 1], repeat=3))) * 2 * np.pi
    for other in (unwrapped, mirrored + shift):
        options = other[1:, :, None] + turns - unwrapped[:-1, :, None]
        assert np.all(taken <= np.min(np.linalg.norm(options, axis=-1), -1) + 1e-9)


@pytest.mark.parametrize("frames", [0, 1, 2, 3])
def test_unwrapping_short_clips(frames):
    rng = np.random.default_rng(8)
    q = random_quaternions(rng, (frames, 5))
    angles = qt.to_euler(q, "ZXY", unwrap=True)
    assert angles.shape == (frames, 5, 3)
    np.testing.assert_allclose(angles[:1], qt.to_euler(q, "ZXY")[:1], atol=1e-15)


@pytest.mark.parametrize("order", ["ZZX", "XYY", "ZXy", "XY", "XYZX", "ABC", ""])
def test_orders_that_do_not_exist(order):
    for convert in (qt.from_euler, qt.to_euler):
        with pytest.raises(ValueError, match=r"order='.*'; expected three of X, Y, Z"):
            convert(jnp.ones(3 if convert is qt.from_euler else 4), order)
