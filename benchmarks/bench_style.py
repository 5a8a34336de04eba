"""Style transfer against a plain NumPy port of Wu et al. 2006, its warp's loop in numba.

No package does it. The port is what a reader of the paper would write: iterative motion warping by
dynamic programming and a banded solve, recursive means and deviations frame by frame, Eq. 7; the
body's path by increments. Sizes are those of the paper's first row, walk on hobble, 427 on 400
frames; it took 921 ms, and 80 ms for the feet (a Pentium 4 of 2.8 GHz).
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solveh_banded

import jaxmotion as jm
from jaxmotion.style import transfer_style

SOURCE, REFERENCE, JOINTS = 427, 400, 31
REPEATS = 2


def clip(seed, frames):
    """Joints about poses of their own, on smooth curves; the body goes straight on."""
    rng = np.random.default_rng(seed)
    parents = (-1, *(int(np.random.default_rng(j).integers(0, j)) for j in range(1, JOINTS)))
    offsets = np.random.default_rng(0).standard_normal((JOINTS, 3))
    names = tuple(f"joint{j}" for j in range(JOINTS))
    t = np.arange(frames)[:, None, None] / 120
    speed, phase = rng.uniform(4, 5, (1, JOINTS, 3)), rng.uniform(0, 6, (1, JOINTS, 3))
    v = 0.4 * np.sin(speed * t + phase) + 0.3 * rng.standard_normal((1, JOINTS, 3))
    v[:, 0] *= 0.2
    place = np.stack([0 * t[:, 0, 0], 1 + 0 * t[:, 0, 0], t[:, 0, 0]], axis=1)
    skeleton = jm.Skeleton(names, parents, offsets)
    return jm.Motion.from_root(skeleton, place, np.asarray(jm.quaternion.exp(v)), 1 / 120)


def multiply(a, b):
    w, x, y, z = np.moveaxis(a, -1, 0)
    s, i, j, k = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            w * s - x * i - y * j - z * k,
            w * i + x * s + y * k - z * j,
            w * j - x * k + y * s + z * i,
            w * k + x * j - y * i + z * s,
        ],
        axis=-1,
    )


def conjugate(q):
    return q * np.array([1.0, -1, -1, -1])


def log(q):
    q = np.where(q[..., :1] < 0, -q, q)
    size = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    return 2 * np.arctan2(size, q[..., :1]) * q[..., 1:] / np.maximum(size, 1e-12)


def exp(v):
    size = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(size / 2), np.sin(size / 2) * v / np.maximum(size, 1e-12)], -1)


def mean_and_deviation(q):
    """Eq. 6, frame by frame, of f[T, J, 4]."""
    middle = q[0]
    for n in range(1, len(q)):
        middle = multiply(middle, exp(log(multiply(conjugate(middle), q[n])) / (n + 1)))
    away = log(multiply(conjugate(middle), q))
    return middle, np.sqrt(np.mean(np.sum(away**2, axis=-1), axis=0))


def warping(numba):
    """The dynamic programme: runs of 1 to m² refined frames for each source frame."""

    @numba.njit(cache=False)
    def runs_of(d, m):
        frames, refined = d.shape[0], d.shape[1] * m
        most = m * m
        cost = np.full((refined + 1,), np.inf)
        cost[0] = 0.0
        length = np.zeros((frames, refined + 1), np.int32)
        for i in range(frames):
            new = np.full((refined + 1,), np.inf)
            for end in range(1, refined + 1):
                total = 0.0
                for c in range(1, most + 1):
                    if c > end:
                        break
                    total += d[i, (end - c) // m]
                    if cost[end - c] + total < new[end]:
                        new[end] = cost[end - c] + total
                        length[i, end] = c
            cost = new
        runs = np.zeros(frames, np.int32)
        end = refined
        for i in range(frames - 1, -1, -1):
            runs[i] = length[i, end]
            end -= runs[i]
        return runs

    return runs_of


def correspondence(s, r, runs_of, rounds=4):
    """Which source and reference frames stand beside each other."""
    a, b = np.ones_like(s), np.zeros_like(s)
    refined = np.repeat(r, REPEATS, axis=0)
    frames = len(s)
    for _ in range(rounds):
        bent = s * a + b
        square = np.sum(bent**2, 1)[:, None] + np.sum(r**2, 1) - 2 * bent @ r.T
        runs = runs_of(np.maximum(square, 0), REPEATS)
        starts = np.concatenate([[0], np.cumsum(runs)[:-1]])
        sums = np.add.reduceat(refined, starts, axis=0)
        ends = np.concatenate([[1.0], np.full(frames - 2, 2.0), [1.0]])
        for c in range(s.shape[1]):
            bands = np.zeros((4, 2 * frames))
            scale = np.mean(s[:, c] ** 2)
            bands[3, 0::2] = runs * s[:, c] ** 2 + scale * ends
            bands[3, 1::2] = runs + ends
            bands[2, 1::2] = runs * s[:, c]
            bands[1, 2::2] = -scale
            bands[1, 3::2] = -1.0
            bands[3] += 1e-6  # joints held still
            right = np.empty(2 * frames)
            right[0::2], right[1::2] = s[:, c] * sums[:, c], sums[:, c]
            x = solveh_banded(bands, right)
            a[:, c], b[:, c] = x[0::2], x[1::2]
    source = np.repeat(np.arange(frames), runs)
    pairs = np.unique(np.stack([source, np.arange(len(source)) // REPEATS], 1), axis=0)
    return pairs[:, 0], pairs[:, 1]


def ported(source, reference, runs_of):
    q, r = (np.asarray(x.rotations) for x in (source, reference))
    channels = []
    for x in (q, r):
        middle = x.mean(axis=0)
        middle = middle / np.linalg.norm(middle, axis=-1, keepdims=True)
        channels.append(log(multiply(conjugate(middle), x)).reshape(len(x), -1))
    at_source, at_reference = correspondence(*channels, runs_of)
    own, sigma = mean_and_deviation(q[at_source])
    other, wanted = mean_and_deviation(r[at_reference])
    turned = multiply(q, multiply(conjugate(own), other))
    away = log(multiply(conjugate(other), turned))
    return multiply(other, exp((wanted / np.maximum(sigma, 1e-6))[:, None] * away))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_transfer(race, own_size, dtype):
    """A whole transfer without contacts, at the clips' own sizes and as one of many lengths."""
    numba = pytest.importorskip("numba")
    runs_of = warping(numba)
    clips = [clip(1, SOURCE), clip(2, REFERENCE)]
    given = [jax.tree.map(lambda x: jnp.asarray(x, dtype), x) for x in clips]
    ported(*clips, runs_of)

    def padded():
        return transfer_style(*given, keep_contacts=False).motion.rotations

    ours, theirs = race(
        f"style transfer {SOURCE} on {REFERENCE} frames, {JOINTS} joints {dtype}",
        own_size(padded),
        {"NumPy, numba": lambda: ported(*clips, runs_of), "of many lengths": padded},
        goals={"NumPy, numba": 15.0},
    )
    away = log(multiply(conjugate(theirs["NumPy, numba"]), np.asarray(ours, float)))[:, 1:]
    # The warps may differ by a frame here and there, the results by what that moves a mean.
    assert np.median(np.linalg.norm(away, axis=-1)) < 0.05


def test_contacts_kept(race):
    """The same with feet, on the built-in clip."""
    walk, run = (jm.samples.load(name).motion for name in ("walk", "run"))
    contacts = jm.contacts.detect(walk)
    race(
        f"style transfer with contacts, {walk.num_frames} on {run.num_frames} frames, 22 joints",
        lambda: transfer_style(walk, run, keep_contacts=contacts).motion.rotations,
        {"found anew": lambda: transfer_style(walk, run).motion.rotations},
    )


def test_first_call(race):
    """Compiled anew."""
    clips = [clip(1, SOURCE), clip(2, REFERENCE)]

    def fresh():
        jax.clear_caches()
        return transfer_style(*clips, keep_contacts=False).motion.rotations

    race("style transfer, first call", fresh, {}, warm=False, rounds=2)
