"""When each new frame is read: monotone maps from the time of a result to the time of its source.

    automatic   du/di = 1 + a ŝ(i),   ŝ = s smoothed over its mean: slower where more happens
    pairs       through given (source time, result time), monotone in between
    ease        speed 0 to 1 by 3x² − 2x³ over the first e_in frames, and back over the last e_out

i: source frames; u(i): where they land, from 0, strictly increasing; s(i): speed at the interval
from i to i + 1, ≥ 0, in any unit; a ≥ 0: the share by which the clip grows. All times in frames.
Maps are read backwards, from the result's frames to source frames, by cubics that keep increasing
(Fritsch & Butland 1984), so that speed changes without a jump. O(T + N), differentiable.

Sources: Eom et al. 2019, §5.3 and Fig. 9, which leave the rule open; ours adds frames in proportion
to speed, u(i) = i + a (T − 1) Σ_{k<i} s_k / Σ_k s_k.
"""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from jaxmotion._types import AnyArray, ScalarLike
from jaxmotion.timing.spline import monotone_slopes, read_curve


def read_backwards(
    knots: Float[AnyArray, " knot"], places: Float[AnyArray, " knot"], at: Float[AnyArray, " frame"]
) -> Float[Array, " frame"]:
    """The increasing curve through (knots, places), both strictly increasing, at the times ``at``;
    straight beyond its ends."""
    knots, places, at = (jnp.asarray(values) for values in (knots, places, at))
    if knots.shape[0] == 1:
        return places + at - knots
    h = jnp.diff(knots)
    interval = jnp.clip(jnp.searchsorted(knots, at, side="right") - 1, 0, h.shape[0] - 1)
    fraction = (at - knots[interval]) / h[interval]
    return read_curve(h, places, monotone_slopes(h, places), interval, fraction)


def slowed_by_speed(
    speed: Float[Array, " interval"],
    amount: Float[Array, ""],
    memory: Float[Array, ""],
    length: Int[Array, ""],
) -> Float[Array, " frame"]:
    """Where source frames land when the clip slows down in proportion to its speed.

    **Arguments:** ``speed``: s ≥ 0, (T − 1,), anything beyond ``length`` frames; ``amount``: a ≥ 0;
    ``memory``: frames after which a neighbour's speed counts 1/e in the smoothing; ``length``: how
    many frames count.
    **Returns:** u, (T,), from 0 to (1 + a)(length − 1); frames beyond go on as the last ones do.
    """
    interval = jnp.arange(speed.shape[0], dtype=length.dtype)
    counts = (interval < length - 1).astype(speed.dtype)
    smooth = _averaged(jnp.where(counts > 0, speed, 0), counts, memory)
    mean = jnp.sum(smooth * counts) / jnp.maximum(jnp.sum(counts), 1)
    moves = mean > 0
    relative = jnp.where(moves, smooth / jnp.where(moves, mean, 1), 1)
    last = relative[jnp.clip(length - 2, 0, None)] if speed.shape[0] else relative
    pace = 1 + amount * jnp.where(counts > 0, relative, last)
    return jnp.concatenate([jnp.zeros(1, speed.dtype), jnp.cumsum(pace)])


def eased(
    at: Float[Array, " frame"], ease_in: ScalarLike, ease_out: ScalarLike, duration: ScalarLike
) -> Float[Array, " frame"]:
    """Times of a clip of ``duration`` frames that leaves rest over the result's first ``ease_in``
    frames and comes to rest over its last ``ease_out``.

    The result lasts (ease_in + ease_out)/2 frames longer, and has to last at least ease_in +
    ease_out. Outside, times stay at the clip's ends.
    """
    dtype = at.dtype
    ease_in, ease_out, duration = (jnp.asarray(e, dtype) for e in (ease_in, ease_out, duration))
    total = duration + (ease_in + ease_out) / 2
    at = jnp.clip(at, 0, total)
    left = total - at
    return at - _lost(at, ease_in) - (ease_out / 2 - _lost(left, ease_out))


def _lost(time: Array, ease: Array) -> Array:
    """How far a clip that starts from rest is behind after ``time``: at last half of ``ease``."""
    time = jnp.minimum(time, ease)
    x = time / jnp.where(ease > 0, ease, 1)
    return time - ease * x**3 * (1 - x / 2)


def _averaged(values: Array, weights: Array, memory: Array) -> Array:
    """Means over neighbours, counted by exp(−distance/memory) times their weight; never negative
    where no value is."""
    keep = jnp.exp(-1 / memory)
    both = jnp.stack([values * weights, weights], axis=1)

    def decay(total, new):
        total = keep * total + new
        return total, total

    none = jnp.zeros(2, values.dtype)
    _, before = lax.scan(decay, none, both)
    _, after = lax.scan(decay, none, both, reverse=True)
    total, weight = jnp.unstack(before + after - both, axis=1)
    return total / jnp.where(weight > 0, weight, 1)
