"""R and E against frame-by-frame oracles, evenly and unevenly spaced, at every short length."""

import numpy as np
import pytest

from jaxmotion.multiresolution import (
    coarser_times,
    downsample,
    expand,
    reduce,
    smoothing_mask,
    upsample,
)
from tests.helpers import assert_same_rotation, no_shape_checks
from tests.multiresolution import oracles
from tests.multiresolution.oracles import swaying


def arrays(motion, joint):
    return np.asarray(motion.rotations)[:, joint], np.asarray(motion.translations)[:, joint]


@pytest.fixture(scope="module")
def clip():
    return swaying(9, moving=True)


def test_reduce_oracle(clip):
    got = reduce(clip)
    assert got.num_frames == 5
    np.testing.assert_allclose(got.frame_time, 2 / 30)
    for j in range(3):
        q, p = oracles.reduced(*arrays(clip, j))
        assert_same_rotation(got.rotations[:, j], q)
        np.testing.assert_allclose(got.translations[:, j], p, atol=1e-13)


def test_reduce_continues_an_even_clip_by_one_frame(clip):
    got = reduce(clip[:8])
    for j in range(3):
        q, p = arrays(clip[:8], j)
        last = oracles.rotations(q[-1:]) * oracles.Rotation.from_rotvec(oracles.turns(q)[-2:-1])
        q = np.concatenate([q, last.as_quat(scalar_first=True)])
        p = np.concatenate([p, p[-1:] + p[-2:-1] - p[-3:-2]])
        q, p = oracles.reduced(q, p)
        assert_same_rotation(got.rotations[:, j], q)
        np.testing.assert_allclose(got.translations[:, j], p, atol=1e-13)


def test_expand_oracle(clip):
    coarse = clip[:5]
    got = expand(coarse)
    np.testing.assert_allclose(got.frame_time, 1 / 60)
    for j in range(3):
        q, p = oracles.expanded(*arrays(coarse, j))
        assert_same_rotation(got.rotations[:, j], q)
        np.testing.assert_allclose(got.translations[:, j], p, atol=1e-13)
    shorter = expand(coarse, 8)
    np.testing.assert_allclose(shorter.rotations, got.rotations[:8], atol=1e-15)


@pytest.mark.parametrize("frames", [2, 3, 5])
def test_expand_draws_the_cubic_at_uneven_times(frames):
    times = np.cumsum(np.random.default_rng(2).uniform(0.5, 1.5, 2 * frames - 1))
    knots = times[::2]
    rough = swaying(frames, moving=True)
    angle = 2 * ((knots - knots[0]) / (knots[-1] - knots[0])) ** min(frames - 1, 3)
    axis = np.array([0.6, 0.0, 0.8])
    q = oracles.Rotation.from_rotvec(angle[:, None] * axis).as_quat(scalar_first=True)
    coarse = rough.with_transforms(rough.translations, np.repeat(q[:, None], 3, axis=1))
    got = expand(coarse, times=times)
    want = oracles.cubic_between(knots, np.asarray(coarse.translations), times)
    np.testing.assert_allclose(got.translations, want, atol=1e-12)
    turns = oracles.cubic_between(knots, angle, times)
    want = oracles.Rotation.from_rotvec(turns[:, None] * axis).as_quat(scalar_first=True)
    assert_same_rotation(got.rotations[:, 0], want)


def test_uneven_times_that_are_even_and_the_mask_for_others(clip):
    even = 0.1 * np.arange(9)
    assert_same_rotation(reduce(clip, times=even).rotations, reduce(clip).rotations)
    uneven = np.cumsum(np.random.default_rng(3).uniform(0.5, 1.5, 9))
    got = reduce(clip, times=uneven)
    masks = np.asarray(smoothing_mask(times=uneven))
    for j in range(3):
        rotation, p = oracles.filtered(*arrays(clip, j), masks)
        assert_same_rotation(got.rotations[:, j], rotation.as_quat(scalar_first=True)[::2])
        np.testing.assert_allclose(got.translations[:, j], p[::2], atol=1e-12)
    np.testing.assert_allclose(coarser_times(uneven), uneven[::2])
    past = uneven[7] + uneven[6] - uneven[5]
    np.testing.assert_allclose(coarser_times(uneven[:8])[-1], past)


def test_octaves(clip):
    coarse = clip[:5]
    up = upsample(coarse, 2)
    assert up.num_frames == 17
    assert_same_rotation(up.rotations[::4], coarse.rotations)
    assert downsample(coarse, 0) is coarse
    assert downsample(up, 2).num_frames == 5
    one = coarse[:1]
    assert expand(one).num_frames == reduce(one).num_frames == 1


def test_wrong_arguments(clip):
    with pytest.raises(ValueError, match="num_frames=20; 9 frames become 16 to 17"):
        expand(clip, 20)
    with pytest.raises(ValueError, match="octaves=-1"):
        upsample(clip, -1)
    with no_shape_checks(), pytest.raises(ValueError, match=r"times has shape \(3,\)"):
        reduce(clip, times=np.arange(3.0))
    with pytest.raises(ValueError, match="times must increase"):
        reduce(clip, times=np.zeros(9))


def test_coarser_times_are_of_times_that_increase():
    with pytest.raises(ValueError, match="coarser_times: times must increase"):
        coarser_times(np.array([0.0, 2.0, 1.0]))
    with no_shape_checks(), pytest.raises(ValueError, match=r"coarser_times: times has shape \(\)"):
        coarser_times(np.array(1.0))
