"""Host-side Euler conversion against SciPy and against the library's own differentiable one."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmotion import quaternion
from jaxmotion.io import euler

ORDERS = ["".join(p) for p in itertools.permutations("XYZ")] + ["XYX", "ZXZ"]
ORDERS += [order.lower() for order in ORDERS]


@pytest.fixture
def smooth_rotations():
    """A clip that tumbles through every branch: f64[400, J, 4]."""
    rng = np.random.default_rng(3)
    time = np.linspace(0, 1, 400)[:, None, None]
    waves = sum(
        rng.normal(size=(1, len(ORDERS), 3)) * np.sin(2 * np.pi * k * time + rng.uniform(0, 6))
        for k in (1, 2, 3)
    )
    turns = Rotation.from_rotvec(2 * waves.reshape(-1, 3))
    return turns.as_quat(scalar_first=True).reshape(400, len(ORDERS), 4)


def _same_rotation(a, b, atol):
    np.testing.assert_allclose(np.abs(np.sum(a * b, -1)), 1, atol=atol)


def test_from_euler_is_scipys():
    angles = np.random.default_rng(0).uniform(-7, 7, (5, len(ORDERS), 3))
    ours = euler.from_euler(angles, ORDERS)
    for j, order in enumerate(ORDERS):
        theirs = Rotation.from_euler(order, angles[:, j]).as_quat(scalar_first=True)
        _same_rotation(ours[:, j], theirs, 1e-14)


def test_round_trip_and_nearest_branch(smooth_rotations):
    angles = euler.to_euler(smooth_rotations, ORDERS)
    _same_rotation(euler.from_euler(angles, ORDERS), smooth_rotations, 1e-14)
    expected = np.stack(
        [
            quaternion.to_euler(jnp.asarray(smooth_rotations[:, j]), order, unwrap=True)
            for j, order in enumerate(ORDERS)
        ],
        axis=1,
    )
    np.testing.assert_allclose(angles, expected, atol=1e-9)
    assert np.abs(angles).max() > 2 * np.pi  # it does unwrap
    assert np.abs(np.diff(angles, axis=0)).max() < np.pi


def test_one_branch_stays_in_range(smooth_rotations):
    angles = euler.to_euler(
        smooth_rotations, ["zxy"] * len(ORDERS), two_branches=[False] * len(ORDERS)
    )
    assert np.abs(angles[..., 1]).max() <= np.pi / 2


def test_gimbal_lock_and_short_clips():
    angles = np.array([[[0.3, np.pi / 2, 0.2]], [[0.3, -np.pi / 2, 0.2]]])
    q = euler.from_euler(angles, ["ZXY"])
    again = euler.from_euler(euler.to_euler(q, ["ZXY"]), ["ZXY"])
    _same_rotation(again, q, 1e-14)
    for frames in (0, 1):
        assert euler.to_euler(q[:frames], ["xyz"]).shape == (frames, 1, 3)
