"""The picture holds the cost, and the path through it, of each kind of warp."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.timing import Alignment, MotionWarp, WarpPath
from jaxmotion.viz import plot_cost_matrix
from tests.helpers import no_shape_checks
from tests.viz.clips import png, turning

COST = np.random.default_rng(0).uniform(0, 2, (4, 6))
CELLS = np.array([[0, 0], [1, 1], [1, 2], [2, 3], [3, 4], [3, 5]])


def path_of(cells=CELLS, length=None):
    filled = np.concatenate([cells, np.repeat(cells[-1:], 3, axis=0)])
    length = len(cells) if length is None else length
    return WarpPath(jnp.ones(()), jnp.asarray(filled), jnp.asarray(length))


def drawn(path, **options):
    figure = plot_cost_matrix(COST, path, **options)
    axes, _ = figure.axes
    np.testing.assert_array_equal(axes.images[0].get_array(), COST)
    return axes


def test_the_cost_and_the_path(tmp_path):
    axes = drawn(path_of(), source="$a$", reference="b\x1b", label="radians²")
    for line in axes.lines:
        np.testing.assert_array_equal(line.get_xydata(), CELLS[:, ::-1])
    assert axes.get_xlim() == (-0.5, 5.5)
    assert axes.get_ylim() == (-0.5, 3.5)
    assert axes.images[0].origin == "lower"
    assert axes.get_xlabel() == r"frame of b\x1b"
    assert axes.get_ylabel() == "frame of $a$"
    assert axes.figure.axes[1].get_ylabel() == "radians²"
    assert png(axes.figure, tmp_path / "cost.png")


def test_alignments_and_motion_warps():
    one, still = jnp.ones(()), turning(np.zeros((6, 1, 3)))
    found = Alignment(still, jnp.zeros(6), path_of().path, jnp.asarray(6), one)
    np.testing.assert_array_equal(drawn(found).lines[1].get_xydata(), CELLS[:, ::-1])
    runs = jnp.array([2, 1, 5, 4])  # of frames repeated twice
    ones = jnp.ones((4, 1))
    warp = MotionWarp(runs, ones, ones, ones[:, 0], one > 0, one.astype(int), 2, 12)
    pairs = [[0, 0], [0, 0], [1, 1], *([2, j // 2] for j in range(3, 8))]
    pairs += [[3, j // 2] for j in range(8, 12)]
    np.testing.assert_array_equal(drawn(warp).lines[1].get_xydata(), np.array(pairs)[:, ::-1])
    each = MotionWarp(ones.astype(int), ones, ones, ones, one > 0, one.astype(int), 2, 12)
    with pytest.raises(ValueError, match="path has a warp for each channel"):
        plot_cost_matrix(COST, each)


def test_no_path_one_cell_and_what_is_not_finite():
    assert not drawn(None).lines
    assert not drawn(path_of(length=0)).lines
    cost = np.array([[np.inf]])
    axes, _ = plot_cost_matrix(cost, path_of(CELLS[:1])).axes
    assert np.ma.getmaskarray(axes.images[0].get_array()).all()
    assert cost[0, 0] == np.inf


def test_refusals():
    wrong = [
        ((COST[:3], path_of()), r"path reaches the frames \(3, 5\); the cost is of 3 and 6 fr"),
        ((COST[0], None), r"cost has shape \(6,\); expected \(n, m\)"),
        ((COST, CELLS), r"path is an array of shape \(6, 2\); expected a WarpPath, Alignment or"),
        ((path_of(), None), "cost is a WarpPath; expected an array"),
    ]
    for given, message in wrong:
        with no_shape_checks(), pytest.raises(ValueError, match=message):
            plot_cost_matrix(*given)
