"""A search for words in clips that come again, and processes of their own that do it.

    python -m tests.cleaning.searching devices FRAMES
    python -m tests.cleaning.searching process NUMBER OF PORT FRAMES
    python -m tests.cleaning.searching killed ADDRESS CACHE KEEP

The first two print a hash of what they find, in parts of so many frames; the last is killed.
"""

import hashlib
import os
import signal
import sys
from pathlib import Path

import jax
import numpy as np

import jaxmotion as jm
from jaxmotion._stored import StoredClips
from jaxmotion.cleaning import nearest_words, parts, search
from tests.cleaning.clips import pacing

FIELDS = ("starts", "clip", "frame", "distance", "warp")
SIZES = {"k": 5, "joints": None}


def query(dtype="float64"):
    """A clip of 70 frames, 12 words."""
    return pacing(50, frames=70).astype(dtype)


def clips(dtype="float64"):
    """440 frames in clips of which one is short of a target, one comes twice, one stands still."""
    found = [pacing(k, frames=n) for k, n in enumerate((60, 90, 33, 20, 18, 100))]
    still = found[0][:30]
    still = still.with_transforms(rotations=np.repeat(still.rotations[:1], 30, axis=0))
    return [clip.astype(dtype) for clip in (*found, found[1], still)]


def same(one, other):
    """Bit for bit."""
    for name in FIELDS:
        a, b = (np.asarray(getattr(x, name)) for x in (one, other))
        assert a.dtype == b.dtype, name
        np.testing.assert_array_equal(a, b, err_msg=name)


def hashed(found):
    """A text for all bits of the answer."""
    seen = hashlib.sha256()
    for name in FIELDS:
        seen.update(np.asarray(getattr(found, name)).tobytes())
    return seen.hexdigest()


class Deadly(StoredClips):
    """A corpus whose clip of one number ends the process that reads it, so many times."""

    def __init__(self, corpus, number, folder, times=1):
        self._corpus, self._number, self._folder, self._times = corpus, number, folder, times

    skeleton = property(lambda self: self._corpus.skeleton)
    dtype = property(lambda self: self._corpus.dtype)
    lengths = property(lambda self: self._corpus.lengths)

    def digest(self):
        return self._corpus.digest()

    def __len__(self):
        return len(self._corpus)

    def __getitem__(self, index):
        marks = [Path(self._folder) / f"met-{k}" for k in range(self._times)]
        left = [mark for mark in marks if not mark.exists()]
        if index == self._number and left:
            left[0].touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return self._corpus[index]


class Faulty(Deadly):
    """One whose clip of one number cannot be read."""

    def __getitem__(self, index):
        if index == self._number:
            raise ValueError("clip 3 is gone")
        return self._corpus[index]


def _main(role, *rest):
    jax.config.update("jax_enable_x64", True)
    if cache := os.environ.get("JAXMOTION_TEST_CACHE"):
        jax.config.update("jax_compilation_cache_dir", cache)
    if role == "killed":
        _killed(*rest)
        return
    client = None
    if role == "devices":
        jax.config.update("jax_num_cpu_devices", 2)
        search._WORDS = 8  # of each: both have words
    else:
        number, of, port = map(int, rest[:3])
        jax.distributed.initialize(f"127.0.0.1:{port}", of, number)
        client = "processes"
    parts._FRAMES = int(rest[-1])
    corpus = jm.corpus.Corpus(clips())
    found = nearest_words(query(), corpus, client=client, **SIZES)
    print(hashed(found), jax.local_device_count(), jax.process_count(), found.warped)


def _killed(address, cache, keep):
    parts._FRAMES = 1

    def leave(done, words):
        if done > 4:
            os.kill(os.getpid(), signal.SIGKILL)

    corpus = jm.corpus.Corpus(clips(), cache=cache)
    nearest_words(query(), corpus, client=address, keep=keep, progress=leave, **SIZES)


if __name__ == "__main__":
    _main(*sys.argv[1:])
