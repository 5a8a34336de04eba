"""Degrees of freedom of Acclaim bones ↔ local rotations and translations.

    q = C R C⁻¹, t = offset + C·(tx, ty, tz)      a bone; C: its axis, Euler angles about x, y, z
                                                  composed in the axis's order, the first innermost
    q = R C,     t = position + (TX, TY, TZ)      the root; C: its preset ``orientation``

R turns about the bone's dofs, the first listed applied first: ``rx ry rz`` is R_z R_y R_x on
column vectors. Absent dofs are 0. Angles in radians, lengths in the file's unit; NumPy, f64.
O(T·J). Source: Acclaim 1995; Meredith & Maddock 2001.
"""

from collections.abc import Sequence

import numpy as np

from jaxmotion.io import euler
from jaxmotion.io.asf import DOFS, ROOT_ORDER, rotation_order
from jaxmotion.skeleton import AsfBone, Skeleton

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
    turns = euler.from_euler(angles, [rotation_order(dofs) for dofs in skeleton.channels])
    rotations = euler.multiply(euler.multiply(left, np.moveaxis(turns, -1, 0)), right)
    translations = np.asarray(skeleton.offsets) + _rotate(left, shifts)
    return translations, np.moveaxis(rotations, 0, -1)


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
    q = np.moveaxis(rotations.astype(np.float64), -1, 0)
    left, right = _frames(bones)
    turns = euler.multiply(
        euler.multiply(_conjugate(left), q / np.linalg.norm(q, axis=0)), _conjugate(right)
    )
    turns = np.moveaxis(turns, 0, -1)
    translations = translations.astype(np.float64)
    shifts = translations - np.asarray(skeleton.offsets, np.float64)
    shifts = _rotate(_conjugate(left), shifts)
    moved = np.abs(shifts).max(0) > least_length * np.abs(translations).max((0, 2))[:, None]
    dofs = [_starting_dofs(names, j == 0) for j, names in enumerate(skeleton.channels)]
    dofs = [_with(names, "t", moved[j].tolist()) for j, names in enumerate(dofs)]
    angles = _angles(turns, dofs)
    for j, names in enumerate(dofs):
        used = [slot for kind, slot in places(names) if kind == "r"]
        unused = [slot for slot in range(3) if slot not in used]
        if np.abs(angles[:, j, unused]).max(initial=0.0) > least_angle:
            dofs[j] = _with(names, "r", (True, True, True))
            angles[:, j : j + 1] = _angles(turns[:, j : j + 1], dofs[j : j + 1])
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
    """What multiplies R from the left and from the right, components in front: f64[4, 1, J]."""
    orders = [bone.axis_order.lower() for bone in bones]
    degrees = [
        [bone.axis["xyz".index(letter)] for letter in order]
        for bone, order in zip(bones, orders, strict=True)
    ]
    left = np.moveaxis(euler.from_euler(np.radians([degrees]), orders), -1, 0)
    right = _conjugate(left)
    right[..., 0] = left[..., 0]
    left[..., 0] = [[1.0], [0.0], [0.0], [0.0]]
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


def _angles(turns: np.ndarray, dofs: Sequence[tuple[str, ...]]) -> np.ndarray:
    counts = [sum(name[0] in "rR" for name in names) for names in dofs]
    orders = [rotation_order(names) for names in dofs]
    return euler.to_euler(turns, orders, two_branches=[count == 3 for count in counts])


def _conjugate(q: np.ndarray) -> np.ndarray:
    return np.stack([q[0], -q[1], -q[2], -q[3]])


def _rotate(q: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors f64[T, J, 3] turned by quaternions f64[4, 1, J]."""
    pure = np.concatenate([np.zeros((1, *vectors.shape[:-1])), np.moveaxis(vectors, -1, 0)])
    return np.moveaxis(euler.multiply(euler.multiply(q, pure), _conjugate(q))[1:], 0, -1)
