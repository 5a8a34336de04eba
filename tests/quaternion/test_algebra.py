"""Products, inverses, rotations of vectors, and signs along time."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import quaternion as qt
from tests.helpers import (
    assert_finite_derivatives,
    assert_jit_and_vmap_agree,
    assert_same_rotation,
    check_gradients,
    no_shape_checks,
    random_quaternions,
    random_vectors,
    scipy_rotation,
)

TOLERANCE = {"float32": 2e-6, "float64": 1e-14}


def test_hamilton_products_of_the_units():
    one, i, j, k = np.eye(4)
    assert np.array_equal(qt.multiply(i, j), k)
    assert np.array_equal(qt.multiply(j, k), i)
    assert np.array_equal(qt.multiply(k, i), j)
    assert np.array_equal(qt.multiply(j, i), -k)
    for unit in (i, j, k):
        assert np.array_equal(qt.multiply(unit, unit), -one)


def test_rotation_is_active_and_right_handed():
    quarter_about_z = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    np.testing.assert_allclose(
        qt.rotate(quarter_about_z, np.array([1.0, 0, 0])), [0, 1, 0], atol=1e-15
    )


def test_products_and_rotations_are_scipys(dtype):
    rng = np.random.default_rng(0)
    a, b = random_quaternions(rng, (50,), dtype), random_quaternions(rng, (50,), dtype)
    v = random_vectors(rng, (50,), dtype)
    tolerance = TOLERANCE[dtype.name]
    product = qt.multiply(a, b)
    assert product.dtype == dtype
    assert_same_rotation(
        product, (scipy_rotation(a) * scipy_rotation(b)).as_quat(scalar_first=True), 4 * tolerance
    )
    np.testing.assert_allclose(
        qt.rotate(a, v), scipy_rotation(a).apply(np.array(v)), tolerance * 4, tolerance * 4
    )
    assert_same_rotation(
        qt.between(a, b),
        (scipy_rotation(a).inv() * scipy_rotation(b)).as_quat(scalar_first=True),
        4 * tolerance,
    )


def test_group_axioms(dtype):
    rng = np.random.default_rng(1)
    a, b, c = (3 * random_quaternions(rng, (30,), dtype) for _ in range(3))
    v = random_vectors(rng, (30,), dtype)
    tolerance = 30 * TOLERANCE[dtype.name]

    @jax.jit
    def identities(a, b, c, v):
        ua, ub = qt.normalize(a), qt.normalize(b)
        one = jnp.broadcast_to(qt.identity(dtype=dtype), a.shape)
        return {
            "associative": (
                qt.multiply(qt.multiply(a, b), c),
                qt.multiply(a, qt.multiply(b, c)),
            ),
            "identity": (qt.multiply(a, qt.identity(dtype=dtype)), a),
            "right inverse": (qt.multiply(a, qt.inverse(a)), one),
            "left inverse": (qt.multiply(qt.inverse(a), a), one),
            "conjugate of a unit": (qt.conjugate(ua), qt.inverse(ua)),
            "conjugate of a product": (
                qt.conjugate(qt.multiply(a, b)),
                qt.multiply(qt.conjugate(b), qt.conjugate(a)),
            ),
            "norm of a product": (
                jnp.linalg.norm(qt.multiply(a, b), axis=-1),
                jnp.linalg.norm(a, axis=-1) * jnp.linalg.norm(b, axis=-1),
            ),
            "action": (
                qt.rotate(qt.multiply(ua, ub), v),
                qt.rotate(ua, qt.rotate(ub, v)),
            ),
            "length kept": (
                jnp.linalg.norm(qt.rotate(ua, v), axis=-1),
                jnp.linalg.norm(v, axis=-1),
            ),
            "between": (qt.multiply(ua, qt.between(ua, ub)), ub),
            "normalize": (qt.normalize(a) * jnp.linalg.norm(a, axis=-1, keepdims=True), a),
        }

    for name, (left, right) in identities(a, b, c, v).items():
        assert left.dtype == dtype, name
        np.testing.assert_allclose(left, right, tolerance, tolerance, err_msg=name)


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2, 1), (0,), (0, 4)])
def test_leading_axes(shape):
    rng = np.random.default_rng(2)
    q, v = random_quaternions(rng, shape), random_vectors(rng, shape)
    assert qt.multiply(q, q).shape == (*shape, 4)
    assert qt.rotate(q, v).shape == (*shape, 3)
    assert qt.inverse(q).shape == qt.normalize(q).shape == qt.conjugate(q).shape == (*shape, 4)
    assert qt.identity(shape).shape == (*shape, 4)
    assert np.all(qt.identity(shape) == np.array([1.0, 0, 0, 0]))


def test_leading_axes_broadcast_against_each_other():
    rng = np.random.default_rng(3)
    a, b = random_quaternions(rng, (3, 1, 2, 1)), random_quaternions(rng, (4, 1, 5))
    product = qt.multiply(a, b)
    assert product.shape == (3, 4, 2, 5, 4)
    np.testing.assert_array_equal(product[2, 3, 1, 4], qt.multiply(a[2, 0, 1, 0], b[3, 0, 4]))
    v = random_vectors(rng, (5,))
    assert qt.rotate(a, v).shape == (3, 1, 2, 5, 3)


def test_jit_and_vmap():
    rng = np.random.default_rng(4)
    a, b = random_quaternions(rng, (6,)), random_quaternions(rng, (6,))
    v = random_vectors(rng, (6,))

    def everything(a, b, v):
        return (
            qt.multiply(a, b),
            qt.rotate(a, v),
            qt.between(a, b),
            qt.inverse(3 * a),
            qt.normalize(2 * b),
            qt.align_signs(a),
        )

    assert_jit_and_vmap_agree(everything, a, b, v)


def test_inputs_are_left_alone():
    q = np.array([[2.0, 0, 0, 0], [-1.0, 1, 0, 0]])
    kept = q.copy()
    qt.normalize(q)
    qt.align_signs(q)
    qt.multiply(q, q)
    np.testing.assert_array_equal(q, kept)


def test_gradients():
    rng = np.random.default_rng(5)
    a, b = random_quaternions(rng, (3,)), random_quaternions(rng, (3,))
    v = random_vectors(rng, (3,))

    def everything(a, b, v):
        return qt.multiply(a, b), qt.rotate(a, v), qt.inverse(a), qt.normalize(1.5 * b)

    check_gradients(everything, a, b, v)


def test_zero_quaternion_normalizes_to_the_identity_without_gradient():
    (jacobian,) = assert_finite_derivatives(qt.normalize, np.zeros(4))
    np.testing.assert_array_equal(qt.normalize(np.zeros(4)), [1, 0, 0, 0])
    np.testing.assert_array_equal(jacobian, np.zeros((4, 4)))


@pytest.mark.parametrize("frames", [0, 1, 2, 3, 40])
def test_align_signs_walks_from_the_first_sample(frames):
    rng = np.random.default_rng(6)
    q = random_quaternions(rng, (frames, 3))
    expected = np.array(q)
    for t in range(1, frames):
        for j in range(3):
            if expected[t, j] @ expected[t - 1, j] < 0:
                expected[t, j] *= -1
    np.testing.assert_array_equal(qt.align_signs(q), expected)
    moved = qt.align_signs(np.moveaxis(np.asarray(q), 0, 1), axis=-2)
    np.testing.assert_array_equal(np.moveaxis(moved, 1, 0), expected)
    np.testing.assert_array_equal(qt.align_signs(expected), expected)


def test_align_signs_keeps_dtype_and_passes_gradients_through(dtype):
    q = jnp.asarray([[1.0, 0, 0, 0], [-1.0, 0.1, 0, 0], [-1.0, 0.2, 0, 0]], dtype)
    aligned, pull = jax.vjp(qt.align_signs, q)
    assert aligned.dtype == dtype
    np.testing.assert_array_equal(aligned[:, 0], [1, 1, 1])
    np.testing.assert_array_equal(pull(jnp.ones_like(q))[0][:, 0], [1, -1, -1])


@pytest.mark.parametrize("axis", [-1, 2, 3, -4])
def test_align_signs_refuses_axes_that_are_not_before_the_last(axis):
    with pytest.raises(ValueError, match=rf"align_signs: axis={axis} of an array of shape"):
        qt.align_signs(np.ones((5, 3, 4)), axis=axis)


def test_wrong_components_are_refused_by_name():
    q, v = np.ones((5, 4)), np.ones((5, 3))
    calls = [
        (qt.multiply, (v, q), r"a must have shape \(\.\.\., 4\), got \(5, 3\)"),
        (qt.multiply, (q, v), r"b must have shape \(\.\.\., 4\), got \(5, 3\)"),
        (qt.rotate, (q, q), r"v must have shape \(\.\.\., 3\), got \(5, 4\)"),
        (qt.log, (np.ones(()),), r"q must have shape \(\.\.\., 4\), got \(\)"),
        (qt.exp, (q,), r"v must have shape"),
        (qt.to_euler, (v,), r"q must have shape"),
        (qt.from_euler, (q,), r"angles must have shape"),
    ]
    for function, given, message in calls:
        with no_shape_checks(), pytest.raises(ValueError, match=message):
            function(*given)
