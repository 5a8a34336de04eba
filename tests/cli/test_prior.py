"""``prior`` learns from files, and ``denoise --prior`` smooths with what it learned."""

import json

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.smoothing import MotionPrior, motion_prior
from tests.cli.conftest import swinging
from tests.helpers import assert_same_rotation


@pytest.fixture
def learned(jaxmotion, take, tmp_path):
    """The take, the prior learned from it, and how that was told."""
    out = tmp_path / "prior.npz"
    result = jaxmotion("prior", take, "-o", out, "--report", tmp_path / "r.json")
    return take, out, result


def test_it_is_the_library_s(learned, tmp_path):
    take, out, result = learned
    prior = motion_prior(jm.load(take, dtype=np.float64))
    found = MotionPrior.load(out)
    np.testing.assert_allclose(found.covariance, prior.covariance, rtol=1e-12, atol=1e-15)
    assert f"{len(prior.joints)} joints turn together, from 40 frames" in result.stderr
    [row] = json.loads((tmp_path / "r.json").read_text())["files"]
    assert (row["status"], row["frames"]) == ("read", 40)


def test_denoise_smooths_with_it(jaxmotion, learned, tmp_path):
    take, prior, _ = learned
    jaxmotion("denoise", take, "-o", tmp_path / "out.npz", "--prior", prior)
    expected = jm.denoise(swinging(), prior=MotionPrior.load(prior))
    assert_same_rotation(jm.load(tmp_path / "out.npz").rotations, expected.rotations, 1e-6)


def test_what_is_refused(jaxmotion, learned, tmp_path):
    take, prior, _ = learned
    out = tmp_path / "out.npz"
    assert "exists" in jaxmotion("prior", take, "-o", prior, code=1).stderr
    jaxmotion("prior", take, "-o", prior, "--overwrite")
    assert ".npz file" in jaxmotion("prior", take, "-o", tmp_path / "p.bvh", code=2).stderr
    words = ("denoise", take, "-o", out, "--prior")
    assert "neither" in jaxmotion(*words, tmp_path / "none.npz", code=2).stderr
    jm.save(swinging(), tmp_path / "clip.npz")
    assert "MotionPrior" in jaxmotion(*words, tmp_path / "clip.npz", code=1).stderr
    assert "tune=False" in jaxmotion(*words, prior, "--lam", "1", code=1).stderr
    assert not out.exists()


def test_a_file_that_cannot_be_read_fails_and_the_rest_is_learned(jaxmotion, take, tmp_path):
    (tmp_path / "bad.bvh").write_text("HIERARCHY")
    out = tmp_path / "prior.npz"
    result = jaxmotion("prior", take, tmp_path / "bad.bvh", "-o", out, code=1)
    assert "FAILED" in result.stderr
    assert MotionPrior.load(out).frames == 40
