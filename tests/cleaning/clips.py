"""Clips for the cleaning room's tests, and its search in plain NumPy."""

import itertools

import numpy as np

import jaxmotion as jm
from tests.style.clips import swaying


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
