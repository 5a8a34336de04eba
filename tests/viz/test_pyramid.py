"""The rows are the levels of detail, and what each stores."""

import jax
import numpy as np
import pytest

from jaxmotion.multiresolution import build_pyramid, upsample
from jaxmotion.viz import plot_pyramid
from tests.helpers import no_shape_checks
from tests.viz.clips import SECOND, chordal_mean, png, turning, vectors_from

FRAMES = 17


def waving(frames=FRAMES):
    t = np.arange(frames)[:, None, None] / 3
    return turning(
        np.sin(t * np.array([1, 1.5, 0.5])) * np.array([0.2, 0.9, 0.3]) * np.ones(2)[:, None]
    )


def test_levels_and_details(tmp_path):
    motion = waving()
    pyramid = build_pyramid(motion, 2)
    figure = plot_pyramid(pyramid, "joint1")
    grid = np.array(figure.axes).reshape(3, 2)
    q = np.asarray(motion.rotations)[:, 1]
    middle, times = chordal_mean(q), SECOND * np.arange(FRAMES)
    whole = vectors_from(middle, q)[:, 1]
    base = vectors_from(middle, upsample(pyramid.base, 2).rotations[:, 1])[:, 1]
    for axes, curve in zip(grid[[0, 2], 0], (base, whole), strict=True):
        np.testing.assert_allclose(axes.lines[-1].get_xdata(), times)
        np.testing.assert_allclose(axes.lines[-1].get_ydata(), curve, atol=1e-6)
    np.testing.assert_allclose(grid[1, 0].lines[0].get_ydata(), whole, atol=1e-6)
    assert not grid[0, 1].axison
    for level, axes in enumerate(grid[1:, 1]):
        detail = np.asarray(pyramid.details[level].rotations)[:, 1, 1]
        step = 2 ** (1 - level)
        np.testing.assert_allclose(axes.lines[-1].get_xdata(), times[::step])
        np.testing.assert_allclose(axes.lines[-1].get_ydata(), 2 * np.degrees(detail))
        assert axes.get_title(loc="left") == f"detail {level + 1} of 2: {[9, 17][level]} frames"
    assert figure.get_supylabel() == "joint1 about y, degrees"
    assert [axes.get_xlabel() for axes in grid[-1]] == ["seconds", "seconds"]
    assert png(figure, tmp_path / "levels.png")


def test_of_a_lazy_pyramid_odd_frames_have_details():
    pyramid = build_pyramid(waving(), 2, lazy=True)
    for level, axes in enumerate(np.array(plot_pyramid(pyramid, 1, axis="x").axes)[[3, 5]]):
        step = 2 ** (1 - level)
        line = axes.lines[-1]
        np.testing.assert_allclose(line.get_xdata(), SECOND * np.arange(step, FRAMES, 2 * step))
        detail = np.asarray(pyramid.details[level].rotations)[:, 1, 0]
        np.testing.assert_allclose(
            line.get_ydata(), 2 * np.degrees(detail)[: len(line.get_xdata())]
        )


def test_padding_uneven_times_and_no_levels():
    padded = build_pyramid(waving(), 1, length=10)
    ends = [axes.lines[-1].get_xdata()[-1] for axes in plot_pyramid(padded, 0).axes if axes.axison]
    np.testing.assert_allclose(ends, 3 * [9 * SECOND])
    times = np.cumsum(np.random.default_rng(0).uniform(1, 2, FRAMES))
    figure = plot_pyramid(build_pyramid(waving(), 1, times=times), 0)
    np.testing.assert_allclose(figure.axes[2].lines[0].get_xdata(), times)
    np.testing.assert_allclose(figure.axes[3].lines[-1].get_xdata(), times)
    assert figure.axes[2].get_xlabel() == "time, unit of the pyramid's"
    assert len(plot_pyramid(build_pyramid(waving(1)), 0).axes) == 2


def test_refusals():
    pyramid = build_pyramid(waving(), 1)
    with no_shape_checks(), pytest.raises(ValueError, match="plot_pyramid: pyramid is a Motion"):
        plot_pyramid(waving(), 0)
    with pytest.raises(ValueError, match="plot_pyramid: pyramid is traced"):
        jax.eval_shape(lambda p: plot_pyramid(p, 0), pyramid)
    with pytest.raises(ValueError, match="plot_pyramid: joint=2; expected 0 to 1"):
        plot_pyramid(pyramid, 2)
