"""Orientation filters against a frame-by-frame oracle, and their invariances."""

import jax
import numpy as np
import pytest

from jaxmotion import quaternion
from jaxmotion.multiresolution import (
    binomial_mask,
    filter_motion,
    orientation_filter,
    smoothing_mask,
    vector_filter,
)
from tests.helpers import (
    assert_jit_and_vmap_agree,
    assert_same_rotation,
    check_gradients,
    no_shape_checks,
    random_quaternions,
)
from tests.multiresolution.oracles import filtered, swaying

FRAMES = 11


def lopsided(rows=()):
    a = np.random.default_rng(3).uniform(-0.3, 0.6, (*rows, 5))
    a[..., 2] += 1 - a.sum(-1)
    return a


@pytest.fixture(scope="module")
def clip():
    return swaying(FRAMES)


@pytest.mark.parametrize("rows", [(), (FRAMES,)], ids=["one mask", "a mask a frame"])
def test_oracle(clip, rows):
    mask = lopsided(rows)
    got = filter_motion(clip, mask)
    masks = np.broadcast_to(mask, (FRAMES, 5))
    for j in range(3):
        want, shift = filtered(
            np.asarray(clip.rotations)[:, j], np.asarray(clip.translations)[:, j], masks
        )
        assert_same_rotation(got.rotations[:, j], want.as_quat(scalar_first=True))
        np.testing.assert_allclose(got.translations[:, j], shift, atol=1e-13)
    np.testing.assert_array_equal(got.translations[:, 1:], clip.translations[:, 1:])


@pytest.mark.parametrize("frames", [1, 2, 3, 4])
def test_short_clips(frames):
    clip, mask = swaying(frames), smoothing_mask()
    got = orientation_filter(clip.rotations, mask)
    for j in range(3):
        q = np.asarray(clip.rotations)[:, j]
        if frames > 1:
            want, _ = filtered(q, np.zeros((frames, 3)), np.tile(mask, (frames, 1)))
            q = want.as_quat(scalar_first=True)
        assert_same_rotation(got[:, j], q)


def test_invariances(clip):
    rng = np.random.default_rng(4)
    a, b = random_quaternions(rng), random_quaternions(rng)
    q, mask = np.asarray(clip.rotations), smoothing_mask(2, 1.3)
    out = orientation_filter(q, mask)

    def both_sides(x):
        return quaternion.multiply(quaternion.multiply(a, x), b)

    assert_same_rotation(orientation_filter(both_sides(q), mask), both_sides(out))
    assert_same_rotation(orientation_filter(q[::-1], mask), out[::-1])
    later = orientation_filter(np.concatenate([q[:1], q]), mask)
    assert_same_rotation(later[4:], out[3:])
    flipped = q * np.where(rng.random((FRAMES, 3, 1)) < 0.5, -1, 1)
    assert_same_rotation(orientation_filter(flipped, mask), out)
    assert np.all(np.sum(out[1:] * out[:-1], -1) > 0)


def test_steady_turns_and_one_axis():
    """A steady turn passes unchanged to the very end; about one axis, angles are filtered."""
    axis, mask = np.array([0.6, 0.0, 0.8]), binomial_mask(2)
    steady = quaternion.exp(0.3 * np.arange(FRAMES)[:, None] * axis)
    assert_same_rotation(orientation_filter(steady, mask), steady)
    angle = np.sin(np.arange(FRAMES) / 2.0)
    out = orientation_filter(quaternion.exp(angle[:, None] * axis), mask)
    want = vector_filter(angle, mask)
    np.testing.assert_allclose(want[2:-2], np.convolve(angle, mask, "valid"), atol=1e-15)
    assert_same_rotation(out, quaternion.exp(want[:, None] * axis))


def test_float32_and_inputs_untouched(clip):
    single = jax.tree.map(lambda x: x.astype(np.float32), clip)
    before = np.array(single.rotations)
    got = filter_motion(single, smoothing_mask())
    assert got.rotations.dtype == got.translations.dtype == np.float32
    assert_same_rotation(got.rotations, filter_motion(clip, smoothing_mask()).rotations, 2e-6)
    np.testing.assert_array_equal(single.rotations, before)


def test_transforms_and_derivatives():
    q, mask = swaying(6, joints=2).rotations, lopsided()

    def f(q, mask):
        return orientation_filter(quaternion.normalize(q), mask)

    assert_jit_and_vmap_agree(lambda q: f(q, mask), q, rtol=1e-12)
    check_gradients(f, q, mask)


def test_wrong_masks(clip):
    for mask, message in (
        (np.ones(4) / 4, r"mask has shape \(4,\)"),
        (np.ones((3, 5)) / 5, r"\(3, 5\)"),
        (np.ones(3), "mask must sum to 1, so that poses stay, got 3"),
    ):
        with no_shape_checks(), pytest.raises(ValueError, match=message):
            filter_motion(clip, mask)
    batch = jax.tree.map(lambda x: np.stack([x, x]), clip)
    with (
        no_shape_checks(),
        pytest.raises(ValueError, match=r"filter_motion: one clip at a time, got .*vmap"),
    ):
        filter_motion(batch, smoothing_mask())


def test_errors_name_the_filter_that_was_called(clip):
    calls = {
        "orientation_filter": lambda mask: orientation_filter(clip.rotations, mask),
        "vector_filter": lambda mask: vector_filter(clip.translations, mask),
        "filter_motion": lambda mask: filter_motion(clip, mask),
    }
    for name, call in calls.items():
        with no_shape_checks(), pytest.raises(ValueError, match=rf"{name}: mask has shape \(4,\)"):
            call(np.ones(4) / 4)
        with pytest.raises(ValueError, match=f"{name}: the mask must sum to 1"):
            call(np.ones(3))
