"""The numbers of seeded variations: systematic where they can be even, and waves that bend time.

Systematic: n equal steps of a range with one random offset for all, in a random order. The shares
are uniform over the simplex, the logarithms of even numbers over their sum.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmotion._types import Key
from jaxmotion.motion import Motion

_WAVES, _PERIODS = 3, (1.0, 4.0)  # seconds


class Draws(NamedTuple):
    """Numbers of every variation, in front of each array: ``alpha``, ``shares``, and periods and
    phases of the waves."""

    alpha: Array
    shares: Array
    periods: Array
    phases: Array


def drawn(key: Key, n: int, manners: int, bounds: Float[Array, "2"]) -> Draws:
    """Of n variations: gains between the bounds, shares of so many manners, waves."""
    kind = bounds.dtype
    of_offset, of_order, of_periods, of_phases = jax.random.split(key, 4)
    columns = 1 + manners
    offset = jax.random.uniform(of_offset, (columns,), kind)
    steps = jnp.broadcast_to(jnp.arange(n, dtype=kind)[:, None], (n, columns))
    order = jax.random.permutation(of_order, steps, axis=0, independent=True)
    even = (order + offset) / n
    alpha = bounds[0] + (bounds[1] - bounds[0]) * even[:, 0]
    # The shares of exponential numbers are uniform over the simplex.
    tiny = jnp.finfo(kind).tiny
    weights = -jnp.log(jnp.maximum(even[:, 1:], tiny))
    shares = weights / jnp.maximum(jnp.sum(weights, axis=1, keepdims=True), tiny)
    low, high = (jnp.asarray(np.log(seconds), kind) for seconds in _PERIODS)
    periods = jnp.exp(jax.random.uniform(of_periods, (n, _WAVES), kind, low, high))
    phases = jax.random.uniform(of_phases, (n, _WAVES), kind, 0, 2 * np.pi)
    return Draws(alpha, shares, periods, phases)


def bent_time(
    draw: Draws, warp: Float[Array, ""], motion: Motion, count: Int[Array, ""]
) -> Float[Array, " time"]:
    """u of the module."""
    frames = motion.num_frames
    times = (jnp.arange(max(frames - 1, 0), dtype=motion.dtype) + 0.5) * motion.frame_time
    wave = jnp.cos(2 * np.pi * times[:, None] / draw.periods + draw.phases)
    speed = jnp.exp(jnp.log1p(warp) * jnp.mean(wave, axis=1))
    way = jnp.concatenate([jnp.zeros(1, motion.dtype), jnp.cumsum(speed)])
    whole, last = way[count - 1], (count - 1).astype(motion.dtype)
    return jnp.minimum(way * (last / jnp.where(whole > 0, whole, 1)), last)
