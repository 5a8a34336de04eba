"""Suggested keys against a greedy search through dense inverses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.smoothing import lgs, suggest_keys


def greedy(precision, sigmas, n, allowed=None):
    """Each round inverts every candidate's precision; returns frames and variances (n, T, C)."""
    frames = len(precision[0])
    left = [i for i in range(frames) if allowed is None or allowed[i]]
    precision, chosen, variances = list(precision), [], []
    for _ in range(n):
        totals = {}
        for i in left:
            unit = np.outer(np.eye(frames)[i], np.eye(frames)[i])
            added = [p + unit / s**2 for p, s in zip(precision, sigmas, strict=True)]
            totals[i] = sum(np.trace(np.linalg.inv(p)) for p in added)
        best = min(left, key=lambda i: totals[i])
        left.remove(best)
        unit = np.outer(np.eye(frames)[best], np.eye(frames)[best])
        precision = [p + unit / s**2 for p, s in zip(precision, sigmas, strict=True)]
        chosen.append(best)
        variances.append(np.stack([np.diag(np.linalg.inv(p)) for p in precision], -1))
    return chosen, np.stack(variances)


def dense_precision(frames, keys, weights, lam, sigma):
    bend = np.diff(np.eye(frames), n=2, axis=0) / 2
    seen = np.zeros(frames)
    np.add.at(seen, keys, weights)
    return lam**2 * bend.T @ bend + np.diag(seen) / sigma**2


def test_matches_greedy_search(dtype):
    keys, lam, sigma = np.array([2, 9, 13, 30]), 1.3, 0.4
    y = np.random.default_rng(0).standard_normal((4, 3)).astype(dtype)
    found = suggest_keys(lgs(y, lam, sigma, index=keys, num_frames=40), 6)
    frames, variance = greedy([dense_precision(40, keys, np.ones(4), lam, sigma)], [sigma], 6)
    assert found.variance.dtype == dtype
    np.testing.assert_array_equal(found.frames, frames)
    tol = 1e-9 if dtype == np.float64 else 2e-3
    np.testing.assert_allclose(found.variance, variance[..., 0], rtol=tol)


def test_parameters_per_channel_and_candidates():
    keys, lam, sigma = np.array([1, 4, 11]), np.array([0.5, 3.0]), np.array([0.4, 1.0])
    weights = np.array([[1.0, 0.5], [2.0, 1.0], [1.0, 1.5]])
    y = np.random.default_rng(1).standard_normal((3, 2))
    posterior = lgs(y, lam, sigma, index=keys, num_frames=16, weights=weights)
    allowed = np.arange(16) % 3 == 0
    precision = [dense_precision(16, keys, weights[:, c], lam[c], sigma[c]) for c in range(2)]
    frames, variance = greedy(precision, sigma, 4, allowed)
    for given in (allowed, jnp.asarray(allowed)):
        found = suggest_keys(posterior, 4, candidates=given)
        np.testing.assert_array_equal(found.frames, frames)
        np.testing.assert_allclose(found.variance, variance, rtol=1e-9)


def test_well_observed_frames_gain_less_and_none_is_chosen_twice():
    """Every frame observed, some poorly and some very well: variances on both sides of an
    observation's own. In the first clip, of frames hardly tied to each other, the poorest would be
    worth observing again."""
    poor_and_good = np.array([0.02, 6.0, 0.9, 2.0, 0.3, 12.0, 1.1, 0.7])
    mixed = np.array([1.15, 1.34, 12.55, 0.05, 0.71, 3.23, 0.1, 0.35])
    sigma = 0.5
    for weights, lam in ((poor_and_good, 0.05), (mixed, 3.0)):
        found = suggest_keys(lgs(np.ones(8), lam, sigma, weights=weights), 5)
        precision = [dense_precision(8, np.arange(8), weights, lam, sigma)]
        frames, variance = greedy(precision, [sigma], 5)
        np.testing.assert_array_equal(found.frames, frames)
        np.testing.assert_allclose(found.variance, variance[..., 0], rtol=1e-9)


def test_observing_the_suggested_frames_gives_the_variances():
    keys = np.array([0.0, 3.25, 19.0])
    found = suggest_keys(lgs(np.ones(3), 1.0, 0.5, index=keys, num_frames=20), 3)
    for count in (1, 3):
        more = np.r_[keys, np.asarray(found.frames[:count])]
        again = lgs(np.ones(len(more)), 1.0, 0.5, index=more, num_frames=20)
        np.testing.assert_allclose(again.variance, found.variance[count - 1], rtol=1e-9)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_short_clips(frames):
    found = suggest_keys(lgs(np.ones(frames), 1.0, 0.5), frames)
    assert sorted(np.asarray(found.frames)) == list(range(frames))
    twice = lgs(np.ones(frames), 1.0, 0.5, weights=np.full(frames, 2.0))
    np.testing.assert_allclose(found.variance[-1], twice.variance)


def test_jit_and_vmap():
    y = jnp.ones((3, 1))
    lams = jnp.asarray([0.3, 4.0])

    def suggest(lam):
        return suggest_keys(lgs(y, lam, 0.5, index=[1, 5, 11], num_frames=14), 2)

    mapped = jax.jit(jax.vmap(suggest))(lams)
    for i, lam in enumerate(lams):
        alone = suggest(lam)
        np.testing.assert_array_equal(mapped.frames[i], alone.frames)
        np.testing.assert_allclose(mapped.variance[i], alone.variance, rtol=1e-10)


@pytest.mark.parametrize(
    ("n", "candidates", "message"),
    [
        (0, None, "n=0"),
        (6, None, "n=6: want from 1 to 5"),
        (2, np.ones(4, bool), r"candidates are bool \(4,\)"),
        (2, np.ones(5), r"candidates are float64 \(5,\)"),
        (2, np.arange(5) == 1, "fewer than n=2"),
    ],
)
def test_bad_arguments(n, candidates, message):
    posterior = lgs(np.ones(5), 1.0, 1.0)
    with pytest.raises(ValueError, match=message):
        suggest_keys(posterior, n, candidates=candidates)


def test_too_few_traced_candidates():
    posterior = lgs(np.ones(5), 1.0, 1.0)
    with pytest.raises(Exception, match="fewer than n=2"):
        jax.block_until_ready(suggest_keys(posterior, 2, candidates=jnp.arange(5) == 1))
