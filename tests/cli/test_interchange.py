"""``convert`` to formats for other programs: the unit, what viewers make of the rate, folders."""

import re
import sys

import numpy as np
import pytest

import jaxmotion as jm
from tests.cli.conftest import record_in, swinging

pytest.importorskip("pygltflib", reason="glTF needs pygltflib")
pytest.importorskip("pxr", reason="USD needs usd-core")


def test_the_unit_is_guessed_or_told_and_the_rate_is_a_note(jaxmotion, take, tmp_path):
    out = tmp_path / "out.glb"
    said = jaxmotion("convert", take, "-o", out).stderr
    assert "by a guess: its joints then span" in said
    assert "set 30 frames a second, and the last frame, before" in said
    assert "exists; add --overwrite" in jaxmotion("convert", take, "-o", out, code=1).stderr
    said = jaxmotion("convert", take, "-o", out, "--overwrite", "--metres", "0.01").stderr
    assert "by a guess" not in said
    told = out.read_bytes()
    jm.save(jm.load(take), out, metres=0.01)
    assert out.read_bytes() == told


@pytest.mark.parametrize("suffix", ["glb", "usda", "usdc"])
def test_folders_are_mirrored_and_notes_told_once(jaxmotion, tmp_path, suffix):
    (tmp_path / "in/deep").mkdir(parents=True)
    for name in ("a", "deep/b"):
        jm.save(swinging(frames=5), tmp_path / f"in/{name}.bvh")
    words = ("convert", tmp_path / "in", "-o", tmp_path / "out", "--to", suffix, "--metres", 1)
    said = jaxmotion(*words).stderr
    assert said.count("  warning: Blender") == 1
    names = ", ".join(str(tmp_path / f"in/{name}.bvh") for name in ("a", "deep/b"))
    assert f"\nthat warning, of 2 files ({names}): Blender keeps its scene's frame rate " in said
    written = sorted(path.relative_to(tmp_path) for path in (tmp_path / "out").rglob("*.*"))
    names = [str(path) for path in written if path.suffix == f".{suffix}"]
    assert names == [f"out/a.{suffix}", f"out/deep/b.{suffix}"]


def test_a_guess_is_told_once_whatever_it_measured(jaxmotion, tmp_path):
    (tmp_path / "in").mkdir()
    for number in range(4):
        big = swinging(frames=5, seed=number).with_transforms(
            swinging(5, seed=number).translations * (1 + number / 8)
        )
        jm.save(big, tmp_path / f"in/{number}.npz")
    report = tmp_path / "r.json"
    words = ("convert", tmp_path / "in", "-o", tmp_path / "out", "--to", "glb", "--report", report)
    said = jaxmotion(*words).stderr
    assert said.count("  warning: a unit of length is taken for") == 1
    assert "that warning, of 4 files: a unit of length is taken for" in said
    spans = {
        text for row in record_in(report)["files"] for text in row["warnings"] if "span" in text
    }
    assert len(spans) > 2  # the report has each


def test_they_are_not_read(jaxmotion, take, tmp_path):
    jaxmotion("convert", take, "-o", tmp_path / "a.glb", "--metres", "1")
    said = jaxmotion("convert", tmp_path / "a.glb", "-o", tmp_path / "b.bvh", code=1).stderr
    assert "a format that is written only" in said
    (tmp_path / "only").mkdir()
    (tmp_path / "a.glb").rename(tmp_path / "only/a.glb")
    said = jaxmotion("convert", tmp_path / "only", "-o", tmp_path / "c", "--to", "bvh", code=2)
    assert "no motion files (.bvh, .amc, .npz)" in said.stderr


def test_metres_goes_with_them_alone(jaxmotion, take, tmp_path):
    words = ("convert", take, "--metres", "0.01", "-o")
    said = jaxmotion(*words, tmp_path / "a.bvh", code=2).stderr
    assert "--metres goes with outputs in glTF or USD" in said
    assert "0.0" in jaxmotion("convert", take, "--metres", "0", "-o", "a.glb", code=2).stderr


def test_an_edit_may_be_written_so_too(jaxmotion, take, tmp_path):
    jaxmotion("denoise", take, "-o", tmp_path / "a.usda", "--lam", "1", "--sigma", "1")
    assert (tmp_path / "a.usda").read_bytes().startswith(b"#usda 1.0")


def test_without_the_extra_it_says_how_to_get_it(jaxmotion, take, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pygltflib", None)
    said = jaxmotion("convert", take, "-o", tmp_path / "a.glb", code=1).stderr
    assert "pip install 'jaxmotion[gltf]'" in said
    assert "unexpected" not in said
    assert np.all([path.suffix != ".glb" for path in tmp_path.iterdir()])


@pytest.mark.parametrize(("suffix", "module"), [("glb", "pygltflib"), ("usda", "pxr")])
def test_an_extra_is_asked_for_once(jaxmotion, tmp_path, monkeypatch, suffix, module):
    """Before any file is read, of which nothing is written; nor by another command."""
    (tmp_path / "in").mkdir()
    for name in "abc":
        jm.save(swinging(frames=5), tmp_path / f"in/{name}.bvh")
    monkeypatch.setitem(sys.modules, module, None)
    words = ("convert", tmp_path / "in", "-o", tmp_path / "out", "--to", suffix)
    said = jaxmotion(*words, code=1).stderr
    assert re.fullmatch(r"Error: writing .* needs .*: pip install 'jaxmotion\[\w+\]'\n", said)
    assert not (tmp_path / "out").exists()
    out = tmp_path / f"a.{suffix}"
    assert jaxmotion("denoise", tmp_path / "in/a.bvh", "-o", out, code=1).stderr == said
    jaxmotion(*words[:-1], "bvh")
