"""Pyramids: the oracle's details, exact reconstruction, invariance, padding, derivatives."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import quaternion
from jaxmotion.multiresolution import build_pyramid, scale_details
from tests.helpers import (
    assert_same_rotation,
    check_gradients,
    no_shape_checks,
    random_quaternions,
)
from tests.multiresolution import oracles
from tests.multiresolution.oracles import swaying

ROOM = 20
UNEVEN = np.cumsum(np.random.default_rng(5).uniform(0.5, 1.5, ROOM))


@pytest.fixture(scope="module")
def clip():
    return swaying(ROOM, moving=True)


def assert_same_motion(got, want, atol=1e-12):
    assert_same_rotation(got.rotations, want.rotations, atol)
    np.testing.assert_allclose(got.translations, want.translations, atol=atol)


@pytest.mark.parametrize("frames", [17, 157])
def test_details_are_the_oracles(frames):
    """In a loop, and each level for its own size."""
    clip = swaying(frames, moving=True)
    pyramid = build_pyramid(clip, 2)
    assert pyramid.frames == (frames // 4 + 1, frames // 2 + 1, frames)
    np.testing.assert_allclose(pyramid.base.frame_time, 4 / 30)
    for j in range(3):
        fine = np.asarray(clip.rotations)[:, j], np.asarray(clip.translations)[:, j]
        for details in pyramid.details[::-1]:
            coarse = oracles.reduced(*fine)
            u, v = oracles.minus(*fine, *oracles.expanded(*coarse))
            np.testing.assert_allclose(details.translations[:, j], u, atol=1e-13)
            np.testing.assert_allclose(details.rotations[:, j], v, atol=1e-13)
            fine = coarse
        assert_same_rotation(pyramid.base.rotations[:, j], fine[0])
    assert_same_motion(pyramid.reconstruct(), clip)


@pytest.mark.parametrize(("lazy", "times"), [(False, None), (True, UNEVEN)])
def test_every_length_comes_back(clip, lazy, times):
    """In one program: what is padding does not matter."""

    @jax.jit
    def there_and_back(rotations, length):
        motion = clip.with_transforms(clip.translations, rotations)
        pyramid = build_pyramid(motion, 4, lazy=lazy, times=times, length=length)
        return pyramid.reconstruct(), pyramid.details[-1].rotations

    junk = random_quaternions(np.random.default_rng(6), clip.rotations.shape[:2])
    for length in range(1, ROOM + 1):
        padded = np.where(np.arange(ROOM)[:, None, None] < length, clip.rotations, junk)
        got, details = there_and_back(padded, length)
        assert_same_motion(got[:length], clip[:length])
        assert np.all(np.isfinite(details))
    whole = build_pyramid(clip, 4, lazy=lazy, times=times)
    assert_same_motion(whole.reconstruct(), clip)
    np.testing.assert_allclose(whole.details[-1].rotations, details, atol=1e-13)
    if lazy:
        kept = sum(len(d.rotations) for d in whole.details) + whole.base.num_frames
        assert kept <= ROOM + 4
        assert_same_rotation(whole.base.rotations[0], clip.rotations[0], 1e-15)


@pytest.mark.parametrize("frames", [1, 2, 3, 11])
def test_lengths_without_padding(clip, frames):
    short = clip[:frames]
    pyramid = build_pyramid(short)
    assert_same_motion(pyramid.reconstruct(), short)
    assert pyramid.levels == (2 if frames == 11 else 0)


def test_details_do_not_depend_on_the_coordinates(clip):
    turn = random_quaternions(np.random.default_rng(7))
    shift = np.array([1.0, -2, 3])
    moved = clip.with_transforms(
        quaternion.rotate(turn, clip.translations) + shift,
        quaternion.multiply(turn, clip.rotations),
    )
    a, b = build_pyramid(clip, 4), build_pyramid(moved, 4)
    for x, y in zip(a.details, b.details, strict=True):
        np.testing.assert_allclose(x.rotations, y.rotations, atol=1e-13)
        np.testing.assert_allclose(x.translations, y.translations, atol=1e-12)
    assert_same_rotation(quaternion.multiply(turn, a.base.rotations), b.base.rotations)


def test_float32_and_clips_side_by_side(clip):
    single = jax.tree.map(lambda x: x.astype(np.float32), clip)
    got = build_pyramid(single, 4).reconstruct()
    assert got.rotations.dtype == got.translations.dtype == np.float32
    assert_same_motion(got, clip, 1e-5)
    pair = jax.tree.map(lambda x: jnp.stack([jnp.asarray(x)] * 2), clip)
    pair = pair.with_transforms(pair.translations, pair.rotations.at[1].set(clip.rotations[::-1]))
    pyramids = jax.jit(jax.vmap(lambda m: build_pyramid(m, 4)))(pair)
    alone = build_pyramid(clip.with_transforms(clip.translations, clip.rotations[::-1]), 4)
    for x, y in zip(pyramids.details, alone.details, strict=True):
        np.testing.assert_allclose(x.rotations[1], y.rotations, atol=1e-13)
    back = jax.jit(jax.vmap(lambda p: p.reconstruct()))(pyramids)
    assert_same_rotation(back.rotations, pair.rotations)


def test_derivatives():
    """One program for values and gradients; finite differences of the one make the other."""
    small = swaying(6, joints=2)
    weights = np.random.default_rng(8).standard_normal(small.rotations.shape)

    @jax.jit
    @partial(jax.value_and_grad, argnums=(0, 1))
    def both(rotations, gains):
        pyramid = build_pyramid(small.with_transforms(small.translations, rotations), 2)
        return jnp.sum(weights * scale_details(pyramid, gains).rotations)

    q, gains = np.asarray(small.rotations), np.array([1.3, 0.4])
    _, (by_q, by_gains) = both(q, gains)
    step = 1e-6 * np.random.default_rng(9).standard_normal(q.shape)
    slope = (both(q + step, gains)[0] - both(q - step, gains)[0]) / 2
    np.testing.assert_allclose(np.vdot(by_q, step), slope, rtol=1e-6)
    for n in range(2):
        step = 1e-5 * np.eye(2)[n]
        slope = (both(q, gains + step)[0] - both(q, gains - step)[0]) / 2e-5
        np.testing.assert_allclose(by_gains[n], slope, rtol=1e-6)
    still = np.broadcast_to([1.0, 0, 0, 0], q.shape)
    value, slopes = both(still, np.ones(2))
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves((value, slopes)))


@pytest.mark.parametrize(
    ("frames", "levels"), [pytest.param(152, 1, marks=pytest.mark.sweep), (9, 2)]
)
def test_derivatives_by_poses_and_times(frames, levels):
    """Both ways that a level is computed: for its own size, and in a loop."""
    clip = swaying(frames, joints=1)
    rng = np.random.default_rng(11)
    times = jnp.asarray(np.cumsum(rng.uniform(0.5, 1.5, frames)))
    weights = rng.standard_normal(clip.rotations.shape)

    def edit(rotations, times):
        moved = clip.with_transforms(clip.translations, rotations)
        pyramid = build_pyramid(moved, levels, times=times)
        return jnp.sum(weights * scale_details(pyramid, 1.7).rotations)

    check_gradients(edit, clip.rotations, times, eps=1e-6)


@pytest.mark.parametrize("uneven", [pytest.param(False, marks=pytest.mark.sweep), True])
def test_long_clips_with_frames_to_spare(uneven):
    long, count = swaying(330, joints=2), 301
    times = jnp.asarray(np.cumsum(np.random.default_rng(12).uniform(0.5, 1.5, 330)))
    times, some = (times, times[:count]) if uneven else (None, None)
    want = build_pyramid(long[:count], 3, times=some)
    got = build_pyramid(long, 3, times=times, length=count)
    for a, b in zip(got.details, want.details, strict=True):
        shorter = a.rotations[: len(b.rotations)]
        np.testing.assert_allclose(shorter, b.rotations, atol=1e-12)


def test_a_gradient_keeps_little():
    """What a gradient needs besides its input and output, in clips: what it computes twice it need
    not keep."""
    clip = swaying(600, joints=8)

    def loss(rotations, gain):
        pyramid = build_pyramid(clip.with_transforms(clip.translations, rotations), 1)
        return jnp.sum(scale_details(pyramid, gain).rotations ** 2)

    program = jax.jit(jax.grad(loss, (0, 1))).lower(clip.rotations, 1.1).compile()
    assert program.memory_analysis().temp_size_in_bytes < 7 * np.asarray(clip.rotations).nbytes


def test_programs_do_not_grow_with_the_levels():
    clip = swaying(1025, joints=1)

    def size(levels):
        text = jax.jit(lambda m: build_pyramid(m, levels).reconstruct()).lower(clip).as_text()
        return len(text.splitlines())

    assert size(9) < 1.3 * size(6)


def test_wrong_arguments(clip):
    with pytest.raises(ValueError, match="levels=9; 20 frames can be halved 0 to 5 times"):
        build_pyramid(clip, 9)
    with no_shape_checks(), pytest.raises(ValueError, match=r"times has shape \(3,\)"):
        build_pyramid(clip, times=np.arange(3.0))
    with pytest.raises(ValueError, match="times must increase"):
        build_pyramid(clip, times=np.zeros(ROOM))
    batch = jax.tree.map(lambda x: np.stack([x, x]), clip)
    with (
        no_shape_checks(),
        pytest.raises(ValueError, match=r"build_pyramid: one clip at a time, got .*vmap"),
    ):
        build_pyramid(batch)
