"""Matrices, the 6-D representation, and Euler angles in all 24 orders."""

import functools
import itertools
import logging

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmotion import quaternion as qt
from tests.helpers import (
    angle_between,
    assert_finite_derivatives,
    assert_jit_and_vmap_agree,
    assert_same_rotation,
    check_gradients,
    no_shape_checks,
    random_quaternions,
    scipy_rotation,
)

LOWER = ["".join(o) for o in itertools.product("xyz", repeat=3) if o[0] != o[1] and o[1] != o[2]]
ORDERS = LOWER + [order.upper() for order in LOWER]
SOME_ORDERS = ["ZXY", "xyz", "YZY", "zxz"]
TOLERANCE = {"float32": 2e-6, "float64": 2e-14}

_from_euler = jax.jit(qt.from_euler, static_argnums=1)


@functools.partial(jax.jit, static_argnums=1)
def _to_euler_both(q, order):
    return qt.to_euler(q, order), qt.to_euler(q, order, unwrap=True)


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


FRAMES = 201
_LOCK_SHIFTS = np.array([0.0, 1e-16, 1e-14, 1e-12, 1e-9, 1e-6, 1e-3])


def _clip(order):
    """Angle paths f[FRAMES, 10, 3] that share one compile an order; see the rows below."""
    rng = np.random.default_rng(3)
    low, high = _middle_range(order)
    t = np.linspace(0, 1, FRAMES)
    rows = {"random": rng.uniform(-np.pi, np.pi, (FRAMES, 3))}
    # Every angle turns several times over: the middle one crosses the lock again and again.
    start = [0.4, 0.5 * (low + high) + 0.1, -0.3]
    rows["turning"] = start + t[:, None] * [9.0, 14.0, -7.0] + 0.2 * np.sin(11 * t)[:, None]
    for name, lock, inward in (("high", high, -1.0), ("low", low, 1.0)):
        middle = lock + inward * np.abs(np.linspace(-1, 1, FRAMES))
        middle[90:111] = lock  # exactly, for a while
        others = np.full(FRAMES, 0.8), np.full(FRAMES, -1.9)
        rows[f"still at {name}"] = np.stack([others[0], middle, others[1]], -1)
        rows[f"moving at {name}"] = rows[f"still at {name}"] + t[:, None] * [3.0, 0, 1.0]
        nearby = lock + inward * np.resize(_LOCK_SHIFTS, FRAMES)
        rows[f"near {name}"] = np.stack([np.full(FRAMES, 0.7), nearby, np.full(FRAMES, -2.1)], -1)
    return dict(zip(rows, range(len(rows)), strict=True)), np.stack(list(rows.values()), 1)


@pytest.mark.parametrize("order", ORDERS)
def test_euler_angles(order):
    row, angles = _clip(order)
    q = np.asarray(_from_euler(angles, order))
    signs = np.random.default_rng(4).choice([-1.0, 1.0], (FRAMES, 1, 1))
    back, unwrapped = (np.asarray(x) for x in _to_euler_both(signs * q, order))

    # SciPy's meaning of the letters, and its canonical range.
    expected = Rotation.from_euler(order, angles.reshape(-1, 3))
    assert_same_rotation(q, expected.as_quat(scalar_first=True).reshape(q.shape), 1e-14)
    free = row["random"]
    canonical = Rotation.from_euler(order, angles[:, free]).as_euler(order)
    np.testing.assert_allclose(back[:, free], canonical, atol=1e-11)
    low, high = _middle_range(order)
    assert np.all((back[..., 1] >= low) & (back[..., 1] <= high))
    assert np.all(np.abs(back) <= np.pi)

    # The rotation survives everywhere, in gimbal lock too, where the free angle is 0.
    assert_same_rotation(_from_euler(back, order), q, 3e-14)
    assert_same_rotation(_from_euler(unwrapped, order), q, 1e-12)
    at_zero = 2 if order.isupper() else 0
    for name in ("near high", "near low"):
        np.testing.assert_array_equal(back[:: len(_LOCK_SHIFTS), row[name], at_zero], 0)

    # Unwrapped, the path itself comes back over both branches and through the lock.
    for name in ("turning", "still at high", "still at low"):
        np.testing.assert_allclose(
            unwrapped[:, row[name]], angles[:, row[name]], atol=1e-9, err_msg=name
        )
    for name in ("moving at high", "moving at low"):
        steps = np.abs(np.diff(unwrapped[90:111, row[name]], axis=0))
        assert np.max(steps) < 3.1 / (FRAMES - 1), name


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


@pytest.mark.parametrize("order", ["ZXY", "zxz"])
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


@pytest.mark.parametrize("order", SOME_ORDERS)
def test_euler_derivatives_in_gimbal_lock_are_finite(order):
    low, high = _middle_range(order)
    locked = np.array([[0.3, low, 0.5], [0.3, high, 0.5], [0.0, high, 0.0]])
    assert_finite_derivatives(
        lambda q: qt.to_euler(q, order, unwrap=True), _from_euler(locked, order)
    )


def test_identity_and_half_turns_have_finite_euler_derivatives():
    q = np.concatenate([np.eye(4), -np.eye(4)])
    assert_finite_derivatives(lambda q: tuple(qt.to_euler(q, order) for order in ("ZXY", "ZXZ")), q)


@pytest.mark.parametrize("order", ["ZXY", "xzx"])
def test_unwrapping_a_random_walk_steps_no_further_than_its_alternatives(order):
    rng = np.random.default_rng(7)
    steps = random_quaternions(rng, (300, 2), angle=0.5)
    q = [np.asarray(random_quaternions(rng, (2,)))]
    for step in np.asarray(steps):
        q.append(np.asarray(qt.multiply(q[-1], step)))
    q = np.stack(q)
    unwrapped = np.asarray(_to_euler_both(q, order)[1])
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


def test_unwrapping_again_compiles_nothing(caplog):
    """Outside of jit too."""
    q = random_quaternions(np.random.default_rng(9), (3, 5))
    qt.to_euler(q, unwrap=True)
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        qt.to_euler(q, unwrap=True)
    assert "Compiling" not in caplog.text


@pytest.mark.parametrize("order", ["ZZX", "XYY", "ZXy", "XY", "XYZX", "ABC", ""])
def test_orders_that_do_not_exist(order):
    for convert in (qt.from_euler, qt.to_euler):
        with pytest.raises(ValueError, match=r"order='.*'; expected three of X, Y, Z"):
            convert(jnp.ones(3 if convert is qt.from_euler else 4), order)


def test_shapes_that_are_no_rotations_are_refused_by_name():
    """Rows were once clamped: two of them gave a wrong unit quaternion."""
    m, columns, q = np.eye(3), np.ones(6), np.ones((2, 4))
    calls = [
        (
            qt.from_matrix,
            (m[:2],),
            r"from_matrix: m must have shape \(\.\.\., 3, 3\), got \(2, 3\)",
        ),
        (qt.from_matrix, (np.ones((4, 3)),), r"from_matrix: m must have shape .* got \(4, 3\)"),
        (qt.from_matrix, (m[0],), r"from_matrix: m must have shape .* got \(3,\)"),
        (qt.from_rotation_6d, (columns[:5],), r"from_rotation_6d: columns must .* 6\), got \(5,\)"),
        (qt.from_rotation_6d, (np.ones(()),), r"from_rotation_6d: columns must have shape"),
        (qt.normalize, (q[:, :1],), r"normalize: q must have shape \(\.\.\., 4\), got \(2, 1\)"),
        (qt.mean, (q[:, :3],), r"mean, std: q must have shape \(\.\.\., 4\), got \(2, 3\)"),
        (qt.std, (q[:, :3],), r"mean, std: q must have shape \(\.\.\., 4\), got \(2, 3\)"),
    ]
    for function, given, message in calls:
        with no_shape_checks(), pytest.raises(ValueError, match=message):
            function(*given)
    with pytest.raises(ValueError, match=r"to_euler: unwrap needs q of shape .*, got \(4,\)"):
        qt.to_euler(q[0], unwrap=True)


def test_degrees_in_and_out(dtype):
    q = random_quaternions(np.random.default_rng(5), (9, 3), dtype)
    angles = qt.to_euler(q, "ZXY", degrees=True)
    assert angles.dtype == dtype
    expected = scipy_rotation(q).as_euler("ZXY", degrees=True).reshape(9, 3, 3)
    np.testing.assert_allclose(angles, expected, atol=1e4 * TOLERANCE[dtype.name])
    back = qt.from_euler(angles, "ZXY", degrees=True)
    assert back.dtype == dtype
    assert_same_rotation(back, q, 100 * TOLERANCE[dtype.name])
    smooth = qt.to_euler(q, "ZXY", unwrap=True, degrees=True)
    np.testing.assert_allclose(
        smooth, np.degrees(qt.to_euler(q, "ZXY", unwrap=True)), 10 * TOLERANCE[dtype.name]
    )


def test_the_real_part_first_or_last(dtype):
    q = random_quaternions(np.random.default_rng(6), (5, 2), dtype)
    last = qt.to_xyzw(q)
    assert last.dtype == dtype
    np.testing.assert_array_equal(last[..., 3], q[..., 0])
    np.testing.assert_array_equal(last[..., :3], q[..., 1:])
    np.testing.assert_allclose(
        Rotation.from_quat(np.asarray(last).reshape(-1, 4)).as_matrix(),
        scipy_rotation(q).as_matrix(),
        atol=1e-6,
    )
    np.testing.assert_array_equal(qt.from_xyzw(last), q)
    with no_shape_checks(), pytest.raises(ValueError, match=r"q must have shape \(..., 4\)"):
        qt.from_xyzw(np.ones(3))
