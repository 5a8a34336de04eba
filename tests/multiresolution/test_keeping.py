"""Edits by level that keep the contacts of what they were made from."""

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.contacts import detect
from jaxmotion.multiresolution import blend, build_pyramid, level_of_detail, scale_details, stitch
from jaxmotion.spacetime import keep_contacts
from tests.helpers import assert_same_rotation
from tests.spacetime.test_keeping import skate

GAINS = np.array([1.6, 1.4, 1.0])


@pytest.fixture(scope="module")
def walk():
    return jm.samples.walk(60, fps=30.0).motion


def test_gains_levels_and_blends(walk):
    pyramid = build_pyramid(walk, 3)
    edit = scale_details(pyramid, GAINS)
    kept = scale_details(pyramid, GAINS, keep_contacts=True)
    assert skate(kept, detect(walk)) < 0.1 * skate(edit, detect(walk))
    want = keep_contacts(edit, walk)
    found = detect(pyramid.reconstruct())
    for got in (
        kept,
        scale_details(pyramid, GAINS, keep_contacts=found),
        blend(walk, edit, walk, 3, keep_contacts=True),
    ):
        assert_same_rotation(got.rotations, want.rotations, 1e-4)
        np.testing.assert_allclose(got.translations, want.translations, atol=1e-4)
    coarse = level_of_detail(pyramid, 1.0, keep_contacts=True)
    want = keep_contacts(level_of_detail(pyramid, 1.0), walk)
    assert_same_rotation(coarse.rotations, want.rotations, 1e-4)


def test_stitched_clips_keep_the_contacts_of_each(walk):
    """Where the second clip was moved to."""
    quarter, later = np.array([0.8, 0, 0.6, 0]), walk[7:]
    elsewhere = later.with_transforms(
        later.translations.at[:, 0].set(jm.quaternion.rotate(quarter, later.translations[:, 0])),
        later.rotations.at[:, 0].set(jm.quaternion.multiply(quarter, later.rotations[:, 0])),
    )
    clips = (walk[:40], elsewhere)
    joined = stitch(clips, 3)
    kept = stitch(clips, 3, keep_contacts=True)
    assert kept.num_frames == joined.num_frames == 92
    contacts = detect(joined)
    assert skate(kept, contacts) < 0.2 * skate(joined, contacts)
    # Feet stand nearly still in a stitched walk: little is to be restored.
    assert jm.quaternion.distance(joined.rotations, kept.rotations).max() < 0.2
