"""A real walk with an error put in, beside other walks."""

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cleaning import clean_levels, repair
from tests.cleaning.clips import turned
from tests.helpers import angle_between


@pytest.fixture(scope="module")
def clips(data_dir):
    paths = sorted(data_dir.glob("bandai/walk_*_001.bvh"))
    every = [jm.resample(jm.load(path), fps=24.0, method="slerp") for path in paths[:9]]
    return every[-1][40:140], [clip[40:110] for clip in every[:-1]]


def test_an_error_is_found_and_repaired(clips):
    walk, context = clips
    assert len(context) == 8
    arm = walk.skeleton.index("UpperArm_L")
    frames = np.arange(40, 58)
    broken = turned(walk, arm, frames, [0.9, 0, 0.5])
    # Of as many frames in all as the walk's search has: programs are shared.
    levels = [clean_levels(context[0], [*context[1:], walk])]
    result = repair(broken, context, levels=levels)
    mask = np.asarray(result.mask)
    assert mask[frames, arm].all()
    # And next to nothing else.
    assert mask.sum() < 2 * len(frames)
    after = angle_between(result.motion.rotations, walk.rotations)
    assert after[frames, arm].mean() < 0.1
    np.testing.assert_array_equal(
        np.asarray(result.motion.rotations)[~mask], np.asarray(broken.rotations)[~mask]
    )
    np.testing.assert_array_equal(result.motion.translations, broken.translations)
