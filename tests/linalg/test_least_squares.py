"""The block-banded step of optimistix's solvers against SciPy, and its derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax
import numpy as np
import optimistix
import pytest
from scipy.optimize import least_squares

from jaxmotion.linalg.block_banded import block_banded_matvec
from jaxmotion.linalg.least_squares import (
    BlockBandedCholesky,
    GaussNewton,
    LevenbergMarquardt,
    probe_blocks,
)
from jaxmotion.linalg.newton import DescendingNewton


def random_blocks(time, w, d, lanes, seed=0):
    """Blocks of a positive definite matrix, zero below its last row."""
    blocks = np.random.default_rng(seed).standard_normal((time, w + 1, d, d, *lanes))
    eye = np.eye(d).reshape(d, d, *[1] * len(lanes))
    blocks[:, 0] = blocks[:, 0] + np.swapaxes(blocks[:, 0], 1, 2) + 6 * (w + 1) * d * eye
    for k in range(1, w + 1):
        blocks[time - k :, k] = 0
    return jnp.asarray(blocks)


@pytest.mark.parametrize(
    ("time", "w", "d", "lanes"), [(8, 1, 2, (3,)), (7, 2, 3, ()), (2, 2, 2, ()), (1, 1, 2, ())]
)
def test_combs_read_every_block(time, w, d, lanes):
    blocks = random_blocks(time, w, d, lanes)
    like = jax.ShapeDtypeStruct((time, d, *lanes), blocks.dtype)
    probed = probe_blocks(lambda x: block_banded_matvec(blocks, x), like, w)
    frame = np.arange(time)
    for k in range(w + 1):
        inside = frame + k < time
        np.testing.assert_array_equal(probed[inside, k], blocks[inside, k])


def test_lineax_solver_solves_and_names_trouble():
    blocks = random_blocks(6, 2, 2, ())
    like = jax.ShapeDtypeStruct((6, 2), blocks.dtype)
    b = jnp.asarray(np.random.default_rng(1).standard_normal((6, 2)))
    solver = BlockBandedCholesky(2)

    def operator(scale):
        return lineax.FunctionLinearOperator(lambda x: scale * block_banded_matvec(blocks, x), like)

    x = lineax.linear_solve(operator(1.0), b, solver).value
    np.testing.assert_allclose(block_banded_matvec(blocks, x), b, atol=1e-12)
    bad = lineax.linear_solve(operator(-1.0), b, solver, throw=False)
    assert bad.result == lineax.RESULTS.singular
    tall = lineax.FunctionLinearOperator(lambda x: jnp.concatenate([x, x]), like)
    with pytest.raises(ValueError, match=r"want a square one"):
        lineax.linear_solve(tall, jnp.concatenate([b, b]), solver)
    flat = lineax.FunctionLinearOperator(lambda x: x, jax.ShapeDtypeStruct((6,), b.dtype))
    with pytest.raises(ValueError, match=r"one array \(T, d, \*lanes\)"):
        lineax.linear_solve(flat, b[:, 0], solver)


TIME, LANES = 9, 2
DATA = np.random.default_rng(2).standard_normal((TIME, 2, LANES))


def residuals(y, args):
    """Coupled data terms, and a second difference in time: bandwidth 2, nothing across lanes."""
    data, stiffness = args
    pair = jnp.stack([y[:, 0] + 0.3 * y[:, 1] ** 2, y[:, 1] - 0.2 * jnp.sin(y[:, 0])], axis=1)
    return pair - data, stiffness * jnp.diff(y, n=2, axis=0)


def dense_minimum(data, stiffness):
    def flat(y):
        parts = residuals(y.reshape(data.shape), (data, stiffness))
        return np.concatenate([np.ravel(part) for part in parts])

    tight = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
    found = least_squares(flat, np.zeros(data.size), jac="3-point", **tight)
    return found.x.reshape(data.shape)


SOLVERS = {
    "ours": GaussNewton(0.0, 1e-11, 2),
    "ours, damped": LevenbergMarquardt(1e-11, 1e-11, 2),
    "optimistix": optimistix.GaussNewton(
        1e-11, 1e-11, linear_solver=lineax.Normal(BlockBandedCholesky(2))
    ),
    "optimistix, damped": optimistix.LevenbergMarquardt(
        1e-11, 1e-11, linear_solver=lineax.Normal(BlockBandedCholesky(2))
    ),
}


def minimise(data, stiffness, solver, throw=True):
    return optimistix.least_squares(
        residuals,
        solver,
        jnp.zeros_like(data),
        (data, stiffness),
        adjoint=optimistix.ImplicitAdjoint(BlockBandedCholesky(2)),
        throw=throw,
    ).value


@pytest.mark.parametrize("name", SOLVERS)
def test_every_solver_reaches_the_dense_minimum(name):
    stiffness = 1.7
    found = minimise(jnp.asarray(DATA), jnp.asarray(stiffness), SOLVERS[name])
    np.testing.assert_allclose(found, dense_minimum(DATA, stiffness), atol=1e-7)


@pytest.mark.parametrize("name", ["ours", "ours, damped"])
def test_float32_while_64_bit_is_on(name):
    exact = minimise(jnp.asarray(DATA), jnp.asarray(1.7), SOLVERS["ours"])
    solver = type(SOLVERS[name])(1e-4, 1e-4, 2)
    single = minimise(jnp.asarray(DATA, jnp.float32), jnp.asarray(1.7, jnp.float32), solver)
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, exact, atol=1e-3)


def test_vmap_equals_lanes_and_jit():
    together = eqx.filter_jit(minimise)(jnp.asarray(DATA), jnp.asarray(1.7), SOLVERS["ours"])
    one = jax.vmap(lambda data: minimise(data, jnp.asarray(1.7), SOLVERS["ours"]), 2, 2)
    np.testing.assert_allclose(one(jnp.asarray(DATA)), together, atol=1e-10)


def test_implicit_derivatives_forward_and_reverse():
    rng = np.random.default_rng(3)
    target, change = (jnp.asarray(rng.standard_normal(DATA.shape)) for _ in range(2))

    def function(t):
        found = minimise(jnp.asarray(DATA) + t * change, 1.7 + t, SOLVERS["ours"])
        return jnp.vdot(target, found)

    forward = jax.jit(lambda t: jax.jvp(function, (t,), (jnp.ones_like(t),)))
    numeric = (forward(jnp.array(1e-4))[0] - forward(jnp.array(-1e-4))[0]) / 2e-4
    np.testing.assert_allclose(forward(jnp.array(0.0))[1], numeric, rtol=1e-6)
    np.testing.assert_allclose(jax.jit(jax.grad(function))(jnp.array(0.0)), numeric, rtol=1e-6)


def test_gauss_newton_does_not_run_away_uphill():
    def fn(y, args):
        return jnp.arctan(y - 1)

    start = jnp.full((4, 1), 4.0)
    wild = optimistix.GaussNewton(1e-8, 1e-8, linear_solver=lineax.Normal(BlockBandedCholesky(0)))
    assert not jnp.allclose(optimistix.least_squares(fn, wild, start, throw=False).value, 1)
    safe = optimistix.least_squares(fn, GaussNewton(0.0, 1e-10, 0), start)
    np.testing.assert_allclose(safe.value, 1, atol=1e-9)


class _Tenths(optimistix.AbstractDescent):
    """Nine tenths of the way each time; from nearer than 0.005 it cannot make a step."""

    def init(self, y, f_info_struct):
        return y, optimistix.RESULTS.successful

    def query(self, y, f_info, state):
        fine, singular = optimistix.RESULTS.successful, optimistix.RESULTS.singular
        far = jnp.max(jnp.abs(f_info.residual)) > 0.005
        return 0.9 * f_info.residual, optimistix.RESULTS.where(far, fine, singular)

    def step(self, step_size, state):
        return -step_size * state[0], state[1]


@pytest.mark.parametrize(("atol", "rest"), [(0.01, True), (0.001, False)])
def test_at_rest_no_further_step_is_needed(atol, rest):
    """Misses are 1, 0.1, 0.01 and 0.001, whence no step can be made: after one of 0.009."""
    found = optimistix.least_squares(
        lambda y, args: y - 3.0,
        DescendingNewton(_Tenths(), 0.0, atol),
        jnp.full((2, 1), 4.0),
        throw=False,
    )
    np.testing.assert_allclose(found.value, 3.001, atol=1e-12)
    assert found.result == (optimistix.RESULTS.successful if rest else optimistix.RESULTS.singular)


def test_a_hopeless_tolerance_is_reported():
    with pytest.raises(Exception, match=r"maximum number of"):
        optimistix.least_squares(
            residuals,
            GaussNewton(0.0, 0.0, 2),
            jnp.zeros(DATA.shape),
            (jnp.asarray(DATA), jnp.asarray(1.7)),
            max_steps=2,
        )
