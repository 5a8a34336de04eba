"""Arcs: what they do to directions, against SciPy, and where there are none."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmotion.quaternion import conjugate, multiply, rotate
from jaxmotion.quaternion.arcs import shortest_arc, twist, unit_across
from tests.helpers import assert_finite_derivatives, random_vectors, scipy_rotation


def norm(v):
    return np.linalg.norm(v, axis=-1)


def test_shortest_arc():
    rng = np.random.default_rng(5)
    a, b = random_vectors(rng, (50,)), random_vectors(rng, (50,))
    turned = rotate(shortest_arc(a, b), a / norm(a)[:, None])
    np.testing.assert_allclose(turned, b / norm(b)[:, None], atol=1e-12)
    np.testing.assert_allclose(rotate(shortest_arc(a, -a), a), -a, atol=1e-12)
    np.testing.assert_array_equal(shortest_arc(a, 0 * a), np.tile([1.0, 0, 0, 0], (50, 1)))
    assert_finite_derivatives(shortest_arc, np.array([1.0, 2, 3]), np.array([-1.0, -2, -3]))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_swing_and_a_twist_are_the_turn(dtype):
    rng = np.random.default_rng(6)
    axis = random_vectors(rng, (20,))
    axis = (axis / norm(axis)[:, None]).astype(dtype)
    around, across = rng.uniform(-3, 3, (2, 20, 1))
    flat = unit_across(random_vectors(rng, (20,)).astype(dtype), axis, 0)
    turns = [
        Rotation.from_rotvec(angle * np.array(v, np.float64))
        for angle, v in ((across, flat), (around, axis))
    ]
    q = np.roll((turns[0] * turns[1]).as_quat(), 1, axis=-1).astype(dtype)
    found = twist(q, axis)
    assert found.dtype == dtype
    apart = scipy_rotation(found).inv() * turns[1]
    np.testing.assert_allclose(apart.magnitude(), 0, atol=1e-13 if dtype == np.float64 else 2e-5)
    swing = np.asarray(multiply(q, conjugate(found)))
    np.testing.assert_allclose(np.sum(swing[:, 1:] * axis, -1), 0, atol=2e-7)


def test_a_half_turn_that_swings_the_axis_round_has_no_twist():
    half, up = np.array([0.0, 1, 0, 0]), np.array([0.0, 1, 0])
    np.testing.assert_array_equal(twist(half, up), [1, 0, 0, 0])
    assert_finite_derivatives(twist, half, up)


def test_what_is_along_the_line_takes_some_perpendicular():
    line = np.array([[0.0, 0, 2], [1, 1, 1], [-3, 0, 0]])
    for v in (line, 0 * line, -5 * line):
        found = unit_across(v, line, 1e-9)
        np.testing.assert_allclose(norm(found), 1, atol=1e-12)
        np.testing.assert_allclose(np.sum(found * line, -1), 0, atol=1e-12)
