"""The parallel chain against dense matrices and against the sequential one."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.linalg import (
    DifferenceChain,
    chain_covariance,
    chain_factor,
    chain_solve,
    parallel_chain_covariance,
    parallel_chain_factor,
    parallel_chain_solve,
)
from jaxmotion.smoothing import lgs
from tests.helpers import assert_jit_and_vmap_agree, assert_trees_close, check_gradients
from tests.linalg.test_difference_chain import as_chain, dense_matrix, random_chain


@pytest.mark.parametrize("frames", [1, 2, 3, 9])
def test_matches_dense(frames, dtype):
    coefficients = random_chain(frames)
    dense, v = dense_matrix(*(c[:, 0] for c in coefficients))
    chain = as_chain(coefficients, dtype)
    b = np.random.default_rng(1).standard_normal((frames, 2)).astype(dtype)
    tol = (1e-9, 1e-11) if dtype == np.float64 else (2e-3, 2e-3)
    x = parallel_chain_solve(chain, b)
    assert x.dtype == dtype
    np.testing.assert_allclose(x, np.linalg.solve(dense, b), *tol)
    inverse = np.linalg.inv(dense)
    cov = parallel_chain_covariance(parallel_chain_factor(chain))
    np.testing.assert_allclose(cov.position[:, 0], np.diag(inverse), *tol)
    np.testing.assert_allclose(cov.cross[:, 0], np.diag(inverse @ v.T), *tol)
    np.testing.assert_allclose(cov.velocity[:, 0], np.diag(v @ inverse @ v.T), *tol)


@pytest.mark.parametrize("product", [1.0, 30.0, 1e3])
def test_equals_the_sequential_solve_over_long_gaps(product):
    rng = np.random.default_rng(2)
    p, w = np.full((500, 1), product**2 / 4), np.ones((500, 1))
    p[[0, -1]] = 0
    w[:20] = w[100:160] = w[250:480] = 0
    chain = DifferenceChain(p, w, 0 * w, 0 * w)
    b = w * np.cumsum(rng.standard_normal((500, 2)), 0)
    want, got = chain_solve(chain, b), parallel_chain_solve(chain, b)
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-9 * np.max(np.abs(want)))
    one, other = chain_factor(chain), parallel_chain_factor(chain)
    assert_trees_close(other, one, rtol=1e-9, atol=1e-14)
    assert_trees_close(parallel_chain_covariance(other), chain_covariance(one), rtol=1e-9)


def test_derivatives_jit_and_vmap():
    chain = as_chain(random_chain(5, k=(2,)))
    b = np.random.default_rng(3).standard_normal((5, 2))

    def both(p, n0, b):
        moved = eqx.tree_at(lambda c: (c.curvature, c.position), chain, (p, n0))
        cov = parallel_chain_covariance(parallel_chain_factor(moved))
        return parallel_chain_solve(moved, b), cov.position

    inner = jnp.asarray([0.0, 1, 1, 1, 0])[:, None]
    check_gradients(lambda p, n0, b: both(p * inner, n0, b), chain.curvature, chain.position, b)
    assert_jit_and_vmap_agree(both, chain.curvature, chain.position, b, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("order", [1, 2])
def test_smoother_in_parallel(order):
    y, index = np.random.default_rng(4).standard_normal((6, 2)), [0.0, 1.5, 2.0, 6.25, 7.0, 9.0]

    def smooth(y, lam, parallel):
        found = lgs(y, lam, 0.7, index=index, num_frames=11, order=order, parallel=parallel)
        return found.mean, found.variance, found.lag_one_covariance, found.leverage

    for got, want in zip(smooth(y, 3.0, True), smooth(y, 3.0, False), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-11)
