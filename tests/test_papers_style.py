"""What benchmarks/papers judges styles and cleaning by is what it says, by small cases."""

from pathlib import Path

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cleaning.levels import examined
from tests.helpers import random_motion

FOLDER = Path(__file__).parents[1] / "benchmarks" / "papers"

pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason="no benchmarks beside the tests")


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture(scope="module")
def walk():
    return jm.samples.load("walk", fps=24.0, num_frames=96).motion


def test_roughness_is_the_greatest_acceleration(script, rng):
    motion = random_motion(rng, frames=20, skeleton=5)
    angle = 0.5 * 3.0 * np.asarray(motion.times) ** 2
    q = np.tile([1.0, 0, 0, 0], (20, 5, 1))
    q[:, 3, 0], q[:, 3, 2] = np.cos(angle / 2), np.sin(angle / 2)
    found = script("wu_figure_2").roughness(motion.with_transforms(rotations=q))
    np.testing.assert_allclose(found, 3.0, rtol=1e-6)


@pytest.mark.parametrize("order", [None, "XYZ", "YZX"])
def test_euler_angles_of_a_clip_on_itself_are_the_clip(script, walk, order):
    """But for the body, which goes as ours does, and joints held still."""
    made = script("style_arrives").euler(walk[:40], walk[:40], order)
    np.testing.assert_allclose(jm.metrics.turn(made.rotations, walk[:40].rotations), 0, atol=1e-6)


def test_words_at_seams_are_not_counted(script):
    cut = script("fifteen_seconds")
    made = np.zeros(cut.FRAMES, bool)
    made[100:112] = True
    counted = cut.Clip(None, made, "").counted
    starts = np.arange(0, cut.FRAMES - cut.WORD + 1, cut.STRIDE)
    np.testing.assert_array_equal(counted, (starts + 15 <= 100) | (starts >= 112))


def test_maps_are_those_of_the_library(script, walk):
    """Made of one search, of eight neighbours and of five."""
    broken = jm.samples.offset_joints(walk, jax.random.key(0), runs=2).motion
    evidence = examined("test", broken, [walk[:60]], 8)
    masks = dict(script("aristidou_table_1").maps(evidence.setting, evidence.found, "pose"))
    map_ = jm.cleaning.digression_map(broken, [walk[:60]])
    np.testing.assert_array_equal(masks["ours"], map_.digression > 0.5)
    map_ = jm.cleaning.digression_map(broken, [walk[:60]], k=5, normalise="row_mean")
    np.testing.assert_array_equal(masks["published, pose"], map_.mdm > 0.5)
    assert masks["ours"].any()


def test_verdicts_on_contexts(script):
    table = script("aristidou_table_1")
    pairs = table.PRINTED["locomotion"]["ours"]

    def lines(*measured):
        names = "recall", "precision", "printed recall", "printed precision"
        both = zip(measured, pairs, strict=True)
        return [dict(zip(names, (*own, *printed), strict=True)) for own, printed in both]

    assert table.of_ours(lines((1, 0.9), (1, 0.95), (1, 0.96))) == "better"
    assert table.of_ours(lines((0.9, 0.8), (0.95, 0.9), (0.96, 0.9))) == "reproduced"
    assert table.of_ours(lines((0.9, 0.95), (0.95, 0.9), (0.96, 0.9))) == "refuted"
    assert table.of_ours(lines((0.9, 0.8), (0.92, 0.8), (0.93, 0.8))) == "refuted"


def test_a_clip_is_nearest_to_itself(script, walk):
    q = np.asarray(walk[:20].rotations)
    signs = np.random.default_rng(1).choice([-1.0, 1.0], (20, q.shape[1], 1))
    found = script("aristidou_figure_12").nearest(q, signs * q)
    np.testing.assert_array_equal(found, np.arange(20))


def test_a_blind_map_clears_nothing(script, capsys):
    figure = script("aristidou_figure_9")
    rows = [{"rule": "map", "clip": "bow", "local": 0.5, "larger": 0.1}]
    wrong, change = np.ones(10, bool), np.ones(10)
    verdicts = [
        figure.item("map", rows, [(np.arange(10) < count, wrong, change)])["verdict"]
        for count in (3, 9)
    ]
    assert verdicts == ["refuted", "reproduced"]
    assert "Figure 9" in capsys.readouterr().out
