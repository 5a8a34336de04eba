"""The warp drawn goes through the times given, and speeds are those of the joints."""

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.viz import plot_time_warp
from tests.helpers import angle_between
from tests.viz.clips import SECOND, legend_of, png, turning


def waving(frames=21):
    t = np.arange(frames)[:, None, None] / 5
    return turning(0.5 * np.sin(t + np.arange(6).reshape(1, 2, 3)))


def mean_turn(motion):
    q = np.asarray(motion.rotations)
    return np.degrees(angle_between(q[:-1], q[1:]).mean(axis=1)) / SECOND


def test_times_given_and_speeds(tmp_path):
    motion, pairs = waving(), [[0.2, 0.5], [0.6, 0.8]]
    figure = plot_time_warp(motion, pairs=pairs)
    above, below = figure.axes
    straight, warped, given = above.lines
    np.testing.assert_allclose(straight.get_xydata(), [[0, 0], [1, 1]])
    np.testing.assert_allclose(given.get_xydata(), [[0.5, 0.2], [0.8, 0.6]], atol=1e-6)
    times = SECOND * np.arange(25)
    np.testing.assert_allclose(warped.get_xdata(), times)
    at = np.interp([0, 0.5, 0.8, 1.2], times, warped.get_ydata())
    np.testing.assert_allclose(at, [0, 0.2, 0.6, 1.0], atol=1e-6)
    result = jm.time_warp(motion, pairs=pairs)
    for line, clip in zip(below.lines, (motion, result), strict=True):
        between = SECOND * (np.arange(clip.num_frames - 1) + 0.5)
        np.testing.assert_allclose(line.get_xdata(), between)
        np.testing.assert_allclose(line.get_ydata(), mean_turn(clip), atol=1e-6)
    assert above.get_ylabel() == "seconds of the clip"
    assert below.get_ylabel() == "mean turn, degrees a second"
    assert below.get_xlabel() == "seconds of the result"
    assert legend_of(figure) == ["as it was", "warped", "pairs"]
    assert png(figure, tmp_path / "warp.png")


def test_easing_moves_what_was_given():
    """By half of the time eased: the marks stay on the curve."""
    axes = plot_time_warp(waving(), pairs=[[0.4, 0.5]], ease=(0.2, 0.0)).axes[0]
    np.testing.assert_allclose(axes.lines[2].get_xydata(), [[0.6, 0.4]], atol=1e-6)


def test_no_warp_a_still_clip_and_one_frame():
    above, _ = plot_time_warp(waving(), amount=0.0).axes
    np.testing.assert_allclose(above.lines[1].get_ydata(), above.lines[1].get_xdata(), atol=1e-9)
    still = turning(np.zeros((9, 2, 3)))
    for line in plot_time_warp(still, amount=0.5).axes[1].lines:
        np.testing.assert_allclose(line.get_ydata(), 0, atol=1e-6)
    assert plot_time_warp(still[:1]).axes[0].lines[1].get_xdata().tolist() == [0.0]


def test_refusals():
    with pytest.raises(ValueError, match="amount and pairs are both given"):
        plot_time_warp(waving(), amount=0.5, pairs=[[0.2, 0.5]])
