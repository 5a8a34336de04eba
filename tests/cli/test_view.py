"""Clips in a browser, alone and compared."""

import dataclasses
import json
import re
import sys
from pathlib import Path
from urllib.parse import unquote, urlparse

import click
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cli._showing import names_of
from tests.cli.conftest import swinging
from tests.helpers import quaternions_by


@pytest.fixture
def opened(monkeypatch):
    """Pages that a browser is asked for, none of which is opened."""
    asked = []

    def launch(url, *_, **__):
        asked.append(Path(unquote(urlparse(url).path)))
        return 0

    monkeypatch.setattr(click, "launch", launch)
    monkeypatch.setenv("DISPLAY", ":0")
    return asked


def named(motion, *names):
    """The clip of joints that are called otherwise."""
    return motion.replace(skeleton=dataclasses.replace(motion.skeleton, names=names))


def turned(motion, joint, frames, degrees):
    """A joint turned about x in some frames."""
    vectors = np.zeros((motion.num_frames, motion.num_joints, 3))
    vectors[frames, joint, 0] = np.radians(degrees)
    rotations = jm.quaternion.multiply(motion.rotations, quaternions_by(vectors))
    return motion.with_transforms(rotations=rotations)


def test_view(jaxmotion, take, opened):
    told = jaxmotion("view", take).stderr
    [page] = opened
    assert page.suffix == ".html"
    assert page.stem == "take"
    assert str(page) in told
    text = page.read_text("utf-8")
    assert text == jm.viz.player({"take": jm.load(take)}, title="take").html


def test_view_writes_where_it_is_told(jaxmotion, take, opened, tmp_path):
    out = tmp_path / "new" / "page.html"
    jaxmotion("view", take, "-o", out, "--no-open")
    assert not opened
    assert out.is_file()
    assert "add --overwrite" in jaxmotion("view", take, "-o", out, "--no-open", code=1).stderr
    jaxmotion("view", take, "-o", out, "--overwrite", "--contacts")
    assert [path.resolve() for path in opened] == [out.resolve()]
    assert "is no .html file" in jaxmotion("view", take, "-o", "page.bvh", code=2).stderr


def test_view_of_several(jaxmotion, take, opened, tmp_path):
    """What cannot be read is told of; the others are shown."""
    other, broken = tmp_path / "b" / "take.bvh", tmp_path / "broken.bvh"
    other.parent.mkdir()
    jm.save(swinging(seed=1), other)
    broken.write_text("HIERARCHY\n")
    told = jaxmotion("view", take, other, broken, code=1).stderr
    assert "FAILED" in told
    text = opened[0].read_text("utf-8")
    clips = {"take.bvh": jm.load(take), "b/take.bvh": jm.load(other)}
    assert text == jm.viz.player(clips, title=", ".join(clips)).html
    assert jaxmotion("view", broken, code=1).exit_code == 1
    assert len(opened) == 1
    many = tmp_path / "many"
    many.mkdir()
    for number in range(13):
        (many / f"{number}.bvh").write_bytes(take.read_bytes())
    assert "13 clips; one page shows 12" in jaxmotion("view", many, code=2).stderr


def test_without_a_browser_it_says_so(jaxmotion, take, monkeypatch):
    monkeypatch.setattr(click, "launch", lambda *_, **__: 1)
    monkeypatch.setenv("DISPLAY", ":0")
    assert "no browser could be opened" in jaxmotion("view", take).stderr
    monkeypatch.undo()  # nor is one asked for where there is no screen
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER", "WSL_DISTRO_NAME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(click, "launch", None)
    assert "no browser could be opened" in jaxmotion("view", take).stderr


def test_names():
    paths = [Path(name) for name in ("a/x.bvh", "b/x.bvh", "c/y.bvh")]
    assert names_of(paths[1:]) == ["x", "y"]
    assert names_of(paths) == ["a/x.bvh", "b/x.bvh", "c/y.bvh"]
    deep = [Path("/home/me/takes") / path for path in paths]
    assert names_of(deep) == ["a/x.bvh", "b/x.bvh", "c/y.bvh"]
    assert names_of([Path("a/x.bvh"), Path("a/x.amc")]) == ["x.bvh", "x.amc"]
    assert names_of([Path("x.bvh")] * 2) == ["x.bvh (1)", "x.bvh (2)"]
    assert names_of([Path("\x1b[2J.bvh")]) == [r"\x1b[2J"]
    assert names_of([Path("k\n.bvh"), Path(r"k\n.bvh")]) == [r"k\n (1)", r"k\n (2)"]


def test_compare(jaxmotion, take, opened, tmp_path):
    """Turned by 10 degrees in five frames: the joint, where, and what hangs from it."""
    clip = jm.load(take)
    other = turned(clip, 1, range(5, 10), 10)
    other = turned(other, 2, [7], 3)
    jm.save(other, tmp_path / "other.npz")
    told = json.loads(jaxmotion("compare", take, tmp_path / "other.npz", "--json").stdout)
    assert told["notes"] == []
    first, second, *others = told["joints"]
    assert first["joint"] == "LeftArm"
    assert first["degrees_frame"] in range(5, 10)
    assert first["degrees_most"] == pytest.approx(10, abs=1e-5)
    assert first["degrees_mean"] == pytest.approx(10 * 5 / 40, abs=1e-5)
    assert first["distance_most"] == pytest.approx(0, abs=1e-6)
    assert (second["joint"], second["degrees_frame"]) == ("LeftHand", 7)
    # A hand 3 long along its arm's x, turned about x, stays; so its place tells by matrices.
    places = [np.asarray(jm.forward_kinematics(x).positions)[:, 2] for x in (clip, other)]
    away = np.linalg.norm(np.subtract(*places), axis=-1)
    assert second["distance_most"] == pytest.approx(away.max(), abs=1e-5)
    assert {row["joint"] for row in others} == {"Hips", "RightArm"}
    assert all(row["degrees_most"] < 1e-5 for row in others)
    frames = told["frames"]
    assert [row["frame"] for row in frames] == list(range(40))
    assert [round(row["degrees"], 4) for row in frames[4:11]] == [0, 10, 10, 10, 10, 10, 0]
    assert frames[6]["turned"] == "LeftArm"
    page = opened[0].read_text("utf-8")
    assert page.count("<iframe") == 1
    assert "By frame" in page


def test_compare_in_words(jaxmotion, take, opened, tmp_path):
    said = jaxmotion("compare", take, take, "--no-open").stdout
    assert said.splitlines() == ["40 frames, 4 joints: all the same"]
    jm.save(turned(jm.load(take), 1, [20], 0.01), tmp_path / "near.npz")
    said = jaxmotion("compare", take, tmp_path / "near.npz", "--no-open").stdout
    assert re.fullmatch(r"40 frames, 4 joints: the same, to 0.01° and \S+ length units\n", said)
    jm.save(turned(jm.load(take), 1, [20], 10), tmp_path / "other.bvh")
    said = jaxmotion("compare", take, tmp_path / "other.bvh", "--no-open", "--frames").stdout
    lines = said.splitlines()
    assert lines[0] == "40 frames, 4 joints"
    assert lines[2].split()[:3] == ["0.25°", "10°", "20"]
    assert lines[2].endswith("LeftArm")
    assert len(lines) == 2 + 4 + 40
    assert "10° LeftArm" in lines[2 + 4 + 20]
    assert not opened


def test_compare_clips_that_are_not_alike(jaxmotion, opened, tmp_path):
    """Another rate, another up axis, other joints, more frames."""
    clip = swinging(60, noise=0.0)
    jm.save(clip, tmp_path / "a.npz")
    other = jm.axes.reorient(jm.resample(clip, fps=60.0), "z")
    jm.save(named(other, "Hips", "LeftArm", "LeftHand", "Wing"), tmp_path / "b.npz")
    words = ("compare", tmp_path / "a.npz", tmp_path / "b.npz", "--no-open")
    told = json.loads(jaxmotion(*words, "--json").stdout)
    assert told["notes"][:3] == [
        "only in one: RightArm, Wing",
        "b.npz was turned to stand along y",
        "b.npz was resampled to 30 frames a second",
    ]
    assert len(told["joints"]) == 3
    assert max(row["degrees_most"] for row in told["joints"]) < 1
    assert max(row["distance_most"] for row in told["joints"]) < 0.1
    jm.save(clip[:50], tmp_path / "b.npz", overwrite=True)
    assert "a.npz goes on for 10 frames more" in jaxmotion(*words).stdout
    jm.save(named(clip, "A", "B", "C", "D"), tmp_path / "b.npz", overwrite=True)
    assert "no joint of one clip" in jaxmotion(*words, code=1).stderr


def test_compare_in_other_units(jaxmotion, tmp_path):
    """Lengths are those of the first clip."""
    clip = swinging(noise=0.0)
    conventions = clip.skeleton.conventions
    for name, metres in (("a", 0.01), ("b", 1.0)):
        told = dataclasses.replace(conventions, metres=metres)
        there = dataclasses.replace(clip.skeleton, conventions=told)
        jm.save(clip.replace(skeleton=there), tmp_path / f"{name}.npz")
    words = ("compare", tmp_path / "a.npz", tmp_path / "b.npz", "--no-open", "--json")
    told = json.loads(jaxmotion(*words).stdout)
    [hips] = [row for row in told["joints"] if row["joint"] == "Hips"]
    assert told["notes"] == ["lengths of b.npz are told in units of 0.01 m"]
    root = np.linalg.norm(np.asarray(clip.translations)[:, 0], axis=-1)
    assert hips["distance_most"] == pytest.approx(99 * root.max(), rel=1e-6)
