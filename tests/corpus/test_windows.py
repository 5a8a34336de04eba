"""Batches for training: slices of the clips, each once an epoch, the same for the same seed."""

import pickle
import threading
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.corpus import Batches, Corpus, prefetch
from jaxmotion.frames.padding import bucket_size
from tests.corpus.clips import several


@pytest.fixture(scope="module")
def corpus():
    return Corpus(several())


def ids(batches, source):
    """The windows of each batch by number: their first frames are all different."""
    first = {source[i].rotations[0].tobytes(): i for i in range(len(source))}
    assert len(first) == len(source)
    return [[first[w.tobytes()] for w in batch.rotations[:, 0]] for batch in batches]


def flat(lists):
    return [x for part in lists for x in part]


def threads():
    return [t for t in threading.enumerate() if t.name.startswith("jaxmotion-corpus")]


@pytest.mark.parametrize(("length", "stride"), [(8, None), (8, 3), (17, 1), (1, 1), (64, 5)])
def test_windows_are_slices_of_the_clips(dtype, length, stride):
    clips = list(several(dtype=dtype).values())
    source = Corpus(clips).window_source(length, stride)
    step = length if stride is None else stride
    wanted = [
        (k, first)
        for k, clip in enumerate(clips)
        for first in range(0, clip.num_frames - length + 1, step)
    ]
    assert len(source) == len(wanted)
    assert [source.place(i) for i in range(len(source))] == wanted
    batch = source.gather(range(len(source)))
    for i, (k, first) in enumerate(wanted):
        want = clips[k][first : first + length]
        for got in (source[i], jax.tree.map(lambda x, i=i: x[i], batch)):
            assert got.dtype == dtype
            assert isinstance(got.rotations, np.ndarray)
            assert jax.tree.structure(got) == jax.tree.structure(want)
            for x, y in zip(jax.tree.leaves(got), jax.tree.leaves(want), strict=True):
                np.testing.assert_array_equal(x, y)
    assert source[-1].rotations.tobytes() == source[len(source) - 1].rotations.tobytes()
    with pytest.raises(IndexError, match=r"window \d+ of \d+"):
        source[len(source)]


@pytest.mark.parametrize("prefetch", [0, 1, 3])
def test_every_window_comes_once_an_epoch(corpus, prefetch):
    batches = corpus.windows(4, 7, seed=1, epochs=3, prefetch=prefetch)
    found = ids(batches, batches.source)
    count = len(batches.source)
    each = -(-count // 7)
    assert len(found) == len(batches) == 3 * each
    epochs = [flat(found[e * each : (e + 1) * each]) for e in range(3)]
    assert all(sorted(epoch) == list(range(count)) for epoch in epochs)
    assert len({tuple(epoch) for epoch in epochs}) == 3
    assert tuple(range(count)) not in map(tuple, epochs)


def test_the_order_is_the_seeds(corpus):
    def order(seed, **more):
        batches = corpus.windows(4, 7, seed=seed, **more)
        return ids(batches, batches.source)

    assert order(1) == order(1) == order(1, prefetch=0)
    again = corpus.windows(4, 7, seed=1)
    assert ids(again, again.source) == ids(again, again.source)
    assert order(1) != order(2)
    assert order(jax.random.key(1)) == order(jax.random.key(1)) != order(jax.random.key(2))
    assert flat(order(5, shuffle=False)) == list(range(len(again.source)))
    whole = order(1, epochs=3)
    for start in (1, 5, 11):
        assert order(1, epochs=3, start=start) == whole[start:]
    assert len(corpus.windows(4, 7, epochs=2, start=500)) == 0


def test_shuffling_is_even():
    """Every window is as often in every place."""
    source = Corpus(several((12,))).window_source(1)
    counts = np.zeros((12, 12))
    for epoch in range(3000):
        (order,) = source.chunks(12, np.random.default_rng([7, epoch]), False)
        counts[np.arange(12), order] += 1
    assert np.abs(counts - 250).max() < 5 * np.sqrt(250)


def test_the_last_batch(corpus):
    full = corpus.windows(4, 7, drop_last=True)
    sizes = [len(b.rotations) for b in full]
    assert set(sizes) == {7}
    assert len(full) == len(sizes) == len(full.source) // 7
    rest = [len(b.rotations) for b in corpus.windows(4, 7)]
    assert rest[-1] == len(full.source) % 7
    with pytest.raises(ValueError, match=r"batch=1000 and drop_last leave none"):
        corpus.windows(4, 1000, drop_last=True)


def test_endless(corpus):
    batches = corpus.windows(16, 3, epochs=None)
    with pytest.raises(TypeError, match="endless"):
        len(batches)
    stream = iter(batches)
    seen = [next(stream) for _ in range(3 * -(-len(batches.source) // 3))]
    assert len(seen) > 6
    assert threads()
    stream.close()
    assert not threads()


def test_what_does_not_fit_is_told(corpus):
    with pytest.raises(ValueError, match="length=65; no clip is so long, the longest has 64 fra"):
        corpus.windows(65, 2)
    for name, value in (("length", 0), ("batch", 0), ("stride", 0), ("epochs", 0)):
        options = {"length": 4, "batch": 2} | {name: value}
        with pytest.raises(ValueError, match=f"^{name}=0; expected a whole number of at least 1"):
            corpus.windows(**options)
    with pytest.raises(ValueError, match="prefetch=-1; expected a whole number of at least 0"):
        corpus.windows(4, 2, prefetch=-1)


def test_a_batch_is_ready_for_vmap_and_jit(corpus):
    (batch, *_) = corpus.windows(8, 3, shuffle=False)

    @jax.jit
    def heights(batch):
        return jax.vmap(lambda clip: jm.forward_kinematics(clip).positions[..., 1])(batch)

    found = heights(batch)
    for i in range(3):
        clip = corpus[0][8 * i : 8 * i + 8]
        want = jm.forward_kinematics(clip).positions[..., 1]
        np.testing.assert_allclose(found[i], want, 1e-12, 1e-12)
    (first, *_) = corpus.windows(8, 3, shuffle=False, device=jax.devices()[0])
    assert all(isinstance(x, jax.Array) for x in jax.tree.leaves(first))
    stacked, _ = jm.stack([corpus[0][8 * i : 8 * i + 8] for i in range(3)])
    assert jax.tree.structure(batch) == jax.tree.structure(stacked)
    for x, y in zip(jax.tree.leaves(first), jax.tree.leaves(stacked), strict=True):
        np.testing.assert_array_equal(x, y)


def test_batches_are_the_users_own(corpus):
    """What is done to one is in no other, nor in the corpus."""
    before = corpus[0].rotations.copy()
    for batch in corpus.windows(8, 3, shuffle=False):
        batch.rotations[...] = np.nan
        batch.translations[...] = np.nan
    np.testing.assert_array_equal(corpus[0].rotations, before)
    for batch in corpus.windows(8, 3):
        assert np.isfinite(batch.rotations).all()


# Whole clips


def test_whole_clips_are_padded_into_buckets(corpus, dtype):
    clips = several((40, 17, 64, 5, 33, 41, 16, 2), dtype)
    made = Corpus(clips)
    seen = []
    for batch, lengths in made.batches(2, seed=3):
        size = batch.rotations.shape[1]
        assert batch.rotations.dtype == dtype
        assert {bucket_size(int(n)) for n in lengths} == {size}
        for i, n in enumerate(lengths):
            got = jax.tree.map(lambda x, i=i: x[i], batch)
            (name,) = [
                k for k, c in clips.items() if np.array_equal(got.rotations[:n], c.rotations)
            ]
            np.testing.assert_array_equal(got.translations[:n], clips[name].translations)
            for rest in (got.rotations[n:] - got.rotations[n - 1], got.translations[n:]):
                assert len(rest) == size - n
            assert not (got.rotations[n:] - got.rotations[n - 1]).any()
            assert not (got.translations[n:] - got.translations[n - 1]).any()
            seen.append(name)
    assert sorted(seen) == sorted(clips)
    sizes = [b.rotations.shape[:2] for b, _ in made.batches(2, drop_last=True)]
    assert {n for n, _ in sizes} == {2}
    assert len(made.batches(2, smallest=64)) == 4


# The thread


def test_no_thread_is_left(corpus):
    def use(stop):
        for i, _ in enumerate(corpus.windows(2, 2, epochs=50)):
            if i == 3:
                if stop == "break":
                    break
                raise KeyError(stop)

    use("break")
    assert not threads()
    with pytest.raises(KeyError):
        use("raise")
    assert not threads()
    list(corpus.windows(8, 2))
    assert not threads()
    iter(corpus.windows(8, 2))  # nothing is begun
    assert not threads()


def test_an_error_in_the_thread_is_raised_where_the_item_would_be():
    def make():
        yield from (1, 2)
        raise OSError("the disk is gone")

    stream = prefetch.prefetched(make, 4)
    assert [next(stream), next(stream)] == [1, 2]
    with pytest.raises(OSError, match="the disk is gone"):
        next(stream)
    assert not threads()


def test_items_are_made_ahead_and_no_more():
    made = []

    def make():
        for i in range(100):
            made.append(i)
            yield i

    stream = prefetch.prefetched(make, 3)
    next(stream)
    time.sleep(0.2)
    assert 3 <= len(made) <= 6
    stream.close()
    assert not threads()


def test_two_loops_at_once(corpus):
    pairs = list(zip(corpus.windows(8, 3), corpus.windows(8, 3), strict=True))
    assert all(np.array_equal(a.rotations, b.rotations) for a, b in pairs)


# Other loaders


def test_pickled_a_source_takes_no_clip_along(corpus):
    source = corpus.window_source(8, 2)
    data = pickle.dumps(source)
    assert len(data) < 6000
    back = pickle.loads(data)
    assert back == source
    np.testing.assert_array_equal(back[7].rotations, source[7].rotations)
    batches = corpus.windows(8, 2, seed=5)
    assert isinstance(batches, Batches)
    again = pickle.loads(pickle.dumps(batches))
    for a, b in zip(batches, again, strict=True):
        np.testing.assert_array_equal(a.rotations, b.rotations)


def test_grain_takes_a_source(corpus):
    grain = pytest.importorskip("grain", reason="grain is not installed")
    source = corpus.window_source(8)
    made = grain.MapDataset.source(source).shuffle(seed=3).batch(2)
    assert len(made) == len(source) // 2 + len(source) % 2
    first = made[0]
    assert first.rotations.shape == (2, 8, 5, 4)
    found = ids(made.to_iter_dataset(), source)
    assert sorted(flat(found)) == list(range(len(source)))
    assert jnp.asarray(jax.vmap(lambda m: m.rotations.sum())(first)).shape == (2,)


def test_torchs_loader_takes_a_source(corpus):
    data = pytest.importorskip("torch.utils.data", reason="torch is not installed")
    source = corpus.window_source(8)
    alone = data.DataLoader(source, batch_size=2, shuffle=True, collate_fn=source.collate)
    assert sorted(flat(ids(alone, source))) == list(range(len(source)))
    workers = data.DataLoader(
        source,
        batch_size=2,
        collate_fn=source.collate,
        num_workers=1,
        multiprocessing_context="spawn",
    )
    assert flat(ids(workers, source)) == list(range(len(source)))
