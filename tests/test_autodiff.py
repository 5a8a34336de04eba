"""Derivatives written out, against JAX's own of the same functions: any order, any mode, loops."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion._autodiff import driven, linear
from tests.helpers import assert_trees_close

RNG = np.random.default_rng(0)
MATRIX, U, V = (jnp.asarray(RNG.standard_normal(shape)) for shape in ((3, 4), (4,), (3,)))


def _change(matrix, power, u, v):
    """Linear in u and v; ``power`` is a whole number, which has no derivative."""
    return matrix @ u + jnp.sin(matrix[0, 0]) * v, jnp.asarray(power, u.dtype) * u


def _pull(matrix, power, pull):
    by_u = matrix.T @ pull[0] + jnp.asarray(power, pull[1].dtype) * pull[1]
    return by_u, jnp.sin(matrix[0, 0]) * pull[0]


def _ours(matrix, u, v):
    return linear(_change, _pull, (matrix, jnp.asarray(2)), (u, v))


def _plain(matrix, u, v):
    return _change(matrix, 2, u, v)


def _loss(map_, weights=(1.0, 1.0)):
    def loss(*args):
        a, b = map_(*args)
        return weights[0] * jnp.sum(jnp.sin(a)) + weights[1] * jnp.sum(b**3)

    return loss


@pytest.mark.parametrize("argnums", [(0,), (1,), (2,), (0, 1, 2), (1, 2)])
@pytest.mark.parametrize("weights", [(1.0, 1.0), (1.0, 0.0)])
def test_linear_has_the_derivatives_of_what_it_computes(argnums, weights):
    point = MATRIX, U, V
    ours, plain = _loss(_ours, weights), _loss(_plain, weights)
    np.testing.assert_allclose(ours(*point), plain(*point), rtol=1e-14)
    for derivative in (jax.grad, jax.hessian, lambda f, n: jax.jacfwd(jax.jacfwd(f, n), n)):
        got, want = (jax.jit(derivative(f, argnums))(*point) for f in (ours, plain))
        assert_trees_close(got, want, 1e-13, 1e-13)
    got, want = (
        jax.jacrev(jax.jacrev(jax.jacrev(f, argnums), argnums), argnums)(*point)
        for f in (ours, plain)
    )
    assert_trees_close(got, want, 1e-12, 1e-12)


def test_the_transpose_is_the_one_given():
    def doubled(matrix, power, pull):
        return jax.tree.map(lambda x: 2 * x, _pull(matrix, power, pull))

    def ours(u):
        return linear(_change, doubled, (MATRIX, jnp.asarray(2)), (u, V))[0]

    np.testing.assert_allclose(jax.vjp(ours, U)[1](V)[0], 2 * MATRIX.T @ V, rtol=1e-14)


@pytest.mark.parametrize("axes", [(0, None, None), (None, 1, None), (0, 1, 0), (2, None, 0)])
def test_many_at_once(axes):
    def many(x, axis):
        if axis is None:
            return x
        return jnp.stack([(k + 1) * x for k in range(5)], axis)

    point = [many(x, axis) for x, axis in zip((MATRIX, U, V), axes, strict=True)]
    for of in (_loss, lambda f: jax.grad(_loss(f), (0, 1, 2))):
        got, want = (jax.jit(jax.vmap(of(f), in_axes=axes))(*point) for f in (_ours, _plain))
        assert_trees_close(got, want, 1e-13, 1e-13)
        one_by_one = []
        for k in range(5):
            at = (x if a is None else jnp.take(x, k, a) for x, a in zip(point, axes, strict=True))
            one_by_one.append(of(_plain)(*at))
        want = jax.tree.map(lambda *x: jnp.stack(x), *one_by_one)
        assert_trees_close(got, want, 1e-13, 1e-13)


def _exponential(x):
    """exp, its derivative the value; nothing passes through the value itself."""
    return driven(
        lambda y, dx: y * dx,
        lambda y, pull: y * pull,
        jnp.exp(jax.lax.stop_gradient(x)),
        x,
        own=lambda value: (value,),
    )


def _power(x):
    """x³ by a derivative at x."""
    cube = jax.lax.stop_gradient(x) ** 3
    return driven(lambda x, dx: 3 * x * x * dx, lambda x, pull: 3 * x * x * pull, cube, x, (x,))


@pytest.mark.parametrize(("ours", "plain"), [(_exponential, jnp.exp), (_power, lambda x: x**3)])
def test_driven_has_the_derivatives_it_is_given_in_any_order_and_in_loops(ours, plain):
    """A scan's derivative takes its body apart, which is where JAX drops a custom_jvp's rule."""

    def looped(f):
        def run(x):
            last, _ = jax.lax.scan(lambda y, _: (f(0.3 * y), None), x, None, 3)
            return jnp.sum(jnp.sin(last))

        return run

    def kept(f):
        return lambda x: jnp.sum(jax.checkpoint(lambda x: f(0.5 * f(x)))(x))

    orders = (
        jax.grad,
        jax.hessian,
        lambda f: jax.jacfwd(jax.jacfwd(f)),
        lambda f: jax.jacrev(jax.jacrev(f)),
        lambda f: jax.jacrev(jax.jacfwd(f)),
        lambda f: jax.jacrev(jax.hessian(f)),
    )
    for around in (looped, kept):
        for derivative in orders:
            got, want = (jax.jit(derivative(around(f)))(U) for f in (ours, plain))
            np.testing.assert_allclose(got, want, rtol=1e-12, atol=1e-12)
    got, want = (jax.vmap(jax.grad(looped(f)))(jnp.outer(V, U)) for f in (ours, plain))
    np.testing.assert_allclose(got, want, rtol=1e-12, atol=1e-12)


def test_driven_without_a_derivative_to_drive_it_has_none():
    def f(x):
        return jnp.sum(driven(lambda d: d, lambda pull: pull, 3 * x, U))

    np.testing.assert_array_equal(jax.grad(f)(U), 0)
    np.testing.assert_array_equal(jax.jvp(f, (U,), (U,))[1], 0)
