"""Clips of many lengths: the numbers of their own length from few compiled programs."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion._posture import upright
from jaxmotion.style import apply_style, motion_style, style_distance, transfer_style
from jaxmotion.style.root import decode, encode
from jaxmotion.style.statistics import deviations
from tests.helpers import assert_trees_close, by_precision, compilations
from tests.style.clips import quaternions, rotations, swaying

transfer = functools.partial(transfer_style, keep_contacts=False)
apply = functools.partial(apply_style, keep_contacts=False)

OPTIONS = {
    "as it is": {},
    "per channel": {"warp": "per_channel", "deviation": "covariance", "max_ratio": 1.5},
    "in tempo": {"tempo": True, "strength": 0.7, "side": "left"},
    "no warp": {"warp": None, "mean": "karcher", "deviation": "covariance", "tempo": True},
    "no root": {"warp": None, "mean": "chordal", "root": False},
}


def assert_same(got, want, dtype):
    """To rounding; whole numbers, as those of the warp, exactly."""
    rough = dtype == np.float32
    assert_trees_close(got, want, 2e-4 if rough else 1e-12, 2e-4 if rough else 1e-12)


def single(*motions):
    return [motion.astype(np.float32) for motion in motions]


@pytest.mark.parametrize(
    ("options", "dtype"),
    by_precision(OPTIONS, single=("per channel",), rare=("as it is",)),  # sizes vary below as it is
)
def test_the_transfer_is_that_of_the_clips_own_lengths(options, dtype):
    """Under ``jit`` nothing is padded."""
    source, reference = swaying(0, 41), swaying(1, 57)
    if dtype == np.float32:
        source, reference = single(source, reference)
    want = eqx.filter_jit(functools.partial(transfer, **OPTIONS[options]))(source, reference)
    got = transfer(source, reference, **OPTIONS[options])
    assert got.motion.dtype == dtype
    if got.warp is not None:
        np.testing.assert_array_equal(got.warp.runs, want.warp.runs)
        assert got.warp.num_refined == want.warp.num_refined == 2 * 57
    assert_same(got, want, dtype)


_RARE = [pytest.param(sizes, marks=pytest.mark.sweep) for sizes in ((1, 1), (40, 1), (128, 60))]


@pytest.mark.parametrize("sizes", [(1, 40), (30, 100), *_RARE])
def test_of_one_frame_of_a_whole_size_and_of_every_other_frame(sizes):
    """30 frames are warped with every second one of 100."""
    source, reference = swaying(2, sizes[0]), swaying(3, sizes[1])
    want = eqx.filter_jit(transfer)(source, reference)
    got = transfer(source, reference)
    np.testing.assert_array_equal(got.warp.runs, want.warp.runs)
    np.testing.assert_array_equal(got.warp.source_index, want.warp.source_index)
    assert_same(got, want, np.float64)


@pytest.mark.parametrize(
    "dtype", [pytest.param(np.float32, marks=pytest.mark.sweep), np.float64], ids=str
)
def test_a_kept_style_and_how_far_it_is(dtype):
    motion, other = swaying(4, 37), swaying(5, 71)
    if dtype == np.float32:
        motion, other = single(motion, other)
    weights = np.linspace(0, 1, 37).astype(dtype)

    def measured(motion, other):
        style, own = motion_style(other), motion_style(motion, weights)
        several = motion_style([motion, other, motion[:1]], np.array([1, 2, 0.5], dtype))
        far = style_distance(motion, style), style_distance(motion, style, weights=weights)
        return style, own, several, far, apply(motion, style, tempo=True)

    assert_same(measured(motion, other), eqx.filter_jit(measured)(motion, other), dtype)


def test_many_lengths_share_programs():
    """Of clips and references of up to 128 frames."""
    clips = [swaying(k, frames) for k, frames in enumerate((41, 57, 64, 100, 127))]

    def all_of_it(source, reference):
        style = motion_style(reference)
        apply(source, style)
        style_distance(source, style, weights=np.ones(len(source)))
        motion_style(source, np.ones(len(source)))
        motion_style([source, reference], [2.0, 1.0])
        return transfer(source, reference).motion

    all_of_it(*clips[:2])
    with compilations() as compiled:
        lengths = [len(all_of_it(a, b)) for a, b in ((clips[2], clips[3]), (clips[4], clips[2]))]
    assert not compiled
    assert lengths == [64, 127]


def test_frames_that_do_not_count_change_nothing():
    """Of the body: its axis, the ground, the channels there and back. Beyond it hangs, far off."""
    motion, wild = swaying(6, 45), swaying(7, 100)
    p = np.concatenate([motion.translations, 50 * np.asarray(wild.translations) - 300])
    q = np.concatenate([motion.rotations, wild.rotations])
    q[45:, 0] = quaternions(Rotation.from_rotvec([np.pi, 0, 0]) * rotations(q[45:, 0]))
    longer = motion.with_transforms(p, q)
    count = jnp.asarray(45, jnp.int32)
    stands = upright(motion)
    np.testing.assert_array_equal(upright(longer, count), stands)
    (rows, start), (want, wanted) = encode(longer, stands, count), encode(motion, stands)
    np.testing.assert_allclose(rows[:45], want, atol=1e-12)
    assert_trees_close(start, wanted, 1e-12, 1e-12)
    low = want.at[:, 3].add(-0.5)
    got = decode(rows.at[:, 3].add(-0.5), start, stands, longer, count)
    again = decode(low, wanted, stands, motion)
    np.testing.assert_allclose(got.translations[:45], again.translations, atol=1e-12)


@pytest.mark.parametrize("frames", [2, 11, 12, 30, 41])
def test_the_ground_is_a_tenth_of_the_way_up(frames):
    motion = swaying(8, frames)
    lowest = jm.forward_kinematics(motion).positions[..., 1].min(axis=1)
    found = motion_style(motion).root_mean[3]
    wanted = np.mean(motion.translations[:, 0, 1]) - np.quantile(lowest, 0.1)
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_turns_past_half_a_circle_keep_their_side():
    """Repeats of a last frame that is far from the mean are more than all the frames."""
    half = np.radians(np.linspace(0, 200, 12))
    q = np.stack([np.cos(half), np.sin(half), 0 * half, 0 * half], axis=-1)[:, None]
    q = np.concatenate([np.repeat(q[:1], 6, axis=0), q])
    mean = jnp.array([[1.0, 0, 0, 0]])
    repeated = jnp.asarray(np.concatenate([q, np.repeat(q[-1:], 100, axis=0)]))
    want = deviations(mean, jnp.asarray(q))
    got = deviations(mean, repeated, jnp.asarray(18, jnp.int32))
    np.testing.assert_allclose(got[:18], want, atol=1e-12)
    assert float(jnp.abs(deviations(mean, repeated)[:18] - want).max()) > 1
