"""Changes of manner found: where clips were joined, and nowhere else."""

import functools

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.style import segment_styles
from jaxmotion.style.segments import _cheapest, _cost, _costs
from tests.style.clips import swaying


def joined(*clips):
    """One clip after another, on the first one's skeleton."""
    return clips[0].with_transforms(
        np.concatenate([clip.translations for clip in clips]),
        np.concatenate([clip.rotations for clip in clips]),
    )


def test_where_clips_were_joined():
    clips = [swaying(seed, frames) for seed, frames in ((0, 450), (1, 600), (2, 390))]
    found = segment_styles(joined(*clips))
    assert [(part.start, part.end) for part in found] == [
        (0, pytest.approx(450, abs=6)),
        (pytest.approx(450, abs=6), pytest.approx(1050, abs=6)),
        (pytest.approx(1050, abs=6), 1440),
    ]
    assert found[0].gain == 0
    assert all(part.gain > 1 for part in found[1:])
    [first, second] = segment_styles(joined(*clips), max_segments=2)
    assert first.end == second.start
    assert min(abs(first.end - 450), abs(first.end - 1050)) <= 6


def test_one_manner_is_one_segment():
    for seed in range(3, 8):
        assert len(segment_styles(swaying(seed, 300))) == 1
    still = swaying(8, frames=1)
    still = still.with_transforms(
        np.repeat(still.translations, 90, 0), np.repeat(still.rotations, 90, 0)
    )
    assert segment_styles(still) == ((0, 90, 0.0),)


def test_cost_is_a_gaussian_s():
    rng = np.random.default_rng(0)
    x = rng.standard_normal((60, 3)) @ rng.standard_normal((3, 3))
    places = np.array([0, 20, 35, 60])
    table = _costs(x, places, 16)
    for a in range(4):
        for b in range(a + 1, 4):
            part = x[places[a] : places[b]]
            if len(part) < 16:
                assert np.isinf(table[a, b])
                continue
            covariance = np.cov(part.T, bias=True) + 0.01 * np.eye(3)
            wanted = 0.5 * len(part) * np.linalg.slogdet(covariance)[1]
            np.testing.assert_allclose(table[a, b], wanted, rtol=1e-9)
    assert np.isinf(table[np.tril_indices(4)]).all()
    assert _cost(np.array([5.0]), np.zeros((1, 3)), np.zeros((1, 3, 3))) < 0


def test_cuts_are_those_of_every_way_to_cut():
    rng = np.random.default_rng(1)
    cost = np.where(np.triu(np.ones((9, 9)), 1) > 0, rng.uniform(0, 10, (9, 9)), np.inf)

    @functools.cache
    def best(at, left):
        ends = [(cost[at, 8], ())]
        if left:
            for k in range(at + 1, 8):
                value, cuts = best(k, left - 1)
                ends.append((cost[at, k] + 2.5 + value, (k, *cuts)))
        return min(ends)

    for most in (1, 2, 4, 8):
        assert tuple(_cheapest(cost, 2.5, most)) == best(0, most - 1)[1]


@pytest.mark.parametrize("sizes", [(1,), (2,), (20, 20), (31, 31)])
def test_short_clips(sizes):
    clips = [swaying(seed, frames) for seed, frames in enumerate(sizes)]
    found = segment_styles(joined(*clips))
    assert (found[0].start, found[-1].end) == (0, sum(sizes))
    if sum(sizes) < 60:
        assert len(found) == 1


def test_long_clips_have_fewer_places():
    clips = [swaying(seed, 1500) for seed in (9, 10)]
    [first, _] = segment_styles(joined(*clips))
    assert abs(first.end - 1500) <= 12


def test_real_walks(data_dir):
    """One after another, in two manners; and one alone."""
    normal, tired = (jm.load(data_dir / f"bandai/walk_{s}_001.bvh") for s in ("normal", "tired"))
    assert len(segment_styles(tired)) == 1
    [first, _] = segment_styles(joined(normal, tired))
    assert abs(first.end - normal.num_frames) <= 3


def test_what_is_wrong_is_said():
    motion = swaying(11, 70)
    with pytest.raises(ValueError, match="max_segments=0"):
        segment_styles(motion, max_segments=0)
    with pytest.raises(ValueError, match="want seconds above 0"):
        segment_styles(motion, shortest=0.0)
    with pytest.raises(TypeError, match="outside of jit"):
        jax.jit(lambda m: segment_styles(m)[0].start)(motion)
