"""``jaxmotion contacts`` lists what the library finds, and writes what it cleans."""

import json
import re

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion._plain import some
from jaxmotion.cli._feet import _carried
from jaxmotion.metrics import foot_skate
from tests.helpers import assert_same_rotation


@pytest.fixture(scope="module")
def skating():
    walk = jm.samples.walk(48, fps=30.0).motion
    return jm.samples.slide_root(walk, jax.random.key(0), amount=0.1).motion


@pytest.fixture
def file(tmp_path, skating):
    path = tmp_path / "walk.npz"
    jm.save(skating, path)
    return path


def test_list(jaxmotion, file, take, skating):
    text = jaxmotion("contacts", file, take).stdout
    found = jm.contacts.detect(skating)
    first = jm.contacts.intervals(found)[0]
    assert "LeftFoot.heel" in text
    assert f"frames {first.first}-{first.last}" in text
    assert "no feet found" in text
    [facts] = json.loads(jaxmotion("contacts", file, "--json").stdout)
    assert facts["frames"] == 48
    assert facts["slide"] == pytest.approx(foot_skate(skating, found), rel=1e-6)
    assert [c["first"] for c in facts["contacts"]] == [
        one.first for one in jm.contacts.intervals(found)
    ]
    np.testing.assert_allclose(facts["contacts"][0]["target"], first.target, atol=1e-6)
    words = ("contacts", file, "--joint", "*hand", "--no-floor", "--method", "thresholds")
    assert "LeftHand" in jaxmotion(*words).stdout


@pytest.mark.parametrize("way", ["legs", "root", "spacetime"])
def test_restore(jaxmotion, file, tmp_path, skating, way):
    out = tmp_path / "clean.npz"
    told = jaxmotion("contacts", file, "-o", out, "--restore", way).stderr
    found = jm.contacts.detect(skating)
    before, after = (skate(motion, found) for motion in (skating, jm.load(out)))
    many = len(jm.contacts.intervals(found))
    assert f"feet slid at {before:.3g}, now {after:.3g} cm/s ({many} contacts kept)" in told
    listed = jaxmotion("contacts", file).stdout
    assert f"{file}: {many} contacts of {len(found.names)} points, which slide at " in listed
    assert len(re.findall(r"\d+-\d+", listed.partition("\n")[2])) == many
    assert foot_skate(jm.load(out), found) < 0.4 * foot_skate(skating, found)


def test_contacts_are_counted(jaxmotion, file):
    words = ("contacts", file, "--no-floor", "--method", "thresholds", "--joint")
    told = jaxmotion(*words, "LeftHand").stdout
    assert told.startswith(f"{file}: 0 contacts of 1 point\n")
    assert some(1, "contact") == "1 contact"


def test_restoring_what_has_no_feet_says_so(jaxmotion, take, tmp_path):
    result = jaxmotion("contacts", take, "-o", tmp_path / "a.bvh", "--restore", "legs", code=1)
    assert "no feet found; --joint names others" in result.stderr
    assert not (tmp_path / "a.bvh").exists()


def skate(motion, found):
    """As it is told: the clip is in metres."""
    return 100 * foot_skate(motion, found)


def test_style_keeps_contacts_where_feet_would_slide_more(jaxmotion, file, tmp_path, skating):
    plain, kept, report = tmp_path / "plain.npz", tmp_path / "kept.npz", tmp_path / "r.json"
    words = ("style", file, "--alpha", "2", "-o")
    told = jaxmotion(*words, plain, "--no-keep-contacts").stderr
    found = jm.contacts.detect(skating)
    before, slid = skate(skating, found), skate(jm.load(plain), found)
    assert slid > 2 * before
    assert f"feet slid at {before:.3g}, now {slid:.3g} cm/s\n" in told
    told = jaxmotion(*words, kept, "--report", report).stderr
    after, many = skate(jm.load(kept), found), len(jm.contacts.intervals(found))
    assert after < 0.1 * slid
    assert (
        f"slid at {before:.3g}, now {after:.3g} cm/s ({many} contacts kept; else {slid:.3g})"
        in told
    )
    [row] = json.loads(report.read_text())["files"]
    feet = row["feet"]
    assert feet["contacts_restored"] == many
    figures = [feet[f"slide_{when}"] for when in ("before", "edited", "after")]
    np.testing.assert_allclose(100 * np.array(figures), [before, slid, after], rtol=1e-6)
    assert row["unit"] == 1.0
    edited, result = jm.load(plain), jm.load(kept)
    moved = np.linalg.norm(result.root_positions - edited.root_positions, axis=-1).max()
    assert feet["root_move"] == pytest.approx(moved, rel=1e-6)
    root = np.linalg.norm(result.root_positions - skating.root_positions, axis=-1)
    assert row["changes"]["root"]["mean"] == pytest.approx(root.mean(), rel=1e-6)


def test_contacts_are_kept_inside_of_the_selection_only(jaxmotion, file, tmp_path, skating):
    plain, kept = tmp_path / "plain.npz", tmp_path / "kept.npz"
    words = ("style", file, "--alpha", "2", "--range", "12:36", "--strength", "0.8", "-o")
    jaxmotion(*words, plain, "--no-keep-contacts")
    assert "contacts kept" in jaxmotion(*words, kept).stderr
    before, without, after = (jm.load(path) for path in (file, plain, kept))
    outside = np.r_[0:12, 36:48]
    np.testing.assert_array_equal(after.rotations[outside], before.rotations[outside])
    np.testing.assert_array_equal(after.translations[outside], before.translations[outside])
    inner = jm.contacts.detect(skating).at_frames(np.arange(20.0, 28.0))
    assert foot_skate(after[20:28], inner) < 0.2 * foot_skate(without[20:28], inner)
    head = before.skeleton.index("Head")  # the edit itself sets in as it does without
    np.testing.assert_allclose(after.rotations[:, head], without.rotations[:, head], atol=1e-3)


def told_speeds(told):
    """Before, in the new timing, now."""
    found = re.search(r"feet slid at (\S+) \((\S+) in the new timing\), now (\S+) cm/s", told)
    assert found, told
    return [float(speed) for speed in found.groups()]


@pytest.mark.parametrize(("pair", "speed"), [("1.5=0.75", 2.0), ("1.5=3", 0.5)])
def test_retime_compares_in_the_new_timing(jaxmotion, file, tmp_path, skating, pair, speed):
    """Feet that slide twice as fast at twice the speed are none of the edit's doing."""
    own = skate(skating, jm.contacts.detect(skating))
    told = jaxmotion("retime", file, "-o", tmp_path / "out.npz", "--at", pair).stderr
    before, timed, now = told_speeds(told)
    assert before == pytest.approx(own, rel=5e-3)
    assert timed == pytest.approx(speed * own, rel=0.2)
    assert now == pytest.approx(timed, rel=0.15)
    assert "kept" not in told


@pytest.fixture
def sparse(tmp_path):
    """Eight frames a second: feet slide in what is read between them."""
    path = tmp_path / "sparse.npz"
    jm.save(jm.samples.walk(24, fps=8.0).motion, path)
    return path


def test_retime_keeps_contacts_where_feet_would_slide_more(jaxmotion, sparse, tmp_path):
    plain, kept = tmp_path / "plain.npz", tmp_path / "kept.npz"
    words = ("retime", sparse, "--to-fps", "24", "-o")
    told = jaxmotion(*words, plain, "--no-keep-contacts").stderr
    _, timed, slid = told_speeds(told)
    assert slid > timed + 4
    want = jm.resample(jm.load(sparse), fps=24)
    assert_same_rotation(jm.load(plain).rotations, want.rotations, 1e-12)
    told = jaxmotion(*words, kept).stderr
    assert told_speeds(told)[2] < 0.2 * slid
    assert re.search(rf"\(\d+ contacts kept; else {slid:.3g}\)", told)


def test_align_tells_of_feet_and_keeps_contacts(jaxmotion, file, skating, sparse, tmp_path):
    out = tmp_path / "out.npz"
    told = jaxmotion("align", file, file, "-o", out).stderr
    own = skate(skating, jm.contacts.detect(skating))
    assert told_speeds(told) == pytest.approx([own] * 3, rel=5e-3)
    told = jaxmotion("align", sparse, file, "-o", out, "--overwrite", "--keep-contacts").stderr
    assert re.search(r"\(\d+ contacts kept; else", told)


def test_what_touches_on_one_side_only_does_not_touch_between():
    skeleton = jm.Skeleton(["Hips", "Foot"], [-1, 0], np.zeros((2, 3)))
    mask = np.array([[0], [1], [1], [0]], bool)
    contacts = jm.contacts.Contacts(
        jm.contacts.ContactPoints(skeleton, ["Foot"]), mask, np.zeros((4, 1, 3))
    )
    at = jax.numpy.asarray([0.0, 0.6, 1.0, 1.4, 2.0, 2.4, 3.0, 1.0, 1.0])
    found = _carried(contacts, at, 8).mask[:, 0]
    np.testing.assert_array_equal(found, np.array([0, 0, 1, 1, 1, 0, 0, 1, 0], bool))


def test_feet_that_slide_no_more_are_left_alone(jaxmotion, file, take, tmp_path):
    for words in (("style", "--alpha", "1"), ("denoise", "--lam", "1", "--sigma", "1")):
        result = jaxmotion(*words, file, "-o", tmp_path / f"{words[0]}.npz")
        assert "feet slid at" in result.stderr
        assert "kept" not in result.stderr
    result = jaxmotion("style", take, "--alpha", "2", "-o", tmp_path / "b.npz", "--keep-contacts")
    assert "feet slid" not in result.stderr
    assert "warning: no feet found that touch: no contacts are kept" in result.stderr


def test_what_is_missing_is_asked_for(jaxmotion, file, tmp_path):
    assert "say how to write" in jaxmotion("contacts", file, "-o", tmp_path / "x", code=2).stderr
    assert "say where" in jaxmotion("contacts", file, "--restore", "legs", code=2).stderr
