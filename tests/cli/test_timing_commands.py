"""What retime and align do to files."""

import json
import sys

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.timing import align
from tests.cli.conftest import assert_same_clip, record_in, swinging


def test_retime_resamples(jaxmotion, take, tmp_path):
    motion, out = jm.load(take), tmp_path / "out.npz"
    result = jaxmotion("retime", take, "-o", out, "--to-fps", "24")
    assert_same_clip(jm.load(out), jm.resample(motion, fps=24))
    assert "40 frames (1.3 s at 30 a second) to 32 frames (1.292 s at 24 a second)" in result.stderr
    jaxmotion("retime", take, "-o", out, "--overwrite", "--frames", "50", "--method", "slerp")
    assert_same_clip(jm.load(out), jm.resample(motion, num_frames=50, method="slerp"))
    jaxmotion("retime", take, "-o", tmp_path / "out.bvh", "--to-fps", "23.976")
    assert jm.load(tmp_path / "out.bvh").fps == pytest.approx(23.976, rel=1e-6)


def test_retime_warps_time(jaxmotion, take, tmp_path):
    motion, out = jm.load(take), tmp_path / "out.npz"
    words = ("retime", take, "-o", out, "--overwrite")
    jaxmotion(*words, "--slow", "0.25", "--ease-out", "0.4")
    assert_same_clip(jm.load(out), jm.time_warp(motion, amount=0.25, ease=(0, 0.4)))
    jaxmotion(*words, "--slow", "0.25", "--keep-duration")
    assert_same_clip(jm.load(out), jm.time_warp(motion, amount=0.25, num_frames=40))
    jaxmotion(*words, "--at", "0.5=0.8", "--at", "1=1.2", "--to-fps", "60")
    warped = jm.time_warp(motion, pairs=[(0.5, 0.8), (1, 1.2)])
    assert_same_clip(jm.load(out), jm.resample(warped, fps=60))
    jaxmotion(*words, "--speed", "0.75")
    slow = jm.load(out)
    assert (slow.num_frames, slow.fps) == (53, motion.fps)
    third = jm.resample(motion, num_frames=4 * 39 + 1)
    np.testing.assert_allclose(slow.rotations, third.rotations[::3], atol=2e-3)


def test_retime_goes_through_folders_and_tells_of_failures(jaxmotion, tmp_path):
    folder = tmp_path / "takes"
    (folder / "day 1").mkdir(parents=True)
    jm.save(swinging(12), folder / "a.bvh")
    jm.save(swinging(30, seed=1), folder / "day 1" / "b.bvh")
    out, report = tmp_path / "out", tmp_path / "r.html"
    words = ("retime", folder, "-o", out, "--at", "0.5=0.7")
    result = jaxmotion(*words, "--report", report, code=1)
    assert "1 written, 1 failed." in result.stderr
    assert "the end of the clip, 0.366667 s" in result.stderr
    assert jm.load(out / "day 1" / "b.bvh").num_frames == 36
    assert not (out / "a.bvh").exists()
    rows = {row["status"]: row for row in record_in(report)["files"]}
    assert "36 frames" in rows["written"]["message"]
    assert (rows["written"]["frames"], rows["written"]["result"]["frames"]) == (30, 36)
    assert ">frames now</button>" in report.read_text()
    assert ">a second now</button>" not in report.read_text()
    assert jaxmotion(*words, "--resume", "--dry-run").exit_code == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "say what"),
        (("--to-fps", "24", "--frames", "3"), "both set the rate"),
        (("--slow", "1", "--at", "1=2"), "all set the timing"),
        (("--speed", "2", "--at", "1=2"), "all set the timing"),
        (("--speed", "0"), "0"),
        (("--keep-duration",), "--keep-duration goes with"),
        (("--at", "1:2"), "not of the form '1.5=2.0'"),
        (("--at", "1=2", "--at", "0.5=3"), "0.5=3 does not come after 1=2"),
        (("--at", "0.5=-1"), "0.5=-1 does not come after 0=0"),
        (("--to-fps", "0"), "0"),
        (("--slow", "-1"), "-1"),
    ],
)
def test_retime_usage(jaxmotion, take, tmp_path, words, message):
    result = jaxmotion("retime", take, "-o", tmp_path / "out.bvh", *words, code=2)
    assert message in result.stderr
    assert not (tmp_path / "out.bvh").exists()


@pytest.fixture
def slow(tmp_path):
    """The take, slowed, in another file."""
    path = tmp_path / "slow.npz"
    jm.save(jm.time_warp(swinging(noise=0.0), amount=0.5), path)
    return path


def test_align(jaxmotion, take, slow, tmp_path):
    out, path, plot = tmp_path / "o" / "out.npz", tmp_path / "p" / "path.json", tmp_path / "p.png"
    result = jaxmotion("align", take, slow, "-o", out, "--path", path, "--plot", plot)
    want = align(jm.load(take), jm.load(slow))
    assert_same_clip(jm.load(out), want.motion)
    facts = json.loads(path.read_text())
    pairs = np.asarray(want.path)[: int(want.length)]
    np.testing.assert_array_equal(facts["pairs"], pairs)
    np.testing.assert_allclose(facts["source_frame"], want.source_frame, atol=1e-6)
    assert facts["rms_degrees"] == pytest.approx(np.degrees(float(want.distance)))
    assert (facts["source"], facts["reference"]) == (str(take), str(slow))
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert "out.npz: 40 frames in the time of 59, held" in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert "(rms); 3 of 3 joints compared" in result.stderr


def test_align_refuses_skeletons_that_share_few_joints(jaxmotion, take, tmp_path):
    motion = swinging(20)
    skeleton = motion.skeleton
    names = ["Hips", "LeftArm", "hand", "arm"]
    strange = jm.Skeleton(names, skeleton.parents, skeleton.offsets)
    jm.save(jm.Motion(strange, motion.translations, motion.rotations, 1 / 30), tmp_path / "b.npz")
    words = ("align", take, tmp_path / "b.npz", "-o", tmp_path / "out.npz")
    told = jaxmotion(*words, code=1).stderr
    assert "only 1 of 3 joints have one of the same name in the other clip; --few-joints" in told
    assert not (tmp_path / "out.npz").exists()
    assert "1 of 3 joints compared" in jaxmotion(*words, "--few-joints").stderr


def test_align_by_warping(jaxmotion, take, slow, tmp_path):
    out, path = tmp_path / "out.npz", tmp_path / "path.json"
    words = ("align", slow, take, "-o", out, "--path", path, "--method", "warping", "--settle", "0")
    jaxmotion(*words)
    want = align(jm.load(slow), jm.load(take), method="warping", settle=0.0)
    assert_same_clip(jm.load(out), want.motion)
    pairs = json.loads(path.read_text())["pairs"]
    assert pairs == [list(p) for p in dict.fromkeys(map(tuple, np.asarray(want.path).tolist()))]


def test_align_refuses(jaxmotion, take, slow, tmp_path, monkeypatch):
    out = tmp_path / "out.bvh"
    out.write_text("precious")
    assert "exists; add --overwrite" in jaxmotion("align", take, slow, "-o", out, code=1).stderr
    assert out.read_text() == "precious"
    words = ("align", take, slow, "-o", tmp_path / "new.bvh")
    assert "over an input" in jaxmotion("align", take, slow, "-o", take, code=2).stderr
    assert "expected a .bvh" in jaxmotion("align", take, slow, "-o", "x.txt", code=2).stderr
    assert "the same file" in jaxmotion(*words, "--path", tmp_path / "new.bvh", code=2).stderr
    assert "ends neither" in jaxmotion(*words, "--plot", "x.jpg", code=2).stderr
    assert "does not exist" in jaxmotion("align", take, "no.bvh", "-o", out, code=2).stderr
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert "jaxmotion[viz]" in jaxmotion(*words, "--plot", tmp_path / "x.png", code=1).stderr
    assert jaxmotion(*words, "--dry-run").stdout.strip() == str(tmp_path / "new.bvh")
    assert not (tmp_path / "new.bvh").exists()
    (tmp_path / "broken.bvh").write_text("nonsense")
    assert (
        "broken.bvh"
        in jaxmotion(
            "align", take, tmp_path / "broken.bvh", "-o", tmp_path / "new.bvh", code=1
        ).stderr
    )
