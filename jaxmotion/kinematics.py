"""Forward kinematics: local transforms to world transforms, all joints of a level at once.

    R_j = R_p ⊗ r_j            rotation of joint j in the world, p its parent
    x_j = x_p + R_p t_j        position, t_j its translation

Level by level from the root, O(T·J). Arrays are worked on with joints first and time last
("lanes", shapes (joint, component, time)): a joint is one block of memory, so levels and parents
are gathered by whole blocks, and every operation is long vector arithmetic. Memory bounds it, so
translations are read only of the joints that move; the others have one, their first frame's.

The derivative is written by hand, because differentiating the loop costs about twenty forward
passes. With ω the angular and v the linear velocity that a change (δr, δt) gives every joint,

    a_j = R_p·2 vec(δr_j ⊗ r̄_j)/‖r_j‖²      ω = Σ over ancestors-or-self of a
    v = Σ over ancestors-or-self of (ω_p × (x_j − x_p) + R_p δt_j)        δR_j = ½ (0, ω_j) ⊗ R_j

and the sums over ancestors are the solve of (I − N) y = x, N the parent relation. Its transpose
sums over descendants: reverse mode gathers forces and torques from the leaves to the root, level
by level. Local rotations are normalised on the way, so the derivative along their length is zero;
the zero quaternion stands for the identity.
"""

import itertools
from collections.abc import Iterator
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion import quaternion
from jaxmotion._checks import traced
from jaxmotion._entry import a_motion, skeleton_of
from jaxmotion._levels import Lanes, Levels, rows_of
from jaxmotion._portable import Portable
from jaxmotion._summary import kept_as, moving, some
from jaxmotion.motion import Motion
from jaxmotion.quaternion.parts import normalized, product, rotated
from jaxmotion.skeleton import Skeleton

__all__ = [
    "WorldPose",
    "WorldVelocity",
    "facing_direction",
    "forward_kinematics",
    "mirrored_pairs",
    "velocities",
]


class WorldPose(Portable):
    """Where every joint is, in the world.

    **Fields:** ``positions``: f[T, J, 3], file unit; ``rotations``: f[T, J, 4], unit;
    ``end_positions``: f[T, E, 3], of the skeleton's end sites.
    """

    positions: Float[Array, "*batch time joint 3"]
    rotations: Float[Array, "*batch time joint 4"]
    end_positions: Float[Array, "*batch time end 3"]

    def _words(self) -> Iterator[str]:
        yield from moving(self.positions)
        yield some(self.end_positions.shape[-2], "end site")
        yield kept_as(self.positions)


def forward_kinematics(motion: Motion) -> WorldPose:
    """World positions and rotations of every joint and end site.

    A joint outside ``motion.translated_joints`` has one translation, its first frame's, and its
    derivative falls there. O(T·J) time and memory. Differentiable in translations, rotations and
    end-site offsets, in both modes; see the module for the adjoint.

    **Arguments:** ``motion``: T frames, J joints; leading batch axes allowed.
    **Returns:** :class:`WorldPose`, in the motion's dtype and unit of length.

    **Example:**

        >>> import jaxmotion as jm
        >>> pose = jm.forward_kinematics(jm.samples.load("walk").motion[:16])
        >>> pose.positions.shape, pose.rotations.shape, pose.end_positions.shape
        ((16, 22, 3), (16, 22, 4), (16, 5, 3))
    """
    a_motion("forward_kinematics", motion)
    return _world_pose(motion)


@eqx.filter_jit
def _world_pose(motion: Motion) -> WorldPose:
    batch = motion.rotations.shape[:-2]
    moved = tuple(sorted(set(motion.translated_joints)))
    resting = jnp.broadcast_to(motion.translations[..., :1, :, :], motion.translations.shape)
    world, positions = _chain(
        motion.skeleton.parents,
        moved,
        jax.lax.optimization_barrier(_to_lanes(motion.rotations)),
        jax.lax.optimization_barrier(rows_of(_to_lanes(motion.translations), np.array(moved, int))),
        _to_lanes(resting),
    )
    ends = np.asarray(motion.skeleton.end_joints, int)
    offsets = jnp.asarray(motion.skeleton.end_offsets, motion.dtype)[..., None, :, :]
    offsets = jnp.broadcast_to(offsets, (*batch, *offsets.shape[-2:]))
    tips = positions[ends] + _turned(world[ends], jnp.unstack(_to_lanes(offsets), axis=1))
    return WorldPose(*(_from_lanes(x, batch) for x in (positions, world, tips)))


def _to_lanes(x: Array) -> Lanes:
    return jnp.transpose(x.reshape(int(np.prod(x.shape[:-2])), *x.shape[-2:]), (1, 2, 0))


def _from_lanes(x: Lanes, batch: tuple[int, ...]) -> Array:
    return jnp.transpose(x, (2, 0, 1)).reshape(*batch, *x.shape[:2])


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _chain(
    parents: tuple[int, ...], moved: tuple[int, ...], q: Lanes, moving: Array, resting: Lanes
) -> tuple[Lanes, Lanes]:
    """World rotations and positions from local rotations, of any length, and translations:
    ``moving``, lanes of the joints ``moved``, and ``resting``, of which the other joints count."""

    def own(joints):
        return rows_of(q, joints), _translations(moved, moving, resting, joints)

    return Levels(parents).descend(own, composed)


def _translations(moved: tuple[int, ...], moving: Array, resting: Array, joints) -> Array:
    """The translations of some joints, read from ``moving`` only for those that are ``moved``."""
    moves = np.isin(joints, moved)
    if not moves.any():
        return rows_of(resting, joints)
    place = np.where(moves, np.searchsorted(moved, joints), 0)
    if moves.all():
        return rows_of(moving, place)
    return jnp.where(moves[:, None, None], moving[place], resting[joints])


def composed(above: tuple[Lanes, Lanes] | None, own: tuple[Lanes, Lanes]) -> tuple[Lanes, Lanes]:
    """World rotation and position of joints by their parents' and their own; for ``descend``."""
    q, t = (jnp.unstack(x, axis=1) for x in own)
    q = normalized(q)
    if above is not None:
        parent, start = (jnp.unstack(x, axis=1) for x in above)
        q = product(parent, q)
        t = [a + b for a, b in zip(start, rotated(parent, t), strict=True)]
    return jnp.stack(q, 1), jnp.stack(t, 1)


def _squared_norm(q) -> Array:
    w, x, y, z = q
    return w * w + x * x + y * y + z * z


@_chain.defjvp
def _chain_jvp(parents, moved, primals, tangents):
    q, (dq, moving, resting) = primals[0], tangents
    dt = resting.at[np.array(moved, int)].set(moving, unique_indices=True)
    world, positions = _chain(parents, moved, *primals)
    above_all = np.maximum(parents, 0)
    root = (np.arange(len(parents)) == 0)[:, None, None]
    identity = jnp.array([1.0, 0.0, 0.0, 0.0], q.dtype)[:, None]
    above = jnp.where(root, identity, world[above_all])
    bone = jnp.where(root, 0, positions - positions[above_all])
    # The barrier keeps these gathers out of every product below.
    above, bone = jax.lax.optimization_barrier((above, bone))
    squared = _squared_norm(jnp.unstack(q, axis=1))[:, None]
    w, x, y, z = jnp.unstack(2 * q / jnp.where(squared > 0, squared, 1), axis=1)
    dw, dx, dy, dz = jnp.unstack(dq, axis=1)
    turn = (
        dx * w - dw * x + dz * y - dy * z,
        dy * w - dw * y + dx * z - dz * x,
        dz * w - dw * z + dy * x - dx * y,
    )
    own = _turned(above, turn)
    omega = _sum_over_ancestors(parents, own)
    swing = _cross(omega - own, bone)
    velocity = _sum_over_ancestors(parents, swing + _turned(above, jnp.unstack(dt, axis=1)))
    w, x, y, z = jnp.unstack(0.5 * world, axis=1)
    a, b, c = jnp.unstack(omega, axis=1)
    spin = [-a * x - b * y - c * z, a * w + b * z - c * y, b * w + c * x - a * z]
    return (world, positions), (jnp.stack([*spin, c * w + a * y - b * x], 1), velocity)


def _turned(q: Lanes, v) -> Lanes:
    """q v q̄ by the rows of the matrix: linear in v, so each derivative needs only one row."""
    w, x, y, z = jnp.unstack(q, axis=1)
    a, b, c = v
    return jnp.stack(
        [
            (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c,
            2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c,
            2 * (x * z - w * y) * a + 2 * (y * z + w * x) * b + (1 - 2 * (x * x + y * y)) * c,
        ],
        1,
    )


def _cross(a: Lanes, b: Lanes) -> Lanes:
    (x, y, z), (u, v, w) = jnp.unstack(a, axis=1), jnp.unstack(b, axis=1)
    return jnp.stack([y * w - z * v, z * u - x * w, x * v - y * u], 1)


def _sum_over_ancestors(parents: tuple[int, ...], x: Lanes) -> Lanes:
    tree = Levels(parents)
    root = (np.arange(len(parents)) == 0)[:, None, None]
    return jax.lax.custom_linear_solve(
        lambda y: y - jnp.where(root, 0, y[np.maximum(parents, 0)]),
        x,
        solve=lambda _, x: tree.descend(
            partial(rows_of, x), lambda above, own: own if above is None else above + own
        ),
        transpose_solve=lambda _, x: tree.ascend(x),
    )


class WorldVelocity(Portable):
    """How fast every joint moves and turns, in world axes.

    **Fields:** ``linear``: f[T, J, 3], file unit a second; ``angular``: f[T, J, 3], radians a
    second.
    """

    linear: Float[Array, "*batch time joint 3"]
    angular: Float[Array, "*batch time joint 3"]

    def _words(self) -> Iterator[str]:
        yield from moving(self.linear)
        yield kept_as(self.linear)


def velocities(motion: Motion) -> WorldVelocity:
    """Velocities of every joint in the world.

    Central differences of :func:`forward_kinematics`, one-sided at the ends; zero for one frame. A
    joint that turns by more than half a turn between the two frames is taken to turn the other way.
    O(T·J). Differentiable in both modes.

    **Arguments:** ``motion``: T frames, J joints; leading batch axes allowed.
    **Returns:** :class:`WorldVelocity`.

    **Example:**

        >>> import jaxmotion as jm
        >>> speed = jm.velocities(jm.samples.load("walk", speed=1.25).motion[:16])
        >>> round(float(speed.linear[:, 0, 2].mean()), 2)
        1.25
    """
    a_motion("velocities", motion)
    return _velocities(motion)


@eqx.filter_jit
def _velocities(motion: Motion) -> WorldVelocity:
    pose = forward_kinematics(motion)
    frames = motion.num_frames
    before = np.maximum(np.arange(frames) - 1, 0)
    after = np.minimum(np.arange(frames) + 1, frames - 1)
    seconds = motion.frame_time[..., None, None, None] * jnp.asarray(
        np.maximum(after - before, 1)[:, None, None], motion.dtype
    )
    x, q = pose.positions, pose.rotations
    linear = x[..., after, :, :] - x[..., before, :, :]
    turn = quaternion.multiply(q[..., after, :, :], quaternion.conjugate(q[..., before, :, :]))
    # A frame against itself: nothing, not the rounding of its product.
    angular = quaternion.log(turn) if frames > 1 else jnp.zeros_like(q[..., 1:])
    return WorldVelocity(linear / seconds, angular / seconds)


def mirrored_pairs(skeleton: Skeleton | Motion) -> tuple[tuple[int, int], ...]:
    """Joints whose names differ only in side.

    Sides are Left/Right, or an L and R that stand apart ("Hand_L") or lead a lower-case name, or a
    part of one, that has its twin ("lfemur", "__lthumb").

    **Arguments:** ``skeleton``: J joints, or a motion of them.
    **Returns:** (left, right) joint numbers, in the order of the left ones.
    """
    skeleton = skeleton_of("mirrored_pairs", skeleton)
    lower = {name.lower(): j for j, name in enumerate(skeleton.names)}
    pairs = []
    for name, j in lower.items():
        twins = [name.replace("left", "right")] if "left" in name else []
        parts = name.replace(".", "_").replace(":", "_").split("_")
        begins = list(itertools.accumulate((len(part) + 1 for part in parts), initial=0))
        if "l" in parts:
            twins.append(_with_r(name, begins[parts.index("l")]))
        twins += [
            twin
            for part, at in zip(parts, begins, strict=False)
            if part.startswith("l") and (twin := _with_r(name, at)) in lower
        ]
        pairs += [(j, lower[twin]) for twin in twins[:1] if twin in lower]
    return tuple(pairs)


def _with_r(name: str, at: int) -> str:
    return name[:at] + "r" + name[at + 1 :]


def facing_direction(
    motion: Motion, pairs: tuple[tuple[int, int], ...] | None = None
) -> Float[Array, "*batch time 3"]:
    """Unit vector on the ground plane that the body faces: left-minus-right × up.

    O(T·J). Differentiable in both modes.

    **Arguments:** ``motion``: T frames, J joints; leading batch axes allowed; ``pairs``: (left,
    right) joints that span the body, static; by default the mirrored joints nearest the root of
    each limb (hips, shoulders).
    **Returns:** f[T, 3]; the frames where left and right stand one above the other have none, and
    get the zero vector with zero gradient.
    **Raises:** ``ValueError`` for what is no motion, when the skeleton has no mirrored joints and
    none are given, or pairs are not of its joints.

    **Example:**

        >>> import jaxmotion as jm
        >>> facing = jm.facing_direction(jm.samples.load("walk").motion[:16])
        >>> facing.shape, bool(facing[:, 2].min() > 0.9)
        ((16, 3), True)
    """
    a_motion("facing_direction", motion)
    return _facing(
        motion,
        pairs if pairs is None else checked_pairs("facing_direction", pairs, motion.num_joints),
    )


def checked_pairs(caller: str, pairs, joints: int) -> tuple[tuple[int, int], ...]:
    """The pairs, if they are (left, right) numbers of joints that there are."""
    if not len(pairs):
        return ()
    wanted = f"{caller}: pairs must be (left, right) joints, each 0..{joints - 1}"
    if traced(pairs):
        raise ValueError(f"{wanted}, and not traced")
    numbers = np.asarray(pairs)
    fits = numbers.ndim == 2 and numbers.shape[1] == 2 and np.issubdtype(numbers.dtype, np.integer)
    if not fits or ((numbers < 0) | (numbers >= joints)).any():
        raise ValueError(f"{wanted}, got {pairs}")
    return tuple((left, right) for left, right in numbers.tolist())


@eqx.filter_jit
def _facing(
    motion: Motion, pairs: tuple[tuple[int, int], ...] | None
) -> Float[Array, "*batch time 3"]:
    pairs = _body_pairs(motion.skeleton) if pairs is None else pairs
    if not pairs:
        raise ValueError(
            "facing_direction: no left/right joints found by name; pass pairs=((left, right), ...)"
        )
    x = forward_kinematics(motion).positions
    left, right = (x[..., side, :] for side in np.asarray(pairs).T)
    up = jnp.asarray(np.eye(3)[motion.skeleton.up_axis], x.dtype)
    forward = jnp.cross(jnp.sum(left - right, axis=-2), up)
    squared = jnp.sum(forward**2, -1, keepdims=True)
    # Below this the positions' rounding alone would point somewhere.
    rounding = 8 * float(jnp.finfo(x.dtype).eps)
    least = rounding**2 * jnp.sum(left**2 + right**2, axis=(-2, -1))[..., None]
    usable = squared > least
    return jnp.where(usable, forward * jax.lax.rsqrt(jnp.where(usable, squared, 1)), 0)


def _body_pairs(skeleton: Skeleton) -> tuple[tuple[int, int], ...]:
    """Mirrored joints at the top of each limb: a pair on one parent, and the next pair down it
    (the first may sit on its parent, as CMU's hip joints do)."""
    pairs = mirrored_pairs(skeleton)
    parents = skeleton.parents
    tops = [(a, b) for a, b in pairs if parents[a] == parents[b]]
    return tuple(tops + [(a, b) for a, b in pairs if (parents[a], parents[b]) in tops])
