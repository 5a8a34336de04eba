"""The picture has the layers of a joint, and the posterior's deviation by a dense inverse."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import MotionLayers
from jaxmotion.displacement import Displacement
from jaxmotion.smoothing import MotionTuning, Tuning
from jaxmotion.viz import plot_layers
from tests.helpers import no_shape_checks
from tests.viz.clips import (
    SECOND,
    about,
    chordal_mean,
    legend_of,
    png,
    prior_rows,
    turned_by,
    turning,
    vectors_from,
)

FRAMES, JOINTS = 11, 3
LAM, SIGMA = np.array([3.0, 2.0, 5.0]), np.array([0.1, 0.4, 0.2])


def some_layers(frames=FRAMES, tuning=None):
    rng = np.random.default_rng(0)
    parts = [rng.normal(0, 0.1, (2, frames, JOINTS, 3)) for _ in range(2)]
    parts[0][1, :, :, 2] *= 4
    base = turning(rng.normal(0, 0.2, (frames, JOINTS, 3)), rng.normal(size=(frames, 3)))
    control, residual = (Displacement(u, v) for u, v in parts)
    one = jnp.ones(())
    return MotionLayers(base, control, residual, one, one, jnp.zeros((), bool), tuning)


def learned(stiffness=None):
    lam, sigma = jnp.asarray(LAM), jnp.asarray(SIGMA)
    firm = None if stiffness is None else jnp.asarray(stiffness)
    return MotionTuning(Tuning(lam, sigma, lam, None, firm), Tuning(2 * lam, sigma, lam))


def deviation(lam, sigma, weights=None, stiffness=None):
    weights = np.ones(FRAMES) if weights is None else weights
    stiffness = np.ones(FRAMES) if stiffness is None else stiffness
    rows = stiffness[1:-1, None] * prior_rows(FRAMES)
    precision = lam**2 * rows.T @ rows + np.diag(weights) / sigma**2
    return np.sqrt(np.diag(np.linalg.inv(precision)))


def band(axes):
    """Half of its width by frame."""
    (patch,) = axes.collections
    corners = patch.get_paths()[0].vertices
    return np.array(
        [np.ptp(corners[np.isclose(corners[:, 0], t * SECOND), 1]) / 2 for t in range(FRAMES)]
    )


def test_curves_of_a_rotation(tmp_path):
    layers = some_layers()
    figure = plot_layers(layers, "joint1")
    whole, *parts = figure.axes
    base = np.asarray(layers.base.rotations)[:, 1]
    denoised = turned_by(base, layers.control.rotations[:, 1])
    captured = turned_by(denoised, layers.residual.rotations[:, 1])
    middle = chordal_mean(denoised)
    for line, q in zip(whole.lines, (captured, base, denoised), strict=True):
        np.testing.assert_allclose(line.get_xdata(), SECOND * np.arange(FRAMES))
        np.testing.assert_allclose(line.get_ydata(), vectors_from(middle, q)[:, 2], atol=1e-6)
    for axes, part in zip(parts, (layers.control, layers.residual), strict=True):
        drawn = axes.lines[-1].get_ydata()
        np.testing.assert_allclose(drawn, np.degrees(part.rotations[:, 1, 2]))
    assert legend_of(figure) == ["captured", "base", "denoised"]
    assert not whole.collections
    assert figure.get_supylabel() == "about z, degrees"
    assert parts[-1].get_xlabel() == "seconds"
    assert png(figure, tmp_path / "layers.png")


def test_the_band_is_two_deviations_of_the_angle():
    stiffness = np.random.default_rng(1).uniform(0.3, 2, (FRAMES, JOINTS))
    weights = np.random.default_rng(2).uniform(0.1, 1, (FRAMES, JOINTS))
    for given, firm in (({}, None), ({"weights": weights}, stiffness)):
        layers = some_layers(tuning=learned(firm))
        whole = plot_layers(layers, 1, **given).axes[0]
        options = [None if x is None else x[:, 1] for x in (given.get("weights"), firm)]
        wanted = 2 * np.degrees(2 * deviation(LAM[1], SIGMA[1], *options))
        np.testing.assert_allclose(band(whole), wanted, rtol=1e-6)
    assert legend_of(whole.figure)[-1] == "± 2 std of the posterior"


def test_translations_have_the_unit_of_the_file():
    layers = some_layers(tuning=learned())
    figure = plot_layers(layers, 0, channel="translation", axis="y")
    whole = figure.axes[0]
    base = np.asarray(layers.base.translations)[:, 0, 1]
    added = layers.control.translations[:, 0, 1], layers.residual.translations[:, 0, 1]
    for line, curve in zip(whole.lines, (base + sum(added), base, base + added[0]), strict=True):
        np.testing.assert_allclose(line.get_ydata(), curve)
    np.testing.assert_allclose(band(whole), 2 * deviation(2 * LAM[0], SIGMA[0]), rtol=1e-6)
    assert figure.get_supylabel() == "along y, file's unit"
    still = plot_layers(layers, 2, channel="translation").axes[0]
    assert not still.collections  # it is not translated: nothing was learned


def test_one_frame_and_turns_beyond_half_a_turn():
    assert len(plot_layers(some_layers(1), 0).axes) == 3
    base = turning(about("y", np.linspace(0, 540, 28))[:, None])
    none = Displacement(np.zeros((28, 1, 3)), np.zeros((28, 1, 3)))
    layers = MotionLayers(base, none, none, *jnp.ones((2, 1)), jnp.zeros(1, bool), None)
    curve = plot_layers(layers, 0, axis="y").axes[0].lines[0].get_ydata()
    np.testing.assert_allclose(np.diff(curve), 20, atol=1e-6)


def test_refusals():
    layers = some_layers(tuning=learned())
    wrong = [
        ({"joint": 3}, "joint=3; expected 0 to 2"),
        ({"joint": "knee"}, "no joint is called 'knee'"),
        ({"joint": 0, "axis": "w"}, "axis='w'; expected 'x', 'y', 'z' or None"),
        ({"joint": 0, "channel": "scale"}, "channel='scale'"),
        ({"joint": 0, "weights": np.ones(4)}, r"weights have shape \(4,\); expected \(11,\)"),
    ]
    for options, message in wrong:
        with no_shape_checks(), pytest.raises(ValueError, match=message):
            plot_layers(layers, **options)
    with no_shape_checks(), pytest.raises(ValueError, match="layers is a Motion; expected Motion"):
        plot_layers(layers.base, 0)
    with pytest.raises(ValueError, match="plot_layers: layers is traced"):
        jax.eval_shape(lambda x: plot_layers(x, 0), layers)
