"""λ and σ learned for a clip of 1900 frames by 32 joints, and the weights that find its spikes.

Peer of the tuner: SciPy's smoothing spline, which chooses its parameter by generalised
cross-validation, a channel at a time; its own time over two joints is taken. Spikes have no peer;
the tuner is the yardstick, as each of four rounds learns once.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from jaxmotion.smoothing import outlier_weights, tune

FRAMES, JOINTS, FEW = 1900, 32, 2


def _signal():
    rng = np.random.default_rng(0)
    t = np.arange(FRAMES)[:, None, None]
    waves = np.sin(t / rng.uniform(8, 40, (JOINTS, 4)) + rng.uniform(0, 6, (JOINTS, 4)))
    return waves + 0.05 * rng.standard_normal((FRAMES, JOINTS, 4))


@pytest.mark.parametrize("criterion", ["evidence", "gcv", "holdout"])
def test_tune(race, criterion):
    y = _signal()
    ours = jnp.asarray(y)
    times = np.arange(FRAMES, dtype=float)
    found, _ = race(
        f"tune {criterion} {FRAMES}x{JOINTS}x4 (SciPy: {FEW} joints)",
        lambda: tune(ours, criterion=criterion),
        {
            "make_smoothing_spline": lambda: [
                make_smoothing_spline(times, y[:, j]) for j in range(FEW)
            ]
        },
        rounds=3,
    )
    np.testing.assert_allclose(found.sigma, 0.05, rtol=0.1)


def test_outlier_weights(race):
    y = jnp.asarray(_signal()).at[::97].add(3.0)
    weights, _ = race(
        f"outlier_weights {FRAMES}x{JOINTS}x4",
        lambda: outlier_weights(y),
        {"tune once": lambda: tune(y)},
        rounds=3,
    )
    assert not np.any(weights[::97])
    assert isinstance(weights, jax.Array)
