"""Euler angles of files, every joint with an order of its own; NumPy, on the host, in float64.

The same mathematics as :mod:`jaxmotion.quaternion.convert` (orders: capitals intrinsic, small
letters extrinsic; half-angle formulas of Bernardes & Viollet 2022), for the edge of the library:
nothing is compiled, so no file waits for its length or its orders, and a float32 session still
writes every digit. Angles in radians, f64[T, J, 3], in the order of the letters.

Unwrapping picks, frame by frame, the triple nearest to the frame before out of the two branches

    (θ₁, θ₂, θ₃)  and  (θ₁ + π, π − θ₂, θ₃ + π)     (proper Euler: −θ₂ in the middle)

and their whole turns. The swap of branches is an isometry of angles modulo 2π, so whether a frame
keeps its predecessor's branch does not depend on which branch that was: the branches are a running
exclusive-or of "the canonical triples jump further than the swapped one", with no loop over time.
O(T·J).
"""

from collections.abc import Sequence

import numpy as np

_TINY = 8 * np.finfo(np.float64).eps


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product of quaternions with the components in front: (4, ...), broadcast."""
    w, x, y, z = a
    W, X, Y, Z = b
    return np.stack(
        [
            w * W - x * X - y * Y - z * Z,
            w * X + x * W + y * Z - z * Y,
            w * Y - x * Z + y * W + z * X,
            w * Z + x * Y - y * X + z * W,
        ]
    )


def from_euler(angles: np.ndarray, orders: Sequence[str]) -> np.ndarray:
    """Unit quaternions f64[T, J, 4] of ``angles`` f64[T, J, 3], joint j in order ``orders[j]``."""
    half = 0.5 * np.moveaxis(np.asarray(angles, np.float64), -1, 0)
    cos, sin = np.cos(half), np.sin(half)
    result = np.empty((4, *half.shape[1:]))
    for order, joints in _groups(orders):
        turns = []
        for slot in range(3):
            turn = np.zeros((4, half.shape[1], len(joints)))
            turn[0] = cos[slot][:, joints]
            turn[1 + "xyz".index(order[slot].lower())] = sin[slot][:, joints]
            turns.append(turn)
        a, b, c = reversed(turns) if order.islower() else turns
        result[:, :, joints] = multiply(multiply(a, b), c)
    return np.moveaxis(result, 0, -1)


def to_euler(
    rotations: np.ndarray, orders: Sequence[str], *, two_branches: Sequence[bool] | None = None
) -> np.ndarray:
    """Angles f64[T, J, 3], unwrapped along time, of unit quaternions ``rotations`` [T, J, 4].

    The first frame's middle angle is in [−π/2, π/2] (proper Euler: [0, π]). Joints whose
    ``two_branches`` is False keep to that branch on every frame.
    """
    q = np.moveaxis(np.asarray(rotations, np.float64), -1, 0)
    result = np.empty((3, *q.shape[1:]))
    free = np.ones(q.shape[2], bool) if two_branches is None else np.asarray(two_branches, bool)
    for order, joints in _groups(orders):
        angles = _canonical(q[:, :, joints], order)
        result[:, :, joints] = _unwrapped(angles, order[0] == order[2], free[joints])
    return np.moveaxis(result, 0, -1)


def _groups(orders: Sequence[str]):
    for order in dict.fromkeys(orders):
        yield order, [j for j, other in enumerate(orders) if other == order]


def _canonical(q: np.ndarray, order: str) -> np.ndarray:
    i, j, k = ("xyz".index(letter) for letter in order.lower())
    if order.isupper():
        i, k = k, i
    proper = i == k
    if proper:
        k = 3 - i - j
    sign = (i - j) * (j - k) * (k - i) // 2
    w, ui, uj, uk = q[0], q[i + 1], q[j + 1], sign * q[k + 1]
    a, b, c, d = (w, ui, uj, uk) if proper else (w - uj, ui + uk, w + uj, uk - ui)
    near, far = np.hypot(a, b), np.hypot(c, d)
    middle = 2 * np.arctan2(far, near)
    half_sum, half_difference = np.arctan2(b, a), np.arctan2(d, c)
    half_sum = np.where(near < _TINY, half_difference, half_sum)
    half_difference = np.where(far < _TINY, half_sum, half_difference)
    first, last = half_sum - half_difference, half_sum + half_difference
    if not proper:
        middle, last = middle - 0.5 * np.pi, sign * last
    angles = np.stack([_wrapped(first), middle, _wrapped(last)])
    return angles if order.islower() else angles[::-1]


def _unwrapped(angles: np.ndarray, proper: bool, free: np.ndarray) -> np.ndarray:
    first, middle, last = angles
    swapped = np.stack([first + np.pi, -middle if proper else np.pi - middle, last + np.pi])
    keep = np.sum(_wrapped(angles[:, 1:] - angles[:, :-1]) ** 2, 0)
    swap = np.sum(_wrapped(swapped[:, 1:] - angles[:, :-1]) ** 2, 0)
    other = np.zeros(angles.shape[1:], bool)
    other[1:] = np.logical_xor.accumulate((swap < keep) & free, axis=0)
    return np.unwrap(np.where(other, swapped, angles), axis=1)


def _wrapped(angle: np.ndarray) -> np.ndarray:
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))
