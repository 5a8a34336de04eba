"""Statistics of a corpus against NumPy and SciPy over all of its frames at once."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.corpus import Corpus, statistics
from tests.corpus.clips import several
from tests.helpers import no_shape_checks


def oracle(clips):
    q = np.concatenate([np.asarray(c.rotations, np.float64) for c in clips])
    t = np.concatenate([np.asarray(c.translations, np.float64) for c in clips])
    found = {"rotation_mean": [], "rotation_covariance": [], "angular_speed": []}
    v = []
    for j in range(q.shape[1]):
        turns = Rotation.from_quat(q[:, j], scalar_first=True)
        mean = turns.mean()  # the chordal one
        about = (mean.inv() * turns).as_rotvec()
        found["rotation_mean"].append(mean.as_quat(scalar_first=True))
        found["rotation_covariance"].append(about.T @ about / len(about))
        v.append(about)
        steps = []
        for c in clips:
            one = Rotation.from_quat(np.asarray(c.rotations[:, j]), scalar_first=True)
            steps += [*(one[:-1].inv() * one[1:]).magnitude()]
        found["angular_speed"].append(np.sqrt(np.mean(np.square(steps))) * 30)
    v = np.stack(v, axis=1)
    found |= {"rotation_lower": v.min(axis=0), "rotation_upper": v.max(axis=0)}
    found |= {"translation_mean": t.mean(axis=0), "translation_deviation": t.std(axis=0)}
    found |= {"translation_lower": t.min(axis=0), "translation_upper": t.max(axis=0)}
    return {name: np.asarray(x) for name, x in found.items()}, v


def assert_agrees(got, clips, tolerance):
    for name, want in oracle(clips)[0].items():
        x = np.asarray(getattr(got, name), np.float64)
        if name == "rotation_mean":
            x = x * np.sign(np.sum(x * want, axis=-1, keepdims=True))
        np.testing.assert_allclose(x, want, tolerance, tolerance, err_msg=name)


@pytest.mark.parametrize("chunk", [1, 7, 4096])
def test_they_are_those_of_all_frames(dtype, chunk, monkeypatch):
    monkeypatch.setattr(statistics, "_CHUNK", chunk)
    clips = list(several(dtype=dtype).values())
    got = Corpus(clips).statistics()
    assert_agrees(got, clips, 1e-5 if dtype == np.float32 else 1e-10)
    assert {np.asarray(x).dtype for x in (got.rotation_mean, got.translation_upper)} == {dtype}
    assert (got.clips, got.frames) == (5, sum(c.num_frames for c in clips))
    assert np.asarray(got.lengths).tolist() == [c.num_frames for c in clips]
    assert got.seconds == pytest.approx(got.frames / 30)
    assert (np.asarray(got.turn_counts).sum(axis=-1) == got.frames).all()
    deviation = np.sqrt(np.trace(oracle(clips)[0]["rotation_covariance"], axis1=1, axis2=2))
    np.testing.assert_allclose(got.rotation_deviation, deviation, 1e-4)


def test_of_parts(dtype):
    clips = list(several(dtype=dtype).values())
    got = Corpus(clips).subset([3, 1]).statistics()
    assert_agrees(got, [clips[3], clips[1]], 1e-4 if dtype == np.float32 else 1e-10)


def test_far_from_the_origin_digits_are_kept():
    clips = list(several((30, 40)).values())
    far = [c.with_transforms(translations=c.translations + 1e7) for c in clips]
    got = Corpus(far).statistics().translation_deviation
    want = np.concatenate([c.translations for c in clips]).std(axis=0)
    np.testing.assert_allclose(got, want, 1e-6, 1e-7)


def test_limits_are_those_that_are_learned_of_all():
    clips = list(several().values())
    got = Corpus(clips).statistics()
    for coverage, tolerance in ((1.0, 1e-9), (0.9, 0.05)):
        ours = got.limits(margin=0.1, coverage=coverage)
        theirs = jm.spacetime.learn_limits(clips, margin=0.1, coverage=coverage)
        assert np.isinf(np.asarray(ours.lower)[0]).all()
        np.testing.assert_allclose(ours.lower[1:], theirs.lower[1:], 0, tolerance)
        np.testing.assert_allclose(ours.upper[1:], theirs.upper[1:], 0, tolerance)
    v = oracle(clips)[1]
    box = got.limits(margin=0.0, coverage=0.9)
    inside = (v >= np.asarray(box.lower)) & (v <= np.asarray(box.upper))
    share = inside[:, 1:].mean(axis=0)
    assert share.min() >= 0.9 - 1e-9
    assert share.max() < 1
    for wrong in (0.0, 1.5, np.nan):
        with no_shape_checks(), pytest.raises(ValueError, match=r"coverage=.*share in"):
            got.limits(coverage=wrong)


def test_the_manner_is_that_of_all(dtype):
    takes = {n: jm.samples.load(n, num_frames=50, dtype=dtype).motion for n in ("walk", "run")}
    takes["short"] = takes["walk"][5:25]
    got = Corpus(takes).style()
    want = jm.style.motion_style(list(takes.values()), mean="chordal")
    assert got.joints == want.joints
    loose = 2e-3 if dtype == np.float32 else 1e-9
    turn = jm.quaternion.distance(got.mean, want.mean)
    assert float(turn.max()) < loose
    for name in ("covariance", "root_mean", "root_deviation", "root_upright", "tempo"):
        x, y = (np.asarray(getattr(s, name)) for s in (got, want))
        assert x.dtype == dtype
        np.testing.assert_allclose(x, y, loose, loose, err_msg=name)


def test_real_clips(data_dir):
    corpus = Corpus(sorted((data_dir / "bandai").glob("bow*")), dtype=np.float32)
    assert_agrees(corpus.statistics(), list(corpus), 2e-3)


def test_nothing_grows_with_the_corpus(monkeypatch):
    """No more than a piece of a clip is in memory at a time."""
    largest = []
    add = statistics._Sums.add

    def seen(self, q, t, with_last):
        largest.append(len(with_last))
        return add(self, q, t, with_last)

    monkeypatch.setattr(statistics._Sums, "add", seen)
    monkeypatch.setattr(statistics, "_CHUNK", 10)
    Corpus(several((95, 4))).statistics()
    assert max(largest) == 11
    assert len(largest) == 11
