"""BVH files that other programs printed with fewer digits: which joints move, and what is kept."""

import dataclasses

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.io import bvh_frames
from jaxmotion.skeleton import DEFAULT_ROOT_CHANNELS


def text(offset, root, leg):
    """Two joints of six channels; rows of the root's and the leg's positions, as spelt."""
    rows = [f"{r} 0 0 0 {p} 0 0 0" for r, p in zip(root, leg, strict=True)]
    six = f"CHANNELS 6 {' '.join(DEFAULT_ROOT_CHANNELS)}"
    return f"""HIERARCHY
ROOT Hips
{{
OFFSET 0 0 0
{six}
JOINT Leg
{{
OFFSET {offset}
{six}
End Site
{{
OFFSET 0 -5 0
}}
}}
}}
MOTION
Frames: {len(rows)}
Frame Time: 0.00833
""" + "\n".join([*rows, ""])


@pytest.fixture
def load(tmp_path):
    def load(content):
        (tmp_path / "clip.bvh").write_text(content)
        return jm.load(tmp_path / "clip.bvh")

    return load


FOUR = "1.36306 -1.79463 0.83929"
CASES = {
    "rounded to four decimals": (FOUR, ["1.3631 -1.7946 0.8393"] * 2, False),
    "cut off instead, a whole unit": (FOUR, ["1.3630 -1.7946 0.8392"] * 2, True),
    "rounded, its zeros taken off": ("3.50003 -1.79463 0", ["3.5 -1.7946 0"] * 2, False),
    "to the digit above and below": (FOUR, ["1.3631 -1.7946 0.8393", "1.363 -1.7946 0.8393"], True),
    "flickers within half a unit": ("1.36305 -1 0", ["1.3631 -1 0", "1.3630 -1 0"], False),
    "moves a unit": (FOUR, ["1.3631 -1.7946 0.8393", "1.3632 -1.7946 0.8393"], True),
    "six digits, a short one too": ("3.52 -17.9463 0.839294", ["3.5 -17.9463 0.839294"] * 2, True),
    "six digits of more": ("352.03049 -17.946312 0", ["352.03 -17.9463 0"] * 2, False),
    "six digits, one off in the last": (FOUR, ["1.36307 -1.79463 0.83929"] * 2, False),
    "six digits, three off in the last": (FOUR, ["1.36309 -1.79463 0.83929"] * 2, True),
    "with exponents": ("352.03049 -1.7946312e-3 0", ["3.5203e+02 -1.7946e-03 0"] * 2, False),
    "whole numbers, far too coarse": ("0.3 0.2 0", ["0 0 0"] * 2, True),
    "whole numbers of millimetres": ("432.4 180.49 0", ["432 180 0"] * 2, False),
    "OFFSET is what is rounded": ("1.36 -1.79 0.84", ["1.3630641 -1.79463 0.83929"] * 2, False),
    "single precision": ("1.36306 -1.79463 0", ["1.363060116 -1.794630051 0"] * 2, False),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_rounding_is_no_movement(load, case):
    offset, leg, moves = CASES[case]
    motion = load(text(offset, ["0 0 0"] * len(leg), leg))
    assert motion.translated_joints == ((0, 1) if moves else (0,))
    printed = np.array([row.split() for row in leg], float)
    np.testing.assert_array_equal(motion.translations[:, 1], printed)
    assert motion.skeleton.offsets[1].tolist() == [float(x) for x in offset.split()]


def test_the_root_may_be_printed_in_its_own_way(load):
    """Only the positions that are compared count: the root's own say nothing of them."""
    leg = ["1.3631 -1.7946 0.8393"] * 2
    motion = load(text(FOUR, ["12.3456789 0 0", "0 1e-12 0"], leg))
    assert motion.translated_joints == (0,)


@pytest.mark.parametrize(("root", "moves"), [("700 0 0", False), ("7 0 0", True)])
def test_single_precision_is_that_of_the_world(load, root, moves):
    """Off by 3e-4 of 700: rounding if the root is there, movement if it is near."""
    leg = ["1.3633600000 -1.7946300000 0.8392900000"] * 2
    motion = load(text(FOUR, ["0 0 0", root], leg))
    assert motion.translated_joints == ((0, 1) if moves else (0,))


@pytest.mark.parametrize("block", [1, 100, 1 << 20])
def test_digits_may_show_late_in_the_file(load, monkeypatch, block):
    monkeypatch.setattr(bvh_frames, "_PARSE_BYTES", block)
    leg = ["432 180 0"] * 40
    assert load(text("432.4 180.49 0", ["0 0 0"] * 40, leg)).translated_joints == (0,)
    leg[33] = "432.4 180 0"
    assert load(text("432.4 180.49 0", ["0 0 0"] * 40, leg)).translated_joints == (0, 1)
    leg = ["432 180 0"] * 20 + ["432 180.02 0"] + ["432 180 0"] * 19
    assert load(text("432.4 180.49 0", ["0 0 0"] * 40, leg)).translated_joints == (0, 1)


def test_positions_come_back_as_they_were_printed(load, tmp_path):
    leg = ["1.3631 -1 0.8393", "1.363 -1 0.8393"]
    motion = load(text("1.36305 -1 0.83929", ["0 0 0"] * 2, leg))
    assert motion.translated_joints == (0,)
    jm.save(motion, tmp_path / "again.bvh")
    rows = (tmp_path / "again.bvh").read_text().splitlines()[-2:]
    assert [" ".join(row.split()[6:9]) for row in rows] == leg
    assert "OFFSET 1.36305 -1.0 0.83929" in (tmp_path / "again.bvh").read_text()


def test_a_capture_printed_with_fewer_digits(data_dir, tmp_path):
    """Six channels on every joint, as Blender and bvhsdk write them."""
    source = jm.load(data_dir / "quirks" / "cmu_12_01_walk.bvh")[:20]
    six = (DEFAULT_ROOT_CHANNELS,) * source.num_joints
    skeleton = dataclasses.replace(source.skeleton, channels=six)
    jm.save(dataclasses.replace(source, skeleton=skeleton), tmp_path / "six.bvh")
    head, rows = (tmp_path / "six.bvh").read_text().split("Frame Time: .0083333\n")
    for style in ("%.6f", "%.4f", "%.3f", "%.6g", "%.5e"):
        printed = "\n".join(
            " ".join(style % float(x) for x in row.split()) for row in rows.splitlines()
        )
        (tmp_path / "out.bvh").write_text(f"{head}Frame Time: .0083333\n{printed}\n")
        back = jm.load(tmp_path / "out.bvh")
        assert back.translated_joints == (0,), style
        np.testing.assert_allclose(back.translations, source.translations, atol=2e-2)


@pytest.mark.filterwarnings("error")
def test_rounded_positions_give_bones_of_acclaim_no_translations(load, tmp_path):
    """The bone is what algorithms see of the joint: its first frame."""
    motion = load(
        text("1.36305 -1 0.83929", ["0 0 0"] * 2, ["1.3631 -1 0.8393", "1.363 -1 0.8393"])
    )
    jm.save(motion, tmp_path / "out.amc")
    back = jm.load(tmp_path / "out.amc")
    assert back.skeleton.channels[1] == ("ry", "rx", "rz")
    assert back.translated_joints == (0,)
    np.testing.assert_allclose(back.skeleton.offsets[1], [1.3631, -1, 0.8393], rtol=1e-15)
    want, found = (jm.forward_kinematics(m).positions for m in (motion, back))
    np.testing.assert_allclose(found, want, atol=1e-14)
