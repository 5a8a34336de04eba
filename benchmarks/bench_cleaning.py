"""The exact search for nearest words against a compiled loop over all pairs.

No package does it. The loop is what a reader of Aristidou et al. 2018 would write with numba, on
every core: frame distances with the three largest of 21 joint terms left out, then the seven-state
recursion of every word with every target. Clips: Bandai Namco's, JAXMOTION_TEST_DATA or
../shared/data, every frame at 24 a second, end to end: 600 s of walks, runs, kicks, bows and dance.
Their MATLAB took about 3 h for 600 s, and 140 s for 20 s of own context.
"""

import os
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cleaning import joint_groups, nearest_words
from jaxmotion.cleaning.words import texture

FPS, SECONDS = 24, 600
LENGTH, TARGET, LEAST, RUN, TRIM = 15, 20, 11, 3, 2
_BESIDE = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="module")
def corpus():
    """All clips end to end, as one motion."""
    folder = Path(os.environ.get("JAXMOTION_TEST_DATA", _BESIDE)) / "bandai"
    paths = sorted(folder.glob("*.bvh"))
    if not paths:
        pytest.skip("no real captures: set JAXMOTION_TEST_DATA to a folder of them")
    clips = [jm.load(path, dtype=np.float32) for path in paths]
    parts = []
    for clip in clips:
        at = np.arange(0, clip.num_frames - 1, float(clip.fps) / FPS).astype(int)
        parts.append((np.asarray(clip.translations)[at], np.asarray(clip.rotations)[at]))
    translations, rotations = (np.concatenate(x)[: SECONDS * FPS] for x in zip(*parts, strict=True))
    return clips[0].with_transforms(translations, rotations).replace(frame_time=1 / FPS)


def all_pairs(numba):
    """Distances f[W, P] of all words and targets, by every path there is."""

    @numba.njit(parallel=True, fastmath=True, cache=False)
    def search(x, starts):
        frames, joints = x.shape[0], x.shape[1]
        targets = frames - TARGET + 1
        found = np.empty((starts.shape[0], targets), np.float32)
        for w in numba.prange(starts.shape[0]):
            d = np.empty((LENGTH, frames), np.float32)
            for i in range(LENGTH):
                for t in range(frames):
                    total = a = b = np.float32(0)
                    for j in range(joints):
                        p, q = x[starts[w] + i, j], x[t, j]
                        cosine = abs(p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3])
                        term = np.arccos(min(cosine, np.float32(1))) ** 2
                        total += term
                        if term > a:
                            a, b = term, a
                        elif term > b:
                            b = term
                    d[i, t] = total - a - b
            cost = np.empty((2, TARGET, 7), np.float32)
            cells = np.empty((2, TARGET, 7), np.int32)
            for t in range(targets):
                found[w, t] = word_distance(d, t, cost, cells)
        return found

    @numba.njit(fastmath=True, inline="always")
    def word_distance(d, t, cost, cells):
        """States: a diagonal step, one to three down, one to three along."""
        best = np.float32(np.inf)
        for i in range(LENGTH):
            now, before = i % 2, (i + 1) % 2
            for j in range(TARGET):
                here = d[i, t + j]
                for s in range(7):
                    cost[now, j, s] = np.inf
                if i == 0 and j == 0:
                    cost[now, j, 0], cells[now, j, 0] = here, 1
                    continue
                if i > 0 and j > 0:
                    for s in range(7):
                        if cost[before, j - 1, s] + here < cost[now, j, 0]:
                            cost[now, j, 0] = cost[before, j - 1, s] + here
                            cells[now, j, 0] = cells[before, j - 1, s] + 1
                if i > 0:
                    for s in (0, 4, 5, 6):
                        if cost[before, j, s] + here < cost[now, j, 1]:
                            cost[now, j, 1] = cost[before, j, s] + here
                            cells[now, j, 1] = cells[before, j, s] + 1
                    for s in (2, 3):
                        cost[now, j, s] = cost[before, j, s - 1] + here
                        cells[now, j, s] = cells[before, j, s - 1] + 1
                if j > 0:
                    for s in range(4):
                        if cost[now, j - 1, s] + here < cost[now, j, 4]:
                            cost[now, j, 4] = cost[now, j - 1, s] + here
                            cells[now, j, 4] = cells[now, j - 1, s] + 1
                    for s in (5, 6):
                        cost[now, j, s] = cost[now, j - 1, s - 1] + here
                        cells[now, j, s] = cells[now, j - 1, s - 1] + 1
                if i == LENGTH - 1 and j >= LEAST - 1:
                    for s in range(7):
                        if cost[now, j, s] < np.inf:
                            best = min(best, cost[now, j, s] / cells[now, j, s])
        return best

    return search


def test_corpus(race, corpus):
    """Every 5th word against every frame: 41 million pairs. Once: the loop takes minutes."""
    numba = pytest.importorskip("numba")
    search = all_pairs(numba)
    joints = joint_groups(corpus)["whole"]
    rotations = np.ascontiguousarray(texture(corpus, joints))
    starts = np.arange(0, corpus.num_frames - LENGTH + 1, 5)
    trim = len(joints) // 8
    assert trim == TRIM
    search(rotations[:100], starts[:4])
    nearest_words(corpus, joints=joints)
    ours, theirs = race(
        f"nearest words, {corpus.num_frames} frames, {len(joints)} joints, every 5th",
        lambda: jax.tree.map(np.asarray, nearest_words(corpus, joints=joints)),
        {"numba, all pairs": lambda: search(rotations, starts)},
        goals={"numba, all pairs": 8.0},
        warm=False,
        rounds=1,
    )
    found = theirs["numba, all pairs"]
    rows = np.arange(len(starts))[:, None]
    same = np.abs(found[rows, ours.frame[: len(starts)]] - ours.distance[: len(starts)])
    assert np.median(same) < 1e-4
    print(f"\n{100 * ours.warped:.3g} % of pairs warped")


def test_own_context(race, corpus):
    """20 s of one clip, the whole body and four groups."""
    clip = corpus[: 20 * FPS]
    groups = joint_groups(clip)

    def search():
        return [nearest_words(clip, joints=joints).distance for joints in groups.values()]

    race(f"nearest words, 20 s of own context, {len(groups)} groups", search, {})


@pytest.fixture(scope="module")
def pieces(corpus):
    """Nine of 20 s."""
    return [corpus[i * 20 * FPS : (i + 1) * 20 * FPS] for i in range(9)]


def test_repair(race, pieces):
    """Errors of 20 s found and repaired beside 160 s, what is usual known. The paper's took 2
    minutes with its local context, 20 with 5 to 10 clips."""
    clip, *context = pieces
    broken = jm.samples.inject_errors(clip, jax.random.key(0)).motion
    usual = [jm.cleaning.clean_levels(x, context[:3]) for x in context[:2]]

    def repaired():
        return jm.cleaning.repair(broken, context, levels=usual).motion.rotations

    race("errors of 20 s found and repaired beside 160 s", repaired, {}, rounds=3)


def test_levels(race, pieces):
    """What is usual in one of eight clips."""
    clip, *context = pieces

    def measured():
        return jm.cleaning.clean_levels(clip, context).jump

    race("what is usual in 20 s beside 160 s", measured, {}, rounds=3)
