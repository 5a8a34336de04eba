"""ASF/AMC: SciPy oracles for C R C⁻¹, real captures, both ways, conversions, quirks and errors."""

import re
import warnings

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmotion import Motion, Skeleton
from jaxmotion._asf_bone import AsfBone
from jaxmotion.io import MotionFileError, MotionFileWarning, load, save
from jaxmotion.io.asfamc import load_amc, save_amc
from tests.helpers import (
    angle_between,
    assert_same_rotation,
    no_shape_checks,
    random_motion,
    random_quaternions,
    random_skeleton,
    scipy_rotation,
    world_by_matrices,
)

ASF = """# a comment
:version 1.10
:name TINY
:units
  mass 1.0
  length 0.45
  angle deg
:documentation
   begin anything goes: root here, 1 2 3
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 1 2 3
   orientation 10 20 30
:bonedata
  begin
     id 1
     name Fixed
     direction 1, 0, 0
     length 2.5   # inches/0.45
     axis 0 7.62852e-016 20 XYZ
     bodymass 12
  end
  begin
     name knee
     direction 0.6 -0.8 0
     length 2
     axis 5 -30 20 ZYX
     dof rz rx
     limits (-10.0 170.0)
            (-inf inf)
  end
  begin
     name slider
     direction 0 0 1
     length 0.5
     axis 90 0 45 XYZ
     dof ry rx rz ty
  end
:hierarchy
  begin
    root Fixed
    Fixed knee slider
  end
"""
AMC = """#!OML:ASF elsewhere.ASF
:FULLY-SPECIFIED
:DEGREES
1
root 1 2 3 10 20 30
KNEE 15 -40

slider 10 100 1e1 0.25   # moved
2
root 1 2 4.5 11 21 31
KNEE 16 -41
slider 11 101 11 7.62852e-016
"""


def write(folder, amc=AMC, asf=ASF, name="tiny"):
    (folder / f"{name}.asf").write_bytes(asf.encode())
    (folder / f"{name}.amc").write_bytes(amc.encode())
    return folder / f"{name}.amc"


def matrices(*steps):
    """Product of turns on column vectors, the first given applied first: ("x", degrees)."""
    result = np.eye(3)
    for axis, degrees in steps:
        result = Rotation.from_euler(axis, degrees, degrees=True).as_matrix() @ result
    return result


def test_formula_against_scipy(tmp_path):
    motion = load_amc(write(tmp_path))
    skeleton = motion.skeleton
    assert skeleton.names == ("root", "Fixed", "knee", "slider")
    assert skeleton.parents == (-1, 0, 1, 1)
    assert skeleton.channels[2:] == (("rz", "rx"), ("ry", "rx", "rz", "ty"))
    assert skeleton.length_unit == 0.45
    assert skeleton.asf[2] == AsfBone(
        (5.0, -30.0, 20.0), "ZYX", (0.6, -0.8, 0.0), 2.0, ((-10.0, 170.0), (-np.inf, np.inf))
    )
    assert skeleton.end_joints == (2, 3)
    np.testing.assert_allclose(skeleton.offsets, [[1, 2, 3], [0, 0, 0], [2.5, 0, 0], [2.5, 0, 0]])
    np.testing.assert_allclose(skeleton.end_offsets, [[1.2, -1.6, 0], [0, 0, 0.5]])
    assert motion.translated_joints == (0, 3)
    assert motion.frame_time == 1 / 120

    got = scipy_rotation(motion.rotations[0]).as_matrix()
    preset = matrices(("x", 10), ("y", 20), ("z", 30))
    np.testing.assert_allclose(got[0], preset @ preset, atol=1e-14)
    np.testing.assert_allclose(got[1], np.eye(3), atol=1e-14)
    axis = matrices(("z", 20), ("y", -30), ("x", 5))
    knee = axis @ matrices(("z", 15), ("x", -40)) @ axis.T
    np.testing.assert_allclose(got[2], knee, atol=1e-14)
    axis = matrices(("x", 90), ("z", 45))
    slider = axis @ matrices(("y", 10), ("x", 100), ("z", 10)) @ axis.T
    np.testing.assert_allclose(got[3], slider, atol=1e-14)
    np.testing.assert_allclose(motion.translations[:, 0], [[2, 4, 6], [2, 4, 7.5]], atol=1e-14)
    moved = np.array([2.5, 0, 0]) + axis @ [0, 0.25, 0]
    np.testing.assert_allclose(motion.translations[0, 3], moved, atol=1e-14)


def test_unit_of_angles(tmp_path):
    """The AMC's, else the ASF's, else degrees, and then it is said; or what the caller says."""
    unsaid = AMC.replace(":DEGREES\n", ""), re.sub(r"\n *angle deg", "", ASF)
    assert all(b != a for a, b in zip((AMC, ASF), unsaid, strict=True))
    plain = load_amc(write(tmp_path))
    assumed = load_amc(write(tmp_path, *unsaid))
    assert plain.skeleton.conventions.angle == "told"
    assert assumed.skeleton.conventions.angle == "assumed"
    np.testing.assert_array_equal(assumed.rotations, plain.rotations)
    said = load_amc(write(tmp_path, *unsaid), angle="rad")
    assert said.skeleton.conventions.angle == "told"
    turn = Rotation.from_euler("xyz", [10, 20, 30]) * Rotation.from_euler("xyz", [10, 20, 30])
    np.testing.assert_allclose(
        scipy_rotation(said.rotations[0, 0]).as_matrix()[0], turn.as_matrix(), atol=1e-12
    )
    with no_shape_checks(), pytest.raises(ValueError, match="expected 'deg' or 'rad'"):
        load_amc(tmp_path / "tiny.amc", angle="grad")


def test_spellings_that_mean_the_same(tmp_path):
    plain = load_amc(write(tmp_path))
    variants = {
        "crlf": (AMC.replace("\n", "\r\n"), ASF.replace("\n", "\r\n")),
        "old mac": (AMC.replace("\n", "\r"), ASF.replace("\n", "\r")),
        "tabs": (AMC.replace(" ", "\t"), ASF.replace(" ", "\t")),
        "mark": ("\ufeff" + AMC, "\ufeff" + ASF),
        "no final line end": (AMC.rstrip(), ASF.rstrip()),
        "comments": (AMC.replace("2\nroot", "# hm\n\n2 # two\n \nroot"), ASF),
        "numbered from elsewhere": (AMC.replace("\n1\n", "\n7\n").replace("\n2\n", "\n9\n"), ASF),
        "capitals": (AMC.lower().replace("fixed", "FIXED"), ASF.replace(":root", ":ROOT")),
        "rate": (AMC.replace(":DEG", ":SAMPLES-PER-SECOND 120\n:DEG"), ASF),
    }
    radians = "\n".join(
        " ".join(repr(float(np.radians(float(x)))) if i in turns else x for i, x in enumerate(row))
        for row in (line.split("#")[0].split() for line in AMC.splitlines()[3:])
        for turns in [{"r": (4, 5, 6), "K": (1, 2), "s": (1, 2, 3)}.get((row or "-")[0][0], ())]
    )
    variants["radians"] = (":RADIANS\n" + radians, ASF)
    for what, (amc, asf) in variants.items():
        other = load_amc(write(tmp_path, amc, asf, name="other"))
        assert other.skeleton.names == plain.skeleton.names, what
        np.testing.assert_allclose(other.rotations, plain.rotations, atol=1e-13, err_msg=what)
        np.testing.assert_allclose(other.translations, plain.translations, err_msg=what)


def test_radians_in_the_skeleton(tmp_path):
    asf = ASF.replace("angle deg", "angle rad").replace("axis 90 0 45", "axis 1.5 0 0.75")
    asf = asf.replace("(-10.0 170.0)", "(-0.5 1.5)").replace("orientation 10 20 30", "")
    skeleton = load_amc(write(tmp_path, asf=asf)).skeleton
    np.testing.assert_allclose(skeleton.asf[3].axis, np.degrees([1.5, 0, 0.75]))
    np.testing.assert_allclose(skeleton.asf[2].limits[0], np.degrees([-0.5, 1.5]))


def test_absent_bones_rate_and_precision(tmp_path, dtype):
    amc = AMC.replace("KNEE 15 -40\n", "").replace("KNEE 16 -41\n", "")
    motion = load_amc(write(tmp_path, amc), fps=30, dtype=dtype)
    assert_same_rotation(motion.rotations[:, 2], np.array([[1.0, 0, 0, 0]] * 2), 1e-12)
    assert motion.dtype == motion.skeleton.offsets.dtype == motion.frame_time.dtype == dtype
    assert motion.frame_time == np.asarray(1 / 30, dtype)
    with pytest.raises(ValueError, match="fps=0"):
        load_amc(tmp_path / "tiny.amc", fps=0)


def reference_world(asf_path, amc_path, frames):
    """Joint positions by another route: a token-by-token parser, 3x3 matrices, global directions.

    p_child = p_parent + (M_parent)·direction·length, M = M_parent C R C⁻¹ (Hoyet's and most CMU
    viewers' form).
    """
    bones, tree, bone, section = {}, [], {}, ""
    for row in asf_path.read_text().splitlines():
        words = row.split("#")[0].replace("(", " ").replace(")", " ").split()
        if not words:
            continue
        if words[0].startswith(":"):
            section = words[0]
        elif section == ":hierarchy" and words[0] not in ("begin", "end"):
            tree.append(words)
        elif section == ":bonedata" and words[0] == "begin":
            bone = {"dof": []}
        elif section == ":bonedata" and words[0] == "name":
            bones[words[1]] = bone
        elif section == ":bonedata" and words[0] in ("direction", "axis"):
            bone[words[0]] = np.array([float(w) for w in words[1:4]])
        elif section == ":bonedata" and words[0] == "length":
            bone["length"] = float(words[1])
        elif section == ":bonedata" and words[0] == "dof":
            bone["dof"] = words[1:]
    table, current = [], {}
    for row in amc_path.read_text().splitlines():
        words = [] if row[:1] in "#:" else row.split()
        if len(words) == 1:
            current = {}
            table.append(current)
        elif words:
            current[words[0]] = [float(w) for w in words[1:]]
    world = []
    for row in (table[frame] for frame in frames):
        shift, turn = np.array(row["root"][:3]), row["root"][3:]
        found = {"root": (shift, matrices(*zip("xyz", turn, strict=True)), shift)}
        for parent, *children in tree:
            for child in children:
                bone = bones[child]
                _, above, start = found[parent]
                c = matrices(*zip("xyz", bone["axis"], strict=True))
                angles = row.get(child, [])
                r = matrices(*((d[1], a) for d, a in zip(bone["dof"], angles, strict=True)))
                m = above @ c @ r @ c.T
                found[child] = (start, m, start + m @ bone["direction"] * bone["length"])
        world.append([found[name][i] for name in ("root", *bones) for i in (0, 2)])
    return np.array(world)


@pytest.mark.parametrize(("subject", "clip"), [("01", "01_01"), ("02", "02_05")])
def test_world_positions_against_a_second_reader(data_dir, subject, clip):
    path = data_dir / "cmu" / f"{clip}.amc"
    frames = [0, 100, 1000, 1800]
    reference = reference_world(data_dir / "cmu" / f"{subject}.asf", path, frames)
    motion = load_amc(path)
    positions, _, tips = world_by_matrices(
        motion.with_transforms(
            motion.translations[np.array(frames)], motion.rotations[np.array(frames)]
        )
    )
    np.testing.assert_allclose(positions, reference[:, ::2], atol=1e-9)
    ends = np.array(motion.skeleton.end_joints)
    np.testing.assert_allclose(tips, reference[:, 1::2][:, ends], atol=1e-9)


SIDES = {
    "@hipjoint": "%HipJoint",
    "@femur": "#UpLeg",
    "@tibia": "#Leg",
    "@foot": "#Foot",
    "@toes": "#ToeBase",
    "@clavicle": "#Shoulder",
    "@humerus": "#Arm",
    "@radius": "#ForeArm",
    "@wrist": "#Hand",
    "@hand": "#FingerBase",
    "@fingers": "%Fingers",
    "@thumb": "%Thumb",
}
CMU_TO_BVH = {
    "root": "Hips",
    "lowerback": "LowerBack",
    "upperback": "Spine",
    "thorax": "Spine1",
    "lowerneck": "Neck",
    "upperneck": "Neck1",
    "head": "Head",
} | {
    short.replace("@", side[0].lower()): long.replace("#", side).replace("%", side[0])
    for side in ("Left", "Right")
    for short, long in SIDES.items()
}


def test_cmu_clip_from_amc_and_from_bvh(data_dir):
    """01_01 read from AMC and from BVH is one motion.

    The BVH (a conversion made by others) has the same unit: factor 1. Its first frame is a T-pose
    put in front, so frame t of the AMC is frame t + 1. All 31 joints correspond (``CMU_TO_BVH``).
    World rotations of all 31 agree to 3e-4 degrees and world positions to 9e-5 units: the BVH's
    four decimals. But that conversion left two kinds of bones out, putting their children where
    they begin instead of where they end (its OFFSETs there are 0 0 0): the thorax, so that neck,
    head and both arms (17 joints) lie 2.06488 units, the thorax's length, too low; and the wrists,
    so that hands, fingers and thumbs lie a further 1.74178 (left) and 1.72209 (right) back. With
    these bones, taken from the ASF and turned by the BVH's own rotations, put back, all 31 joints
    agree to 1.5e-4.
    """
    amc = load(data_dir / "cmu" / "01_01.amc")
    bvh = load(data_dir / "cmu" / "01_01.bvh")
    assert bvh.num_frames == amc.num_frames + 1 == 2752
    assert abs(bvh.frame_time - amc.frame_time) < 1e-7
    every = slice(0, None, 5)
    p, r, _ = world_by_matrices(amc[every])
    q, s, _ = world_by_matrices(bvh[1:][every])
    index = np.array([bvh.skeleton.index(CMU_TO_BVH[name]) for name in amc.skeleton.names])
    assert len(set(index.tolist())) == amc.num_joints == bvh.num_joints == 31
    q, s = q[:, index], s[:, index]
    angles = scipy_rotation_of(r).inv() * scipy_rotation_of(s)
    assert np.degrees(angles.magnitude().max()) < 5e-4

    names, parents = amc.skeleton.names, amc.skeleton.parents
    gap = np.zeros_like(q)
    for j in range(len(names)):
        above = names[parents[j]]
        gap[:, j] = gap[:, parents[j]] if j else 0
        if above in ("thorax", "lwrist", "rwrist") and j:
            gap[:, j] += s[:, parents[j]] @ np.asarray(amc.skeleton.offsets[j])
    np.testing.assert_allclose(q + gap, p, atol=1.5e-4)
    differs = np.linalg.norm(gap, axis=-1).max(0) > 0
    assert differs.sum() == 17
    np.testing.assert_allclose(q[:, ~differs], p[:, ~differs], atol=1e-4)
    neck = names.index("lowerneck")
    np.testing.assert_allclose(np.linalg.norm(p - q, axis=-1)[:, neck], 2.06488, atol=1e-4)


def scipy_rotation_of(matrix):
    return Rotation.from_matrix(matrix.reshape(-1, 3, 3))


CLIPS = ["01_01", *(f"02_{n:02d}" for n in range(1, 11))]


@pytest.mark.parametrize("clip", CLIPS)
def test_every_capture_round_trips(data_dir, tmp_path, clip):
    motion = load(data_dir / "cmu" / f"{clip}.amc")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save(motion, tmp_path / "again.amc")
        again = load(tmp_path / "again.amc")
    assert_same_motion(motion, again)
    assert np.abs(np.diff(_numbers_of(tmp_path / "again.amc"), axis=0)).max() < 180


def _numbers_of(path):
    text = path.read_text().split(":DEGREES\n")[1].replace("root", "\nroot")
    rows = [line.split()[1:] for line in text.splitlines() if line[:1].isalpha()]
    frames = sum(line.startswith("root") for line in text.splitlines())
    return np.array([float(x) for row in rows for x in row]).reshape(frames, -1)


def assert_same_motion(a, b, rotation=1e-9, length=1e-12):
    assert b.skeleton.names == a.skeleton.names
    assert b.skeleton.parents == a.skeleton.parents
    assert b.skeleton.channels == a.skeleton.channels
    assert b.skeleton.asf == a.skeleton.asf
    assert b.skeleton.end_joints == a.skeleton.end_joints
    assert b.skeleton.length_unit == a.skeleton.length_unit
    assert b.translated_joints == a.translated_joints
    assert b.frame_time == a.frame_time
    assert b.dtype == a.dtype
    np.testing.assert_allclose(b.skeleton.offsets, a.skeleton.offsets, atol=length)
    np.testing.assert_allclose(b.skeleton.end_offsets, a.skeleton.end_offsets, atol=length)
    np.testing.assert_allclose(b.translations, a.translations, atol=length)
    assert angle_between(a.rotations, b.rotations).max() < rotation


def test_decimals_of_a_capture_come_back(data_dir, tmp_path):
    source = data_dir / "cmu" / "02_03.amc"
    save(load(source), tmp_path / "a.amc")
    lines = source.read_text().splitlines()[3:33]
    wanted = {row.split()[0]: row.split()[1:] for row in lines if len(row.split()) > 1}
    found = {
        row.split()[0]: row.split()[1:]
        for row in (tmp_path / "a.amc").read_text().splitlines()[5:35]
    }
    for name, values in wanted.items():
        np.testing.assert_array_equal(
            np.round(np.array(found[name], float), 12), np.round(np.array(values, float), 12)
        )
    assert found["root"] == wanted["root"]


def test_tiny_round_trip_with_translations_and_preset(tmp_path, dtype):
    motion = load_amc(write(tmp_path), dtype=dtype)
    save_amc(motion, tmp_path / "out.amc", asf=tmp_path / "shape.asf")
    again = load_amc(tmp_path / "out.amc", asf=tmp_path / "shape.asf", dtype=dtype)
    eps = np.finfo(dtype).eps
    assert_same_motion(motion, again, rotation=max(30 * eps, 1e-9), length=20 * eps)


def test_rotations_beyond_the_dofs_extend_them(tmp_path):
    motion = load_amc(write(tmp_path))
    rng = np.random.default_rng(0)
    rotations = jnp.asarray(random_quaternions(rng, (2, 4)))
    changed = motion.with_transforms(motion.translations + jnp.array([1.0, 2.0, 4.0]), rotations)
    with pytest.warns(MotionFileWarning, match="to Fixed, knee, slider"):
        save_amc(changed, tmp_path / "wild.amc")
    again = load_amc(tmp_path / "wild.amc")
    assert again.skeleton.channels[1:] == (
        ("tx", "ty", "tz", "rx", "ry", "rz"),
        ("rz", "rx", "tx", "ty", "tz", "ry"),
        ("ry", "rx", "rz", "ty", "tx", "tz"),
    )
    assert again.skeleton.asf[2].limits[:2] == motion.skeleton.asf[2].limits
    assert len(again.skeleton.asf[2].limits) == 6
    assert_same_rotation(again.rotations, rotations, 1e-12)
    np.testing.assert_allclose(again.translations, changed.translations, atol=1e-12)


@pytest.mark.parametrize("kind", ["tree", "chain", "star"])
def test_any_skeleton_gets_bones_that_fit(tmp_path, kind):
    rng = np.random.default_rng(5)
    skeleton = random_skeleton(rng, 8, kind)
    ends = (*skeleton.end_joints, 0, 0, 1, 1)
    skeleton = Skeleton(
        skeleton.names,
        skeleton.parents,
        skeleton.offsets,
        end_joints=sorted(ends),
        end_offsets=np.concatenate([rng.normal(size=(len(ends) - 1, 3)), np.zeros((1, 3))]),
    )
    motion = random_motion(rng, 3, skeleton, translated=False)
    save(motion, tmp_path / "a.amc")
    again = load(tmp_path / "a.amc")
    assert again.skeleton.names == ("root", *skeleton.names[1:])
    assert again.skeleton.parents == skeleton.parents
    assert again.skeleton.end_joints == skeleton.end_joints
    np.testing.assert_allclose(again.skeleton.end_offsets, skeleton.end_offsets, atol=1e-14)
    np.testing.assert_allclose(again.skeleton.offsets, skeleton.offsets, atol=1e-14)
    np.testing.assert_allclose(again.translations, motion.translations, atol=1e-13)
    assert_same_rotation(again.rotations, motion.rotations, 1e-12)
    save(again, tmp_path / "b.amc")
    assert (tmp_path / "a.asf").read_text() == (tmp_path / "b.asf").read_text()


@pytest.mark.filterwarnings("ignore::jaxmotion.io.MotionFileWarning")
def test_bvh_to_amc_and_back(data_dir, tmp_path):
    source = load(data_dir / "bandai" / "walk_normal_002.bvh")
    save(source, tmp_path / "a.amc")
    amc = load(tmp_path / "a.amc")
    save(amc, tmp_path / "a.bvh")
    back = load(tmp_path / "a.bvh")
    wanted = world_by_matrices(source)
    for other in (amc, back):
        assert other.skeleton.names[1:] == source.skeleton.names[1:]
        found = world_by_matrices(other)
        for a, b in zip(wanted, found, strict=True):
            np.testing.assert_allclose(b, a, atol=1e-9 * np.abs(wanted[0]).max())
    assert float(amc.frame_time) == pytest.approx(float(source.frame_time), rel=1e-15)


def test_amc_to_bvh_keeps_the_world(data_dir, tmp_path):
    source = load(data_dir / "cmu" / "02_03.amc")
    save(source, tmp_path / "a.bvh")
    back = load(tmp_path / "a.bvh")
    assert back.skeleton.names == source.skeleton.names
    for a, b in zip(world_by_matrices(source), world_by_matrices(back), strict=True):
        np.testing.assert_allclose(b, a, atol=1e-9)
    assert source.skeleton.channels[source.skeleton.index("lhipjoint")] == ()
    counts = [len(names) for names in back.skeleton.channels]
    assert counts == [6] + [3] * (source.num_joints - 1)


def test_names_that_acclaim_cannot_hold(tmp_path):
    names = ["Hips", "mixamorig:Left Arm", "root", "12", "a#b", "a_b", "end", "50%", "x__link"]
    motion = random_motion(
        np.random.default_rng(0), 2, Skeleton(names, [-1, *range(8)], np.ones((9, 3)))
    )
    save(motion, tmp_path / "a.amc")
    again = load(tmp_path / "a.amc")
    assert again.skeleton.names == (
        "root", "mixamorig:Left_Arm", "root_", "12_", "a_b", "a_b_2", "end_", "50%", "x__link_",
    )  # fmt: skip
    assert_same_rotation(again.rotations, motion.rotations, 1e-12)


def test_which_skeleton_is_used(tmp_path):
    path = write(tmp_path, name="07_02_b")
    (tmp_path / "07_02_b.asf").rename(tmp_path / "07.ASF")
    assert load_amc(path).num_joints == 4
    (tmp_path / "other.asf").write_text("nonsense")
    assert load_amc(path).num_joints == 4
    (tmp_path / "07.ASF").rename(tmp_path / "unrelated.asf")
    with pytest.raises(MotionFileError, match=r"2 \.asf files.*asf=") as caught:
        load_amc(path)
    assert caught.value.path == str(path)
    assert load_amc(path, asf=tmp_path / "unrelated.asf").num_joints == 4
    (tmp_path / "other.asf").unlink()
    assert load_amc(path).num_joints == 4
    (tmp_path / "unrelated.asf").unlink()
    with pytest.raises(MotionFileError, match=r"no \.asf files"):
        load_amc(path)
    with pytest.raises(FileNotFoundError):
        load_amc(tmp_path / "absent.amc")


def test_an_end_of_file_mark_is_no_text(tmp_path):
    plain = load_amc(write(tmp_path))
    marked = load_amc(write(tmp_path, AMC + "\x1a", ASF + "\x1a\r\n"))
    np.testing.assert_array_equal(marked.rotations, plain.rotations)
    assert marked.skeleton.names == plain.skeleton.names


def test_a_last_frame_cut_off_is_dropped(tmp_path):
    whole = load_amc(write(tmp_path))
    for end in ("slider 11 101", "KNEE 16", "KN", "root 1 2", "\n2"):
        cut = AMC[: AMC.rindex(end) + len(end)]
        with pytest.warns(MotionFileWarning, match="cut off"):
            motion = load_amc(write(tmp_path, cut, name="cut"))
        assert motion.num_frames == 1
        np.testing.assert_array_equal(motion.rotations, whole.rotations[:1])


@pytest.mark.parametrize(
    ("old", "new", "line", "frame", "message"),
    [
        ("KNEE 16 -41", "KNEE 16 -4x1", 11, 1, "2 finite numbers"),
        ("KNEE 16 -41", "KNEE 16 nan", 11, 1, "2 finite numbers"),
        ("KNEE 16 -41", "KNEE 1_6 4", 11, 1, "2 finite numbers"),
        ("KNEE 16 -41\n", "", 11, 1, "'knee' and 2"),
        ("KNEE 15 -40\n", "ellbow 15 -40\n", 6, 0, "unknown bone 'ellbow'"),
        ("KNEE 15 -40\n", "root 15 -40\n", 6, 0, "second bone 'root'"),
        ("\n2\nroot", "\n1\nroot", 9, 1, "constant step"),
        ("\n2\nroot", "\n2 2\nroot", 9, 0, "unknown bone '2'"),
        ("root 1 2 3 10 20 30", "root 1 2 3 10 20", 5, 0, "'root' and 6"),
        (":DEGREES", "DEGREES", 3, None, "keyword"),
        (":DEGREES", ":SAMPLES-PER-SECOND 0", 3, None, "frames a second"),
    ],
)
def test_errors_say_where(tmp_path, old, new, line, frame, message):
    assert AMC.count(old) == 1
    with pytest.raises(MotionFileError, match=message) as caught:
        load_amc(write(tmp_path, AMC.replace(old, new)))
    assert (caught.value.line, caught.value.frame) == (line, frame)
    assert caught.value.path.endswith("tiny.amc")


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("length 2\n", "length two\n", 27, "1 numbers"),
        ("length 2\n", "length 1e999\n", 27, "finite"),
        ("length 2\n", "length 1e308\n     direction 1e9 0 0\n", None, "finite"),
        ("angle deg", "angle gon", 7, "'deg' or 'rad'"),
        ("dof rz rx", "dof rz rw", 29, "dofs among"),
        ("dof rz rx", "dof rz rz", 29, "each once"),
        ("dof rz rx", "dof rx l", 29, "changes its length"),
        ("dof rz rx", "dof rz rx ry", 30, "4 limits"),
        ("20 ZYX", "20 ZYZ", 28, "order of axes"),
        ("name knee", "name Fixed", 24, "unique"),
        ("name knee", "name root", 24, "of its own"),
        ("name knee", "name left knee", 25, "one word"),
        ("Fixed knee slider", "Fixed knee", 33, "hanging from nothing"),
        ("Fixed knee slider", "Fixed knee Knee slider", 43, "second parent"),
        ("Fixed knee slider", "Fixed knee sliderr", 43, "'sliderr'"),
        ("root Fixed\n    Fixed", "Fixed", 16, "hanging"),
        ("  end\n  begin\n     name knee", "     name knee", 23, "second 'name'"),
        ("\n:bonedata\n", "\n:bones\n", 42, "'Fixed'"),
    ],
)
def test_skeleton_errors_say_where(tmp_path, old, new, line, message):
    assert old in ASF
    with pytest.raises(MotionFileError, match=message) as caught:
        load_amc(write(tmp_path, asf=ASF.replace(old, new, 1)))
    if line is not None:
        assert caught.value.line == line
        assert caught.value.path.endswith("tiny.asf")


def test_what_cannot_be_written(tmp_path):
    motion = load_amc(write(tmp_path))
    out = tmp_path / "out.amc"
    with pytest.raises(ValueError, match="'slider' at frame 1"):
        save_amc(motion.with_transforms(rotations=motion.rotations.at[1, 3, 0].set(jnp.nan)), out)
    with pytest.raises(ValueError, match=r"rotation of 'knee' at frame 0 is.*unit quaternions"):
        save_amc(motion.with_transforms(rotations=motion.rotations.at[0, 2].mul(1.01)), out)
    batch = Motion(
        motion.skeleton, motion.translations[None], motion.rotations[None], motion.frame_time
    )
    with pytest.raises(ValueError, match="one clip"):
        save_amc(batch, out)
    with pytest.raises(ValueError, match="two names"):
        save_amc(motion, out, asf=out)
    assert not out.exists()
    (tmp_path / "out.asf").write_text("precious")
    with pytest.raises(FileExistsError):
        save_amc(motion, out, overwrite=False)
    assert not out.exists()
    assert (tmp_path / "out.asf").read_text() == "precious"
    save_amc(motion, out)
    assert load_amc(out).num_frames == 2


def test_frame_rates_survive(tmp_path, dtype):
    motion = load_amc(write(tmp_path), dtype=dtype)
    for seconds in (1 / 120, 0.0333333, 0.0417083750417, 1 / 59.94, 1.0, 0.01, 7.3):
        clip = Motion(motion.skeleton, motion.translations, motion.rotations, seconds)
        save_amc(clip, tmp_path / "rate.amc")
        again = load_amc(tmp_path / "rate.amc", dtype=dtype).frame_time
        if seconds == 7.3:  # no double f has 1/f == 7.3
            assert abs(again - clip.frame_time) < 2e-15 or dtype == np.float32
        else:
            assert again == clip.frame_time
    save_amc(motion, tmp_path / "rate.amc")
    assert ":SAMPLES-PER-SECOND 120.0\n" in (tmp_path / "rate.amc").read_text()


def test_a_bone_with_translations_that_stay_nought_is_not_translated(tmp_path):
    """Some programs write all six dofs for every bone."""
    asf = ASF.replace("dof rz rx\n", "dof rz rx tx ty tz\n")
    asf = asf.replace("(-inf inf)", "(-inf inf) (-1 1) (-1 1) (-1 1)")
    for shift, moved in (("0 -0.0 1e-9", (0, 3)), ("0 1e-3 0", (0, 2, 3))):
        amc = AMC.replace("KNEE 15 -40", "KNEE 15 -40 0 0 0").replace("16 -41", f"16 -41 {shift}")
        motion = load_amc(write(tmp_path, amc, asf))
        assert motion.translated_joints == moved
        save_amc(motion, tmp_path / "out.amc")
        back = load_amc(tmp_path / "out.amc")
        assert back.skeleton.channels == motion.skeleton.channels
        np.testing.assert_allclose(back.translations, motion.translations, atol=1e-8)
