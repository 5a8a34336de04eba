"""The up axis at the command line: told, guessed, doubted, turned, kept."""

import json

import numpy as np
import pytest

import jaxmotion as jm
from tests.helpers import world_by_matrices


@pytest.fixture(scope="module")
def walk():
    return jm.samples.walk(60, fps=30.0).motion


@pytest.fixture
def z_up(walk, tmp_path):
    """A BVH file as Blender writes them."""
    jm.save(jm.reorient(walk, "z"), tmp_path / "zup.bvh", up="keep")
    return tmp_path / "zup.bvh"


def facts(result):
    return json.loads(result.stdout)[0]


def test_info_says_what_is_assumed(jaxmotion, walk, z_up, tmp_path):
    text = jaxmotion("info", z_up).stdout
    assert "y (assumed)" in text
    assert "y points up (assumed), but it stands along z, on a level floor; --up z?" in text
    assert "z (guessed)" in jaxmotion("info", z_up, "--up", "auto").stdout
    told = facts(jaxmotion("info", z_up, "--up", "z", "--json"))
    assert (told["up"], told["conventions"]["up"], told["warnings"]) == ("z", "told", [])
    assert told["height"] == pytest.approx(1.74, abs=0.05)
    jm.save(walk, tmp_path / "walk.npz")
    text = jaxmotion("info", tmp_path / "walk.npz").stdout
    assert "metres" in text
    assert "(assumed)" not in text
    jm.save(walk, tmp_path / "walk.amc")
    amc = tmp_path / "walk.amc"
    amc.write_text(amc.read_text().replace(":SAMPLES-PER-SECOND", "# "))
    amc.with_suffix(".asf").write_text(
        amc.with_suffix(".asf").read_text().replace("  angle deg\n", "")
    )
    text = jaxmotion("info", amc).stdout
    assert "at 120 a second (assumed)" in text
    assert "degrees (assumed)" not in text  # the .amc says it
    amc.write_text(amc.read_text().replace(":DEGREES\n", ""))
    assert "degrees (assumed)" in jaxmotion("info", amc).stdout
    assert "(assumed)" not in jaxmotion("info", amc, "--fps", "60").stdout.split("frames")[1][:40]


def test_check_doubts(jaxmotion, z_up):
    result = jaxmotion("check", z_up, "--json", "--ignore", "gimbal", code=3)
    [problem] = facts(result)["problems"]
    assert problem["kind"] == "up"
    assert problem["serious"]
    assert jaxmotion("check", z_up, "--up", "z", "--ignore", "gimbal").stdout.endswith("ok\n")


def test_contacts_of_the_axis_that_is_told(jaxmotion, walk, z_up, tmp_path):
    jm.save(walk, tmp_path / "yup.bvh")
    want = facts(jaxmotion("contacts", tmp_path / "yup.bvh", "--json"))
    assert want["warnings"] == []
    for up in ("z", "auto"):
        got = facts(jaxmotion("contacts", z_up, "--json", "--up", up))
        assert len(got["contacts"]) == len(want["contacts"]) > 0
        for one, other in zip(got["contacts"], want["contacts"], strict=True):
            assert [one[k] for k in ("point", "first", "last")] == [
                other[k] for k in ("point", "first", "last")
            ]
            x, y, z = one["target"]
            np.testing.assert_allclose([x, z, -y], other["target"], atol=1e-9)
        assert got["points"] == pytest.approx(want["points"])
    wrong = facts(jaxmotion("contacts", z_up, "--json"))
    assert "--up z?" in wrong["warnings"][0]


def test_convert_turns_and_says_so(jaxmotion, walk, z_up, tmp_path):
    jaxmotion("convert", z_up, "-o", tmp_path / "z.npz", "--up", "z")
    assert jm.load(tmp_path / "z.npz").skeleton.up == "z"
    result = jaxmotion("convert", tmp_path / "z.npz", "-o", tmp_path / "y.bvh")
    assert "turned from z up to y up" in result.stderr
    places = world_by_matrices(jm.load(tmp_path / "y.bvh"))[0]
    np.testing.assert_allclose(places, world_by_matrices(walk)[0], atol=1e-9)
    words = ("convert", tmp_path / "z.npz", "-o", tmp_path / "kept.bvh", "--out-up", "keep")
    assert "z points up, which the file cannot say" in jaxmotion(*words).stderr
    kept = jm.load(tmp_path / "kept.bvh", up="z")
    np.testing.assert_allclose(kept.root_positions, jm.load(z_up).root_positions, atol=1e-12)
    jaxmotion("convert", tmp_path / "y.bvh", "-o", tmp_path / "again.npz", "--out-up", "z")
    again = jm.load(tmp_path / "again.npz")
    assert again.skeleton.up == "z"
    np.testing.assert_allclose(again.root_positions, kept.root_positions, atol=1e-12)


@pytest.mark.parametrize(
    "words",
    [
        ("retime", "--to-fps", "20"),
        ("denoise", "--lam", "1", "--sigma", "1"),
        ("layers",),
    ],
)
def test_every_way_of_writing_takes_it(jaxmotion, walk, z_up, tmp_path, words):
    verb, *rest = words
    out = tmp_path / "parts" if verb == "layers" else tmp_path / "out.bvh"
    result = jaxmotion(verb, z_up, "-o", out, "--up", "z", *rest)
    assert "turned from z up to y up" in result.stderr
    motion = jm.load(out / "base.bvh" if verb == "layers" else out)
    assert jm.guess_up(motion).axis == "y"
    # Begun where the walk begins, seen from its own world.
    np.testing.assert_allclose(motion.root_positions[0], walk.root_positions[0], atol=0.05)


def test_joining_takes_it(jaxmotion, z_up, tmp_path):
    words = (z_up, z_up, "-o", tmp_path / "long.bvh", "--search", "0")
    assert "--up z?" in jaxmotion("stitch", *words).stderr
    result = jaxmotion("stitch", *words, "--up", "auto", "--overwrite")
    assert "z points up, by a guess" in result.stderr
    assert "turned from z up to y up" in result.stderr
    assert jm.guess_up(jm.load(tmp_path / "long.bvh")).axis == "y"
    jaxmotion("align", z_up, z_up, "-o", tmp_path / "aligned.npz", "--up", "z", "--out-up", "y")
    assert jm.load(tmp_path / "aligned.npz").skeleton.up == "y"


def test_a_rate_that_amass_does_not_tell(jaxmotion, tmp_path):
    rng = np.random.default_rng(0)
    parts = {"root_orient": rng.normal(size=(9, 3)), "pose_body": rng.normal(size=(9, 63))}
    np.savez(tmp_path / "a.npz", trans=np.zeros((9, 3)), **parts)
    assert "--fps 30" in jaxmotion("info", tmp_path / "a.npz", code=1).stderr
    told = facts(jaxmotion("info", tmp_path, "--fps", "25", "--json"))
    assert (told["fps"], told["up"], told["conventions"]["metres"]) == (25, "z", 1.0)


@pytest.mark.parametrize("verb", ["info", "check", "convert", "align", "blend", "stitch"])
def test_other_axes_are_usage_errors(jaxmotion, z_up, verb):
    assert "'--up'" in jaxmotion(verb, z_up, "--up", "Z", code=2).stderr
