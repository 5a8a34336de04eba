"""Which clips are most like one."""

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cleaning import joint_groups, most_alike, nearest_words, sequence_distance
from jaxmotion.cleaning.similarity import _distance, light
from jaxmotion.cleaning.words import texture
from tests.cleaning.clips import frame_distance, repeating


def by_loops(motion, clips):
    """All mean distances, pair by pair of frames."""
    joints = joint_groups(motion)["whole"]
    own, *others = (np.asarray(texture(clip, joints)) for clip in (motion, *clips))
    trim = len(joints) // 8
    return [
        np.mean([min(frame_distance(x, y, trim) for y in other) for x in own]) for other in others
    ]


def test_the_order_is_that_of_mean_distances():
    motion, *clips = (repeating(seed, frames=30) for seed in range(5))
    far = by_loops(motion, clips)
    assert most_alike(motion, clips) == tuple(np.argsort(far))
    assert most_alike(motion, clips, 2) == tuple(np.argsort(far)[:2])
    assert most_alike(motion, []) == ()


def test_walks_are_like_walks_whichever_way_they_go_and_at_any_rate():
    walk = jm.samples.load("walk", fps=30.0, num_frames=90).motion
    turn = jm.quaternion.exp(np.array([0.0, 2.0, 0.0]))
    rotations = np.array(walk.rotations)
    rotations[:, 0] = jm.quaternion.multiply(turn, rotations[:, 0])
    elsewhere = walk.with_transforms(np.asarray(walk.translations) + 50, rotations)
    fast = jm.resample(walk[20:], fps=120.0)
    idle, run = (jm.samples.load(x, fps=30.0, num_frames=90).motion for x in ("idle", "run"))
    found = most_alike(walk, [idle, fast, run, elsewhere])
    assert set(found[:2]) == {1, 3}


def test_tiles_change_nothing(monkeypatch):
    rng = np.random.default_rng(0)
    x, y = (rng.standard_normal((n, 9, 4)).astype(np.float32) for n in (70, 90))
    x, y = (q / np.linalg.norm(q, axis=-1, keepdims=True) for q in (x, y))
    whole = _distance(x, y)
    monkeypatch.setattr("jaxmotion.cleaning.similarity.LONGEST", 32)
    assert _distance(x, y) == pytest.approx(whole, rel=1e-6)
    assert whole == pytest.approx(
        np.mean([min(frame_distance(a, b, 1) for b in y) for a in x]), rel=1e-5
    )


def test_frames_are_thinned():
    walk = jm.samples.load("walk", fps=120.0, num_frames=50).motion
    few = light(walk)
    assert (few.num_frames, few.dtype) == (10, np.float32)
    assert float(few.fps) == pytest.approx(24)
    np.testing.assert_allclose(few.rotations, np.asarray(walk.rotations)[::5], atol=1e-6)


def test_what_is_missing_or_still():
    walk = jm.samples.load("walk", fps=24.0, num_frames=60).motion
    rotations = np.array(walk.rotations)
    rotations[10:13, 4] = np.nan
    gone = walk.with_transforms(rotations=rotations)
    run = jm.samples.load("run", fps=24.0, num_frames=60).motion
    assert most_alike(gone, [run, walk], 1) == (1,)
    assert most_alike(walk, [run, gone], 1) == (1,)
    still = walk.with_transforms(rotations=np.broadcast_to(rotations[:1], rotations.shape).copy())
    assert most_alike(still, [run, walk], 1) == (0,)


def test_what_is_refused():
    walk = jm.samples.load("walk", num_frames=20).motion
    dog = jm.samples.load("quadruped_walk", num_frames=20).motion
    with pytest.raises(ValueError, match="other joints"):
        most_alike(walk, [dog])
    with pytest.raises(ValueError, match="many=0"):
        most_alike(walk, [walk], 0)
    with pytest.raises(ValueError, match="traced"):
        jax.eval_shape(lambda q: most_alike(walk.with_transforms(rotations=q), []), walk.rotations)


def test_sequences():
    """The mean of the nearest words' distances; nothing to a copy, and not the same both ways."""
    one, other = repeating(0, 60), repeating(1, 70)
    far = sequence_distance(one, other)
    words = nearest_words(one, other, k=1, own=False).distance
    assert far == pytest.approx(float(words.mean()))
    assert sequence_distance(one[:40], one) < 1e-12 < far
    assert sequence_distance(other, one) != pytest.approx(far)
    assert sequence_distance(one[:10], other) == np.inf
    assert sequence_distance(one, other[:10]) == np.inf
