"""What ``mirror`` does to files."""

import numpy as np
import pytest

import jaxmotion as jm
from tests.cli.conftest import assert_same_clip
from tests.helpers import random_motion


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    path = tmp_path_factory.mktemp("walk") / "walk.bvh"
    jm.save(jm.samples.load("walk", num_frames=24).motion, path)
    return path


@pytest.mark.parametrize("plane", ["body", "z"])
def test_the_library_s(jaxmotion, walk, tmp_path, plane):
    out = tmp_path / "out.npz"
    words = () if plane == "body" else ("--plane", plane)
    told = jaxmotion("mirror", walk, "-o", out, *words, "--reference", walk).stderr
    assert "24 frames mirrored" in told
    assert_same_clip(jm.load(out), jm.mirror(jm.load(walk), plane))


def test_twice_is_the_file(jaxmotion, walk, tmp_path):
    jaxmotion("mirror", walk, "-o", tmp_path / "once", "--report", tmp_path / "r.html")
    jaxmotion("mirror", tmp_path / "once" / "walk.bvh", "-o", tmp_path / "twice")
    once, twice = (jm.load(tmp_path / name / "walk.bvh") for name in ("once", "twice"))
    assert jm.metrics.difference(jm.load(walk), once).angle.value > 0.1
    assert_same_clip(twice, jm.load(walk))
    assert (tmp_path / "r.html").exists()


def test_a_file_without_sides_is_named(jaxmotion, tmp_path):
    take = tmp_path / "take.npz"
    jm.save(random_motion(np.random.default_rng(0)), take)
    told = jaxmotion("mirror", take, "-o", tmp_path / "out.bvh", code=1).stderr
    assert "no left/right joints found by name" in told
