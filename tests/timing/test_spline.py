"""Splines through knots against SciPy, numpy and the smoother on ever finer grids."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import (
    CubicHermiteSpline,
    CubicSpline,
    PchipInterpolator,
    make_smoothing_spline,
)

from jaxmotion.smoothing import lgs
from jaxmotion.timing.spline import local_slopes, monotone_slopes, read_curve, smoothed_knots
from tests.helpers import assert_finite_derivatives, assert_jit_and_vmap_agree, check_gradients


def knots(seed, n=12, channels=(2, 3)):
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.uniform(0.5, 2, n)), rng.standard_normal((n, *channels))


def count(n):
    return jnp.asarray(n, jnp.int32)


def read(t, curve, at):
    interval = np.clip(np.searchsorted(t, at, side="right") - 1, 0, max(len(t) - 2, 0))
    fraction = (at - t[interval]) / np.diff(t)[interval]
    dtype = curve[0].dtype
    return read_curve(
        jnp.asarray(np.diff(t), dtype),
        *curve,
        jnp.asarray(interval),
        jnp.asarray(fraction, dtype),
    )


def smoothed(t, y, product, dtype=np.float64):
    h, y = jnp.asarray(np.diff(t), dtype), jnp.asarray(y, dtype)
    return smoothed_knots(h, y, jnp.asarray(product, dtype), count(len(t)))


@pytest.mark.parametrize("product", [0.0, 0.3, 4.0])
def test_smoothing_spline_is_scipy_s(product, dtype):
    t, y = knots(0)
    spline = (
        make_smoothing_spline(t, y, lam=(product / 2) ** 2)
        if product
        else CubicSpline(t, y, bc_type="natural")
    )
    at = np.linspace(t[0], t[-1], 60)
    got = read(t, smoothed(t, y, product, dtype), at)
    assert got.dtype == dtype
    np.testing.assert_allclose(got, spline(at), atol=1e-12 if dtype == np.float64 else 3e-5)


def test_it_is_the_limit_of_the_smoother_on_finer_grids():
    """A grid m times finer: λσ grows as m^1.5, as L takes differences where the integral has x″."""
    _, y = knots(1, n=9)
    t, product, off = np.arange(9.0), 1.5, []
    want = read(t, smoothed(t, y, product), np.arange(0, 8.01, 0.5))
    for m in (2, 8, 32):
        fine = lgs(y, product * m**1.5, 1.0, index=m * np.arange(9), num_frames=8 * m + 1).mean
        off.append(np.abs(np.asarray(fine[:: m // 2]) - want).max())
    assert off[0] < 0.1
    assert off[1] < off[0] / 8
    assert off[2] < off[1] / 8


def test_a_gain_per_channel_equals_channel_by_channel():
    t, y = knots(2, channels=(3, 2))
    gains = np.array([0.0, 0.5, 5.0])
    together = smoothed(t, y, gains[:, None])
    for j, gain in enumerate(gains):
        for got, want in zip(together, smoothed(t, y[:, j], gain), strict=True):
            np.testing.assert_allclose(got[:, j], want, atol=1e-12)


def test_local_slopes_are_numpy_s_gradient():
    t, y = knots(3)
    h = jnp.asarray(np.diff(t))
    slope = local_slopes(h, jnp.asarray(y), count(len(t)))
    np.testing.assert_allclose(slope, np.gradient(y, t, axis=0), atol=1e-12)
    at = np.linspace(t[0], t[-1], 60)
    got = read(t, (jnp.asarray(y), slope), at)
    np.testing.assert_allclose(got, CubicHermiteSpline(t, y, slope)(at), atol=1e-12)


def test_monotone_slopes_are_scipy_s_inside():
    t, _ = knots(4)
    y = np.cumsum(np.random.default_rng(4).uniform(0.01, 5, len(t)))
    slope = monotone_slopes(jnp.asarray(np.diff(t)), jnp.asarray(y))
    want = PchipInterpolator(t, y).derivative()(t)
    np.testing.assert_allclose(slope[1:-1], want[1:-1], rtol=1e-12)
    np.testing.assert_allclose(slope[0] * np.diff(t)[0], np.diff(y)[0], rtol=1e-12)
    fine = read(t, (jnp.asarray(y), slope), np.linspace(t[0] - 1, t[-1] + 1, 2000))
    assert np.all(np.diff(fine) > 0)


def test_beyond_the_knots_it_goes_on_straight():
    t, y = knots(5)
    values, slopes = smoothed(t, y, 0.7)
    got = read(t, (values, slopes), np.array([t[0] - 3, t[-1] + 2]))
    want = np.stack([values[0] - 3 * slopes[0], values[-1] + 2 * slopes[-1]])
    np.testing.assert_allclose(got, want, atol=1e-12)


def test_padding_does_not_matter():
    t, y = knots(6, n=15)
    h, y = jnp.asarray(np.diff(t)), jnp.asarray(y)
    for find in (local_slopes, lambda h, y, n: smoothed_knots(h, y, jnp.asarray(0.8), n)):
        whole = jax.tree.leaves(find(h[:9], y[:10], count(10)))
        padded = jax.tree.leaves(find(h, y, count(10)))
        for got, want in zip(padded, whole, strict=True):
            np.testing.assert_allclose(got[:10], want, atol=1e-13)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_shortest(n):
    t, y = knots(7, n=n)
    product = jnp.asarray(0.5)

    def everything(h, y):
        whole = smoothed_knots(h, y, product, count(n))
        return [read_curve(h, *whole, count([0]), h[:1] * 0.3 + 0.2), local_slopes(h, y, count(n))]

    if n > 1:
        assert_finite_derivatives(everything, jnp.diff(jnp.asarray(t)), jnp.asarray(y))
    if n < 3:
        np.testing.assert_array_equal(smoothed(t, y, 0.5)[0], y)
    line = np.multiply.outer(t, y[0])
    np.testing.assert_allclose(smoothed(t, line, 0.5)[0], line, atol=1e-12)


def test_derivatives_and_transformations():
    t, y = knots(8, n=6, channels=(2,))
    fraction = jnp.asarray(np.random.default_rng(8).uniform(0.1, 0.9, 5))

    def both(h, y, product, fraction):
        curve = smoothed_knots(h, y, product, count(6))
        other = (y, local_slopes(h, y, count(6)))
        places = jnp.arange(5)
        return [read_curve(h, *c, places, fraction) for c in (curve, other)]

    args = (jnp.diff(jnp.asarray(t)), jnp.asarray(y), jnp.asarray(0.7), fraction)
    check_gradients(both, *args)
    assert_jit_and_vmap_agree(both, *args, atol=1e-11)
    check_gradients(lambda h, y: monotone_slopes(h, jnp.cumsum(y**2)), args[0], args[1][:, 0])
