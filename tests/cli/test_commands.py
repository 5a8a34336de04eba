"""What each command does to files."""

import json
import re
from importlib import import_module
from itertools import pairwise

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import quaternion
from tests.cli.conftest import swinging
from tests.helpers import assert_same_rotation

PLAIN = ("--lam", "1", "--sigma", "1")


def degrees(a, b):
    from jaxmotion.metrics import turn

    return np.degrees(turn(a.rotations, b.rotations))


@pytest.fixture(scope="module")
def denoised():
    """The take of 40 frames and its denoised version, by the library."""
    return swinging(), jm.denoise(swinging(), lam=1.0, sigma=1.0)


def test_denoise_is_the_library_s(jaxmotion, take, tmp_path, denoised):
    report = tmp_path / "r.json"
    out = tmp_path / "clean" / "out.bvh"
    result = jaxmotion("denoise", take, "-o", out, *PLAIN, "--report", report)
    assert "40 of 40 frames changed, by up to" in result.stderr
    got = jm.load(out)
    assert_same_rotation(got.rotations, denoised[1].rotations, 1e-9)
    np.testing.assert_allclose(got.translations, denoised[1].translations, atol=1e-9)
    [row] = json.loads(report.read_text())["files"]
    changes = row["changes"]
    assert changes["degrees"]["max"] == pytest.approx(degrees(*denoised).max(), rel=1e-6)
    assert changes["degrees"]["mean"] == pytest.approx(degrees(*denoised).mean(), rel=1e-6)
    assert changes["distance"]["max"] > 0
    assert (row["frames"], changes["frames_changed"]) == (40, 40)


def test_strength_joints_and_range(jaxmotion, take, tmp_path, denoised):
    before, full = denoised
    out = tmp_path / "out.npz"
    words = ("denoise", take, "-o", out, *PLAIN, "--overwrite")
    jaxmotion(*words, "--joints", "left*", "--range", "10:30", "--fade", "4", "--strength", "0.5")
    got = jm.load(out)
    changed = degrees(before, got)
    outside = np.r_[0:10, 30:40]
    assert changed[outside].max() < 1e-9
    assert changed[:, [0, 3]].max() < 1e-9
    np.testing.assert_allclose(
        changed[14:26, 1:3], 0.5 * degrees(before, full)[14:26, 1:3], atol=1e-9
    )
    assert np.all(changed[10, 1:3] < 0.1 * degrees(before, full)[10, 1:3] + 1e-9)
    np.testing.assert_array_equal(got.translations[outside], jm.load(take).translations[outside])


def test_denoise_options_reach_the_library(jaxmotion, take, tmp_path, monkeypatch):
    out = tmp_path / "out.npz"
    jaxmotion("denoise", take, "-o", out)
    assert_same_rotation(jm.load(out).rotations, jm.denoise(jm.load(take)).rotations, 1e-6)
    asked = {
        ("--method", "geodesic"): {"method": "geodesic"},
        ("--robust",): {"robust": True},
        ("--paper",): {"tune": False},
        ("--auto",): {"tune": True},
        ("--prior", "gaussian", "--max-change", "0.5"): {
            "prior": "gaussian",
            "max_change": np.radians(0.5),
        },
    }
    module = import_module("jaxmotion.layers.synthesize")  # layers has a function of that name
    told, library = [], module.denoised

    def quick(motion, length, **options):
        told.append(options)
        return library(motion, lam=1.0, sigma=1.0, length=length)

    monkeypatch.setattr(module, "denoised", quick)
    for words in asked:
        jaxmotion("denoise", take, "-o", out, "--overwrite", *words)
    assert told == list(asked.values())
    result = jaxmotion("denoise", take, "-o", out, "--overwrite", "--auto", "--lam", "2", code=2)
    assert "--auto learns" in result.output


def test_denoise_robust_lists_what_it_bridged(jaxmotion, take, tmp_path):
    motion, out = jm.load(take), tmp_path / "out.npz"
    spiked = tmp_path / "spiked.bvh"
    away = np.zeros((40, 4, 3))
    away[20:22, 1, 0], away[30, 3, 1] = 1.0, 1.5
    turned = quaternion.multiply(motion.rotations, quaternion.exp(away))
    jm.save(motion.with_transforms(rotations=turned), spiked)
    words = ("denoise", spiked, "-o", out, "--overwrite", "--robust", *PLAIN)
    told = jaxmotion(*words).stderr
    assert re.search(r"bridged 2 spikes: LeftArm 20-21 by 5\d.*°, RightArm 30 by 8\d.*°", told)
    assert degrees(motion, jm.load(out))[[20, 21, 30], [1, 1, 3]].max() < 10
    told = jaxmotion(*words, "--joints", "Right*").stderr
    assert re.search(r"bridged 1 spike: RightArm 30 by", told)
    assert "bridged" not in jaxmotion("denoise", take, *words[2:]).stderr


def test_a_pattern_without_joints_and_an_empty_range_fail(jaxmotion, take, tmp_path):
    words = ("denoise", take, "-o", tmp_path / "out.bvh", *PLAIN)
    assert "the joints are Hips" in jaxmotion(*words, "--joints", "Tail*", code=1).stderr
    assert "none of the 40 frames" in jaxmotion(*words, "--range", "50:60", code=1).stderr


@pytest.mark.parametrize("frames", [1, 2])
def test_tiny_clips(jaxmotion, tmp_path, frames):
    jm.save(swinging(frames), tmp_path / "in.bvh")
    jaxmotion("denoise", tmp_path / "in.bvh", "-o", tmp_path / "out.bvh", *PLAIN)
    assert len(jm.load(tmp_path / "out.bvh")) == frames


def test_style(jaxmotion, take, tmp_path):
    motion = swinging()
    out = tmp_path / "out.npz"
    words = ("style", take, "-o", out, "--overwrite")
    jaxmotion(*words, "--alpha", "2")
    assert_same_rotation(jm.load(out).rotations, jm.stylize(motion, 2.0).rotations, 1e-9)
    jaxmotion(*words, "--gain", "*Arm=1.5", "--gain", "Left*=0.5")
    gains = np.array([1.0, 0.5, 0.5, 1.5])
    assert_same_rotation(jm.load(out).rotations, jm.stylize(motion, gains).rotations, 1e-9)
    assert "say how much" in jaxmotion(*words, code=2).stderr


def test_layers(jaxmotion, take, tmp_path, denoised):
    out = tmp_path / "parts"
    result = jaxmotion("layers", take, "-o", out)
    assert sorted(p.name for p in out.iterdir()) == ["base.bvh", "denoised.bvh", "layers.npz"]
    layers = jm.decompose(swinging())
    hertz = 30 / np.pi * np.arcsin(1 / np.sqrt(2 * layers.lam * layers.sigma))
    assert f"base below {hertz:.4g} Hz (lambda" in result.stderr
    turns = np.degrees(np.linalg.norm(layers.control.rotations, axis=-1))
    told = f"style, below 7.5 Hz, turns up to {turns.max():.3g}°, rms "
    assert told in result.stderr
    assert f"rms {np.sqrt(np.mean(turns**2)):.3g}°; noise turns up to" in result.stderr
    assert_same_rotation(jm.load(out / "base.bvh").rotations, layers.base.rotations, 1e-9)
    assert_same_rotation(jm.load(out / "denoised.bvh").rotations, denoised[1].rotations, 1e-9)
    with np.load(out / "layers.npz", allow_pickle=False) as parts:
        np.testing.assert_allclose(parts["control_rotations"], layers.control.rotations, atol=1e-9)
        np.testing.assert_allclose(
            parts["residual_translations"], layers.residual.translations, atol=1e-9
        )
        assert parts["lam"] == layers.lam
        assert list(parts["joints"]) == list(swinging().skeleton.names)
    assert "exists" in jaxmotion("layers", take, "-o", out, code=1).stderr


def test_convert_between_all_formats(jaxmotion, take, tmp_path):
    chain = [take, *(tmp_path / f"x.{suffix}" for suffix in ("amc", "npz")), tmp_path / "y.bvh"]
    for source, target in pairwise(chain):
        jaxmotion("convert", source, "-o", target, "--fps", "30")
    from jaxmotion.metrics import world_positions

    np.testing.assert_allclose(
        world_positions(jm.load(chain[-1]))[:, :4], world_positions(swinging())[:, :4], atol=1e-6
    )
    assert "which format" in jaxmotion("convert", take, "-o", tmp_path / "dir", code=2).stderr


def test_convert_leaves_out_positions_of_still_joints(jaxmotion, tmp_path):
    motion = swinging(frames=3)
    six = [jm.skeleton.DEFAULT_ROOT_CHANNELS] * 4
    places = np.array(motion.translations)
    places[:, 1] += 1
    skeleton = jm.Skeleton(
        motion.skeleton.names, motion.skeleton.parents, motion.skeleton.offsets, channels=six
    )
    jm.save(jm.Motion(skeleton, places, motion.rotations, 1 / 30), tmp_path / "a.bvh")
    words = ("convert", tmp_path / "a.bvh", "--no-still-positions", "-o")
    jaxmotion(*words, tmp_path / "b.bvh")
    kept, lean = jm.load(tmp_path / "a.bvh"), jm.load(tmp_path / "b.bvh")
    assert [len(names) for names in kept.skeleton.channels] == [6, 6, 6, 6]
    assert [len(names) for names in lean.skeleton.channels] == [6, 3, 3, 3]
    np.testing.assert_array_equal(lean.skeleton.offsets[1], [3, 6, 1])
    np.testing.assert_array_equal(lean.translations, kept.translations)
    assert "goes with outputs in BVH" in jaxmotion(*words, tmp_path / "b.npz", code=2).stderr


def test_info(jaxmotion, take, tmp_path):
    text = jaxmotion("info", take, "--tree").stdout
    for piece in ("40 at 30 a second", "4, and 1 end sites", "LeftHand", "end site", "Hips"):
        assert piece in text
    (tmp_path / "bad.bvh").write_text("nonsense")
    result = jaxmotion("info", take, tmp_path / "bad.bvh", "--json", code=1)
    [facts] = json.loads(result.stdout)
    assert facts["joints"] == ["Hips", "LeftArm", "LeftHand", "RightArm"]
    assert facts["seconds"] == pytest.approx(39 / 30)  # as retime tells it
    low, high = facts["bounding_box"]
    assert low[1] <= 9 < high[1]
    assert facts["translated_joints"] == ["Hips"]
    assert "bad.bvh" in result.stderr


def test_info_of_a_folder_is_a_table(jaxmotion, take, tmp_path):
    jm.save(swinging(25), tmp_path / "other.npz")
    (tmp_path / "bad.bvh").write_text("nonsense")
    result = jaxmotion("info", tmp_path, code=1)
    head, *rows = result.stdout.splitlines()
    assert head.split() == ["frames", "rate", "seconds", "joints", "height", "up", "file"]
    cells = {row.split()[-1]: row.split()[:4] for row in rows}
    assert cells == {
        str(tmp_path / "other.npz"): ["25", "30", "0.80", "4"],
        str(take): ["40", "30", "1.30", "4"],
    }
    assert "FAILED" in result.stderr
    assert "2 files, 65 frames, 2.1 s" in result.stderr
    assert "LeftHand" in jaxmotion("info", tmp_path, "--tree", code=1).stdout


def test_check(jaxmotion, tmp_path):
    good = tmp_path / "good.npz"
    jm.save(swinging(noise=0.0), good)
    assert jaxmotion("check", good).stdout.strip() == f"{good}: ok"
    motion = swinging(noise=0.0)
    rotations = np.array(motion.rotations)
    rotations[20, 2] = [0, 1, 0, 0]
    rotations[30:, 1] *= -1
    bad = tmp_path / "bad.npz"
    jm.save(motion.with_transforms(rotations=rotations), bad)
    result = jaxmotion("check", good, bad, code=3)
    assert "LeftHand, frame 20" in result.stdout
    assert "1 of 2 files have problems." in result.stderr
    assert f"  spike         1 in {bad}\n" in result.stderr
    assert f"  flip (note)   3 in {bad}\n" in result.stderr
    found = json.loads(jaxmotion("check", bad, "--json", code=3).stdout)[0]["problems"]
    kinds = {(p["kind"], p["frame"], p["joint"]) for p in found}
    assert ("spike", 20, "LeftHand") in kinds
    assert ("flip", 30, "LeftArm") in kinds
    words = ("check", bad, "--ignore", "spike", "--ignore", "jump")
    jaxmotion(*words)
    jaxmotion(*words, "--strict", code=3)
    assert "kinds are" in jaxmotion("check", bad, "--ignore", "spikes", code=2).stderr


def test_check_tells_of_unreadable_and_repaired_files(jaxmotion, take, tmp_path):
    text = take.read_text()
    broken, cut = tmp_path / "broken.bvh", tmp_path / "cut.bvh"
    broken.write_text(text[:100])
    cut.write_text(text.replace("Frames: 40", "Frames: 41"))
    result = jaxmotion("check", broken, cut, "--json", code=3)
    kinds = [[p["kind"] for p in entry["problems"]] for entry in json.loads(result.stdout)]
    assert kinds[0] == ["unreadable"]
    assert kinds[1][0] == "repaired"


def test_demo(jaxmotion, tmp_path):
    out = tmp_path / "demo"
    result = jaxmotion("demo", "-o", out)
    clips = {name: jm.load(out / f"{name}.bvh") for name in ("clean", "noisy", "denoised")}
    assert (out / "exaggerated.bvh").exists()
    assert (out / "broken.bvh").exists()
    off = {name: degrees(clips["clean"], clip).mean() for name, clip in clips.items()}
    assert off["denoised"] < 0.8 * off["noisy"]
    assert "denoised" in result.stdout
    assert "cm" in result.stdout
    assert "exists" in jaxmotion("demo", "-o", out, code=1).stderr


def test_a_real_capture_goes_through(jaxmotion, data_dir, tmp_path):
    source = sorted((data_dir / "bandai").glob("bow_*.bvh"))[0]
    out = tmp_path / "out.bvh"
    jaxmotion("denoise", source, "-o", out, *PLAIN, "--range", ":20")
    before, after = jm.load(source), jm.load(out)
    assert after.skeleton.names == before.skeleton.names
    assert_same_rotation(after.rotations[20:], before.rotations[20:], 1e-9)
    assert jaxmotion("info", out, "--json").exit_code == 0
