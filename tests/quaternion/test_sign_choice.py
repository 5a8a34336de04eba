"""Signs of least energy against all combinations."""

from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import quaternion
from jaxmotion.quaternion import align_signs, least_energy_signs
from tests.helpers import no_shape_checks, random_quaternions


def energy(y, times):
    h = np.diff(times)
    d = (y[2:] - y[1:-1]) / h[1:, None] - (y[1:-1] - y[:-2]) / h[:-1, None]
    return np.sum(np.sum(d**2, -1) / (h[1:] + h[:-1]))


def least(y, times):
    signs = product([1, -1], repeat=len(y) - 1)
    return min(energy(y * np.array((1, *s))[:, None], times) for s in signs)


@pytest.mark.parametrize("n", [3, 4, 9])
def test_energy_is_the_least_of_all_combinations(n, dtype):
    rng = np.random.default_rng(n)
    q = random_quaternions(rng, (n, 5), dtype)
    times = np.cumsum(rng.uniform(0.5, 2, n)).astype(dtype)
    for t, clock in ((None, np.arange(n)), (times, times)):
        before = np.array(q)
        got = np.asarray(least_energy_signs(q, t))
        assert got.dtype == dtype
        np.testing.assert_array_equal(np.abs(got), np.abs(before))
        np.testing.assert_array_equal(got[0], before[0])
        for j in range(5):
            want = least(np.asarray(before[:, j], np.float64), clock)
            assert energy(got[:, j], clock) == pytest.approx(want, rel=1e-5)
        np.testing.assert_array_equal(before, q)


@pytest.mark.parametrize("gap", [150, 180, 200, 220])
def test_a_turn_past_half_a_circle_goes_on(gap):
    """Fig. 8: 60° a key, one gap longer than 180°, any signs on the way in."""
    angles = np.radians(np.cumsum([0, 60, 60, gap, 60, 60]))
    q = quaternion.exp(angles[:, None] * np.array([0.0, 0.6, 0.8]))
    q = q * np.array([1.0, -1, 1, 1, -1, -1])[:, None]
    signed = np.asarray(least_energy_signs(q))
    half = np.unwrap(np.arctan2(signed[:, 1:] @ [0.0, 0.6, 0.8], signed[:, 0]), period=2 * np.pi)
    np.testing.assert_allclose(np.degrees(2 * np.diff(half)), [60, 60, gap, 60, 60], atol=1e-9)


def test_frames_close_together_are_aligned_as_ever():
    rng = np.random.default_rng(1)
    q = quaternion.exp(np.cumsum(0.2 * rng.standard_normal((200, 3, 3)), axis=0))
    q = q * rng.choice([-1.0, 1.0], (200, 3, 1))
    np.testing.assert_array_equal(least_energy_signs(q), align_signs(q))


@pytest.mark.parametrize("n", [1, 2])
def test_without_second_differences_the_short_way(n):
    q = random_quaternions(np.random.default_rng(2), (n, 6))
    np.testing.assert_array_equal(least_energy_signs(q), align_signs(q))


def test_time_reversal_and_a_common_turn_choose_alike():
    rng = np.random.default_rng(3)
    q, turn = random_quaternions(rng, (12, 4)), random_quaternions(rng)
    times = np.cumsum(rng.uniform(0.5, 2, 12))

    def changes(q, times):
        signed = np.asarray(least_energy_signs(q, times))
        return np.sum(signed[1:] * signed[:-1], axis=-1)

    want = changes(q, times)
    np.testing.assert_allclose(changes(q[::-1], -times[::-1])[::-1], want, atol=1e-12)
    np.testing.assert_allclose(changes(quaternion.multiply(turn, q), times), want, atol=1e-12)


def test_vmap_and_derivative():
    q = random_quaternions(np.random.default_rng(4), (2, 7, 3))
    mapped = jax.vmap(least_energy_signs)(q)
    np.testing.assert_array_equal(mapped, np.stack([least_energy_signs(x) for x in q]))
    signs = np.sign(np.asarray(mapped[0] * q[0]).sum(-1, keepdims=True))
    slope = jax.grad(lambda x: jnp.sum(least_energy_signs(x)))(q[0])
    np.testing.assert_array_equal(slope, np.broadcast_to(signs, slope.shape))
    tangent = jax.jvp(least_energy_signs, (q[0],), (jnp.ones_like(q[0]),))[1]
    np.testing.assert_array_equal(tangent, slope)


def test_padding_does_not_matter():
    q = random_quaternions(np.random.default_rng(6), (7, 20))
    padding = random_quaternions(np.random.default_rng(7), (4, 20))
    times = np.array([0.0, 1, 3, 4, 4.5, 6, 7, 8, 9, 10, 20])
    padded = least_energy_signs(jnp.concatenate([q, padding]), times, length=7)
    np.testing.assert_array_equal(padded[:7], least_energy_signs(q, times[:7]))


def test_times_that_do_not_fit():
    q = random_quaternions(np.random.default_rng(5), (4, 2))
    with no_shape_checks(), pytest.raises(ValueError, match=r"times has shape \(3,\); want \(4,\)"):
        least_energy_signs(q, np.arange(3.0))
