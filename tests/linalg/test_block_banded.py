"""Block-banded factor, solve, log-determinant and selected inverse against dense numpy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.linalg.block_banded import (
    block_banded_factor,
    block_banded_log_det,
    block_banded_matvec,
    block_banded_selected_inverse,
    block_banded_solve,
    block_banded_substitute,
)

SHAPES = [
    # time, bandwidth, block, lanes
    (7, 2, 3, (2,)),
    (6, 1, 2, ()),
    (4, 0, 1, (2, 2)),
    (6, 2, 6, (2,)),
    (5, 1, 9, ()),
    (1, 2, 3, (2,)),
    (2, 2, 3, (2,)),
    (3, 2, 3, (2,)),
]


def random_system(time, w, d, lanes, dtype=np.float64, seed=0):
    """Blocks of a random positive definite matrix, and it in full: (*lanes, T d, T d)."""
    rng = np.random.default_rng(seed)
    dense = np.zeros((*lanes, time, d, time, d))
    for t in range(time):
        for k in range(min(w, time - 1 - t) + 1):
            block = rng.standard_normal((*lanes, d, d))
            if k == 0:
                block = block + np.swapaxes(block, -1, -2) + 6 * (w + 1) * d * np.eye(d)
            dense[..., t + k, :, t, :] = block
            dense[..., t, :, t + k, :] = np.swapaxes(block, -1, -2)
    blocks = np.full((time, w + 1, d, d, *lanes), np.nan)  # outside P: must not be read
    for t in range(time):
        for k in range(min(w, time - 1 - t) + 1):
            blocks[t, k] = np.moveaxis(dense[..., t + k, :, t, :], (-2, -1), (0, 1))
    return jnp.asarray(blocks, dtype), dense.reshape(*lanes, time * d, time * d)


def flat(x):
    """(T, d, *lanes) as (*lanes, T d)."""
    x = np.moveaxis(np.asarray(x, np.float64), (0, 1), (-2, -1))
    return x.reshape(*x.shape[:-2], -1)


def tolerance(dtype):
    return 2e-5 if dtype == np.float32 else 1e-12


@jax.jit
def everything(blocks, rhs):
    factor = block_banded_factor(blocks)
    return (
        block_banded_solve(blocks, rhs),
        block_banded_matvec(blocks, rhs),
        block_banded_log_det(blocks),
        block_banded_selected_inverse(factor),
    )


@pytest.mark.parametrize(("time", "w", "d", "lanes"), SHAPES)
def test_everything_against_dense(time, w, d, lanes, dtype):
    blocks, dense = random_system(time, w, d, lanes, dtype)
    rhs = jnp.asarray(np.random.default_rng(1).standard_normal((time, d, *lanes)), dtype)
    tol = 2e-5 if dtype == np.float32 else 1e-12
    solution, product, log_det, selected = everything(blocks, rhs)
    assert {x.dtype for x in (solution, product, log_det, selected)} == {dtype}

    expected = np.linalg.solve(dense, flat(rhs)[..., None])[..., 0]
    np.testing.assert_allclose(flat(solution), expected, atol=tol)
    expected = (dense @ flat(rhs)[..., None])[..., 0]
    np.testing.assert_allclose(flat(product), expected, atol=100 * tol)
    assert log_det.shape == lanes
    np.testing.assert_allclose(log_det, np.linalg.slogdet(dense)[1], rtol=10 * tol)
    inverse = np.linalg.inv(dense).reshape(*lanes, time, d, time, d)
    for t in range(time):
        for k in range(w + 1):
            got = np.moveaxis(np.asarray(selected[t, k]), (0, 1), (-2, -1))
            want = inverse[..., t + k, :, t, :] if t + k < time else 0.0
            np.testing.assert_allclose(got, want * np.ones_like(got), atol=tol)


def test_one_factor_serves_many_right_hand_sides_and_shared_blocks_many_lanes():
    blocks, dense = random_system(6, 1, 2, ())
    rhs = np.random.default_rng(2).standard_normal((6, 2, 5))
    together = block_banded_solve(blocks, jnp.asarray(rhs))
    factor = block_banded_factor(blocks)
    for lane in range(5):
        expected = np.linalg.solve(dense, rhs[..., lane].ravel()).reshape(6, 2)
        np.testing.assert_allclose(together[..., lane], expected, atol=1e-13)
        one = block_banded_substitute(factor, jnp.asarray(rhs[..., lane]))
        np.testing.assert_allclose(one, expected, atol=1e-13)


@pytest.mark.parametrize("d", [2, 6])
def test_jit_equals_eager_and_vmap_equals_loop_and_lanes(d):
    systems = [random_system(5, 2, d, (), seed=seed)[0] for seed in range(3)]
    rhs = jnp.asarray(np.random.default_rng(3).standard_normal((3, 5, d)))
    eager = jnp.stack([block_banded_solve(b, r) for b, r in zip(systems, rhs, strict=True)])
    batched = jax.jit(jax.vmap(block_banded_solve))(jnp.stack(systems), rhs)
    np.testing.assert_allclose(batched, eager, atol=1e-13)
    lanes = block_banded_solve(jnp.stack(systems, -1), jnp.moveaxis(rhs, 0, -1))
    np.testing.assert_allclose(jnp.moveaxis(lanes, -1, 0), eager, atol=1e-13)


@pytest.mark.parametrize(("d", "lanes"), [(2, (2,)), (5, ())])
def test_derivatives_forward_reverse_and_finite_differences(d, lanes):
    blocks = jnp.nan_to_num(random_system(4, 2, d, lanes)[0])
    rng = np.random.default_rng(4)
    rhs = jnp.asarray(rng.standard_normal((4, d, *lanes)))

    @jax.jit
    def function(t, blocks, rhs, change, weights):
        blocks = blocks + t * (change[0] + jnp.swapaxes(change[0], 2, 3))
        factor = block_banded_factor(blocks, throw=False)
        outputs = (
            block_banded_solve(blocks, rhs + t * change[1], throw=False),
            block_banded_log_det(blocks),
            block_banded_selected_inverse(factor),
        )
        return sum(jnp.vdot(w, x) for w, x in zip(weights, outputs, strict=True))

    change = (
        jnp.asarray(rng.standard_normal(blocks.shape)),
        jnp.asarray(rng.standard_normal(rhs.shape)),
    )
    weights = [jnp.asarray(rng.standard_normal(s)) for s in (rhs.shape, lanes, blocks.shape)]
    rest = (blocks, rhs, change, weights)
    forward = jax.jit(jax.jacfwd(function))(0.0, *rest)
    reverse = jax.jit(jax.grad(function))(0.0, *rest)
    step = 1e-5
    numeric = (function(step, *rest) - function(-step, *rest)) / (2 * step)
    np.testing.assert_allclose(forward, numeric, rtol=1e-7)
    np.testing.assert_allclose(reverse, numeric, rtol=1e-7)


def test_second_derivatives():
    blocks = jnp.nan_to_num(random_system(3, 1, 2, ())[0])
    rhs = jnp.ones((3, 2))
    direction = jnp.eye(2) * jnp.ones((3, 2, 1, 1))

    def function(t):
        moved = blocks + t**2 * direction + t * direction
        return jnp.sum(block_banded_solve(moved, rhs)) + block_banded_log_det(moved)

    slope = jax.jit(jax.grad(function))
    curvature = jax.jit(jax.jacfwd(jax.grad(function)))(0.1)
    numeric = (slope(0.1 + 1e-5) - slope(0.1 - 1e-5)) / 2e-5
    np.testing.assert_allclose(curvature, numeric, rtol=1e-7)


def test_indefinite_matrix_is_an_error_or_not_a_number():
    blocks = jnp.asarray(np.random.default_rng(5).standard_normal((4, 2, 3, 3)))
    blocks = blocks.at[:, 0].set(-jnp.eye(3, dtype=blocks.dtype))
    with pytest.raises(Exception, match="not positive definite"):
        block_banded_solve(blocks, jnp.ones((4, 3)))
    assert jnp.isnan(block_banded_log_det(blocks))
    assert not jnp.isfinite(block_banded_solve(blocks, jnp.ones((4, 3)), throw=False)).all()


def test_shapes_that_do_not_fit_are_named():
    blocks, _ = random_system(4, 1, 3, (2,))
    for wrong in [(4, 2, 2), (5, 3, 2), (4, 3, 3), (4, 3)]:
        with pytest.raises(ValueError, match=r"do not fit the right-hand side"):
            block_banded_solve(blocks, jnp.ones(wrong))


def test_what_is_known_to_be_indefinite_is_a_value_error():
    blocks = -jnp.ones((3, 1, 1, 1))
    with pytest.raises(ValueError, match=r"^block_banded_factor: blocks: .* not positive definite"):
        block_banded_factor(blocks)
    with pytest.raises(ValueError, match=r"^block_banded_solve: blocks: .* not positive definite"):
        block_banded_solve(blocks, jnp.ones((3, 1)))
