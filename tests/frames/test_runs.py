"""Runs of mask frames against loops."""

from itertools import groupby

import jax.numpy as jnp
import numpy as np

from jaxmotion.frames import runs
from tests.helpers import check_gradients

T, C = 60, 5
ALL = jnp.ones(T, bool)


def masks(seed, share=0.6):
    return np.random.default_rng(seed).uniform(size=(T, C)) < share


def runs_of(column):
    """(first, end, value) of each run."""
    start = 0
    for value, group in groupby(column):
        count = len(list(group))
        yield start, start + count, value
        start += count


def test_hysteresis():
    strong, weak = masks(0, 0.1), masks(1, 0.7)
    want = np.zeros((T, C), bool)
    for c in range(C):
        for first, end, value in runs_of(weak[:, c] | strong[:, c]):
            want[first:end, c] = value and strong[first:end, c].any()
    np.testing.assert_array_equal(runs.hysteresis(jnp.asarray(strong), jnp.asarray(weak)), want)


def test_short_runs_and_gaps():
    mask, valid = masks(2), np.arange(T) < 50
    mask = mask & valid[:, None]
    short, gaps = mask.copy(), mask.copy()
    for c in range(C):
        for first, end, value in runs_of(mask[:50, c]):
            inside = first > 0 and end < 50 and end - first < 3
            if inside and value:
                short[first:end, c] = False
            if inside and not value:
                gaps[first:end, c] = True
    three = jnp.asarray(3, jnp.int32)
    given = jnp.asarray(mask), three, jnp.asarray(valid)
    np.testing.assert_array_equal(runs.without_short(*given), short)
    np.testing.assert_array_equal(runs.without_gaps(*given), gaps)


def test_mean_over_runs_far_from_the_origin(dtype):
    rng = np.random.default_rng(3)
    mask, weights = masks(4), rng.uniform(0.1, 1, (T, C))
    values = rng.standard_normal((T, C, 3))
    got = runs.mean_over_runs(
        jnp.asarray(mask), jnp.asarray(values + 1e3, dtype), jnp.asarray(weights, dtype)
    )
    want = values.copy()
    for c in range(C):
        for first, end, value in runs_of(mask[:, c]):
            if value:
                w = weights[first:end, c, None]
                want[first:end, c] = (w * values[first:end, c]).sum(0) / w.sum()
    assert got.dtype == dtype
    np.testing.assert_allclose(got, want + 1e3, atol=2e-4 if dtype == np.float32 else 1e-11)


def test_spread_against_a_loop():
    rng = np.random.default_rng(5)
    on = masks(6, 0.08)
    on[:, 0] = False
    values, reach = rng.standard_normal((T, C, 2)), 6.0
    got = runs.spread(jnp.asarray(values), jnp.asarray(on), jnp.asarray(reach))
    want = np.zeros_like(values)
    for c in range(C):
        frames = np.flatnonzero(on[:, c])
        for t in range(T):
            before, after = frames[frames <= t], frames[frames >= t]
            if on[t, c]:
                want[t, c] = values[t, c]
                continue
            gap = after[0] - before[-1] if len(before) and len(after) else np.inf
            for frame in (*before[-1:], *after[:1]):
                u = min(abs(t - frame) / min(gap, reach + 1), 1)
                want[t, c] += (2 * u**3 - 3 * u**2 + 1) * values[frame, c]
    np.testing.assert_allclose(got, want, atol=1e-12)
    check_gradients(lambda v: runs.spread(v, jnp.asarray(on), jnp.asarray(reach)), values)


def test_held_values_are_the_last_there_or_else_the_first():
    rng = np.random.default_rng(3)
    values, mask = rng.normal(size=(12, 4)), rng.random((12, 4)) < 0.4
    mask[:, 0], mask[:, 1] = False, True
    found = runs.held(jnp.asarray(values), jnp.asarray(mask))
    for c in range(4):
        there = np.flatnonzero(mask[:, c])
        for t in range(12):
            before = there[there <= t]
            at = before[-1] if len(before) else (there[0] if len(there) else 0)
            assert found[t, c] == values[at, c]
    shared = runs.held(jnp.asarray(values), jnp.asarray(mask[:, 2:3]))
    np.testing.assert_array_equal(shared[:, 2], found[:, 2])
