"""What a word's distance cannot be less than."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.cleaning import bound
from jaxmotion.cleaning.bound import WordShape, least_distances
from tests.cleaning.clips import word_distance

SHAPES = [WordShape(15, 20, 3, 11), WordShape(6, 9, 3, 5), WordShape(5, 5, 2, 3)]


def reached(shape):
    """Cells on some path to an end, by trying every step from every cell."""
    n, m, run = shape.length, shape.target, shape.run
    steps = [(1, 1, ""), (1, 0, "i"), (0, 1, "j")]
    states = {(0, 0, "", 0)}
    order = [(0, 0, "", 0)]
    after = {}
    for state in order:
        i, j, axis, count = state
        for di, dj, name in steps:
            longer = count + 1 if name and name == axis else int(bool(name))
            new = (i + di, j + dj, name, longer)
            if new[0] < n and new[1] < m and longer <= run:
                after.setdefault(new, []).append(state)
                if new not in states:
                    states.add(new)
                    order.append(new)
    useful = {s for s in states if s[0] == n - 1 and s[1] >= shape.least - 1}
    order = list(useful)
    for state in order:
        for before in after.get(state, []):
            if before not in useful:
                useful.add(before)
                order.append(before)
    return {state[:2] for state in useful}


@pytest.mark.parametrize("shape", SHAPES)
def test_rows_hold_every_path(shape):
    cells = reached(shape)
    for i in range(shape.length):
        columns = [j for a, j in cells if a == i]
        first, last = shape.columns(i)
        assert first <= min(columns)
        assert last >= max(columns)
    # And no more than a little else.
    wide = sum(last - first + 1 for first, last in map(shape.columns, range(shape.length)))
    assert wide <= 1.35 * len(cells)


def distances(rng, rows, columns):
    """As of words: hills and valleys along both axes."""
    rough = rng.standard_normal((rows, columns))
    return np.abs(np.cumsum(rough, axis=1)) + rng.uniform(0, 0.5, (rows, columns))


@pytest.mark.parametrize("shape", SHAPES[:2])
def test_is_never_above_the_distance(shape, monkeypatch):
    """Over the seams of tiles as well."""
    monkeypatch.setattr(bound, "_COLUMNS", 16)
    rng = np.random.default_rng(0)
    starts = [0, 3, 4]
    d = distances(rng, starts[-1] + shape.length, 40 + shape.target)
    least = np.asarray(least_distances(jnp.asarray(d), jnp.asarray(starts, jnp.int32), shape))
    assert least.shape == (3, d.shape[1])
    for (w, start), t in itertools.product(enumerate(starts), range(40)):
        patch = d[start : start + shape.length, t : t + shape.target]
        exact = word_distance(patch, shape.least)
        assert 0 < least[w, t] <= exact


def test_is_the_least_mean_of_what_rows_can_have():
    """Of all weights from 1 to 4: those of the smallest m first, as many as pay."""
    rng = np.random.default_rng(1)
    shape = WordShape(6, 9, 3, 5)
    d = distances(rng, 6, 30)
    least = np.asarray(least_distances(jnp.asarray(d), jnp.zeros(1, jnp.int32), shape))[0]
    for t in range(20):
        m = [min(d[i, t + a : t + b + 1]) for i, (a, b) in enumerate(map(shape.columns, range(6)))]
        m = np.sort(m)
        means = [(4 * m[:k].sum() + m[k:].sum()) / (4 * k + 6 - k) for k in range(7)]
        assert min(means) * (1 - 1e-3) <= least[t] <= min(means)


def test_equal_distances():
    """Every mean is the same, and so is the bound but for its margin."""
    shape = SHAPES[0]
    d = jnp.full((15, 60), 0.25)
    least = least_distances(d, jnp.zeros(1, jnp.int32), shape)[0, :40]
    np.testing.assert_allclose(least, 0.25, rtol=2e-5)
    assert (least < 0.25).all()
