"""The scorer of benchmarks/denoise_quality.py measures what the library does, by its own means."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import jaxmotion as jm
from tests.helpers import angle_between, random_motion, random_quaternions

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "denoise_quality.py"

pytestmark = pytest.mark.skipif(not SCRIPT.is_file(), reason="no benchmarks beside the tests")


@pytest.fixture(scope="module")
def quality():
    spec = importlib.util.spec_from_file_location("denoise_quality", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def turning(degrees):
    """One joint that turns about x by the given angle in every frame."""
    half = np.radians(degrees) / 2
    return np.stack([np.cos(half), np.sin(half), 0 * half, 0 * half], axis=-1)[:, None]


def test_positions_are_those_of_the_library(quality, rng):
    motion = random_motion(rng, frames=4, skeleton=12)
    arrays = np.asarray(motion.translations), np.asarray(motion.rotations)
    found = quality.positions(motion.skeleton.parents, *arrays)
    want = jm.forward_kinematics(motion).positions
    np.testing.assert_allclose(np.moveaxis(found, 0, 1), want, rtol=0, atol=1e-12)


def test_angles(quality, rng):
    a, b = random_quaternions(rng, (2, 50))
    np.testing.assert_allclose(quality.angles(a, b), np.degrees(angle_between(a, b)), atol=1e-6)
    assert np.all(quality.angles(a, -a) == 0)


def test_noise_has_its_deviation(quality, rng):
    p, still = np.zeros((4000, 3, 3)), np.tile([1.0, 0, 0, 0], (4000, 3, 1))
    for corrupt in (quality.white, quality.coloured, quality.jitter):
        _, q = corrupt(0.02)(rng, p, still, 30.0)
        v = quality.rotations(q).as_rotvec()
        np.testing.assert_allclose(np.std(v), 0.02, rtol=0.05)


def test_dropped_and_quantised(quality, rng):
    degrees = np.linspace(0.0, 20.2, 41)
    q = turning(degrees)
    p = np.arange(41.0)[:, None, None] * np.ones(3)
    for _ in range(20):
        kept = quality.dropped(rng, p, q, 30.0)[0][:, 0, 0]
        lost = kept != np.arange(41)
        assert np.sum(lost) == 4
        np.testing.assert_array_equal(kept[1:][lost[1:]], kept[:-1][lost[1:]])
    _, whole = quality.quantised(rng, p, q, 30.0)
    np.testing.assert_allclose(whole, turning(np.round(degrees)), atol=1e-12)


def test_only_what_stands_out_is_sudden(quality):
    t = np.arange(60)
    swing, flick = 30 * np.sin(t / 5), np.where((t == 30) | (t == 31), 30.0, 0.0)
    shake = 8.0 * (-1) ** t
    joints = (swing, shake, swing + flick)
    near = quality.near_sudden(np.concatenate([turning(x) for x in joints], axis=1))
    assert not np.any(near[:, :2])
    np.testing.assert_array_equal(near[:, 2], (t >= 29 - 3) & (t <= 32 + 3))


def test_the_best_cut_off_is_no_worse_than_another(quality, rng):
    clean = turning(20 * np.sin(np.arange(200) / 10))
    _, noisy = quality.white(0.02)(rng, np.zeros((200, 1, 3)), clean, 30.0)
    error = lambda q: float(np.mean(quality.angles(q, clean)))  # noqa: E731
    least, cutoff = quality.best_butterworth(noisy * np.sign(rng.normal(size=(200, 1, 1))), error)
    assert least < 0.5 * error(noisy)
    assert quality.CUTOFFS[0] < cutoff < quality.CUTOFFS[-1]
