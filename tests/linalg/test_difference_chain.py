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
    chain_knowledge,
    chain_log_det,
    chain_sample,
    chain_smooth,
    chain_squared_inverse,
)

LENGTHS = [1, 2, 3, 4, 9]


def random_chain(frames, seed=0, k=(1,)):
    """Random penalties per frame, whole and fractional readings, some frames without any."""
    rng = np.random.default_rng([seed, frames])
    p = rng.uniform(0.5, 4, (frames, *k))
    p[0] = p[-1] = 0
    n, g = rng.uniform(0.5, 2, (2, frames, *k)) * [[[1]], [[0.4]]]
    n[2::3] = 0
    r = rng.uniform(0, 1, (frames, *k))
    g[0] = r[0] = 0
    return p, n, g, r


def dense_matrix(p, n, g, r):
    """P written term by term from the quadratic form, one channel."""
    frames = len(p)
    x = np.eye(frames)
    v = np.vstack([np.zeros(frames), np.diff(x, axis=0)])
    total = np.zeros((frames, frames))
    for j in range(frames):
        if 0 < j < frames - 1:
            total += p[j] * np.outer(v[j + 1] - v[j], v[j + 1] - v[j])
        read = x[j] - g[j] * v[j]
        total += n[j] * np.outer(read, read) + r[j] * np.outer(v[j], v[j])
    return total, v


def dense_solution(p, n, g, r, z, f):
    """The minimiser for readings ``z (T, channels)`` and pushes ``f``, one chain for all."""
    total, v = dense_matrix(p, n, g, r)
    side = (np.eye(len(p)) - g[:, None] * v).T @ (n[:, None] * z) + v.T @ f
    return np.linalg.solve(total, side)


def as_chain(coefficients, dtype=jnp.float64):
    return DifferenceChain(*(jnp.asarray(c, dtype) for c in coefficients))


@pytest.mark.parametrize("frames", LENGTHS)
def test_matches_dense(frames, dtype):
    coefficients = random_chain(frames)
    dense, v = dense_matrix(*(c[:, 0] for c in coefficients))
    chain = as_chain(coefficients, dtype)
    z, f = jnp.asarray(np.random.default_rng(1).standard_normal((2, frames, 3)), dtype)
    inverse = np.linalg.inv(dense)
    tol = 2e-5 if dtype == np.float32 else 1e-11

    x = chain_smooth(chain, z, f)
    want = dense_solution(*(c[:, 0] for c in coefficients), np.asarray(z), np.asarray(f))
    np.testing.assert_allclose(x, want, rtol=tol, atol=tol)
    none = np.zeros((frames, 3))
    want = dense_solution(*(c[:, 0] for c in coefficients), np.asarray(z), none)
    np.testing.assert_allclose(chain_smooth(chain, z), want, rtol=tol, atol=tol)
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


def test_knowledge_of_readings_between_frames():
    """Variance of x - g v, and the squares of all covariances, off the dense inverse."""
    coefficients = random_chain(9)
    dense, v = dense_matrix(*(c[:, 0] for c in coefficients))
    inverse = np.linalg.inv(dense)
    factor = chain_factor(as_chain(coefficients))
    back = jnp.linspace(0, 1, 9)[:, None]
    read = np.eye(9) - np.asarray(back) * v
    got = chain_knowledge(factor).covariance(back)
    np.testing.assert_allclose(got.position[:, 0], np.diag(read @ inverse @ read.T), rtol=1e-11)
    np.testing.assert_allclose(got.cross[1:, 0], np.diag(read @ inverse @ v.T)[1:], atol=1e-12)
    squares = chain_squared_inverse(factor)[:, 0]
    np.testing.assert_allclose(squares, np.diag(inverse @ inverse), rtol=1e-11)


def test_channels_vmap_and_jit_agree():
    coefficients = random_chain(9, k=(3,))
    chain = as_chain(coefficients)
    z = jnp.asarray(np.random.default_rng(2).standard_normal((9, 3)))
    loop = np.concatenate(
        [
            dense_solution(*(c[:, i] for c in coefficients), z[:, i : i + 1], np.zeros((9, 1)))
            for i in range(3)
        ],
        axis=1,
    )
    np.testing.assert_allclose(chain_smooth(chain, z), loop, atol=1e-12)
    np.testing.assert_allclose(jax.jit(chain_smooth)(chain, z), loop, atol=1e-12)
    vmapped = jax.vmap(chain_smooth, in_axes=-1, out_axes=-1)
    np.testing.assert_allclose(vmapped(chain, z), loop, atol=1e-12)
    # Coefficients shared by the last axis of a grid of channels.
    grid = jnp.stack([z, 2 * z], axis=-1)
    wide = jax.tree.map(lambda c: c[..., None], chain)
    np.testing.assert_allclose(chain_smooth(wide, grid)[..., 1], 2 * loop, atol=1e-12)
    columns = [dense_matrix(*(c[:, i] for c in coefficients))[0] for i in range(3)]
    log_dets = [np.linalg.slogdet(c)[1] for c in columns]
    np.testing.assert_allclose(chain_log_det(chain), log_dets, atol=1e-12)


def test_constants_are_exact(dtype):
    chain = as_chain(random_chain(40), dtype)
    level = jnp.asarray([1e3, -1 / 3], dtype) + jnp.zeros((40, 2), dtype)
    np.testing.assert_array_equal(chain_smooth(chain, level), level)


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


def test_samples_between_distant_readings_pass_near_them(dtype):
    """Between readings 150 frames apart a draw strays by 1e6 or more; at them, by about 1."""
    n = np.zeros((301, 1))
    n[[0, 150, 300]] = 1
    p = np.full((301, 1), 1e-10)
    p[[0, -1]] = 0
    factor = chain_factor(as_chain((p, n, 0 * n, 0 * n), dtype))
    draws = np.asarray(chain_sample(factor, jax.random.key(2), (2000,)))
    spread = draws.std(axis=1)
    width = np.sqrt(np.asarray(chain_covariance(factor).position)[:, 0])
    assert draws.dtype == dtype
    assert width[75] > 1e6
    np.testing.assert_allclose(
        spread[[0, 75, 150, 225, 300]], width[[0, 75, 150, 225, 300]], rtol=0.08
    )
    np.testing.assert_allclose(width[[0, 150, 300]], 1, atol=1e-5)


def test_derivatives():
    p, n, g, r = (jnp.asarray(c) for c in random_chain(5))
    z, f = jnp.asarray(np.random.default_rng(3).standard_normal((2, 5, 2)))

    def chain_of(more, shift, speed):
        """Penalties and weights by factors, so that zeros stay."""
        g_new, r_new = (g + shift).at[0].set(0), (r + speed).at[0].set(0)
        return DifferenceChain(p * jnp.exp(more[0]), n * jnp.exp(more[1]), g_new, r_new)

    def everything(z, f, *changes):
        chain = chain_of(*changes)
        factor = chain_factor(chain)
        sample = chain_sample(factor, jax.random.key(1), (2,))
        smooth = chain_smooth(chain, z, f), chain_smooth(chain, z)
        return smooth, chain_log_det(chain), chain_covariance(factor), sample

    def scalar(*changes):
        chain = chain_of(*changes)
        return jnp.sum(chain_smooth(chain, z, f) ** 2) + jnp.sum(chain_log_det(chain))

    changes = jnp.zeros((2, 5, 1)), jnp.zeros((5, 1)), jnp.zeros((5, 1))
    check_grads(jax.jit(everything), (z, f, *changes), 1, modes=("fwd", "rev"), rtol=1e-4)
    slope = jax.jit(jax.grad(scalar, argnums=(0, 1, 2)))
    check_grads(slope, changes, 1, modes=("fwd",), rtol=1e-4)


def test_derivatives_in_loops_and_under_checkpoint():
    """The rule survives where JAX takes a loop's body apart."""
    chain = as_chain(random_chain(6))
    z = jnp.asarray(np.random.default_rng(4).standard_normal((6, 2)))

    def once(z, scale):
        stiff = eqx.tree_at(lambda c: c.curvature, chain, chain.curvature * scale)
        return chain_smooth(stiff, z)

    def looped(z, scale):
        return jnp.sum(jax.lax.scan(lambda z, _: (once(z, scale), None), z, length=3)[0] ** 2)

    def plain(z, scale):
        return jnp.sum(once(once(once(z, scale), scale), scale) ** 2)

    want = jax.grad(plain, argnums=(0, 1))(z, 2.0)
    for f in (looped, jax.checkpoint(plain)):
        got = jax.jit(jax.grad(f, argnums=(0, 1)))(z, 2.0)
        assert eqx.tree_equal(got, want, rtol=1e-11, atol=1e-12)
    want = jax.jit(jax.hessian(plain, argnums=1))(z, 2.0)
    np.testing.assert_allclose(jax.jit(jax.hessian(looped, argnums=1))(z, 2.0), want, rtol=1e-10)


def test_derivative_of_a_solve_is_a_solve():
    chain = as_chain(random_chain(6))
    grad = jax.jit(jax.grad(lambda chain, z: jnp.sum(chain_smooth(chain, z) ** 2)))
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
            exact = np.asarray(chain_smooth(as_chain(coefficients), jnp.asarray(y)))
            single = chain_smooth(as_chain(coefficients, jnp.float32), jnp.asarray(y, jnp.float32))
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
    np.testing.assert_allclose(factor.pivot, eager.pivot, atol=1e-15)
