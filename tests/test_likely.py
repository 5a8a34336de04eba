"""Numbers of another convention are told from a motion's own, and real captures from both."""

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import _likely
from jaxmotion.metrics import turn
from tests.helpers import scipy_rotation


@pytest.fixture(scope="module")
def rotations():
    return np.asarray(jm.samples.load("walk", num_frames=60).motion.rotations)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (30.0, "is it a rate, 30 frames a second?"),
        (23.976, "is it a rate, 23.976 frames a second?"),
        (100.0, "is it a rate, 100 frames a second?"),
        (8.333, "is it milliseconds, 120 frames a second?"),
        (33.3333, "is it milliseconds, 30 frames a second?"),
    ],
)
def test_rates_and_milliseconds_for_seconds(seconds, words):
    assert words in _likely.doubt_frame_time(seconds)


@pytest.mark.parametrize("seconds", [1 / 240, 1 / 30, 0.0417083, 1.0, 1.3, 7.0, 17.0])
def test_times_that_are_times(seconds):
    assert _likely.doubt_frame_time(seconds) == ""


def test_the_order_of_components(rotations):
    assert _likely.doubt_rotations(rotations) is None
    kind, text = _likely.doubt_rotations(np.roll(rotations, -1, -1))
    assert kind == "order"
    assert "(x, y, z, w)? quaternion.from_xyzw" in text
    assert _likely.doubt_rotations(np.roll(rotations, -1, -1)[:, :3]) is None  # too few joints


def test_turns_of_all_sizes_are_in_order():
    """Uniform on the sphere no component leads; half turns about z of a third of the joints."""
    q = np.random.default_rng(0).standard_normal((50, 8, 4))
    assert _likely.doubt_rotations(q / np.linalg.norm(q, axis=-1, keepdims=True)) is None
    turned = np.tile(np.eye(4)[0], (50, 9, 1))
    turned[:, :3] = np.eye(4)[3]
    assert _likely.doubt_rotations(turned) is None


def test_norms(rotations):
    kind, text = _likely.doubt_rotations(2 * rotations)
    assert kind == "norm"
    assert "norms of about 2," in text
    assert "scaled?" in text
    kind, text = _likely.doubt_rotations(90 * np.random.default_rng(0).random((9, 5, 4)))
    assert kind == "norm"
    assert "are they quaternions?" in text


def test_norms_that_are_let_be(rotations):
    printed = np.round(rotations, 4)
    padded = np.concatenate([rotations[:10], np.zeros_like(rotations[:50])])
    missing = np.where(np.arange(60)[:, None, None] < 30, np.nan, rotations)
    for q in (printed, padded, missing, 0 * rotations, rotations[:0], -rotations):
        assert _likely.doubt_rotations(q) is None


def test_degrees_for_radians(rotations):
    clip = scipy_rotation(rotations).as_euler("ZXY", degrees=True)
    wild = type(scipy_rotation(rotations)).from_euler("ZXY", clip).as_quat(scalar_first=True)
    wild = wild.reshape(rotations.shape)
    assert "degrees taken for radians?" in _likely.doubt_rates(turn(wild[1:], wild[:-1]), 1 / 60)
    assert _likely.doubt_rates(turn(wild[1:9], wild[:8]), 1 / 60) == ""  # too few steps
    assert _likely.doubt_rates(turn(rotations[1:], rotations[:-1]), 1 / 60) == ""
    assert _likely.doubt_rates(np.zeros((20, 3)), 1 / 60) == ""


def test_real_captures_are_not_doubted_and_their_errors_are(data_dir):
    files = sorted((data_dir / "bandai").glob("*.bvh"))[::12] + sorted(data_dir.glob("xia/*"))[:2]
    looked_at = 0
    for path in (path for path in files if path.suffix == ".bvh"):
        motion = jm.load(path)
        q, seconds = np.asarray(motion.rotations), float(motion.frame_time)
        assert _likely.doubt_rotations(q) is None, path
        assert _likely.doubt_rates(turn(q[1:], q[:-1]), seconds) == "", path
        assert _likely.doubt_rotations(np.roll(q, -1, -1))[0] == "order", path
        looked_at += 1
    assert looked_at > 5


@pytest.mark.parametrize("share", [0.0, 0.3, 0.45, 0.5, 0.55, 0.8, 1.0])
def test_good_clips_are_told_at_a_glance_and_no_others(monkeypatch, share):
    """The short cut answers as what it spares would."""
    rng = np.random.default_rng(5)
    clips = []
    for _ in range(20):
        q = rng.standard_normal((16, 5, 4)) * rng.choice([0.3, 1.0], 4)
        q /= np.linalg.norm(q, axis=-1, keepdims=True)
        rolled = rng.random((16, 5, 1)) < share
        by_size = np.take_along_axis(q, np.argsort(np.abs(q), axis=-1), axis=-1)
        clips.append(np.where(rolled, by_size, q))
    quick = [_likely.doubt_rotations(q) for q in clips]
    monkeypatch.setattr(_likely, "_last_leads", lambda q: True)
    assert quick == [_likely.doubt_rotations(q) for q in clips]
    assert share != 1.0 or any(quick)
