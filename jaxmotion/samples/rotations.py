"""Rotation matrices of given angles, in numpy: the clip makers pose in float64 whatever JAX uses.

Active, right-handed, on column vectors. A positive turn about x takes y to z, about y z to x, about
z x to y: seen on a figure that faces +Z with Y up, a positive pitch (x) bows forward, a positive
yaw (y) turns left, a positive roll (z) tips to the right.
"""

import numpy as np

IDENTITY = np.eye(3)


def about(axis: str, angle) -> np.ndarray:
    """Rotation by ``angle`` (...) radians about "x", "y" or "z": f[..., 3, 3]."""
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    angle = np.asarray(angle, np.float64)
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.zeros((*angle.shape, 3, 3))
    matrix[..., i, i] = 1.0
    matrix[..., j, j] = matrix[..., k, k] = cos
    matrix[..., k, j], matrix[..., j, k] = sin, -sin
    return matrix


def turn(axes: str, *angles) -> np.ndarray:
    """Product of rotations about ``axes``, the last letter acting first on a vector."""
    result = about(axes[0], angles[0])
    for axis, angle in zip(axes[1:], angles[1:], strict=True):
        result = result @ about(axis, angle)
    return result


def ease(t, start: float, stop: float):
    """0 before ``start``, 1 after ``stop``, a C² quintic in between."""
    u = np.clip((t - start) / (stop - start), 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def keyed(t, times, values):
    """C² curve through values[k] at times[k], at rest there. f[T] or f[T, C]."""
    values = np.asarray(values, np.float64)
    result = np.zeros((len(t), *values.shape[1:])) + values[0]
    for k in range(1, len(times)):
        weight = ease(t, times[k - 1], times[k])
        result += np.multiply.outer(weight, values[k] - values[k - 1])
    return result


def bump(x, centre: float, width: float):
    """(1 − ((x − centre)/width)²)³ within ±width of the centre, 0 beyond: C², 1 at its top."""
    return np.clip(1.0 - ((x - centre) / width) ** 2, 0.0, None) ** 3


def sway(rng: np.random.Generator, t, amplitude: float, frequency: float = 0.3):
    """A slow smooth wander: three sines of seeded phase about ``frequency`` hertz. f[T]."""
    phases = rng.uniform(0.0, 2.0 * np.pi, 3)
    rates = 2.0 * np.pi * frequency * np.array([0.61, 1.0, 1.47])
    return amplitude * np.sum(np.sin(np.multiply.outer(t, rates) + phases), axis=-1) / 3.0
