"""About the seam stand the clips as they are, and as stitch makes them."""

import numpy as np
import pytest

from jaxmotion.multiresolution import stitch
from jaxmotion.viz import plot_seam
from tests.viz.clips import SECOND, chordal_mean, legend_of, png, turning, vectors_from

FRAMES, JOINTS, LEVELS = 21, 6, 2
JUMPS = np.array([0.0, 30.0, 5.0, 60.0, 10.0, 20.0])  # degrees about x from clip to clip


def clips():
    t = np.arange(FRAMES)[:, None, None] / 6
    swing = 0.2 * np.sin(t + np.arange(JOINTS)[None, :, None]) * np.array([1.0, 0.2, 0.0])
    first = swing + 0.0
    second = swing - swing[:1] + swing[-1:]
    second[..., 0] += np.radians(JUMPS)
    return turning(first), turning(second)


def test_before_and_after(tmp_path):
    first, second = clips()
    figure = plot_seam([first, second], LEVELS, align=False)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles == ["joint1", "joint3", "joint4", "joint5"]
    result = stitch([first, second], LEVELS, align=False)
    around = round(0.75 / SECOND)
    seam, low = FRAMES - 1, FRAMES - 1 - around
    times = SECOND * np.arange(-around, around + 1)
    for axes, joint in zip(figure.axes, (1, 3, 4, 5), strict=True):
        line, left, right, new = axes.lines
        np.testing.assert_allclose(line.get_xdata(), [0, 0])
        stitched = np.asarray(result.rotations)[low : seam + around + 1, joint]
        middle = chordal_mean(stitched)
        np.testing.assert_allclose(new.get_xdata(), times, atol=1e-12)
        wanted = vectors_from(middle, stitched)[:, 0]
        np.testing.assert_allclose(new.get_ydata(), wanted, atol=1e-6)
        before = vectors_from(middle, first.rotations[low:seam, joint])[:, 0]
        after = vectors_from(middle, second.rotations[: around + 1, joint])[:, 0]
        np.testing.assert_allclose(left.get_xdata(), times[:around], atol=1e-12)
        np.testing.assert_allclose(left.get_ydata(), before, atol=1e-6)
        np.testing.assert_allclose(right.get_xdata(), times[around:], atol=1e-12)
        np.testing.assert_allclose(right.get_ydata(), after, atol=1e-6)
        assert axes.get_ylabel() == "about x"
    assert figure.axes[-1].get_xlabel() == "seconds from the seam"
    assert figure.get_supylabel() == "degrees from mean"
    assert legend_of(figure) == ["end to end", "stitched"]
    assert png(figure, tmp_path / "seam.png")


def test_another_seam_and_joints_that_are_asked_for():
    first, second = clips()
    figure = plot_seam([first, second, first], LEVELS, seam=-1, joints=["joint2", 0])
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["joint2", "joint0"]
    result = stitch([first, second, first], LEVELS)
    seam, around = 2 * (FRAMES - 1), round(0.75 / SECOND)
    q = np.asarray(result.rotations)[seam - around : seam + around + 1, 2]
    curve = vectors_from(chordal_mean(q), q)
    drawn = figure.axes[0].lines[-1].get_ydata()
    along = "xyz".index(figure.axes[0].get_ylabel()[-1])
    np.testing.assert_allclose(drawn, curve[:, along], atol=1e-6)


def test_refusals():
    first, second = clips()
    with pytest.raises(ValueError, match="seam=1; there are 1 seams"):
        plot_seam([first, second], seam=1)
    with pytest.raises(ValueError, match="plot_seam: motions must be a list of two clips"):
        plot_seam([first])
    with pytest.raises(ValueError, match="joint=6; expected 0 to 5"):
        plot_seam([first, second], joints=[6])
