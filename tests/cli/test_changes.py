"""The line that tells what was turned most, and the rows of a report."""

import json
from types import SimpleNamespace

import equinox as eqx
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cli._changes import frames_in_brief, in_brief, of_joints
from jaxmotion.cli._padding import pad
from jaxmotion.smoothing import Removal, removed
from tests.cli.conftest import swinging


class Touching(eqx.Module):
    """Contacts of points on joints, no more than is asked for."""

    mask: np.ndarray
    joints: tuple[int, ...] = eqx.field(static=True)


def row(joint, degrees, *stands_out, contact=None, noise=0.41):
    found = Removal(joint, degrees, 374, 12.4, 0.6, 0.021, 0.0, 0.0, contact, stands_out)
    return found._asdict() | {"noise": noise}


def test_what_is_told():
    toe, hand = row("Toe", 3.217), row("Hand", 2.0, noise=None)
    assert in_brief([]) == ""
    little = [row("Hand", 0.004), row("Toe", 0.049, "lean")]
    assert in_brief(little) == "next to no noise: at most 0.049°, Toe"
    first = "turned most: Toe by 3.22° at frame 374 (noise 0.41°, 2.1 % of variance)"
    assert in_brief([toe]) == first
    assert "(noise 0.41°, 99 % of variance)" in in_brief([toe | {"share": 0.998}])
    others = [hand, *(row(name, 1.0) for name in "ABC")]
    told = in_brief([toe, *others])
    assert told.startswith(f"{first}, Hand by 2° at frame 374 (2.1 % of variance), A by")
    assert told.count("frame") == 3


def test_dropped_frames_are_told(jaxmotion, tmp_path):
    clip = swinging()
    kept = np.maximum.accumulate(np.where(np.isin(np.arange(40), [7, 15, 16]), 0, range(40)))
    clip = clip.with_transforms(clip.translations[kept], clip.rotations[kept])
    jm.save(clip, tmp_path / "take.npz")
    report = tmp_path / "r.json"
    words = ("denoise", tmp_path / "take.npz", "-o", tmp_path / "out.npz", "--report", report)
    assert "made anew 3 dropped frames: 7, 15, 16" in jaxmotion(*words).stderr
    [file] = json.loads(report.read_text())["files"]
    assert [row["frame"] for row in file["learned"]["dropped"]] == [7, 15, 16]
    assert file["learned"]["dropped"][0]["seconds"] == pytest.approx(7 * float(clip.frame_time))


def test_a_few_of_many_frames_are_named():
    assert frames_in_brief([]) == ""
    assert frames_in_brief([{"frame": 3}]) == "made anew 1 dropped frame: 3"
    many = frames_in_brief([{"frame": t} for t in range(20)])
    assert many == "made anew 20 dropped frames: 0, 1, 2, 3, 4, 5, 6, 7 and 12 more"


def test_what_is_not_like_noise_is_told_by_joint():
    odd = row("Foot", 0.6, "correlation", "lean", "contact", contact=0.2)
    assert in_brief([odd]).endswith(
        "; not like noise, 1 joint: Foot (lasts over frames, one-sided, less in contact)"
    )
    more = [row(name, 1.0, "contact", contact=3.0) for name in "ABCD"]
    told = in_brief([row("Toe", 3.0), *more])
    assert told.endswith(
        "; not like noise, 4 joints: A (more in contact), B (more in contact), C (more in contact)"
    )
    assert "not like noise" not in in_brief([row("Toe", 3.0), row("Foot", 0.4, "lean")])


def test_rows_are_of_the_frames_that_count(monkeypatch):
    """Padding is not looked at, and each joint has its own noise."""
    from jaxmotion.cli import _feet

    motion, length = pad(swinging(40))
    assert motion.num_frames > length
    clean, _ = pad(swinging(40, noise=0.0))
    rotations = np.array(clean.rotations)
    rotations[:, 3] = motion.rotations[:, 3]  # as it was
    rotations[length:] = [1, 0, 0, 0]
    clean = clean.with_transforms(rotations=rotations)
    mask = np.arange(motion.num_frames)[:, None] % 7 < 3
    touching = Touching(mask, (2,))
    monkeypatch.setattr(_feet, "find_feet", lambda motion, length: touching)
    sigma = np.radians([0.5, 1.0, 1.5, 2.0]) / 2
    tuning = SimpleNamespace(rotations=SimpleNamespace(sigma=sigma))
    found = of_joints(motion, clean, length, tuning)
    cut = [m.with_transforms(m.translations[:40], m.rotations[:40]) for m in (motion, clean)]
    want = removed(*cut, contacts=Touching(mask[:40], (2,)))
    noise = {"Hips": 0.5, "LeftArm": 1.0, "LeftHand": 1.5}
    assert [line["joint"] for line in found] == [line.joint for line in want]
    for line, same in zip(found, want, strict=True):
        assert line.pop("noise") == pytest.approx(noise[same.joint])
        assert line == same._asdict()
    assert of_joints(motion, clean, length, None)[0]["noise"] is None
