"""``repair`` finds joints that are in error and puts them where the body has them elsewhere."""

import re

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cleaning import levels
from jaxmotion.cli import _beside, _page, _pictures
from tests.cli.conftest import record_in

FRAMES = 96


def walking(begin=0, frames=FRAMES):
    """A walk of which every part is like every other."""
    return jm.samples.load("walk", fps=24.0, num_frames=begin + frames).motion[begin:]


def broken(motion, seed=0):
    """An arm out of place for a while, and which entries that is."""
    joint = motion.skeleton.index("LeftArm")
    return jm.samples.offset_joints(
        motion, jax.random.key(seed), runs=1, joints=[joint], length=(10, 14)
    )


@pytest.fixture(autouse=True)
def own_shelf():
    """Nothing is known of files of other tests."""
    yield
    _beside.shelf.cache_clear()


@pytest.fixture(scope="module")
def clips():
    """A walk, it broken, and another."""
    walk = walking()
    return walk, broken(walk), walking(5)


@pytest.fixture
def takes(clips, tmp_path):
    """A folder with a broken walk, a good one, and a dog."""
    folder = tmp_path / "takes"
    folder.mkdir()
    _, case, other = clips
    jm.save(case.motion, folder / "a.bvh")
    jm.save(other, folder / "b.bvh")
    dog = jm.samples.load("quadruped_walk", fps=24.0, num_frames=96).motion
    jm.save(dog, folder / "dog.bvh")
    return folder


def off(clip, path, mask):
    """How far a file's joints are from a clip's where the mask is set, and elsewhere; degrees."""
    angle = np.degrees(jm.metrics.turn(clip.rotations, jm.load(path).rotations))
    mask = np.asarray(mask)
    return angle[mask].max(), angle[~mask].max()


def test_a_folder_is_its_own_context(jaxmotion, takes, clips, tmp_path, monkeypatch):
    """What is broken is repaired, what is sound is copied, of other joints is looked at alone. Each
    file is searched once."""
    searches, search = [], levels.searched
    monkeypatch.setattr(levels, "searched", lambda *x: searches.append(1) or search(*x))
    out, report = tmp_path / "out", tmp_path / "r.html"
    told = jaxmotion("repair", takes, "-o", out, "--report", report).stderr
    walk, case, _ = clips
    assert off(walk, takes / "a.bvh", case.mask)[0] > 10
    assert len(searches) == 3
    inside, outside = off(walk, out / "a.bvh", case.mask)
    assert inside < 8
    assert outside < 5
    for name in ("b.bvh", "dog.bvh"):
        assert (out / name).read_bytes() == (takes / name).read_bytes()
    assert "a.bvh: 1 run, " in told
    assert "% of joint-frames repaired" in told
    assert re.search(r"largest, in frames \d+-\d+: LeftArm by \d+°", told)
    assert "b.bvh: nothing found" in told
    assert "left out of the context: 1 clip of other joints" in told
    assert "left out of the context: 2 clips of other joints" in told
    a, b, dog = record_in(report)["files"]
    assert a["learned"]["context"] == [str(takes / "b.bvh")]
    assert a["learned"]["left_out"] == {"other_joints": 1, "unreadable": 0}
    assert dog["learned"]["context"] == []
    assert b["learned"]["runs"] == []
    assert b["changes"]["frames_changed"] == 0
    [row] = a["learned"]["runs"]
    frames = np.flatnonzero(np.asarray(case.mask).any(axis=1))
    assert abs(row["start"] - frames[0]) <= 1
    assert abs(row["stop"] - frames[-1] - 1) <= 1
    assert row["seconds"] == pytest.approx(row["start"] / 24, abs=1e-3)
    assert row["lasts"] == pytest.approx((row["stop"] - row["start"]) / 24, abs=1e-3)
    assert row["joints"] == ["LeftArm"]
    assert row["jump_after"] < row["jump_before"]
    assert row["change"] == pytest.approx(a["changes"]["degrees"]["max"], rel=1e-3)
    assert 0.5 <= row["confidence"] <= 1
    assert "digression" in row["detectors"]
    assert row["size"] > 5
    text = report.read_text()
    pictures = _page.pictures_in(text)
    count = {name: len(re.findall("<img", shown)) for name, shown in pictures.items()}
    files = {_page.as_text(takes / name): n for name, n in (("a.bvh", 2), ("b.bvh", 1))}
    assert count == files | {_page.as_text(takes / "dog.bvh"): 1}
    told = jaxmotion("repair", takes, "-o", out, "--report", report, "--resume").stderr
    assert "3 skipped" in told
    assert _page.pictures_in(report.read_text()) == pictures


def test_the_library_s(jaxmotion, takes, tmp_path):
    """The same beside clips that are named, with another method, and only of some joints."""
    a, good = jm.load(takes / "a.bvh"), jm.load(takes / "b.bvh")
    words = "repair", takes / "a.bvh", "--context", takes / "b.bvh", "--no-keep-contacts"
    out = tmp_path / "out.npz"
    jaxmotion(*words, "-o", out, "--method", "medoid")
    want = jm.cleaning.repair(
        a, [good], levels=[jm.cleaning.clean_levels(good)], method="medoid"
    ).motion
    assert np.degrees(jm.metrics.turn(jm.load(out).rotations, want.rotations)).max() < 0.1
    told = jaxmotion(*words, "-o", tmp_path / "other.bvh", "--joint", "Right*").stderr
    assert "nothing found" in told
    assert "no joint matches" in jaxmotion(
        *words, "-o", tmp_path / "x.bvh", "--joint", "Tail", code=1
    ).stderr  # fmt: skip


def test_detect_only_writes_nothing(jaxmotion, takes, clips, tmp_path):
    report = tmp_path / "r.json"
    (takes / "dog.bvh").write_text("HIERARCHY\nROOT")
    words = "repair", takes, "--detect-only"
    before = sorted(tmp_path.rglob("*"))
    result = jaxmotion(*words, "--report", report, code=1)
    assert sorted(tmp_path.rglob("*")) == sorted([*before, report])
    lines = result.stdout.splitlines()
    assert lines[0].startswith(f"{takes / 'a.bvh'}: 1 run, ")
    assert re.match(r"  frames \d+-\d+ +[\d.]+ to [\d.]+ s  LeftArm, [\d.]+°, .*0\.\d\d$", lines[1])
    assert "left out of the context: 1 clip that cannot be read" in lines[2]
    assert f"{takes / 'b.bvh'}: nothing found" in lines
    assert "FAILED" in result.stderr
    a, b, dog = record_in(report)["files"]
    assert [a["status"], b["status"], dog["status"]] == ["read", "read", "failed"]
    [row] = a["learned"]["runs"]
    frames = np.flatnonzero(np.asarray(clips[1].mask).any(axis=1))
    assert abs(row["start"] - frames[0]) <= 1
    assert "nothing would be written" in jaxmotion(*words, "--dry-run").stderr
    assert "exists; add --overwrite" in jaxmotion(*words, "--report", report, code=2).stderr


def test_errors_of_little_confidence_are_told_and_left(jaxmotion, takes, clips, tmp_path):
    """Their joints stay bit for bit, where they are found and where they are repaired."""
    walk, case, _ = clips
    (takes / "dog.bvh").unlink()
    (takes / "a.bvh").unlink()
    joint = walk.skeleton.index("RightArm")
    q = np.array(case.motion.rotations)
    turn = jm.quaternion.exp(np.array([0.35, 0, 0]))
    q[70:82, joint] = jm.quaternion.multiply(q[70:82, joint], turn)
    a = takes / "a.npz"
    jm.save(case.motion.with_transforms(rotations=q), a)
    lines = jaxmotion("repair", a, "--context", takes / "b.bvh", "--detect-only").stdout.split("\n")
    told = {name: line for line in lines for name in ("LeftArm", "RightArm") if name in line}
    sure = {name: float(line[-4:]) for name, line in told.items()}
    assert sure["RightArm"] < sure["LeftArm"] - 0.05
    report, least = tmp_path / "r.json", (sure["RightArm"] + sure["LeftArm"]) / 2
    words = "repair", a, "--context", takes / "b.bvh", "--confidence", least, "--report", report
    text = jaxmotion(*words, "--detect-only").stdout
    assert f"in error; 1 run of confidence below {least:g} left\n" in text
    assert f"{told['RightArm']}, left\n" in text
    assert f"{told['LeftArm']}\n" in text
    looked = record_in(report)["files"][0]
    page, out = tmp_path / "r.html", tmp_path / "out.npz"
    text = jaxmotion(*words[:-1], page, "-o", out).stderr
    assert f"; 1 run of confidence below {least:g} left" in text
    last = told["RightArm"].split()[-1]
    assert re.search(rf"left, in frames \d+-\d+: RightArm, confidence {last}", text)
    repaired = record_in(page)["files"][0]
    assert "<h4>runs_left</h4>" in page.read_text()
    for entry in (looked, repaired):
        assert entry["learned"]["least_confidence"] == least
        assert [row["joints"] for row in entry["learned"]["runs"]] == [["LeftArm"]]
        [row] = entry["learned"]["runs_left"]
        assert row["joints"] == ["RightArm"]
        assert row["confidence"] == pytest.approx(sure["RightArm"], abs=0.006)
    made = np.asarray(jm.load(out).rotations)
    np.testing.assert_array_equal(made[:, joint], np.asarray(jm.load(a).rotations)[:, joint])
    assert off(walk, out, case.mask)[0] < 8
    every = jaxmotion(*words[:4], "-o", tmp_path / "all.npz").stderr
    assert "2 runs, " in every
    assert "left" not in every
    text = jaxmotion(*words[:4], "--confidence", 1, "-o", tmp_path / "none.npz").stderr
    assert "none.npz: 2 runs of confidence below 1 left" in text
    for number in ("-0.1", "1.1", "nan"):
        jaxmotion(*words[:4], "--confidence", number, "--detect-only", code=2)


def test_feet_come_back(jaxmotion, tmp_path):
    """A knee that was repaired stands where its foot does."""
    walk = walking()
    joint = walk.skeleton.index("LeftLeg")
    case = jm.samples.offset_joints(walk, jax.random.key(3), runs=1, joints=[joint], length=(8, 9))
    take = tmp_path / "take.npz"
    jm.save(case.motion, take)
    told = jaxmotion("repair", take, "-o", tmp_path / "kept.npz").stderr
    jaxmotion("repair", take, "-o", tmp_path / "free.npz", "--no-keep-contacts")
    assert "feet slid at" in told
    contacts = jm.contacts.detect(walk)
    slides = {
        name: float(jm.metrics.foot_skate(jm.load(tmp_path / f"{name}.npz"), contacts))
        for name in ("kept", "free")
    }
    assert slides["kept"] <= slides["free"] * 1.001
    assert off(walk, tmp_path / "kept.npz", case.mask)[0] < 5


@pytest.mark.parametrize("frames", [2, 9])
def test_a_clip_too_short_for_a_word(jaxmotion, takes, tmp_path, frames):
    short = takes / "short.bvh"
    jm.save(walking(0, frames), short)
    (takes / "dog.bvh").unlink()
    out = tmp_path / "out"
    told = jaxmotion("repair", short, takes / "b.bvh", "-o", out).stderr
    assert told.count("nothing found") == 2
    assert (out / "short.bvh").read_bytes() == short.read_bytes()


def test_side_by_side(jaxmotion, takes, tmp_path):
    """Workers say the same, and send their pictures."""
    report = tmp_path / "r.html"
    (takes / "dog.bvh").unlink()
    words = "repair", takes, "--jobs", 2, "--no-cache"
    told = jaxmotion(*words, "-o", tmp_path / "out", "--report", report).stderr
    assert "a.bvh: 1 run, " in told
    assert len(_page.pictures_in(report.read_text())) == 2


def test_what_is_wrong_is_said(jaxmotion, takes, tmp_path):
    assert "say where to write" in jaxmotion("repair", takes, code=2).stderr
    jaxmotion("repair", takes, "-o", tmp_path / "o", "--context", tmp_path / "none", code=2)
    told = jaxmotion("repair", takes, "-o", tmp_path / "o", "--dry-run").stderr
    assert "3 files would be written." in told
    assert not (tmp_path / "o").exists()


def test_pictures_need_matplotlib(jaxmotion, takes, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    report = tmp_path / "r.html"
    jaxmotion("repair", takes / "b.bvh", "--detect-only", "--report", report)
    text = report.read_text()
    assert "pictures need Matplotlib: pip install &#x27;jaxmotion[viz]&#x27;" in text
    assert "<img" not in text


def test_pictures_of_names_that_are_code():
    title = '"><script>\x1b</div>'
    text = _pictures.shown([_pictures.Drawing(title, b"\x89PNG"), _pictures.Drawing(title)])
    assert "<script>" not in text
    assert "\x1b" not in text
    assert "</div>" not in text
    page = f'<div class="pictures" data-input="a">\n{text}\n</div>'
    assert _page.pictures_in(page) == {"a": text}
