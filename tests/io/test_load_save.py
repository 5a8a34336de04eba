"""``load`` and ``save``: the right format, the right dtype, whole files or none."""

import os
import pickle
import stat

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion._plain import quoted
from jaxmotion.io import MotionFileError
from jaxmotion.io.atomic import atomic_write
from tests.helpers import random_motion, random_skeleton, single_precision


@pytest.fixture
def motion():
    skeleton = random_skeleton(np.random.default_rng(0), 4, "chain")
    return random_motion(np.random.default_rng(1), 5, skeleton, translated=False)


@pytest.mark.parametrize("suffix", [".bvh", ".BVH", ".npz"])
def test_the_suffix_chooses_the_format(motion, tmp_path, suffix):
    path = tmp_path / f"clip{suffix}"
    jm.save(motion, path)
    for given in (path, str(path)):
        back = jm.load(given)
        assert back.skeleton.names == motion.skeleton.names
        np.testing.assert_array_equal(back.translations, motion.translations)


@pytest.mark.parametrize("name", ["clip.fbx", "clip", "clip.bvh.gz", "clip.asf"])
def test_other_suffixes_are_refused_by_name(motion, tmp_path, name):
    hint = r"name the \.amc" if name.endswith("asf") else "one of those"
    with pytest.raises(MotionFileError, match=rf"expected \.bvh, \.amc.*{hint}"):
        jm.load(tmp_path / name)
    with pytest.raises(MotionFileError, match=r"expected \.bvh, \.amc"):
        jm.save(motion, tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".bvh", ".amc", ".npz"])
def test_a_missing_file_is_an_oserror(tmp_path, suffix):
    with pytest.raises(FileNotFoundError):
        jm.load(tmp_path / f"none{suffix}")


def test_dtype(motion, tmp_path):
    path = tmp_path / "clip.bvh"
    jm.save(motion, path)
    assert jm.load(path).dtype == np.float64
    assert jm.load(path, dtype="float32").dtype == np.float32
    with pytest.raises(ValueError, match="float32 or float64"):
        jm.load(path, dtype=np.int32)
    with single_precision():
        assert jm.load(path).dtype == np.float32
        with pytest.raises(ValueError, match="jax_enable_x64"):
            jm.load(path, dtype=np.float64)


def test_overwriting_is_a_choice(motion, tmp_path):
    path = tmp_path / "clip.bvh"
    jm.save(motion, path, overwrite=False)
    jm.save(motion, path)
    path.write_text("mine")
    with pytest.raises(FileExistsError, match="overwrite=True"):
        jm.save(motion, path, overwrite=False)
    assert path.read_text() == "mine"
    assert os.listdir(tmp_path) == ["clip.bvh"]


def test_permissions_are_kept(motion, tmp_path):
    path = tmp_path / "clip.bvh"
    jm.save(motion, path)
    plain = tmp_path / "plain"
    plain.touch()
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)
    path.chmod(0o640)
    jm.save(motion, path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_a_link_keeps_pointing(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "target")
    for text in (b"one", b"two"):
        with atomic_write(tmp_path / "link") as file:
            file.write(text)
        assert (tmp_path / "link").is_symlink()
        assert (tmp_path / "target").read_bytes() == text


@pytest.mark.parametrize("trouble", [RuntimeError, KeyboardInterrupt])
def test_a_failure_leaves_everything_as_it_was(tmp_path, trouble):
    def fail(path):
        with atomic_write(path) as file:
            file.write(b"half")
            file.flush()
            assert len(os.listdir(tmp_path)) == 1 + (tmp_path / "old").exists()
            raise trouble

    with pytest.raises(trouble):
        fail(tmp_path / "new")
    assert not os.listdir(tmp_path)
    (tmp_path / "old").write_bytes(b"old")
    with pytest.raises(trouble):
        fail(tmp_path / "old")
    assert os.listdir(tmp_path) == ["old"]
    assert (tmp_path / "old").read_bytes() == b"old"


def test_a_file_that_appears_meanwhile_is_not_replaced(tmp_path):
    def race():
        with atomic_write(tmp_path / "a", overwrite=False) as file:
            file.write(b"late")
            (tmp_path / "a").write_bytes(b"early")

    with pytest.raises(FileExistsError):
        race()
    assert os.listdir(tmp_path) == ["a"]
    assert (tmp_path / "a").read_bytes() == b"early"


def test_places_that_cannot_be_written(motion, tmp_path):
    (tmp_path / "folder.bvh").mkdir()
    with pytest.raises(IsADirectoryError, match="folder"):
        jm.save(motion, tmp_path / "folder.bvh")
    with pytest.raises(FileNotFoundError, match="no folder"):
        jm.save(motion, tmp_path / "none" / "clip.bvh")


def test_the_error_reads_well_and_travels():
    error = MotionFileError("a/b.bvh", "x", expected="y", hint="z", line=3, frame=1)
    assert str(error) == "a/b.bvh:3 (frame 1): found x; expected y. Try: z"
    assert str(MotionFileError("b.bvh", "x")) == "b.bvh: found x"
    assert isinstance(error, ValueError)
    copy = pickle.loads(pickle.dumps(error))
    assert vars(copy) == vars(error)
    assert str(copy) == str(error)


def test_quoted_pieces_are_short_and_printable():
    assert quoted("a b") == "'a b'"
    assert len(quoted("x" * 10_000)) < 50
    assert quoted(b"\xff\x00\n").isprintable()
    assert len(quoted(b"\xff" * 10_000)) < 250
