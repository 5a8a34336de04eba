"""Functions of symmetric matrices: against SciPy's, and where eigenvalues agree."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from jaxmotion.linalg.symmetric import symmetric_function
from tests.helpers import check_gradients

root = jax.jit(lambda matrix: symmetric_function(jnp.sqrt, matrix))


def matrices(seed=0, count=4, n=3):
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((count, n, n))
    return x @ np.swapaxes(x, -1, -2) + 0.1 * np.eye(n)


def test_is_scipys():
    given = matrices()
    for got, matrix in zip(root(given), given, strict=True):
        np.testing.assert_allclose(got, scipy.linalg.sqrtm(matrix), atol=1e-12)
    sine = symmetric_function(jnp.sin, given)
    np.testing.assert_allclose(sine[1], np.imag(scipy.linalg.expm(1j * given[1])), atol=1e-12)


@pytest.mark.parametrize(
    "matrix",
    [matrices(1, 1)[0], 2 * np.eye(3), np.diag([1.0, 1.0, 3.0]), np.diag([1.0, 1 + 1e-9, 4.0])],
    ids=["apart", "all agree", "two agree", "nearly"],
)
def test_derivatives(matrix):
    def symmetric(x):
        return root(0.5 * (x + x.T))

    check_gradients(symmetric, jnp.asarray(matrix), rtol=1e-5, atol=1e-7)


def test_float32():
    low = root(matrices().astype(np.float32))
    assert low.dtype == np.float32
    np.testing.assert_allclose(low, root(matrices()), rtol=1e-4, atol=1e-5)
