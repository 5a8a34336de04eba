"""The file of a shard: what goes in comes out, and what was changed is found out."""

import json
import struct

import numpy as np
import pytest

from jaxmotion.corpus.shards import DamagedShard, Row, Shard, write_shard
from tests.corpus.clips import clip


def rows(dtype):
    made = []
    for k, frames in enumerate((9, 1, 30)):
        c = clip(frames, k, dtype)
        moved = (0, 2) if k == 2 else (0,)
        t = np.array(c.translations)
        t[:, 2, 1] += np.arange(frames, dtype=dtype) * (k == 2)
        bones = c.skeleton
        made.append(Row(f"é {k}", t, c.rotations, bones.offsets, bones.end_offsets, moved))
    made.insert(1, Row("broken", fault="it has none"))
    return made


def written(path, dtype=np.float64):
    made = rows(dtype)
    joints, ends = len(made[0].offsets), len(made[0].ends)
    with path.open("wb") as file:
        write_shard(file, made, joints, ends, dtype)
    return made


def test_what_goes_in_comes_out(tmp_path, dtype):
    made = written(tmp_path / "a", dtype)
    shard = Shard(tmp_path / "a")
    assert [about["frames"] for about in shard.clips] == [9, 0, 1, 30]
    assert shard.clips[1]["fault"] == "it has none"
    for k in (0, 2, 3):
        got, want = shard.clip(k), made[k]
        assert got.rotations.dtype == dtype
        np.testing.assert_array_equal(got.rotations, want.rotations)
        np.testing.assert_array_equal(got.translations(), want.translations)
        np.testing.assert_array_equal(got.translations(slice(2, 5)), want.translations[2:5])
        np.testing.assert_array_equal(got.offsets, want.offsets)
        np.testing.assert_array_equal(got.ends, want.ends)
        assert got.translated == want.translated
        q = want.rotations.astype(float)
        moments = np.stack([q[:, j].T @ q[:, j] for j in range(q.shape[1])])
        np.testing.assert_allclose(shard.moments[k], moments, 1e-12, 1e-12)
    with pytest.raises(ValueError, match="read-only"):
        shard.clip(0).rotations[0] = 1


def test_the_layout_is_the_documented_one(tmp_path):
    made = written(tmp_path / "a")
    data = (tmp_path / "a").read_bytes()
    magic, version, length, _ = struct.unpack_from("<8sIII", data)
    assert (magic, version) == (b"JMCORPUS", 1)
    header = json.loads(data[64 : 64 + length])
    assert header["size"] == len(data)
    assert header["joints"] == [0, 2]
    where = header["arrays"]["rotations"]
    assert all(array["at"] % 64 == 0 for array in header["arrays"].values())
    q = np.frombuffer(data, where["dtype"], int(np.prod(where["shape"])), where["at"])
    frames = slice(header["clips"][3]["first"], None)
    np.testing.assert_array_equal(q.reshape(where["shape"])[frames], made[3].rotations)


def test_the_same_rows_give_the_same_bytes(tmp_path):
    written(tmp_path / "a")
    written(tmp_path / "b")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize("cut", [0, 10, 64, 300, -64, -1])
def test_a_shard_that_was_cut_off_is_found_out(tmp_path, cut):
    path = tmp_path / "a"
    written(path)
    whole = path.read_bytes()
    path.write_bytes(whole[:cut])
    with pytest.raises(DamagedShard):
        Shard(path)
    path.write_bytes(whole + b"more")
    with pytest.raises(DamagedShard, match="it was written with"):
        Shard(path)


def test_every_changed_byte_that_is_read_is_found_out(tmp_path):
    path = tmp_path / "a"
    written(path)
    data = bytearray(path.read_bytes())
    arrays = Shard(path)
    used = [(0, 20), (64, 64 + struct.unpack_from("<I", data, 12)[0])]
    about = json.loads(data[64 : used[1][1]])["arrays"].values()
    used += [
        (a["at"], a["at"] + int(np.prod(a["shape"])) * np.dtype(a["dtype"]).itemsize) for a in about
    ]
    assert len(arrays.clips) == 4
    rng = np.random.default_rng(0)
    for start, stop in used:
        for place in rng.integers(start, stop, 5):
            data[place] ^= 0x10
            path.write_bytes(data)
            with pytest.raises(DamagedShard):
                [Shard(path).clip(k) for k in range(4)]
            data[place] ^= 0x10


def test_another_layout_and_other_files_are_refused(tmp_path):
    path = tmp_path / "a"
    written(path)
    data = path.read_bytes()
    path.write_bytes(data[:8] + struct.pack("<I", 2) + data[12:])
    with pytest.raises(DamagedShard, match="layout version 2; this is 1"):
        Shard(path)
    path.write_bytes(b"BVH" * 100)
    with pytest.raises(DamagedShard, match="no shard of a corpus"):
        Shard(path)


def test_a_shard_may_have_no_sound_clip(tmp_path):
    with (tmp_path / "a").open("wb") as file:
        write_shard(file, [Row("x", fault="none")], 3, 0, np.float32)
    assert Shard(tmp_path / "a").clips[0]["fault"] == "none"
