"""Banded systems against dense linear algebra."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from jaxmotion import checks
from jaxmotion.linalg import (
    banded_factor,
    banded_log_det,
    banded_matvec,
    banded_selected_inverse,
    banded_solve,
)

SIZES = [(1, 0), (1, 2), (2, 2), (7, 1), (9, 2), (8, 3)]


def random_bands(n, w, seed=0):
    """A random positive definite banded matrix: dense, and in lower band storage."""
    rng = np.random.default_rng([seed, n, w])
    root = np.tril(rng.standard_normal((n, n)))
    root = np.triu(root, -w) + (1 + w) * np.eye(n)
    dense = root @ root.T
    bands = np.full((n, w + 1), 7.0)  # entries below the last row must be ignored
    for i in range(min(w + 1, n)):
        bands[: n - i, i] = np.diag(dense, -i)
    return dense, bands


def band_of(dense, w):
    n = len(dense)
    bands = np.zeros((n, w + 1))
    for i in range(min(w + 1, n)):
        bands[: n - i, i] = np.diag(dense, -i)
    return bands


@pytest.mark.parametrize(("n", "w"), SIZES)
def test_matches_dense(n, w, dtype):
    dense, bands = random_bands(n, w)
    b = np.random.default_rng(1).standard_normal((n, 3))
    bands, b = jnp.asarray(bands, dtype), jnp.asarray(b, dtype)
    tol = 1e-4 if dtype == np.float32 else 1e-11

    factor = banded_factor(bands)
    lower = np.eye(n)
    for i in range(1, min(w + 1, n)):
        lower += np.diag(np.asarray(factor.multipliers)[: n - i, i - 1], -i)
    np.testing.assert_allclose(
        lower * np.asarray(factor.pivots) @ lower.T, dense, rtol=tol, atol=tol
    )
    x = banded_solve(bands, b)
    np.testing.assert_allclose(x, np.linalg.solve(dense, np.asarray(b)), rtol=tol, atol=tol)
    np.testing.assert_allclose(banded_matvec(bands, x), b, rtol=tol, atol=tol)
    np.testing.assert_allclose(
        banded_log_det(bands), np.linalg.slogdet(dense)[1], rtol=tol, atol=tol
    )
    inverse = banded_selected_inverse(factor)
    np.testing.assert_allclose(inverse, band_of(np.linalg.inv(dense), w), rtol=tol, atol=tol)
    assert {a.dtype for a in (x, inverse, banded_log_det(bands), factor.pivots)} == {dtype}


def test_channels_vmap_and_jit_agree():
    pairs = [random_bands(9, 2, seed) for seed in range(3)]
    bands = jnp.stack([jnp.asarray(bands) for _, bands in pairs], axis=-1)
    b = jnp.asarray(np.random.default_rng(2).standard_normal((9, 3)))
    loop = np.stack([np.linalg.solve(dense, b[:, c]) for c, (dense, _) in enumerate(pairs)], 1)
    per_channel = banded_solve(bands, b)
    np.testing.assert_allclose(per_channel, loop, atol=1e-12)
    vmapped = jax.vmap(banded_solve, in_axes=-1, out_axes=-1)(bands, b)
    np.testing.assert_allclose(vmapped, loop, atol=1e-12)
    np.testing.assert_allclose(jax.jit(banded_solve)(bands, b), per_channel, atol=1e-14)
    log_dets = [np.linalg.slogdet(dense)[1] for dense, _ in pairs]
    np.testing.assert_allclose(banded_log_det(bands), log_dets, atol=1e-12)
    # One column vector, and one factor shared by a grid of channels.
    shared = jnp.asarray(pairs[0][1])
    np.testing.assert_allclose(
        banded_solve(shared, b[:, 0]), banded_solve(shared, b)[:, 0], atol=1e-14
    )
    grid = b.reshape(9, 3, 1)
    np.testing.assert_allclose(
        banded_solve(shared, grid)[..., 0], banded_solve(shared, b), atol=1e-14
    )


def test_derivatives():
    _, bands = random_bands(5, 2)
    bands = jnp.asarray(bands)
    b = jnp.asarray(np.random.default_rng(3).standard_normal((5, 2)))
    everything = jax.jit(
        lambda bands, b: (
            banded_solve(bands, b),
            banded_log_det(bands),
            banded_selected_inverse(banded_factor(bands)),
        )
    )
    check_grads(everything, (bands, b), 1, modes=("fwd", "rev"), rtol=1e-5)
    slope = jax.jit(
        jax.grad(lambda bands: jnp.sum(banded_solve(bands, b) ** 2) + banded_log_det(bands))
    )
    check_grads(slope, (bands,), 1, modes=("fwd",), rtol=1e-5)


def test_derivative_of_a_solve_is_a_solve():
    _, bands = random_bands(6, 2)
    grad = jax.jit(jax.grad(lambda bands, b: jnp.sum(banded_solve(bands, b) ** 2)))
    hlo = grad.lower(jnp.asarray(bands), jnp.ones((6, 1))).compile().as_text()
    assert hlo.count(" while(") == 5  # one factor, two substitutions for each solve


def test_refuses_what_is_not_positive_definite():
    bands = jnp.asarray([[1.0, 2.0], [1.0, 0.0]])
    with pytest.raises(Exception, match="not positive definite"):
        banded_solve(bands, jnp.ones(2)).block_until_ready()
    assert jnp.isnan(banded_log_det(bands))
    assert banded_solve(bands, jnp.ones(2), throw=False).shape == (2,)


@pytest.mark.parametrize("b_shape", [(4,), (5, 2)])
def test_refuses_shapes_that_do_not_fit(b_shape):
    with pytest.raises(ValueError, match="do not fit"):
        banded_solve(jnp.ones((5, 3, 3)), jnp.ones(b_shape))


@pytest.mark.parametrize("width", [1, 2, 3])
def test_an_indefinite_matrix_is_a_value_error_or_not_a_number(width):
    """The solution was once finite; and eager errors those of a callback."""
    _, bands = random_bands(6, width - 1)
    bands = np.stack([bands, bands], axis=-1)
    bands[3, 0, 1] = -1.0
    bands, b = jnp.asarray(bands), jnp.ones((6, 2))
    for f in (banded_factor, lambda bands, throw=True: banded_solve(bands, b, throw=throw)):
        with pytest.raises(ValueError, match=r"^banded_.*: bands: .* is not positive definite"):
            f(bands)
        traced = eqx.filter_jit(f)
        with pytest.raises(eqx.EquinoxRuntimeError, match=r"bands: .* is not positive definite"):
            traced(bands)
        with checks("nan"):
            assert jnp.isnan(jax.tree.leaves(traced(bands))[-1]).all()
        found = jax.tree.leaves(f(bands, throw=False))[-1]
        assert jnp.isfinite(found[:, 0]).all()
        assert jnp.isnan(found[:, 1]).all()
    inverse = banded_selected_inverse(banded_factor(bands, throw=False))
    assert jnp.isnan(inverse[:, 0, 1]).all()
