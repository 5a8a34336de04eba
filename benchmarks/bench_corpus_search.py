"""The search for words in a corpus: two workers against one, memory, six hours of clips.

    python benchmarks/bench_corpus_search.py FOLDER [--hours 6] [--rounds 2] [--cache DIR]

FOLDER holds motion files of one skeleton, ten minutes in all: Bandai Namco's clips. First every 5th
word of all of them in all of them, by one worker of one core and by two, in turn, each after a
search that compiled: seconds, those of the busiest worker's core (on a machine that does other
things, what two workers would take by themselves), the largest worker. Then a corpus of so many
hours, made of the clips by time warps and small turns of joints held through a clip, all of a seed:
words of a clip in parts of it, by two workers: seconds, the share of pairs that were warped,
seconds a million pairs of words and targets, memory of client and workers together.
"""

import argparse
import json
import os
import tempfile
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import jax
import numpy as np
import psutil

import jaxmotion as jm
from jaxmotion._cluster import connections

_MB, _FPS = 2**20, 24.0


def main() -> None:
    """Both parts."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--hours", type=float, default=6.0)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--cache", type=Path, help="folder that clips made here stay in")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="bench-search-") as scratch:
        programs = os.environ.get("JAXMOTION_TEST_CACHE", f"{scratch}/programs")
        Path(programs).mkdir(parents=True, exist_ok=True)
        jax.config.update("jax_compilation_cache_dir", programs)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        corpus = jm.corpus.Corpus(given.folder, fps=_FPS, cache=f"{scratch}/small")
        if given.rounds:
            race(corpus, given.rounds)
        if given.hours:
            there = (given.cache or Path(scratch)) / f"hours-{given.hours:g}"
            hours(enlarged(corpus, given.hours, there), corpus)


def joined(corpus: jm.corpus.Corpus) -> jm.Motion:
    """All clips of a corpus as one."""
    clips = list(corpus)
    t, q = (np.concatenate([getattr(x, name) for x in clips]) for name in PARTS)
    return clips[0].with_transforms(t, q)


PARTS = ("translations", "rotations")


def race(corpus: jm.corpus.Corpus, rounds: int) -> None:
    """One worker against two."""
    query, best = joined(corpus), {}
    options = {"own": False, "stride": 5}
    for turn in range(rounds):
        for workers in (1, 2):
            with at_work(workers) as (client, watch):
                jm.cleaning.nearest_words(query[:470], corpus, client=client, **options)
                watch.begin()
                found = jm.cleaning.nearest_words(query, corpus, client=client, **options)
                told = watch.ended()
            words, frames = len(found.starts), int(corpus.lengths.sum())
            told |= {"workers": workers, "turn": turn, "words": words, "frames": frames}
            told |= {"warped": found.warped}
            print(json.dumps(told), flush=True)
            for name in ("seconds", "busiest"):
                best[name, workers] = min(told[name], best.get((name, workers), np.inf))
    for name in ("seconds", "busiest"):
        one, two = best[name, 1], best[name, 2]
        print(f"{name}: {one:.1f} by one, {two:.1f} by two: {two / (one / 2):.2f} of half of it")


def hours(corpus: jm.corpus.Corpus, small: jm.corpus.Corpus) -> None:
    """Times by words and frames."""
    clip = joined(small)[: 188 * 5 + 10]
    many = len(corpus)
    with at_work(2) as (client, watch):
        jm.cleaning.nearest_words(clip, corpus[:300], client=client)
        print("| words | hours | warped | seconds | core seconds | a million pairs | total MB |")
        print("|---|---|---|---|---|---|---|")
        for words, share in ((47, 0.25), (47, 0.5), (47, 1.0), (94, 1.0), (188, 1.0)):
            part = corpus[: round(many * share)]
            query, frames = clip[: words * 5 + 10], int(part.lengths.sum())
            watch.begin()
            found = jm.cleaning.nearest_words(query, part, client=client)
            told = watch.ended()
            pairs = len(found.starts) * frames / 1e6
            print(
                f"| {len(found.starts)} | {frames / _FPS / 3600:.2f} | {found.warped:.2%} "
                f"| {told['seconds']:.1f} | {told['cores']:.1f} | {told['cores'] / pairs:.3f} "
                f"| {told['total_mb']:.0f} (largest worker {told['worker_mb']:.0f}) |",
                flush=True,
            )


def enlarged(corpus: jm.corpus.Corpus, many: float, folder: Path) -> jm.corpus.Corpus:
    """So many hours of clips, made of those there are."""
    folder.mkdir(parents=True, exist_ok=True)
    rng, frames, made = np.random.default_rng(0), 0, []
    while frames < many * 3600 * _FPS:
        clip = corpus[len(made) % len(corpus)]
        pace = rng.uniform(0.8, 1.25)
        size = max(30, round(len(clip) * pace))
        turn = 0.025 * rng.standard_normal((clip.num_joints, 3)).astype(np.float32)
        frames += size
        made.append(folder / f"{len(made):05d}.npz")
        if made[-1].exists():
            continue
        # As in a captured clip, somewhat faster here and slower there.
        at = np.linspace(0, 1, size)
        at = (at + 0.02 * np.sin(2 * np.pi * (at * 3 + rng.uniform()))) * (len(clip) - 1)
        at = np.clip(at, 0, len(clip) - 1).astype(np.float32)
        low = np.minimum(at.astype(int), len(clip) - 2)
        way = (at - low).astype(np.float32)
        q, t = np.asarray(clip.rotations), np.asarray(clip.translations)
        after = np.where(
            np.sum(q[low] * q[low + 1], -1, keepdims=True) < 0, -q[low + 1], q[low + 1]
        )
        q = q[low] + way[:, None, None] * (after - q[low])
        q = _turned(q, turn)
        q /= np.linalg.norm(q, axis=-1, keepdims=True)
        t = t[low] + way[:, None, None] * (t[low + 1] - t[low])
        jm.save(clip.with_transforms(t, q), made[-1])
    return jm.corpus.Corpus(made, cache=folder / "cache")


def _turned(q: np.ndarray, half: np.ndarray) -> np.ndarray:
    """By small rotations, twice these vectors; in NumPy, as every length would be compiled for."""
    w, v = q[..., :1], q[..., 1:]
    real = w - np.sum(v * half, -1, keepdims=True)
    return np.concatenate([real, v + w * half + np.cross(v, half)], -1)


class Watch:
    """Time and memory of this process and its children."""

    def __init__(self):
        self._ended = threading.Event()
        self._total = self._worker = 0.0
        threading.Thread(target=self._look, daemon=True).start()

    def begin(self) -> None:
        self._total = self._worker = 0.0
        self._cpu, self._begun = self._cores(), time.perf_counter()

    def ended(self) -> dict[str, float]:
        seconds = time.perf_counter() - self._begun
        spent = {k: x - self._cpu.get(k, 0.0) for k, x in self._cores().items()}
        own = spent.pop(os.getpid())
        told = {"seconds": seconds, "busiest": max(spent.values()), "client": own}
        told |= {"cores": sum(spent.values()) + own}
        told |= {"worker_mb": self._worker, "total_mb": self._total}
        return {name: round(x, 2) for name, x in told.items()}

    def stop(self) -> None:
        self._ended.set()

    def _cores(self) -> dict[int, float]:
        found = {os.getpid(): _spent(psutil.Process())}
        for child in psutil.Process().children(recursive=True):
            with suppress(psutil.Error):
                found[child.pid] = _spent(child)
        return found

    def _look(self) -> None:
        me = psutil.Process()
        while not self._ended.wait(0.1):
            with suppress(psutil.Error):
                theirs = [x.memory_info().rss / _MB for x in me.children(recursive=True)]
                self._worker = max(self._worker, *theirs, 0.0)
                self._total = max(self._total, me.memory_info().rss / _MB + sum(theirs))


def _spent(process: psutil.Process) -> float:
    times = process.cpu_times()
    return times.user + times.system


@contextmanager
def at_work(workers: int):
    """So many workers of one core each, and who watches them."""
    watch = Watch()
    cores, connections.cores = connections.cores, lambda: workers
    try:
        with jm.corpus.local_client(workers) as client:
            yield client, watch
    finally:
        connections.cores = cores
        watch.stop()


if __name__ == "__main__":
    main()
