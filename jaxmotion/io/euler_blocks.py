"""Euler angles of files to quaternions and back, and products of these, in blocks of one size.

:mod:`jaxmotion.quaternion` does the mathematics; this file feeds it arrays of a fixed shape, so
that one compiled function an Euler order (and one for products) serves clips of any length and
skeletons of any size: 8192 samples at a time going in, 512 frames × 32 joints going out and in
products, padded. Arithmetic is in the dtype of the arrays; float32 where JAX is without float64.

Going out, angles are unwrapped along time by a scan, which starts afresh in every block. Blocks
therefore share a frame, and the later one is carried over to what the earlier one chose there: the
other branch of the order, (θ₁ + π, π − θ₂, θ₃ + π) (proper Euler: −θ₂), and whole turns. Both keep
the distances that the scan compares, so the outcome is that of one long scan. O(T·J).
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from jaxmotion._program import one_program
from jaxmotion._types import AnyArray
from jaxmotion.quaternion import from_euler, multiply, to_euler

_SAMPLES = 8192
_FRAMES = 512
_JOINTS = 32


def joints_by_order(orders: Sequence[str]) -> dict[str, list[int]]:
    """The joints of each Euler order, of the orders of all joints."""
    groups: dict[str, list[int]] = {}
    for joint, order in enumerate(orders):
        groups.setdefault(order, []).append(joint)
    return groups


def quaternions(angles: np.ndarray, order: str, dtype: np.dtype) -> Callable[[], np.ndarray]:
    """Unit quaternions [..., 4] in ``dtype`` of angles f64[..., 3] in radians.

    They are computed in the background; the function returned waits for them.
    """
    flat = angles.reshape(-1, 3)
    results = []
    for start in range(0, len(flat), _SAMPLES):
        block = np.zeros((_SAMPLES, 3), dtype)
        piece = flat[start : start + _SAMPLES]
        block[: len(piece)] = piece
        results.append(from_euler(block, order))  # type: ignore[arg-type]

    def wait() -> np.ndarray:
        joined = np.concatenate([np.asarray(block) for block in results])
        return joined[: len(flat)].reshape(*angles.shape[:-1], 4)

    return wait


def frame_blocks(frames: int) -> Iterator[slice]:
    """The frames that each block of :func:`angle_blocks` covers."""
    for start in range(0, frames, _FRAMES - 1):
        yield slice(start, min(start + _FRAMES - 1, frames))


def angle_blocks(rotations: np.ndarray, order: str) -> Iterator[np.ndarray]:
    """Angles of ``rotations`` [T, J, 4], unwrapped along time: f64[n, J, 3], block after block.

    While one block is used, the next is computed in the background.
    """
    blocks = list(frame_blocks(len(rotations)))
    proper = order[0] == order[2]
    previous = None
    wait = _begin_angles(rotations, blocks[0], order)
    for following in [*blocks[1:], None]:
        begun = _begin_angles(rotations, following, order) if following else wait
        angles, wait = wait(), begun
        if previous is not None:
            angles = _carried_over(angles, previous, proper)[1:]
        previous = angles[-1]
        yield angles


def _begin_angles(rotations: np.ndarray, block: slice, order: str) -> Callable[[], np.ndarray]:
    """Angles of the block and, unless it is the first, of the frame before it."""
    rotations = rotations[max(block.start - 1, 0) : block.stop]
    frames, joints, _ = rotations.shape
    results = []
    for j in range(0, joints, _JOINTS):
        padded = _padded(rotations[:, j : j + _JOINTS], _FRAMES, _JOINTS)
        results.append(to_euler(padded, order, unwrap=True))  # type: ignore[arg-type]

    def wait() -> np.ndarray:
        joined = np.concatenate([np.asarray(block)[:frames] for block in results], axis=1)
        return joined[:, :joints].astype(np.float64)

    return wait


def _carried_over(angles: np.ndarray, previous: np.ndarray, proper: bool) -> np.ndarray:
    """The same rotations, with ``previous`` as the angles of the first frame."""
    same = np.cos(previous - angles[0]).sum(-1)
    other = _other_branch(angles, proper)
    swap = np.cos(previous - other[0]).sum(-1) > same
    angles = np.where(swap[:, None], other, angles)
    return angles + 2 * np.pi * np.round((previous - angles[0]) / (2 * np.pi))


def products(left: np.ndarray, rotations: np.ndarray, right: np.ndarray) -> np.ndarray:
    """left_j ⊗ q_tj ⊗ right_j, f64[T, J, 4], of [J, 4], ``rotations`` [T, J, 4] and [J, 4]."""
    result = np.empty(rotations.shape)
    frames, joints, _ = rotations.shape
    begun = []
    for j in range(0, joints, _JOINTS):
        across = slice(j, j + _JOINTS)
        a, b = _padded(left[across], _JOINTS), _padded(right[across], _JOINTS)
        for start in range(0, frames, _FRAMES):
            here = slice(start, start + _FRAMES), across
            begun.append((here, _sandwich(a, _padded(rotations[here], _FRAMES, _JOINTS), b)))
    for here, block in begun:
        rows, columns, _ = result[here].shape
        result[here] = np.asarray(block)[:rows, :columns]
    return result


@one_program()
def _sandwich(left, q, right) -> AnyArray:
    return multiply(multiply(left, q), right)


def _padded(rotations: np.ndarray, *shape: int) -> np.ndarray:
    """``rotations`` [..., 4] in the corner of an array ``shape`` + (4,) of identities."""
    block = np.zeros((*shape, 4), rotations.dtype)
    block[..., 0] = 1
    block[tuple(map(slice, rotations.shape))] = rotations
    return block


def one_branch(angles: np.ndarray, slot: int) -> np.ndarray:
    """The same rotations by the branch in which the angle ``slot``, middle or last, is nearer to 0
    than to π; unwrapped along time. Angles [T, ..., 3] of a Tait–Bryan order."""
    folded = np.cos(angles[..., slot, None]) < 0
    return np.unwrap(np.where(folded, _other_branch(angles, proper=False), angles), axis=0)


def _other_branch(angles: np.ndarray, proper: bool) -> np.ndarray:
    """The other triple that means the same rotation."""
    half_turn = np.pi
    first, middle, last = np.moveaxis(angles, -1, 0)
    middle = -middle if proper else half_turn - middle
    return np.stack([first + half_turn, middle, last + half_turn], axis=-1)
