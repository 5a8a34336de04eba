"""Our own .npz: bit for bit, every field, never pickled, and what a wrong file says."""

import dataclasses
import io
import json
import pickle
import zipfile

import jax
import numpy as np
import pytest

from jaxmotion import Motion, Skeleton
from jaxmotion._asf_bone import AsfBone
from jaxmotion.io import MotionFileError, load
from jaxmotion.io.archive import Archive
from jaxmotion.io.npz import load_npz, save_npz
from jaxmotion.skeleton import Conventions
from tests.helpers import random_motion


def full_motion(dtype=np.float64, batch=()):
    """A motion that uses every field, odd values included."""
    plain = random_motion(np.random.default_rng(1), 4, 3, dtype=dtype, batch=batch)
    bones = [
        AsfBone(),
        AsfBone((0.1, -7.62852e-16, 90.0), "ZYX", (1.0, 0.0, 0.0), 0.3, ((-10.0, np.inf),)),
        AsfBone(),
    ]
    skeleton = Skeleton(
        ["Hüfte", "mixamorig:Left Arm", "\udc80 broken"],
        [-1, 0, 0],
        plain.skeleton.offsets,
        end_joints=[2, 1],
        end_offsets=np.array([[0.1, -0.0, 5e-324], [1 / 3, 2.0, 1e30]]).astype(dtype) % 7,
        end_labels=["End site", "End Site"],
        channels=[("Zrotation", "Xposition"), ("rx",), ()],
        asf=bones,
        up="z",
        length_unit=0.45,
        conventions=Conventions("guessed", "assumed", metres=0.01),
    )
    return Motion(
        skeleton,
        plain.translations,
        plain.rotations,
        plain.frame_time,
        translated_joints=(0, 2),
        frame_time_text=".0333333",
    )


def assert_identical(a, b):
    assert jax.tree.structure(a) == jax.tree.structure(b)
    one, other = a.skeleton.conventions, b.skeleton.conventions
    assert dataclasses.asdict(one) == dataclasses.asdict(other)  # any two compare equal
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert np.asarray(x).dtype == np.asarray(y).dtype
        assert np.asarray(x).tobytes() == np.asarray(y).tobytes()


@pytest.mark.parametrize("batch", [(), (2,), (2, 1)])
@pytest.mark.parametrize("compress", [True, False])
def test_bit_for_bit(tmp_path, dtype, batch, compress):
    motion = full_motion(dtype, batch)
    save_npz(motion, tmp_path / "a.npz", compress=compress)
    again = load(tmp_path / "a.npz")
    assert_identical(motion, again)
    save_npz(again, tmp_path / "b.npz", compress=compress)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_no_field_is_forgotten(tmp_path):
    """A field added to the currency must be added to the format."""
    saved = {
        Motion: "skeleton translations rotations frame_time translated_joints frame_time_text",
        Skeleton: "names parents offsets end_offsets end_joints end_labels channels asf up "
        "length_unit encoding conventions",
        AsfBone: "axis axis_order direction length limits",
        Conventions: "up frame_time angle metres",
    }
    for kind, names in saved.items():
        assert {f.name for f in dataclasses.fields(kind)} == set(names.split())
    defaults = random_motion(np.random.default_rng(0), 1, 1)
    save_npz(defaults, tmp_path / "a.npz")
    assert_identical(defaults, load_npz(tmp_path / "a.npz"))


def test_another_dtype_on_request(tmp_path):
    save_npz(full_motion(), tmp_path / "a.npz")
    single = load_npz(tmp_path / "a.npz", dtype=np.float32)
    assert {x.dtype for x in jax.tree.leaves(single)} == {np.dtype(np.float32)}
    with pytest.raises(ValueError, match="float16"):
        load_npz(tmp_path / "a.npz", dtype=np.float16)


def test_plain_numpy_reads_it(tmp_path):
    motion = full_motion()
    save_npz(motion, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["rotations"], motion.rotations)
        assert json.loads(str(arrays["static"]))["up"] == "z"


def test_nothing_unfinished_is_written(tmp_path):
    motion = full_motion()
    with pytest.raises(ValueError, match="rotations"):
        save_npz(motion.with_transforms(rotations=motion.rotations * np.nan), tmp_path / "a.npz")
    assert list(tmp_path.iterdir()) == []
    save_npz(motion, tmp_path / "a.npz")
    with pytest.raises(FileExistsError):
        save_npz(motion, tmp_path / "a.npz", overwrite=False)


def arrays_of(path):
    with np.load(path) as arrays:
        return {name: arrays[name] for name in arrays.files}


def static_with(**changes):
    def change(arrays):
        static = json.loads(str(arrays["static"]))
        static.update(changes)
        return {**arrays, "static": np.array(json.dumps(static))}

    return change


def with_bone(**changes):
    def change(arrays):
        bones = json.loads(str(arrays["static"]))["asf"]
        bones[1].update(changes)
        return static_with(asf=bones)(arrays)

    return change


def with_rotation(place, scale):
    def change(arrays):
        rotations = arrays["rotations"].copy()
        rotations[place] *= scale
        return {**arrays, "rotations": rotations}

    return change


def beyond_unicode(text):
    """The text with a last character that is none."""
    characters = text.reshape(1).view(np.uint32).copy()
    characters[-1] = 0x110000
    return characters.view(text.dtype).reshape(())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: {**a, "jaxmotion_motion": np.array(2)}, "version"),
        (lambda a: {**a, "jaxmotion_motion": np.array([1, 1])}, "version"),
        (lambda a: {k: v for k, v in a.items() if k != "offsets"}, "no array 'offsets'"),
        (lambda a: {k: v for k, v in a.items() if k != "jaxmotion_motion"}, "ours or AMASS"),
        (lambda a: {**a, "offsets": a["offsets"].astype(int)}, "float32 or float64"),
        (lambda a: {**a, "rotations": a["rotations"][:, :2]}, "fit together"),
        (lambda a: {**a, "rotations": a["rotations"] * np.nan}, "nan in 'rotations'"),
        (lambda a: {**a, "frame_time": np.array([0.1, 0.2])}, "frame time"),
        (lambda a: {**a, "frame_time": np.array(-0.1)}, "frame time"),
        (lambda a: {**a, "static": np.array("{")}, "JSON"),
        (lambda a: {**a, "static": np.array("[1]")}, "JSON object"),
        (lambda a: {**a, "static": np.array("[" * 100_000)}, "JSON"),
        (lambda a: {**a, "static": np.zeros(3)}, "JSON"),
        (static_with(names=["a", "a", "b"]), "unique"),
        (static_with(names="abc"), "texts"),
        (static_with(names=7), "fit together"),
        (static_with(parents=[-1, 0, 5]), "parents"),
        (static_with(parents=[-1, 0, 0.5]), "whole number"),
        (static_with(end_joints=[0, 9]), "beyond"),
        (static_with(translated_joints=[3]), "beyond"),
        (static_with(channels=["ab", [], []]), "texts"),
        (static_with(up="w"), "up"),
        (static_with(conventions={"up": "so"}), "conventions"),
        (static_with(conventions={"down": "told"}), "down"),
        (static_with(conventions={"metres": -1}), "-1 metres"),
        (static_with(length_unit="metre"), "fit together"),
        (static_with(asf=[{}]), "axis"),
        (static_with(asf=[1, 2, 3]), "fit together"),
        (static_with(frame_time_text=3), "texts"),
        (static_with(encoding=3), "texts"),
        (static_with(length_unit=10**400), "fit together"),
        (static_with(length_unit=float("nan")), "the number nan"),
        (with_bone(length=10**400), "fit together"),
        (with_bone(axis=[0, float("inf"), 0]), "the number inf"),
        (with_bone(limits=[[0, float("nan")]]), "limits"),
        (with_rotation((2, 1), 1.01), "rotation of 'mixamorig:Left Arm' at frame 2 is .*unit"),
        (with_rotation((3, 0), 0.0), "rotation of 'Hüfte' at frame 3 is .*unit"),
        (lambda a: {**a, "static": beyond_unicode(a["static"])}, "'static' .characters beyond"),
        (lambda a: {**a, "jaxmotion_motion": beyond_unicode(np.array("11"))}, "beyond Unicode"),
        (lambda a: {**a, "frame_time": -np.ones((30, 40))}, "frame time"),
        (static_with(up="\n\x1b"), "up="),
    ],
)
def test_wrong_files_say_what_is_wrong(tmp_path, change, message):
    path = tmp_path / "a.npz"
    save_npz(full_motion(), path)
    np.savez(path, **change(arrays_of(path)))
    with pytest.raises(MotionFileError, match=message) as caught:
        load_npz(path)
    assert caught.value.path == str(path)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 1000


def test_a_batch_says_which_clip_is_wrong(tmp_path):
    motion = full_motion(batch=(2, 2))
    rotations = np.array(motion.rotations)
    rotations[1, 0, 3, 2] *= 2
    bad = motion.with_transforms(rotations=rotations)
    with pytest.raises(ValueError, match="broken' at frame 3 of clip 1, 0 is"):
        save_npz(bad, tmp_path / "a.npz")
    save_npz(motion, tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", **{**arrays_of(tmp_path / "a.npz"), "rotations": rotations})
    with pytest.raises(MotionFileError, match="broken' at frame 3 of clip 1, 0 is"):
        load_npz(tmp_path / "a.npz")


def test_files_from_before_the_encoding_was_kept(tmp_path):
    path = tmp_path / "a.npz"
    save_npz(full_motion(), path)
    arrays = arrays_of(path)
    static = json.loads(str(arrays["static"]))
    assert static.pop("encoding") == "utf-8"
    np.savez(path, **{**arrays, "static": np.array(json.dumps(static))})
    assert_identical(load_npz(path), full_motion())


class Mine:
    """Unpickling this would be noticed."""

    def __reduce__(self):
        return (pytest.fail, ("a pickle was loaded",))


def test_pickles_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    save_npz(full_motion(), path)
    arrays = arrays_of(path)
    arrays["rotations"] = np.array([Mine()], dtype=object)
    np.savez(path, **arrays)
    with pytest.raises(MotionFileError, match="pickled objects in 'rotations'"):
        load_npz(path)
    path.write_bytes(pickle.dumps([1, 2]))
    with pytest.raises(MotionFileError, match="damaged archive"):
        load_npz(path)
    with pytest.raises(FileNotFoundError):
        load_npz(tmp_path / "absent.npz")


def test_a_shape_that_the_bytes_do_not_hold(tmp_path):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (1 << 40, 3)}
    )
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("x.npy", header.getvalue() + bytes(80))
        archive.writestr("y.npy", b"\x93NUMPY\x09\x00")
        archive.writestr("z.npy", b"")
    archive = Archive(tmp_path / "a.npz")
    assert archive.names == ("x", "y", "z")
    for name, found in (("x", "bytes"), ("y", "version"), ("z", "damaged")):
        with pytest.raises(MotionFileError, match=found):
            archive.read(name)
