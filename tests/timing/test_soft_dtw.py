"""Soft dynamic time warping against the sum over every path, and as a training loss."""

from functools import partial
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.special import logsumexp

from jaxmotion.timing import dtw, pad_to_bucket, soft_alignment, soft_dtw


def all_paths(n, m):
    """Every path from (0, 0) to (n − 1, m − 1) as an indicator matrix (paths, n, m)."""
    found = []

    def go(i, j, cells):
        cells = [*cells, (i, j)]
        if (i, j) == (n - 1, m - 1):
            mask = np.zeros((n, m))
            mask[tuple(np.transpose(cells))] = 1
            found.append(mask)
        for a, b in ((i + 1, j), (i, j + 1), (i + 1, j + 1)):
            if a < n and b < m:
                go(a, b, cells)

    go(0, 0, [])
    return np.array(found)


def by_enumeration(cost, gamma):
    paths = all_paths(*cost.shape)
    sums = np.sum(paths * np.where(paths > 0, cost, 0), axis=(1, 2))
    value = -gamma * logsumexp(-sums / gamma)
    return value, np.tensordot(np.exp((value - sums) / gamma), paths, 1)


@jax.jit
def value_and_alignment(cost, gamma):
    return soft_dtw(cost=cost, gamma=gamma), soft_alignment(cost=cost, gamma=gamma)


@jax.jit
def value_and_slopes(cost, gamma):
    gamma = jnp.asarray(gamma, cost.dtype)
    slopes = jax.grad(lambda d, g: soft_dtw(cost=d, gamma=g), (0, 1))(cost, gamma)
    return value_and_alignment(cost, gamma), slopes


@pytest.mark.parametrize("gamma", [0.01, 0.3, 1.0, 20.0])
def test_value_and_alignment_equal_the_sum_over_paths(gamma):
    cost = np.random.default_rng(0).random((4, 5))
    value, expected = by_enumeration(cost, gamma)
    got_value, got_expected = value_and_alignment(cost, gamma)
    np.testing.assert_allclose(got_value, value, rtol=1e-12)
    np.testing.assert_allclose(got_expected, expected, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (1, 3), (3, 1), (2, 2), (7, 3)])
def test_shapes(n, m, dtype):
    cost = np.random.default_rng(1).random((n, m)).astype(dtype)
    value, expected = by_enumeration(cost.astype(float), 0.5)
    got_value, got_expected = value_and_alignment(cost, 0.5)
    assert got_value.dtype == got_expected.dtype == dtype
    np.testing.assert_allclose(got_value, value, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(got_expected, expected, atol=1e-5)


def test_forbidden_cells_are_never_visited():
    cost = np.random.default_rng(2).random((4, 5))
    cost[1, 1:4] = np.inf
    value, expected = by_enumeration(cost, 0.5)
    got_value, got_expected = value_and_alignment(cost, 0.5)
    np.testing.assert_allclose(got_value, value, rtol=1e-12)
    np.testing.assert_allclose(got_expected, expected, atol=1e-12)
    slope = jax.jit(jax.grad(lambda g: soft_dtw(cost=cost, gamma=g)))(0.5)
    step = 1e-6
    ends = [by_enumeration(cost, 0.5 + s)[0] for s in (-step, step)]
    np.testing.assert_allclose(slope, (ends[1] - ends[0]) / (2 * step), rtol=1e-7)
    bend = jax.jit(jax.grad(jax.grad(lambda g: soft_dtw(cost=cost, gamma=g))))(0.5)
    step = 1e-4
    before, here, after = [by_enumeration(cost, 0.5 + s)[0] for s in (-step, 0, step)]
    np.testing.assert_allclose(bend, (before - 2 * here + after) / step**2, rtol=1e-5)


def test_no_path_and_no_number():
    cost = np.ones((4, 5))
    cost[2] = np.inf
    assert np.isposinf(value_and_alignment(cost, 0.5)[0])
    cost[2] = np.nan
    assert np.isnan(value_and_alignment(cost, 0.5)[0])


def test_falls_on_dtw_as_gamma_vanishes():
    cost = np.random.default_rng(3).random((30, 34))
    hard = dtw(cost=cost)
    path = np.zeros_like(cost)
    path[tuple(np.transpose(hard.path[: int(hard.length)]))] = 1
    gammas = [1.0, 0.1, 1e-2, 1e-4, 1e-9]
    values = [value_and_alignment(cost, g) for g in gammas]
    gaps = [float(hard.cost - v) for v, _ in values]
    assert all(a >= b - 1e-12 for a, b in pairwise(gaps))
    assert gaps[0] > 1
    np.testing.assert_allclose(gaps[-1], 0, atol=1e-6)
    np.testing.assert_allclose(values[-1][1], path, atol=1e-6)


def test_long_clips_and_small_gamma_stay_finite(dtype):
    cost = (100 * np.random.default_rng(4).random((200, 180))).astype(dtype)
    value, expected = value_and_alignment(cost, 1e-3)
    assert bool(jnp.isfinite(value))
    np.testing.assert_allclose(expected[0, 0], 1, rtol=1e-4)
    np.testing.assert_allclose(expected[-1, -1], 1, rtol=1e-4)
    assert float(expected.min()) >= 0
    assert float(expected.sum()) <= 200 + 180


def test_gradient_in_the_cost_is_the_alignment():
    cost = jnp.asarray(np.random.default_rng(5).random((4, 5)))
    _, expected = by_enumeration(np.asarray(cost), 0.7)
    run = jax.jit(lambda d: soft_dtw(cost=d, gamma=0.7))
    np.testing.assert_allclose(jax.grad(run)(cost), expected, rtol=1e-10)
    np.testing.assert_allclose(jax.jacfwd(run)(cost), expected, rtol=1e-10)


@pytest.mark.parametrize("metric", ["sqeuclidean", "euclidean"])
def test_derivatives_equal_differences(metric):
    rng = np.random.default_rng(6)
    x, y = jnp.asarray(rng.standard_normal((5, 3))), jnp.asarray(rng.standard_normal((4, 3)))
    run = jax.jit(partial(soft_dtw, metric=metric))
    check_grads(run, (x, y, jnp.asarray(0.6)), 1, ("fwd", "rev"), atol=1e-6, rtol=1e-6, eps=1e-6)


def test_second_derivatives_equal_differences():
    cost = jnp.asarray(np.random.default_rng(7).random((3, 4)))
    hessian = jax.jit(jax.hessian(lambda d: soft_dtw(cost=d, gamma=0.5)))(cost)
    step = 1e-5
    for index in np.ndindex(cost.shape):
        bump = np.zeros(cost.shape)
        bump[index] = step
        ends = [by_enumeration(np.asarray(cost) + s * bump, 0.5)[1] for s in (-1, 1)]
        np.testing.assert_allclose(hessian[index], (ends[1] - ends[0]) / (2 * step), atol=1e-7)
    run = jax.jit(lambda d: soft_alignment(cost=d, gamma=0.5))
    check_grads(run, (cost,), 1, ("fwd", "rev"), eps=1e-6)


def plain_soft(cost, gamma):
    """Both recursions by loops over cells (Cuturi & Blondel 2017, algorithms 1 and 2)."""
    n, m = cost.shape
    r = np.full((n + 2, m + 2), np.inf)
    r[0, 0] = 0
    for i, j in np.ndindex(n, m):
        before = np.array([r[i, j], r[i, j + 1], r[i + 1, j]])
        r[i + 1, j + 1] = cost[i, j] - gamma * logsumexp(-before / gamma)
    value = r[n, m]
    d = np.pad(cost, 1)
    r[n + 1, :] = r[:, m + 1] = -np.inf
    r[n + 1, m + 1] = value
    e = np.zeros((n + 2, m + 2))
    e[n + 1, m + 1] = 1
    for i in range(n, 0, -1):
        for j in range(m, 0, -1):
            for a, b in ((i + 1, j + 1), (i + 1, j), (i, j + 1)):
                e[i, j] += e[a, b] * np.exp((r[a, b] - r[i, j] - d[a, b]) / gamma)
    return value, e[1:-1, 1:-1]


LONG = np.random.default_rng(11).random((201, 30))  # two strips, with a row to spare


def test_long_clips_go_through_in_strips():
    value, expected = plain_soft(LONG, 0.2)
    got_value, got_expected = value_and_alignment(LONG, 0.2)
    np.testing.assert_allclose(got_value, value, rtol=1e-12)
    np.testing.assert_allclose(got_expected, expected, rtol=1e-8, atol=1e-12)


def test_a_path_may_end_in_any_strip():
    @jax.jit
    def run(n, m):
        arguments = {"cost": LONG, "gamma": 0.2, "x_length": n, "y_length": m}
        return soft_dtw(**arguments), soft_alignment(**arguments)

    for n, m in [(1, 1), (60, 30), (101, 22), (102, 1), (201, 29)]:
        value, expected = plain_soft(LONG[:n, :m], 0.2)
        got_value, got_expected = run(n, m)
        np.testing.assert_allclose(got_value, value, rtol=1e-12)
        np.testing.assert_allclose(got_expected[:n, :m], expected, rtol=1e-8, atol=1e-12)
        assert not np.any(got_expected[n:])
        assert not np.any(got_expected[:, m:])


def test_second_derivatives_cross_strips():
    way, weight = np.random.default_rng(12).standard_normal((2, *LONG.shape))
    alignment = jax.jit(lambda d: soft_alignment(cost=d, gamma=0.2))
    change = jax.jit(lambda d, way: jax.jvp(alignment, (d,), (way,))[1])(LONG, way)
    step = 1e-5
    ends = [alignment(LONG + s * way) for s in (-step, step)]
    np.testing.assert_allclose(change, (ends[1] - ends[0]) / (2 * step), atol=1e-7)
    pulled = jax.jit(jax.grad(lambda d: jnp.sum(weight * alignment(d))))(LONG)
    np.testing.assert_allclose(np.sum(pulled * way), np.sum(weight * change), rtol=1e-9)


def test_temperatures_of_any_size(dtype):
    """Sums over paths down to exp(−1e13) and up to the count of all paths."""
    hard = dtw(cost=LONG)
    path = np.zeros_like(LONG)
    path[tuple(np.transpose(hard.path[: int(hard.length)]))] = 1
    cost = LONG.astype(dtype)
    for gamma in (1e-12, 1e-9, 1e-7):
        value, expected = value_and_alignment(cost, gamma)
        np.testing.assert_allclose(value, hard.cost, rtol=1e-6)
        np.testing.assert_allclose(expected, path, atol=1e-5)
    value, expected = value_and_alignment(cost, 1e9)
    want, want_expected = plain_soft(LONG, 1e9)
    np.testing.assert_allclose(value, want, rtol=1e-6)
    np.testing.assert_allclose(expected, want_expected, atol=1e-5)


@pytest.mark.parametrize("gamma", [1e-27, 1e-29, 1e-33, 1e-45])
def test_the_smallest_temperatures_are_dtw_s(gamma, dtype):
    """Costs of cells that no path needs, as large as the dtype has, do not count; nor do none."""
    hard = dtw(cost=LONG)
    path = np.zeros_like(LONG)
    path[tuple(np.transpose(hard.path[: int(hard.length)]))] = 1
    largest = float(jnp.finfo(dtype).max) / 1e4
    for unit in (1.0, 1e-12, 1e12):
        cost = np.where(path > 0, unit * LONG, largest).astype(dtype)
        cost[3, 20:] = np.inf
        (value, expected), slopes = value_and_slopes(cost, gamma)
        np.testing.assert_allclose(value, unit * hard.cost, rtol=1e-5)
        np.testing.assert_allclose(expected, path, atol=1e-5)
        np.testing.assert_allclose(slopes[0], path, atol=1e-5)
        np.testing.assert_allclose(slopes[1], 0, atol=1e-2)
    value, _ = value_and_slopes(np.where(np.arange(30) == 7, np.inf, cost), gamma)
    assert np.isposinf(value[0])


def test_the_slope_in_a_small_temperature_is_the_entropy_of_ties(dtype):
    cost = np.ones((3, 3), dtype)
    cost[1, 1] = 3  # two ways round of four cells; through the middle costs 5
    for gamma in (1e-3, 1e-30):
        (value, expected), slopes = value_and_slopes(cost, gamma)
        np.testing.assert_allclose(value, 4 - gamma * np.log(2), rtol=1e-6)
        np.testing.assert_allclose(expected[1], [0.5, 0, 0.5], atol=1e-6)
        np.testing.assert_allclose(slopes[1], -np.log(2), rtol=1e-5)


def test_gradient_where_clips_agree():
    x = np.random.default_rng(8).standard_normal((6, 3))
    for metric in ("sqeuclidean", "euclidean"):
        grad = jax.jit(jax.grad(partial(soft_dtw, metric=metric)))(x, x)
        assert bool(jnp.all(jnp.isfinite(grad)))


def test_padding_and_lengths_change_nothing():
    rng = np.random.default_rng(9)
    x, y = rng.standard_normal((5, 3)), rng.standard_normal((7, 3))
    padded_x, n = pad_to_bucket(x)
    padded_y, m = pad_to_bucket(y)

    @jax.jit
    def run(x, y, n, m):
        return (
            jax.value_and_grad(lambda x: soft_dtw(x, y, 0.4, x_length=n, y_length=m))(x),
            soft_alignment(x, y, 0.4, x_length=n, y_length=m),
        )

    (value, grad), expected = run(padded_x, padded_y, n, m)
    (want, want_grad), want_expected = run(x, y, 5, 7)
    np.testing.assert_allclose(value, want, rtol=1e-12)
    np.testing.assert_allclose(grad[:5], want_grad, rtol=1e-10)
    assert not np.any(grad[5:])
    np.testing.assert_allclose(expected[:5, :7], want_expected, rtol=1e-10)
    assert not np.any(expected[5:])
    assert not np.any(expected[:, 7:])


def test_modes_agree():
    rng = np.random.default_rng(10)
    x, y = rng.standard_normal((3, 5, 2)), rng.standard_normal((3, 6, 2))
    kept = x.copy()
    run = jax.value_and_grad(partial(soft_dtw, gamma=0.3))
    values, grads = jax.jit(jax.vmap(run))(x, y)
    for i in range(3):
        value, grad = jax.jit(run)(x[i], y[i])
        np.testing.assert_allclose(values[i], value, rtol=1e-12)
        np.testing.assert_allclose(grads[i], grad, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(soft_dtw(x[0], y[0], 0.3), values[0], rtol=1e-12)
    np.testing.assert_array_equal(x, kept)


def test_is_a_training_loss():
    """Gradient descent pulls a flat curve onto a shifted bump, which a per-frame loss cannot."""
    t = np.linspace(0, 1, 24)
    clips = np.exp(-(((t - np.array([[0.35], [0.5], [0.65]])) / 0.1) ** 2))[..., None]
    barycentre = jnp.asarray(clips.mean(axis=0))

    def loss(x):
        return jnp.mean(jax.vmap(lambda y: soft_dtw(x, y, 0.01))(clips))

    @jax.jit
    def step(x):
        value, grad = jax.value_and_grad(loss)(x)
        return x - 0.1 * grad, value

    first = step(barycentre)[1]
    for _ in range(60):
        barycentre, last = step(barycentre)
    assert float(last) < 0.3 * float(first)
    assert float(barycentre.max()) > 0.9


def test_static_trouble_names_the_argument():
    x = np.zeros((3, 2))
    with pytest.raises(ValueError, match=r"gamma must be a temperature above 0, got 0\.0"):
        soft_dtw(x, x, 0.0)
    with pytest.raises(ValueError, match=r"gamma must be .*, got -1"):
        soft_alignment(x, x, jnp.asarray(-1.0))
    with pytest.raises(ValueError, match="either x and y, or cost="):
        soft_dtw(x)


def test_errors_name_the_function_that_was_called():
    x = np.zeros((4, 2))
    for function in (soft_dtw, soft_alignment):
        for name, bad in (("gamma", -1.0), ("x_length", 5)):
            with pytest.raises(ValueError, match=f"^{function.__name__}: {name}"):
                function(x, x, **{name: bad})
