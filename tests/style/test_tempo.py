"""How fast a body moves for how far it goes, and the time that a transfer stretches."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.style import apply_style, interpolate, motion_style, transfer_style
from tests.helpers import assert_same_rotation, check_gradients
from tests.style.clips import quaternions, rotations, swaying


def swinging(periods, size=0.5, frames=61, rate=60.0):
    """Every joint below the root swings about one axis, whole periods of it."""
    motion = swaying(0, frames, rate=rate)
    angle = size * np.sin(2 * np.pi * periods * np.arange(frames) / (frames - 1))
    q = np.array(motion.rotations)
    q[:, 1:] = quaternions(Rotation.from_rotvec(angle[:, None] * np.array([1.0, 0, 0])))[:, None]
    return motion.with_transforms(rotations=q)


def test_of_a_swing():
    """2 sin(ωΔ/2)/Δ, of frames Δ apart."""
    for periods, size in ((2, 0.5), (5, 0.5), (5, 2.0)):
        motion = swinging(periods, size)
        w = np.ones(61)
        w[0] = w[-1] = 0.5  # the ends of a period are one frame
        style = motion_style(motion, w, mean="karcher")
        turn, steps = 2 * np.pi * periods / 60, 0.5 * (w[1:] + w[:-1])
        angle = size * np.sin(turn * np.arange(61))
        fast = np.sqrt(steps @ np.diff(angle) ** 2 / steps.sum()) * 60
        np.testing.assert_allclose(style.tempo, fast / (size / np.sqrt(2)), rtol=1e-9)
        wanted = 2 * np.sin(turn / 2) * 60
        np.testing.assert_allclose(style.tempo, wanted, rtol=0.02)


def test_against_plain_numpy():
    motion = swaying(1, 50)
    q = np.asarray(motion.rotations)
    style = motion_style(motion)
    turns = [
        (rotations(q[:-1, j]).inv() * rotations(q[1:, j])).magnitude() * 30 for j in range(1, 5)
    ]
    fast = sum(np.mean(turn**2) for turn in turns)
    far = float((style.deviation[1:] ** 2).sum())
    np.testing.assert_allclose(style.tempo, np.sqrt(fast / far), rtol=1e-12)


def test_does_not_know_the_rate_nor_the_size():
    """Twice the frames of the same swing, and a wider one; several clips are one. The pose that a
    whole number of periods begins and ends with counts twice: some 1/121."""
    slow, twice = swinging(2, frames=241, rate=120.0), swinging(2, frames=121, rate=60.0)
    wide = swinging(2, size=1.0, frames=121, rate=60.0)
    tempos = [float(motion_style(clip).tempo) for clip in (slow, twice, wide)]
    np.testing.assert_allclose(tempos, tempos[0], rtol=3e-3)
    both = motion_style([slow, twice])
    np.testing.assert_allclose(both.tempo, tempos[0], rtol=3e-3)


@pytest.mark.parametrize("deviation", ["scalar", "covariance"])
@pytest.mark.parametrize("warp", [None, "shared"])
def test_time_is_stretched(deviation, warp):
    """A quick swing on a slow one: the same frames, over as much more time."""
    source, reference = swinging(4), swinging(2, size=0.8)
    options = {"deviation": deviation, "warp": warp, "keep_contacts": False}
    result = transfer_style(source, reference, tempo=True, **options)
    longer = result.source_style.tempo / result.reference_style.tempo
    np.testing.assert_allclose(longer, 2, rtol=0.02)
    np.testing.assert_allclose(result.report.longer, longer)
    np.testing.assert_allclose(result.motion.frame_time, longer / 60, rtol=1e-12)
    plain = transfer_style(source, reference, **options)
    assert_same_rotation(result.motion.rotations[:, 1:], plain.motion.rotations[:, 1:], 1e-12)
    assert float(plain.report.longer) == 1
    assert float(plain.motion.frame_time) == float(source.frame_time)


@pytest.mark.parametrize("root", [True, False])
def test_speeds_are_the_reference_s(root):
    """Of joints, and of the body, whose path is longer by the time it takes; a root that is left
    goes the way it went."""
    source, reference = swaying(2), swaying(3, 52)
    result = transfer_style(
        source, reference, tempo=True, warp=None, root=root, mean="karcher", keep_contacts=False
    )
    style = motion_style(result.motion, mean="karcher")
    wanted = result.reference_style
    np.testing.assert_allclose(style.tempo, wanted.tempo, rtol=0.02)
    if root:
        np.testing.assert_allclose(style.root_mean[:3], wanted.root_mean[:3], atol=1e-9)
        np.testing.assert_allclose(style.root_deviation[:3], wanted.root_deviation[:3], rtol=1e-9)
    else:
        np.testing.assert_array_equal(result.motion.root_positions, source.root_positions)


def test_without_a_clip_and_by_degrees():
    source, reference = swinging(4), swinging(2)
    own, other = motion_style(source), motion_style(reference)
    whole = apply_style(source, other, tempo=True, keep_contacts=False)
    np.testing.assert_allclose(whole.frame_time * other.tempo, own.tempo / 60, rtol=1e-12)
    half = apply_style(source, other, tempo=True, strength=0.5, keep_contacts=False)
    np.testing.assert_allclose(half.frame_time**2, whole.frame_time / 60, rtol=1e-12)
    between = interpolate([own, other], [1.0, 3.0])
    np.testing.assert_allclose(between.tempo, own.tempo**0.25 * other.tempo**0.75, rtol=1e-12)
    same = apply_style(source, own, tempo=True, keep_contacts=False)
    np.testing.assert_allclose(same.frame_time, source.frame_time, rtol=1e-12)


def test_still_bodies_keep_their_time():
    source = swinging(2)
    still = source.with_transforms(rotations=np.repeat(source.rotations[:1], 61, axis=0))
    assert float(motion_style(still).tempo) == 0
    assert float(motion_style(source[:1]).tempo) == 0
    for one, other in ((source, still), (still, source), (source[:1], source)):
        result = transfer_style(one, other, tempo=True, keep_contacts=False)
        assert float(result.report.longer) == 1
        assert np.isfinite(result.motion.rotations).all()
    styles = [motion_style(source), motion_style(still)]
    assert float(interpolate(styles, [0.5, 0.5]).tempo) == 0

    def loss(rotations):
        return motion_style(still.with_transforms(rotations=rotations)).tempo

    assert np.isfinite(jax.grad(loss)(still.rotations)).all()


def test_derivatives():
    source, reference = swaying(4, 12), swaying(5, 15)

    def lasting(translations, rotations):
        clip = source.with_transforms(translations, rotations)
        found = transfer_style(clip, reference, tempo=True, warp=None, keep_contacts=False)
        return found.motion.frame_time

    check_gradients(lasting, source.translations, source.rotations)


def test_back_to_the_rate():
    """The frame time is what ``resample`` takes."""
    result = transfer_style(swinging(4), swinging(2), tempo=True, keep_contacts=False).motion
    again = jm.resample(result, fps=60)
    assert again.num_frames in (120, 121, 122)
