"""``jaxmotion contacts`` lists what the library finds, and writes what it cleans."""

import json

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.metrics import foot_skate


@pytest.fixture(scope="module")
def skating():
    walk = jm.samples.walk(48, fps=30.0).motion
    return jm.samples.slide_root(walk, jax.random.key(0), amount=0.1).motion


@pytest.fixture
def file(tmp_path, skating):
    path = tmp_path / "walk.npz"
    jm.save(skating, path)
    return path


def test_list(jaxmotion, file, take, skating):
    text = jaxmotion("contacts", file, take).stdout
    found = jm.contacts.detect(skating)
    first = jm.contacts.intervals(found)[0]
    assert "LeftFoot.heel" in text
    assert f"frames {first.first}-{first.last}" in text
    assert "no feet found" in text
    [facts] = json.loads(jaxmotion("contacts", file, "--json").stdout)
    assert facts["frames"] == 48
    assert facts["slide"] == pytest.approx(foot_skate(skating, found), rel=1e-6)
    assert [c["first"] for c in facts["contacts"]] == [
        one.first for one in jm.contacts.intervals(found)
    ]
    np.testing.assert_allclose(facts["contacts"][0]["target"], first.target, atol=1e-6)
    words = ("contacts", file, "--joint", "*hand", "--no-floor", "--method", "thresholds")
    assert "LeftHand" in jaxmotion(*words).stdout


@pytest.mark.parametrize("way", ["legs", "root", "spacetime"])
def test_restore(jaxmotion, file, tmp_path, skating, way):
    out = tmp_path / "clean.npz"
    jaxmotion("contacts", file, "-o", out, "--restore", way)
    found = jm.contacts.detect(skating)
    assert foot_skate(jm.load(out), found) < 0.4 * foot_skate(skating, found)


def test_restoring_what_has_no_feet_says_so(jaxmotion, take, tmp_path):
    result = jaxmotion("contacts", take, "-o", tmp_path / "a.bvh", "--restore", "legs", code=1)
    assert "no feet found; --joint names others" in result.stderr
    assert not (tmp_path / "a.bvh").exists()


def test_style_keeps_contacts(jaxmotion, file, tmp_path, skating):
    plain, kept = tmp_path / "plain.npz", tmp_path / "kept.npz"
    words = ("style", file, "--alpha", "2", "-o")
    jaxmotion(*words, plain)
    jaxmotion(*words, kept, "--keep-contacts")
    found = jm.contacts.detect(skating)
    assert foot_skate(jm.load(kept), found) < 0.1 * foot_skate(jm.load(plain), found)


def test_what_is_missing_is_asked_for(jaxmotion, file, tmp_path):
    assert "say how to write" in jaxmotion("contacts", file, "-o", tmp_path / "x", code=2).stderr
    assert "say where" in jaxmotion("contacts", file, "--restore", "legs", code=2).stderr
