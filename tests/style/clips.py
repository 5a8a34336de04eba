"""Clips for the style room's tests, and what the paper does with them in plain NumPy and SciPy."""

import numpy as np
from scipy.spatial.transform import Rotation

import jaxmotion as jm

JOINTS = 5


def skeleton(names=None):
    names = names or ("hips", "spine", "arm", "leg", "foot")
    offsets = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, -1, 0], [0, -1, 0.2]], float)
    return jm.Skeleton(names, (-1, 0, 1, 0, 3), offsets)


def quaternions(turns):
    return np.roll(turns.as_quat(), 1, axis=-1)


def rotations(q):
    """SciPy's of f[..., 4], flattened."""
    return Rotation.from_quat(np.roll(np.reshape(np.asarray(q, float), (-1, 4)), -1, axis=-1))


def swaying(seed, frames=40, size=0.4, names=None, rate=30.0):
    """Every joint about a pose of its own, on smooth curves; the root walks on a bent path."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None, None, None] / rate
    phase, speed = rng.uniform(0, 6, (1, JOINTS, 3, 2)), rng.uniform(3, 8, (1, JOINTS, 3, 2))
    v = size * np.mean(np.sin(speed * t + phase), axis=-1)
    pose = Rotation.from_rotvec(rng.standard_normal((JOINTS, 3)) * 0.5)
    q = [quaternions(pose[j] * Rotation.from_rotvec(v[:, j])) for j in range(JOINTS)]
    angle = np.cumsum(rng.normal(0.3, 0.5, frames)) / rate
    lean = Rotation.from_rotvec(v[:, 0] * np.array([0.5, 0, 0.5]))
    q[0] = quaternions(Rotation.from_rotvec(angle[:, None] * np.array([0, 1, 0])) * lean)
    pace = rng.uniform(0.5, 1.5) * (1 + 0.3 * np.sin(5 * t[:, 0, 0]))
    step = np.stack([np.sin(angle), 0 * angle, np.cos(angle + 0.2)], 1) * pace / rate
    place = np.cumsum(step, axis=0) + np.array([3.0, 0, -2.0])
    place[:, 1] = 2 + 0.1 * np.sin(8 * t[:, 0, 0, 0] + rng.uniform(0, 6))
    return jm.Motion.from_root(skeleton(names), place, np.stack(q, axis=1), 1 / rate)


def recursive_mean(q):
    """Eq. 6 with 1/n, of f[T, 4]."""
    middle = q[0]
    for n, sample in enumerate(q[1:], start=2):
        sample = sample if middle @ sample >= 0 else -sample
        away = (rotations(middle).inv() * rotations(sample)).as_rotvec()[0]
        middle = quaternions(rotations(middle) * Rotation.from_rotvec(away / n))[0]
    return middle


def log_half(middle, q):
    """Half the rotation vectors from a mean to f[T, 4]."""
    return 0.5 * (rotations(middle).inv() * rotations(q)).as_rotvec()


def transferred(q, warped, reference):
    """Eq. 7 for one joint f[T, 4]: statistics of the warped clips, the result in q's own frames."""
    own, other = recursive_mean(warped), recursive_mean(reference)
    sigma = [
        np.sqrt(np.mean(np.sum(log_half(m, x) ** 2, -1)))
        for m, x in ((own, warped), (other, reference))
    ]
    turned = rotations(q) * rotations(own).inv() * rotations(other)
    away = (rotations(other).inv() * turned).as_rotvec()
    return quaternions(rotations(other) * Rotation.from_rotvec(sigma[1] / sigma[0] * away))
