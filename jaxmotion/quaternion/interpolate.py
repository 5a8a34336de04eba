"""Spherical linear interpolation.

    slerp_t(a, b) = a ⊗ (a⁻¹b)^t = (sin((1−t)θ/2)·a + sin(tθ/2)·b) / sin(θ/2)

with θ the angle from a to b. Goes the short way round (b and −b give the same rotations), at
constant angular speed; any real t extrapolates. Computed from the right-hand side, whose weights
are smooth in θ² (series near 0), so a = b is no special case. O(n).
"""

import jax.numpy as jnp

from jaxmotion._numerics import angle_over_sine, sin_half_over
from jaxmotion._program import one_program
from jaxmotion._types import ArrayLike, Quaternion
from jaxmotion.quaternion.algebra import half_angle_between


@one_program()
def slerp(a: Quaternion, b: Quaternion, t: ArrayLike) -> Quaternion:
    """Rotation a fraction ``t`` of the way from a to b along the shortest arc.

    Source: Shoemake 1985.

    **Arguments:** ``a``, ``b``: f[..., 4], unit, broadcast; ``t``: broadcasts with their leading
    axes; 0 gives a, 1 gives b (up to sign).
    **Returns:** f[..., 4], unit.
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    a, b = jnp.asarray(a), jnp.asarray(b)
    squared_sine, cosine = half_angle_between(a, b)
    squared_angle = squared_sine * angle_over_sine(squared_sine, jnp.abs(cosine)) ** 2
    t = jnp.asarray(t, a.dtype)
    rest = 1.0 - t
    whole = sin_half_over(squared_angle)
    of_a = rest * sin_half_over(rest**2 * squared_angle) / whole
    of_b = t * sin_half_over(t**2 * squared_angle) / whole
    of_b = jnp.where(cosine < 0, -of_b, of_b)
    return of_a[..., None] * a + of_b[..., None] * b
