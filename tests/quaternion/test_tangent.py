"""Differences of rotations: values against SciPy, derivatives against finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmotion import quaternion
from jaxmotion.quaternion.parts import parts_of, together
from jaxmotion.quaternion.tangent import (
    component_first,
    inverse_jacobian,
    jacobian,
    on_blocks,
    relative,
)

RNG = np.random.default_rng(0)
SIZES = np.array([0.0, 1e-9, 1e-4, 0.003, 0.1, 1.0, 2.5, 3.1])[:, None, None]


def vectors(size, lanes=2):
    """(8, 3, lanes) rotation vectors of the given lengths."""
    v = RNG.standard_normal((8, 3, lanes))
    return jnp.asarray(v / np.linalg.norm(v, axis=1, keepdims=True) * size)


def flat(v):
    return np.moveaxis(np.asarray(v), 1, -1).reshape(-1, 3)


def test_value_against_scipy(dtype):
    a, b, c = vectors(0.7), vectors(0.4), vectors(SIZES)
    q = quaternion.exp(jnp.moveaxis(c, 1, -1))
    found = relative(a.astype(dtype), b.astype(dtype), q.astype(dtype))
    assert found.dtype == dtype
    first, last, middle = (Rotation.from_rotvec(flat(v)) for v in (a, b, c))
    expected = (first.inv() * middle * last).as_rotvec()
    np.testing.assert_allclose(flat(found), expected, atol=1e-13 if dtype == np.float64 else 3e-6)
    without = relative(a, None, q)
    np.testing.assert_allclose(without, relative(a, jnp.zeros_like(a), q), atol=1e-15)


@pytest.mark.parametrize("start", [0.0, 0.3])
def test_derivatives_at_every_angle(start):
    """First and second order, forward and reverse, in all three arguments."""
    # relative(a, b, c) turns by SIZES, also where a and b vanish.
    a, b, w, da, db, dc = (vectors(s) for s in (start, start, SIZES, 1.0, 1.0, 1.0))
    q = [quaternion.exp(jnp.moveaxis(v, 1, -1)) for v in (a, w, -b)]
    c = quaternion.multiply(quaternion.multiply(q[0], q[1]), q[2])
    np.testing.assert_allclose(relative(a, b, c), w, atol=1e-13)
    target = vectors(1.0)

    def function(t):
        turned = quaternion.multiply(c, quaternion.exp(t * jnp.moveaxis(dc, 1, -1)))
        return relative(a + t * da, b + t * db, turned)

    def scalar(t):
        return jnp.vdot(target, function(t) ** 2)

    step = 1e-5
    forward = jax.jit(lambda t: jax.jvp(function, (t,), (1.0,)))
    numeric = (forward(step)[0] - forward(-step)[0]) / (2 * step)
    np.testing.assert_allclose(forward(0.0)[1], numeric, atol=1e-8)
    slope = jax.jit(jax.grad(scalar))
    np.testing.assert_allclose(
        slope(0.0), jnp.vdot(target, 2 * forward(0.0)[0] * numeric), atol=1e-7
    )
    curvature = jax.jit(jax.jacfwd(jax.grad(scalar)))(0.0)
    numeric = (slope(step) - slope(-step)) / (2 * step)
    np.testing.assert_allclose(curvature, numeric, rtol=1e-6)


def test_inverse_jacobian_is_the_derivative_of_log():
    w, v = vectors(SIZES), vectors(1.0)

    def log(t):
        at = quaternion.exp(jnp.moveaxis(w, 1, -1))
        return component_first(quaternion.log(quaternion.multiply(at, quaternion.exp(t * turn))))

    turn = jnp.moveaxis(v, 1, -1)
    numeric = (log(1e-5) - log(-1e-5)) / 2e-5
    np.testing.assert_allclose(on_blocks(inverse_jacobian, w, v), numeric, atol=1e-8)
    u = vectors(1.0)
    one = jnp.vdot(u, on_blocks(inverse_jacobian, w, v))
    np.testing.assert_allclose(jnp.vdot(on_blocks(inverse_jacobian, w, u, transpose=True), v), one)


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-4, 0.1, 2.5, 3.1, 7.0])
def test_jacobian_is_the_derivative_of_exp(size):
    """exp(v)^-1 exp(v + dv) = exp(Jr(v) dv), by SciPy."""
    v, dv = RNG.standard_normal((2, 6, 3))
    v *= size / np.linalg.norm(v, axis=-1, keepdims=True)
    step, start = 1e-6, Rotation.from_rotvec(v)
    ahead, behind = (Rotation.from_rotvec(v + h * dv) for h in (step, -step))
    numeric = ((start.inv() * ahead).as_rotvec() - (start.inv() * behind).as_rotvec()) / (2 * step)
    found = together(jacobian(parts_of(v), parts_of(dv)))
    np.testing.assert_allclose(found, numeric, atol=1e-8)
    if size < 6:
        back = together(inverse_jacobian(parts_of(v), parts_of(found)))
        np.testing.assert_allclose(back, dv, atol=1e-9)
