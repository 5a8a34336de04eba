"""What multires, blend and stitch do to files."""

import shutil

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cli import multires
from jaxmotion.multiresolution import blend, build_pyramid, level_of_detail, scale_details, stitch
from jaxmotion.multiresolution.pyramid import DEEPEST
from jaxmotion.multiresolution.stitching import stitched
from tests.cli.conftest import assert_same_clip, swinging
from tests.helpers import assert_same_rotation


@pytest.fixture
def other(tmp_path):
    """Another take of 40 frames."""
    path = tmp_path / "other.npz"
    jm.save(swinging(seed=1), path)
    return path


def test_multires(jaxmotion, take, tmp_path):
    pyramid, out = build_pyramid(jm.load(take), 3), tmp_path / "o" / "out.npz"
    jaxmotion("multires", take, "-o", out, "--gains", "1,1.5,0")
    assert_same_clip(jm.load(out), scale_details(pyramid, np.array([1, 1.5, 0])))
    words = ("multires", take, "-o", out, "--overwrite", "--levels", "3", "--level", "1.5")
    jaxmotion(*words)
    assert_same_clip(jm.load(out), level_of_detail(pyramid, 1.5))
    jaxmotion(*words, "--joints", "Left*")
    edited, before = jm.load(out), jm.load(take)
    assert_same_rotation(edited.rotations[:, 3], before.rotations[:, 3], 1e-9)
    assert np.max(jm.quaternion.distance(edited.rotations[:, 1], before.rotations[:, 1])) > 0.01


def test_multires_goes_through_folders_and_tells_of_failures(jaxmotion, tmp_path):
    folder, out = tmp_path / "takes", tmp_path / "out"
    folder.mkdir()
    jm.save(swinging(40), folder / "a.bvh")
    (folder / "b.bvh").write_text("HIERARCHY\n")
    result = jaxmotion("multires", folder, "-o", out, "--gains", "1,0,0", code=1)
    assert "1 written, 1 failed." in result.stderr
    assert jm.load(out / "a.bvh").num_frames == 40
    assert not (out / "b.bvh").exists()


def test_multires_of_short_clips_has_the_finest_of_the_levels(jaxmotion, tmp_path):
    folder, out = tmp_path / "takes", tmp_path / "out"
    folder.mkdir()
    levels = {1: 0, 3: 1, 4: 2}
    for frames in levels:
        jm.save(swinging(frames), folder / f"{frames}.npz")
    result = jaxmotion("multires", folder, "-o", out, "--gains", "0.5,0")
    assert "3 written." in result.stderr
    assert result.stderr.count("warning: ") == 2
    assert "warning: 1 frame: 0 levels of detail, not 2" in result.stderr
    assert "warning: 3 frames: 1 level of detail, not 2" in result.stderr
    for frames, number in levels.items():
        clip, edited = (jm.load(place / f"{frames}.npz") for place in (folder, out))
        pyramid = build_pyramid(clip, number)
        assert_same_clip(edited, scale_details(pyramid, np.array([0.5, 0])[2 - number :]))
        if not number:
            assert_same_clip(edited, clip)
    words = ("--overwrite", "--levels", "4", "--level", "0")
    result = jaxmotion("multires", folder / "3.npz", "-o", out / "3.npz", *words)
    assert "warning: 3 frames: 1 level of detail, not 4" in result.stderr
    assert_same_clip(jm.load(out / "3.npz"), level_of_detail(build_pyramid(swinging(3), 1), 0))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "say what"),
        (("--gains", "1", "--level", "2"), "one of them"),
        (("--gains", "1,x"), "not of the form"),
        (("--gains", "1,1", "--levels", "3"), "disagree"),
        (("--level", "-1"), "-1"),
        (("--level", "40"), "--level 40: there are 6 levels of detail; --levels makes more"),
        (("--level", "3.5", "--levels", "3"), "--level 3.5: there are 3 levels of detail;"),
        (("--level", "1.5", "--levels", "1"), "there is 1 level of detail;"),
    ],
)
def test_multires_usage(jaxmotion, take, tmp_path, words, message):
    result = jaxmotion("multires", take, "-o", tmp_path / "out.bvh", *words, code=2)
    assert message in result.stderr
    assert not (tmp_path / "out.bvh").exists()


def test_there_are_as_many_levels_as_the_library_makes():
    assert multires._DEEPEST == DEEPEST


def test_blend(jaxmotion, take, other, tmp_path):
    out = tmp_path / "o" / "out.npz"
    result = jaxmotion("blend", take, other, take, "-o", out)
    assert_same_clip(jm.load(out), jm.load(other))
    assert "out.npz: 40 frames" in result.stderr
    jaxmotion("blend", take, other, other, "-o", out, "--levels", "2", "--overwrite")
    a, b = jm.load(take), jm.load(other)
    assert_same_clip(jm.load(out), blend(a, b, b, 2))
    jm.save(swinging(12), tmp_path / "short.bvh")
    words = ("blend", take, tmp_path / "short.bvh", other, "-o", tmp_path / "new.bvh")
    assert "40, 12, 40 frames; jaxmotion align" in jaxmotion(*words, code=1).stderr
    assert not (tmp_path / "new.bvh").exists()


def test_stitch(jaxmotion, take, other, tmp_path):
    out = tmp_path / "out.npz"
    result = jaxmotion("stitch", take, other, "-o", out, "--search", "0")
    clips = [jm.load(take), jm.load(other)]
    assert_same_clip(jm.load(out), stitch(clips))
    assert "2 clips in 79 frames, 0 dropped, seam at frame 39 (1.3 s)" in result.stderr
    words = ("stitch", take, other, "-o", out, "--overwrite", "--levels", "2")
    result = jaxmotion(*words, "--no-align", "--search", "0.2")
    want = stitch(clips, 2, align=False, search=6)
    assert_same_clip(jm.load(out), want)
    assert f"{want.num_frames} frames, {79 - want.num_frames} dropped" in result.stderr
    seam = int(result.stderr.split("seam at frame ")[1].split()[0])
    assert 39 - 6 <= seam <= 39
    third = shutil.copy(take, tmp_path / "third.bvh")
    words = (take, other, third, "-o", out, "--overwrite", "--search", "0")
    told = jaxmotion("stitch", *words).stderr
    assert "seams at frame 39 (1.3 s), frame 78 (2.6 s)" in told


def test_keep_contacts(jaxmotion, tmp_path):
    """What it does is the library's: here, that the option arrives."""

    def kept(edit, original):  # one program with what the commands call
        return jm.spacetime.keep_contacts(edit, original, length=edit.num_frames)

    take, out = tmp_path / "walk.bvh", tmp_path / "out.npz"
    jm.save(jm.samples.walk(16, fps=15.0).motion, take)
    words = ("-o", out, "--overwrite", "--keep-contacts")
    walk = jm.load(take)
    jaxmotion("multires", take, "--gains", "2", *words)
    want = kept(scale_details(build_pyramid(walk, 1), 2.0), walk)
    assert_same_rotation(jm.load(out).rotations, want.rotations, 1e-3)
    told = jaxmotion("blend", take, take, take, "--levels", "1", *words).stderr
    assert "out.npz: 16 frames; feet slid at" in told
    want = kept(blend(walk, walk, walk, 1), walk)
    assert_same_rotation(jm.load(out).rotations, want.rotations, 1e-3)
    parts = tmp_path / "begin.bvh", tmp_path / "end.bvh"  # 16 frames again
    for path, part in zip(parts, (walk[:8], walk[7:]), strict=True):
        jm.save(part, path)
    jaxmotion("stitch", *parts, "--levels", "1", "--search", "0", *words)
    found = stitched([jm.load(path) for path in parts], 1)
    assert found.motion.num_frames == 16
    assert_same_rotation(
        jm.load(out).rotations, kept(found.motion, found.end_to_end).rotations, 1e-3
    )


def test_they_refuse(jaxmotion, take, other, tmp_path):
    out = tmp_path / "out.bvh"
    out.write_text("precious")
    words = ("stitch", take, other, "-o")
    assert "exists; add --overwrite" in jaxmotion(*words, out, code=1).stderr
    assert out.read_text() == "precious"
    assert "over an input" in jaxmotion(*words, take, code=2).stderr
    assert "expected a .bvh" in jaxmotion(*words, "x.txt", code=2).stderr
    assert "no file or folder" in jaxmotion("stitch", "no.bvh", "-o", "x.bvh", code=2).stderr
    assert "does not exist" in jaxmotion("blend", take, take, "no.bvh", "-o", out, code=2).stderr
    assert jaxmotion(*words, tmp_path / "n.bvh", "-n").stdout.strip() == str(tmp_path / "n.bvh")
    assert not (tmp_path / "n.bvh").exists()
