"""What files do not say: assumed, told or guessed by the reader; kept or turned by the writer."""

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.io import MotionFileWarning
from jaxmotion.io.formats import SUFFIXES
from tests.helpers import assert_same_rotation, no_shape_checks, world_by_matrices


@pytest.fixture(scope="module")
def walk():
    """Two steps, z up and known to be."""
    return jm.reorient(jm.samples.walk(40, fps=30.0).motion, "z")


def saved(motion, path, **options):
    jm.save(motion, path, **options)
    return path


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_reader_takes_a_rate_and_an_axis(walk, tmp_path, suffix):
    path = saved(walk, tmp_path / f"a{suffix}", up="y")
    motion = jm.load(path, fps=25, up="x")
    assert motion.frame_time == 0.04
    assert motion.frame_time_text is None
    assert motion.skeleton.up == "x"
    assert motion.skeleton.conventions.up == motion.skeleton.conventions.frame_time == "told"
    plain = jm.load(path)
    np.testing.assert_array_equal(motion.rotations, plain.rotations)
    np.testing.assert_array_equal(motion.translations, plain.translations)
    for wrong in ({"fps": 0}, {"fps": -1.0}, {"fps": np.nan}, {"fps": np.inf}, {"fps": 1e-320}):
        with pytest.raises(ValueError, match=r"load_.*fps="):
            jm.load(path, **wrong)
    with (
        no_shape_checks(),
        pytest.raises(ValueError, match=r"load_.*expected 'x', 'y', 'z' or 'auto'"),
    ):
        jm.load(path, up="Z")  # type: ignore[arg-type]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_guess_is_made_and_told(walk, tmp_path, suffix):
    path = saved(walk, tmp_path / f"a{suffix}", up="keep")
    with pytest.warns(MotionFileWarning, match="z points up, by a guess: it stands along z"):
        motion = jm.load(path, up="auto")
    assert (motion.skeleton.up, motion.skeleton.conventions.up) == ("z", "guessed")
    path = saved(walk[:1], tmp_path / f"b{suffix}", up="keep")
    with pytest.warns(MotionFileWarning, match="cannot tell the up axis .* is taken"):
        motion = jm.load(path, up="auto")
    assert motion.skeleton.up == ("z" if suffix == ".npz" else "y")


def test_what_is_assumed_is_kept_by_our_own_format(walk, tmp_path):
    path = saved(walk, tmp_path / "a.bvh")
    for options, how in (({}, "assumed"), ({"up": "y"}, "told")):
        motion = jm.load(path, **options)
        assert motion.skeleton.conventions.up == how
        again = jm.load(saved(motion, tmp_path / "a.npz"))
        assert again.skeleton.conventions.up == how
    amc = saved(walk, tmp_path / "a.amc")
    assert jm.load(amc).skeleton.conventions.frame_time == "told"
    text = amc.read_text()
    amc.write_text(text.replace(":SAMPLES-PER-SECOND", "# "))
    motion = jm.load(amc)
    assert (motion.frame_time, motion.skeleton.conventions.frame_time) == (1 / 120, "assumed")


@pytest.mark.parametrize("suffix", [".bvh", ".amc"])
def test_formats_without_an_axis_get_y_up_and_it_is_told(walk, tmp_path, suffix):
    with pytest.warns(MotionFileWarning, match="turned from z up to y up"):
        path = saved(walk, tmp_path / f"a{suffix}")
    motion = jm.load(path)
    assert motion.skeleton.up == "y"
    want = world_by_matrices(walk)[0][..., [0, 2, 1]] * [1, 1, -1]
    np.testing.assert_allclose(world_by_matrices(motion)[0], want, atol=1e-12)
    back = jm.reorient(motion, "z")
    np.testing.assert_array_equal(back.root_positions, walk.root_positions)
    assert_same_rotation(back.rotations, walk.rotations, 1e-12)


@pytest.mark.parametrize("suffix", [".bvh", ".amc"])
def test_or_keep_theirs_and_it_is_told(walk, tmp_path, suffix):
    with pytest.warns(MotionFileWarning, match="z points up, which the file cannot say"):
        path = saved(walk, tmp_path / f"a{suffix}", up="keep")
    motion = jm.load(path, up="z")
    np.testing.assert_array_equal(motion.root_positions, walk.root_positions)
    with no_shape_checks(), pytest.raises(ValueError, match=r"save_.*'z' or 'keep'"):
        jm.save(walk, path, up="up")  # type: ignore[arg-type]


@pytest.mark.filterwarnings("error")
def test_nothing_is_said_of_what_needs_nothing(walk, tmp_path):
    y_up = jm.reorient(walk, "y")
    for suffix in SUFFIXES:
        jm.load(saved(y_up, tmp_path / f"a{suffix}"))
    kept = jm.load(saved(walk, tmp_path / "b.npz"))
    assert kept.skeleton.up == "z"
    assert jm.load(saved(walk, tmp_path / "c.npz", up="x")).skeleton.up == "x"


def test_a_file_comes_back_from_there_and_back(walk, tmp_path):
    """Y up to Z up and back again: the same motion, and the same text of all but the root, whose
    angles pass through a gimbal lock on the way."""
    path = saved(jm.reorient(walk, "y"), tmp_path / "a.bvh")
    there = saved(jm.reorient(jm.load(path), "z"), tmp_path / "b.bvh", up="keep")
    back = saved(jm.load(there, up="z"), tmp_path / "c.bvh", up="y")
    assert back.read_text().split("MOTION")[0] == path.read_text().split("MOTION")[0]
    before, after = (
        [line.split() for line in p.read_text().splitlines()[-walk.num_frames :]]
        for p in (path, back)
    )
    assert [row[6:] for row in after] == [row[6:] for row in before]
    assert_same_rotation(jm.load(back).rotations, jm.load(path).rotations, 1e-12)
    np.testing.assert_array_equal(jm.load(back).translations, jm.load(path).translations)
