"""BVH files read and written, quaternions included, against pybvh and pymotion.

Ours converts every rotation to a quaternion and back and writes exact decimals; both peers keep the
file's Euler angles and write six decimals. pybvh cannot read the dance (positions on joints other
than the root), so it runs on a CMU clip. "numbers only" is ``numpy.fromstring`` on the rows: how
much of reading is turning text into numbers.
"""

import os
from pathlib import Path

import numpy as np
import pytest

import jaxmotion as jm

pybvh = pytest.importorskip("pybvh")
pymotion = pytest.importorskip("pymotion.io.bvh")

DANCE = "bandai/dance-short_normal_001.bvh"
JUMPS = "cmu/01_01.bvh"


@pytest.fixture
def clip(request):
    """A real capture; see tests/conftest.py for where they are."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    path = Path(os.environ.get("JAXMOTION_TEST_DATA", beside)) / request.param
    if not path.is_file():
        pytest.skip(f"no {path}")
    return path


def megabytes(path: Path) -> tuple[float, str]:
    return path.stat().st_size / 1e6, "MB"


def pymotion_read(path):
    reader = pymotion.BVH()
    reader.load(str(path))
    return reader


@pytest.mark.parametrize("clip", [DANCE, JUMPS], indirect=True)
def test_read(race, clip):
    data = clip.read_bytes()
    rows = data[data.index(b"\n", data.index(b"Frame Time")) :]
    peers = {
        "pymotion": lambda: pymotion_read(clip).data["rotations"],
        "numbers only": lambda: np.fromstring(rows, sep=" "),
    }
    if "cmu" in str(clip):
        peers["pybvh"] = lambda: pybvh.read_bvh_file(clip).joint_angles
    ours, theirs = race(
        f"read BVH {clip.name}",
        lambda: jm.load(clip),
        peers,
        goals={"pymotion": 40 / 12} if "bandai" in str(clip) else None,
        amount=megabytes(clip),
    )
    np.testing.assert_array_equal(theirs["pymotion"].shape[:2], ours.rotations.shape[:2])


@pytest.mark.parametrize("clip", [DANCE, JUMPS], indirect=True)
def test_write(race, clip, tmp_path):
    motion = jm.load(clip)
    jm.save(motion, tmp_path / "ours.bvh")
    theirs = pymotion_read(clip)
    peers = {"pymotion": lambda: theirs.save(str(tmp_path / "pymotion.bvh"))}
    if "cmu" in str(clip):
        other = pybvh.read_bvh_file(clip)
        peers["pybvh"] = lambda: pybvh.write_bvh_file(other, tmp_path / "pybvh.bvh")
    race(
        f"write BVH {clip.name}",
        lambda: jm.save(motion, tmp_path / "ours.bvh"),
        peers,
        amount=megabytes(tmp_path / "ours.bvh"),
    )


@pytest.mark.parametrize("frames", [20_000, 150_000])
@pytest.mark.parametrize("clip", [DANCE], indirect=True)
def test_long_files(race, clip, frames, tmp_path):
    once = jm.load(clip)
    times = np.arange(frames) % len(once)
    motion = once.with_transforms(
        np.asarray(once.translations)[times], np.asarray(once.rotations)[times]
    )
    path = tmp_path / "long.bvh"
    jm.save(motion, path)
    many, size = {"rounds": 1 if frames > 50_000 else 5}, megabytes(path)
    race(f"write BVH {frames}x132", lambda: jm.save(motion, path), amount=size, **many)


@pytest.mark.parametrize("frames", [20_000, 150_000])
@pytest.mark.parametrize("clip", [DANCE], indirect=True)
def test_long_reads(race, clip, frames, tmp_path):
    once = jm.load(clip)
    times = np.arange(frames) % len(once)
    path = tmp_path / "long.bvh"
    jm.save(
        once.with_transforms(
            np.asarray(once.translations)[times], np.asarray(once.rotations)[times]
        ),
        path,
    )
    race(
        f"read BVH {frames}x132",
        lambda: jm.load(path),
        amount=megabytes(path),
        rounds=1 if frames > 50_000 else 5,
    )
