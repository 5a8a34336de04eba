"""How a joint turns, as curves in degrees: rotations f[T, 4] in, NumPy out. O(T)."""

import numpy as np
from jaxtyping import Float

from jaxmotion.cleaning.turns import mean_rotation, steps, vectors_between

Curve = Float[np.ndarray, " time"]
Vectors = Float[np.ndarray, "time 3"]


def middle_of(rotations) -> Float[np.ndarray, " 4"]:
    """The mean pose."""
    return mean_rotation(np.asarray(rotations)[:, None])[0]


def from_middle(rotations, middle: Float[np.ndarray, " 4"]) -> Vectors:
    """Rotation vectors from ``middle``, degrees, in the joint's own axes, without jumps."""
    q = np.asarray(rotations)
    start = np.broadcast_to(middle.astype(q.dtype), q.shape)
    return np.degrees(_without_jumps(vectors_between(start, q).astype(np.float64)))


def turned_since_first(rotations) -> Vectors:
    """Steps from frame to frame in the joint's own axes, added up, degrees; exact for turns about
    one axis, of any size."""
    q = np.asarray(rotations)
    identity = np.broadcast_to(np.eye(4, dtype=q.dtype)[0], q[:-1].shape)
    vectors = vectors_between(identity, steps(q)) if len(q) > 1 else np.zeros((0, 3))
    return np.degrees(np.concatenate([np.zeros((1, 3)), np.cumsum(vectors, axis=0)]))


def _without_jumps(vectors: Vectors) -> Vectors:
    """The same rotations, each by the rotation vector that is nearest to the one before: v and
    v (1 + 2πk/‖v‖) turn alike."""
    lengths = np.linalg.norm(vectors, axis=1)
    result = vectors.copy()
    for t in np.flatnonzero(lengths > 1e-6):
        if t:
            unit = vectors[t] / lengths[t]
            wanted = result[t - 1] @ unit
            result[t] += unit * 2 * np.pi * np.round((wanted - lengths[t]) / (2 * np.pi))
    return result
