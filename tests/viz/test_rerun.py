"""A recording, read back by rerun, holds the clip's joints and bones at every frame."""

import sys

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.viz import log_rerun
from tests.helpers import random_motion, world_by_matrices

rr = pytest.importorskip("rerun", reason="recordings need rerun-sdk")


def logged(motion, *entity):
    """What a recording says of a motion, as rerun's messages, and its record batches."""
    recording = rr.RecordingStream("jaxmotion.tests")
    held = recording.memory_recording()
    log_rerun(motion, *entity, recording=recording)
    return held.drain_as_bytes()


def batches(motion, tmp_path, *entity):
    """Entity to the record batches of its chunks, those that are static and those in time."""
    chunk = pytest.importorskip("rerun.chunk", reason="this rerun does not read recordings")
    (tmp_path / "a.rrd").write_bytes(logged(motion, *entity))
    found = {}
    for piece in chunk.RrdReader(tmp_path / "a.rrd").stream():
        key = (str(piece.entity_path), bool(piece.is_static))
        found.setdefault(key, []).append(piece.to_record_batch())
    return found


def column(tables, ending):
    """A column by the end of its name, rows of all the tables, in order of frames."""
    rows = []
    for table in tables:
        [name] = [name for name in table.schema.names if name.endswith(ending)]
        values = table.column(name)
        values = values.cast("int64") if name == "seconds" else values  # nanoseconds
        rows += zip(table.column("frame").to_pylist(), values.to_pylist(), strict=True)
    return [value for _, value in sorted(rows, key=lambda row: row[0])]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_joints_and_bones_are_where_they_are(dtype, tmp_path):
    motion = random_motion(np.random.default_rng(0), 6, 5, dtype)
    found = batches(motion, tmp_path)
    joints, _, ends = world_by_matrices(motion)
    points = np.concatenate([joints, ends], axis=1)
    got = column(found["/motion/joints", False], "Points3D:positions")
    np.testing.assert_allclose(np.array(got), points, atol=1e-5)
    parents = [*motion.skeleton.parents, *motion.skeleton.end_joints]
    bones = column(found["/motion/bones", False], "LineStrips3D:strips")
    want = np.stack([points[:, parents[1:]], points[:, 1:]], axis=2)
    np.testing.assert_allclose(np.array(bones), want, atol=1e-5)
    assert column(found["/motion/joints", False], "frame") == list(range(6))
    seconds = column(found["/motion/joints", False], "seconds")
    np.testing.assert_allclose(np.array(seconds) / 1e9, np.arange(6) / 30, atol=1e-8)


def test_names_and_the_up_axis_are_told_once(tmp_path):
    motion = jm.reorient(jm.samples.load("walk").motion[:4], "z")
    found = batches(motion, tmp_path, "a/walk")
    labels = found["/a/walk/joints", True]
    [name] = [name for name in labels[0].schema.names if name.endswith(":labels")]
    [[*names]] = labels[0].column(name).to_pylist()
    assert names[:22] == list(motion.skeleton.names)
    assert names[22:] == [f"{motion.skeleton.names[j]} end" for j in motion.skeleton.end_joints]
    [axes] = found["/a/walk", True]
    [name] = [name for name in axes.schema.names if name.endswith(":xyz")]
    assert axes.column(name).to_pylist() == [[[3, 5, 1]]]  # right, forward, up


def test_one_joint_has_no_bones(tmp_path):
    motion = random_motion(np.random.default_rng(1), 3, jm.Skeleton(["a"], [-1], np.ones((1, 3))))
    found = batches(motion, tmp_path)
    assert ("/motion/joints", False) in found
    assert not any(path.endswith("bones") for path, _ in found)


def test_missing_places_are_logged_as_they_are(tmp_path):
    motion = random_motion(np.random.default_rng(2), 4, 3)
    broken = motion.replace(translations=motion.translations.at[2, 1].set(np.nan))
    got = np.array(column(batches(broken, tmp_path)["/motion/joints", False], "positions"))
    assert np.isnan(got[2]).any()
    assert np.isfinite(got[[0, 1, 3]]).all()


def test_the_active_recording_is_the_default():
    motion = random_motion(np.random.default_rng(3), 3, 3)
    recording = rr.RecordingStream("jaxmotion.tests")
    held = recording.memory_recording()
    held.drain_as_bytes()
    with recording:
        log_rerun(motion)
    assert b"motion/joints" in held.drain_as_bytes()


def test_without_a_recording_or_rerun(monkeypatch):
    motion = random_motion(np.random.default_rng(4), 3, 3)
    with pytest.raises(ValueError, match=r"log_rerun: no recording; call rerun\.init"):
        log_rerun(motion)
    with pytest.raises(ValueError, match="log_rerun: one clip at a time"):
        log_rerun(random_motion(np.random.default_rng(5), 3, 3, batch=(2,)))
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ImportError, match=r"rerun-sdk: pip install 'jaxmotion\[rerun\]'"):
        log_rerun(motion)
