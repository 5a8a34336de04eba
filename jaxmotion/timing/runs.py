"""A warp as runs: source frame i stands at ``runs[i]`` refined frames in a row.

Refined frames past the last run belong to the last source frame there is. O(refined), but for
the search for the best, O(N_s N_r m³).
"""

from functools import partial

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxmotion import quaternion


def by_channel(function, runs, *signal, **static):
    """Apply a function of (runs (N_s,), signal) to each channel when the runs differ by channel."""

    def one(runs, *signal):
        return function(runs, *signal, **static)

    return (one if runs.ndim == 1 else jax.vmap(one, -1, -1))(runs, *signal)


@partial(jax.jit, static_argnames="num_refined")
def source_index(runs, *, num_refined):
    """Which source frame stands at each refined frame."""
    frames = jnp.arange(runs.shape[0], dtype=runs.dtype)
    return jnp.repeat(frames, runs, total_repeat_length=num_refined)


def run_sums(runs, signal):
    """Sums of a signal on the refined timeline over each source frame's run."""
    index = source_index(runs, num_refined=signal.shape[0])
    return jax.ops.segment_sum(signal, index, runs.shape[0], indices_are_sorted=True)


def run_means(runs, signal):
    """The same, means."""
    sums = run_sums(runs, signal)
    return sums / runs.astype(signal.dtype).reshape((-1,) + (1,) * (sums.ndim - 1))


def run_geodesic_means(runs, q):
    """Means of rotations, one more frame at a time."""
    index = source_index(runs, num_refined=q.shape[0])
    starts = jnp.cumsum(runs) - runs
    place = (jnp.arange(q.shape[0], dtype=runs.dtype) - starts[index]).astype(q.dtype)

    def one_frame(mean, frame):
        q, place = frame
        mean = jnp.where(place == 0, q, quaternion.slerp(mean, q, 1 / (place + 1)))
        return mean, mean

    _, means = lax.scan(one_frame, q[0], (q, place))
    return means[starts + runs - 1]


def best_runs(
    d: Float[Array, "source reference"],
    m: int,
    counts: Bool[Array, " source"],
    num_reference: Int[Array, ""],
) -> Int[Array, " source"]:
    """Runs of 1 … m² refined frames of least total distance, one for each source frame that counts,
    0 for the others; of the reference the first frames count."""
    refined = d.shape[1] * m

    def one_frame(ended, row):
        i, row = row
        row = jnp.repeat(row, m)
        before = jnp.where(i == 0, 0, jnp.inf).astype(d.dtype)
        run = _shift_in(ended, before) + row
        best, length = run, jnp.ones(refined, jnp.int32)
        for c in range(2, m * m + 1):
            run = _shift_in(run, jnp.inf) + row
            length = jnp.where(run < best, c, length)
            best = jnp.minimum(best, run)
        return best, length

    def one_run(end, frame):
        lengths, counts = frame
        run = jnp.where(counts, lengths[end], 0)
        return end - run, run

    start = jnp.full(refined, jnp.inf, d.dtype)
    frames = jnp.arange(d.shape[0], dtype=jnp.int32)
    _, lengths = lax.scan(one_frame, start, (frames, d))
    last = m * num_reference.astype(jnp.int32) - 1
    return lax.scan(one_run, last, (lengths, counts), reverse=True)[1]


def _shift_in(values, outside):
    """Entry j of the result is entry j − 1; ``outside`` enters at the start."""
    return lax.pad(values[:-1], jnp.asarray(outside, values.dtype), [(1, 0, 0)])
