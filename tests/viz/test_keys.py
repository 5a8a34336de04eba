"""Between keys a joint turns as the closed form says: the long way, the short way, straight."""

import numpy as np
import pytest

from jaxmotion.viz import plot_key_interpolation
from tests.viz.clips import SECOND, about, legend_of, png, turning

AT, DEGREES = np.array([0, 4, 8, 12, 16]), np.array([0.0, 60.0, 260.0, 320.0, 380.0])


def spun(degrees):
    return turning(np.stack([0 * about("z", degrees), about("z", degrees)], axis=1))


def test_the_way_round(tmp_path):
    whole = np.interp(np.arange(17), AT, DEGREES)
    figure = plot_key_interpolation(spun(DEGREES), AT, "joint1", truth=spun(whole))
    (axes,) = figure.axes
    truth, least, nearest, slerp, keys = axes.lines
    for line in (truth, least, nearest, slerp):
        np.testing.assert_allclose(line.get_xdata(), SECOND * np.arange(17))
    np.testing.assert_allclose(truth.get_ydata(), whole, atol=1e-6)
    np.testing.assert_allclose(least.get_ydata()[AT], DEGREES, atol=1e-6)
    short = np.array([0.0, 60.0, -100.0, -40.0, 20.0])
    np.testing.assert_allclose(nearest.get_ydata()[AT], short, atol=1e-6)
    straight = np.interp(np.arange(17), AT, short)
    np.testing.assert_allclose(slerp.get_ydata(), straight, atol=1e-6)
    np.testing.assert_allclose(keys.get_xydata(), np.stack([SECOND * AT, DEGREES], 1), atol=1e-6)
    assert axes.get_xlabel() == "seconds"
    assert axes.get_ylabel() == "turned about z, degrees"
    assert legend_of(figure)[0] == "truth"
    assert png(figure, tmp_path / "keys.png")


def test_a_still_joint_and_frames_after_the_last_key():
    axes = plot_key_interpolation(spun(DEGREES), AT, 0, num_frames=20, axis="x").axes[0]
    least, nearest, slerp, keys = axes.lines
    for line in (least, nearest, slerp):
        np.testing.assert_allclose(line.get_ydata(), np.zeros(20), atol=1e-6)
    assert len(keys.get_xdata()) == 5


def test_refusals():
    keys = spun(DEGREES)
    for wrong in (AT + 1, AT[:3]):
        with pytest.raises(ValueError, match="expected 5 known frames, one a key, the first 0"):
            plot_key_interpolation(keys, wrong, 0)
    with pytest.raises(ValueError, match="index must increase strictly"):
        plot_key_interpolation(keys, [0, 4, 4, 5, 6], 0)
