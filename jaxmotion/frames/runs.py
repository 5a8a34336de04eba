"""Runs of set frames in masks: where they begin and end, and rules on their lengths.

Every function takes bool[T, ...], works on each column by itself, and costs O(T) a column without
loops: the last frame with a property, up to here, is a running maximum of frame numbers.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from jaxmotion._program import one_program
from jaxmotion._types import AnyArray

Mask = Bool[AnyArray, "time point"]


def spans(mask: Any) -> list[tuple[int, int]]:
    """The first frame and the one after the last of every run of a known mask bool[T]; on the
    host."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(mask, np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


@one_program()
def last_before(mask: Bool[AnyArray, "time *rest"]) -> Int[Array, "time *rest"]:
    """The last set frame up to and with each frame; −1 where there is none."""
    return jax.lax.cummax(jnp.where(mask, _frames(mask), -1), axis=0)


@one_program()
def next_after(mask: Bool[AnyArray, "time *rest"]) -> Int[Array, "time *rest"]:
    """The next set frame from each frame on; T where there is none."""
    return jax.lax.cummin(jnp.where(mask, _frames(mask), mask.shape[0]), axis=0, reverse=True)


@one_program()
def held(values: Shaped[AnyArray, "time *rest"], mask: Bool[AnyArray, "time ..."]) -> Array:
    """Values where the mask is set; elsewhere the last one before that is, or else the first of
    all. The mask has the values' axes, each equal or 1."""
    last, first = last_before(mask), next_after(mask)[:1] % mask.shape[0]
    return jnp.take_along_axis(values, jnp.where(last < 0, first, last), axis=0)


@one_program()
def hysteresis(strong: Mask, weak: Mask) -> Mask:
    """Runs of ``weak | strong`` that have a ``strong`` frame somewhere."""
    either = weak | strong
    from_before = last_before(strong) > last_before(~either)
    from_after = next_after(strong) < next_after(~either)
    return either & (from_before | from_after)


def without_short(mask: Mask, least: Int[Array, ""], counts: Bool[AnyArray, " time"]) -> Mask:
    """Drop runs of fewer than ``least`` frames; those that an end of the clip cuts stay."""
    begin, end = last_before(~mask), next_after(~mask)
    cut = (begin < 0) | (end >= jnp.sum(counts, dtype=jnp.int32))
    return mask & (cut | (end - begin - 1 >= least))


def without_gaps(mask: Mask, least: Int[Array, ""], counts: Bool[AnyArray, " time"]) -> Mask:
    """Close gaps of fewer than ``least`` frames between two runs."""
    return ~without_short(~mask & counts[:, None], least, counts) & counts[:, None]


def mean_over_runs(
    mask: Mask, values: Float[AnyArray, "time point 3"], weights: Float[AnyArray, "time point"]
) -> Float[Array, "time point 3"]:
    """In each run, the weighted mean of the values over the run; where free, the values."""
    count = mask.shape[0]
    start = mask & ~jnp.pad(mask, ((1, 0), (0, 0)))[:-1]
    run = jnp.where(mask, jnp.cumsum(start, axis=0, dtype=jnp.int32), 0)
    # Sums of differences from the run's first value, so that float32 keeps its digits far away.
    first = jnp.take_along_axis(values, jnp.maximum(last_before(start), 0)[..., None], axis=0)
    weights = jnp.where(mask, weights, 0)

    def per_point(run, values, weights):
        # At most every second frame begins a run; number 0 collects the free frames.
        sums = jax.ops.segment_sum(
            jnp.concatenate([weights[:, None] * values, weights[:, None]], axis=1),
            run,
            count // 2 + 2,
        )
        total = jnp.where(sums[:, 3:] > 0, sums[:, 3:], 1)
        return (sums[:, :3] / total)[run]

    mean = jax.vmap(per_point, 1, 1)(run, values - first, weights)
    return jnp.where(mask[..., None], first + mean, values)


def spread(
    values: Float[AnyArray, "time limb n"], on: Bool[AnyArray, "time limb"], reach: Float[Array, ""]
) -> Float[Array, "time limb n"]:
    """Values where ``on``; elsewhere those of the nearest such frames before and after, faded to
    nothing over ``reach`` frames, or into one another over shorter gaps, by 2u³ − 3u² + 1."""
    count = on.shape[0]
    frames = _frames(on)
    before, after = last_before(on), next_after(on)
    far = jnp.asarray(4 * count, jnp.int32)
    since = jnp.where(before >= 0, frames - before, far)
    until = jnp.where(after < count, after - frames, far)
    span = jnp.minimum((since + until).astype(values.dtype), reach + 1)

    def side(frame, away):
        u = jnp.clip(away.astype(values.dtype) / jnp.where(on, 1, span), 0, 1)
        fade = jnp.where(on, 1, 2 * u**3 - 3 * u**2 + 1)
        frame = jnp.clip(frame, 0, count - 1)[..., None]
        return fade[..., None] * jnp.take_along_axis(values, frame, axis=0)

    return jnp.where(on[..., None], values, side(before, since) + side(after, until))


def _frames(mask: Bool[AnyArray, "time *rest"]) -> Int[Array, "time *one"]:
    frames = np.arange(mask.shape[0], dtype=np.int32)
    return jnp.asarray(frames.reshape(-1, *[1] * (mask.ndim - 1)))
