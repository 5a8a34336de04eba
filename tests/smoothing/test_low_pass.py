"""The low-pass filter against its gain in closed form."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.smoothing import lgs
from jaxmotion.smoothing.low_pass import half_gain, low_pass

FPS, CUTOFF = 120.0, 6.0


@pytest.mark.parametrize("hertz", [1.0, 3.0, CUTOFF, 12.0, 40.0])
def test_waves_keep_the_share_that_the_module_says(hertz, dtype):
    time = np.arange(1200) / FPS
    wave = np.stack([np.sin(2 * np.pi * hertz * time), np.cos(2 * np.pi * hertz * time)], axis=1)
    got = low_pass(jnp.asarray(wave, dtype), CUTOFF, 1 / FPS)
    assert got.dtype == dtype
    gain = 1 / (1 + (np.sin(np.pi * hertz / FPS) / np.sin(np.pi * CUTOFF / FPS)) ** 4)
    if hertz == CUTOFF:
        assert gain == 0.5
    middle = slice(300, 900)
    tolerance = 1e-6 if dtype == np.float64 else 2e-4
    np.testing.assert_allclose(got[middle], gain * wave[middle], atol=tolerance)


def test_frames_that_do_not_count_have_no_say():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(40, 3))
    alone = low_pass(jnp.asarray(x[:30]), CUTOFF, 1 / FPS)
    padded = low_pass(jnp.asarray(x), CUTOFF, 1 / FPS, jnp.arange(40) < 30)
    np.testing.assert_allclose(padded[:30], alone, atol=1e-9)


def test_short_clips_and_high_cutoffs_stay():
    x = np.array([[1.0], [5.0]])
    np.testing.assert_array_equal(low_pass(jnp.asarray(x), CUTOFF, 1 / FPS), x)
    still = np.full((9, 2), 3.0)
    np.testing.assert_allclose(low_pass(jnp.asarray(still), 500.0, 1 / FPS), still, atol=1e-12)


@pytest.mark.parametrize("count", [1, 2])
def test_few_frames_that_count_stay(count):
    x = np.random.default_rng(1).normal(size=(9, 3))
    got = low_pass(jnp.asarray(x), CUTOFF, 1 / FPS, jnp.arange(9) < count)
    np.testing.assert_array_equal(got[:count], x[:count])


@pytest.mark.parametrize(("lam", "sigma"), [(1.0, 1.0), (128.0, 12.8), (1e3, 1.0)])
def test_half_of_a_wave_is_left_where_it_is_told(lam, sigma):
    hertz = float(half_gain(lam * sigma, 1 / FPS))
    time = np.arange(2400) / FPS
    wave = np.sin(2 * np.pi * hertz * time)
    got = np.asarray(lgs(jnp.asarray(wave), lam, sigma).mean)
    middle = slice(800, 1600)
    np.testing.assert_allclose(got[middle], 0.5 * wave[middle], atol=1e-3)
    assert half_gain(0.1, 1 / FPS) == FPS / 2
