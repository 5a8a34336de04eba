"""Frames that are not there, against SciPy's slerp and NumPy's interpolation."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Slerp

import jaxmotion as jm
from jaxmotion.cleaning.missing import bridged, filled
from tests.helpers import assert_same_rotation
from tests.style.clips import quaternions, rotations, swaying


def gone(motion, *places, turns=True, moves=True):
    """The motion with joints missing: (first frame, after the last, joint)."""
    q, there = np.array(motion.rotations), np.array(motion.translations)
    for start, stop, joint in places:
        if turns:
            q[start:stop, joint, 1] = np.nan
        if moves:
            there[start:stop, joint, 2] = np.inf
    return motion.with_transforms(there, q)


def test_between_the_frames_there_are(dtype):
    motion = swaying(0, 30).astype(dtype)
    broken = gone(motion, (4, 9, 2), (12, 13, 2), (14, 28, 0))
    whole, missing = filled("f", broken)
    assert whole.dtype == dtype
    wanted = np.zeros((30, 5), bool)
    wanted[4:9, 2] = wanted[12, 2] = wanted[14:28, 0] = True
    np.testing.assert_array_equal(missing, wanted)
    for name in ("rotations", "translations"):
        new, old = (np.asarray(getattr(x, name)) for x in (whole, motion))
        np.testing.assert_array_equal(new[~missing], old[~missing])
    atol = 1e-9 if dtype == np.float64 else 1e-5
    for j in (0, 2):
        there = np.flatnonzero(~missing[:, j])
        line = Slerp(there, rotations(motion.rotations[there, j]))
        assert_same_rotation(whole.rotations[:, j], quaternions(line(np.arange(30))), atol)
        for axis in range(3):
            known = np.asarray(motion.translations)[there, j, axis]
            straight = np.interp(np.arange(30), there, known)
            np.testing.assert_allclose(whole.translations[:, j, axis], straight, atol=atol)
    # What was given is as it was.
    assert np.isnan(np.asarray(broken.rotations)[4, 2]).any()


def test_ends_stand():
    motion = swaying(1, 12)
    whole, missing = filled("f", gone(motion, (0, 3, 1), (10, 12, 1)))
    assert missing.sum() == 5
    q, wanted = (np.asarray(x.rotations)[:, 1] for x in (whole, motion))
    assert_same_rotation(q[:3], np.repeat(wanted[3:4], 3, axis=0), 1e-12)
    assert_same_rotation(q[10:], np.repeat(wanted[9:10], 2, axis=0), 1e-12)


def test_a_joint_that_is_never_there():
    """Is as the skeleton has it."""
    motion = swaying(2, 6)
    whole, missing = filled("f", gone(motion, (0, 6, 2)))
    assert missing[:, 2].all()
    np.testing.assert_array_equal(whole.rotations[:, 2], np.tile([1.0, 0, 0, 0], (6, 1)))
    offsets = np.tile(motion.skeleton.offsets[2], (6, 1))
    np.testing.assert_array_equal(whole.translations[:, 2], offsets)


def test_places_alone():
    """An entry of which only the place is missing keeps its turn."""
    motion = swaying(3, 10)
    whole, missing = filled("f", gone(motion, (3, 5, 0), turns=False))
    assert missing.sum() == 2
    np.testing.assert_array_equal(whole.rotations, motion.rotations)
    whole, missing = filled("f", gone(motion, (3, 5, 0), moves=False))
    assert missing.sum() == 2
    np.testing.assert_array_equal(whole.translations, motion.translations)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_few_frames(frames):
    motion = swaying(4, frames)
    whole, missing = filled("f", motion)
    assert whole is motion
    assert not missing.any()
    whole, missing = filled("f", gone(motion, (0, 1, 0)))
    assert missing.sum() == 1
    assert np.isfinite(whole.rotations).all()
    assert np.isfinite(whole.translations).all()
    if frames > 1:
        assert_same_rotation(whole.rotations[0, 0], motion.rotations[1, 0], 1e-12)


def test_bridges_go_the_short_way():
    q = np.array(swaying(5, 20).rotations)
    there = np.ones((20, 5), bool)
    there[5:9, 3] = False
    wanted = bridged(q, there)
    q[9:] *= -1
    assert_same_rotation(bridged(q, there), wanted, 1e-12)
    np.testing.assert_array_equal(bridged(q, there)[there], q[there])
    line = Slerp([4, 9], rotations(q[[4, 9], 3]))
    assert_same_rotation(wanted[4:10, 3], quaternions(line(np.arange(4, 10))), 1e-9)


def test_what_is_wrong_is_said():
    motion = swaying(6, 6)
    with pytest.raises(ValueError, match="f: motion is traced"):
        jax.jit(lambda m: filled("f", m)[0].rotations)(motion)
    with pytest.raises(ValueError, match="one clip at a time"):
        filled("f", jm.stack([motion, motion])[0])
