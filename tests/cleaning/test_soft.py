"""Soft words: what they come to as they harden, and derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit

import jaxmotion as jm
from jaxmotion.cleaning import soft_mask, soft_neighbours, soft_word_distances
from tests.cleaning.clips import frame_distance, repeating, word_distance
from tests.helpers import no_shape_checks

N, M, LEAST = 6, 8, 5


@pytest.fixture(scope="module")
def pairs():
    """Three words, four targets, and their cost matrices by hand."""
    q = np.asarray(repeating(0, 60).rotations)
    words = np.stack([q[s : s + N] for s in (0, 7, 20)])
    targets = np.stack([q[s : s + M] for s in (3, 18, 31, 44)])
    costs = [
        [np.array([[frame_distance(x, y, 1) for y in t] for x in w]) for t in targets]
        for w in words
    ]
    return words, targets, costs


def paths(n, m):
    """Every path of "slope3" from the first cell, as lists of cells, with its last step's run."""
    found, alive = [], [([(0, 0)], "", 0)]
    while alive:
        cells, axis, run = alive.pop()
        found.append(cells)
        i, j = cells[-1]
        for di, dj, name in ((1, 1, ""), (1, 0, "i"), (0, 1, "j")):
            longer = run + 1 if name and name == axis else int(bool(name))
            if i + di < n and j + dj < m and longer <= 3:
                alive.append(([*cells, (i + di, j + dj)], name, longer))
    return found


def test_by_every_path(pairs):
    """Sums over all paths to each end, by listing them."""
    words, targets, costs = pairs
    gamma = 0.05
    found = soft_word_distances(words[:1], targets[:2], gamma=gamma, trim=1, least=LEAST)
    listed = paths(N, M)
    for target in range(2):
        d, means = costs[0][target], []
        for end in range(LEAST - 1, M):
            here = [cells for cells in listed if cells[-1] == (N - 1, end)]
            sums = np.array([sum(d[c] for c in cells) for cells in here])
            weights = np.exp(-sums / gamma)
            total = -gamma * np.log(weights.sum())
            means.append(total / (weights @ [len(c) for c in here] / weights.sum()))
        want = -gamma / N * np.log(np.exp(-np.array(means) * N / gamma).sum())
        assert float(found[0, target]) == pytest.approx(want, rel=1e-9)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_hardens_to_the_distance_of_words(pairs, dtype):
    words, targets, costs = pairs
    found = soft_word_distances(
        words.astype(dtype), targets.astype(dtype), gamma=1e-6, trim=1, least=LEAST
    )
    assert found.dtype == dtype
    want = [[word_distance(d, LEAST) for d in row] for row in costs]
    np.testing.assert_allclose(found, want, rtol=1e-9 if dtype == "float64" else 1e-3, atol=1e-6)


def test_derivatives_of_distances(pairs):
    """Against differences in both modes, and finite where a word is its own target."""
    words, targets, _ = pairs

    def loss(q, gamma):
        return jnp.sum(soft_word_distances(q, targets, gamma=gamma, least=LEAST))

    rng = np.random.default_rng(0)
    v = rng.standard_normal(words.shape)
    v -= np.sum(v * words, axis=-1, keepdims=True) * words

    def along(t):
        return jnp.asarray((words + t * v) / np.linalg.norm(words + t * v, axis=-1, keepdims=True))

    want = (loss(along(1e-5), 0.02) - loss(along(-1e-5), 0.02)) / 2e-5
    _, forward = jax.jvp(lambda q: loss(q, 0.02), (jnp.asarray(words),), (jnp.asarray(v),))
    backward = jnp.vdot(jax.grad(loss)(jnp.asarray(words), 0.02), v)
    np.testing.assert_allclose([forward, backward], want, rtol=1e-6)
    d_gamma = jax.grad(loss, 1)(jnp.asarray(words), 0.02)
    want = (loss(words, 0.02 + 1e-6) - loss(words, 0.02 - 1e-6)) / 2e-6
    np.testing.assert_allclose(d_gamma, want, rtol=1e-5)
    same = jnp.asarray(targets[:, :N])
    assert np.isfinite(jax.grad(loss)(same, 1e-3)).all()


def test_neighbours():
    """They add up to one; each is a sigmoid's; hard, those of the K least distances."""
    rng = np.random.default_rng(1)
    d = rng.uniform(0, 1, (2, 3, 20))
    soft = np.asarray(soft_neighbours(d, k=4, beta=0.1))
    np.testing.assert_allclose(soft.sum(axis=-1), 1, atol=1e-12)
    logits = np.log(4 * soft / (1 - 4 * soft))
    np.testing.assert_allclose(np.ptp(logits + d / 0.1, axis=-1), 0, atol=1e-8)
    hard = np.asarray(soft_neighbours(d, k=4, beta=1e-6))
    nearest = np.argsort(d, axis=-1)[..., :4]
    np.testing.assert_allclose(np.take_along_axis(hard, nearest, -1), 0.25, atol=1e-9)
    jacobian = jax.jacfwd(lambda x: soft_neighbours(x, k=4, beta=0.1))(d[0, 0])
    step = 1e-6 * np.eye(20)
    want = [
        (soft_neighbours(d[0, 0] + e, k=4, beta=0.1) - soft_neighbours(d[0, 0] - e, k=4, beta=0.1))
        / 2e-6
        for e in step
    ]
    np.testing.assert_allclose(jacobian, np.stack(want, axis=1), atol=1e-8)
    # Equals share, and nothing is lost where distances are far apart.
    np.testing.assert_allclose(soft_neighbours(np.ones(5), k=2), 0.2, atol=1e-12)
    far = soft_neighbours(np.array([0.0, 1e3, 2e3]), k=1, beta=0.01)
    np.testing.assert_allclose(far, [1, 0, 0], atol=1e-9)


def test_mask():
    m = np.linspace(0, 2, 9)[:, None] * np.ones(3)
    scale = np.array([0.5, 1.0, 1.5])
    soft = soft_mask(m, scale, width=0.2)
    np.testing.assert_allclose(soft, expit((m / scale - 1) / 0.2), atol=1e-12)
    hard = np.asarray(soft_mask(m, scale, width=1e-6))
    off = np.abs(m / scale - 1) > 1e-9
    np.testing.assert_array_equal(hard[off] > 0.5, (m > scale)[off])
    assert soft_mask(np.float32([0.1])).dtype == np.float32


def test_under_jit(pairs):
    words, targets, _ = pairs

    def all_of_it(q):
        d = soft_word_distances(q, targets, gamma=0.01, least=LEAST)
        return soft_mask(soft_neighbours(d, k=2, beta=0.05), 0.3)

    np.testing.assert_allclose(jax.jit(all_of_it)(words), all_of_it(words), atol=1e-12)


def test_what_is_wrong_is_said(pairs):
    words, targets, _ = pairs
    with no_shape_checks():
        with pytest.raises(ValueError, match=r"targets have shape \(4, 8, 4, 4\)"):
            soft_word_distances(words, targets[:, :, :4])
        with pytest.raises(ValueError, match="gamma must be above 0"):
            soft_word_distances(words, targets, gamma=0.0)
        with pytest.raises(ValueError, match="least=9; expected 1 to 8"):
            soft_word_distances(words, targets, least=9)
        with pytest.raises(ValueError, match="k=3; expected"):
            soft_neighbours(np.ones(3), k=3)
        with pytest.raises(ValueError, match="beta must be above 0"):
            soft_neighbours(np.ones(3), k=1, beta=-1)
        with pytest.raises(ValueError, match="scale must be above 0"):
            soft_mask(np.ones(3), 0.0)
        with pytest.raises(ValueError, match="width must be above 0"):
            soft_mask(np.ones(3), width=0.0)
        with pytest.raises(ValueError, match="Motion"):
            soft_neighbours(jm.samples.load("walk").motion)
