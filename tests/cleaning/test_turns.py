"""Rotations of whole clips on the host, against SciPy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from jaxmotion.cleaning import turns
from tests.helpers import assert_same_rotation, compilations, random_quaternions
from tests.style.clips import quaternions, rotations

TOLERANCE = {"float32": 2e-6, "float64": 1e-12}


def pair(frames, joints=3, dtype=np.float64):
    rng = np.random.default_rng(frames)
    return tuple(np.array(random_quaternions(rng, (frames, joints), dtype)) for _ in range(2))


def apart(a, b):
    return (rotations(a).inv() * rotations(b)).as_rotvec().reshape(*a.shape[:-1], 3)


@pytest.mark.parametrize("frames", [0, 1, 2, 37])
def test_vectors_and_angles(frames, dtype):
    a, b = pair(frames, dtype=dtype)
    found, size = turns.vectors_between(a, b), turns.angles_between(a, b)
    assert found.dtype == size.dtype == dtype
    assert found.shape == (frames, 3, 3)
    if frames:
        # Angles near π have two vectors in float32.
        near = np.linalg.norm(apart(a, b), axis=-1) < 3
        np.testing.assert_allclose(found[near], apart(a, b)[near], atol=30 * TOLERANCE[dtype.name])
        wanted = np.linalg.norm(apart(a, b), axis=-1)
        np.testing.assert_allclose(size, wanted, atol=10 * TOLERANCE[dtype.name])
        np.testing.assert_array_equal(found[near], turns.vectors_between(a, -b)[near])


def test_steps_and_what_is_turned(dtype):
    q, other = pair(20, dtype=dtype)
    wanted = rotations(q[:-1]).inv() * rotations(q[1:])
    atol = 10 * TOLERANCE[dtype.name]
    assert_same_rotation(turns.steps(q), quaternions(wanted).reshape(19, 3, 4), atol)
    v = apart(q, other).astype(dtype)
    assert_same_rotation(turns.turned(q, v), other, atol)
    assert turns.turned(q, v).dtype == dtype


@pytest.mark.parametrize("way", [0.0, 0.3, 1.0, 1.4])
def test_between(way, dtype):
    """The short way, at one speed, and on beyond."""
    rng = np.random.default_rng(0)
    a = np.asarray(random_quaternions(rng, (9, 2), dtype))
    v = rng.uniform(-1, 1, (9, 2, 3))
    b = turns.turned(a, v.astype(dtype))
    b = np.concatenate([-b[:4], b[4:]])
    found = turns.between(a, b, np.full((9, 2), way, dtype))
    wanted = rotations(a) * Rotation.from_rotvec(way * v.reshape(-1, 3))
    assert_same_rotation(found, quaternions(wanted).reshape(9, 2, 4), 10 * TOLERANCE[dtype.name])
    line = Slerp([0, 1], Rotation.concatenate([rotations(a[1, 0]), rotations(b[1, 0])]))
    if way <= 1:
        assert_same_rotation(found[1, 0], quaternions(line(way)), 10 * TOLERANCE[dtype.name])


@pytest.mark.parametrize("frames", [1, 5, 64, 70])
def test_mean_rotation(frames):
    """The first eigenvector of Σ q qᵀ: what fills a clip up does not count."""
    q, _ = pair(frames)
    q[::2] *= -1
    moment = np.einsum("tja,tjb->jab", q, q)
    wanted = np.linalg.eigh(moment)[1][:, :, -1]
    assert_same_rotation(turns.mean_rotation(q), wanted, 1e-7)


def test_lengths_share_programs():
    a, b = pair(100)
    turns.angles_between(a[:97], b[:97])
    turns.mean_rotation(a[:97])
    with compilations() as made:
        turns.angles_between(a[:99], b[:99])
        turns.mean_rotation(a[:99])
    assert not made
