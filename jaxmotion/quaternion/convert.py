"""Conversions: matrices, Euler angles, the six-dimensional representation, (x, y, z, w).

Euler orders follow SciPy: three letters, capitals for intrinsic axes ("ZXY" turns about the
moving z, x, y in that order: q = q_z q_x q_y), small letters for extrinsic ("zxy":
q = q_y q_x q_z). All twelve orders work, Tait–Bryan and proper Euler. Angles come back from a
quaternion by the half-angle formulas of Bernardes & Viollet 2022 (no matrix, no loss near the
gimbal lock):

    a = w − u_j, b = u_i + s·u_k, c = w + u_j, d = s·u_k − u_i
    (proper Euler: a = w, b = u_i, c = u_j, d = s·u_k; s the sign of the permutation i, j, k)
    θ₂ = 2·atan2(√(c²+d²), √(a²+b²)),  θ₁,₃ = atan2(b, a) ∓ atan2(d, c)

Matrices act on column vectors, (..., 3, 3). The 6-D representation is the first two columns
[x; y], each of three (Zhou et al. 2019), orthonormalised by Gram–Schmidt. O(n).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmotion._numerics import safe_arctan2, safe_norm, safe_sqrt
from jaxmotion._program import one_program
from jaxmotion._types import Angles, Matrix3, Quaternion, Rotation6d
from jaxmotion.quaternion.algebra import components, ending_in, multiply
from jaxmotion.quaternion.parts import together


@one_program()
def to_matrix(q: Quaternion) -> Matrix3:
    """Rotation matrix of a unit quaternion.

    **Arguments:** ``q``: f[..., 4], unit.
    **Returns:** f[..., 3, 3], acting on column vectors.
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    w, x, y, z = components(q, 4, "q")
    rows = (
        together((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y))),
        together((2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x))),
        together((2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))),
    )
    return jnp.stack(rows, axis=-2)


@one_program()
def from_matrix(m: Matrix3) -> Quaternion:
    """Unit quaternion, w ≥ 0 where it leads, of a rotation matrix.

    Shepperd's method: of the four equivalent formulas the one with the largest square root is
    taken, so nothing is divided by a small number.

    **Arguments:** ``m``: f[..., 3, 3], acting on column vectors.
    **Returns:** f[..., 4], unit.
    **Raises:** ``ValueError`` where the last two axes are not 3 and 3.
    """
    m = ending_in(m, (3, 3), "from_matrix: m")
    (a, b, c), (d, e, f), (g, h, i) = (jnp.unstack(m[..., r, :], axis=-1) for r in range(3))
    squares = jnp.stack([1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i])
    candidates = jnp.stack(
        [
            jnp.stack([squares[0], h - f, c - g, d - b]),
            jnp.stack([h - f, squares[1], b + d, c + g]),
            jnp.stack([c - g, b + d, squares[2], f + h]),
            jnp.stack([d - b, c + g, f + h, squares[3]]),
        ]
    )
    best = jnp.argmax(squares, axis=0)
    chosen = jnp.take_along_axis(candidates, best[None, None], axis=0)[0]
    return jnp.moveaxis(chosen / safe_norm(chosen, axis=0), 0, -1)


@one_program()
def to_rotation_6d(q: Quaternion) -> Rotation6d:
    """First two columns of the rotation matrix, one after the other.

    Source: Zhou et al. 2019.

    **Arguments:** ``q``: f[..., 4], unit.
    **Returns:** f[..., 6].
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    m = to_matrix(q)
    return jnp.concatenate([m[..., :, 0], m[..., :, 1]], axis=-1)


@one_program()
def from_rotation_6d(columns: Rotation6d) -> Quaternion:
    """Unit quaternion from two (not necessarily orthonormal) columns.

    Source: Zhou et al. 2019, Eq. 14.

    **Arguments:** ``columns``: f[..., 6], two vectors of three, neither zero nor parallel.
    **Returns:** f[..., 4], unit.
    **Raises:** ``ValueError`` where the last axis is not 6.
    """
    columns = ending_in(columns, (6,), "from_rotation_6d: columns")
    first, second = columns[..., :3], columns[..., 3:]
    x = first / safe_norm(first, keepdims=True)
    across = second - jnp.sum(x * second, -1, keepdims=True) * x
    y = across / safe_norm(across, keepdims=True)
    return from_matrix(jnp.stack([x, y, jnp.cross(x, y)], axis=-1))


@one_program()
def from_xyzw(q: Quaternion) -> Quaternion:
    """Quaternion (w, x, y, z), as this library has it, of one with the real part last.

    SciPy, ROS, Unity and glTF write (x, y, z, w).

    **Arguments:** ``q``: f[..., 4], (x, y, z, w).
    **Returns:** f[..., 4], (w, x, y, z).
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    x, y, z, w = components(q, 4, "q")
    return together((w, x, y, z))


@one_program()
def to_xyzw(q: Quaternion) -> Quaternion:
    """Quaternion with the real part last of one of this library's.

    **Arguments:** ``q``: f[..., 4], (w, x, y, z).
    **Returns:** f[..., 4], (x, y, z, w).
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    w, x, y, z = components(q, 4, "q")
    return together((x, y, z, w))


@one_program("order", "degrees")
def from_euler(angles: Angles, order: str = "ZXY", *, degrees: bool = False) -> Quaternion:
    """Unit quaternion of three Euler angles.

    **Arguments:** ``angles``: f[..., 3], in the order of the letters; ``order``: three of X, Y and
    Z, no two equal in a row: capitals turn about the moving axes, one after the other ("ZXY": z
    first), small letters about the fixed ones; ``degrees``: whether the angles are degrees, not
    radians.
    **Returns:** f[..., 4], unit.
    **Raises:** ``ValueError`` for an order that is not one of the 24, or a last axis that is not 3.
    """
    i, j, k, extrinsic = _axes(order)
    angles = jnp.radians(angles) if degrees else angles
    first, second, third = components(angles, 3, "angles")
    turns = (_about(i, first), _about(j, second), _about(k, third))
    a, b, c = reversed(turns) if extrinsic else turns
    return multiply(multiply(a, b), c)


@one_program("order", "unwrap", "degrees")
def to_euler(
    q: Quaternion, order: str = "ZXY", *, unwrap: bool = False, degrees: bool = False
) -> Angles:
    """Euler angles of a unit quaternion.

    Source: Bernardes & Viollet 2022.

    **Arguments:** ``q``: f[..., 4]; ``order``: as :func:`from_euler`, "ZXY" for angles about the
    moving z, x and y; ``unwrap``: treat axis 0 as time and give every frame, of the angle triples
    that mean its rotation (the two branches of the order and any whole turns; in gimbal lock a line
    of them), the one nearest the frame before; costs one scan; ``degrees``: whether to give
    degrees.
    **Returns:** f[..., 3], radians unless ``degrees``; without ``unwrap`` the middle angle is in
    [−π/2, π/2] (Tait–Bryan) or [0, π], the others in [−π, π]. In gimbal lock the last intrinsic
    (first extrinsic) angle is 0.
    **Raises:** ``ValueError`` for an order that is not one of the 24, a last axis that is not 4, or
    an ``unwrap`` of one quaternion without time.
    """
    if unwrap and jnp.ndim(q) < 2:
        raise ValueError(f"to_euler: unwrap needs q of shape (time, ..., 4), got {jnp.shape(q)}")
    i, j, k, extrinsic = _axes(order)
    if not extrinsic:
        i, k = k, i
    *angles, lock = _extrinsic_angles(components(q, 4, "q"), i, j, k)
    angles = together(angles if extrinsic else angles[::-1])
    if unwrap:
        angles = _nearest_to_previous(angles, lock, proper=i == k)
    return jnp.degrees(angles) if degrees else angles


def _axes(order: str) -> tuple[int, int, int, bool]:
    extrinsic = order.islower()
    letters = ["xyz".find(c) for c in order.lower()] if order.islower() or order.isupper() else []
    if len(letters) != 3 or -1 in letters or letters[0] == letters[1] or letters[1] == letters[2]:
        raise ValueError(
            f"order={order!r}; expected three of X, Y, Z, no two equal in a row: capitals for "
            "intrinsic axes ('ZXY'), small letters for extrinsic ('zxy')"
        )
    i, j, k = letters
    return i, j, k, extrinsic


def _about(axis: int, angle: Float[Array, "..."]) -> Quaternion:
    zero = jnp.zeros_like(angle)
    parts = [jnp.cos(0.5 * angle), zero, zero, zero]
    parts[axis + 1] = jnp.sin(0.5 * angle)
    return together(parts)


def _extrinsic_angles(q: tuple[Array, ...], i: int, j: int, k: int):
    """First, middle and last angle; and r = ±1 where only last − r·first is known, else 0."""
    proper = i == k
    if proper:
        k = 3 - i - j
    sign = (i - j) * (j - k) * (k - i) // 2
    w, ui, uj, uk = q[0], q[i + 1], q[j + 1], sign * q[k + 1]
    a, b, c, d = (w, ui, uj, uk) if proper else (w - uj, ui + uk, w + uj, uk - ui)
    near, far = safe_sqrt(a * a + b * b), safe_sqrt(c * c + d * d)
    middle = 2 * jnp.arctan2(far, near)
    # In gimbal lock one of the two half angles means nothing; it is set so that the first or the
    # last angle vanishes, and no gradient comes from it.
    tiny = 8 * float(jnp.finfo(w.dtype).eps)
    half_sum = _angle_unless(near < tiny, b, a)
    half_difference = _angle_unless(far < tiny, d, c)
    half_sum = jnp.where(near < tiny, half_difference, half_sum)
    half_difference = jnp.where(far < tiny, half_sum, half_difference)
    first, last = half_sum - half_difference, half_sum + half_difference
    lock = jnp.where(near < tiny, 1.0, jnp.where(far < tiny, -1.0, 0.0)).astype(w.dtype)
    if not proper:
        last, middle, lock = sign * last, middle - jnp.pi / 2, sign * lock
    return _wrap(first), middle, _wrap(last), lock


def _angle_unless(lost, y, x):
    return safe_arctan2(jnp.where(lost, 0.0, y), jnp.where(lost, 0.0, x))


def _wrap(angle):
    turn = 2 * jnp.pi
    return angle - turn * jnp.round(angle / turn)


def _nearest_to_previous(
    angles: Float[Array, "time ... 3"], lock: Float[Array, "time ..."], proper: bool
):
    other_middle = -angles[..., 1] if proper else jnp.pi - angles[..., 1]
    other = jnp.stack([angles[..., 0] + jnp.pi, other_middle, angles[..., 2] + jnp.pi], -1)

    def step(previous, frame):
        one, other, r = frame
        one, other = _wrap(one - previous), _wrap(other - previous)
        nearer = jnp.sum(one**2, -1, keepdims=True) <= jnp.sum(other**2, -1, keepdims=True)
        free = jnp.where(nearer, one, other)
        # In gimbal lock the first and last angle share the change of last − r·first.
        share = 0.5 * _wrap(one[..., 2] - r * one[..., 0])
        locked = jnp.stack([-r * share, one[..., 1], share], -1)
        chosen = previous + jnp.where(r[..., None] == 0, free, locked)
        return chosen, chosen

    if angles.shape[0] == 0:
        return angles
    rest = jax.lax.scan(step, angles[0], (angles[1:], other[1:], lock[1:]))[1]
    return jnp.concatenate([angles[:1], rest])
