"""The errors drawn are those of dense solves and of 4x4 matrices."""

import numpy as np
import pytest

from jaxmotion.viz import plot_denoising_error
from tests.helpers import random_skeleton, world_by_matrices
from tests.viz.clips import SECOND, legend_of, png, prior_rows, turning

FRAMES, RATE = 15, 1 / SECOND


def clips():
    rng = np.random.default_rng(0)
    where = random_skeleton(rng, 4)
    times = np.arange(FRAMES)[:, None, None] / 4
    vectors = 0.4 * np.sin(times + rng.uniform(0, 6, (1, 4, 3)))
    shape = {"parents": where.parents, "offsets": where.offsets}
    noise = rng.normal(0, 0.05, vectors.shape)
    return turning(vectors, **shape), turning(vectors + noise, noise[:, 0], **shape)


def error(motion, truth):
    apart = world_by_matrices(motion)[0] - world_by_matrices(truth)[0]
    return np.linalg.norm(apart, axis=-1).mean()


def smoothed(motion, cutoff):
    """Eq. 6 by a dense solve whose response is a half at the cut-off."""
    product = 1 / (1 - np.cos(2 * np.pi * cutoff / RATE))
    rows = product * prior_rows(FRAMES)
    solve = np.linalg.inv(rows.T @ rows + np.eye(FRAMES))
    q = np.einsum("ts,sjc->tjc", solve, motion.rotations)
    root = solve @ np.asarray(motion.translations)[:, 0]
    translations = np.asarray(motion.translations).copy()
    translations[:, 0] = root
    return motion.with_transforms(translations, q / np.linalg.norm(q, axis=-1, keepdims=True))


def test_errors_of_the_smoother_of_filters_and_of_results(tmp_path):
    truth, noisy = clips()
    asked = []

    def halved(motion, cutoff):
        asked.append(cutoff)
        return motion.with_transforms(0.5 * motion.translations)

    at = [2.0, 5.0, 9.0]
    results = {"other": halved(noisy, 0.0)}
    figure = plot_denoising_error(
        truth, noisy, cutoffs=at, filters={"$half$": halved}, denoised=results
    )
    (axes,) = figure.axes
    smooth, other, given, result = axes.lines
    assert asked == [0.0, *at]
    np.testing.assert_allclose(smooth.get_xdata(), at)
    wanted = [error(smoothed(noisy, f), truth) for f in at]
    np.testing.assert_allclose(smooth.get_ydata(), wanted, rtol=1e-9)
    half = error(noisy.with_transforms(0.5 * noisy.translations), truth)
    np.testing.assert_allclose(other.get_ydata(), 3 * [half])
    np.testing.assert_allclose(given.get_ydata(), error(noisy, truth))
    np.testing.assert_allclose(result.get_ydata(), half)
    assert axes.get_xlabel() == "cut-off, Hz"
    assert axes.get_ylabel() == "mean joint error, file's unit"
    assert legend_of(figure) == ["LGS, one λσ", r"\$half\$", "noisy", "other"]
    assert png(figure, tmp_path / "error.png")


def test_by_default_from_a_hundredth_of_the_rate_to_half_of_it():
    truth, noisy = clips()
    at = plot_denoising_error(truth, noisy).axes[0].lines[0].get_xdata()
    assert len(at) == 16
    assert at[0] == pytest.approx(0.01 * RATE)
    assert at[-1] < RATE / 2


def test_refusals():
    truth, noisy = clips()
    for wrong in ([0.0], [RATE / 2], [], [[1.0]]):
        with pytest.raises(ValueError, match="expected Hz above 0 and below 10, half the frame"):
            plot_denoising_error(truth, noisy, cutoffs=wrong)
    with pytest.raises(ValueError, match="noisy has 5 frames of 4 joints, the truth 15 of 4"):
        plot_denoising_error(truth, noisy[:5])
    with pytest.raises(ValueError, match=r"filters\['cut'\] has 3 frames"):
        plot_denoising_error(truth, noisy, cutoffs=[2.0], filters={"cut": lambda m, _: m[:3]})
