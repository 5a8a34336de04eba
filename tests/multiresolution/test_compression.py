"""Compression: the stated error holds, and is the measured one."""

import jax
import numpy as np
import pytest

from jaxmotion import quaternion
from jaxmotion.multiresolution import compress
from tests.helpers import assert_same_rotation
from tests.multiresolution.oracles import swaying


@pytest.fixture(scope="module")
def clip():
    return swaying(33, moving=True)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-5])
def test_the_error_is_within_the_tolerances(clip, tolerance):
    packed = compress(clip, rotation_tolerance=tolerance, translation_tolerance=3 * tolerance)
    back = packed.decompress()
    turn = float(np.max(quaternion.distance(back.rotations, clip.rotations)))
    shift = float(np.max(np.linalg.norm(back.translations - clip.translations, axis=-1)))
    assert 0.05 * tolerance < turn <= tolerance
    assert 0.15 * tolerance < shift <= 3 * tolerance
    assert packed.rotation_error == pytest.approx(turn, rel=1e-6)
    assert packed.translation_error == pytest.approx(shift, rel=1e-6)
    raw = clip.num_frames * clip.num_joints * 7 * 8
    assert packed.ratio == pytest.approx(raw / packed.num_bytes)
    assert packed.ratio > (2 if tolerance == 1e-2 else 1.2)


def test_steady_motion_is_all_zeros():
    clip = swaying(33)
    turn = np.arange(33)[:, None, None] * np.array([0.02, 0, 0.01])
    steady = clip.with_transforms(
        0 * np.asarray(clip.translations), quaternion.exp(np.broadcast_to(turn, (33, 3, 3)))
    )
    packed = compress(steady, rotation_tolerance=1e-3, translation_tolerance=1e-3)
    assert not any(np.any(codes) for pair in packed.codes for codes in pair)
    assert_same_rotation(packed.decompress().rotations, steady.rotations, 1e-12)


def test_float32(clip):
    single = jax.tree.map(lambda x: x.astype(np.float32), clip)
    packed = compress(single, rotation_tolerance=1e-3, translation_tolerance=1e-3)
    back = packed.decompress()
    assert back.rotations.dtype == back.translations.dtype == np.float32
    assert packed.rotation_error <= 1e-3
    assert packed.translation_error <= 1e-3


def test_wrong_arguments(clip):
    with pytest.raises(ValueError, match="rotation_tolerance=0"):
        compress(clip, rotation_tolerance=0, translation_tolerance=1)
    with pytest.raises(ValueError, match="do not fit 32 bits"):
        compress(clip, rotation_tolerance=1e-14, translation_tolerance=1e-14)
