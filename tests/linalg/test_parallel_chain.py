"""The parallel chain against dense matrices and against the sequential one."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.linalg import (
    DifferenceChain,
    chain_factor,
    chain_knowledge,
    chain_smooth,
    chain_ways,
    parallel_chain_factor,
    parallel_chain_knowledge,
    parallel_chain_smooth,
)
from jaxmotion.smoothing import lgs
from tests.helpers import assert_jit_and_vmap_agree, assert_trees_close, check_gradients
from tests.linalg.test_difference_chain import (
    as_chain,
    dense_matrix,
    dense_solution,
    random_chain,
)


@pytest.mark.parametrize("frames", [1, 2, 3, 9])
def test_matches_dense(frames, dtype):
    coefficients = random_chain(frames)
    dense, v = dense_matrix(*(c[:, 0] for c in coefficients))
    chain = as_chain(coefficients, dtype)
    z, f = np.random.default_rng(1).standard_normal((2, frames, 2)).astype(dtype)
    tol = (1e-9, 1e-11) if dtype == np.float64 else (2e-3, 2e-3)
    x = parallel_chain_smooth(chain, z, f)
    assert x.dtype == dtype
    np.testing.assert_allclose(x, dense_solution(*(c[:, 0] for c in coefficients), z, f), *tol)
    inverse = np.linalg.inv(dense)
    cov = parallel_chain_knowledge(chain).covariance()
    np.testing.assert_allclose(cov.position[:, 0], np.diag(inverse), *tol)
    np.testing.assert_allclose(cov.cross[1:, 0], np.diag(inverse @ v.T)[1:], *tol)
    np.testing.assert_allclose(cov.velocity[1:, 0], np.diag(v @ inverse @ v.T)[1:], *tol)


@pytest.mark.parametrize("product", [1.0, 30.0, 1e3])
def test_equals_the_sequential_solve_over_long_gaps(product):
    rng = np.random.default_rng(2)
    p, w = np.full((500, 1), product**2 / 4), np.ones((500, 1))
    p[[0, -1]] = 0
    w[:20] = w[100:160] = w[250:480] = 0
    chain = DifferenceChain(p, w, 0 * w, 0 * w)
    z = np.cumsum(rng.standard_normal((500, 2)), 0)
    want, got = chain_smooth(chain, z), parallel_chain_smooth(chain, z)
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-9 * np.max(np.abs(want)))
    one, other = chain_factor(chain), parallel_chain_factor(chain)
    assert_trees_close(other.pivot, one.pivot, rtol=1e-9, atol=1e-14)
    known = chain_knowledge(one).covariance(), parallel_chain_knowledge(chain).covariance()
    assert_trees_close(*known, rtol=1e-8, atol=1e-12)


def test_derivatives_jit_and_vmap():
    chain = as_chain(random_chain(5, k=(2,)))
    z = np.random.default_rng(3).standard_normal((5, 2))

    def both(more, heavier, z):
        moved = eqx.tree_at(
            lambda c: (c.curvature, c.weight),
            chain,
            (chain.curvature * jnp.exp(more), chain.weight * jnp.exp(heavier)),
        )
        return parallel_chain_smooth(moved, z), parallel_chain_knowledge(moved).covariance()[0]

    none = jnp.zeros((5, 2))
    check_gradients(both, none, none, z)
    assert_jit_and_vmap_agree(both, none, none, z, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("order", [1, 2])
def test_smoother_in_parallel(order):
    y, index = np.random.default_rng(4).standard_normal((6, 2)), [0.0, 1.5, 2.0, 6.25, 7.0, 9.0]

    def smooth(y, lam, parallel):
        found = lgs(y, lam, 0.7, index=index, num_frames=11, order=order, parallel=parallel)
        return found.mean, found.variance, found.lag_one_covariance, found.leverage

    for got, want in zip(smooth(y, 3.0, True), smooth(y, 3.0, False), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize(("product", "gap"), [(1e-3, 10), (1e-4, 60)])
def test_digits_that_parallel_steps_would_lose_are_refused(product, gap):
    """float32, keys far apart, hardly any stiffness: an error instead of wrong numbers."""
    y = np.random.default_rng(5).uniform(-1, 1, 5).astype(np.float32)
    index = gap * np.arange(5)
    with pytest.raises(Exception, match="parallel=True loses digits"):
        lgs(y, product, 1.0, index=index, parallel=True).mean.block_until_ready()
    every = lgs(y, product, 1.0, parallel=True).mean  # no gap, nothing to lose
    np.testing.assert_allclose(every, y, atol=1e-5)


@pytest.fixture
def on_a_gpu(monkeypatch):
    """What is chosen there; computed here."""
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")


def test_way_that_is_chosen(on_a_gpu):
    assert chain_ways.way_of(None, 64, 88) == "either"
    assert chain_ways.way_of(None, 63, 88) == "frames"
    assert chain_ways.way_of(None, 64, 2**19) == "frames"
    assert chain_ways.way_of(False, 64, 88) == "frames"
    assert chain_ways.way_of(True, 1, 88) == "parallel"
    with jax.default_device(jax.devices("cpu")[0]):
        assert chain_ways.way_of(None, 64, 88) == "frames"


def test_frame_by_frame_is_the_way_of_a_cpu():
    assert chain_ways.way_of(None, 10_000, 88) == "frames"


@pytest.mark.parametrize("product", [1.0, 1e-4])
def test_what_is_chosen_loses_no_digits(on_a_gpu, product):
    """Also in float32 across gaps over which parallel steps would, and under jit, vmap and grad."""
    y = np.random.default_rng(5).uniform(-1, 1, (2, 5)).astype(np.float32)
    index = 60 * np.arange(5)

    def smooth(y, parallel=None):
        found = lgs(y, product, 1.0, index=index, parallel=parallel)
        return found.mean, found.variance

    assert lgs(y[0], product, 1.0, index=index)._way == "either"
    want = jax.vmap(lambda y: smooth(y, parallel=False))(y)
    for got in (jax.vmap(smooth)(y), [jnp.stack(x) for x in zip(*map(smooth, y), strict=True)]):
        for a, b in zip(got, want, strict=True):
            np.testing.assert_allclose(a, b, rtol=2e-3, atol=1e-5)
    slope, other = (
        jax.grad(lambda y, way=way: jnp.sum(smooth(y, way)[0] ** 2))(y[0]) for way in (None, False)
    )
    np.testing.assert_allclose(slope, other, rtol=2e-3, atol=1e-4)
