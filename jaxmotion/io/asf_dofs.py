"""Degrees of freedom of Acclaim bones ↔ local rotations and translations.

    q = C R C⁻¹, t = offset + C·(tx, ty, tz)      a bone; C: its axis, Euler angles about x, y, z
                                                  composed in the axis's order, the first innermost
    q = R C,     t = position + (TX, TY, TZ)      the root; C: its preset ``orientation``

R turns about the bone's dofs, the first listed applied first: ``rx ry rz`` is R_z R_y R_x on
column vectors. Absent dofs are 0. Angles in radians, lengths in the file's unit.
O(T·J). Source: Acclaim 1995; Meredith & Maddock 2001.
"""

from collections.abc import Sequence

import numpy as np

from jaxmotion._asf_bone import AsfBone
from jaxmotion.io.asf import DOFS, ROOT_ORDER, rotation_order
from jaxmotion.io.euler_blocks import (
    angle_blocks,
    joints_by_order,
    one_branch,
    products,
    quaternions,
)
from jaxmotion.skeleton import Skeleton

_SLOTS = ((), (0,), (0, 2), (0, 1, 2))


def transforms_from_dofs(
    skeleton: Skeleton, columns: dict[str, np.ndarray], frames: int
) -> tuple[np.ndarray, np.ndarray]:
    """Translations f64[T, J, 3] and rotations f64[T, J, 4] of the dofs f64[T, n] by joint name."""
    angles = np.zeros((frames, skeleton.num_joints, 3))
    shifts = np.zeros_like(angles)
    for j, (name, dofs) in enumerate(zip(skeleton.names, skeleton.channels, strict=True)):
        if name in columns:
            for values, (kind, slot) in zip(columns[name].T, places(dofs), strict=True):
                (angles if kind == "r" else shifts)[:, j, slot] = values
    left, right = _frames(skeleton.asf)
    turns = _quaternions(angles, [rotation_order(dofs) for dofs in skeleton.channels])
    translations = np.asarray(skeleton.offsets) + _rotate(left, shifts)
    return translations, products(left, turns, right)


def dofs_from_transforms(
    skeleton: Skeleton,
    bones: Sequence[AsfBone],
    translations: np.ndarray,
    rotations: np.ndarray,
) -> tuple[list[tuple[str, ...]], list[np.ndarray]]:
    """Dof names and their values f64[T, n], one entry a joint.

    Dofs are the skeleton's, or in the order of its BVH channels. Those missing to express a
    rotation or translation, by more than the rounding of the arrays' dtype, are added at the end.
    """
    # Noise, not motion: what rounding leaves of an angle (radians) or a length (relative).
    eps = float(np.finfo(rotations.dtype).eps)
    least_angle, least_length = max(16 * eps, 1e-12), max(4 * eps, 1e-13)
    q = rotations.astype(np.float64)
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    left, right = _frames(bones)
    turns = products(_conjugate(left), q, _conjugate(right))
    translations = translations.astype(np.float64)
    shifts = translations - np.asarray(skeleton.offsets, np.float64)
    shifts = _rotate(_conjugate(left), shifts)
    moved = np.abs(shifts).max(0) > least_length * np.abs(translations).max((0, 2))[:, None]
    dofs = [_starting_dofs(names, j == 0) for j, names in enumerate(skeleton.channels)]
    dofs = [_with(names, "t", moved[j].tolist()) for j, names in enumerate(dofs)]
    angles = _angles(turns, dofs)
    short = []
    for j, names in enumerate(dofs):
        used = [slot for kind, slot in places(names) if kind == "r"]
        unused = [slot for slot in range(3) if slot not in used]
        if np.abs(angles[:, j, unused]).max(initial=0.0) > least_angle:
            dofs[j] = _with(names, "r", (True, True, True))
            short.append(j)
    angles[:, short] = _angles(turns[:, short], [dofs[j] for j in short])
    values = []
    for j, names in enumerate(dofs):
        columns = [(angles if kind == "r" else shifts)[:, j, slot] for kind, slot in places(names)]
        values.append(np.stack(columns, axis=1) if columns else np.zeros((len(turns), 0)))
    return dofs, values


def places(dofs: Sequence[str]) -> list[tuple[str, int]]:
    """Of each dof "r" and its place in the triple of ``rotation_order``, or "t" and its axis."""
    slots = iter(_SLOTS[sum(name[0] in "rR" for name in dofs)])
    return [
        ("r", next(slots)) if name[0] in "rR" else ("t", "xyz".index(name[1].lower()))
        for name in dofs
    ]


def _frames(bones: Sequence[AsfBone]) -> tuple[np.ndarray, np.ndarray]:
    """What multiplies R from the left and from the right: f64[J, 4]."""
    orders = [bone.axis_order.lower() for bone in bones]
    degrees = [
        [bone.axis["xyz".index(letter)] for letter in order]
        for bone, order in zip(bones, orders, strict=True)
    ]
    left = _quaternions(np.radians([degrees]), orders)[0]
    right = _conjugate(left)
    right[0] = left[0]
    left[0] = [1.0, 0.0, 0.0, 0.0]
    return left, right


def _starting_dofs(channels: Sequence[str], root: bool) -> tuple[str, ...]:
    if channels and all(name.lower() in DOFS for name in channels):
        return tuple(channels)
    axes = [name[0] for name in channels if name[1:].lower() == "rotation"]
    turns = tuple("r" + axis.lower() for axis in reversed(axes))
    if not root:
        return turns
    return (*ROOT_ORDER[:3], *map(str.upper, turns)) if turns else ROOT_ORDER


def _with(dofs: tuple[str, ...], kind: str, axes: Sequence[bool]) -> tuple[str, ...]:
    """The dofs and those of ``kind`` about the ``axes`` that are missing, in the root's case."""
    present = {name.lower() for name in dofs}
    wanted = [kind + axis for axis, needed in zip("xyz", axes, strict=True) if needed]
    added = tuple(name for name in wanted if name not in present)
    return dofs + (tuple(map(str.upper, added)) if dofs and dofs[0].isupper() else added)


def _quaternions(angles: np.ndarray, orders: Sequence[str]) -> np.ndarray:
    """Unit quaternions f64[T, J, 4] of ``angles`` f64[T, J, 3], joint j in order ``orders[j]``."""
    if np.abs(angles).max() > 4 * np.pi:
        angles = np.fmod(angles, 4 * np.pi)
    begun = [
        (joints, quaternions(angles[:, joints], order, angles.dtype))
        for order, joints in joints_by_order(orders).items()
    ]
    result = np.empty((*angles.shape[:-1], 4))
    for joints, wait in begun:
        result[:, joints] = wait()
    return result


def _angles(turns: np.ndarray, dofs: Sequence[tuple[str, ...]]) -> np.ndarray:
    """Angles f64[T, J, 3] in each joint's ``rotation_order``, unwrapped along time.

    Fewer than three dofs say what they can in the branch where the middle angle, absent, can be 0.
    """
    angles = np.empty((*turns.shape[:-1], 3))
    for order, joints in joints_by_order([rotation_order(names) for names in dofs]).items():
        angles[:, joints] = np.concatenate(list(angle_blocks(turns[:, joints], order)))
    limited = [j for j, names in enumerate(dofs) if sum(name[0] in "rR" for name in names) < 3]
    angles[:, limited] = one_branch(angles[:, limited], slot=1)
    return angles


def _conjugate(q: np.ndarray) -> np.ndarray:
    return q * [1.0, -1.0, -1.0, -1.0]


def _rotate(q: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors f64[T, J, 3] turned by quaternions f64[J, 4]."""
    pure = np.concatenate([np.zeros((*vectors.shape[:-1], 1)), vectors], axis=-1)
    return products(q, pure, _conjugate(q))[..., 1:]
