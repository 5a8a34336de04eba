"""``augment`` writes sound variations, as many as are asked for."""

import json
import zlib

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.style import motion_style
from tests.cli.conftest import swinging
from tests.helpers import assert_same_rotation


def poses(path):
    return jm.load(path).rotations


def test_they_are_the_library_s(jaxmotion, take, tmp_path):
    out = tmp_path / "out"
    words = "--count", 3, "--seed", 4, "--alpha", 0.5, 1.5, "--time-warp", 0.2
    result = jaxmotion("augment", take, "-o", out, *words, "--report", tmp_path / "r.json")
    assert sorted(path.name for path in out.iterdir()) == ["01.bvh", "02.bvh", "03.bvh"]
    assert "3 variations" in result.stderr
    key = jax.random.fold_in(jax.random.key(4), zlib.crc32(b"take.bvh"))
    made = jm.augment(
        jm.load(take), jax.random.fold_in(key, 0), n=3, alpha=(0.5, 1.5), time_warp=0.2
    )
    for number, clip in enumerate(made.sound(), 1):
        assert_same_rotation(poses(out / f"0{number}.bvh"), clip.rotations, 1e-3)
    [row] = json.loads((tmp_path / "r.json").read_text())["files"]
    rows = row["learned"]["variations"]
    np.testing.assert_allclose([row["gain"] for row in rows[:3]], made.alpha, rtol=1e-6)
    assert [not row["refused"] for row in rows[:3]] == made.accepted.tolist()
    assert [row["file"] for row in rows if row["file"]] == ["01.bvh", "02.bvh", "03.bvh"]


def test_seeds_and_names(jaxmotion, take, tmp_path):
    """The same again, another for another seed, and another for another file."""
    twin = tmp_path / "twin.bvh"
    twin.write_bytes(take.read_bytes())
    words = "augment", "--count", 1, "--no-keep-contacts"
    jaxmotion(*words, take, "-o", tmp_path / "a")
    jaxmotion(*words, take, "-o", tmp_path / "b")
    jaxmotion(*words, take, "-o", tmp_path / "c", "--seed", 1)
    jaxmotion(*words, take, twin, "-o", tmp_path / "d")
    made = {name: poses(tmp_path / name / "01.bvh") for name in "abc"}
    made |= {name: poses(tmp_path / "d" / name / "01.bvh") for name in (take.stem, "twin")}
    np.testing.assert_array_equal(made["a"], made["b"])
    np.testing.assert_array_equal(made["a"], made[take.stem])
    for other in ("c", "twin"):
        assert np.abs(np.abs(made["a"]) - np.abs(made[other])).max() > 1e-3


def test_styles_and_limits(jaxmotion, take, tmp_path):
    """What turns further than other clips is left out and made anew; where too little is left, it
    is said why, and nothing written."""
    wide = swinging()
    wide = wide.with_transforms(rotations=jm.quaternion.power(wide.rotations, 1.4))
    jm.save(wide, tmp_path / "wide.bvh")
    motion_style(jm.load(tmp_path / "wide.bvh")).save(tmp_path / "wide.npz")
    words = "augment", take, "--count", 4, "--no-keep-contacts", "--time-warp", 0
    styles = "--style", tmp_path / "wide.bvh", "--style", tmp_path / "wide.npz"
    limits = "--limits", take, "--margin"
    out = tmp_path / "some"
    result = jaxmotion(*words, "-o", out, *styles, *limits, 10, "--alpha", 0.7, 1.2)
    assert "joint limits" in result.stderr
    learned = jm.spacetime.learn_limits(jm.load(take), margin=np.radians(10.01))
    for path in out.iterdir():
        assert np.abs(learned.excess(poses(path))).max() == 0
    out = tmp_path / "none"
    told = jaxmotion(*words, "-o", out, *limits, 0, "--alpha", 3, 4, code=1).stderr
    assert "only 0 of 16 variations are sound" in told
    assert "joint limits" in told
    assert not out.exists()


def test_nothing_varied_is_the_take(jaxmotion, take, tmp_path):
    words = "--alpha", 1, 1, "--time-warp", 0, "--count", 1
    jaxmotion("augment", take, "-o", tmp_path / "out", *words)
    assert_same_rotation(poses(tmp_path / "out" / "01.bvh"), poses(take), 1e-3)


def test_resumes(jaxmotion, take, tmp_path):
    words = "augment", take, "-o", tmp_path / "out", "--count", 2, "--no-keep-contacts"
    jaxmotion(*words)
    before = (tmp_path / "out" / "02.bvh").stat().st_mtime_ns
    assert "skipped" in jaxmotion(*words, "--resume").stderr.lower()
    assert (tmp_path / "out" / "02.bvh").stat().st_mtime_ns == before
    jaxmotion(*words, code=1)


@pytest.mark.parametrize("words", [("--alpha", 2, 1), ("--count", 0), ("-o", "one.bvh")])
def test_what_is_wrong_is_said(jaxmotion, take, tmp_path, words):
    jaxmotion("augment", take, "-o", tmp_path / "out", *words, code=2)
