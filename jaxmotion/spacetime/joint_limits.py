"""Joint limits: how far each joint may turn, as a box about a resting rotation.

    v_j = log(c_j^-1 q_j)                  turn of joint j from its centre c_j, a rotation vector
    lower_j <= v_j <= upper_j              each component by itself, radians; +-infinity: no limit

Learned from clean clips, c_j is the chordal mean of the joint's rotations and the box holds all of
them (or a share), widened by a margin. The root turns freely. Cost O(T J log T) to learn.
"""

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmotion import quaternion
from jaxmotion._entry import finite_clip
from jaxmotion._portable import Portable
from jaxmotion._types import AnyArray, ArrayLike, Quaternion, ScalarLike
from jaxmotion.motion import Motion


class JointLimits(Portable):
    """A box about a resting rotation for each joint's turn.

    **Arguments:** ``lower``, ``upper``: f[J, 3], radians, of the turn's rotation vector, +-infinity
    for no limit; ``centre``: f[J, 4], unit quaternions, the resting rotations, the identity by
    default.
    **Raises:** ``ValueError`` for shapes that do not fit.
    """

    lower: Float[AnyArray, "joint 3"]
    upper: Float[AnyArray, "joint 3"]
    centre: Float[AnyArray, "joint 4"]

    def __init__(self, lower: ArrayLike, upper: ArrayLike, centre: ArrayLike | None = None):
        self.lower, self.upper = jnp.asarray(lower), jnp.asarray(upper)
        joints = self.lower.shape[:1]
        if centre is None:
            centre = quaternion.identity(joints, self.lower.dtype)
        self.centre = jnp.asarray(centre)
        for name, size in (("lower", 3), ("upper", 3), ("centre", 4)):
            if getattr(self, name).shape != (*joints, size):
                raise ValueError(
                    f"JointLimits: {name} has shape {getattr(self, name).shape}; expected "
                    f"{(*joints, size)}, (joints, {size})"
                )

    def turns(self, rotations: Quaternion) -> Float[Array, "*batch joint 3"]:
        """v: rotation vectors f[..., J, 3] of local rotations about the centres."""
        return quaternion.log(quaternion.between(self.centre, rotations))

    def excess(self, rotations: Quaternion) -> Float[Array, "*batch joint 3"]:
        """How far beyond the box, radians, signed; 0 inside. f[..., J, 3]."""
        v = self.turns(rotations)
        return jnp.maximum(v - self.upper, 0) - jnp.maximum(self.lower - v, 0)

    def of(self, joints: Sequence[int] | Int[Array, " some"]) -> "JointLimits":
        """The limits of some joints, in that order."""
        rows = jnp.asarray(joints, int)
        return JointLimits(self.lower[rows], self.upper[rows], self.centre[rows])

    def astype(self, dtype) -> "JointLimits":
        """The same in another floating-point type."""
        return JointLimits(*(jnp.asarray(x, dtype) for x in (self.lower, self.upper, self.centre)))


def learn_limits(
    motions: Motion | Sequence[Motion], *, margin: ScalarLike = 0.05, coverage: float = 1.0
) -> JointLimits:
    """Limits that clean clips of one skeleton keep.

    **Arguments:** ``motions``: one or more clips, J joints each; ``margin``: radians added on every
    side; ``coverage``: share of the frames that the box holds in each component, in (0, 1], less
    than 1 to leave outliers out.
    **Returns:** :class:`JointLimits` of J joints, the root's infinite.
    **Raises:** ``ValueError`` for no clips, what is not one clip of finite numbers, clips of
    different skeletons, a bad coverage.
    """
    clips = list(motions) if isinstance(motions, Sequence) else [motions]
    for clip in clips:
        finite_clip("learn_limits", clip, "motions")
    if not clips or len({clip.skeleton.names for clip in clips}) > 1:
        raise ValueError(
            f"learn_limits: motions holds {len(clips)} clips; expected one or more, of one skeleton"
        )
    if not 0 < coverage <= 1:
        raise ValueError(f"learn_limits: coverage={coverage}; expected a share in (0, 1]")
    q = jnp.concatenate([clip.rotations for clip in clips])
    return _learn(q, jnp.asarray(margin, q.dtype), float(coverage))


@partial(jax.jit, static_argnums=2)
def _learn(q: Quaternion, margin: Float[Array, ""], coverage: float) -> JointLimits:
    centre = quaternion.mean(q, method="chordal")
    v = quaternion.log(quaternion.between(centre, q))
    outside = jnp.asarray([0.5 - 0.5 * coverage, 0.5 + 0.5 * coverage], q.dtype)
    lower, upper = jnp.quantile(v, outside, axis=0)
    free = jnp.arange(centre.shape[0])[:, None] == 0
    return JointLimits(
        jnp.where(free, -jnp.inf, lower - margin), jnp.where(free, jnp.inf, upper + margin), centre
    )
