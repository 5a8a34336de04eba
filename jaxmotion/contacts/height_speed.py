"""Is a point low and slow? Two thresholds on each, with hysteresis.

Positions are smoothed (by the linear Gaussian smoother, half amplitude at 8 Hz), so that noise does
not pass for speed. With v the speed on the slower of the two sides of a frame (the first and last
frames of a contact are at rest on one side), h the height over the point's own level, and L the
limb's length, all in units of the clip,

    v* = max(½ L/s, ⅒ of the point's 95th percentile of v),    h* = 0.02 L
    in contact: runs of frames with v < v*, h < h* that have one with v < v*/2, h < h*/2

The level is the point's own lowest height within 0.4 s, so soles of any thickness and floors that
are not quite level do; but at most 0.15 L over the tenth percentile of its heights, so that a foot
held up is in the air. T frames, C points, O(T·C).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxmotion._numerics import safe_norm
from jaxmotion.smoothing.low_pass import low_pass

_CUTOFF = 8.0  # hertz
_SPEED, _OF_FASTEST, _FAST = 0.5, 0.1, 0.95
HEIGHT = 0.02
_LEVEL, _UNEVEN, _STRIDE = 0.1, 0.15, 5


class LowAndSlow(NamedTuple):
    """``speed`` and ``height`` f[T, C], over their thresholds (below 1: may be in contact)."""

    speed: Float[Array, "time point"]
    height: Float[Array, "time point"]


def low_and_slow(
    heights: Float[Array, "time point"] | None,
    smoothed: Float[Array, "time point 3"],
    size: Float[Array, " point"],
    counts: Bool[Array, " time"],
    frame_time: Float[Array, ""],
    tolerance: Float[Array, ""],
) -> LowAndSlow:
    """Speeds and heights over their thresholds.

    **Arguments:** ``heights`` over the points' levels, None where height does not count;
    ``smoothed`` positions; ``size``: limb lengths; ``counts``: frames that count, the first ones;
    ``tolerance`` scales both thresholds.
    """
    count = smoothed.shape[0]
    length = jnp.where(size > 0, size, 1)
    height = jnp.zeros_like(smoothed[..., 0]) if heights is None else heights / (HEIGHT * length)
    if count < 2:
        return LowAndSlow(jnp.zeros_like(height), height / tolerance)
    step = safe_norm(jnp.diff(smoothed, axis=0)) / (frame_time * length)
    step = jnp.where(counts[1:, None], step, jnp.inf)
    speed = jnp.minimum(
        jnp.pad(step, ((1, 0), (0, 0)), mode="edge"), jnp.pad(step, ((0, 1), (0, 0)), mode="edge")
    )
    speed = jnp.where(jnp.isfinite(speed), speed, 0)  # a single frame, and the padding
    seen = jnp.where(counts[:, None], speed, jnp.nan)
    fast = jnp.nan_to_num(jnp.nanquantile(seen, jnp.asarray(_FAST, speed.dtype), axis=0))
    most = jnp.maximum(_SPEED, _OF_FASTEST * fast) * tolerance
    return LowAndSlow(speed / most, height / tolerance)


def smooth(
    positions: Float[Array, "time point 3"],
    counts: Bool[Array, " time"],
    frame_time: Float[Array, ""],
) -> Float[Array, "time point 3"]:
    """Positions without what is faster than 8 Hz."""
    return low_pass(positions, _CUTOFF, frame_time, counts)


def levels(
    heights: Float[Array, "time point"],
    size: Float[Array, " point"],
    counts: Bool[Array, " time"],
    window: int,
) -> Float[Array, "time point"]:
    """Height at which each point stands about each frame, f[T, C]; the module has the rule.

    **Arguments:** ``window``: frames in 0.08 s.
    """
    seen = jnp.where(counts[:, None], heights, jnp.nan)
    usual = jnp.nanquantile(seen, jnp.asarray(_LEVEL, heights.dtype), axis=0)
    side = _STRIDE * window
    infinite = np.asarray(np.inf, heights.dtype)
    lowest = jax.lax.reduce_window(
        jnp.where(counts[:, None], heights, infinite),
        infinite,
        jax.lax.min,
        (2 * side + 1, 1),
        (1, 1),
        ((side, side), (0, 0)),
    )
    return jnp.minimum(lowest, usual + _UNEVEN * size)
