"""Spherical linear interpolation: slerp_t(a, b) = a ⊗ exp(t·log(a⁻¹b)).

Goes the short way round (b and −b give the same rotations), at constant angular speed; any real t
extrapolates. O(n).
"""

import jax.numpy as jnp

from jaxmotion._types import ArrayLike, Quaternion
from jaxmotion.quaternion.algebra import between, multiply
from jaxmotion.quaternion.explog import exp, log


def slerp(a: Quaternion, b: Quaternion, t: ArrayLike) -> Quaternion:
    """Rotation a fraction ``t`` of the way from a to b along the shortest arc.

    **Arguments:** ``a``, ``b``: (..., 4), unit, broadcast; ``t``: broadcasts with their leading
    axes; 0 gives a, 1 gives b (up to sign).
    **Returns:** (..., 4), unit. Source: Shoemake 1985, in the form of Lee & Shin 2001.
    """
    v = log(between(a, b))
    return multiply(a, exp(jnp.asarray(t, v.dtype)[..., None] * v))
