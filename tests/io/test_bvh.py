"""BVH: every quirk read, every motion written so that it comes back."""

import itertools
import warnings

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.io import MotionFileError, MotionFileWarning, euler_blocks
from tests.helpers import (
    angle_between,
    assert_same_rotation,
    compilations,
    random_motion,
    random_quaternions,
    world_by_matrices,
)

POSITIONS = ("Xposition", "Yposition", "Zposition")
ORDERS = ["".join(o) for o in itertools.product("XYZ", repeat=3) if o[0] != o[1] and o[1] != o[2]]


def rotation_channels(order):
    return tuple(f"{letter}rotation" for letter in order)


def bvh_text(joints, rows, *, frames=None, frame_time="0.0333333"):
    """A chain: joints are (name, offset, channels); an end site closes it."""
    lines = ["HIERARCHY"]
    for depth, (name, offset, channels) in enumerate(joints):
        lines += [f"{'JOINT' if depth else 'ROOT'} {name}", "{"]
        lines += [f"OFFSET {' '.join(map(str, offset))}"]
        lines += [f"CHANNELS {len(channels)} {' '.join(channels)}"]
    lines += ["End Site", "{", "OFFSET 0 1 0", "}"] + ["}"] * len(joints)
    lines += ["MOTION", f"Frames: {len(rows) if frames is None else frames}"]
    lines += [f"Frame Time: {frame_time}"]
    lines += [" ".join(map(repr, row)) for row in np.asarray(rows, float).tolist()]
    return "\n".join(lines) + "\n"


SIMPLE = bvh_text(
    [
        ("Hips", (0, 0, 0), POSITIONS + rotation_channels("ZXY")),
        ("Left Arm", (1, 2, 3), rotation_channels("XYZ")),
    ],
    np.arange(27.0).reshape(3, 9),
)


@pytest.fixture
def load(tmp_path):
    """Load text or bytes as a file; further arguments go to ``jm.load``."""

    def load(content, **options):
        path = tmp_path / "clip.bvh"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return jm.load(path, **options)

    return load


@pytest.fixture
def again(tmp_path):
    """Save a motion and load it."""

    def again(motion, **options):
        path = tmp_path / "again.bvh"
        jm.save(motion, path)
        return jm.load(path, **options)

    return again


def assert_same_motion(a, b, atol=1e-12):
    """All that a round trip owes: static facts and translations exactly, rotations to ``atol``."""
    for field in ("names", "parents", "channels", "end_joints", "end_labels"):
        assert getattr(a.skeleton, field) == getattr(b.skeleton, field)
    np.testing.assert_array_equal(a.skeleton.offsets, b.skeleton.offsets)
    np.testing.assert_array_equal(a.skeleton.end_offsets, b.skeleton.end_offsets)
    np.testing.assert_array_equal(a.translations, b.translations)
    assert angle_between(a.rotations, b.rotations).max() <= atol
    assert a.frame_time == b.frame_time
    assert a.rotations.dtype == b.rotations.dtype == b.translations.dtype


# Reading


def test_every_euler_order_reads_as_scipy_does(load, dtype):
    rng = np.random.default_rng(0)
    joints = [("root", (0, 0, 0), POSITIONS + rotation_channels("ZXY"))]
    joints += [(f"j{o}", (1, 0, 0), rotation_channels(o)) for o in ORDERS]
    rows = rng.uniform(-400, 400, (4, 6 + 3 * len(ORDERS)))
    motion = load(bvh_text(joints, rows), dtype=dtype)
    assert motion.rotations.dtype == motion.translations.dtype == dtype
    assert motion.skeleton.offsets.dtype == motion.frame_time.dtype == dtype
    for j, order in enumerate(["ZXY", *ORDERS]):
        wanted = Rotation.from_euler(order, rows[:, 3 + 3 * j : 6 + 3 * j], degrees=True)
        got = Rotation.from_quat(np.asarray(motion.rotations[:, j], float), scalar_first=True)
        assert (wanted.inv() * got).magnitude().max() < (1e-6 if dtype == np.float32 else 1e-14)
    np.testing.assert_array_equal(motion.root_positions, rows[:, :3].astype(dtype))


def test_channels_of_any_number_in_any_order(load):
    joints = [
        ("root", (9, 9, 9), ("Yrotation", "Zposition", "Xrotation", "yPOSITION")),
        ("two", (1, 2, 3), ("Xrotation", "Zrotation")),
        ("none", (4, 5, 6), ()),
        ("one", (7, 8, 9), ("Yrotation", "Xposition")),
    ]
    rows = np.array([[10.0, 20, 30, 40, 50, 60, 70, 80], [11.0, 20, 30, 40, 50, 60, 70, 7]])
    motion = load(bvh_text(joints, rows))
    assert motion.skeleton.channels == tuple(c for _, _, c in joints)
    np.testing.assert_array_equal(
        motion.translations[0], [[9, 40, 20], [1, 2, 3], [4, 5, 6], [80, 8, 9]]
    )
    for j, (order, columns) in enumerate([("YX", [0, 2]), ("XZ", [4, 5]), (None, []), ("Y", [6])]):
        wanted = Rotation.identity(2)
        if order:
            wanted = Rotation.from_euler(order, rows[:, columns], degrees=True)
        wanted = wanted.as_quat(scalar_first=True)
        assert_same_rotation(motion.rotations[:, j], wanted, 1e-14)
    assert motion.translated_joints == (0, 3)


def test_translated_joints_are_those_that_leave_their_offset(load):
    six = POSITIONS + rotation_channels("ZXY")
    rows = np.zeros((2, 24))
    rows[:, 6:9] = 10, 0, 0
    rows[:, 12:15] = 10, 5e-6, 0
    rows[:, 18:21] = 10, 0, 0.5
    joints = [("root", (0, 0, 0), six)] + [(n, (10, 0, 0), six) for n in "abc"]
    motion = load(bvh_text(joints, rows))
    assert motion.translated_joints == (0, 3)
    np.testing.assert_array_equal(motion.translations[1, 2], [10, 5e-6, 0])


def respelt(old, new):
    assert old in SIMPLE
    return SIMPLE.replace(old, new)


@pytest.mark.parametrize(
    "content",
    [
        SIMPLE.replace("\n", "\r\n"),
        SIMPLE.replace("\n", "\r"),
        SIMPLE.replace(" ", "\t").replace("Left\tArm", "Left Arm").replace("End\t", "End "),
        SIMPLE.replace("\n", " \t\n\n"),
        SIMPLE.rstrip("\n"),
        b"\xef\xbb\xbf" + SIMPLE.encode(),
        SIMPLE.encode("utf-16"),
        SIMPLE.upper().replace("HIPS", "Hips").replace("LEFT ARM", "Left Arm"),
        respelt("Frames: 3", "Frames:\t3"),
        respelt("Frames: 3", "Frames 3"),
        respelt("ROOT Hips\n{", "ROOT Hips {"),
        respelt("0.0333333", "3.33333e-2"),
        respelt("0.0333333", ".0333333"),
        respelt("10.0 ", "1.0e+1 "),
        respelt("10.0 ", "+10. "),
        respelt("3.0 ", "3.0\n "),
        SIMPLE.replace("8.0\n", "8.0 ").replace("17.0\n", "17.0 "),
        SIMPLE + "\n\n  \n",
        SIMPLE + "\x1a",
        SIMPLE.rstrip("\n") + "\x1a",
        SIMPLE.replace("\n", "\r\n") + "\x1a\0\0",
        " ".join(SIMPLE.replace("Hips\n{", "Hips {").split("\n")),
        respelt("HIERARCHY\n", "HIERARCHY "),
        respelt("Hips\n{\nOFFSET 0 0 0\nCHANNELS", "Hips { OFFSET 0 0 0 CHANNELS"),
        respelt("OFFSET 1 2 3", "OFFSET 1\n\n2 3"),
        respelt("CHANNELS 6 Xposition Yposition ", "CHANNELS\n6 Xposition\n  Yposition\n"),
        respelt("JOINT Left Arm\n{", "joint\n\tLeft Arm{"),
        respelt("End Site\n{\nOFFSET 0 1 0\n}", "End\nSite{OFFSET 0 1 0}"),
        respelt("}\n}\nMOTION\nFrames: 3\nFrame", "}}MOTION Frames: 3 Frame"),
        respelt("MOTION\n", "motion\t"),
        respelt("Frames: 3\n", "Frames:\n3\n"),
        respelt("Frame Time: 0", "FrameTime:0"),
        respelt("Frame Time: 0", "Frame\nTime:\n\n0"),
        respelt("Frame Time: 0.0333333\n", "Frame Time: 0.0333333 "),
    ],
)
def test_spelling_does_not_matter(load, content):
    plain, motion = load(SIMPLE), load(content)
    np.testing.assert_array_equal(motion.translations, plain.translations)
    np.testing.assert_array_equal(motion.rotations, plain.rotations)
    assert motion.skeleton.names == plain.skeleton.names == ("Hips", "Left Arm")
    spelt = [[c.lower() for names in m.skeleton.channels for c in names] for m in (motion, plain)]
    assert spelt[0] == spelt[1]
    assert motion.skeleton.end_labels[0].lower() == "end site"
    np.testing.assert_array_equal(motion.skeleton.offsets, plain.skeleton.offsets)
    assert motion.frame_time == plain.frame_time


def test_text_is_kept_as_spelt(load, again):
    text = SIMPLE.replace("Hips", "mixamorig:Hips").replace("End Site", "End site")
    text = text.replace("Left Arm", "Müller  kid's arm").replace("0.0333333", ".0417083750417")
    for encoding in ("utf-8", "latin-1"):
        motion = load(text.encode(encoding))
        assert motion.skeleton.names == ("mixamorig:Hips", "Müller  kid's arm")
        assert motion.skeleton.end_labels == ("End site",)
        assert motion.frame_time_text == ".0417083750417"
        assert_same_motion(motion, again(motion))
        assert again(motion).frame_time_text == ".0417083750417"
    changed = jm.Motion(
        motion.skeleton, motion.translations, motion.rotations, 0.01, frame_time_text="0.02"
    )
    assert again(changed).frame_time_text == "0.01"


def test_options(load):
    motion = load(SIMPLE.replace("0.0333333", "0"), frame_time=0.05, up="z")
    assert motion.frame_time == 0.05
    assert motion.frame_time_text is None
    assert motion.skeleton.up == "z"
    assert load(SIMPLE.replace("0.0333333", "0"), fps=20).frame_time == 0.05
    with pytest.raises(ValueError, match="give one of them"):
        load(SIMPLE, fps=20, frame_time=0.05)


@pytest.mark.parametrize(
    ("content", "frames", "message"),
    [
        (respelt("Frames: 3", "Frames: 4"), 3, "header says 4 frames, 3 are there"),
        (respelt("Frames: 3", "Frames: 2"), 3, "header says 2 frames, 3 are there"),
        (respelt("Frames: 3", f"Frames: {10**17}"), 3, "header says 1000"),
        (respelt(" 25.0 26.0\n", ""), 2, r"last row is cut off \(7 of 9"),
        (respelt(" 26.0\n", " -"), 2, r"last row is cut off \(8 of 9"),
        (respelt(" 26.0\n", " 2.6e"), 2, r"last row is cut off \(8 of 9"),
        (respelt("Left Arm", "Hips"), 3, "repeat a name.*Hips"),
        (SIMPLE + "END\n", 3, "'END' after the last frame is no number and was left out$"),
        (SIMPLE + "-- end of take 7\n", 3, "'--' after the last frame.* left out$"),
        (SIMPLE + "1 2 x", 3, "'x' after the last frame"),
    ],
)
def test_repairs_are_made_and_said(load, content, frames, message):
    with pytest.warns(MotionFileWarning, match=message) as record:
        motion = load(content)
    assert len(record) == 1
    assert len(motion) == frames
    np.testing.assert_array_equal(
        motion.root_positions, 9.0 * np.arange(frames)[:, None] + [0, 1, 2]
    )


def test_repeated_names_are_numbered(load):
    six = rotation_channels("ZXY")
    joints = [(name, (0, 1, 0), six) for name in ("a", "a_2", "a", "b", "a")]
    with pytest.warns(MotionFileWarning, match="2 joints"):
        motion = load(bvh_text(joints, np.zeros((1, 15))))
    assert motion.skeleton.names == ("a", "a_2", "a_3", "b", "a_4")


@pytest.mark.parametrize(
    ("content", "line", "frame", "message"),
    [
        (respelt("12.0 ", "abc "), 20, 1, "'abc' for 'Hips Zrotation'.*finite number"),
        (respelt("16.0 ", "nan "), 20, 1, "'nan' for 'Left Arm Yrotation'"),
        (respelt("25.0 ", "-inf "), 21, 2, "'-inf' for 'Left Arm Yrotation'"),
        (respelt("25.0 ", "1e999 "), 21, 2, "'1e999'"),
        (respelt("12.0 ", "12,0 "), 20, 1, "'12,0'.*decimal points"),
        (respelt("12.0 ", "1_2 "), 20, 1, "'1_2'"),
        (respelt("12.0 ", "0x1 "), 20, 1, "'0x1'"),
        (respelt("12.0 ", "1\x002 "), 20, 1, "10 numbers"),
        (respelt("12.0 ", ""), 20, 1, "8 numbers; expected 9"),
        (respelt("12.0 ", "12.0 1 "), 20, 1, "10 numbers; expected 9"),
        (respelt("11.0 12.0", "11.0-12.0"), 20, 1, "'11.0-12.0' among 8 n.*9.*blank between.*join"),
        (respelt("12.0 ", "12.0 deg "), 20, 1, "'deg' among 10 numbers; expected 9.*no number"),
        (respelt("18.0 ", "REST\n18.0 "), 21, 2, "'REST' among 1 number;"),
        (respelt("10.0 ", "10.0, "), 20, 1, "'10.0,' for 'Hips Yposition'.*blanks between"),
        (respelt("0.0333333", "0.0333333 seconds"), 18, None, "'seconds' after.*'0.0333333'"),
        (respelt("0.0333333", "33.3333 ms"), 18, None, "'ms' after.*in seconds"),
        (respelt("0.0333333", "0.0333333s"), 18, None, "Frame Time: '0.0333333s'"),
        (respelt("Frames: 3", "Frames: 3,000"), 17, None, "'3,000'.*digits alone"),
        (respelt("Frames: 3", "Frames:"), 17, None, "Frames: ''"),
        (respelt("OFFSET 1 2 3", "OFFSET 1, 2, 3"), 8, None, "blanks between"),
        (respelt("CHANNELS 3 X", "CHANNELS 4 X"), 9, None, "3 names; expected a count"),
        (respelt("CHANNELS 6 Xposition", "CHANNELS 6"), 5, None, "5 names; expected a count"),
        (respelt("CHANNELS 3 X", "CHANNELS 1 X"), 9, None, "3 names; expected a count"),
        (respelt("12.0 ", "").replace("20.0", "20.0 1"), 20, 1, "8 numbers; expected 9"),
        (respelt("0.0333333", "0,033"), 18, None, "'0,033'.*decimal points.*frame_time"),
        (respelt("0.0333333", "0"), 18, None, "Frame Time: '0'; expected a positive"),
        (respelt("0.0333333", ""), 18, None, "Frame Time: ''"),
        (respelt("Frames: 3", "Frames: -3"), 17, None, "whole number of frames"),
        (respelt("Frames: 3", "Frames: many"), 17, None, "'many'"),
        (respelt("Frames: 3\n", ""), 17, None, "Frame Time.*expected 'Frames: N'"),
        (respelt("Frame Time: 0.0333333\n", ""), 18, None, "expected 'Frame Time: seconds'"),
        (SIMPLE[: SIMPLE.index("0.0 1.0")], 18, None, "no complete frame"),
        (SIMPLE[: SIMPLE.index("MOTION")], 16, None, "end of the file.*expected MOTION"),
        (respelt("}\n}\nMOTION", "}\nMOTION"), 15, None, "braces that close what line 2"),
        (respelt("}\nMOTION", "}\n}\nMOTION"), 16, None, "no more of them than of"),
        (respelt("HIERARCHY\n", ""), 1, None, "expected HIERARCHY.*BVH"),
        (respelt("OFFSET 1 2 3", "OFFSET 1 2"), 8, None, "OFFSET '1 2'; expected three"),
        (respelt("OFFSET 1 2 3", "OFFSET 1 2 nan"), 8, None, "three finite numbers"),
        (respelt("OFFSET 1 2 3", "OFFSET 1,5 2 3"), 8, None, "decimal points"),
        (respelt("OFFSET 1 2 3\n", ""), 13, None, "an OFFSET for what line 6 opens"),
        (respelt("CHANNELS 3 X", "CHANNELS 99999999999999 X"), 9, None, "as many names"),
        (respelt("CHANNELS 3 Xrot", "CHANNELS 3 Wrot"), 9, None, "'Wrotation'"),
        (respelt("Xposition Y", "Yposition Y"), 5, None, "'Yposition' twice"),
        (respelt("3 Xrotation", "3 Yrotation"), 9, None, "rotation channels about Y, Y, Z"),
        (respelt("JOINT Left Arm", "JOINT"), 6, None, "JOINT with no name"),
        (respelt("JOINT Left Arm", "ROOT Left Arm"), 6, None, "second root"),
        (respelt("JOINT Left Arm", "BONE Left Arm"), 6, None, "'BONE Left Arm'"),
        (respelt("Left Arm\n{", "Left Arm"), 7, None, "{ to open line 6"),
        (b"\xff\xfe\x00", 1, None, "UTF-16"),
        (b"", 1, None, "HIERARCHY"),
        (b"\x00\x01\x02\xff" * 50, 1, None, "HIERARCHY"),
    ],
)
def test_errors_say_where_what_and_what_to_try(load, content, line, frame, message):
    with pytest.raises(MotionFileError, match=message) as caught:
        load(content)
    assert (caught.value.line, caught.value.frame) == (line, frame)
    assert caught.value.path.endswith("clip.bvh")
    assert "\n" not in str(caught.value)


def test_numbers_too_large_for_float32(load):
    with pytest.raises(MotionFileError, match="float32"):
        load(respelt("10.0 ", "1e39 "), dtype=np.float32)
    assert load(respelt("10.0 ", "1e39 "), dtype=np.float64).translations[1, 0, 1] == 1e39


def test_long_files_are_read_in_pieces(load):
    rng = np.random.default_rng(1)
    rows = np.round(rng.uniform(-180, 180, (60_000, 6)), 6)
    text = bvh_text([("root", (0, 0, 0), POSITIONS + rotation_channels("ZXY"))], rows)
    assert len(text) > 3 << 20
    motion = load(text)
    np.testing.assert_array_equal(motion.root_positions, rows[:, :3])
    wanted = Rotation.from_euler("ZXY", rows[:, 3:], degrees=True).as_quat(scalar_first=True)
    assert_same_rotation(motion.rotations[:, 0], wanted, 1e-14)
    bad = text.splitlines()
    bad[-7] = bad[-7].replace(" ", " x", 1)
    with pytest.raises(MotionFileError, match="for 'root Yposition'") as caught:
        load("\n".join(bad))
    assert (caught.value.line, caught.value.frame) == (len(bad) - 6, len(rows) - 7)


def test_no_compile_for_another_length(load, again):
    clip = load(SIMPLE)
    again(clip)
    lengths = (1, 2, 5, 511, 512, 600)
    with compilations() as names:
        for frames in lengths:
            shapes = (frames, 2, 3), (frames, 2, 4)
            parts = map(np.resize, (clip.translations, clip.rotations), shapes)
            longer = clip.with_transforms(*parts)
            assert_same_motion(longer, again(longer))
    assert [name for name in names if "euler" in name] == []


# Writing and coming back


@pytest.mark.parametrize("step", [5, pytest.param(1, marks=pytest.mark.sweep)])
def test_every_real_file_comes_back(data_dir, tmp_path, step):
    """In a sweep every one, else some of each folder."""
    files = sorted(data_dir.rglob("*.bvh"))[::step]
    assert files
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for file in files:
            motion = jm.load(file)
            jm.save(motion, tmp_path / "a.bvh")
            first = jm.load(tmp_path / "a.bvh")
            assert_same_motion(motion, first)
            assert motion.frame_time_text == first.frame_time_text
            assert motion.translated_joints == first.translated_joints


def test_saving_what_was_saved_changes_no_byte(data_dir, tmp_path):
    for name in ("quirks/bvh_test3.bvh", "bandai/walk_normal_002.bvh", "xia/angry_13_000.bvh"):
        jm.save(jm.load(data_dir / name), tmp_path / "a.bvh")
        jm.save(jm.load(tmp_path / "a.bvh"), tmp_path / "b.bvh")
        assert (tmp_path / "a.bvh").read_bytes() == (tmp_path / "b.bvh").read_bytes()


def test_a_files_own_decimals_come_back(load, tmp_path):
    load_text = SIMPLE.replace(".0 ", ".123456 ").replace(".0\n", ".654321\n")
    jm.save(load(load_text), tmp_path / "a.bvh")
    rows = load_text[load_text.index("Frame Time") :].splitlines()[1:]
    assert (tmp_path / "a.bvh").read_text().splitlines()[-3:] == rows


def test_random_motions_come_back(again, dtype):
    rng = np.random.default_rng(2)
    orders = ["ZXY", "XYZ", "ZYZ", *["YXZ"] * 10]
    skeleton = jm.Skeleton(
        [f"joint {j}" for j in range(13)],
        [j - 1 for j in range(13)],
        rng.normal(size=(13, 3)).astype(dtype),
        end_joints=[12, 12, 3],
        end_offsets=rng.normal(size=(3, 3)).astype(dtype),
        end_labels=["End Site", "end  of it", "End Site"],
        channels=[POSITIONS[::-1] + rotation_channels(o) for o in orders],
    )
    motion = random_motion(rng, 40, skeleton, dtype=dtype)
    back = again(motion, dtype=dtype)
    assert back.skeleton.end_joints == (12, 12, 3)
    assert_same_motion(motion, back, 1e-12 if dtype == np.float64 else 5e-6)


def test_rotations_near_every_singular_place_come_back(again):
    rng = np.random.default_rng(3)
    for order in ("ZXY", "XYX"):
        middle = np.array([-90.0, 90, 0, 180, 180 - 1e-9, 90 - 1e-7, 1e-8, 90 + 1e-12])
        angles = rng.uniform(-180, 180, (8, 3))
        angles[:, 1] = middle
        q = Rotation.from_euler(order, angles, degrees=True).as_quat(scalar_first=True)
        q = np.concatenate([q, -q, np.eye(4), -np.eye(4)])[:, None]
        skeleton = jm.Skeleton(
            ["root"], [-1], np.zeros((1, 3)), channels=[rotation_channels(order)]
        )
        motion = jm.Motion(skeleton, np.zeros((len(q), 1, 3)), q, 0.01)
        assert_same_motion(motion, again(motion), 1e-13)


@pytest.mark.parametrize("order", ["ZXY", "YZY"])
def test_angles_are_unwrapped_across_blocks(tmp_path, order):
    frames = 1300
    t = np.linspace(0, 1, frames)
    angles = np.stack([3000 * t, 70 * np.sin(9 * t) + (90 if order == "YZY" else 0), -2000 * t], -1)
    q = Rotation.from_euler(order, angles, degrees=True).as_quat(scalar_first=True)[:, None]
    skeleton = jm.Skeleton(["root"], [-1], np.zeros((1, 3)), channels=[rotation_channels(order)])
    jm.save(jm.Motion(skeleton, np.zeros((frames, 1, 3)), q, 0.01), tmp_path / "a.bvh")
    written = np.loadtxt((tmp_path / "a.bvh").read_text().splitlines()[-frames:])
    np.testing.assert_allclose(written, angles, atol=1e-9)


@pytest.mark.parametrize("order", ["ZXY", "YZY"])
def test_blocks_of_a_wild_motion_join_as_one_scan(order):
    wild = np.asarray(random_quaternions(np.random.default_rng(4), (1300, 9)))
    joined = np.concatenate(list(euler_blocks.angle_blocks(wild, order)))
    whole = jax.jit(lambda q: jm.quaternion.to_euler(q, order, unwrap=True))(wild)
    np.testing.assert_allclose(joined, whole, atol=1e-9)


def test_channels_grow_only_where_something_would_be_lost(load, again):
    joints = [
        ("root", (0, 0, 0), ("Yposition", "Yrotation")),
        ("knee", (0, 1, 0), ("Xrotation",)),
        ("wrist", (0, 2, 0), ("Xrotation", "Zrotation")),
        ("fixed", (0, 3, 0), ()),
    ]
    spin = np.linspace(0, 1000, 60)
    rows = np.stack([spin, spin, -spin, spin / 7, 150 * np.cos(spin / 50)], -1)
    motion = load(bvh_text(joints, rows))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_same_motion(motion, again(motion))

    rng = np.random.default_rng(5)
    free = motion.with_transforms(rotations=random_quaternions(rng, (60, 4)))
    with pytest.warns(MotionFileWarning, match="added to 4 joints.*root, knee, wrist, fixed"):
        back = again(free)
    assert back.skeleton.channels == (
        ("Yposition", "Yrotation", "Xrotation", "Zrotation"),
        ("Xrotation", "Yrotation", "Zrotation"),
        ("Xrotation", "Zrotation", "Yrotation"),
        ("Zrotation", "Xrotation", "Yrotation"),
    )
    assert_same_rotation(free.rotations, back.rotations, 1e-13)

    moved = np.array(motion.translations)
    moved[7, 0, 2] += 1e-9
    moved[:, 3, 1] = 4
    shifted = motion.with_transforms(translations=moved)
    with pytest.warns(MotionFileWarning, match="added to 2 joints.*root, fixed"):
        back = again(shifted)
    assert back.skeleton.channels[0] == ("Xposition", "Zposition", "Yposition", "Yrotation")
    assert back.skeleton.channels[3] == POSITIONS
    np.testing.assert_array_equal(back.translations, moved)
    assert_same_rotation(motion.rotations, back.rotations, 1e-12)


def test_positions_of_joints_that_never_move_may_be_left_out(load, tmp_path, dtype):
    joints = [
        ("root", (5, 6, 7), POSITIONS + rotation_channels("ZXY")),
        ("still", (1, 2, 3), POSITIONS + rotation_channels("YXZ")),
        ("slider", (0, 3, 0), ("Xposition", *rotation_channels("ZXY"))),
        ("bolt", (0, 4, 0), POSITIONS),
        ("leaf", (0, 1, 0), rotation_channels("XYZ")),
    ]
    rows = np.random.default_rng(0).uniform(-50, 50, (4, 22))
    rows[:, 6:9] = 1.25, 2, 3.5
    rows[:, 16:19] = 9, 8, 7
    motion = load(bvh_text(joints, rows), dtype=dtype)
    path = tmp_path / "a.bvh"
    with pytest.warns(MotionFileWarning, match="joints that move, 1 in all: slider$") as said:
        jm.save(motion, path, still_positions=False)
    assert len(said) == 1
    back = jm.load(path, dtype=dtype)
    assert back.skeleton.channels == (
        POSITIONS + rotation_channels("ZXY"),
        rotation_channels("YXZ"),
        ("Xposition", *rotation_channels("ZXY")),
        rotation_channels("ZXY"),
        rotation_channels("XYZ"),
    )
    wanted = [(5, 6, 7), (1.25, 2, 3.5), (0, 3, 0), (9, 8, 7), (0, 1, 0)]
    np.testing.assert_array_equal(back.skeleton.offsets, np.asarray(wanted, dtype))
    np.testing.assert_array_equal(back.translations, motion.translations)
    atol = 1e-4 if dtype == np.float32 else 1e-11
    for a, b in zip(world_by_matrices(motion), world_by_matrices(back), strict=True):
        np.testing.assert_allclose(b, a, atol=atol)
    jm.save(motion, path)
    assert jm.load(path).skeleton.channels == motion.skeleton.channels


def test_left_out_positions_of_real_files(data_dir, tmp_path):
    for name in ("bandai/walk_normal_002.bvh", "xia/angry_13_000.bvh"):
        motion = jm.load(data_dir / name)[:40]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MotionFileWarning)
            jm.save(motion, tmp_path / "a.bvh", still_positions=False)
        back = jm.load(tmp_path / "a.bvh")
        positions = [sum("position" in c for c in names) for names in back.skeleton.channels]
        still = [j for j in range(1, back.num_joints) if j not in motion.translated_joints]
        assert still
        assert all(positions[j] == 0 for j in still)
        for a, b in zip(world_by_matrices(motion), world_by_matrices(back), strict=True):
            np.testing.assert_allclose(b, a, atol=1e-10)


def test_joints_of_an_acclaim_skeleton_that_do_not_turn_get_channels(again):
    """Others refuse CHANNELS 0; a BVH that has them keeps them."""
    rng = np.random.default_rng(6)
    for channels, wanted in (
        ([("TX", "RX"), (), ("rx",)], [POSITIONS + rotation_channels("ZXY")]),
        ([("Xposition", "Yrotation", "Xrotation", "Zrotation"), (), ("Yrotation",)], None),
    ):
        skeleton = jm.Skeleton(
            ["root", "hip", "knee"], [-1, 0, 1], rng.normal(size=(3, 3)), channels=channels
        )
        motion = random_motion(rng, 3, skeleton, translated=False)
        turns, places = np.array(motion.rotations), np.array(motion.translations)
        turns[:, 1:] = 1, 0, 0, 0
        places[:, 0, 1:] = skeleton.offsets[0, 1:]
        back = again(motion.with_transforms(places, turns))
        if wanted is None:
            assert back.skeleton.channels == skeleton.channels
        else:
            assert back.skeleton.channels == (*wanted, *[rotation_channels("ZXY")] * 2)


def test_a_skeleton_with_no_channels_at_all(again):
    skeleton = jm.Skeleton(["root"], [-1], np.zeros((1, 3)), channels=[()])
    still = jm.Motion(skeleton, np.zeros((4, 1, 3)), np.tile([1.0, 0, 0, 0], (4, 1, 1)), 0.01)
    with pytest.warns(MotionFileWarning, match="root"):
        assert len(again(still)) == 4


def test_channels_of_another_format_become_bvhs(again):
    rng = np.random.default_rng(6)
    skeleton = jm.Skeleton(
        ["root", "knee"], [-1, 0], rng.normal(size=(2, 3)), channels=[("TX", "RX"), ("rx",)]
    )
    motion = random_motion(rng, 3, skeleton, translated=False)
    back = again(motion)
    assert back.skeleton.channels == (
        POSITIONS + rotation_channels("ZXY"),
        rotation_channels("ZXY"),
    )
    np.testing.assert_array_equal(back.translations, motion.translations)
    assert_same_rotation(motion.rotations, back.rotations, 1e-13)


def test_joints_are_written_depth_first(again):
    rng = np.random.default_rng(7)
    skeleton = jm.Skeleton(
        ["root", "a", "b", "aa", "ba"],
        [-1, 0, 0, 1, 2],
        rng.normal(size=(5, 3)),
        end_joints=[4, 1, 0],
        end_offsets=rng.normal(size=(3, 3)),
        channels=[POSITIONS + rotation_channels("XYZ")] * 5,
    )
    motion = random_motion(rng, 6, skeleton)
    back = again(motion)
    assert back.skeleton.names == ("root", "a", "aa", "b", "ba")
    chosen = [motion.skeleton.index(name) for name in back.skeleton.names]
    np.testing.assert_array_equal(back.translations, motion.translations[:, chosen])
    assert_same_rotation(back.rotations, motion.rotations[:, chosen], 1e-13)
    ends = {
        back.skeleton.names[j]: o
        for j, o in zip(
            back.skeleton.end_joints, np.asarray(back.skeleton.end_offsets).tolist(), strict=True
        )
    }
    wanted = np.asarray(motion.skeleton.end_offsets).tolist()
    assert ends == {"ba": wanted[0], "a": wanted[1], "root": wanted[2]}


@pytest.mark.parametrize("end_joints", [[1, 2, 0], [0, 1, 2], [1, 0, 2], [2, 2, 0]])
def test_end_sites_keep_their_places_among_the_children(again, end_joints):
    rng = np.random.default_rng(8)
    skeleton = jm.Skeleton(
        ["root", "a", "b"],
        [-1, 0, 0],
        np.ones((3, 3)),
        end_joints=end_joints,
        end_offsets=rng.normal(size=(3, 3)),
    )
    motion = random_motion(rng, 1, skeleton, translated=False)
    assert_same_motion(motion, again(motion))


def broken(rng, **changes):
    motion = random_motion(rng, 4, 3)
    for field, (index, value) in changes.items():
        values = np.array(getattr(motion, field))
        values[index] = value
        motion = motion.with_transforms(**{field: values})
    return motion


def named(names, labels=None):
    ends = range(len(labels or ()))
    skeleton = jm.Skeleton(
        names,
        [j - 1 for j in range(len(names))],
        np.zeros((len(names), 3)),
        end_joints=[0 for _ in ends],
        end_offsets=np.zeros((len(ends), 3)),
        end_labels=labels,
    )
    return random_motion(np.random.default_rng(0), 1, skeleton, translated=False)


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (random_motion(np.random.default_rng(0), 4, 3, batch=(2,)), "batch axes"),
        (random_motion(np.random.default_rng(0), 0, 3), "no frames"),
        (broken(np.random.default_rng(0), rotations=((2, 1), np.nan)), "'joint1' .*frame 2"),
        (broken(np.random.default_rng(0), rotations=((3, 2), 0.0)), "'joint2' at frame 3.*unit"),
        (broken(np.random.default_rng(0), translations=((1, 0, 2), np.inf)), "'joint0'.*frame 1"),
        (named(["a{b"]), "name 'a{b'"),
        (named([" a"]), "name ' a'"),
        (named(["a\nb"]), "name"),
        (named(["a"], ["Site"]), "end site 'Site'"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path, motion, message):
    (tmp_path / "a.bvh").write_text("as it was")
    with pytest.raises(ValueError, match=message):
        jm.save(motion, tmp_path / "a.bvh")
    assert (tmp_path / "a.bvh").read_text() == "as it was"
    assert len(list(tmp_path.iterdir())) == 1


def test_inputs_are_untouched(again):
    motion = random_motion(np.random.default_rng(9), 5, 4)
    before = jax.tree.map(np.array, motion)
    with pytest.warns(MotionFileWarning):
        again(motion)
    jax.tree.map(np.testing.assert_array_equal, before, motion)
