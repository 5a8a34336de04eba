"""A corpus as a value: clips as they are loaded, parts of it, and what takes it for a list."""

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.corpus import Corpus, store
from tests.corpus.clips import assert_same_clip, clip, several
from tests.helpers import no_shape_checks


@pytest.fixture(scope="module")
def corpus():
    return Corpus(several())


def test_clips_are_those_that_were_given(dtype):
    clips = several(dtype=dtype)
    made = Corpus(clips)
    assert made.dtype == dtype
    assert made.names == tuple(clips)
    assert made.lengths.tolist() == [c.num_frames for c in clips.values()]
    assert made.fps == pytest.approx(30)
    for got, want in zip(made, clips.values(), strict=True):
        assert_same_clip(got, want)
        assert jax.tree.structure(got) == jax.tree.structure(want)
    assert_same_clip(made[-1], list(clips.values())[-1])
    with pytest.raises(IndexError, match="clip 5 of a corpus of 5"):
        made[5]


def test_real_clips_are_as_loaded_and_share_one_skeleton(data_dir):
    made = Corpus(sorted((data_dir / "bandai").glob("*.bvh"))[::4], dtype=np.float32)
    assert len(made) == 26
    for k in (0, 12, 25):
        path = data_dir / "bandai" / f"{made.names[k]}.bvh"
        want = jm.load(path, dtype=np.float32)
        np.testing.assert_array_equal(made[k].rotations, want.rotations)
        np.testing.assert_array_equal(made[k].translations[:, :2], want.translations[:, :2])
        size = float(np.abs(want.translations).max())
        np.testing.assert_allclose(made[k].translations, want.translations, 0, 1e-6 * size)
        assert made[k].frame_time_text == want.frame_time_text
        assert made[k].skeleton.channels == want.skeleton.channels
    walks = made.select("walk*", "RUN_*")
    assert 2 < len(walks) < 26
    assert len(walks.lengths) == len(walks)
    assert all(name.startswith(("walk", "run")) for name in walks.names)


def test_one_rate(dtype):
    clips = several(dtype=dtype)
    rounded = clips["take 0"].replace(frame_time=0.033333)
    mixed = {"a": rounded, "b": clip(50, 9, dtype, seconds=1 / 60), "c": clips["take 2"]}
    made = Corpus(mixed, fps=30)
    np.testing.assert_array_equal(made[0].rotations, rounded.rotations)
    want = jm.resample(mixed["b"], fps=30)
    assert made.lengths.tolist() == [40, want.num_frames, 64]
    np.testing.assert_array_equal(made[1].rotations, want.rotations)
    np.testing.assert_array_equal(made[1].translations, want.translations)
    assert {float(c.frame_time) for c in made} == {float(np.asarray(1 / 30, dtype))}
    assert {c.dtype for c in made} == {dtype}
    with pytest.raises(ValueError, match=r"at 60 frames a second, the corpus at 30.*; give fps="):
        Corpus(mixed)[1]


def test_one_dtype():
    mixed = [clip(4), clip(4, dtype=np.float32)]
    with pytest.raises(ValueError, match="it is float32, the corpus float64; give dtype="):
        Corpus(mixed)[1]
    made = Corpus(mixed, dtype=np.float32)
    assert [c.dtype for c in made] == [np.float32] * 2
    np.testing.assert_array_equal(made[0].rotations, mixed[0].rotations.astype(np.float32))


def test_one_skeleton():
    whole = clip(6)
    bones = whole.skeleton
    extra = jm.Skeleton(
        (*bones.names, "prop"), (*bones.parents, 0), np.vstack([bones.offsets, np.ones((1, 3))])
    )
    other = clip(8, 1, bones=extra)
    with pytest.raises(ValueError, match=r"'clip 1': joints that the corpus's .*'prop'; extra_j"):
        Corpus([whole, other])[1]
    made = Corpus([whole, other], extra_joints="drop")
    np.testing.assert_array_equal(made[1].rotations, other.rotations[:, :-1])
    np.testing.assert_array_equal(made[1].skeleton.offsets, extra.offsets[:-1])
    assert made[1].skeleton.names == bones.names
    assert Corpus([other, whole], skeleton=whole, extra_joints="drop").names == ("clip 0", "clip 1")
    two = Corpus([whole], joints=[bones.names[0], bones.names[1]])
    assert two.skeleton.names == two[0].skeleton.names == bones.names[:2]
    message = "extra_joints='keep'; expected 'refuse' or 'drop'"
    with no_shape_checks(), pytest.raises(ValueError, match=message):
        Corpus([whole], extra_joints="keep")


def test_what_is_no_sound_clip_is_told():
    broken = clip(6)
    q = broken.rotations.copy()
    q[3, 1] = np.nan
    with pytest.raises(ValueError, match="'clip 1': rotations of 'joint1' at frame 3 are not fin"):
        Corpus([broken, broken.with_transforms(rotations=q)])[1]


# Parts


def test_subsets(corpus):
    assert corpus.subset([3, 0]).names == ("take 3", "take 0")
    assert corpus.subset(np.arange(5) > 2).names == ("take 3", "take 4")
    assert corpus[1:3].names == corpus.subset([1, 2]).names == ("take 1", "take 2")
    assert corpus[1:3][-1:].names == ("take 2",)
    assert_same_clip(corpus.subset([3, 0])[1], corpus[0])
    assert corpus.subset([3, 0]).lengths.tolist() == [5, 40]
    assert corpus.subset([3, 0]) != corpus.subset([0, 3])
    assert corpus.subset([-1]) == corpus[4:]
    for wrong in ([], [5], [0.5], [[1]], "take 1"):
        with pytest.raises(ValueError, match="subset: indices="):
            corpus.subset(wrong)


def test_parts_by_shard(monkeypatch):
    monkeypatch.setattr(store, "_MOST", 2)
    made = Corpus(several())
    assert [part.names for part in made.shards()] == [
        ("take 0", "take 1"),
        ("take 2", "take 3"),
        ("take 4",),
    ]
    assert [len(part) for part in made.subset([4, 1, 0]).shards()] == [1, 2]
    assert made.subset([4, 1, 0]).shards()[1].names == ("take 1", "take 0")


def test_selections(corpus):
    assert corpus.select("*3", "TAKE 1").names == ("take 1", "take 3")
    with pytest.raises(ValueError, match="no clip matches 'walk'; 'take 0', 'take 1'"):
        corpus.select("walk")


def test_splits_are_by_clip_and_seeded(corpus):
    parts = corpus.split([0.6, 0.2, 0.2], seed=4)
    assert [len(part) for part in parts] == [3, 1, 1]
    assert sorted(name for part in parts for name in part.names) == sorted(corpus.names)
    assert all(list(part.names) == sorted(part.names) for part in parts)
    assert corpus.split([0.6, 0.2, 0.2], seed=4) == parts
    seeds = {corpus.split([0.6, 0.4], seed=s)[0].names for s in range(20)}
    assert len(seeds) > 5
    by_key = corpus.split([0.6, 0.4], seed=jax.random.key(3))
    assert by_key == corpus.split([0.6, 0.4], seed=jax.random.key(3))
    for wrong in ([], [0.5], [0.5, 0.6], [1.5, -0.5]):
        with pytest.raises(ValueError, match="split: fractions="):
            corpus.split(wrong)
    with pytest.raises(ValueError, match=r"split: part 1, 0\.01 of 5 clips, is empty"):
        corpus.split([0.99, 0.01])
    for seed in (-1, 1.5, True):
        with no_shape_checks(), pytest.raises(ValueError, match="split: seed"):
            corpus.split([0.5, 0.5], seed=seed)


# As a list of motions


def test_a_corpus_is_a_list_of_motions(corpus):
    clips = list(several().values())
    ours, theirs = map(jm.smoothing.motion_prior, (corpus, clips))
    np.testing.assert_array_equal(ours.covariance, theirs.covariance)
    ours, theirs = map(jm.spacetime.learn_limits, (corpus, clips))
    np.testing.assert_array_equal(ours.lower, theirs.lower)
    batch, lengths = jm.stack(corpus)
    assert batch.rotations.shape == (5, 64, 5, 4)
    assert lengths.tolist() == corpus.lengths.tolist()
    found = jm.cleaning.most_alike(corpus[0], corpus[1:], 3)
    assert found == jm.cleaning.most_alike(clips[0], clips[1:], 3)


def test_clips_go_through_the_library(corpus):
    ours, theirs = (jm.resample(c, num_frames=90) for c in (corpus[0], several()["take 0"]))
    np.testing.assert_array_equal(ours.rotations, theirs.rotations)


def test_what_it_says_of_itself(corpus):
    assert repr(corpus) == "Corpus(5 clips, 30 fps, 5 joints from joint0, y up, float64)"
    assert np.asarray(corpus).shape == ()  # and not an array of all frames


def test_progress_is_told():
    told = []
    Corpus(several()).build(lambda done, of: told.append((done, of)))
    assert told == [(5, 5)]
