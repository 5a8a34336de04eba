"""What is usual in sound clips."""

import jax
import numpy as np
import pytest

from jaxmotion.cleaning import clean_levels
from jaxmotion.cleaning.missing import filled
from jaxmotion.cleaning.words import texture
from tests.cleaning.clips import pacing, turned
from tests.cleaning.oracles import (
    digression_by_hand,
    foretold_by_hand,
    pairs_of,
)
from tests.helpers import no_shape_checks
from tests.style.clips import swaying


@pytest.fixture(scope="module")
def clips():
    return turned(pacing(0, 80), 2, [40], [0.3, 0, 0]), [pacing(1, 70), pacing(2, 60)]


@pytest.fixture(scope="module")
def levels(clips):
    return clean_levels(*clips, k=3)


def test_the_most_of_each(clips, levels):
    motion, context = clips
    joints = tuple(range(5))
    textures = [np.asarray(texture(clip, joints)) for clip in (motion, *context)]
    residual, _ = digression_by_hand(motion, context, 3)
    foretold = foretold_by_hand(textures, 1, np.zeros((80, 5), bool))
    for found, x in ((levels.digression, residual), (levels.foretold, foretold)):
        np.testing.assert_allclose(found, np.linalg.norm(x, axis=-1).max(axis=0), atol=1e-7)
    pair = pairs_of(motion)
    np.testing.assert_allclose(levels.jump, pair.max(axis=0), atol=1e-7)
    # There and back, by 0.3 rad.
    np.testing.assert_allclose(levels.jump[2], 0.3, atol=0.05)
    assert np.argmax(levels.jump) == 2
    assert repr(levels) == "Levels(5 joints)"


def test_float32(clips, levels):
    motion, context = clips
    single = clean_levels(motion.astype(np.float32), [x.astype(np.float32) for x in context], k=3)
    for name in ("digression", "foretold", "jump"):
        assert getattr(single, name).dtype == np.float32
        np.testing.assert_allclose(getattr(single, name), getattr(levels, name), atol=1e-3)


def test_joints_that_tell_nothing():
    """Are usual at 0; their jumps count."""
    clips = [pacing(n, 60) for n in range(2)]
    clips = [
        x.with_transforms(
            rotations=np.where(np.arange(5)[:, None] == 3, clips[0].rotations[:1], x.rotations)
        )
        for x in clips
    ]
    found = clean_levels(clips[0], clips[1:], k=2)
    assert found.digression[3] == found.foretold[3] == 0
    assert (np.delete(np.asarray(found.foretold), 3) > 0).all()


def test_what_is_missing_does_not_count(clips, levels):
    motion, context = clips
    q = np.array(motion.rotations)
    q[38:44, 2] = np.nan
    found = clean_levels(motion.with_transforms(rotations=q), context, k=3)
    assert found.jump[2] < 0.1
    assert np.isfinite(found.digression).all()
    whole, missing = filled("f", motion.with_transforms(rotations=q))
    textures = [np.asarray(texture(clip, tuple(range(5)))) for clip in (whole, *context)]
    size = np.linalg.norm(foretold_by_hand(textures, 1, missing), axis=-1)
    np.testing.assert_allclose(found.foretold, size.max(axis=0), atol=1e-7)


@pytest.mark.parametrize("frames", [1, 2, 3, 14])
def test_few_frames(frames):
    found = clean_levels(swaying(0, frames))
    np.testing.assert_array_equal(found.digression, np.zeros(5))
    assert np.isfinite(found.foretold).all()


def test_what_is_wrong_is_said(clips):
    motion, _ = clips
    with pytest.raises(ValueError, match="other joints"):
        clean_levels(motion, swaying(0, names=("a", "b", "c", "d", "e")))
    with pytest.raises(ValueError, match="k=0"):
        clean_levels(motion, k=0)
    with pytest.raises(ValueError, match="traced"):
        jax.jit(lambda m: clean_levels(m).jump)(motion)
    with no_shape_checks(), pytest.raises(ValueError, match="Motion"):
        clean_levels("walk")
