"""Turned pyramids of motions are right to rounding, of Euler angles only about their first axis."""

import numpy as np
import pytest

from jaxmotion.viz import plot_invariance
from tests.viz.clips import png, turning


def tumbling(frames=17, up="y"):
    t = np.arange(frames)[:, None, None] / 3
    return turning(np.sin(t + np.arange(6).reshape(1, 2, 3)) * 0.7, up=up)


def errors(figure):
    return {line.get_label(): line.get_ydata() for line in figure.axes[0].lines}


def test_errors_of_four_ways(tmp_path):
    figure = plot_invariance(tumbling(), 2)
    (axes,) = figure.axes
    found = errors(figure)
    assert list(found) == ["this library", *(f"Euler angles, {o}" for o in ("XYZ", "ZXY", "YXZ"))]
    for line in axes.lines:
        np.testing.assert_allclose(line.get_xdata(), 15.0 * np.arange(1, 10))
    assert found["this library"].max() < 1e-11
    assert found["Euler angles, YXZ"].max() < 1e-11
    assert found["Euler angles, XYZ"].min() > 0.1
    assert found["Euler angles, ZXY"].min() > 0.1
    assert axes.get_yscale() == "log"
    assert axes.get_xlabel() == "turned about y, degrees"
    assert axes.get_ylabel() == "largest error of the root, degrees"
    assert png(figure, tmp_path / "turned.png")


def test_the_vertical_of_another_world_comes_first_in_another_order():
    figure = plot_invariance(tumbling(up="z"), 2, angles=[90.0], orders=["ZXY", "YXZ"])
    found = errors(figure)
    assert figure.axes[0].get_xlabel() == "turned about z, degrees"
    assert found["this library"][0] < 1e-11 > found["Euler angles, ZXY"][0]
    assert found["Euler angles, YXZ"][0] > 0.1


def test_turns_about_the_vertical_alone_suit_every_order():
    yaw = np.zeros((17, 2, 3))
    yaw[:, 0, 1] = 0.4 * np.sin(np.arange(17))
    found = errors(plot_invariance(turning(yaw), 2, angles=[0.0, 30.0], orders=["YXZ", "XYZ"]))
    assert max(curve.max() for curve in found.values()) < 1e-6
    still = errors(plot_invariance(turning(0 * yaw[:1]), angles=[30.0], orders=["ZXY"]))
    assert max(curve.max() for curve in still.values()) < 1e-6


def test_refusals():
    for wrong in ([], [np.nan]):
        with pytest.raises(ValueError, match="expected some degrees"):
            plot_invariance(tumbling(), angles=wrong)
    with pytest.raises(ValueError, match="order='XXY'"):
        plot_invariance(tumbling(), 2, angles=[1.0], orders=["XXY"])
