"""Frames that a capture dropped, and filled with the frame before.

Such a frame equals the one before in every joint and says nothing of its own time. Smoothed as
data, it pulls the motion back, and its jump is spread over frames that were right; so it gets
weight 0. Repeats in a row are dropped frames where they are few, and the body moves before and
after; a longer run is a body at rest, and so may be one at an end of the clip. O(T·J).
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool

from jaxmotion.frames.runs import last_before, next_after
from jaxmotion.motion import Motion

_MOST = 3  # frames dropped in a row


def without_repeats(motion: Motion, weights: Array | None) -> Array | None:
    """``weights`` (f[T] or f[T, J], or None for 1), 0 where a frame repeats the one before."""
    if motion.num_frames < 3:
        return weights
    dropped = dropped_frames(motion, weights)
    weights = jnp.ones(motion.num_frames, motion.dtype) if weights is None else weights
    return jnp.where(dropped.reshape(-1, *[1] * (weights.ndim - 1)), 0, weights)


def dropped_frames(motion: Motion, weights: Array | None) -> Bool[Array, " time"]:
    """Which frames were dropped; of those of weight 0 nothing is said."""
    seen = jnp.ones(motion.num_frames, bool)
    if weights is not None:
        seen = jnp.any(weights.reshape(motion.num_frames, -1) > 0, axis=1)
    arrays = motion.rotations, motion.translations
    same = [jnp.all(x[1:] == x[:-1], axis=(1, 2)) for x in map(jnp.asarray, arrays)]
    repeats = jnp.pad(same[0] & same[1], (1, 0))
    of_its_own = seen & ~repeats
    begin, end = last_before(of_its_own), next_after(of_its_own)
    inside = (begin > 0) & (end < motion.num_frames)
    return seen & repeats & inside & (end - begin <= _MOST + 1)
