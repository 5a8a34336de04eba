"""Shards on disk: made once, made again when their clips change or they are damaged, by anyone."""

import os
import pickle
import shutil
import subprocess
import sys

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.corpus import Corpus, store
from tests.corpus.clips import assert_same_clip, clip, several
from tests.helpers import no_shape_checks


@pytest.fixture(autouse=True)
def _small_shards(monkeypatch):
    monkeypatch.setattr(store, "_MOST", 2)


@pytest.fixture
def files(tmp_path):
    """Five files in a folder."""
    folder = tmp_path / "takes"
    folder.mkdir()
    for name, motion in several().items():
        jm.save(motion, folder / f"{name}.npz", compress=False)
    return folder


@pytest.fixture
def cache(tmp_path):
    return tmp_path / "cache"


def shards(cache):
    """Name to time of change."""
    return {path.name: path.stat().st_mtime_ns for path in cache.iterdir()}


def damage(path, place=-200):
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)


def first_row(path):
    """A place in the rotations of the first clip."""
    return 64 + int.from_bytes(path.read_bytes()[12:16], "little") + 8


def test_what_was_read_once_is_not_read_again(files, cache, monkeypatch):
    corpus = Corpus(files, cache=cache)
    assert not shards(cache)  # until a clip is asked for
    corpus.build()
    made = shards(cache)
    assert len(made) == 3
    again = Corpus(files, cache=cache)
    monkeypatch.setattr(store.Store, "_row", None)
    assert len(list(again)) == 5
    assert again == corpus
    assert hash(again) == hash(corpus)
    assert shards(cache) == made


def test_a_cache_that_is_removed_is_made_again(files, cache):
    corpus = Corpus(files, cache=cache)
    first = corpus[0]
    shutil.rmtree(cache)
    assert_same_clip(corpus[0], first)  # mapped still
    assert_same_clip(corpus[4], jm.load(files / "take 4.npz"))
    assert len(shards(cache)) == 1


def test_only_what_is_asked_for_is_read(files, cache):
    corpus = Corpus(files, cache=cache)
    assert_same_clip(corpus[4], jm.load(files / "take 4.npz"))
    assert len(shards(cache)) == 1


def test_a_changed_input_is_noticed(files, cache):
    Corpus(files, cache=cache).build()
    before = shards(cache)
    changed = clip(21, 99)
    jm.save(changed, files / "take 3.npz")
    corpus = Corpus(files, cache=cache)
    assert_same_clip(corpus[3], changed)
    corpus.build()
    after = shards(cache)
    assert before.items() <= after.items()
    assert len(after) == len(before) + 1


def test_a_file_that_changes_while_a_corpus_lives_is_noticed(files, cache):
    corpus = Corpus(files, cache=cache)
    corpus[0]
    jm.save(clip(21, 99), files / "take 4.npz")
    with pytest.raises(ValueError, match="'take 4' has changed since the corpus was made"):
        corpus[4]


def test_a_change_of_motions_in_memory_is_noticed(cache):
    clips = several()
    Corpus(clips, cache=cache).build()
    other = clips["take 1"].rotations.copy()
    other[3] = -other[3]
    changed = clips | {"take 1": clips["take 1"].with_transforms(rotations=other)}
    np.testing.assert_array_equal(Corpus(changed, cache=cache)[1].rotations, other)


@pytest.mark.parametrize(
    "options",
    [{"fps": 20}, {"joints": ["*0", "*1"]}, {"dtype": np.float32}],
    ids=["fps", "joints", "dtype"],
)
def test_options_have_shards_of_their_own(cache, options):
    clips = several()
    plain = Corpus(clips, cache=cache)
    plain.build()
    other = Corpus(clips, cache=cache, **options)
    assert other != plain
    other.build()
    assert len(shards(cache)) == 6
    assert_same_clip(plain[1], clips["take 1"])


def test_a_file_more_changes_one_shard(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "_MOST", 512)
    monkeypatch.setattr(store, "_MEAN", 4)
    clips = {f"take {k:02}": clip(5, k) for k in range(40)}
    more = dict(sorted((clips | {"take 07b": clip(6, 100)}).items()))
    Corpus(clips, cache=tmp_path).build()
    before = shards(tmp_path)
    Corpus(more, cache=tmp_path).build()
    after = shards(tmp_path)
    assert len(before) > 5
    assert len(after) <= len(before) + 2
    assert before.items() <= after.items()


@pytest.mark.parametrize("how", ["header", "rows", "cut", "emptied", "other"])
def test_a_damaged_shard_is_made_again(files, cache, how):
    corpus = Corpus(files, cache=cache)
    corpus.build()
    path = corpus._view.store.files[0]
    whole = path.read_bytes()
    if how in ("header", "rows"):
        damage(path, 70 if how == "header" else first_row(path))
    else:
        path.write_bytes({"cut": whole[:-64], "emptied": b"", "other": b"x" * 500}[how])
    again = Corpus(files, cache=cache)
    assert_same_clip(again[0], jm.load(min(files.iterdir())))
    assert path.read_bytes() == whole
    assert len(again.lengths) == 5


def test_what_is_damaged_and_cannot_be_made_again_is_said(files, cache):
    corpus = Corpus(files, cache=cache)
    corpus.build()
    sent = pickle.dumps(corpus)
    damage(corpus._view.store.files[0], first_row(corpus._view.store.files[0]))
    (next(iter(sorted(files.iterdir())))).unlink()
    with pytest.raises(
        ValueError, match=r"damaged in clip 0, take 0, and cannot be made again: .*t"
    ):
        pickle.loads(sent)[0]
    in_memory = Corpus(several(), cache=cache / "b")
    sent = pickle.dumps(in_memory)
    damage(in_memory._view.store.files[0], first_row(in_memory._view.store.files[0]))
    with pytest.raises(ValueError, match="motion was left behind when the corpus was pickled"):
        pickle.loads(sent)[0]
    assert_same_clip(in_memory[0], several()["take 0"])  # who has the motion makes it again


def test_clips_that_cannot_be_used(files, cache):
    (files / "take 1.npz").write_bytes(b"no motion")
    jm.save(clip(9, seconds=1 / 50), files / "take 3.npz")
    corpus = Corpus(files, cache=cache)
    assert corpus[0].num_frames == 40
    with pytest.raises(ValueError, match=r"clip 'take 1': .*damaged archive"):
        corpus[1]
    with pytest.raises(ValueError, match=r"'take 1': .*; clip 'take 3': it is at 50 frames a sec"):
        corpus.build()
    with pytest.raises(ValueError, match="clip 'take 1'"):
        corpus.windows(4, 2)
    with pytest.warns(
        UserWarning, match=r"Corpus: 2 clips of 5 left out; the first: clip 'take 1'"
    ):
        sound = Corpus(files, cache=cache, on_error="skip")
    assert sound.names == ("take 0", "take 2", "take 4")
    assert sound.lengths.tolist() == [40, 64, 33]
    assert corpus.subset([0, 2, 4]).lengths.tolist() == [40, 64, 33]
    with pytest.raises(ValueError, match=r"expected an \.npz file"):
        Corpus([files / "take 1.npz"])
    with pytest.raises(ValueError, match="none of the clips can be used"):
        Corpus([files / "take 1.npz"], on_error="skip")
    with pytest.warns(UserWarning, match="1 clip of 2 left out"):
        Corpus([files / "take 1.npz", next(iter(sorted(files.iterdir())))], on_error="skip")


def test_a_temporary_folder_goes_with_the_last_that_uses_it():
    corpus = Corpus(several())
    folder = corpus._view.store.folder
    part = pickle.loads(pickle.dumps(corpus[1:3].window_source(4)))
    del corpus
    assert part[0].num_frames == 4
    del part
    assert not folder.exists()


def test_pickled_no_clip_travels(files, cache):
    for corpus in (Corpus(files, cache=cache), Corpus(several(), cache=cache)):
        list(corpus)
        data = pickle.dumps(corpus)
        assert len(data) < 8000 < sum(clip.rotations.nbytes for clip in corpus)
        back = pickle.loads(data)
        assert back == corpus
        assert_same_clip(back[2], corpus[2])


def test_pickled_before_it_was_read_a_corpus_reads_files_elsewhere(files, cache):
    corpus = Corpus(files, cache=cache)
    back = pickle.loads(pickle.dumps(corpus[2:4]))
    assert not shards(cache)
    assert_same_clip(back[0], jm.load(files / "take 2.npz"))
    assert len(shards(cache)) == 1


_WRITER = """
import sys
from jaxmotion.corpus import Corpus, store
store._MOST = 2
if len(sys.argv) > 3:
    import os
    atomic = store.atomic_write
    def dies(path, **more):
        if len(list(path.parent.glob("*.jmshard"))) == int(sys.argv[3]):
            block = atomic(path, **more)
            block.__enter__().write(b"half")
            os._exit(9)
        return atomic(path, **more)
    store.atomic_write = dies
print("ready", flush=True)
sys.stdin.readline()
for _ in range(1 if len(sys.argv) > 3 else 50):
    corpus = Corpus(sys.argv[1], cache=sys.argv[2])
    corpus.build()
    assert len(corpus[3]) == 5
"""


def writer(*args):
    command = [sys.executable, "-c", _WRITER, *map(str, args)]
    # The tests may have x64 on, which is part of what shards are named by; npz files keep theirs.
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, env=os.environ | {"JAX_ENABLE_X64": "1"}, **pipes)


def test_two_processes_write_one_cache_and_a_killed_one_is_gone_on_with(files, cache, tmp_path):
    both = tmp_path / "both"
    killed, other = writer(files, cache, 1), writer(files, both)
    assert other.stdout.readline() == "ready\n"
    for process in (killed, other):
        process.stdin.write("go\n")
        process.stdin.close()
    while other.poll() is None:  # here at the same time, over and over
        corpus = Corpus(files, cache=both)
        corpus.build()
        assert_same_clip(corpus[4], jm.load(files / "take 4.npz"))
        if other.poll() is None:
            corpus._view.store.files[0].unlink(missing_ok=True)
    Corpus(files, cache=both).build()
    assert [process.wait(120) for process in (killed, other)] == [9, 0]
    left = shards(cache)
    assert sorted(name.endswith(".jmshard") for name in left) == [False, True]
    corpus = Corpus(files, cache=cache)
    corpus.build()
    after = shards(cache)
    assert len(after) == 3
    assert after.items() >= {k: t for k, t in left.items() if k.endswith(".jmshard")}.items()
    assert sorted(shards(both)) == sorted(after)
    for name in after:
        assert (cache / name).read_bytes() == (both / name).read_bytes()


def test_what_clips_may_be():
    wrong = [
        ([], "clips is empty"),
        ([3], r"clips\[0\] is a int; expected a file or a Motion"),
        ([jm.stack(list(several((4, 5)).values()))[0]], "one clip at a time for clips"),
    ]
    for clips, message in wrong:
        with no_shape_checks(), pytest.raises(ValueError, match=message):
            Corpus(clips)
    with pytest.raises(OSError, match="nowhere"):
        Corpus(["nowhere.bvh"])


def test_a_folder_that_is_emptied_meanwhile(files, tmp_path, monkeypatch):
    """What was written is gone before it is read: it is written again."""
    corpus, calls = Corpus(files, cache=tmp_path / "cache"), []
    write = store.Store._write

    def writes(self, group, rows):
        write(self, group, rows)
        calls.append(group)
        if len(calls) < 3:
            self.files[group].unlink()

    monkeypatch.setattr(store.Store, "_write", writes)
    assert_same_clip(corpus[0], jm.load(min(files.iterdir())))
    assert calls == [0, 0, 0]


def test_a_pattern_takes_files_of_a_folder(tmp_path):
    for k, name in enumerate(("b.bvh", "a.bvh", "c.npz")):
        jm.save(next(iter(several((4 + k,)).values())), tmp_path / name)
    assert list(Corpus(f"{tmp_path}/*.bvh").lengths) == [5, 4]
    assert list(Corpus(tmp_path / "*.npz").lengths) == [6]
    with pytest.raises(FileNotFoundError, match="no motion file"):
        Corpus(f"{tmp_path}/*.amc")


def test_a_folder_without_clips_is_told(tmp_path):
    (tmp_path / "notes.txt").write_text("none")
    with pytest.raises(ValueError, match="no motion file in the folder"):
        Corpus(tmp_path)
