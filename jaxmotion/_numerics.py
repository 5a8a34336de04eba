"""Floating-point helpers whose values and derivatives stay finite at the singular places.

A branch guarded only by ``where`` still differentiates the branch it throws away, and
``0 · inf`` is NaN; so each function here replaces the *input* of the dangerous branch first.

Symbols: θ is an angle in radians, x = θ². Series are cut where the next term falls below the
rounding error of the dtype, at x < eps^(1/3).
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmotion._types import AnyArray


def series_switch(dtype) -> float:
    """Squared argument below which a three-term series is exact to rounding."""
    return float(jnp.finfo(dtype).eps) ** (1.0 / 3.0)


def safe_sqrt(x: Float[AnyArray, "..."], floor: float | Array = 0.0) -> Float[Array, "..."]:
    """√x for x ≥ 0 with value and derivative 0, not infinity, where x ≤ ``floor`` (a number, or
    one for each of x); NaN of NaN."""
    flat = x <= floor
    return jnp.where(flat, 0.0, jnp.sqrt(jnp.where(flat, 1.0, x)))


def rounding_angle(dtype) -> float:
    """Angle in radians by which rounding alone can turn a product of two unit quaternions."""
    return 4 * float(jnp.finfo(dtype).eps)


def safe_norm(
    v: Float[AnyArray, "..."], axis: int = -1, keepdims: bool = False
) -> Float[Array, "..."]:
    """Euclidean norm along ``axis`` with gradient 0 at the zero vector."""
    return safe_sqrt(jnp.sum(v * v, axis=axis, keepdims=keepdims))


def safe_arctan2(y: Float[AnyArray, "..."], x: Float[AnyArray, "..."]) -> Float[Array, "..."]:
    """atan2(y, x), with value and gradient 0 at the origin."""
    somewhere = (x != 0) | (y != 0)
    return jnp.where(somewhere, jnp.arctan2(y, jnp.where(somewhere, x, 1.0)), 0.0)


def cos_half(x: Float[AnyArray, "..."]) -> Float[Array, "..."]:
    """cos(θ/2) as a smooth function of x = θ²."""
    far = x > series_switch(x.dtype)
    theta = jnp.sqrt(jnp.where(far, x, 1.0))
    near = 1.0 - x * (1.0 / 8.0 - x * (1.0 / 384.0 - x / 46080.0))
    return jnp.where(far, jnp.cos(0.5 * theta), near)


def sin_half_over(x: Float[AnyArray, "..."]) -> Float[Array, "..."]:
    """sin(θ/2)/θ as a smooth function of x = θ²; ½ at 0."""
    far = x > series_switch(x.dtype)
    theta = jnp.sqrt(jnp.where(far, x, 1.0))
    near = 0.5 - x * (1.0 / 48.0 - x * (1.0 / 3840.0 - x / 645120.0))
    return jnp.where(far, jnp.sin(0.5 * theta) / theta, near)


def angle_over_sine(s2: Float[AnyArray, "..."], w: Float[AnyArray, "..."]) -> Float[Array, "..."]:
    """2·atan2(s, w)/s for s = √s2 ≥ 0 and w ≥ 0: the factor of the quaternion logarithm.

    Scaling s and w together divides it by the scale, so the switch compares s2 with w²; 2 where
    both vanish."""
    far = s2 > series_switch(s2.dtype) * w * w
    s = jnp.sqrt(jnp.where(far, s2, 1.0))
    w_near = jnp.where(far | (w == 0), 1.0, w)
    r2 = jnp.where(far, 0.0, s2) / (w_near * w_near)
    near = 2.0 / w_near * (1.0 - r2 * (1.0 / 3.0 - r2 * (1.0 / 5.0 - r2 / 7.0)))
    return jnp.where(far, 2.0 * jnp.arctan2(s, w) / s, near)
