"""Paths are those of the joints by 4x4 matrices, and turn the way that they turn from above."""

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.viz import plot_trajectories
from tests.helpers import random_motion, world_by_matrices
from tests.viz.clips import legend_of, png, turning

CIRCLE = 0.3 * np.arange(25)


def circling():
    """Counterclockwise about y as seen from above, facing ahead; left is to the left."""
    root = np.stack([np.sin(CIRCLE), 0 * CIRCLE, np.cos(CIRCLE)], 1)
    vectors = np.zeros((25, 3, 3))
    vectors[:, 0, 1] = CIRCLE + np.pi / 2
    offsets = [[0, 0, 0], [0.1, 0, 0], [-0.1, 0, 0]]
    names = ["hip", "LeftLeg", "RightLeg"]
    return turning(vectors, root, names=names, parents=[-1, 0, 0], offsets=offsets)


def turns_left(line):
    (a, b), (c, d) = np.diff(line.get_xydata()[:3], axis=0)
    return a * d - b * c > 0


def test_a_circle_from_above(tmp_path):
    motion = circling()
    figure = plot_trajectories(motion, joints=["hip", "LeftLeg"])
    (axes,) = figure.axes
    where = world_by_matrices(motion)[0]
    for line, joint in zip(axes.lines[::2], (0, 1), strict=True):
        np.testing.assert_allclose(line.get_xydata(), where[:, joint][:, [2, 0]], atol=1e-9)
    for ring, joint in zip(axes.lines[1::2], (0, 1), strict=True):
        np.testing.assert_allclose(ring.get_xydata(), where[:1, joint][:, [2, 0]], atol=1e-9)
    assert turns_left(axes.lines[0])
    (arrows,) = axes.collections
    assert arrows.N == 2  # frames 0 and 20
    ahead = np.stack([arrows.U, arrows.V], 1)
    ways = np.diff(axes.lines[0].get_xydata(), axis=0)[[0, 20]]
    cosine = np.sum(ahead * ways, 1) / np.linalg.norm(ahead, axis=1) / np.linalg.norm(ways, axis=1)
    assert cosine.min() > 0.98
    inner = np.linalg.norm(axes.lines[2].get_xydata(), axis=1)
    np.testing.assert_allclose(inner, 0.9, atol=1e-9)  # left, inside of a turn to the left
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("z, file's unit", "x, file's unit")
    assert axes.get_aspect() == 1.0
    assert legend_of(figure) == ["hip", "LeftLeg"]
    assert png(figure, tmp_path / "paths.png")


def test_a_world_with_z_up_has_its_own_axes_and_turns_alike():
    motion = jm.reorient(circling(), "z")
    (axes,) = plot_trajectories(motion).axes
    where = world_by_matrices(motion)[0][:, 0]
    np.testing.assert_allclose(axes.lines[0].get_xydata(), where[:, :2], atol=1e-9)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x, file's unit", "y, file's unit")
    assert turns_left(axes.lines[0])


def test_clips_by_name_one_frame_and_no_sides():
    motion = random_motion(np.random.default_rng(0), frames=9, skeleton=3)
    figure = plot_trajectories({"a": motion, "$b$": motion[:1]}, joints=[0, 2])
    assert legend_of(figure) == ["a, joint0", "a, joint2", r"\$b\$, joint0", r"\$b\$, joint2"]
    assert not figure.axes[0].collections
    assert legend_of(plot_trajectories({"a": motion, "b": motion})) == ["a", "b"]


def test_refusals():
    motion = circling()
    with pytest.raises(ValueError, match="clips with y and z up; expected one axis"):
        plot_trajectories({"a": motion, "b": jm.reorient(motion, "z")})
    with pytest.raises(ValueError, match=r"joints=\[\]; expected a list of some joints"):
        plot_trajectories(motion, joints=[])
