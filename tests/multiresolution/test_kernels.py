"""Steps and turns by component, against the quaternion room and finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import quaternion
from jaxmotion.multiresolution.kernels import (
    halfway,
    parts_of,
    quaternions_of,
    rotations_of,
    step,
    steps,
    together,
    turned,
    wrapped,
)
from tests.helpers import (
    assert_finite_derivatives,
    check_gradients,
    random_quaternions,
    random_vectors,
)


@jax.jit
def _step(a, b):
    return together(step(rotations_of(a), rotations_of(b)))


@jax.jit
def _turned(q, v):
    return together(quaternions_of(turned(rotations_of(q), wrapped(parts_of(v)))))


@jax.jit
def _halfway(q, v):
    rotations = rotations_of(q)
    return together(quaternions_of(halfway(rotations, steps(rotations), parts_of(v))))


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0, 3.14159])
def test_they_are_log_and_exp(scale, dtype):
    rng = np.random.default_rng(0)
    eps = np.finfo(dtype).eps
    q = random_quaternions(rng, (40, 3))
    v = np.asarray(random_vectors(rng, (40, 3)))
    v = scale * v / np.linalg.norm(v, axis=-1, keepdims=True)
    after = _turned(q.astype(dtype), v.astype(dtype))
    assert after.dtype == dtype
    want = quaternion.multiply(q, quaternion.exp(v))
    np.testing.assert_allclose(after, want, atol=8 * eps)
    back = np.asarray(_step(q.astype(dtype), (-want).astype(dtype)), np.float64)
    sign = np.sign(np.sum(back * v, -1, keepdims=True))
    np.testing.assert_allclose(np.where(scale > 3, sign, 1) * back, v, atol=40 * eps)


def test_long_vectors_are_wrapped():
    rng = np.random.default_rng(1)
    q, v = random_quaternions(rng, (50, 1)), 20 * random_vectors(rng, (50, 1))
    want = quaternion.multiply(q, quaternion.exp(v))
    got = _turned(q, v)
    sign = np.sign(np.sum(got * want, -1, keepdims=True))
    np.testing.assert_allclose(sign * got, want, atol=1e-13)
    assert np.linalg.norm(together(wrapped(parts_of(v))), axis=-1).max() <= np.pi + 1e-12


def test_derivatives():
    rng = np.random.default_rng(2)
    a = random_quaternions(rng, (4, 2))
    v = 1.1 * random_vectors(rng, (4, 2))
    normalize = quaternion.normalize
    check_gradients(lambda a, b: _step(normalize(a), normalize(b)), a, _turned(a, v))
    check_gradients(lambda a, v: _turned(normalize(a), v), a, v)


def test_derivatives_are_finite_at_rest_and_at_half_a_turn():
    identity = jnp.asarray([[[1.0, 0, 0, 0]]])
    half = jnp.asarray([[[0.0, 1, 0, 0]]])
    zero = jnp.zeros((1, 1, 3))
    for a, b in ((identity, identity), (identity, half), (identity, -identity)):
        assert_finite_derivatives(_step, a, b)
    for v in (zero, zero.at[..., 0].set(np.pi), zero.at[..., 1].set(2 * np.pi)):
        (_, by_v) = assert_finite_derivatives(_turned, identity, v)
    assert np.abs(by_v).max() > 0.1


def test_halfway_is_slerp_and_exp_whatever_the_signs():
    rng = np.random.default_rng(3)
    q = random_quaternions(rng, (9, 4))
    v = 0.5 * random_vectors(rng, (8, 4))
    middle = quaternion.slerp(q[:-1], q[1:], 0.5)
    want = np.asarray(quaternion.multiply(middle, quaternion.exp(v)))
    sign = np.sign(np.sum(np.asarray(middle) * q[:-1], -1, keepdims=True))
    np.testing.assert_allclose(_halfway(q, v), sign * want, atol=1e-14)


def test_derivatives_along_time():
    rng = np.random.default_rng(4)
    q = random_quaternions(rng, (5, 2))
    v = 0.7 * random_vectors(rng, (4, 2))
    normalize = quaternion.normalize
    check_gradients(lambda q, v: _halfway(normalize(q), v), q, v)
    check_gradients(lambda q: together(steps(rotations_of(normalize(q)))), q)


def test_wrapping_passes_the_derivative_of_the_same_rotation():
    v = 9 * random_vectors(np.random.default_rng(5), (6, 2))
    assert np.linalg.norm(v, axis=-1).max() > 2 * np.pi
    check_gradients(lambda v: together(wrapped(parts_of(v))), v)


def test_unit_is_normalize_and_so_are_its_derivatives():
    q = 3 * np.random.default_rng(6).standard_normal((5, 2, 4))
    q[2, 1] = 0
    weights = np.random.default_rng(7).standard_normal(q.shape)

    def loss(normalized):
        return lambda q: jnp.sum(weights * normalized(q) ** 3)

    def by_parts(q):
        return together(quaternions_of(rotations_of(q)))

    np.testing.assert_allclose(by_parts(q), quaternion.normalize(q), atol=1e-15)
    want = jax.grad(loss(quaternion.normalize))(q)
    np.testing.assert_allclose(jax.grad(loss(by_parts))(q), want, atol=1e-14)
    check_gradients(by_parts, np.delete(q, 2, axis=0))


def test_second_derivatives_also_through_loops():
    rng = np.random.default_rng(8)
    q, v = random_quaternions(rng, (5, 2)), 0.4 * random_vectors(rng, (5, 2))
    other = random_quaternions(rng, (5, 2))
    weights = jnp.asarray(rng.standard_normal((5, 2, 4)))

    def loss(size):
        def body(rotations, _):
            ends = jax.tree.map(lambda x: x[-1:], rotations)
            middle = halfway(rotations, steps(rotations), parts_of(size * v[:4]))
            longer = jax.tree.map(lambda x, y: jnp.concatenate([x, y]), middle, ends)
            change = step(longer, rotations_of(other))
            change = wrapped(tuple(8 * size * x for x in change))
            return turned(longer, change), None

        last, _ = jax.lax.scan(body, rotations_of(3 * size * q), None, 2)
        return jnp.sum(weights * together(quaternions_of(last)))

    first = jax.jit(jax.grad(loss))
    want = (first(1.0 + 1e-5) - first(1.0 - 1e-5)) / 2e-5
    for second in (
        jax.hessian(loss),
        jax.jacfwd(jax.jacfwd(loss)),
        jax.grad(jax.grad(loss)),
        jax.grad(lambda size: jax.jvp(loss, (size,), (1.0,))[1]),
    ):
        np.testing.assert_allclose(jax.jit(second)(1.0), want, rtol=1e-6)


def test_steps_beyond_the_frames_that_count_are_zero_and_pass_nothing():
    q = random_quaternions(np.random.default_rng(9), (6, 2))
    counted = together(steps(rotations_of(q), jnp.asarray(4)))
    np.testing.assert_array_equal(counted[3:], 0)
    np.testing.assert_array_equal(counted[:3], together(steps(rotations_of(q)))[:3])
    weights = jnp.asarray(random_vectors(np.random.default_rng(10), (5, 2)))
    got = jax.grad(lambda q: jnp.sum(weights * together(steps(rotations_of(q), jnp.asarray(4)))))(q)
    want = jax.grad(lambda q: jnp.sum((weights * together(steps(rotations_of(q))))[:3]))(q)
    np.testing.assert_allclose(got, want, atol=1e-14)
    assert np.abs(got[:4]).max() > 0.1
