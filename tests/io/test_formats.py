"""The table of formats: rows that exist, files told apart, files that go together."""

import inspect
from pathlib import Path

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.io import amass, formats, npz
from tests.helpers import random_motion


@pytest.mark.parametrize("row", formats.FORMATS, ids=lambda row: row.load or row.suffix)
def test_a_row_s_functions_take_what_load_and_save_pass_on(row):
    assert row.load or row.save
    if row.load is not None:
        read = inspect.signature(formats._named(row.load)).parameters
        assert {"dtype", "fps", "up"} <= set(read)
    if row.save is not None:
        assert {"overwrite", "up"} <= set(inspect.signature(formats._named(row.save)).parameters)
    if row.note is not None:
        assert "metres" in inspect.signature(formats._named(row.save)).parameters
    assert callable(formats._named(row.knows)) if row.knows else True


def archive(path, **arrays):
    np.savez(path, **{name: np.zeros(3) for name in arrays or ("other",)})
    return path


def test_archives_are_told_apart(tmp_path):
    ours = tmp_path / "ours.NPZ"
    jm.save(random_motion(np.random.default_rng(0), 3), ours)
    parts = archive(tmp_path / "parts.npz", root_orient=0, pose_body=0, trans=0)
    other, text = archive(tmp_path / "other.npz"), tmp_path / "text.npz"
    text.write_text("no archive")
    assert formats.reader(ours) is npz.load_npz
    assert formats.reader(parts) is amass.load_amass
    found = [p for p in (ours, parts, other, text) if formats.may_hold_a_motion(p)]
    assert found == [ours, parts, text]  # reading tells what the last one is


def test_files_that_go_together():
    assert formats.files_of(Path("a/walk.amc")) == [Path("a/walk.amc"), Path("a/walk.asf")]
    for name in ("walk.bvh", "walk.npz", "walk"):
        assert formats.files_of(Path(name)) == [Path(name)]


def test_files_that_are_read_along(tmp_path):
    take = tmp_path / "take_01.amc"
    assert formats.read_with(take) == []  # reading it will tell
    take.touch()
    assert formats.read_with(take) == []
    skeleton = tmp_path / "take.asf"
    skeleton.touch()
    assert formats.read_with(take) == [skeleton]
    assert formats.read_with(tmp_path / "take.bvh") == []


@pytest.mark.parametrize("name", ["walk.fbx", "walk", "walk.asf"])
def test_other_suffixes_are_refused_with_those_there_are(name):
    read = r"\.bvh, \.amc \(with its \.asf\)"
    for choose, rest in ((formats.reader, r" or \.npz"), (formats.writer, r", \.npz, \.glb, ")):
        with pytest.raises(jm.io.MotionFileError, match=read + rest):
            choose(Path(name))
    assert not formats.may_hold_a_motion(Path(name))
