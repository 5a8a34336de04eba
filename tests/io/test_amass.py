"""AMASS files: SciPy for the rotations, the models' published kinematic trees, wrong files."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.io import MotionFileError, load, save
from jaxmotion.io.amass import is_amass, load_amass
from tests.helpers import assert_same_rotation, scipy_rotation, world_by_matrices

BODY = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19]


def hands(first):
    fingers = [
        parent
        for wrist, start in ((20, first), (21, first + 15))
        for k in range(start, start + 15, 3)
        for parent in (wrist, k, k + 1)
    ]
    return fingers


PARENTS = {
    22: BODY,
    24: [*BODY, 20, 21],
    52: BODY + hands(22),
    55: [*BODY, 15, 15, 15, *hands(25)],
}


def write(folder, joints=52, frames=4, rate="mocap_framerate", **changes):
    rng = np.random.default_rng(joints)
    arrays = {
        "poses": rng.normal(size=(frames, 3 * joints)),
        "trans": rng.normal(size=(frames, 3)),
        rate: np.array(59.94),
        "betas": np.zeros(16),
        "gender": np.array("neutral"),
        "labels": np.array([{"never": "read"}], dtype=object),
    }
    arrays.update(changes)
    arrays = {name: array for name, array in arrays.items() if array is not None}
    np.savez(folder / "a.npz", **arrays)
    return folder / "a.npz", arrays


@pytest.mark.parametrize("joints", [22, 24, 52, 55])
def test_rotations_tree_and_root(tmp_path, joints, dtype):
    path, arrays = write(tmp_path, joints, rate="mocap_frame_rate")
    assert is_amass(path)
    motion = load(path, dtype=dtype)
    assert motion.skeleton.parents == tuple(PARENTS[joints])
    assert motion.skeleton.up == "z"
    assert motion.dtype == motion.skeleton.offsets.dtype == dtype
    assert motion.translated_joints == (0,)
    np.testing.assert_allclose(motion.fps, 59.94, rtol=1e-6)
    turns = Rotation.from_rotvec(arrays["poses"].reshape(-1, 3)).as_quat(scalar_first=True)
    eps = np.finfo(dtype).eps
    assert_same_rotation(motion.rotations, turns.reshape(-1, joints, 4), 8 * eps)
    rest = np.asarray(motion.skeleton.offsets)
    np.testing.assert_allclose(motion.root_positions, arrays["trans"] + rest[0], atol=8 * eps)
    np.testing.assert_array_equal(motion.translations[2, 1:], rest[1:])


def test_names_match_across_models(tmp_path):
    names = {n: load_amass(write(tmp_path, n)[0]).skeleton.names for n in PARENTS}
    assert names[24][:22] == names[52][:22] == names[55][:22] == names[22]
    assert names[52][22:] == names[55][25:]
    assert names[24][22:] == ("left_hand", "right_hand")
    assert names[52][22:25] == ("left_index1", "left_index2", "left_index3")
    assert names[52][-3:] == ("right_thumb1", "right_thumb2", "right_thumb3")
    assert names[55][22] == "jaw"


def test_nominal_adult_is_a_plausible_t_pose(tmp_path):
    zeros = np.zeros((1, 156))
    path, _ = write(tmp_path, frames=1, poses=zeros, trans=np.zeros((1, 3)))
    motion = load_amass(path)
    positions = dict(zip(motion.skeleton.names, world_by_matrices(motion)[0][0], strict=True))
    for name, place in positions.items():
        if name.startswith("left"):
            mirrored = positions[name.replace("left", "right")]
            np.testing.assert_allclose(mirrored, place * [-1, 1, 1], atol=1e-12)
            assert place[0] > 0
    assert 1.35 < positions["head"][1] - positions["left_foot"][1] < 1.65
    assert 1.2 < positions["left_wrist"][0] - positions["right_wrist"][0] < 1.5
    assert abs(positions["left_wrist"][1] - positions["left_shoulder"][1]) < 0.05
    assert positions["left_foot"][2] > positions["left_ankle"][2] + 0.05
    tall = load_amass(path, height=1.87)
    np.testing.assert_allclose(tall.skeleton.offsets, 1.1 * motion.skeleton.offsets, atol=1e-12)


def test_given_offsets_and_y_up(tmp_path):
    path, arrays = write(tmp_path, 24, mocap_framerate=None, mocap_frequency=np.array([120]))
    offsets = np.random.default_rng(0).normal(size=(24, 3))
    as_filed = load_amass(path, offsets=offsets)
    np.testing.assert_array_equal(as_filed.skeleton.offsets, offsets)
    turned = jm.reorient(as_filed, "y")
    assert turned.skeleton.up == "y"
    np.testing.assert_allclose(turned.fps, 120)
    z_up, y_up = world_by_matrices(as_filed)[0], world_by_matrices(turned)[0]
    np.testing.assert_allclose(y_up, z_up[..., [0, 2, 1]] * [1, 1, -1], atol=1e-12)
    root = Rotation.from_rotvec(arrays["poses"][0, :3]).as_matrix()
    np.testing.assert_allclose(scipy_rotation(as_filed.rotations[0, 0]).as_matrix()[0], root)


def test_zero_and_huge_rotations(tmp_path):
    poses = np.zeros((3, 66))
    poses[1] = 1e-200
    poses[2] = 12.0
    path, _ = write(tmp_path, 22, poses=poses, trans=np.zeros((3, 3)))
    q = np.asarray(load_amass(path).rotations)
    assert np.isfinite(q).all()
    np.testing.assert_array_equal(q[0], [[1.0, 0, 0, 0]] * 22)
    turns = Rotation.from_rotvec(poses.reshape(-1, 3)).as_quat(scalar_first=True)
    assert_same_rotation(q, turns.reshape(3, 22, 4), 1e-14)


def test_a_rotation_of_any_size_is_a_unit_quaternion(tmp_path, dtype):
    vectors = np.random.default_rng(0).standard_normal((4, 66))
    for size in (1e3, 1e6, 1e9, 1e12):
        path, _ = write(tmp_path, 22, poses=size * vectors)
        q = np.asarray(load(path, dtype=dtype).rotations, np.float64)
        np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1, atol=4 * np.finfo(dtype).eps)
        # The angle itself is known to its own rounding: a millionth of a turn at 1e9.
        if size <= 1e9:
            turns = Rotation.from_rotvec(size * vectors.reshape(-1, 3)).as_quat(scalar_first=True)
            assert_same_rotation(q, turns.reshape(4, 22, 4), 1e-6)


PARTS = {"root_orient": 3, "pose_body": 63, "pose_jaw": 3, "pose_eye": 6, "pose_hand": 90}


@pytest.mark.parametrize(
    ("parts", "joints"),
    [
        (("root_orient", "pose_body"), 22),
        (("root_orient", "pose_body", "pose_hand"), 52),
        (tuple(PARTS), 55),
        (("root_orient", "pose_body", "pose_jaw"), 55),
    ],
)
def test_poses_in_parts(tmp_path, parts, joints):
    """As the whole they are parts of; parts that are missing are at rest."""
    rng = np.random.default_rng(5)
    given = {name: rng.standard_normal((4, PARTS[name])) for name in parts}
    path, _ = write(tmp_path, joints, poses=None, **given)
    assert is_amass(path)
    motion = load(path)
    names = tuple(PARTS) if joints == 55 else tuple(n for n in PARTS if n in parts)
    whole = np.concatenate([given.get(n, np.zeros((4, PARTS[n]))) for n in names], axis=1)
    again = load(write(tmp_path, joints, poses=whole)[0])
    assert motion.skeleton.names == again.skeleton.names
    assert motion.num_joints == joints
    np.testing.assert_array_equal(motion.rotations, again.rotations)
    np.testing.assert_array_equal(motion.translations, again.translations)


def test_a_rate_from_the_caller(tmp_path):
    path, _ = write(tmp_path, 22, mocap_framerate=None)
    with pytest.raises(MotionFileError, match=r"Try: tell the rate: fps=30"):
        load(path)
    assert load(path, fps=25).frame_time == 0.04
    wrong, _ = write(tmp_path, 22, mocap_framerate=np.array(0.0))
    assert load(wrong, fps=25).frame_time == 0.04


def test_metres_are_said(tmp_path):
    motion = load(write(tmp_path, 22)[0])
    assert motion.skeleton.conventions.metres == 1.0
    assert motion.skeleton.conventions.up == "told"


def test_into_our_own_format_and_back(tmp_path):
    path, _ = write(tmp_path)
    motion = load(path)
    save(motion, tmp_path / "ours.npz")
    assert not is_amass(tmp_path / "ours.npz")
    np.testing.assert_array_equal(load(tmp_path / "ours.npz").rotations, motion.rotations)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"poses": np.zeros((4, 63))}, r"poses of shape \(4, 63\)"),
        ({"poses": np.zeros((0, 156)), "trans": np.zeros((0, 3))}, "with frames"),
        ({"poses": np.zeros(156)}, "poses of shape"),
        ({"poses": np.full((4, 156), np.nan)}, "not finite"),
        ({"poses": np.full((4, 156), 1e300)}, "too large"),
        ({"mocap_framerate": np.array(1e-320)}, "too small"),
        ({"poses": np.array([["x"]])}, "dtype"),
        ({"poses": np.array([None])}, "pickled objects in 'poses'"),
        ({"trans": np.zeros((3, 3))}, r"trans of shape \(3, 3\)"),
        ({"trans": None}, "no array 'trans'"),
        ({"mocap_framerate": None}, "no array 'mocap_framerate'"),
        ({"mocap_framerate": np.array(0.0)}, "one positive number"),
        ({"mocap_framerate": np.array([1.0, 2.0])}, "one positive number"),
        ({"mocap_framerate": np.array("120")}, "dtype"),
        ({"poses": None, "root_orient": np.zeros((4, 3)), "pose_body": np.zeros((4, 60))}, "body"),
        ({"poses": None, "root_orient": np.zeros((3, 3)), "pose_body": np.zeros((4, 63))}, "body"),
        ({"poses": None, "root_orient": np.zeros(3), "pose_body": np.zeros((4, 63))}, "root"),
    ],
)
def test_wrong_files_say_what_is_wrong(tmp_path, changes, message):
    path, _ = write(tmp_path, **changes)
    with pytest.raises(MotionFileError, match=message) as caught:
        load(path)
    assert caught.value.path == str(path)


def test_wrong_arguments(tmp_path):
    path, _ = write(tmp_path, 22, trans=np.full((4, 3), 1e39))
    with pytest.raises(ValueError, match="offsets of shape"):
        load_amass(path, offsets=np.zeros((24, 3)))
    with pytest.raises(ValueError, match="height"):
        load_amass(path, height=-1)
    with pytest.raises(MotionFileError, match="finite in float32"):
        load_amass(path, dtype=np.float32)
    assert load_amass(path).dtype == np.float64
