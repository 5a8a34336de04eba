"""Frames that repeat the one before were dropped by the capture: they count for nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.smoothing.repeats import without_repeats
from tests.helpers import random_motion

FRAMES, JOINTS = 24, 2


@pytest.fixture(scope="module")
def clip():
    return random_motion(np.random.default_rng(0), FRAMES, JOINTS)


def repeating(clip, frames):
    """The clip, where these frames repeat the one before."""
    kept = np.arange(FRAMES)
    kept[list(frames)] = 0
    kept = np.maximum.accumulate(kept)
    return clip.with_transforms(clip.translations[kept], clip.rotations[kept])


@pytest.mark.parametrize(
    ("repeats", "dropped"),
    [
        ([], []),
        ([5], [5]),
        ([5, 9, 10, 14, 15, 16], [5, 9, 10, 14, 15, 16]),
        ([5, 6, 7, 8], []),  # at rest
        ([1, 2], []),  # at rest, and then moves
        ([2], [2]),
        ([22, 23], []),  # comes to rest
        ([22], [22]),
    ],
)
def test_which_frames_were_dropped(clip, repeats, dropped):
    expected = np.ones(FRAMES)
    expected[dropped] = 0
    np.testing.assert_array_equal(without_repeats(repeating(clip, repeats), None), expected)


def test_all_joints_repeat_and_are_translated_alike(clip):
    there = repeating(clip, [5])
    turned = there.with_transforms(rotations=clip.rotations)
    shifted = there.with_transforms(translations=clip.translations)
    for motion in (turned, shifted):
        assert (without_repeats(motion, None) == 1).all()


def test_weights_of_joints_and_frames_that_do_not_count(clip):
    motion = repeating(clip, [5, 21, 22])
    weights = jnp.asarray(np.random.default_rng(1).uniform(0.5, 1, (FRAMES, JOINTS)))
    expected = np.array(weights)
    expected[[5, 21, 22]] = 0
    np.testing.assert_array_equal(without_repeats(motion, weights), expected)
    # Repeats at the end of what counts are rest, whatever comes after.
    weights = jnp.where(np.arange(FRAMES)[:, None] < 23, weights, 0)
    expected = np.array(weights)
    expected[5] = 0
    np.testing.assert_array_equal(without_repeats(motion, weights), expected)


def test_short_clips_and_vmap(clip):
    assert without_repeats(clip[:2], None) is None
    clips = [repeating(clip, frames) for frames in ([5], [7, 8])]
    batch, _ = jm.stack(clips)
    mapped = jax.jit(jax.vmap(lambda motion: without_repeats(motion, None)))(batch)
    for got, motion in zip(mapped, clips, strict=True):
        np.testing.assert_array_equal(got, without_repeats(motion, None))


def test_denoise_makes_dropped_frames_anew():
    clean = jm.samples.load("walk").motion[20:60].astype(np.float64)
    kept = np.maximum.accumulate(np.where(np.isin(np.arange(40), [7, 15, 16, 29]), 0, range(40)))
    dropped = clean.with_transforms(clean.translations[kept], clean.rotations[kept])
    found = jm.denoise(dropped)
    off = [
        np.asarray(jm.quaternion.distance(m.rotations, clean.rotations)) for m in (found, dropped)
    ]
    assert off[0].max() < 0.3 * off[1].max()
    assert off[0].mean() < 0.2 * off[1].mean()
    root = [np.abs(m.translations - clean.translations).max() for m in (found, dropped)]
    assert root[0] < 0.2 * root[1]
