"""Walks of pairs against the normal equations, written out."""

import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from jaxmotion.linalg.pair_walk import Symmetric, solve_walk


@pytest.mark.parametrize("count", [7, 4, 1])
def test_is_the_least_squares_solution_of_what_counts(count):
    rng = np.random.default_rng(0)
    counts = np.arange(7) < count
    half = rng.standard_normal((7, 2, 2)) * counts[:, None, None]
    g = half @ np.swapaxes(half, 1, 2)
    pull = rng.standard_normal((7, 2, 1))
    whole = np.zeros((2 * count, 2 * count))
    for i in range(count):
        whole[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = g[i]
    d = np.kron(np.diff(np.eye(count), axis=0), np.eye(2))
    want = np.linalg.solve(whole + d.T @ d, pull[:count].ravel())
    gram = Symmetric(*(jnp.asarray(g[:, a, b, None]) for a, b in ((0, 0), (0, 1), (1, 1))))

    def solved(pull, aa):
        walk = gram._replace(aa=jnp.asarray(aa))
        return solve_walk(walk, jnp.asarray(pull), jnp.asarray(counts))

    got = solved(jnp.asarray(pull), gram.aa)
    np.testing.assert_allclose(got[:count].ravel(), want, rtol=1e-9)
    np.testing.assert_array_equal(got[count:], 0)
    if count == 7:
        check_grads(solved, (jnp.asarray(pull), gram.aa), order=1, eps=1e-6)
