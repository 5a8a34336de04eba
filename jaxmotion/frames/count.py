"""Which frames count: the first ``count`` of T, where the rest is padding.

``count`` i32[] is what ``jaxmotion._checks.counted`` makes of the ``length`` a user gives: from 1
to T, traced or not. O(T).
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int


def frame_mask(count: Int[Array, "*batch"], frames: int) -> Bool[Array, "*batch time"]:
    """True for the frames that count, bool[T]."""
    return jnp.asarray(np.arange(frames, dtype=count.dtype)) < count[..., None]


def step_mask(count: Int[Array, ""], frames: int) -> Bool[Array, " step"]:
    """True for the steps from a frame to the next between frames that count, bool[T - 1]."""
    return frame_mask(count - 1, frames - 1)


def counted_weights(
    weights: Float[Array, "time *joint"] | None, count: Int[Array, ""], frames: int, dtype
) -> Float[Array, "time *joint"]:
    """``weights``, ones if there are none, and 0 for the frames that do not count."""
    counts = frame_mask(count, frames).astype(dtype)
    return counts if weights is None else weights * counts.reshape(-1, *[1] * (weights.ndim - 1))
