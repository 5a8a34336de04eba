"""Maps of time against SciPy, sums written out, and quadrature."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from jaxmotion.timing.time_maps import eased, read_backwards, slowed_by_speed
from tests.helpers import assert_finite_derivatives, assert_jit_and_vmap_agree, check_gradients


def slowed(speed, amount, memory=2.0, length=None, dtype=np.float64):
    length = len(speed) + 1 if length is None else length
    numbers = (jnp.asarray(v, dtype) for v in (speed, amount, memory))
    return np.asarray(slowed_by_speed(*numbers, jnp.asarray(length, jnp.int32)))


def test_slowing_is_the_sum_written_out(dtype):
    speed = np.random.default_rng(0).uniform(0, 3, 20)
    i = np.arange(20)
    kernel = np.exp(-np.abs(i[:, None] - i) / 2.0)
    smooth = kernel @ speed / kernel.sum(1)
    want = np.concatenate([[0], np.cumsum(1 + 0.4 * smooth / smooth.mean())])
    got = slowed(speed, 0.4, dtype=dtype)
    assert got.dtype == dtype
    np.testing.assert_allclose(got, want, rtol=1e-5 if dtype == np.float32 else 1e-13)
    assert got[-1] == pytest.approx(1.4 * 20)


def test_more_frames_where_more_happens_and_always_onward():
    speed = np.where(np.abs(np.arange(40) - 20) < 5, 3.0, 0.0)
    steps = np.diff(slowed(speed, 2.0))
    assert steps.min() >= 1
    assert steps[18:22].min() > 3 * steps[:5].max()


@pytest.mark.parametrize("speed", [np.zeros(6), np.zeros(0), np.ones(1)])
def test_stillness_and_the_shortest_clips_slow_evenly(speed):
    np.testing.assert_allclose(slowed(speed, 0.5), 1.5 * np.arange(len(speed) + 1))
    length = jnp.asarray(len(speed) + 1, jnp.int32)
    if len(speed):
        assert_finite_derivatives(
            lambda s, a: slowed_by_speed(s, a, jnp.asarray(2.0), length), speed, jnp.asarray(0.5)
        )


def test_amount_0_is_no_change():
    speed = np.random.default_rng(1).uniform(0, 3, 30)
    np.testing.assert_array_equal(slowed(speed, 0.0), np.arange(31))
    at = np.arange(31.0)
    np.testing.assert_array_equal(read_backwards(slowed(speed, 0.0), at, at), at)


def test_padding_does_not_matter():
    speed = np.random.default_rng(2).uniform(0, 3, 25)
    got = slowed(speed, 0.7, length=16)
    np.testing.assert_allclose(got[:16], slowed(speed[:15], 0.7), rtol=1e-13)
    at = np.linspace(0, got[15], 40)
    want = read_backwards(got[:16], np.arange(16.0), at)
    np.testing.assert_allclose(read_backwards(got, np.arange(26.0), at), want, rtol=1e-12)


def test_reading_backwards_is_scipy_s_pchip_inside():
    rng = np.random.default_rng(3)
    knots, places = np.cumsum(rng.uniform(0.1, 3, (2, 12)), axis=1)
    at = np.linspace(knots[1], knots[-2], 80)
    got = read_backwards(knots, places, at)
    np.testing.assert_allclose(got, PchipInterpolator(knots, places)(at), rtol=1e-12)
    slope = PchipInterpolator(knots, places).derivative()(knots)
    slope[0], slope[-1] = (np.diff(places) / np.diff(knots))[[0, -1]]
    whole = np.linspace(knots[0] - 2, knots[-1] + 2, 4000)
    inside = (whole >= knots[0]) & (whole <= knots[-1])
    got = np.asarray(read_backwards(knots, places, whole))
    want = CubicHermiteSpline(knots, places, slope)(whole[inside])
    np.testing.assert_allclose(got[inside], want, rtol=1e-12)
    assert np.all(np.diff(got) > 0)
    np.testing.assert_allclose(read_backwards(np.ones(1), np.full(1, 4.0), at), 3 + at)


def test_two_pairs_are_a_straight_line():
    at = np.linspace(-1, 5, 7)
    np.testing.assert_allclose(read_backwards(np.array([0.0, 2]), np.array([0.0, 1]), at), at / 2)


@pytest.mark.parametrize(("ease_in", "ease_out"), [(4.0, 0.0), (0.0, 6.0), (5.0, 9.0)])
def test_easing_is_the_integral_of_its_speed(ease_in, ease_out):
    duration = 10.0
    total = duration + (ease_in + ease_out) / 2

    def speed(t):
        rise = np.clip(t / ease_in, 0, 1) if ease_in else 1.0
        fall = np.clip((total - t) / ease_out, 0, 1) if ease_out else 1.0
        return (3 * rise**2 - 2 * rise**3) * (3 * fall**2 - 2 * fall**3)

    at = np.linspace(0, total, 23)
    got = eased(jnp.asarray(at), ease_in, ease_out, duration)
    bends = [ease_in, total - ease_out]
    want = [quad(speed, 0, t, points=[b for b in bends if 0 < b < t] or None)[0] for t in at]
    np.testing.assert_allclose(got, want, atol=1e-9)
    assert float(got[-1]) == pytest.approx(duration)


def test_without_easing_time_stays():
    at = jnp.linspace(0, 10, 21)
    np.testing.assert_array_equal(eased(at, 0, 0, 10), at)


def test_derivatives_and_transformations():
    rng = np.random.default_rng(4)
    speed, at = jnp.asarray(rng.uniform(0.5, 2, 8)), jnp.asarray(rng.uniform(0.5, 10, 6))
    length = jnp.asarray(9, jnp.int32)

    def whole(speed, amount, memory, ease, at):
        u = slowed_by_speed(speed, amount, memory, length)
        clip_time = eased(at, ease[0], ease[1], u[-1])
        return read_backwards(u, jnp.arange(9, dtype=at.dtype), clip_time)

    args = (speed, jnp.asarray(0.6), jnp.asarray(1.5), jnp.array([2.0, 3.0]), at)
    check_gradients(whole, *args, rtol=1e-5)
    assert_jit_and_vmap_agree(whole, *args)
    slope = jax.grad(lambda e: jnp.sum(whole(speed, args[1], args[2], e, at)))(jnp.zeros(2))
    assert np.all(np.isfinite(slope))
