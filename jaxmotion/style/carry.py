"""A motion carried from its own manner to another: Eq. 4 and 7 of Wu et al. 2006, and past them.

    q′ = q q̄_s⁻¹ q̄_r ("right") or q̄_r q̄_s⁻¹ q ("left");   q = q̄_r exp(A log(q̄_r⁻¹ q′))
    x = (σ_r/σ_s)(x_s − x̄_s) + x̄_r                             channels of the root

    scalar       A = σ_r/σ_s                                      Eq. 7: slerp from q̄_r
    covariance   A C_s A = C_r                                    Gaussian optimal transport

"right" keeps deviations as the parent sees them, "left" as the joint itself does. With the
covariance each direction has its own ratio: a hinge stays a hinge. What is still, σ_s below 0.001
rad (0.06°; a direction's, with the covariance), counts as 0.001: there is nothing to scale but
rounding. Ratios may be capped.

With the tempo, time is stretched first, by ω̄_s/ω̄_r: frames stay what they are, each lasts longer.
The source's channels a second are those of its own time, of which its statistics are.

The body stands on the floor it stood on: after all, the root is put as far up as the lowest joint
has sunk, so that the mean height is that of a body in these poses. O(T·J).
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmotion import quaternion
from jaxmotion._types import AnyArray
from jaxmotion.linalg.symmetric import symmetric_function
from jaxmotion.motion import Motion
from jaxmotion.style.root import Start, decode
from jaxmotion.style.statistics import STILL, MotionStyle, deviations, square_root


def carried(
    motion: Motion,
    count: Int[Array, ""],
    body: tuple[Float[Array, "time 6"], Start],
    own: MotionStyle,
    goal: MotionStyle,
    *,
    joints: tuple[bool, ...],
    root: bool,
    deviation: str,
    side: str,
    cap: Float[AnyArray, ""] | None,
) -> Motion:
    """The motion, of which the first ``count`` frames count, with ``goal``'s statistics for its
    ``own``, of these ``joints`` and of the ``root``. ``body``: its channels, as ``encode`` gives
    them for the goal."""
    away = deviations(own.mean, motion.rotations, count)
    covariance = jnp.asarray(own.covariance)
    if side == "right":
        turn = quaternion.between(goal.mean, own.mean)
        away = quaternion.rotate(turn, away)
        matrix = quaternion.to_matrix(turn)
        covariance = matrix @ covariance @ jnp.swapaxes(matrix, -1, -2)
    if deviation == "covariance":
        matrix = transport(covariance, jnp.asarray(goal.covariance), cap)
        away = jnp.einsum("jab,tjb->tja", matrix, away)
    else:
        away = ratio(own.deviation, goal.deviation, cap)[:, None] * away
    turned = quaternion.multiply(goal.mean, quaternion.exp(away))
    first = jnp.sum(turned[:1] * motion.rotations[:1], axis=-1, keepdims=True) < 0
    turned = jnp.where(first, -turned, turned)
    rotations = jnp.where(np.asarray(joints)[:, None], turned, motion.rotations)
    edited = motion.with_transforms(rotations=rotations)
    if not root:
        return edited
    channels, start = body
    channels = _root_ratio(own, goal, cap) * (channels - own.root_mean) + goal.root_mean
    return decode(channels, start, goal.root_upright, edited, count)


def how_much_longer(own: Float[AnyArray, ""], goal: Float[AnyArray, ""]) -> Float[Array, ""]:
    """ω̄_s/ω̄_r, by which time is stretched from one tempo to the other; 1 where either is still."""
    own, goal = jnp.asarray(own), jnp.asarray(goal)
    still = (own <= 0) | (goal <= 0)
    return jnp.where(still, 1, own / jnp.where(still, 1, goal))


def ratio(
    own: Float[AnyArray, "..."], goal: Float[AnyArray, "..."], cap: Float[AnyArray, ""] | None
) -> Float[Array, "..."]:
    """σ_r/σ_s, capped."""
    found = goal / jnp.maximum(own, STILL)
    return found if cap is None else jnp.minimum(found, cap)


def _root_ratio(
    own: MotionStyle, goal: MotionStyle, cap: Float[AnyArray, ""] | None
) -> Float[Array, "6"]:
    """Of the root's channels, which have units of their own: still is what rounding makes of the
    larger of the two."""
    mine, theirs = jnp.asarray(own.root_deviation), jnp.asarray(goal.root_deviation)
    size = jnp.maximum(abs(own.root_mean) + mine, abs(goal.root_mean) + theirs)
    nothing = size < float(jnp.finfo(mine.dtype).tiny) ** 0.25
    found = theirs / jnp.where(nothing, 1, jnp.maximum(mine, STILL * size))
    return found if cap is None else jnp.minimum(found, cap)


def transport(
    own: Float[AnyArray, "joint 3 3"],
    goal: Float[AnyArray, "joint 3 3"],
    cap: Float[AnyArray, ""] | None = None,
) -> Float[Array, "joint 3 3"]:
    """The symmetric A ≥ 0 with A C_s A = C_r, of a C_s whose eigenvalues are 0.001² at least; no
    more than the cap in each of its directions."""
    least = STILL**2
    root = symmetric_function(lambda w: jnp.sqrt(jnp.maximum(w, least)), own)
    inverse = symmetric_function(lambda w: 1 / jnp.sqrt(jnp.maximum(w, least)), own)
    found = inverse @ square_root(root @ goal @ root) @ inverse
    found = 0.5 * (found + jnp.swapaxes(found, -1, -2))
    return found if cap is None else symmetric_function(lambda w: jnp.minimum(w, cap), found)
