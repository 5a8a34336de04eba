"""Damaged ASF, AMC and .npz files: a MotionFileError, or a sound motion; nothing else comes out."""

import warnings

import numpy as np
import pytest

from jaxmotion.io import MotionFileError
from jaxmotion.io.amass import is_amass, load_amass
from jaxmotion.io.asfamc import load_amc
from jaxmotion.io.npz import load_npz, save_npz
from tests.helpers import random_motion

ASF = b""":version 1.10
:units
  length 0.45
  angle deg
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
     id 1
     name hip
     direction 0.6 0.8 0
     length 2.4
     axis 0 0 20 XYZ
    dof rx ry rz
    limits (-160.0 20.0)
           (-70.0 70.0)
           (-60.0 70.0)
  end
  begin
     id 2
     name knee
     direction 0.3 -0.9 0
     length 7
     axis 0 7.62852e-016 20 XYZ
    dof rx
    limits (-10.0 170.0)
  end
:hierarchy
  begin
    root hip
    hip knee
  end
"""
AMC = b"""#!OML:ASF x.ASF
:FULLY-SPECIFIED
:DEGREES
1
root 9.3 17.8 -17.3 -2.0 -7.5 -3.2
hip 2.3 -0.3 1.1
knee 0.003
2
root 9.4 17.9 -17.2 -2.1 -7.4 -3.1
hip 2.4 -0.2 1.2
knee 4e-015
"""
SHREDS = [
    *b"nan inf -1e999 1e308 begin end root hip knee dof limits axis name length ( - .".split(),
    *(b"1_0", b"\xd9\xa1", b"tx ty tz", b"rx rx", b":hierarchy\nknee hip\n", b":RADIANS\n"),
    *(b":SAMPLES-PER-SECOND 1e-320\n", b"hip hip\n", b"\x85", b"\xe2\x80\xa8", b"__link", b":"),
    *(b"9" * 5000, b"1" * 30, b"\x00", b"\xff\xfe", b"\n", b"\r", b" ", b"#"),
]


def damaged(data: bytes, rng) -> bytes:
    """One to three cuts, swaps, repeats, flips or insertions."""
    for _ in range(rng.integers(1, 4)):
        a, b = sorted(rng.integers(0, len(data) + 1, 2))
        kind = rng.integers(0, 7)
        if kind == 0:
            data = data[:a]
        elif kind == 1:
            data = data[:a] + data[b:]
        elif kind == 2:
            data = data[:b] + data[a:]
        elif kind == 3:
            data = data[:a] + rng.bytes(int(rng.integers(1, 20))) + data[a:]
        elif kind == 4 and a < len(data):
            data = data[:a] + bytes([data[a] ^ (1 << rng.integers(0, 8))]) + data[a + 1 :]
        elif kind == 5:
            lines = data.split(b"\n")
            rng.shuffle(lines)
            data = b"\n".join(lines)
        else:
            data = data[:a] + SHREDS[rng.integers(0, len(SHREDS))] + data[a:]
    return data


def outcome(load, *args, **kwargs) -> str:
    """What became of a file; anything but a motion or MotionFileError propagates."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            motion = load(*args, **kwargs)
        except MotionFileError as error:
            message = str(error)
        else:
            message = ""
    if message:
        assert "\n" not in message
        assert len(message) < 1000
        return "refused"
    rotations = np.asarray(motion.rotations, np.float64)
    assert np.isfinite(rotations).all()
    assert np.isfinite(motion.translations).all()
    assert np.isfinite(motion.frame_time)
    np.testing.assert_allclose(np.linalg.norm(rotations, axis=-1), 1, atol=1e-5)
    return "read"


@pytest.mark.parametrize("seed", range(2))
def test_damaged_text(tmp_path, seed, dtype):
    rng = np.random.default_rng(seed)
    asf, amc = tmp_path / "a.asf", tmp_path / "a.amc"
    seen = {"refused": 0, "read": 0}
    for case in range(120):
        asf.write_bytes(damaged(ASF, rng) if case % 2 else ASF)
        amc.write_bytes(AMC if case % 2 else damaged(AMC, rng))
        seen[outcome(load_amc, amc, dtype=dtype)] += 1
    assert min(seen.values()) > 5, seen


def test_truncations(tmp_path):
    asf, amc = tmp_path / "a.asf", tmp_path / "a.amc"
    asf.write_bytes(ASF)
    for end in range(0, len(AMC), 2):
        amc.write_bytes(AMC[:end])
        outcome(load_amc, amc)
    amc.write_bytes(AMC)
    for end in range(0, len(ASF), 7):
        asf.write_bytes(ASF[:end])
        outcome(load_amc, amc)


@pytest.mark.parametrize(
    "data",
    [b"", b"\x00" * 1000, bytes(range(256)) * 20, b"1\n" * 1000, b"\n" * 1000, b"1", b"#", b":"],
    ids=["empty", "zeros", "bytes", "ones", "blank", "one", "hash", "colon"],
)
def test_not_the_format_at_all(tmp_path, data):
    asf, amc = tmp_path / "a.asf", tmp_path / "a.amc"
    for path in (asf, amc):
        asf.write_bytes(ASF)
        amc.write_bytes(AMC)
        path.write_bytes(data)
        if not (path == amc and data[:1] == b"1"):  # frames without bones are bones at rest
            assert outcome(load_amc, amc) == "refused"


def test_many_bones_are_no_trouble(tmp_path):
    count = 3000
    bones = b"".join(
        b"begin\nname b%d\ndirection 1 0 0\nlength 1\ndof rx\nend\n" % i for i in range(count)
    )
    tree = b"root b0\n" + b"".join(b"b%d b%d\n" % (i, i + 1) for i in range(count - 1))
    (tmp_path / "a.asf").write_bytes(b":bonedata\n" + bones + b":hierarchy\n" + tree)
    (tmp_path / "a.amc").write_bytes(b":DEGREES\n1\nroot 0 0 0 0 0 0\n")
    assert load_amc(tmp_path / "a.amc").num_joints == count + 1


@pytest.mark.parametrize("kind", ["ours", "amass"])
def test_damaged_archives(tmp_path, kind, dtype):
    rng = np.random.default_rng(7)
    path = tmp_path / "a.npz"
    if kind == "ours":
        save_npz(random_motion(rng, 3, 3), path, compress=False)
    else:
        poses, trans = rng.normal(size=(3, 66)), rng.normal(size=(3, 3))
        np.savez(path, poses=poses, trans=trans, mocap_framerate=np.array(60.0))
    whole = path.read_bytes()

    def either(path, dtype):
        return (load_amass if is_amass(path) else load_npz)(path, dtype=dtype)

    seen = {"refused": 0, "read": 0}
    for _ in range(150):
        path.write_bytes(damaged(whole, rng))
        seen[outcome(either, path, dtype=dtype)] += 1
    assert seen["refused"] > 50, seen
