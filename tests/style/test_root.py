"""The body's channels: there and back, and that they do not know where the body is."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion._posture import upright
from jaxmotion.style.root import decode, encode, lean
from tests.helpers import assert_same_rotation
from tests.style.clips import quaternions, rotations, skeleton, swaying


def placed(motion, angle, shift):
    """The clip turned about the vertical and carried elsewhere."""
    turn = Rotation.from_rotvec([0, angle, 0])
    q = np.array(motion.rotations)
    q[:, 0] = quaternions(turn * rotations(q[:, 0]))
    place = np.array(motion.translations)
    place[:, 0] = turn.apply(place[:, 0]) + shift
    return motion.with_transforms(place, q)


def walk(angle, speed=1.5, up=0.0, rate=30.0):
    """A body that faces where it goes: ``angle`` of every frame."""
    frames = len(angle)
    q = np.zeros((frames, 5, 4))
    q[..., 0] = 1
    q[:, 0] = quaternions(Rotation.from_rotvec(angle[:, None] * np.array([0, 1.0, 0])))
    step = speed / rate * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], 1)
    place = np.cumsum(step, axis=0) - step + np.array([0, 2 + up, 0])
    return jm.Motion.from_root(skeleton(), place, q, 1 / rate)


@pytest.mark.parametrize("rate", [0.0, 0.6], ids=["straight", "circle"])
def test_channels_of_a_walk(rate):
    angle = 0.4 + rate * np.arange(50) / 30
    motion = walk(angle, up=0.7)
    channels, start = encode(motion, upright(motion))
    # up is y, so that ahead is z and aside is x: the walk goes along z of its own yaw.
    np.testing.assert_allclose(channels[:, :3], np.tile([1.5, 0, rate], (50, 1)), atol=1e-9)
    np.testing.assert_allclose(channels[:, 3], 2, atol=1e-12)  # the foot is 2 below the hips
    np.testing.assert_allclose(channels[:, 4:], 0, atol=1e-9)
    np.testing.assert_allclose(start.ground, 0.7, atol=1e-12)


def test_there_and_back():
    motion = swaying(0)
    stands = upright(motion)
    again = decode(*encode(motion, stands), stands, motion)
    np.testing.assert_allclose(again.translations, motion.translations, atol=1e-12)
    assert_same_rotation(again.rotations, motion.rotations, 1e-12)


def test_place_and_yaw_do_not_matter():
    motion = swaying(1)
    stands = upright(motion)
    here, there = (
        encode(clip, stands)[0] for clip in (motion, placed(motion, 2.5, [7.0, 3.0, -9.0]))
    )
    np.testing.assert_allclose(there, here, atol=1e-9)


@pytest.mark.parametrize("axis", ["x", "z"])
def test_other_axes_up(axis):
    motion = swaying(2)
    other = jm.reorient(motion, up=axis)
    assert other.skeleton.up == axis
    here, there = (encode(clip, upright(clip))[0] for clip in (motion, other))
    np.testing.assert_allclose(np.sort(abs(there[5])), np.sort(abs(here[5])), atol=1e-9)
    stands = upright(other)
    again = decode(*encode(other, stands), stands, other)
    np.testing.assert_allclose(again.translations, other.translations, atol=1e-12)


@pytest.mark.parametrize("turn", [[np.pi, 0, 0], [0, 0, np.pi], [np.pi / 2, 0, 0]])
def test_a_root_with_axes_of_its_own(turn):
    """A root whose y points down or ahead: the yaw is as good, where q itself has none."""
    motion = swaying(3)
    own = Rotation.from_rotvec(turn)
    q = np.array(motion.rotations)
    q[:, 0] = quaternions(rotations(q[:, 0]) * own)
    other = motion.with_transforms(rotations=q)
    stands = upright(other)
    np.testing.assert_allclose(own.apply(np.array(stands)), [0, 1, 0], atol=1e-12)
    channels = encode(other, stands)[0]
    np.testing.assert_allclose(channels[:, 2], encode(motion, upright(motion))[0][:, 2], atol=1e-9)
    # What is ahead may be another of the root's axes; how far it leans is not.
    here, there = lean(motion, upright(motion)), lean(other, stands)
    np.testing.assert_allclose(jnp.sum(there**2, -1), jnp.sum(here**2, -1), atol=1e-9)


def test_a_joint_above_the_hips():
    """Files that put a joint of their own above the body's: what moves is the hips."""
    inner = swaying(4)
    names = ("file", *inner.skeleton.names)
    parents = (-1, *(p + 1 for p in inner.skeleton.parents))
    offsets = np.concatenate([np.zeros((1, 3)), inner.skeleton.offsets])
    above = Rotation.from_rotvec([0.3, 0.8, -0.2])
    shape = (inner.num_frames, 1)
    q = np.concatenate([np.broadcast_to(quaternions(above), (*shape, 4)), inner.rotations], 1)
    q[:, 1] = quaternions(above.inv() * rotations(q[:, 1]))
    place = np.concatenate([np.zeros((*shape, 3)), inner.translations], 1)
    place[:, 1] = above.inv().apply(place[:, 1])
    outer = jm.Motion(
        jm.Skeleton(names, parents, offsets), place, q, 1 / 30, translated_joints=(0, 1)
    )
    assert (inner.body_joint, outer.body_joint) == (0, 1)
    stands = upright(inner)
    np.testing.assert_allclose(encode(outer, stands)[0], encode(inner, stands)[0], atol=1e-9)
    again = decode(*encode(outer, stands), stands, outer)
    np.testing.assert_allclose(again.translations, outer.translations, atol=1e-12)
    assert_same_rotation(again.rotations, outer.rotations, 1e-12)


def test_stands_where_it_stood():
    """Shorter legs than the pose had: the body comes down with them."""
    motion = walk(np.zeros(20))
    channels, start = encode(motion, upright(motion))
    q = np.array(motion.rotations)
    q[:, 3] = quaternions(Rotation.from_rotvec([1.0, 0, 0]))  # the leg swings up
    bent = motion.with_transforms(rotations=q)
    result = decode(channels, start, upright(motion), bent)
    lowest = jm.forward_kinematics(result).positions[..., 1].min(axis=1)
    np.testing.assert_allclose(lowest, start.ground, atol=1e-12)
    assert result.translations[0, 0, 1] < 1.9


def test_one_frame():
    motion = swaying(5, frames=1)
    stands = upright(motion)
    channels, start = encode(motion, stands)
    np.testing.assert_array_equal(channels[:, :3], 0)
    again = decode(channels, start, stands, motion)
    np.testing.assert_allclose(again.translations, motion.translations, atol=1e-12)
    assert jnp.isfinite(channels).all()
