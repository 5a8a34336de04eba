"""``transfer`` gives files the library's result, from a clip or a kept style."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cli import transfer
from jaxmotion.style import StyleReport, apply_style, motion_style, transfer_style
from tests.cli.conftest import swinging
from tests.helpers import assert_same_rotation


@pytest.fixture
def other(tmp_path):
    """A file of a clip like the take, that swings wider about another posture."""
    clip = swinging()
    turn = jm.quaternion.exp(np.array([0.4, 0.1, 0.0]))
    wide = jm.quaternion.power(clip.rotations, 1.5)
    posed = jm.quaternion.multiply(wide, turn)[:31]
    path = tmp_path / "other.bvh"
    jm.save(clip[:31].with_transforms(rotations=posed), path)
    return path


def test_it_is_the_library_s(jaxmotion, take, other, tmp_path):
    result = jaxmotion(
        *("transfer", take, "-o", tmp_path / "out.npz", "--reference", other),
        *("--report", tmp_path / "r.json", "--amount", 0.8, "--no-keep-contacts"),
    )
    source, reference = jm.load(take), jm.load(other)
    wanted = transfer_style(source, reference, strength=0.8, keep_contacts=False)
    got = jm.load(tmp_path / "out.npz")
    assert_same_rotation(got.rotations, wanted.motion.rotations, 1e-5)
    np.testing.assert_allclose(got.translations, wanted.motion.translations, atol=1e-4)
    assert "posture: " in result.stderr
    [row] = json.loads((tmp_path / "r.json").read_text())["files"]
    style = {entry["joint"]: entry for entry in row["learned"]["style"]}
    turned = np.degrees(np.asarray(wanted.report.turned))
    for j, name in enumerate(source.skeleton.names):
        if name in style:
            np.testing.assert_allclose(style[name]["degrees"], turned[j], atol=0.01)


def test_a_kept_style(jaxmotion, take, other, tmp_path):
    style = motion_style(jm.load(other))
    style.save(tmp_path / "style.npz")
    words = "transfer", take, "-o", tmp_path / "out.npz", "--no-keep-contacts", "--overwrite"
    jaxmotion(*words, "--reference", tmp_path / "style.npz")
    wanted = apply_style(jm.load(take), style, keep_contacts=False)
    assert_same_rotation(jm.load(tmp_path / "out.npz").rotations, wanted.rotations, 1e-5)
    # A motion's archive is a clip, and anything else neither.
    jm.save(jm.load(other), tmp_path / "clip.npz")
    jaxmotion(*words, "--reference", tmp_path / "clip.npz")
    np.savez(tmp_path / "else.npz", x=np.zeros(3))
    result = jaxmotion(*words, "--reference", tmp_path / "else.npz", code=1)
    assert "MotionStyle" in result.stderr


def test_a_folder_reads_its_reference_once(jaxmotion, take, other, tmp_path, monkeypatch):
    clips, asked = tmp_path / "clips", []
    clips.mkdir()
    for frames in (40, 33, 21):
        jm.save(swinging(frames), clips / f"{frames}.bvh")
    read = transfer.read
    monkeypatch.setattr(transfer, "read", lambda *a, **b: asked.append(a) or read(*a, **b))
    jaxmotion(
        *("transfer", clips, "-o", tmp_path / "out", "--reference", other, "--no-keep-contacts")
    )
    assert len(list((tmp_path / "out").glob("*.bvh"))) == 3
    assert len(asked) == 1


def test_joints_that_the_source_holds_still_are_named():
    turned, still = jnp.radians(jnp.array([3.0, 0, 0])), jnp.array([False, False, True])
    report = StyleReport(("hips", "arm", "toe"), turned, turned, still, jnp.ones(()), ())
    assert transfer.in_brief(report) == (
        "posture: hips 3°; still in the source, nothing to scale: toe"
    )


def test_a_selection_stays_one(jaxmotion, take, other, tmp_path):
    source = jm.load(take)
    joint = source.skeleton.names[-1]
    jaxmotion(
        *("transfer", take, "-o", tmp_path / "out.npz", "--reference", other),
        *("--joints", joint, "--range", "10:20", "--no-keep-contacts"),
    )
    got = jm.load(tmp_path / "out.npz")
    changed = np.abs(np.asarray(got.rotations) - np.asarray(source.rotations)).max(axis=-1) > 1e-5
    assert changed[:, -1].any()
    assert not changed[:, :-1].any()
    assert not changed[:10].any()
    assert not changed[20:].any()


def test_what_is_refused(jaxmotion, take, tmp_path):
    out = tmp_path / "out.npz"
    assert "--reference" in jaxmotion("transfer", take, "-o", out, code=2).stderr
    strange = swinging()
    names = tuple(f"x{j}" for j in range(strange.num_joints))
    skeleton = jm.Skeleton(names, strange.skeleton.parents, strange.skeleton.offsets)
    jm.save(strange.replace(skeleton=skeleton), tmp_path / "strange.npz")
    words = "transfer", take, "-o", out, "--reference", tmp_path / "strange.npz"
    assert "another skeleton" in jaxmotion(*words, code=1).stderr
    assert not out.exists()


def test_tempo_brings_the_time_and_keeps_the_rate(jaxmotion, take, other, tmp_path):
    """A reference that is played at half speed: the result is longer by the ratio of tempos."""
    slow = jm.load(other)
    jm.save(slow.replace(frame_time=2 * float(slow.frame_time)), tmp_path / "slow.bvh")
    words = "transfer", take, "-o", tmp_path / "out.bvh", "--no-keep-contacts", "--tempo"
    jaxmotion(*words, "--reference", tmp_path / "slow.bvh")
    source, result = jm.load(take), jm.load(tmp_path / "out.bvh")
    reference = jm.load(tmp_path / "slow.bvh")
    found = transfer_style(source, reference, tempo=True, keep_contacts=False)
    wanted = jm.resample(found.motion, fps=float(source.fps))
    assert len(result) == len(wanted) > 1.5 * len(source)
    assert result.frame_time_text == source.frame_time_text
    assert_same_rotation(result.rotations, wanted.rotations, 1e-3)
    told = jaxmotion(*words, "--reference", other, "--range", "2:9", code=2).stderr
    assert "whole clip" in told
