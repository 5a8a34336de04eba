"""What the other joints foretell of a joint, and how far it is from that.

In a body that does what it does elsewhere a joint's rotation follows from what the others do about
the same time. With x(t, j) ∈ R³ the rotation vector of joint j from its mean over the clip, less
its median,

    x(t, j) ≈ Σ_k≠j Σ_l B_jkl x(t + l, k),      l ∈ {−8, −4, 0, 4, 8}

B by ridge regression over the frames of the clip, weighted, and of its context. What is foretold of
a frame comes from a B that its neighbourhood had no part in (blocks of 30 frames), or an error
would foretell itself; it is made twice, the second time with Cauchy weights by how far rows were
from what the first foretold. NumPy on the host: O(T·J²) for the sums, O(T·J⁴) for the systems.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from jaxmotion.cleaning.turns import mean_rotation, vectors_between

_LAGS = (-8, -4, 0, 4, 8)
_BLOCK = 30  # frames
_OWN = 5.0  # weight of a frame of the clip itself
_RIDGE = 0.05  # radians
_FAR = 0.15  # radians, where a row's weight is half


def foretold_residual(
    textures: Sequence[np.ndarray], step: int, left_out: Bool[np.ndarray, "time joint"]
) -> Float[np.ndarray, "time joint 3"]:
    """x less what the other joints foretell, radians.

    ``textures``: of the clip, f[T, J, 4] at its own rate, then of the context, every ``step``-th
    frame of theirs; lags are of ``step`` frames. Entries that are ``left_out`` teach nothing.
    """
    own, *others = (_vectors(x) for x in textures)
    frames, joints = own.shape[:2]
    rows = np.arange(0, frames, step)
    width = joints * 3 * len(_LAGS)
    gram, moment = np.zeros((width, width)), np.zeros((width, joints * 3))
    for x in others:
        features = about(x, np.arange(len(x)), 1)
        gram += features.T @ features
        moment += features.T @ x.reshape(len(x), -1)
    known = float(sum(len(x) for x in others))
    features = about(own, rows, step)
    counts = _OWN * ~left_out[rows]
    every = about(own, np.arange(frames), step)
    residual = np.empty_like(own)
    for joint in range(joints):
        others_only = np.tile(np.repeat(np.arange(joints) != joint, 3), len(_LAGS))
        one = slice(3 * joint, 3 * joint + 3)
        residual[:, joint] = _of_joint(
            own[:, joint],
            features[:, others_only],
            every[:, others_only],
            rows,
            counts[:, joint],
            (gram[np.ix_(others_only, others_only)], moment[others_only, one], known),
        )
    return residual


def _vectors(rotations: np.ndarray) -> np.ndarray:
    """Rotation vectors from the clip's mean, less their medians, f[T, J, 3]."""
    middle = np.broadcast_to(mean_rotation(rotations), rotations.shape)
    turns = vectors_between(middle, rotations).astype(np.float64)
    return turns - np.median(turns, axis=0)


def about(x: np.ndarray, frames: np.ndarray, step: int) -> np.ndarray:
    """All joints' x at five frames about each, f[n, 5·J·3]."""
    at = frames[:, None] + step * np.array(_LAGS)
    return x[np.clip(at, 0, len(x) - 1)].reshape(len(frames), -1)


def _of_joint(x, features, every, rows, counts, taught) -> np.ndarray:
    """The residual of one joint in every frame."""
    blocks = max(1, -(-len(rows) // _BLOCK))
    block = np.arange(len(rows)) * blocks // len(rows)
    of_frame = block[np.minimum(np.searchsorted(rows, np.arange(len(x)), "right") - 1, len(rows))]

    def without_own_block(weights: np.ndarray) -> np.ndarray:
        gram, moment, known = taught
        weighted = features * weights[:, None]
        gram = gram + features.T @ weighted
        moment = moment + weighted.T @ x[rows]
        total = known + weights.sum()
        residual = np.empty_like(x)
        for b in range(blocks):
            held = block == b
            system = gram - features[held].T @ weighted[held]
            system[np.diag_indices_from(system)] += _RIDGE**2 * (total - weights[held].sum() + 1)
            right = moment - weighted[held].T @ x[rows[held]]
            here = of_frame == b
            residual[here] = x[here] - every[here] @ np.linalg.solve(system, right)
        return residual

    first = without_own_block(counts)
    return without_own_block(counts / (1 + np.sum(first[rows] ** 2, axis=-1) / _FAR**2))
