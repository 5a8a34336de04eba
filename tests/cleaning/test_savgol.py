"""The filter over a repair's edges, against SciPy's."""

import numpy as np
import pytest
from scipy.signal import savgol_filter

from jaxmotion.cleaning.savgol import smoothed
from tests.helpers import assert_same_rotation, random_quaternions
from tests.style.clips import swaying


def by_scipy(q):
    """Savitzky and Golay's of f[T, J, 4], the clip going on turned about at its ends."""
    q = np.array(q, float)
    for t in range(1, len(q)):
        q[t] *= np.where(np.sum(q[t] * q[t - 1], axis=-1, keepdims=True) < 0, -1, 1)
    beyond = np.pad(q, ((4, 4), (0, 0), (0, 0)), mode="reflect", reflect_type="odd")
    found = savgol_filter(beyond, 9, 2, axis=0)[4:-4]
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


def test_as_scipy_has_it(dtype):
    q = np.array(swaying(0, 40).rotations, dtype)
    q[7:20] *= -1
    q[30, 2] *= -1
    before = q.copy()
    mask = np.zeros((40, 5), bool)
    mask[:, :4] = True
    found, wide = smoothed(q, mask)
    assert found.dtype == dtype
    assert_same_rotation(found[:, :4], by_scipy(q)[:, :4], 1e-10 if dtype == np.float64 else 1e-5)
    np.testing.assert_array_equal(found[:, 4], q[:, 4])
    np.testing.assert_array_equal(wide, mask)
    np.testing.assert_array_equal(q, before)


def test_four_frames_beside_each_run():
    q = np.array(swaying(1, 40).rotations)
    mask = np.zeros((40, 5), bool)
    mask[2, 0] = mask[20:24, 1] = mask[38, 2] = True
    found, wide = smoothed(q, mask)
    wanted = np.zeros((40, 5), bool)
    wanted[:7, 0] = wanted[16:28, 1] = wanted[34:, 2] = True
    np.testing.assert_array_equal(wide, wanted)
    np.testing.assert_array_equal(found[~wanted], q[~wanted])
    assert_same_rotation(found[wanted], by_scipy(q)[wanted], 1e-10)


def test_a_parabola_stays():
    """Of quaternions, before they have length 1 again."""
    t = np.linspace(-1, 1, 30)[:, None]
    line = np.concatenate([np.ones_like(t), 0.3 * t, 0.1 * t**2, 0 * t], axis=1)
    q = (line / np.linalg.norm(line, axis=1, keepdims=True))[:, None]
    found, _ = smoothed(line[:, None], np.ones((30, 1), bool))
    assert_same_rotation(found[4:-4], q[4:-4], 1e-12)


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 5, 9])
def test_short_clips(frames):
    """A clip that stands still does so afterwards; all are of length 1."""
    q = np.asarray(random_quaternions(np.random.default_rng(0), (1, 2)))
    found, wide = smoothed(np.repeat(q, frames, axis=0), np.ones((frames, 2), bool))
    assert_same_rotation(found, np.repeat(q, frames, axis=0), 1e-7)
    mask = np.zeros((frames, 2), bool)
    mask[0, 1] = True
    _, wide = smoothed(np.repeat(q, frames, axis=0), mask)
    np.testing.assert_array_equal(wide[:, 1], np.arange(frames) <= 4)
    assert not wide[:, 0].any()
    if frames >= 5:
        q = np.array(swaying(2, frames).rotations)
        found, _ = smoothed(q, np.ones((frames, 5), bool))
        assert_same_rotation(found, by_scipy(q), 1e-10)
