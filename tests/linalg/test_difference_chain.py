"""The position-velocity chain against the dense matrix of its quadratic form."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.linalg import LinAlgError, solveh_banded

from jaxmotion.linalg import (
    DifferenceChain,
    chain_covariance,
    chain_factor,
    chain_log_det,
    chain_matvec,
    chain_sample,
    chain_solve,
)

LENGTHS = [1, 2, 3, 4, 9]


def random_chain(frames, seed=0, k=(1,)):
    """Random penalties per frame, whole and fractional observations, some frames without any."""
    rng = np.random.default_rng([seed, frames])
    p = rng.uniform(0.5, 4, (frames, *k))
    p[0] = p[-1] = 0
    w, g = rng.uniform(0.5, 2, (2, frames, *k)) * [[[1]], [[0.4]]]
    w[2::3] = 0
    g[0] = 0
    q = rng.uniform(0, 1, (frames, *k))
    q[0] = 0
    return p, w, w * g, w * g * g + q


def dense_matrix(p, n0, n1, n2):
    """P written term by term from the quadratic form, one channel."""
    frames = len(p)
    x = np.eye(frames)
    v = np.vstack([np.zeros(frames), np.diff(x, axis=0)])
    total = np.zeros((frames, frames))
    for j in range(frames):
        if 0 < j < frames - 1:
            total += p[j] * np.outer(v[j + 1] - v[j], v[j + 1] - v[j])
        cross = np.outer(x[j], v[j])
        total += n0[j] * np.outer(x[j], x[j]) - n1[j] * (cross + cross.T)
        total += n2[j] * np.outer(v[j], v[j])
    return total, v


def as_chain(coefficients, dtype=jnp.float64):
    return DifferenceChain(*(jnp.asarray(c, dtype) for c in coefficients))


@pytest.mark.parametrize("frames", LENGTHS)
def test_matches_dense(frames, dtype):
    coefficients = random_chain(frames)
    dense, v = dense_matrix(*(c[:, 0] for c in coefficients))
    chain = as_chain(coefficients, dtype)
    b = jnp.asarray(np.random.default_rng(1).standard_normal((frames, 3)), dtype)
    inverse = np.linalg.inv(dense)
    tol = 2e-5 if dtype == np.float32 else 1e-11

    x = chain_solve(chain, b)
    np.testing.assert_allclose(x, inverse @ np.asarray(b), rtol=tol, atol=tol)
    np.testing.assert_allclose(chain_matvec(chain, x), b, rtol=tol, atol=10 * tol)
    np.testing.assert_allclose(
        chain_log_det(chain), [np.linalg.slogdet(dense)[1]], rtol=tol, atol=tol
    )
    cov = chain_covariance(chain_factor(chain))
    np.testing.assert_allclose(cov.position[:, 0], np.diag(inverse), rtol=tol, atol=tol)
    np.testing.assert_allclose(cov.cross[:, 0], np.diag(v @ inverse), rtol=tol, atol=tol)
    np.testing.assert_allclose(cov.velocity[:, 0], np.diag(v @ inverse @ v.T), rtol=tol, atol=tol)
    lag_one = (cov.position - cov.cross)[1:, 0]
    np.testing.assert_allclose(lag_one, np.diag(inverse, 1), rtol=tol, atol=tol)
    assert {leaf.dtype for leaf in jax.tree.leaves((x, cov, chain_log_det(chain)))} == {dtype}


def test_channels_vmap_and_jit_agree():
    coefficients = random_chain(9, k=(3,))
    chain = as_chain(coefficients)
    b = jnp.asarray(np.random.default_rng(2).standard_normal((9, 3)))
    columns = [dense_matrix(*(c[:, i] for c in coefficients))[0] for i in range(3)]
    loop = np.stack([np.linalg.solve(columns[i], b[:, i]) for i in range(3)], axis=1)
    np.testing.assert_allclose(chain_solve(chain, b), loop, atol=1e-12)
    np.testing.assert_allclose(jax.jit(chain_solve)(chain, b), loop, atol=1e-12)
    vmapped = jax.vmap(chain_solve, in_axes=-1, out_axes=-1)
    np.testing.assert_allclose(vmapped(chain, b), loop, atol=1e-12)
    # Coefficients shared by the last axis of a grid of channels.
    grid = jnp.stack([b, 2 * b], axis=-1)
    wide = jax.tree.map(lambda c: c[..., None], chain)
    np.testing.assert_allclose(chain_solve(wide, grid)[..., 1], 2 * loop, atol=1e-12)
    log_dets = [np.linalg.slogdet(c)[1] for c in columns]
    np.testing.assert_allclose(chain_log_det(chain), log_dets, atol=1e-12)


def test_constants_are_exact(dtype):
    chain = as_chain(random_chain(40), dtype)
    level = jnp.asarray([1e3, -1 / 3], dtype)
    rows = (chain.position - chain.cross).at[:-1].add(chain.cross[1:])
    np.testing.assert_allclose(
        chain_solve(chain, rows * level), level + jnp.zeros((40, 2), dtype), rtol=2e-7
    )


def test_samples_have_covariance_of_the_inverse():
    coefficients = random_chain(5)
    dense, _ = dense_matrix(*(c[:, 0] for c in coefficients))
    factor = chain_factor(as_chain(coefficients))
    keys = jax.random.split(jax.random.key(0), 40)
    draws = jax.vmap(lambda key: chain_sample(factor, key, (1000,)))(keys)
    draws = np.moveaxis(np.asarray(draws), 1, 0).reshape(5, -1)
    inverse = np.linalg.inv(dense)
    scale = np.sqrt(np.outer(np.diag(inverse), np.diag(inverse)))
    np.testing.assert_allclose(np.cov(draws) / scale, inverse / scale, atol=0.03)
    np.testing.assert_allclose(draws.mean(1) / np.sqrt(np.diag(inverse)), 0, atol=0.03)


def test_derivatives():
    inner = [c[1:-1] if i == 0 else c for i, c in enumerate(random_chain(5))]
    b = jnp.asarray(np.random.default_rng(3).standard_normal((5, 2)))

    def chain_of(p, n0, n1, n2):
        p = jnp.pad(p, ((1, 1), (0, 0)))
        return DifferenceChain(p, n0, n1.at[0].set(0), n2.at[0].set(0))

    def everything(b, *coefficients):
        chain = chain_of(*coefficients)
        factor = chain_factor(chain)
        sample = chain_sample(factor, jax.random.key(1), (2,))
        return chain_solve(chain, b), chain_log_det(chain), chain_covariance(factor), sample

    def scalar(*coefficients):
        chain = chain_of(*coefficients)
        return jnp.sum(chain_solve(chain, b) ** 2) + jnp.sum(chain_log_det(chain))

    check_grads(jax.jit(everything), (b, *inner), 1, modes=("fwd", "rev"), rtol=1e-4)
    slope = jax.jit(jax.grad(scalar, argnums=(0, 1, 2, 3)))
    check_grads(slope, tuple(inner), 1, modes=("fwd",), rtol=1e-4)


def test_derivative_of_a_solve_is_a_solve():
    chain = as_chain(random_chain(6))
    grad = jax.jit(jax.grad(lambda chain, b: jnp.sum(chain_solve(chain, b) ** 2)))
    hlo = grad.lower(chain, jnp.ones((6, 2))).compile().as_text()
    assert hlo.count(" while(") == 5  # one factor, two substitutions for each solve


@pytest.mark.parametrize("frames", [300, 20_000])
def test_float32_holds_where_a_banded_cholesky_breaks(frames):
    rng = np.random.default_rng(5)
    t = np.arange(frames)
    y = np.stack([np.sin(t / 30), np.cumsum(rng.standard_normal(frames)) / np.sqrt(frames)], 1)
    y += 0.05 * rng.standard_normal(y.shape)
    span = np.ptp(y, axis=0)
    for product in (1.0, 1e2, 1e4):
        for every in (1, 20):
            n0 = (t % every == 0).astype(float)[:, None]
            p = np.zeros((frames, 1))
            p[1:-1] = product**2
            coefficients = (p, n0, 0 * n0, 0 * n0)
            exact = np.asarray(chain_solve(as_chain(coefficients), jnp.asarray(n0 * y)))
            single = chain_solve(
                as_chain(coefficients, jnp.float32), jnp.asarray(n0 * y, jnp.float32)
            )
            error = np.max(np.abs(np.asarray(single, float) - exact) / span)
            assert error < 2e-5, (product, every)
            bands = np.zeros((3, frames))
            bands[2] = n0[:, 0] + product**2 * np.r_[1, 5, np.full(frames - 4, 6.0), 5, 1]
            bands[1, 1:] = -(product**2) * np.r_[2, np.full(frames - 3, 4.0), 2]
            bands[0, 2:] = product**2
            # Independent float64 answer, itself only good to about cond * eps.
            reference = solveh_banded(bands, n0 * y)
            assert np.max(np.abs(reference - exact) / span) < 5e-4, (product, every)
    try:
        naive = solveh_banded(bands.astype(np.float32), (n0 * y).astype(np.float32))
    except LinAlgError:
        return
    assert np.max(np.abs(naive - exact) / span) > 1e-2


def test_trees_pass_through_jit_and_stay_unchanged():
    chain = as_chain(random_chain(9))
    before = jax.tree.map(np.array, chain)
    factor = jax.jit(chain_factor)(chain)
    eager = chain_factor(chain)
    assert eqx.tree_equal(jax.tree.map(np.asarray, chain), before)
    np.testing.assert_allclose(factor.beta, eager.beta, atol=1e-15)
