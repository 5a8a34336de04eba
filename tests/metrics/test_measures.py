"""Measures against SciPy and 4x4 matrices."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion._asf_bone import AsfBone
from jaxmotion.metrics import measures
from tests.helpers import (
    angle_between,
    random_motion,
    random_quaternions,
    random_skeleton,
    scipy_rotation,
    world_by_matrices,
)

IDENTITY = np.array([1.0, 0, 0, 0])


@pytest.fixture
def motion(dtype):
    return random_motion(np.random.default_rng(0), 7, 4, dtype)


def test_turn():
    rng = np.random.default_rng(1)
    a, b = random_quaternions(rng, (50,)), random_quaternions(rng, (50,))
    np.testing.assert_allclose(measures.turn(a, b), angle_between(a, b), atol=1e-12)
    assert np.all(measures.turn(a, -a) == 0)
    tiny = jm.quaternion.multiply(a, jm.quaternion.exp(np.full((50, 3), 1e-9)))
    np.testing.assert_allclose(measures.turn(a, tiny), np.sqrt(3) * 1e-9, rtol=1e-5)


def test_rotation_rates(motion):
    want = angle_between(motion.rotations[1:], motion.rotations[:-1]) * 30
    np.testing.assert_allclose(measures.rotation_rates(motion), want, rtol=1e-5)


def test_sign_flips(motion):
    aligned = np.array(jm.quaternion.align_signs(motion.rotations))
    assert not measures.sign_flips(motion.with_transforms(rotations=aligned)).any()
    aligned[3:, 2] *= -1
    flips = measures.sign_flips(motion.with_transforms(rotations=aligned))
    assert np.argwhere(flips).tolist() == [[2, 2]]


def test_bend_of_a_spike_and_of_a_steady_turn():
    vectors = np.zeros((9, 1, 3))
    vectors[:, 0, 0] = 0.1 * np.arange(9)
    skeleton = random_skeleton(np.random.default_rng(0), 1)
    steady = jm.Motion.from_root(skeleton, np.zeros((9, 3)), jm.quaternion.exp(vectors), 1 / 30)
    np.testing.assert_allclose(measures.bend(steady), 0, atol=1e-7)
    vectors[4] += [0.4, 0, 0]
    spiky = steady.with_transforms(rotations=jm.quaternion.exp(vectors))
    np.testing.assert_allclose(measures.bend(spiky)[:, 0], [0, 0, 0.2, 0.4, 0.2, 0, 0], atol=1e-7)


def test_bend_does_not_mind_signs(motion):
    signs = np.random.default_rng(2).choice([-1.0, 1.0], (7, 4, 1)).astype(motion.dtype)
    signed = motion.with_transforms(rotations=motion.rotations * signs)
    np.testing.assert_allclose(measures.bend(signed), measures.bend(motion), atol=1e-6)


def test_root_bend(motion):
    p = world_by_matrices(motion)[0][:, motion.body_joint]
    want = np.linalg.norm(np.diff(p, 2, axis=0), axis=-1) / 2
    np.testing.assert_allclose(measures.root_bend(motion), want, rtol=1e-5)


def test_duplicate_frames(motion):
    held = motion.with_transforms(
        motion.translations[np.array([0, 0, 1, 2, 2, 2, 3])],
        motion.rotations[np.array([0, 0, 1, 2, 2, 2, 4])],
    )
    assert np.flatnonzero(measures.duplicate_frames(held)).tolist() == [1, 4, 5]
    assert not measures.duplicate_frames(motion).any()
    assert measures.duplicate_frames(motion[:1]).tolist() == [False]


@pytest.mark.parametrize("order", ["ZXY", "XYZ", "YZX", "ZXZ", "YXY"])
def test_gimbal_margin(order):
    rng = np.random.default_rng(3)
    skeleton = jm.Skeleton(
        ["a", "b"],
        [-1, 0],
        np.zeros((2, 3)),
        channels=[[f"{c}rotation" for c in order], ["Xrotation", "Yrotation"]],
    )
    motion = random_motion(rng, 30, skeleton)
    margin = measures.gimbal_margin(motion)
    middle = scipy_rotation(motion.rotations[:, 0]).as_euler(order)[:, 1]
    proper = order[0] == order[2]
    want = np.minimum(np.abs(middle), np.pi - np.abs(middle)) if proper else None
    want = np.pi / 2 - np.abs(middle) if want is None else want
    np.testing.assert_allclose(margin[:, 0], want, atol=1e-7)
    assert np.all(np.isinf(margin[:, 1]))


def test_gimbal_margin_in_an_asf_bone_s_own_axes():
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(4)
    angles = rng.uniform(-1.5, 1.5, (20, 3))
    turn = Rotation.from_euler("xyz", angles)
    own = Rotation.from_euler("xyz", [20, 30, -50], degrees=True)
    rotations = [(turn * own).as_quat(scalar_first=True)]
    rotations.append((own * turn * own.inv()).as_quat(scalar_first=True))
    skeleton = jm.Skeleton(
        ["root", "bone"],
        [-1, 0],
        np.zeros((2, 3)),
        channels=[["rx", "ry", "rz"]] * 2,
        asf=[AsfBone(axis=(20.0, 30.0, -50.0))] * 2,
    )
    motion = jm.Motion.from_root(skeleton, np.zeros((20, 3)), np.stack(rotations, 1), 0.01)
    want = np.pi / 2 - np.abs(angles[:, 1])
    np.testing.assert_allclose(measures.gimbal_margin(motion), np.stack([want, want], 1), atol=1e-7)


def test_world_positions_in_blocks(motion, monkeypatch):
    monkeypatch.setattr(measures, "_BLOCK", 3)
    positions, _, ends = world_by_matrices(motion)
    got = measures.world_positions(motion)
    np.testing.assert_allclose(got, np.concatenate([positions, ends], 1), rtol=1e-4, atol=1e-4)
    assert got.dtype == np.float64


def test_figure_size():
    skeleton = jm.Skeleton(
        ["a", "b", "c"], [-1, 0, 1], np.array([[9.0, 9, 9], [0, 3, 4], [12, 0, 0]])
    )
    assert measures.figure_size(skeleton) == 17
    assert measures.figure_size(jm.Skeleton(["a"], [-1], np.zeros((1, 3)))) == 1


def test_difference():
    motion = random_motion(np.random.default_rng(5), 8, 4)
    names = motion.skeleton.names
    none = measures.difference(motion, motion, world=True)
    assert (none.frames, none.frames_changed, none.angle.value) == (8, 0, 0)
    assert none.distance is not None
    assert (none.distance.value, none.distance.mean, none.distance.p95) == (0, 0, 0)
    vectors = np.zeros((8, 4, 3))
    vectors[3, 2] = [0.0, 0.3, 0.0]
    vectors[6, 1] = [0.1, 0.0, 0.0]
    turned = jm.quaternion.multiply(motion.rotations, jm.quaternion.exp(vectors))
    shifts = np.eye(8, 4)[..., None] * [0.0, 0.0, 0.5]
    shifts[1, 0] = [0.3, 0.4, 1.2]  # of the root
    edited = motion.with_transforms(motion.translations + jnp.asarray(shifts), -turned)
    found = measures.difference(motion, edited, world=True)
    assert found.frames_changed == 5
    assert (found.angle.frame, found.angle.joint) == (3, "joint2")
    assert_peak(found.angle, np.linalg.norm(vectors, axis=-1), names)
    assert_peak(found.shift, np.linalg.norm(shifts, axis=-1), names)
    before, after = (
        np.concatenate([positions, ends], axis=1)
        for positions, _, ends in map(world_by_matrices, (motion, edited))
    )
    ends = tuple(names[joint] for joint in motion.skeleton.end_joints)
    assert found.distance is not None
    far, body = np.linalg.norm(after - before, axis=-1), motion.body_joint
    assert_peak(found.distance, far, names + ends)
    assert_peak(found.root, far[:, [body]], names[body:])
    assert measures.difference(motion, edited).distance is None
    with pytest.raises(ValueError, match="must agree"):
        measures.difference(motion, motion[:3])


def assert_peak(peak, values, names):
    frame, point = np.unravel_index(np.argmax(values), values.shape)
    assert (peak.frame, peak.joint, peak.end_site) == (frame, names[point], point >= 4)
    got = [peak.value, peak.mean, peak.p95]
    want = [values.max(), values.mean(), np.percentile(values, 95)]
    np.testing.assert_allclose(got, want, atol=1e-6)


def test_the_last_joint_s_turn_moves_its_end_site():
    skeleton = jm.Skeleton(
        ["hips", "hand"],
        [-1, 0],
        np.array([[0.0, 0, 0], [0, 5, 0]]),
        end_joints=[1],
        end_offsets=np.array([[2.0, 0, 0]]),
    )
    motion = jm.Motion.from_root(skeleton, np.zeros((3, 3)), np.tile(IDENTITY, (3, 2, 1)), 1 / 30)
    vectors = np.zeros((3, 2, 3))
    vectors[2, 1, 2] = np.pi / 2
    edited = motion.with_transforms(rotations=jm.quaternion.exp(vectors))
    moved = measures.difference(motion, edited, world=True).distance
    assert moved is not None
    assert (moved.frame, moved.joint, moved.end_site) == (2, "hand", True)
    assert moved.value == pytest.approx(2 * np.sqrt(2))
    assert moved.mean == pytest.approx(2 * np.sqrt(2) / 9)


def test_frames_that_change_by_less_than_one_sees_are_not_counted():
    skeleton = jm.Skeleton(["hips", "hand"], [-1, 0], np.array([[0.0, 0, 0], [0, 5, 0]]))
    motion = jm.Motion.from_root(skeleton, np.zeros((4, 3)), np.tile(IDENTITY, (4, 2, 1)), 1 / 30)
    vectors, shifts = np.zeros((4, 2, 3)), np.zeros((4, 2, 3))
    vectors[:2, 1, 0] = np.radians([0.049, 0.051])
    shifts[2:, 0, 1] = [0.0049, 0.0051]  # the figure's size is 5
    edited = motion.with_transforms(
        motion.translations + jnp.asarray(shifts), jm.quaternion.exp(vectors)
    )
    found = measures.difference(motion, edited)
    assert (found.frames, found.frames_changed) == (4, 2)
    assert found.angle.value == pytest.approx(np.radians(0.051))
