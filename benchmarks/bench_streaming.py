"""One live frame of 65 joints at lag 30: a jitted step from Python, and one frame inside a scan.

Goal: under 1 ms a frame, warm.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.smoothing import StreamingSmoother, smooth_quaternions

FRAMES, JOINTS, LAG = 1000, 65, 30


def rotations(dtype):
    walk = np.cumsum(0.05 * np.random.default_rng(0).standard_normal((FRAMES, JOINTS, 4)), axis=0)
    q = walk + np.array([4.0, 0, 0, 0])
    return jnp.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True), dtype)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_step(race, dtype):
    q = rotations(dtype)
    smoother = StreamingSmoother(10.0, 1.0, lag=LAG, rotations=True)
    state = smoother.init(q[0])
    race(
        f"stream step {JOINTS} joints lag {LAG} {dtype}",
        lambda: smoother.step(state, q[0]),
        rounds=100,
    )


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_whole_clip(race, dtype):
    """The peer sees the whole clip at once."""
    q = rotations(dtype)
    smoother = StreamingSmoother(10.0, 1.0, lag=LAG, rotations=True)
    stream = jax.jit(lambda q: jax.lax.scan(smoother.step, smoother.init(q[0]), q)[1])
    batch = jax.jit(lambda q: smooth_quaternions(q, 10.0, 1.0))
    late, whole = race(
        f"stream {FRAMES} frames x {JOINTS} joints {dtype}",
        lambda: stream(q),
        {"batch": lambda: batch(q)},
        amount=(FRAMES, "frames"),
    )
    np.testing.assert_allclose(late[LAG:], whole["batch"][:-LAG], atol=5e-4)
