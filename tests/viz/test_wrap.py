"""Rotation vectors are wrong where they wrap, quaternions are not; both drawn as they are."""

import numpy as np
import pytest

from jaxmotion.viz import plot_wrap
from tests.helpers import scipy_rotation
from tests.viz.clips import SECOND, about, legend_of, png, prior_rows, turning

FRAMES, LAM = 21, 2.0


def swinging(noise=0.0):
    degrees = 180 + 40 * np.sin(np.arange(FRAMES) / 3)
    vectors = about("y", degrees) + np.random.default_rng(0).normal(0, noise, (FRAMES, 3))
    return turning(np.stack([0.1 * vectors, vectors], axis=1))


def smooth_components(x):
    rows = LAM * prior_rows(FRAMES)
    return np.linalg.solve(rows.T @ rows + np.eye(FRAMES), x)


def test_both_ways_beside_what_is_given(tmp_path):
    truth, noisy = swinging(), swinging(0.02)
    figure = plot_wrap(noisy, "joint1", lam=LAM, truth=truth)
    above, below = figure.axes
    dots, vectors, quaternions = above.lines
    q = np.asarray(noisy.rotations)[:, 1]
    given = scipy_rotation(q).as_rotvec()
    np.testing.assert_allclose(dots.get_xdata(), SECOND * np.arange(FRAMES))
    np.testing.assert_allclose(dots.get_ydata(), np.degrees(given[:, 1]), atol=1e-6)
    by_vectors = smooth_components(given)
    signs = np.cumprod(np.r_[1, np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1, 1)])
    by_quaternions = smooth_components(signs[:, None] * q)
    right = scipy_rotation(truth.rotations[:, 1])
    from scipy.spatial.transform import Rotation

    found = Rotation.from_rotvec(by_vectors), scipy_rotation(by_quaternions)
    errors = [np.degrees((right.inv() * r).magnitude()) for r in found]
    for line, error in zip(below.lines, errors, strict=True):
        np.testing.assert_allclose(line.get_ydata(), error, atol=1e-6)
    assert errors[0].max() > 90 > 5 > errors[1].max()
    for line, r in zip((vectors, quaternions), found, strict=True):
        drawn, whole = line.get_ydata(), np.degrees(r.as_rotvec()[:, 1])
        gap = np.isnan(drawn)
        np.testing.assert_allclose(drawn[~gap], whole[~gap], atol=1e-6)
        assert gap.sum() == np.sum(np.abs(np.diff(whole)) > 180)
    assert np.isnan(quaternions.get_ydata()).any()
    assert above.get_ylabel() == "rotation vector, y, degrees"
    assert below.get_ylabel() == "off the truth, degrees"
    assert below.get_xlabel() == "seconds"
    assert f"{errors[1].max():.3g}° by quaternions" in below.get_title(loc="left")
    assert legend_of(figure) == ["as given", "by rotation vectors", "by quaternions"]
    assert png(figure, tmp_path / "wrap.png")


def test_a_still_joint_is_right_both_ways():
    still = turning(np.zeros((FRAMES, 2, 3)))
    above, below = plot_wrap(still, 1).axes
    for line in (*above.lines, *below.lines):
        np.testing.assert_allclose(line.get_ydata(), 0, atol=1e-6)
    assert below.get_ylabel() == "off what is given, degrees"


def test_refusals():
    motion = swinging()
    with pytest.raises(ValueError, match=r"truth has rotations of shape \(4, 2, 4\)"):
        plot_wrap(motion, 0, truth=motion[:4])
    with pytest.raises(ValueError, match="joint=-1; expected 0 to 1"):
        plot_wrap(motion, -1)
