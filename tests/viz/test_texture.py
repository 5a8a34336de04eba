"""The colours are the angles of joints that turn about one axis."""

import numpy as np
import pytest

from jaxmotion.viz import plot_texture
from tests.viz.clips import SECOND, png, turning

FRAMES = 12
SWING = 30 * np.sin(2 * np.pi * np.arange(FRAMES) / FRAMES)


def swinging():
    vectors = np.zeros((FRAMES, 3, 3))
    vectors[:, 0, 1] = np.radians(50 * np.arange(FRAMES))  # yaw of the root: left out
    vectors[:, 1, 0] = np.radians(SWING + 40)
    vectors[:, 2] = -np.radians(SWING)[:, None] * np.array([0.6, 0.0, -0.8])
    return turning(
        vectors, np.random.default_rng(0).normal(size=(FRAMES, 3)), names=["hip", "$a$", "b"]
    )


def test_rows_are_angles_about_the_axis_of_each_joint(tmp_path):
    figure = plot_texture(swinging())
    axes, bar = figure.axes
    (image,) = axes.images
    found = np.asarray(image.get_array())
    wanted = np.stack([0 * SWING, SWING, SWING])
    np.testing.assert_allclose(found, wanted, atol=1e-6)
    assert image.get_clim() == pytest.approx((-30, 30))
    np.testing.assert_allclose(image.get_extent(), (-0.5 * SECOND, 11.5 * SECOND, 2.5, -0.5))
    assert [text.get_text() for text in axes.get_yticklabels()] == ["hip", "$a$", "b"]
    assert axes.get_xlabel() == "seconds"
    assert bar.get_ylabel() == "degrees from mean pose"
    assert png(figure, tmp_path / "texture.png")


def test_some_joints_a_still_clip_and_one_frame():
    axes = plot_texture(swinging(), joints=["b", 1]).axes[0]
    np.testing.assert_allclose(axes.images[0].get_array(), [SWING, SWING], atol=1e-6)
    still = turning(np.zeros((5, 2, 3)))
    for clip in (still, still[:1]):
        image = plot_texture(clip).axes[0].images[0]
        np.testing.assert_allclose(image.get_array(), np.zeros((2, len(clip))), atol=1e-6)
    with pytest.raises(ValueError, match="no joint is called 'c'"):
        plot_texture(still, joints=["c"])
