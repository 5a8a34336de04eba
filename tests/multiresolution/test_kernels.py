"""Steps and turns by component, against the quaternion room and finite differences."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import quaternion
from jaxmotion.multiresolution.kernels import (
    halfway,
    quaternions_of,
    rotations_of,
    step,
    steps,
    turned,
    turned_by,
)
from jaxmotion.quaternion.parts import parts_of, together
from tests.helpers import (
    assert_finite_derivatives,
    assert_trees_close,
    check_gradients,
    random_quaternions,
    random_vectors,
)


@jax.jit
def _step(a, b):
    return together(step(rotations_of(a), rotations_of(b)))


@jax.jit
def _turned(q, v):
    unscaled = jnp.ones(v.shape[-2], v.dtype)
    return together(quaternions_of(turned(rotations_of(q), parts_of(v), unscaled)))


@jax.jit
def _halfway(q, v):
    _, middle = halfway(*steps(rotations_of(q)), lambda v: v, (parts_of(v),))
    return together(quaternions_of(middle))


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


def test_scaled_vectors_may_be_of_any_length():
    rng = np.random.default_rng(1)
    q, v = random_quaternions(rng, (50, 1)), 20 * random_vectors(rng, (50, 1))
    assert np.linalg.norm(v, axis=-1).max() > 30
    np.testing.assert_allclose(_turned(q, v), quaternion.multiply(q, quaternion.exp(v)), atol=1e-13)


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
    check_gradients(lambda q: together(steps(rotations_of(normalize(q)))[1]), q)


def test_derivatives_by_gains_and_of_long_vectors():
    rng = np.random.default_rng(5)
    q, v = random_quaternions(rng, (6, 2)), random_vectors(rng, (6, 2))
    gains = jnp.array([-1.5, 12.0])
    assert np.linalg.norm(gains[:, None] * v, axis=-1).max() > 4 * np.pi

    def scaled(v, gains):
        return together(quaternions_of(turned(rotations_of(q), parts_of(v), gains)))

    want = quaternion.multiply(q, quaternion.exp(gains[:, None] * v))
    np.testing.assert_allclose(scaled(v, gains), want, atol=1e-13)
    check_gradients(scaled, v, gains)


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


def _mixed(u, v, k):
    """Some vector made of two and a number."""
    return tuple(k * x * jnp.cos(y) for x, y in zip(u, v, strict=True))


def test_vectors_made_again_pass_what_they_are_made_of_its_derivative():
    rng = np.random.default_rng(11)
    q = random_quaternions(rng, (5, 2))
    u, v = (random_vectors(rng, (5, 2)) for _ in range(2))
    weights = jnp.asarray(rng.standard_normal((5, 2, 4)))

    def turned_again(q, u, v, k):
        r = turned_by(rotations_of(q), _mixed, (parts_of(u), parts_of(v)), (k,))
        return together(quaternions_of(r))

    def turned_once(q, u, v, k):
        r = turned(rotations_of(q), _mixed(parts_of(u), parts_of(v), k))
        return together(quaternions_of(r))

    def halfway_again(q, u, v, k):
        r, omega = steps(rotations_of(q))
        by = parts_of(u[1:]), omega
        r, middle = halfway(r, omega, _mixed, by, (k,))
        return together(quaternions_of(middle)) + together(quaternions_of(r))[1:]

    def halfway_once(q, u, v, k):
        r, omega = steps(rotations_of(q))
        _, middle = halfway(r, omega, lambda v: v, (_mixed(parts_of(u[1:]), omega, k),))
        return together(quaternions_of(middle)) + together(quaternions_of(rotations_of(q)))[1:]

    for again, once in ((turned_again, turned_once), (halfway_again, halfway_once)):

        def loss(f, q, u, v):
            y = f(q, u, v, 0.3)
            return jnp.sum(weights[: len(y)] * y)

        np.testing.assert_allclose(again(q, u, v, 0.3), once(q, u, v, 0.3), atol=1e-15)
        for derivative in (jax.grad, jax.jacfwd):
            got, want = (
                jax.jit(derivative(partial(loss, f), (0, 1, 2)))(q, u, v) for f in (again, once)
            )
            assert_trees_close(got, want, 1e-12, 1e-13)
        check_gradients(lambda u, v, f=again: f(q, u, v, 0.3), u, v)


SECOND = {
    "forward of reverse": jax.hessian,
    "reverse of forward": lambda f: jax.grad(lambda x: jax.jvp(f, (x,), (1.0,))[1]),
    "forward of forward": lambda f: jax.jacfwd(jax.jacfwd(f)),
    "reverse of reverse": lambda f: jax.grad(jax.grad(f)),
}
_RARE = [pytest.param(name, marks=pytest.mark.sweep) for name in list(SECOND)[2:]]


@pytest.mark.parametrize("way", [*list(SECOND)[:2], *_RARE])
def test_second_derivatives_also_through_loops(way):
    rng = np.random.default_rng(8)
    q, v = random_quaternions(rng, (5, 2)), 0.4 * random_vectors(rng, (5, 2))
    other = random_quaternions(rng, (5, 2))
    weights = jnp.asarray(rng.standard_normal((5, 2, 4)))

    def loss(size):
        def body(rotations, _):
            ends = jax.tree.map(lambda x: x[-1:], rotations)
            rotations, omega = steps(rotations)
            by = (parts_of(v[:4]), omega)
            bent = halfway(rotations, omega, _mixed, (*by, size))[1]
            longer = jax.tree.map(lambda x, y: jnp.concatenate([x, y]), bent, ends)
            change = step(longer, rotations_of(other))
            return turned(longer, change, 8 * size * jnp.ones(2)), None

        last, _ = jax.lax.scan(body, rotations_of(3 * size * q), None, 2)
        return jnp.sum(weights * together(quaternions_of(last)))

    first = jax.jit(jax.grad(loss))
    want = (first(1.0 + 1e-5) - first(1.0 - 1e-5)) / 2e-5
    np.testing.assert_allclose(jax.jit(SECOND[way](loss))(1.0), want, rtol=1e-6)


def test_steps_beyond_the_frames_that_count_are_zero_and_pass_nothing():
    q = random_quaternions(np.random.default_rng(9), (6, 2))
    counted = together(steps(rotations_of(q), jnp.asarray(4))[1])
    np.testing.assert_array_equal(counted[3:], 0)
    np.testing.assert_array_equal(counted[:3], together(steps(rotations_of(q))[1])[:3])
    weights = jnp.asarray(random_vectors(np.random.default_rng(10), (5, 2)))
    got = jax.grad(
        lambda q: jnp.sum(weights * together(steps(rotations_of(q), jnp.asarray(4))[1]))
    )(q)
    want = jax.grad(lambda q: jnp.sum((weights * together(steps(rotations_of(q))[1]))[:3]))(q)
    np.testing.assert_allclose(got, want, atol=1e-14)
    assert np.abs(got[:4]).max() > 0.1
