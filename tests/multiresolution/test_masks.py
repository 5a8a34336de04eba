"""Masks: their gains, what they keep, and uneven times."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.multiresolution import band_pass_mask, binomial_mask, smoothing_mask
from tests.helpers import check_gradients, no_shape_checks


def gain(mask, omega):
    half = len(mask) // 2
    return np.real(np.exp(1j * np.outer(omega, np.arange(-half, half + 1))) @ mask)


OMEGA = np.linspace(0, np.pi, 50)


def test_the_papers_mask():
    np.testing.assert_allclose(smoothing_mask(), np.array([-1, 4, 18, 4, -1]) / 24, atol=1e-16)


@pytest.mark.parametrize("power", [1, 2, 3, 4])
@pytest.mark.parametrize("strength", [0.3, 1.0])
def test_smoothing_gain(power, strength):
    factor = float(np.prod(np.arange(1, 2 * power + 1)))
    want = 1 - strength / factor * (2 - 2 * np.cos(OMEGA)) ** power
    mask = smoothing_mask(power, strength)
    np.testing.assert_allclose(gain(mask, OMEGA), want, atol=1e-14)
    assert mask.sum() == pytest.approx(1)
    strongest = smoothing_mask(power, factor / 4**power)
    assert gain(strongest, [np.pi])[0] == pytest.approx(0, abs=1e-13)


def test_binomial_gain():
    for k in range(4):
        np.testing.assert_allclose(
            gain(binomial_mask(k), OMEGA), np.cos(OMEGA / 2) ** (2 * k), atol=1e-15
        )


def test_band_pass_keeps_the_pose_and_the_band():
    mask = band_pass_mask(0.1, 0.2, 40)
    np.testing.assert_allclose(mask, mask[::-1], atol=1e-16)
    at = lambda f: gain(mask, [2 * np.pi * f])[0]  # noqa: E731
    assert at(0.0) == pytest.approx(1)
    assert at(0.15) == pytest.approx(1, abs=0.02)
    assert max(abs(at(f)) for f in (0.06, 0.25, 0.3, 0.4, 0.5)) < 0.02


@pytest.mark.parametrize("power", [1, 2])
def test_uneven_times_keep_polynomials_and_agree_with_even_ones(power, dtype):
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.5, 1.5, 12))
    mask = smoothing_mask(power, 0.7, times=jnp.asarray(times, dtype))
    assert mask.dtype == dtype
    assert mask.shape == (12, 2 * power + 1)
    inner = np.arange(power, 12 - power)
    values = (times - times[6]) ** (2 * power - 1)
    out = [np.asarray(mask)[i] @ values[i - power : i + power + 1] for i in inner]
    np.testing.assert_allclose(out, values[inner], atol=1e3 * np.finfo(dtype).eps)
    even = smoothing_mask(power, 0.7, times=jnp.asarray(3.0 * np.arange(9), dtype))
    np.testing.assert_allclose(
        even, np.tile(smoothing_mask(power, 0.7), (9, 1)), atol=50 * np.finfo(dtype).eps
    )


def test_the_scale_of_time_does_not_matter_and_derivatives_agree():
    times = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, 7))
    f = lambda t, s: smoothing_mask(2, s, times=t)  # noqa: E731
    np.testing.assert_allclose(f(times, 1.0), f(0.01 * times, 1.0), atol=1e-13)
    check_gradients(f, times, jnp.asarray(0.8))
    np.testing.assert_allclose(jax.jit(lambda s: smoothing_mask(2, s))(0.8), smoothing_mask(2, 0.8))


def test_wrong_arguments():
    with pytest.raises(ValueError, match="power=0"):
        smoothing_mask(0)
    with pytest.raises(ValueError, match="half_width=-1"):
        binomial_mask(-1)
    with pytest.raises(ValueError, match=r"low=0\.3, high=0\.2"):
        band_pass_mask(0.3, 0.2, 5)


def test_times_that_do_not_increase_are_refused():
    with pytest.raises(ValueError, match="smoothing_mask: times must increase"):
        smoothing_mask(times=np.array([0.0, 1.0, 1.0, 2.0]))
    with no_shape_checks(), pytest.raises(ValueError, match=r"times has shape \(2, 2\)"):
        smoothing_mask(times=np.ones((2, 2)))
