"""Clips for the cleaning room's tests, and its search in plain NumPy."""

import itertools

import numpy as np

import jaxmotion as jm
from tests.helpers import quaternions_by
from tests.style.clips import skeleton, swaying


def repeating(seed, frames=90, jitter=0.03):
    """A sway that comes again every 25 to 35 frames, never quite the same."""
    rng = np.random.default_rng(seed)
    base = swaying(seed, 200)
    at = np.cumsum(rng.uniform(0.8, 1.2, frames)) % 30
    motion = jm.resample(base, index=None, num_frames=200)
    nearest = np.asarray(motion.rotations)[np.round(at).astype(int)]
    turn = jm.quaternion.exp(jitter * rng.standard_normal((frames, nearest.shape[1], 3)))
    q = np.asarray(jm.quaternion.multiply(nearest, turn))
    return motion.with_transforms(np.asarray(motion.translations)[:frames], q)


def pacing(take, frames=100, seed=0, rate=24.0):
    """Every joint goes round smoothly, once in some 30 frames; takes go at paces of their own and
    face elsewhere. In seconds the same at any rate."""
    rng, own = np.random.default_rng(seed), np.random.default_rng(100 + take)
    t = np.arange(frames) * 24 / rate
    at = t + own.uniform(0, 30) + 2 * np.sin(t / 17 + own.uniform(0, 6))
    at = at[:, None, None] * 2 * np.pi / 30
    phase, size = rng.uniform(0, 6, (2, 1, 5, 3)), rng.uniform(0.1, 0.4, (2, 1, 5, 3))
    v = size[0] * np.sin(at + phase[0]) + 0.5 * size[1] * np.sin(2 * at + phase[1])
    q = quaternions_by(v)
    yaw = quaternions_by([0, own.uniform(-3, 3), 0])
    q[:, 0] = np.asarray(jm.quaternion.multiply(yaw, q[:, 0]))
    there = np.stack([own.uniform(-2, 2) + 0 * t, 2 + 0 * t, t / 24], 1)
    return jm.Motion.from_root(skeleton(), there, q, 1 / rate)


def turned(motion, joint, frames, vectors):
    """The motion with a joint turned in its own frame: f[3], or one for each of the frames."""
    q = np.array(motion.rotations)
    vectors = np.array(np.broadcast_to(np.asarray(vectors, float), (len(frames), 3)))
    turn = quaternions_by(vectors, q.dtype)
    q[frames, joint] = np.asarray(jm.quaternion.multiply(q[frames, joint], turn))
    return motion.with_transforms(rotations=q)


def squared_half_angles(p, q):
    """θ² of f[4] and f[4]: the half angle between rotations."""
    cosine = min(abs(float(p @ q)), 1.0)
    return np.arccos(cosine) ** 2


def frame_distance(x, y, trim):
    """Sum over joints without the largest terms, of poses f[J, 4]."""
    terms = sorted(squared_half_angles(p, q) for p, q in zip(x, y, strict=True))
    return sum(terms[: len(terms) - trim])


def word_distance(d, least):
    """Least mean of d f[N, M] over paths to the last row, at column ``least`` − 1 or later, by
    every state there is: the cell, and how many steps on end led there along one axis."""
    n, m = d.shape
    best = {(0, 0, "", 0): (d[0, 0], 1)}
    ends = {}
    for i, j in itertools.product(range(n), range(m)):
        for axis, run in [("", 0), *itertools.product("ij", (1, 2, 3))]:
            if (i, j, axis, run) not in best:
                continue
            total, cells = best[i, j, axis, run]
            if i == n - 1 and j >= least - 1:
                known = ends.get(j)
                ends[j] = min((total, cells), known) if known else (total, cells)
            for di, dj, name in ((1, 1, ""), (1, 0, "i"), (0, 1, "j")):
                a, b = i + di, j + dj
                longer = run + 1 if name and name == axis else int(bool(name))
                if a < n and b < m and longer <= 3:
                    new = (total + d[a, b], cells + 1)
                    key = a, b, name, longer
                    if key not in best or new[0] < best[key][0]:
                        best[key] = new
    return min(total / cells for total, cells in ends.values())
