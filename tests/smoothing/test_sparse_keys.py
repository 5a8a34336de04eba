"""Keys far apart at every stiffness, against dense equations solved with 60 digits.

As lam sigma -> 0 the mean is the spline through the keys, and as it grows their straight line; the
equations' condition passes 1e30 between. ``python -m pytest -m sweep -s tests/smoothing`` prints
the table of errors over stiffness, gap, order and dtype.
"""

import decimal
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from jaxmotion.smoothing import StreamingSmoother, lgs, smooth_quaternions

decimal.getcontext().prec = 60
D = decimal.Decimal
KEYS = 5
LIMITS = {"float32": 1e-4, "float64": 1e-9}
PRODUCTS = [1e-6, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 1e2, 1e4]


def data(gap, order):
    """Keys within 1 and the frames they stand at, some between frames, ends left open."""
    rng = np.random.default_rng([gap, order])
    index = gap * np.arange(KEYS) + 3.0
    index[1::2] += 0.25 if gap > 1 else 0
    return rng.uniform(-1, 1, KEYS), index, int(index[-1]) + 3


def equations(lam, sigma, index, frames, order):
    """Bands of P (of Eq. 6 or 7, "half") and the rows of A / sigma^2, in Decimal."""
    bands = [[D(0)] * frames for _ in range(3)]

    def add(row, weight):  # row: {frame: coefficient}
        for i, x in row.items():
            for j, y in row.items():
                if j >= i:
                    bands[j - i][i] += weight * x * y

    lam, sigma = D(lam), D(sigma)
    if order == 2:
        for j in range(1, frames - 1):
            add({j - 1: D("-0.5"), j: D(1), j + 1: D("-0.5")}, lam**2)
    else:
        for j in range(1, frames):
            add({j - 1: D(-1), j: D(1)}, lam * (1 if j in (1, frames - 1) else 2))
    rows = []
    for t in index:
        j = min(int(t), frames - 2)
        rows.append({j: D(1) - (D(t) - j), j + 1: D(t) - j})
        add(rows[-1], 1 / sigma**2)
    return bands, rows


def factored(bands):
    """L and D of the pentadiagonal matrix, column by column."""
    frames = len(bands[0])
    l1, l2, d = [D(0)] * frames, [D(0)] * frames, [D(0)] * frames
    for j in range(frames):
        d[j] = bands[0][j]
        d[j] -= l1[j - 1] ** 2 * d[j - 1] if j > 0 else 0
        d[j] -= l2[j - 2] ** 2 * d[j - 2] if j > 1 else 0
        l1[j] = (bands[1][j] - (l2[j - 1] * l1[j - 1] * d[j - 1] if j > 0 else 0)) / d[j]
        l2[j] = bands[2][j] / d[j]
    return l1, l2, d


def solved(factor, b):
    l1, l2, d = factor
    x = list(b)
    for j in range(len(x)):
        x[j] -= (l1[j - 1] * x[j - 1] if j > 0 else 0) + (l2[j - 2] * x[j - 2] if j > 1 else 0)
    x = [value / pivot for value, pivot in zip(x, d, strict=True)]
    for j in reversed(range(len(x))):
        x[j] -= (l1[j] * x[j + 1] if j + 1 < len(x) else 0) + (
            l2[j] * x[j + 2] if j + 2 < len(x) else 0
        )
    return x


def oracle(ys, lam, sigma, index, frames, order, at=()):
    """Mean of every frame for each of ``ys``, and covariance of the frames ``at`` with others."""
    bands, rows = equations(lam, sigma, index, frames, order)
    factor = factored(bands)
    means = []
    for y in ys:
        b = [D(0)] * frames
        for value, row in zip(y, rows, strict=True):
            for j, x in row.items():
                b[j] += x * D(value) / D(sigma) ** 2
        means.append(solved(factor, b))
    return means, [solved(factor, [D(int(i == j)) for i in range(frames)]) for j in at]


def floats(values):
    return np.array([float(v) for v in values])


@functools.lru_cache(maxsize=2)
def smoother(gap, order, dtype):
    """Derivatives in the keys and in log lam of a weighted sum of the mean; mean and variance."""
    _, index, frames = data(gap, order)
    weights = np.random.default_rng(7).standard_normal(frames).astype(dtype)
    weights /= np.sum(np.abs(weights))

    def value(y, log_lam, lam, sigma):
        found = lgs(y, lam * jnp.exp(log_lam), sigma, index=index, num_frames=frames, order=order)
        return jnp.vdot(jnp.asarray(weights), found.mean), (found.mean, found.variance)

    return weights, jax.jit(jax.grad(value, argnums=(0, 1), has_aux=True))


def errors(product, gap, order, dtype):
    """Largest errors: of the mean by the keys' range, of the variance by itself, of the derivatives
    in the keys by their size and in log lam by the range."""
    y, index, frames = data(gap, order)
    y = y.astype(dtype).astype(float)
    sigma = 0.5
    lam = product / sigma if order == 2 else product / sigma**2
    lam = float(np.dtype(dtype).type(lam))
    at = sorted({0, int(index[0]), int(index[1]), (int(index[1]) + int(index[2])) // 2, frames - 1})
    solutions, columns = oracle([y, *np.eye(KEYS)], lam, sigma, index, frames, order, at)
    variance = floats(column[j] for j, column in zip(at, columns, strict=True))
    weights, both = smoother(gap, order, dtype)

    def weighted(mean):
        return sum((D(float(w)) * m for w, m in zip(weights, mean, strict=True)), D(0))

    step = D("1e-20")
    ahead, behind = (
        weighted(oracle([y], D(lam) * (1 + s), sigma, index, frames, order)[0][0])
        for s in (step, -step)
    )
    by_key = floats(weighted(solution) for solution in solutions[1:])
    none = jnp.zeros((), dtype)
    slopes, (mean, got_variance) = both(jnp.asarray(y, dtype), none, none + lam, none + sigma)
    return (
        np.max(np.abs(np.asarray(mean) - floats(solutions[0]))) / np.ptp(y),
        np.max(np.abs(np.asarray(got_variance)[at] / variance - 1)),
        np.max(np.abs(np.asarray(slopes[0]) - by_key)) / np.max(np.abs(by_key)),
        abs(float(slopes[1]) - float((ahead - behind) / (2 * step))) / np.ptp(y),
    )


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize(
    ("product", "gap", "order"), [(1e-6, 200, 2), (1e-3, 60, 2), (0.1, 10, 2), (1e-6, 10, 1)]
)
def test_keys_far_apart(product, gap, order, dtype):
    assert max(errors(product, gap, order, dtype)) < LIMITS[dtype]


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_tiny_parameters_give_the_spline_through_the_keys(dtype):
    """Eq. 3 on either side of a key: SciPy's natural spline, up to the step of one frame."""
    y, index, _ = data(200, 2)
    index = np.round(index).astype(int)
    mean = lgs(y.astype(dtype), 1e-6, 1e-6, index=index).mean
    spline = CubicSpline(index, y, bc_type="natural")(np.arange(index[0], index[-1] + 1))
    assert mean.dtype == dtype
    np.testing.assert_allclose(mean[index[0] :], spline, atol=1e-4 * np.ptp(y))
    np.testing.assert_allclose(mean[index], y, atol=1e-6)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_rotations_between_distant_keys(dtype):
    """Keys a turn about one axis apart: the angle is close to the spline of the angles."""
    angles, index = np.array([0.0, 0.02, -0.01, 0.015, 0.0]), 60 * np.arange(5)
    q = np.stack([np.cos(angles / 2), np.sin(angles / 2), 0 * angles, 0 * angles], -1)
    smooth = smooth_quaternions(q.astype(dtype), 1e-3, 1.0, index=index, num_frames=241)
    turned = 2 * np.arctan2(smooth[:, 1], smooth[:, 0])
    spline = CubicSpline(index, angles, bc_type="natural")(np.arange(241))
    np.testing.assert_allclose(turned, spline, atol=1e-4 * np.ptp(angles) + 2e-5)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_streams_with_long_gaps(dtype):
    """Missing frames between keys, hardly any stiffness: what the smoother gives, frame 0 on."""
    y, index, frames = data(10, 2)
    index = np.round(index).astype(int)
    given = np.full((frames, 1), np.nan, dtype)
    given[index, 0] = y
    stream = StreamingSmoother(1e-3, 1.0, lag=frames - 1)
    state = stream.init(given[0])
    state, late = jax.lax.scan(stream.step, state, given)
    rest = stream.flush(state)
    exact = lgs(y, 1e-3, 1.0, index=index, num_frames=frames).mean
    got = np.concatenate([late[-1:], rest])[:, 0]
    np.testing.assert_allclose(got, exact, atol=LIMITS[dtype] * np.ptp(y))


@pytest.mark.sweep
def test_table_of_errors():
    print(
        f"\n{'dtype':8} {'order':>5} {'gap':>4} {'lam sigma':>9} | mean, variance, d/dkey, d/dlam"
    )
    worst = {}
    for dtype in LIMITS:
        for order in (1, 2):
            for gap in (1, 10, 60, 200):
                for product in PRODUCTS:
                    found = errors(product, gap, order, dtype)
                    worst[dtype] = max(worst.get(dtype, 0), *found)
                    row = " ".join(f"{error:8.1e}" for error in found)
                    print(f"{dtype:8} {order:5} {gap:4} {product:9.0e} | {row}", flush=True)
    assert all(worst[dtype] < limit for dtype, limit in LIMITS.items())
