"""A clip as a mirror shows it, on the same skeleton: what the left did the right does.

With M the reflection in an upright plane, σ(j) the joint on the other side (j itself in the middle)
and G_j the rotation of joint j in the world,

    G'_j = M G_σ(j) S_j

where S_j, improper and constant, says how the axes of σ(j) lie when those of j are seen in a
mirror. Rigs of two sides are built alike, and then S_j is one of four: −1, or the reflection of one
axis. As −S_j is the rotation by a quaternion r_j ∈ {1, i, j, k}, a joint's own rotation becomes

    q'_j = r̄_p ⊗ q_σ(j) ⊗ r_j               p the parent of j
    t'_j = o_j − r̄_p (t_σ(j) − o_σ(j)) r_p  from its OFFSET o, so that bones keep their lengths

which for a T-pose of identities, where all r are i, is (w, x, −y, −z). Which they are:

    1. the body's    the axis along which left and right joints lie apart
    2. the others'   l̄_σ(j) ⊗ r_p ⊗ l_j rounded to one of the four, l a pose in which the body
                     stands alike on both sides: one that takes the bones that hang from σ(j) to
                     those that hang from j, of these the nearest, and r_p unless another is nearer
                     by far, as rigs lay axes along a limb

The pose is the rest pose, if its bones mirror each other to a tenth of their length, else the mean
pose of a clip. What is chosen passes no gradient. Joints above the body stay as they are. O(T·J).
"""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxmotion import quaternion
from jaxmotion._checks import fault, one_of, raise_faults
from jaxmotion._entry import one_clip
from jaxmotion._file_facts import compiled
from jaxmotion._levels import Levels
from jaxmotion._posture import hung, pose_in_world
from jaxmotion._program import one_program
from jaxmotion._types import Vector3
from jaxmotion.kinematics import checked_pairs, composed, mirrored_pairs
from jaxmotion.motion import Motion
from jaxmotion.quaternion.parts import conjugate, product
from jaxmotion.skeleton import Skeleton

__all__ = ["mirror"]

_ALIKE = 0.1  # of the bones' lengths
_AS_ABOVE = 0.75  # of a quaternion's length
_SIGNS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])  # v ↦ r̄ v r, r = 1, i, j, k


def mirror(
    motion: Motion,
    plane: Literal["body", "x", "y", "z"] = "body",
    *,
    pairs: tuple[tuple[int, int], ...] | None = None,
    reference: Motion | None = None,
) -> Motion:
    """A clip as a mirror shows it, left and right exchanged, on the same skeleton.

    Mirrored again it is the clip, up to signs of quaternions. Bones keep their lengths: where those
    of left and right differ, a foot ends up that much from where the mirror shows it.

    O(T·J). Differentiable in both modes; NaN stays in its joint and frame, and in those below.

    **Arguments:** ``motion``: one clip, T frames, J joints; ``plane``: of the mirror: upright,
    through the body's first place and along the way its hips face there, so that it sets out alike
    ("body"), or through the origin across an axis of the world that does not point up; static;
    ``pairs``: (left, right) joints, by default those whose names differ in side; static;
    ``reference``: a clip of the same joints that moves alike on both sides, a walk, to learn from
    how the axes of left and right joints mirror each other where the rest pose does not show it;
    by default the clip itself.
    **Returns:** a motion of the same skeleton and frames.
    **Raises:** ``ValueError`` for a plane across the axis that points up, no pairs, pairs that are
    not mirror images in the tree of joints, a reference of other joints; and as
    :func:`jaxmotion.checks` says, where the body lies on its side in the first frame and the plane
    is "body", or bones of left and right do not mirror each other in any way that is tried.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk", num_frames=64).motion
        >>> other = jm.mirror(walk)
        >>> left, right = walk.skeleton.index("LeftLeg"), walk.skeleton.index("RightLeg")
        >>> bool((other.rotations[:, left, 1] == walk.rotations[:, right, 1]).all())
        True
    """
    one_clip("mirror", motion)
    one_of("mirror: plane", plane, ("body", "x", "y", "z"))
    skeleton = motion.skeleton
    if plane == skeleton.up:
        raise ValueError(f"mirror: plane={plane!r} is across the axis that points up")
    if reference is not None:
        one_clip("mirror", reference, "reference")
        if reference.skeleton.names != skeleton.names:
            raise ValueError("mirror: reference has other joints than motion")
    other = _other_side(skeleton, motion.body_joint, pairs)
    turns, alike = _turns(
        skeleton.parents,
        other,
        motion.body_joint,
        *_usual(motion if reference is None else reference),
    )
    if plane == "body":
        normal, through, lost = _of_body(motion[:1], turns)
    else:
        normal = jnp.asarray(np.eye(3)["xyz".index(plane)], motion.dtype)
        through, lost = jnp.zeros_like(normal), False
    return raise_faults(
        _mirrored(motion, turns, normal, through, other),
        fault(lost, "mirror: the body lies on its side in the first frame; give another plane=")
        + fault(
            ~alike,
            "mirror: the axes of left and right joints do not mirror each other; give reference=, "
            "a clip that moves alike on both sides, or other pairs=",
        ),
    )


def _other_side(skeleton: Skeleton, body: int, pairs) -> tuple[int, ...]:
    """σ. ``ValueError`` unless it takes the tree to itself."""
    if pairs is None:
        pairs = mirrored_pairs(skeleton)
    pairs = checked_pairs("mirror", pairs, skeleton.num_joints)
    if not pairs:
        raise ValueError(
            "mirror: no left/right joints found by name; pass pairs=((left, right), ...)"
        )
    other = list(range(skeleton.num_joints))
    for left, right in pairs:
        if other[left] != left or other[right] != right or left == right:
            raise ValueError(f"mirror: pairs name {skeleton.names[left]!r} twice")
        other[left], other[right] = right, left
    for j, p in enumerate(skeleton.parents):
        above = -1 if p < 0 else other[p]
        if skeleton.parents[other[j]] != above or (j <= body and other[j] != j):
            raise ValueError(
                f"mirror: {skeleton.names[j]!r} and {skeleton.names[other[j]]!r} do not hang from "
                "joints that are a pair, or the same; pass other pairs="
            )
    return tuple(other)


@eqx.filter_jit
def _usual(
    clip: Motion,
) -> tuple[Float[Array, "joint 4 4"], Float[Array, "joint 3"]]:
    """Σ q qᵀ, whose first eigenvector is the mean rotation, and mean translations, of what is
    finite."""
    q, p = jax.lax.stop_gradient((clip.rotations, clip.translations))
    q = jnp.where(jnp.all(jnp.isfinite(q), axis=-1, keepdims=True), q, 0)
    return jnp.einsum("tja,tjb->jab", q, q), jnp.mean(p, axis=0, where=jnp.isfinite(p))


@one_program("parents", "other", "body")
def _turns(
    parents: tuple[int, ...],
    other: tuple[int, ...],
    body: int,
    moments: Float[Array, "joint 4 4"],
    bones: Float[Array, "joint 3"],
) -> tuple[Float[Array, "joint 4"], Bool[Array, ""]]:
    """r of every joint, by the rest pose or else by the mean pose, and whether bones of left and
    right mirror each other then."""
    side, above = np.array(other), np.maximum(parents, 0)
    below = np.arange(len(parents))[:, None] > body
    bones = jnp.where(below, bones, 0)
    rest = jnp.broadcast_to(jnp.eye(4, dtype=bones.dtype)[0], (len(parents), 4))
    mean = jnp.where(below, jnp.linalg.eigh(moments)[1][..., -1], rest)
    apart = _apart(parents, side, jnp.stack([rest, mean], -1), bones)

    # How far bones are from being mirrored by each of 1, i, j and k, of those that hang from each
    # joint as a share.
    by_each = bones[:, None] + _SIGNS.astype(bones.dtype) * bones[side][:, None]
    length, missed = (jnp.linalg.norm(x, axis=-1) for x in (bones, by_each))
    hanging = jax.ops.segment_sum(jnp.c_[missed, length], above, len(parents))
    missed_below = hanging[:, :4] / jnp.where(hanging[:, 4:] > 0, hanging[:, 4:], 1)

    def joined(above, own):
        pose, of_other, missed = own
        if above is None:
            likely = apart[..., 1:]
        else:
            likely = jnp.abs(_triple(of_other, above, pose)) + _AS_ABOVE * above
        best = jnp.argmax(likely - missed, axis=1, keepdims=True)
        return (best == np.arange(4)[:, None]).astype(bones.dtype)

    lanes = mean[..., None], mean[side][..., None], missed_below[..., None]
    by_mean = Levels(parents).descend(lambda joints: tuple(x[joints] for x in lanes), joined)
    by_rest = jnp.argmax(apart[0, :, 0]) == np.arange(4)
    both = jnp.stack([jnp.broadcast_to(by_rest.astype(bones.dtype), rest.shape), by_mean[..., 0]])
    alike = jnp.sum(missed * both[:, above], axis=(1, 2)) <= _ALIKE * jnp.sum(length)
    return jnp.where(alike[0], *both), jnp.any(alike)


@eqx.filter_jit
def _of_body(
    first: Motion, turns: Float[Array, "joint 4"]
) -> tuple[Vector3, Vector3, Bool[Array, ""]]:
    """Normal of the upright plane that the hips are mirrored in, a point of it, and whether there
    is none."""
    body, up = first.body_joint, first.skeleton.up_axis
    position, turned = pose_in_world(first, body)
    aside = quaternion.rotate(turned[0], turns[body, 1:]).at[up].set(0)
    squared = jnp.sum(aside**2)
    lost = squared <= (8 * jnp.finfo(aside.dtype).eps) ** 2
    return aside * jax.lax.rsqrt(jnp.where(lost, 1, squared)), position[0], lost


def _apart(
    parents: tuple[int, ...], side: np.ndarray, poses: Array, bones: Float[Array, "joint 3"]
) -> Float[Array, "1 4 pose"]:
    """How far left and right joints lie apart along each axis of the body, as a share, before
    which stands a zero."""

    def own(joints):
        place = jnp.broadcast_to(bones[joints][..., None], (len(joints), 3, poses.shape[-1]))
        return poses[joints], place

    places = Levels(parents).descend(own, composed)[1]
    left = np.flatnonzero(side > np.arange(len(side)))
    apart = jnp.abs(jnp.sum(places[left] - places[side[left]], axis=0))
    apart = apart / jnp.maximum(jnp.max(apart, axis=0), jnp.finfo(apart.dtype).tiny)
    return jnp.concatenate([jnp.zeros_like(apart[:1]), apart])[None]


def _triple(of_other: Array, above: Array, pose: Array) -> Array:
    """conj(of_other) ⊗ above ⊗ pose, of lanes."""
    a, b, c = (tuple(jnp.unstack(x, axis=1)) for x in (of_other, above, pose))
    return jnp.stack(product(conjugate(a), product(b, c)), axis=1)


@compiled
def _mirrored(
    motion: Motion,
    turns: Float[Array, "joint 4"],
    normal: Vector3,
    through: Vector3,
    other: tuple[int, ...],
) -> Motion:
    """The mirrored motion, of the r of every joint and the plane."""
    skeleton, body, side = motion.skeleton, motion.body_joint, np.array(other)
    above = turns[np.maximum(skeleton.parents, 0)]
    rotations = quaternion.multiply(
        quaternion.conjugate(above), quaternion.multiply(motion.rotations[:, side], turns)
    )
    offsets = jnp.asarray(skeleton.offsets, motion.dtype)
    away = motion.translations[:, side] - offsets[side]
    moved = offsets - quaternion.rotate(quaternion.conjugate(above), away)
    stays = np.arange(skeleton.num_joints)[:, None] <= body  # the body's own place comes last
    translated = motion.translated_joints
    mirrored = motion.replace(
        translations=jnp.where(stays, motion.translations, moved),
        rotations=jnp.where(stays, motion.rotations, rotations),
        translated_joints=tuple(sorted({body, *translated, *(other[j] for j in translated)})),
    )
    position, turned = pose_in_world(motion, body)
    position -= 2 * jnp.sum((position - through) * normal, -1, keepdims=True) * normal
    half_turn = jnp.concatenate([jnp.zeros_like(normal[:1]), normal])
    turned = quaternion.multiply(
        quaternion.conjugate(half_turn), quaternion.multiply(turned, turns[body])
    )
    return hung(mirrored, body, position, turned)
