"""Time warps: identity, duration, where frames go, given times, easing, derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import jaxmotion as jm
from jaxmotion import time_warp
from jaxmotion.layers.time_warp import _slowed, _source_times
from tests.helpers import (
    angle_between,
    assert_same_rotation,
    check_gradients,
    no_shape_checks,
    quaternions_by,
    random_motion,
    scipy_rotation,
)


def turning(angles, fps=30.0, dtype=np.float64):
    """One joint at rest and one turning about y by these angles (radians)."""
    skeleton = jm.Skeleton(["root", "arm"], [-1, 0], np.array([[0.0, 0, 0], [1, 0, 0]], dtype))
    turns = np.stack([np.zeros_like(angles), angles], axis=1)[..., None] * np.array([0.0, 1, 0])
    rotations = quaternions_by(turns, dtype)
    return jm.Motion.from_root(skeleton, np.zeros((len(angles), 3), dtype), rotations, 1 / fps)


def angles_of(motion):
    return np.unwrap(scipy_rotation(motion.rotations[:, 1]).as_rotvec()[:, 1])


def kick(frames=61, **options):
    """Still, a quick turn by 2 rad in the middle, still."""
    t = np.linspace(-1, 1, frames)
    return turning(1 + np.tanh(8 * t), **options)


def test_nothing_asked_changes_nothing(dtype):
    motion = random_motion(np.random.default_rng(0), 11, 4, dtype)
    atol = 1e-14 if dtype == np.float64 else 1e-6
    for same in (
        time_warp(motion),
        time_warp(motion, amount=0.0),
        time_warp(motion, num_frames=11),
    ):
        assert (same.dtype, same.num_frames) == (dtype, 11)
        assert_same_rotation(same.rotations, motion.rotations, max(atol, 1e-6))
        np.testing.assert_allclose(same.translations, motion.translations, atol=atol * 10)
        assert same.frame_time == motion.frame_time


@pytest.mark.parametrize(("before", "after"), [(230, 286), (211, 261), (79, 139)])
def test_the_kick_slows_down_where_it_is_quick(before, after):
    """Fig. 9, with the lengths of Table 1."""
    motion = kick(before)
    slow = time_warp(motion, amount=(after - 1) / (before - 1) - 1)
    assert slow.num_frames == after
    assert_same_rotation(slow.rotations[:: after - 1], motion.rotations[:: before - 1], 1e-9)
    angles, turned = angles_of(motion), angles_of(slow)
    assert np.all(np.diff(turned) > -1e-9)
    assert np.diff(turned).max() < 0.8 * np.diff(angles).max()

    def frames_between(x):
        return np.sum((x > 0.2) & (x < 1.8))

    quick, rest = frames_between(turned), np.sum(turned < 0.01)
    assert quick > 1.5 * frames_between(angles)
    assert rest < 1.1 * np.sum(angles < 0.01) + 1


def test_frames_are_handed_out_by_speed():
    """The rule written out, on the same curve by SciPy."""
    motion = kick(40)
    turned = angle_between(motion.rotations[:-1], motion.rotations[1:]).sum(axis=1)
    i = np.arange(39)
    kernel = np.exp(-np.abs(i[:, None] - i) / (0.1 * 30))
    speed = kernel @ turned / kernel.sum(axis=1)
    lands = np.concatenate([[0], np.cumsum(1 + 0.5 * speed / speed.mean())])
    slow = time_warp(motion, amount=0.5)
    assert slow.num_frames == 59
    source = CubicSpline(lands, np.arange(40))(np.arange(59))
    angles = CubicSpline(np.arange(40), angles_of(motion), bc_type="natural")(source)
    np.testing.assert_allclose(angles_of(slow), angles, atol=2e-3)


def test_duration_is_kept_on_request():
    motion = kick()
    slow = time_warp(motion, amount=1.0, num_frames=len(motion))
    assert slow.num_frames == len(motion)
    assert_same_rotation(slow.rotations[::60], motion.rotations[::60], 1e-9)
    speed = np.abs(np.diff(angles_of(slow)))
    assert speed.max() < 0.75 * np.abs(np.diff(angles_of(motion))).max()


def test_the_unit_of_length_does_not_matter():
    rng = np.random.default_rng(1)
    small = random_motion(rng, 14, 4)
    skeleton = jm.Skeleton(
        small.skeleton.names, small.skeleton.parents, 100 * small.skeleton.offsets
    )
    large = jm.Motion(skeleton, 100 * small.translations, small.rotations, small.frame_time)
    a, b = (time_warp(m, amount=0.7) for m in (small, large))
    assert_same_rotation(a.rotations, b.rotations, 1e-9)
    np.testing.assert_allclose(100 * a.translations, b.translations, atol=1e-9)


def test_given_times():
    """What happened at 0.5 s and 1 s happens at 1.2 s and 1.5 s, and nothing turns back."""
    motion = turning(np.linspace(0, 3, 61))
    pairs = [(0.5, 1.2), (1.0, 1.5)]
    warped = time_warp(motion, pairs=pairs)
    angles = angles_of(warped)
    assert warped.num_frames == 76  # 2 s, and half a second more
    np.testing.assert_allclose(angles[[36, 45, 75]], [0.75, 1.5, 3.0], atol=1e-9)
    assert np.all(np.diff(angles) > 0)
    np.testing.assert_allclose(np.diff(angles[46:75]), 3 / 60, atol=0.4 * 3 / 60)
    same = time_warp(motion, pairs=[(0, 0), *pairs])
    assert_same_rotation(same.rotations, warped.rotations)
    pinned = time_warp(motion, pairs=[(1.0, 0.5), (2.0, 2.0)])
    np.testing.assert_allclose(angles_of(pinned)[[0, 15, 60]], [0, 1.5, 3], atol=1e-9)
    assert pinned.num_frames == 61
    stretched = time_warp(motion, pairs=pairs, num_frames=151)
    np.testing.assert_allclose(angles_of(stretched)[[72, 90]], [0.75, 1.5], atol=1e-9)


def test_ease_in_and_out():
    motion = turning(np.linspace(0, 3, 61))
    soft = time_warp(motion, ease=(0.4, 0.6))
    assert soft.num_frames == 76  # half of the second that is eased
    angles = angles_of(soft)
    np.testing.assert_allclose(angles[[0, -1]], [0, 3], atol=1e-9)
    speed = np.diff(angles) * 60 / 3
    assert speed[0] < 0.01
    assert speed[-1] < 0.01
    np.testing.assert_allclose(speed[12:56], 1, atol=1e-9)
    assert np.all(speed > 0)
    kept = time_warp(motion, ease=(0.4, 0.6), num_frames=61)
    np.testing.assert_allclose(angles_of(kept)[[0, -1]], [0, 3], atol=1e-9)


def test_layers_run_on_the_retimed_signal():
    motion = kick()
    slow = time_warp(motion, amount=0.3)
    both = time_warp(motion, amount=0.3, alpha=1.5, residual=0.0)
    want = jm.stylize(slow, 1.5)
    assert_same_rotation(both.rotations, want.rotations, 1e-12)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_shortest_clips(frames):
    motion = random_motion(np.random.default_rng(frames), frames, 3)
    for options in ({"amount": 1.0}, {"num_frames": 5}, {"amount": 0.5, "num_frames": frames}):
        warped = time_warp(motion, **options)
        assert np.all(np.isfinite(warped.rotations))
        assert_same_rotation(warped.rotations[0], motion.rotations[0], 1e-9)
    assert time_warp(motion, amount=1.0).num_frames == 2 * frames - 1


def test_stillness_is_slowed_evenly_and_has_finite_derivatives():
    still = turning(np.zeros(6))
    assert time_warp(still, amount=0.5).num_frames == 8

    def total(rotations, amount):
        warped = time_warp(still.with_transforms(rotations=rotations), amount=amount, num_frames=8)
        return jnp.sum(warped.rotations)

    slopes = jax.grad(total, (0, 1))(jnp.asarray(still.rotations), 0.5)
    assert all(np.all(np.isfinite(s)) for s in slopes)


@pytest.mark.slow
def test_derivatives():
    motion = turning(np.array([0.0, 0.1, 0.5, 1.3, 1.7, 1.8]))
    pairs = jnp.array([[0.05, 0.06], [0.1, 0.13]])

    def automatic(rotations, amount, ease):
        given = motion.with_transforms(rotations=rotations)
        warped = time_warp(given, amount=amount, ease=(ease, 2 * ease), num_frames=9)
        return warped.rotations[1:-1]

    # The speed of a map has kinks, so that differences are only good to their step.
    near = {"rtol": 1e-5, "atol": 2e-5, "eps": 1e-6}
    check_gradients(automatic, motion.rotations, jnp.asarray(0.6), jnp.asarray(0.03), **near)
    check_gradients(
        lambda p: time_warp(motion, pairs=p, num_frames=9).rotations[1:-1], pairs, **near
    )


def test_compiled_and_mapped():
    motion = kick(12)
    slow = time_warp(motion, amount=0.5, num_frames=17)
    run = jax.jit(jax.vmap(lambda a: time_warp(motion, amount=a, num_frames=17)))
    mapped = run(jnp.array([0.5, 0.1]))
    assert_same_rotation(mapped.rotations[0], slow.rotations, 1e-9)
    with pytest.raises(Exception, match="amount must be 0 or more"):
        jax.block_until_ready(run(jnp.array([0.5, -0.1])))


def test_one_compilation_serves_a_bucket_of_lengths():
    counts = []
    for frames in (33, 40, 48):
        got = time_warp(kick(frames), amount=0.0, num_frames=frames)
        assert_same_rotation(got.rotations, kick(frames).rotations, 1e-9)
        counts.append((_slowed._cache_size(), _source_times._cached._cache_size()))
    assert counts[0] == counts[1] == counts[2]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"amount": -0.1}, "amount must be 0 or more, got -0.1"),
        ({"amount": 0.1, "pairs": [(1, 1)]}, "expected one of them"),
        ({"pairs": [1.0, 2.0]}, r"pairs have shape \(2,\); expected \(K, 2\)"),
        ({"pairs": [(0.5, 0.6), (0.4, 0.7)]}, "must increase in both columns"),
        ({"pairs": [(0.5, 0.6), (0.6, 0.6)]}, "must increase in both columns"),
        ({"pairs": [(0.0, 0.6)]}, "must increase"),
        ({"pairs": [(2.5, 2.6)]}, "the end of the clip, 2 s"),
        ({"ease": (0.1,)}, "seconds at the start and at the end"),
        ({"ease": (-0.1, 0)}, "0 or more seconds"),
        ({"ease": (3, 2)}, "at most twice the clip's duration"),
        ({"num_frames": 0}, "num_frames=0; expected at least 1"),
    ],
)
def test_trouble_is_named(options, message):
    with no_shape_checks(), pytest.raises(ValueError, match=message):
        time_warp(kick(), **options)


def test_a_traced_amount_cannot_tell_the_duration():
    motion = kick(6)
    with pytest.raises(ValueError, match="give num_frames"):
        jax.jit(lambda a: time_warp(motion, amount=a).rotations)(0.5)
    with pytest.raises(Exception, match="must increase"):
        jax.block_until_ready(
            jax.jit(lambda p: time_warp(motion, pairs=p, num_frames=6).rotations)(
                jnp.array([[0.1, 0.1], [0.05, 0.2]])
            )
        )
