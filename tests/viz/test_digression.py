"""The pictures show what was found, and what was done about it."""

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cleaning import DetectedErrors, Digression, Repaired
from jaxmotion.viz import plot_digression, plot_repair
from tests.helpers import random_motion

NAMES = ["hip", "$arm$", "hand", "hob\x1bble"]


def four_joints(frames=20):
    motion = random_motion(np.random.default_rng(0), frames=frames, skeleton=4)
    skeleton = jm.Skeleton(NAMES, motion.skeleton.parents, motion.skeleton.offsets)
    return motion.replace(skeleton=skeleton)


def errors_of(motion):
    """Two joints on end in error in two runs, one of them of one frame."""
    shape = motion.rotations.shape[:2]
    mask = np.zeros(shape, bool)
    mask[3:6, 1] = mask[4:7, 2] = mask[12, 2] = True
    mdm = np.random.default_rng(1).uniform(0, 0.4, shape) + 0.5 * mask
    mdm[:, 3] = 0
    return DetectedErrors(mask, mdm, mdm, {"digression": mask}, motion)


def map_of(mdm):
    residual = np.zeros((*mdm.shape, 3))
    return Digression(mdm, mdm, residual, np.zeros((*mdm.shape, 4)), {}, 1)


def png(figure, path):
    figure.savefig(path)
    return path.read_bytes().startswith(b"\x89PNG")


def edges(mask, second):
    """What bounds the entries that are set, each by its sides that no neighbour shares."""
    sides = set()
    for t, j in np.argwhere(mask):
        for a, b in (((0, 0), (0, 1)), ((1, 0), (1, 1)), ((0, 0), (1, 0)), ((0, 1), (1, 1))):
            sides ^= {((t + a[0], j + a[1]), (t + b[0], j + b[1]))}
    return {tuple(((t - 0.5) * second, j - 0.5) for t, j in side) for side in sides}


def rounded(lines):
    return {tuple(tuple(np.round(point, 9).tolist()) for point in line) for line in lines}


def test_the_map_and_the_outlines_of_errors(tmp_path):
    motion = four_joints()
    found = errors_of(motion)
    second = float(motion.frame_time)
    figure = plot_digression(found)
    axes, bar = figure.axes
    (image,) = axes.images
    np.testing.assert_array_equal(image.get_array(), np.asarray(found.mdm).T)
    assert image.get_clim() == (0, 1)
    np.testing.assert_allclose(image.get_extent(), (-0.5 * second, 19.5 * second, 3.5, -0.5))
    (lines,) = axes.collections
    assert rounded(lines.get_segments()) == rounded(edges(np.asarray(found.mask), second))
    bars = [line.get_xdata() for line in axes.lines]
    np.testing.assert_allclose(bars, second * np.array([[2.5, 6.5], [11.5, 12.5]]))
    labels = [text.get_text() for text in axes.get_yticklabels()]
    assert labels == ["hip", "$arm$", "hand", r"hob\x1bble"]
    assert axes.get_xlabel() == "seconds"
    assert "digression" in bar.get_ylabel()
    assert axes.get_title(loc="left") == "2 runs of errors, 8.8 % of joint-frames"
    assert png(figure, tmp_path / "map.png")


def test_a_map_without_a_motion_has_frames_and_numbers():
    motion = four_joints()
    found = map_of(np.asarray(errors_of(motion).mdm))
    axes, _ = plot_digression(found).axes
    assert axes.get_xlabel() == "frame"
    assert [text.get_text() for text in axes.get_yticklabels()] == list("0123")
    assert not axes.lines
    axes, _ = plot_digression(found, motion=motion, joints=["hand", 0]).axes
    assert [text.get_text() for text in axes.get_yticklabels()] == ["hand", "hip"]
    np.testing.assert_array_equal(axes.images[0].get_array(), np.asarray(found.mdm).T[[2, 0]])
    with pytest.raises(ValueError, match="'hand' is a name; give the motion too"):
        plot_digression(found, joints=["hand"])
    with pytest.raises(ValueError, match=r"joints=\[9\]; expected some of 4 joints"):
        plot_digression(found, joints=[9])
    with pytest.raises(ValueError, match="has 5 frames of 4 joints, the map 20 of 4"):
        plot_digression(found, motion=motion[:5])


def test_of_many_joints_those_that_tell():
    mdm = np.zeros((9, 100))
    mdm[:, [7, 40]] = 0.1
    axes, _ = plot_digression(map_of(mdm)).axes
    assert [text.get_text() for text in axes.get_yticklabels()] == ["7", "40"]
    axes, _ = plot_digression(map_of(np.zeros((9, 100)))).axes
    assert axes.images[0].get_array().shape == (100, 9)


def test_nothing_found():
    motion = four_joints()
    none = np.zeros(motion.rotations.shape[:2])
    axes, _ = plot_digression(DetectedErrors(none > 0, none, none, {}, motion)).axes
    assert axes.get_title(loc="left") == "no errors found"
    assert not axes.lines


def turned(motion, mask, by):
    """The motion with those entries turned by so many degrees about x."""
    half = np.radians(by) / 2 * mask
    turn = np.stack([np.cos(half), np.sin(half), 0 * half, 0 * half], -1)
    return motion.with_transforms(rotations=jm.quaternion.multiply(motion.rotations, turn))


def test_curves_of_a_run(tmp_path):
    motion = four_joints(90)
    mask = np.zeros((90, 4), bool)
    mask[40:44, 1] = mask[41:43, 3] = mask[70, 2] = True
    repaired = Repaired(motion, mask, turned(motion, mask, 30), None)
    second, around = float(motion.frame_time), round(float(motion.fps))
    figure = plot_repair(repaired)
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["$arm$", r"hob\x1bble"]
    assert figure.get_suptitle() == "frames 40 to 43, by up to 30°"
    first, last = max(40 - around, 0), min(44 + around, 90)
    for axes, joint in zip(figure.axes, (1, 3), strict=True):
        old, new = axes.lines
        np.testing.assert_allclose(old.get_xdata(), second * np.arange(first, last))
        q = np.asarray(motion.rotations)[:, joint]
        middle = np.linalg.eigh(q.T @ q)[1][:, -1]  # the chordal mean
        angle = np.degrees(2 * np.arccos(np.minimum(np.abs(q @ middle), 1)))
        np.testing.assert_allclose(new.get_ydata(), angle[first:last], atol=1e-4)
        apart = np.abs(old.get_ydata() - new.get_ydata()) > 1e-6
        np.testing.assert_array_equal(apart, mask[first:last, joint])
        spans = [patch.get_x() + patch.get_width() / 2 for patch in axes.patches]
        np.testing.assert_allclose(spans, second * np.flatnonzero(mask[:44, joint]))
    assert png(figure, tmp_path / "run.png")
    assert plot_repair(repaired, run=-1).get_suptitle() == "frame 70, by up to 30°"
    with pytest.raises(ValueError, match="run=2; there are 2 runs"):
        plot_repair(repaired, run=2)


def test_of_many_joints_those_changed_most():
    motion = random_motion(np.random.default_rng(0), frames=9, skeleton=12)
    mask = np.zeros((9, motion.num_joints), bool)
    mask[4] = True
    degrees = np.random.default_rng(2).permutation(motion.num_joints) + 5.0
    figure = plot_repair(Repaired(motion, mask, turned(motion, mask, degrees), None))
    most = sorted(np.argsort(-degrees)[:6])
    shown = [axes.get_title(loc="left") for axes in figure.axes]
    assert shown == [motion.skeleton.names[j] for j in most]
    assert figure.get_suptitle().endswith(f"and {motion.num_joints - 6} more joints")
