"""Bones are where 4x4 matrices have them, seen from the side and from in front."""

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.viz import plot_poses
from jaxmotion.viz.colours import BLUE, GREY, ORANGE
from tests.helpers import world_by_matrices
from tests.viz.clips import legend_of, png, turning

NAMES = ["hip", "spine", "LeftLeg", "LeftFoot", "RightLeg", "RightFoot"]
PARENTS = [-1, 0, 0, 2, 0, 4]
OFFSETS = [[0, 0, 0], [0, 0.5, 0], [0.2, 0, 0], [0, -0.8, 0], [-0.2, 0, 0], [0, -0.8, 0]]


def walker(frames=13, scale=0.3):
    """It faces z: left is x."""
    rng = np.random.default_rng(0)
    vectors = scale * rng.normal(size=(frames, 6, 3))
    vectors[:, 0] = 0
    root = np.stack([0 * np.arange(frames), np.full(frames, 0.8), 0.1 * np.arange(frames)], 1)
    return turning(vectors, root, names=NAMES, parents=PARENTS, offsets=OFFSETS)


def ahead_of(motion):
    """Left less right of legs and feet, turned by a quarter: the mean of each frame's."""
    points = world_by_matrices(motion)[0]
    aside = points[:, 2] + points[:, 3] - points[:, 4] - points[:, 5]
    ahead = np.stack([-aside[:, 2], 0 * aside[:, 1], aside[:, 0]], 1)
    ahead = (ahead / np.linalg.norm(ahead, axis=1, keepdims=True)).mean(axis=0)
    return ahead / np.linalg.norm(ahead)


def bones(motion, frame, across):
    """To the right by ``across`` and up, from above the root's place on the ground."""
    points = world_by_matrices(motion)[0][frame]
    flat = np.stack([(points - points[0]) @ across, points[:, 1]], axis=1)
    return [flat[[parent, j]] for j, parent in enumerate(PARENTS) if j]


def drawn(axes, many):
    """f[count, bone, 2, 2] of the last clip, less where each pose stands."""
    lines = np.array(axes.collections[-1].get_segments()).reshape(many, -1, 2, 2)
    return lines - np.stack([axes.get_xticks(), np.zeros(many)], -1)[:, None, None]


def test_bones_from_the_side_and_from_in_front(tmp_path):
    motion = walker()
    ahead = ahead_of(motion)
    assert ahead[2] > 0.9
    for view, across in (("side", ahead), ("front", np.array([ahead[2], 0, -ahead[0]]))):
        figure = plot_poses(motion, count=4, view=view)
        (axes,) = figure.axes
        found = drawn(axes, 4)
        for lines, frame in zip(found, (0, 4, 8, 12), strict=True):
            np.testing.assert_allclose(lines, bones(motion, frame, across), atol=1e-9)
        places = axes.get_xticks()
        wide = np.ptp(found[..., 0])
        assert np.diff(places).min() > wide  # no pose reaches into the next
    assert [text.get_text() for text in axes.get_xticklabels()] == ["0", "0.2", "0.4", "0.6"]
    assert axes.get_xlabel() == "seconds"
    assert axes.get_ylabel() == "height, file's unit"
    assert axes.get_aspect() == 1.0
    assert legend_of(figure) == ["left", "right"]
    from matplotlib.colors import to_hex

    colours = [to_hex(c) for c in axes.collections[0].get_colors()[:5]]
    assert colours == [GREY, BLUE, BLUE, ORANGE, ORANGE]
    assert png(figure, tmp_path / "strip.png")


def test_two_clips_are_drawn_over_each_other():
    before, after = walker(), walker(scale=0.5)
    figure = plot_poses({"before": before, "$a$": after}, count=3)
    (axes,) = figure.axes
    assert legend_of(figure) == ["before", r"\$a\$"]
    assert len(axes.collections) == 2
    last = drawn(axes, 3)[2]
    np.testing.assert_allclose(last, bones(after, 12, ahead_of(before)), atol=1e-9)


def test_a_world_with_z_up_looks_alike():
    pictures = [plot_poses(m, count=3).axes[0] for m in (walker(), jm.reorient(walker(), "z"))]
    first, second = (drawn(axes, 3) for axes in pictures)
    np.testing.assert_allclose(first, second, atol=1e-9)


def test_one_frame_a_single_joint_and_no_sides():
    assert len(plot_poses(walker(1), count=5).axes[0].get_xticks()) == 1
    point = plot_poses(turning(np.zeros((3, 1, 3))), count=2)
    assert len(point.axes[0].collections[0].get_segments()) == 2
    assert legend_of(point) == []
    root = np.arange(9.0).reshape(3, 3) * np.array([1, 0, 0])
    bent = turning(np.zeros((3, 2, 3)), root, offsets=[[0, 0, 0], [0.5, 0, 0]])
    found = drawn(plot_poses(bent, count=1).axes[0], 1)
    np.testing.assert_allclose(found[0, 0], [[0, 0], [0.5, 0]], atol=1e-9)  # it goes along x


def test_refusals():
    with pytest.raises(ValueError, match="clips of 13 and 5 frames"):
        plot_poses({"a": walker(), "b": walker()[:5]})
    with pytest.raises(ValueError, match="plot_poses: count must be a whole number from 1"):
        plot_poses(walker(), count=0)
    with pytest.raises(ValueError, match="motions is empty"):
        plot_poses({})
