import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.spacetime.low_rank import low_rank_factor
from jaxmotion.spacetime.prior import Prior, random_walk
from tests.helpers import assert_jit_and_vmap_agree

SIZE, BEND = 0.7, 3e3


def dense_prior(frames):
    second = np.diff(np.eye(frames), n=2, axis=0)
    return SIZE * np.eye(frames) + BEND * second.T @ second


def walk(frames, dtype=np.float64):
    return random_walk(Prior(jnp.asarray(SIZE, dtype), jnp.asarray(BEND, dtype)), frames)


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 40])
def test_the_walk_inverts_the_prior(frames, dtype):
    b = np.random.default_rng(0).standard_normal((frames, 3))
    x = jax.jit(lambda b: walk(frames, dtype).solve(b))(jnp.asarray(b, dtype))
    assert x.dtype == dtype
    want = np.linalg.solve(dense_prior(frames), b)
    np.testing.assert_allclose(x, want, atol=3e4 * np.finfo(dtype).eps * np.abs(want).max())


def test_float32_holds_where_the_matrix_itself_has_lost_its_diagonal():
    size, bend, frames = 1.0, 1e8, 100  # in float32, size + 6 bend == 6 bend
    prior = Prior(jnp.float32(size), jnp.float32(bend))
    b = np.random.default_rng(1).standard_normal((frames, 1))
    second = np.diff(np.eye(frames), n=2, axis=0)
    want = np.linalg.solve(size * np.eye(frames) + bend * second.T @ second, b)
    x = random_walk(prior, frames).solve(jnp.asarray(b, jnp.float32))
    np.testing.assert_allclose(x, want, atol=1e-4 * np.abs(want).max())


def test_rows_of_the_prior_square_to_its_matrix():
    prior = Prior(jnp.asarray(SIZE), jnp.asarray(BEND))
    x = np.random.default_rng(2).standard_normal((9, 2))
    total = sum(float(jnp.sum(part**2)) for part in prior.rows(jnp.asarray(x)))
    np.testing.assert_allclose(total, np.sum(x * (dense_prior(9) @ x)), rtol=1e-12)


@jax.jit
def solve(jacobian, b):
    return low_rank_factor(walk(len(b), b.dtype), jacobian).solve(b)


def case(frames, rows, d, seed=3):
    rng = np.random.default_rng(seed)
    return 10 * rng.standard_normal((frames, rows, d)), rng.standard_normal((frames, d))


@pytest.mark.parametrize(("frames", "rows"), [(1, 2), (2, 2), (3, 7), (8, 2)])
def test_low_rank_solve_is_the_dense_one(frames, rows, dtype):
    d = 4
    jacobian, b = case(frames, rows, d)
    dense = np.kron(dense_prior(frames), np.eye(d))
    for t in range(frames):
        block = slice(t * d, t * d + d)
        dense[block, block] += jacobian[t].T @ jacobian[t]
    want = np.linalg.solve(dense, b.ravel()).reshape(frames, d)
    x = solve(jnp.asarray(jacobian, dtype), jnp.asarray(b, dtype))
    assert x.dtype == dtype
    np.testing.assert_allclose(x, want, atol=2e4 * np.finfo(dtype).eps * np.abs(want).max())


def test_low_rank_solve_compiled_and_mapped():
    jacobian, b = case(5, 2, 3)
    assert_jit_and_vmap_agree(solve, jacobian, b, rtol=1e-9, atol=1e-9)


def test_low_rank_solve_is_symmetric():
    jacobian, b = (jnp.asarray(x) for x in case(6, 3, 4))
    c = jnp.asarray(np.random.default_rng(4).standard_normal(b.shape))
    np.testing.assert_allclose(
        jnp.vdot(c, solve(jacobian, b)), jnp.vdot(solve(jacobian, c), b), rtol=1e-8
    )


def test_a_long_clip_and_a_stiff_spring_stay_accurate():
    """Rounding must not grow from frame to frame, as it would in a covariance that forgets its
    symmetry."""
    frames, d = 300, 2
    jacobian, b = case(frames, 1, d)
    stiff = random_walk(Prior(jnp.asarray(5.0), jnp.asarray(1.0)), frames)
    second = np.diff(np.eye(frames), n=2, axis=0)
    dense = np.kron(5.0 * np.eye(frames) + second.T @ second, np.eye(d))
    for t in range(frames):
        block = slice(t * d, t * d + d)
        dense[block, block] += jacobian[t].T @ jacobian[t]
    want = np.linalg.solve(dense, b.ravel()).reshape(frames, d)
    x = jax.jit(lambda j, b: low_rank_factor(stiff, j).solve(b))(jnp.asarray(jacobian), b)
    np.testing.assert_allclose(x, want, atol=1e-9 * np.abs(want).max())


def rigid_pair(frames):
    """Six rows of rank five: two points of one body by its place and turn, with A weak beside them
    as it is in ``keep_contacts``."""
    rng = np.random.default_rng(5)
    first, apart = np.cumsum(0.05 * rng.standard_normal((2, frames, 3)), axis=1)
    arms = [first - 0.9, first - 0.9 + [0.1, 0, 0.05] + 0.1 * apart]
    cross = [np.cross(np.eye(3), arm[:, None]) for arm in arms]
    place = np.broadcast_to(np.eye(3), (frames, 3, 3))
    rows = [np.concatenate([place, np.swapaxes(c, 1, 2)], axis=2) for c in cross]
    wave = np.sin(np.arange(frames)[:, None] / 5 + np.arange(6))
    return np.concatenate(rows, axis=1), 0.1 * wave


def test_rows_that_say_the_same_leave_float32_a_root():
    """In S they see nothing but their 1, beside which the rounding of all else is some units."""
    frames, size, bend = 60, 1.25e-7, 1.6e-4
    rows, z = rigid_pair(frames)
    seen = np.einsum("trd,td->tr", rows, z)
    second = np.diff(np.eye(frames), n=2, axis=0)
    dense = np.kron(size * np.eye(frames) + bend * second.T @ second, np.eye(6))
    for t in range(frames):
        dense[6 * t : 6 * t + 6, 6 * t : 6 * t + 6] += rows[t].T @ rows[t]
    want = np.linalg.solve(dense, np.einsum("trd,tr->td", rows, seen).ravel()).reshape(frames, 6)

    @jax.jit
    def moved(rows, seen):
        prior = Prior(jnp.asarray(size, rows.dtype), jnp.asarray(bend, rows.dtype))
        factor = low_rank_factor(random_walk(prior, frames), rows)
        return factor.pulled(factor.forces(seen))

    np.testing.assert_allclose(moved(rows, seen), want, atol=1e-6)
    for scale in np.linspace(1, 30, 12):  # the longer the rows, the more their rounding
        x = moved(jnp.float32(scale * rows), jnp.float32(scale * seen))
        np.testing.assert_allclose(x, moved(scale * rows, scale * seen), atol=0.01)
