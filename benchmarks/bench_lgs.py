"""LGS smoother against SciPy's banded Cholesky, on the clip size of Eom et al. (2019), Table 1.

The peer gets its band matrix ready made; ours builds everything from lam and sigma each time.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solveh_banded

from jaxmotion.smoothing import lgs

FRAMES, CHANNELS = 2526, 260


def signal(frames, channels, dtype):
    rng = np.random.default_rng(0)
    return np.cumsum(rng.standard_normal((frames, channels)), axis=0).astype(dtype)


def eq6_bands(frames, dtype):
    """P of Eq. 6 at lam = sigma = 1, half scale, in SciPy's upper storage."""
    bands = np.zeros((3, frames), dtype)
    bands[2] = 1 + np.r_[1, 5, np.full(frames - 4, 6.0), 5, 1] / 4
    bands[1, 1:] = -np.r_[2, np.full(frames - 3, 4.0), 2] / 4
    bands[0, 2:] = 1 / 4
    return bands


@jax.jit
def mean(y, lam, sigma):
    return lgs(y, lam, sigma).mean


@pytest.mark.parametrize(
    ("frames", "channels", "dtype", "goal"),
    [
        (FRAMES, CHANNELS, "float64", 2.5),
        (FRAMES, CHANNELS, "float32", 5.0),
        (20_000, 26, "float64", None),
        (200_000, 26, "float64", None),
        (20_000, 26, "float32", None),
        (200_000, 26, "float32", None),
    ],
)
def test_mean(race, frames, channels, dtype, goal):
    y = signal(frames, channels, dtype)
    bands, data = eq6_bands(frames, dtype), jnp.asarray(y)
    ours, theirs = race(
        f"lgs mean {frames}x{channels} {dtype}",
        lambda: mean(data, 1.0, 1.0),
        {"solveh_banded": lambda: solveh_banded(bands, y, check_finite=False)},
        goals={"solveh_banded": goal} if goal else None,
    )
    close = 1e-4 if dtype == "float32" else 1e-10
    span = np.ptp(y, axis=0)
    np.testing.assert_allclose(ours / span, theirs["solveh_banded"] / span, rtol=0, atol=close)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("lam_shape", [(65, 1), (65, 4)], ids=["per joint", "per channel"])
def test_mean_own_parameters(race, lam_shape, dtype):
    """The peer must be called once for every joint or channel with its own matrix."""
    y = signal(FRAMES, CHANNELS, dtype)
    bands, data = eq6_bands(FRAMES, dtype), jnp.asarray(y).reshape(FRAMES, 65, 4)
    lam, width = jnp.ones(lam_shape, dtype), 5 - lam_shape[1]

    def one_by_one():
        parts = np.split(y, CHANNELS // width, axis=1)
        return [solveh_banded(bands, part, check_finite=False) for part in parts]

    race(
        f"lgs mean {FRAMES}x65x4 {dtype}, lam {lam_shape}",
        lambda: mean(data, lam, 1.0),
        {"solveh_banded": one_by_one},
        rounds=15,
    )


def mean_loss(lam, sigma, y):
    return jnp.sum(lgs(y, lam, sigma).mean ** 2)


def evidence(lam, sigma, y):
    return jnp.sum(lgs(y, lam, sigma).log_evidence)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("value", [mean_loss, evidence])
def test_value_and_gradient(race, value, dtype):
    """Against the value alone."""
    y = jnp.asarray(signal(FRAMES, CHANNELS, dtype))
    alone, both = jax.jit(value), jax.jit(jax.value_and_grad(value, argnums=(0, 1)))
    race(
        f"lgs {value.__name__} value and gradient {FRAMES}x{CHANNELS} {dtype}",
        lambda: both(1.0, 1.0, y),
        {"value alone": lambda: alone(1.0, 1.0, y)},
    )


def test_variance(race):
    y = jnp.asarray(signal(FRAMES, 1, "float64"))
    run = jax.jit(lambda y, lam, sigma: lgs(y, lam, sigma).variance)
    race(f"lgs variance {FRAMES} float64", lambda: run(y, 1.0, 1.0))


def test_compile(race):
    y = jnp.asarray(signal(FRAMES, CHANNELS, "float64"))

    def fresh():
        jax.clear_caches()
        return jax.jit(lambda y, lam, sigma: lgs(y, lam, sigma).mean)(y, 1.0, 1.0)

    race("lgs mean, trace and compile", fresh, warm=False, rounds=5)
