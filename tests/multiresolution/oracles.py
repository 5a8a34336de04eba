"""Filters, levels and clips written out plainly: NumPy and SciPy, frame by frame."""

import numpy as np
from scipy.interpolate import BarycentricInterpolator
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from tests.helpers import quaternions_by


def swaying(frames, joints=3, seed=0, dtype=np.float64, moving=False):
    """A smooth clip of large turns, far from any wrap between two frames."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None, None] / 10
    v = sum(
        rng.uniform(0.2, 0.9, (joints, 3)) / k * np.sin(k * t + rng.uniform(0, 6, (joints, 3)))
        for k in (1, 2, 5)
    )
    shape = (frames, joints if moving else 1, 3)
    p = np.cumsum(0.1 * rng.standard_normal(shape), axis=0)
    skeleton = jm.Skeleton(
        [f"joint{j}" for j in range(joints)],
        list(range(-1, joints - 1)),
        rng.standard_normal((joints, 3)).astype(dtype),
    )
    q = quaternions_by(v, dtype)
    if moving:
        return jm.Motion(skeleton, p.astype(dtype), q, 1 / 30)
    return jm.Motion.from_root(skeleton, p[:, 0].astype(dtype), q, 1 / 30)


def rotations(q):
    return Rotation.from_quat(np.asarray(q, np.float64), scalar_first=True)


def turns(q):
    """log(q_i⁻¹ q_{i+1}) of one joint, f[T − 1, 3]."""
    r = rotations(q)
    return (r[:-1].inv() * r[1:]).as_rotvec()


def mirrored(steps, index):
    """Step ``index``, mirrored at the first and the last as often as needed (Eq. 6)."""
    n = len(steps)
    if n == 1:
        return steps[0]
    while not 0 <= index < n:
        index = -index if index < 0 else 2 * n - index - 2
    return steps[index]


def filtered(q, p, masks):
    """Eq. 4–5 of one joint: f[T, 4] and f[T, 3]; ``masks`` f[T, 2k + 1]."""
    half = masks.shape[1] // 2
    omega, moves = turns(q), np.diff(p, axis=0)
    change, shift = np.zeros((len(q), 3)), np.zeros((len(q), 3))
    for i, mask in enumerate(masks):
        for m in range(-half, half):
            b = mask[half + m + 1 :].sum() if m >= 0 else -mask[: half + m + 1].sum()
            change[i] += b * mirrored(omega, i + m)
            shift[i] += b * mirrored(moves, i + m)
    return rotations(q) * Rotation.from_rotvec(change), p + shift


def reduced(q, p):
    """R of one joint, evenly spaced, an odd number of frames."""
    masks = np.tile(np.array([-1, 4, 18, 4, -1]) / 24, (len(q), 1))
    r, p = filtered(q, p, masks)
    return r.as_quat(scalar_first=True)[::2], p[::2]


def expanded(q, p):
    """E of one joint: the paper's masks, one-sided at the ends; at least four frames."""
    omega = turns(q)
    n = len(omega)
    r, out_q, out_p = rotations(q), [], []
    for i in range(n):
        if i == 0:
            off = (3 * omega[0] - 4 * omega[1] + omega[2]) / 16
            mid = (5 * p[0] + 15 * p[1] - 5 * p[2] + p[3]) / 16
        elif i == n - 1:
            off = -(3 * omega[-1] - 4 * omega[-2] + omega[-3]) / 16
            mid = (5 * p[-1] + 15 * p[-2] - 5 * p[-3] + p[-4]) / 16
        else:
            off = (omega[i - 1] - omega[i + 1]) / 16
            mid = (-p[i - 1] + 9 * p[i] + 9 * p[i + 1] - p[i + 2]) / 16
        turn = Rotation.from_rotvec(omega[i] / 2) * Rotation.from_rotvec(off)
        out_q += [q[i], (r[i] * turn).as_quat(scalar_first=True)]
        out_p += [p[i], mid]
    return np.array([*out_q, q[-1]]), np.array([*out_p, p[-1]])


def minus(q, p, q0, p0):
    """(u, v) of Eq. 3, half-angle."""
    r = rotations(q0).inv()
    return r.apply(p - p0), 0.5 * (r * rotations(q)).as_rotvec()


def cubic_between(coarse_times, x, times):
    """The cubic through the four knots nearest to each time (fewer if there are fewer)."""
    out = []
    for t in times:
        i = int(np.clip(np.searchsorted(coarse_times, t) - 1, 0, len(x) - 2))
        width = min(4, len(x))
        s = int(np.clip(i - 1, 0, len(x) - width))
        knots = slice(s, s + width)
        out.append(BarycentricInterpolator(coarse_times[knots], x[knots])(t))
    return np.array(out)


def reduced_vectors(x):
    """R of vectors f[T, n], T odd: the paper's mask, differences mirrored at the ends."""
    steps = np.diff(x, axis=0)
    b = np.array([1, -3, 3, -1]) / 24
    change = [sum(b[m + 2] * mirrored(steps, i + m) for m in range(-2, 2)) for i in range(len(x))]
    return (x + np.array(change))[::2]


def vectors_between(x):
    """E of vectors f[K, n], K at least 4."""
    knots = np.arange(len(x), dtype=float)
    return cubic_between(knots, x, np.arange(2 * len(x) - 1) / 2)
