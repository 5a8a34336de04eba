"""Rotations of whole clips on the host: NumPy in and out, at a few sizes for clips of any length.

Frames f[T, ...] are filled up to :func:`jaxmotion.frames.padding.program_size`, so that a folder of
clips compiles each of these once or twice. O(T·J).
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxmotion import quaternion
from jaxmotion.frames.padding import padded, program_size

Rotations = Float[np.ndarray, "time *rest 4"]
Vectors = Float[np.ndarray, "time *rest 3"]


def vectors_between(a: Rotations, b: Rotations) -> Vectors:
    """log(a⁻¹ b)."""
    return _over_frames(_vectors_between, a, b)


def angles_between(a: Rotations, b: Rotations) -> Float[np.ndarray, "time *rest"]:
    """‖log(a⁻¹ b)‖, radians."""
    return np.linalg.norm(vectors_between(a, b), axis=-1)


def steps(q: Rotations) -> Float[np.ndarray, "step *rest 4"]:
    """q(t)⁻¹ q(t + 1)."""
    return _over_frames(quaternion.between, q[:-1], q[1:])


def between(a: Rotations, b: Rotations, way: Float[np.ndarray, "time *rest"]) -> Rotations:
    """The rotation at ``way`` from a to b, 0 to 1, and beyond."""
    return _over_frames(quaternion.slerp, a, b, way)


def on_one_hemisphere(q: Rotations) -> Rotations:
    """The same rotations, the sign of each nearer to the one before."""
    return _over_frames(quaternion.align_signs, q)


def turned(q: Rotations, v: Vectors) -> Rotations:
    """q exp(v)."""
    return _over_frames(_turned, q, v)


def rotated(
    q: Rotations, v: Float[np.ndarray, "time *rest 3"]
) -> Float[np.ndarray, "time *rest 3"]:
    """q v q⁻¹."""
    return _over_frames(quaternion.rotate, q, v)


def mean_rotation(q: Any) -> Float[np.ndarray, "*rest 4"]:
    """Chordal mean over the frames."""
    size = program_size(len(q))
    counts = (np.arange(size) < len(q)).astype(q.dtype)
    return np.asarray(_mean(padded(q, size), counts))


def _over_frames(function: Callable, *clips: Any) -> np.ndarray:
    frames = len(clips[0])
    if not frames:
        return np.asarray(function(*clips))
    size = program_size(frames)
    return np.asarray(jax.jit(function)(*(padded(x, size) for x in clips)))[:frames]


def _vectors_between(a, b):
    return quaternion.log(quaternion.between(a, b))


def _turned(q, v):
    return quaternion.multiply(q, quaternion.exp(v))


@jax.jit
def _mean(q, counts):
    return quaternion.mean(jnp.asarray(q), counts, method="chordal")
