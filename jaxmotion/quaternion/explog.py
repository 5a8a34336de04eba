"""Exponential and logarithm maps between rotation vectors and unit quaternions.

    exp(v)      = (cos(‖v‖/2), sin(‖v‖/2)·v/‖v‖)     turns by ‖v‖; Eom et al. 2019
    exp_half(v) = exp(2v)                              turns by 2‖v‖; Lee & Shin, Wu, Aristidou
    log(q)      = 2·atan2(‖u‖, w)·u/‖u‖,  q = (w, u) with the sign that makes w ≥ 0
    log_half(q) = log(q)/2

``log(q) = log(−q)`` and ‖log(q)‖ ≤ π. Series take over near the identity, so values and gradients
are finite everywhere; at angle π the axis may be either of two, and one is returned.
Broadcast over leading axes, O(n).
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmotion._numerics import (
    angle_over_sine,
    cos_half,
    rounding_angle,
    safe_arctan2,
    safe_sqrt,
    sin_half_over,
)
from jaxmotion._program import one_program
from jaxmotion._types import ArrayLike, Quaternion, Vector3
from jaxmotion.quaternion.algebra import components, half_angle_between
from jaxmotion.quaternion.parts import together


@one_program()
def exp(v: Vector3) -> Quaternion:
    """Unit quaternion that turns by ‖v‖ radians about v.

    Source: Eom et al. 2019, §3.

    **Arguments:** ``v``: f[..., 3], radians.
    **Returns:** f[..., 4], unit.
    **Raises:** ``ValueError`` where the last axis is not 3.
    """
    x, y, z = components(v, 3, "v")
    squared = x * x + y * y + z * z
    s = sin_half_over(squared)
    return together((cos_half(squared), s * x, s * y, s * z))


@one_program()
def log(q: Quaternion) -> Vector3:
    """Rotation vector of q, full angle, ‖log(q)‖ ≤ π; q and −q agree.

    Source: Eom et al. 2019, Eq. 9 and 13.

    **Arguments:** ``q``: f[..., 4]; only its direction matters.
    **Returns:** f[..., 3], radians.
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    w, x, y, z = components(q, 4, "q")
    sign = jnp.where(w < 0, -1.0, 1.0).astype(w.dtype)
    factor = sign * angle_over_sine(x * x + y * y + z * z, sign * w)
    return together((factor * x, factor * y, factor * z))


@one_program()
def exp_half(v: Vector3) -> Quaternion:
    """Unit quaternion that turns by 2‖v‖ radians about v.

    Source: Lee & Shin 2001, §2.

    **Arguments:** ``v``: f[..., 3], half the angle in radians.
    **Returns:** f[..., 4], unit.
    **Raises:** ``ValueError`` where the last axis is not 3.
    """
    return exp(2 * jnp.asarray(v))


@one_program()
def log_half(q: Quaternion) -> Vector3:
    """Half the rotation vector of q: its norm is arc length on S³.

    **Arguments:** ``q``: f[..., 4]; only its direction matters.
    **Returns:** f[..., 3], half the angle in radians.
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    return 0.5 * log(q)


@one_program()
def power(q: Quaternion, t: ArrayLike) -> Quaternion:
    """q to the power t: the same axis, t times the (shortest) angle.

    **Arguments:** ``q``: f[..., 4], unit; ``t``: broadcasts with q's leading axes.
    **Returns:** f[..., 4], unit.
    **Raises:** ``ValueError`` where the last axis of q is not 4.
    """
    v = log(q)
    return exp(jnp.asarray(t, v.dtype)[..., None] * v)


@one_program()
def distance(a: Quaternion, b: Quaternion) -> Float[Array, "..."]:
    """Angle of the rotation between a and b, in [0, π].

    0 with gradient 0 where they agree to rounding. Source: Lee & Shin 2001, Eq. 22, who measure
    half of it (arc length on S³).

    **Arguments:** ``a``, ``b``: f[..., 4], unit, broadcast.
    **Returns:** f[...], radians.
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    squared, cosine = half_angle_between(a, b)
    sine = safe_sqrt(squared, (0.5 * rounding_angle(squared.dtype)) ** 2)
    return 2 * safe_arctan2(sine, jnp.abs(cosine))
