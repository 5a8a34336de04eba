"""Fixed-size blocks: products against SciPy, one branch, AMC clips of any length compiled once."""

import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmotion import Motion, Skeleton
from jaxmotion.io import euler_blocks, load, save
from tests.helpers import (
    angle_between,
    assert_same_rotation,
    compilations,
    random_quaternions,
    scipy_rotation,
)


@pytest.mark.parametrize(("frames", "joints"), [(1, 1), (512, 32), (513, 33)])
def test_products_are_scipys(frames, joints):
    rng = np.random.default_rng(frames)
    left, right = (np.asarray(random_quaternions(rng, (joints,))) for _ in "lr")
    q = np.asarray(random_quaternions(rng, (frames, joints)))
    given = left.copy(), q.copy(), right.copy()
    a, b, c = (scipy_rotation(np.broadcast_to(x, q.shape)) for x in (left, q, right))
    wanted = (a * b * c).as_quat(scalar_first=True).reshape(q.shape)
    assert_same_rotation(euler_blocks.products(left, q, right), wanted, 1e-14)
    for before, after in zip(given, (left, q, right), strict=True):
        np.testing.assert_array_equal(before, after)


@pytest.mark.parametrize(("order", "slot"), [("zxy", 1), ("XYZ", 2)])
def test_one_branch_means_the_same_and_stays_in_range(order, slot):
    wild = np.asarray(random_quaternions(np.random.default_rng(3), (400, 5)))
    angles = np.concatenate(list(euler_blocks.angle_blocks(wild, order)))
    assert (np.cos(angles[..., slot]) < -0.1).any()
    kept = euler_blocks.one_branch(angles, slot)
    assert np.cos(kept[..., slot]).min() >= -1e-12
    assert np.abs(np.diff(kept, axis=0)).max() <= np.pi + 1e-12
    again = Rotation.from_euler(order, kept.reshape(-1, 3)).as_quat(scalar_first=True)
    assert_same_rotation(again.reshape(wild.shape), wild, 1e-12)


DOFS = (("TX", "TY", "TZ", "RX", "RY", "RZ"), ("rz", "rx"), ("ry",))


def test_limited_dofs_turn_right_round_and_no_length_compiles_anew(tmp_path):
    """Jumps of 170 degrees about both of two axes, for which the other triple lies nearer."""
    skeleton = Skeleton(["root", "two", "one"], [-1, 0, 1], np.zeros((3, 3)), channels=DOFS)
    with compilations() as names:
        for frames in (1300, 1, 2, 511, 512, 600):
            turns = np.radians(170.0 * np.arange(frames) + 1.0)
            zero = np.zeros(frames)
            angles = [(zero, turns, zero), (turns, zero, -turns), (zero, turns, zero)]
            quats = [
                Rotation.from_euler(order, np.stack(a, -1)).as_quat(scalar_first=True)
                for order, a in zip(("xyz", "zyx", "xyz"), angles, strict=True)
            ]
            motion = Motion(skeleton, np.zeros((frames, 3, 3)), np.stack(quats, 1), 0.01)
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                save(motion, tmp_path / "a.amc")
                again = load(tmp_path / "a.amc")
            assert again.skeleton.channels == DOFS
            assert np.asarray(angle_between(motion.rotations, again.rotations)).max() < 1e-9
            rows = [row.split() for row in (tmp_path / "a.amc").read_text().splitlines()]
            written = np.array([row[1:] for row in rows if row[0] == "two"], float)
            np.testing.assert_allclose(
                np.radians(written), np.stack([turns, -turns], -1), atol=1e-9
            )
            if frames == 1300:
                names.clear()
    assert [name for name in names if "euler" in name or "sandwich" in name] == []
