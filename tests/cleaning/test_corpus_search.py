"""The search for words in a corpus: in parts, by workers that die, on two devices, by processes."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion._caller import Caller
from jaxmotion.cleaning import digression_map, nearest_words, parts, search
from tests.cleaning.clips import pacing

# Checks of shapes look at a clip of every sequence: there are none where that would do harm.
from tests.cleaning.searching import SIZES, Deadly, Faulty, clips, hashed, query, same
from tests.corpus.conftest import client  # noqa: F401
from tests.helpers import no_shape_checks
from tests.style.clips import swaying

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def corpus(tmp_path_factory):
    return jm.corpus.Corpus(clips(), cache=tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def wanted():
    """The answer of one machine that warps every pair of a list of clips."""
    return nearest_words(query(), clips(), pairs="all", **SIZES)


def searched_tiles(monkeypatch):
    """The tiles that are searched in this process from now on."""
    seen, call = [], parts.Work.__call__
    monkeypatch.setattr(
        parts.Work, "__call__", lambda self, tile, *x: seen.append(tile) or call(self, tile, *x)
    )
    return seen


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_parts_say_the_same(dtype, monkeypatch):
    """One clip in each, some, all; of a list, and of a corpus."""
    motion, context = query(dtype), clips(dtype)
    every = nearest_words(motion, context, pairs="all", **SIZES)
    several = jm.corpus.Corpus(context)
    found = []
    for frames, many in ((1, 9), (250, 3), (16384, 1)):
        monkeypatch.setattr(parts, "_FRAMES", frames)
        assert len(parts._parts(np.append(70, several.lengths), 0)) == many
        for clips_ in (context, several):
            found.append(nearest_words(motion, clips_, **SIZES))
            same(found[-1], every)
            assert found[-1].distance.dtype == np.dtype(dtype)
            assert (found[-1].left_out > found[-1].distance[:, -1]).all()
    others = nearest_words(motion, context, own=False, **SIZES)
    monkeypatch.setattr(parts, "_FRAMES", 1)
    same(nearest_words(motion, several, own=False, **SIZES), others)
    assert (np.asarray(others.clip) != 0).all()


def test_parts_in_any_order(corpus, wanted, monkeypatch):
    """Whatever bound was known to each: what is as far as the K-th is found, of equals the first.
    Clip 7 is clip 2 again, and K ends between the two in some words."""
    monkeypatch.setattr(parts, "_FRAMES", 1)
    caught = []
    monkeypatch.setattr(parts, "_here", lambda *x: caught.append(x) or (x for x in ()))
    nearest_words(query(), corpus, **SIZES)
    (work, tiles, _, _) = caught[0]
    for order in (tiles, tiles[::-1], tiles[4:] + tiles[:4]):
        merged = parts._Merged(work.query)
        for tile in order:
            merged.add(tile, work(tile, merged.bound(tile)))
        for name in ("clip", "frame", "distance"):
            np.testing.assert_array_equal(getattr(merged.found, name), getattr(wanted, name))
    assert (np.asarray(wanted.clip)[:, -1] == 2).sum() > 1


def test_what_is_bounded_is_not_warped(corpus, monkeypatch):
    """With what other parts have found, a part warps fewer pairs; with nothing to find, none."""
    monkeypatch.setattr(parts, "_FRAMES", 1)
    monkeypatch.setattr(search, "_FIRST", 8)
    found = nearest_words(query(), corpus, **SIZES)
    monkeypatch.setattr(parts._Merged, "bound", lambda self, tile: np.full(12, np.inf))
    assert found.warped < 0.8 * nearest_words(query(), corpus, **SIZES).warped


def test_words_go_in_tiles(corpus, wanted, monkeypatch, tmp_path):
    """With a folder, some at a time; all are told of."""
    monkeypatch.setattr(parts, "_FRAMES", 250)
    monkeypatch.setattr(parts, "_WORDS", 5)
    seen, told = searched_tiles(monkeypatch), []
    same(
        nearest_words(query(), corpus, keep=tmp_path, progress=lambda *x: told.append(x), **SIZES),
        wanted,
    )
    assert [tile[1:] for tile in seen] == 3 * [(0, 5), (5, 10), (10, 12)]
    assert told == sorted(set(told))
    assert told[-1] == (12, 12)
    assert len(list(tmp_path.iterdir())) == len(seen)


def test_what_was_found_is_kept(corpus, wanted, monkeypatch, tmp_path):
    """And searched again only where it is not what was written, or something else is asked."""
    monkeypatch.setattr(parts, "_FRAMES", 1)
    first = nearest_words(query(), corpus, keep=tmp_path / "new", **SIZES)
    same(first, wanted)
    kept = sorted((tmp_path / "new").iterdir())
    assert len(kept) == 9
    seen = searched_tiles(monkeypatch)
    again = nearest_words(query(), corpus, keep=tmp_path / "new", **SIZES)
    same(again, wanted)
    assert not seen
    assert again.warped == first.warped
    np.testing.assert_array_equal(again.left_out, first.left_out)
    text = kept[0].read_bytes()
    kept[0].write_bytes(text[:200] + bytes([text[200] ^ 1]) + text[201:])
    kept[1].write_bytes(kept[1].read_bytes()[:100])
    kept[2].write_bytes(b"")
    kept[3].unlink()
    same(nearest_words(query(), corpus, keep=tmp_path / "new", **SIZES), wanted)
    assert sorted(tile.part for tile in seen) == [0, 1, 2, 3]
    seen.clear()
    same(nearest_words(query(), corpus, keep=tmp_path / "new", **SIZES), wanted)
    assert not seen
    for change in ({"trim": 1}, {"own": False}):
        nearest_words(query(), corpus, keep=tmp_path / "new", **SIZES | change)
        assert len(seen) == 9 - (change == {"own": False}), change
        seen.clear()
    nearest_words(query()[1:], corpus, keep=tmp_path / "new", **SIZES)
    nearest_words(query(), corpus[::-1], keep=tmp_path / "new", **SIZES)
    assert len(seen) == 18


def test_a_digest_is_of_clips_and_options(corpus, tmp_path):
    assert corpus.digest() == jm.corpus.Corpus(clips(), cache=tmp_path).digest()
    others = [corpus[::-1], corpus[:3], corpus[1:], jm.corpus.Corpus(clips(), fps=20)]
    assert len({corpus.digest(), *(x.digest() for x in others)}) == 5


@pytest.mark.parametrize("rate", [24.0, 60.0])
def test_a_digression_is_the_same(rate, monkeypatch):
    """Of a list, and of a corpus at another rate, in parts; with the groups and medians of all."""
    motion = query()
    context = [pacing(k, frames=n, rate=rate) for k, n in enumerate((200, 150, 180))]
    seen = []
    want = digression_map(motion, context, progress=lambda *x: seen.append(x))
    monkeypatch.setattr(parts, "_FRAMES", 1)
    found = digression_map(motion, jm.corpus.Corpus(context), progress=lambda *x: seen.append(x))
    for name in ("digression", "mdm", "residual", "texture"):
        np.testing.assert_array_equal(getattr(found, name), getattr(want, name), err_msg=name)
    assert found.neighbours.keys() == want.neighbours.keys()
    for name, neighbours in found.neighbours.items():
        same(neighbours, want.neighbours[name])
        assert neighbours.joints == want.neighbours[name].joints


def test_one_clip_is_in_memory_at_a_time(monkeypatch):
    """Of all that is not searched: groups are measured clip by clip."""
    context, live = clips(), []

    class Counting(Faulty):
        def __getitem__(self, index):
            live.append(index)
            return self._corpus[index]

    several = Counting(jm.corpus.Corpus(context), None, None)
    with no_shape_checks():
        digression_map(query(), several)
    many = len(context)
    # The first once more for its rate; twice for the groups, then for the search of every group.
    assert live[: 1 + 2 * many].count(3) == 2


def test_what_is_wrong_is_said(corpus, monkeypatch):
    motion = query()
    for wrong in ({"client": "local"}, {"keep": "somewhere"}):
        for function in (nearest_words, digression_map):
            with pytest.raises(ValueError, match=r"client= and keep= are for a jaxmotion\.corpus"):
                function(motion, clips(), **wrong)
    with no_shape_checks(), pytest.raises(ValueError, match="client is a int; expected a dask"):
        nearest_words(motion, corpus, client=3, **SIZES)
    with pytest.raises(ValueError, match="'here' is no cluster"):
        nearest_words(motion, corpus, client="here", **SIZES)
    other = swaying(1, names=tuple("abcde"))
    for function in (nearest_words, digression_map):
        with pytest.raises(ValueError, match="corpus has other joints"):
            function(other, corpus)
    with pytest.raises(ValueError, match="24 frames a second, the motion 30"):
        nearest_words(motion.replace(frame_time=1 / 30), corpus, **SIZES)
    monkeypatch.setattr(parts, "_FRAMES", 1)
    with no_shape_checks(), pytest.raises(ValueError, match="clip 3 is gone"):
        nearest_words(motion, Faulty(corpus, 3, None), **SIZES)


def test_workers_say_the_same(client, corpus, wanted, monkeypatch, tmp_path):  # noqa: F811
    monkeypatch.setattr(parts, "_FRAMES", 1)
    told = []
    found = nearest_words(
        query(), corpus, client=client, progress=lambda *x: told.append(x), **SIZES
    )
    same(found, wanted)
    assert told[-1] == (12, 12)
    assert isinstance(found.warped, float)
    gone = r"clips 3 to 3 of the context: .*clip 3 is gone"
    with no_shape_checks(), pytest.raises(RuntimeError, match=gone):
        nearest_words(query(), Faulty(corpus, 3, None), client=client, keep=tmp_path, **SIZES)
    assert list(tmp_path.iterdir())


def test_workers_digress_the_same(client, monkeypatch, tmp_path):  # noqa: F811
    """Connected once for all groups, each of whose parts are kept."""
    monkeypatch.setattr(parts, "_FRAMES", 1)
    context = [pacing(k, frames=100) for k in range(3)]
    several, motion = jm.corpus.Corpus(context), query()
    want = digression_map(motion, several)
    found = digression_map(motion, several, client=client.scheduler.address, keep=tmp_path)
    for name in ("digression", "mdm", "residual", "texture"):
        np.testing.assert_array_equal(getattr(found, name), getattr(want, name), err_msg=name)
    assert len(list(tmp_path.iterdir())) == 4 * len(found.neighbours)


def test_a_worker_that_dies_is_replaced(client, corpus, wanted, monkeypatch, tmp_path):  # noqa: F811
    monkeypatch.setattr(parts, "_FRAMES", 1)
    deadly = Deadly(corpus, 5, tmp_path)
    with no_shape_checks():
        found = nearest_words(query(), deadly, client=client, **SIZES)
    same(found, wanted)
    assert (tmp_path / "met-0").exists()


def test_a_killed_client_is_begun_anew(client, corpus, wanted, monkeypatch, tmp_path):  # noqa: F811
    """What it had is kept, and not searched again."""
    address, keep = client.scheduler.address, tmp_path / "keep"
    ran = _program("killed", address, str(tmp_path / "cache"), str(keep))
    assert ran.wait(120) == -signal.SIGKILL, ran.stderr.read()
    ran.communicate()
    kept = {path.name: path.stat().st_mtime_ns for path in keep.glob("*.jmfound")}
    assert 2 <= len(kept) < 9
    monkeypatch.setattr(parts, "_FRAMES", 1)
    sent, stream = [], parts.stream
    monkeypatch.setattr(
        parts,
        "stream",
        lambda c, work, tiles, **x: sent.extend(tiles) or stream(c, work, tiles, **x),
    )
    again = jm.corpus.Corpus(clips(), cache=tmp_path / "elsewhere")
    same(nearest_words(query(), again, client=client, keep=keep, **SIZES), wanted)
    assert len(sent) == 9 - len(kept)
    now = {path.name: path.stat().st_mtime_ns for path in keep.glob("*.jmfound")}
    assert len(now) == 9
    assert kept.items() <= now.items()


def test_a_worker_of_another_release_is_refused(corpus, monkeypatch):
    """Last digits are of JAX's release."""
    there = Caller.here()._replace(release="0.0")
    monkeypatch.setattr(parts.Caller, "here", lambda: there)
    words = f"the worker has jax {jax.__version__}, its client 0.0"
    with pytest.raises(ValueError, match=words):
        nearest_words(query(), corpus, **SIZES)


def test_two_devices_and_two_processes(wanted):
    """Each with a part of the words, or of the clips: in the end the same bits in all."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    programs = [_program("devices", "250")]
    programs += [_program("process", str(k), "2", str(port), "1") for k in (0, 1)]
    told = []
    for program in programs:
        out, err = program.communicate(timeout=240)
        assert program.returncode == 0, err[-2000:]
        told.append(out.split()[-4:])
    assert [x[1:3] for x in told] == [["2", "1"], ["1", "2"], ["1", "2"]]
    assert {x[0] for x in told} == {hashed(wanted)}
    assert told[1] == told[2]


def _program(*arguments):
    paths = filter(None, (str(ROOT), os.environ.get("PYTHONPATH")))
    return subprocess.Popen(
        [sys.executable, "-m", "tests.cleaning.searching", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths), "JAX_PLATFORMS": "cpu"},
    )
