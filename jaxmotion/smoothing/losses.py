"""Robust losses ρ, and what a sample far from the fit is worth under them.

    huber    ρ(u) = u up to k², then 2k√u − k²       ρ'(u) = min(1, k/√u)       k = 1.345
    cauchy   ρ(u) = k² log(1 + u/k²)                 ρ'(u) = 1/(1 + u/k²)       k = 2.385

u: the square of a residual in standard deviations; l2 is ρ(u) = u. With k as it is, 95 % efficient
for normal noise (Holland & Welsch 1977). ρ' is the weight of the sample in reweighted least
squares.
"""

from typing import Literal, TypeAlias

import jax.numpy as jnp
from jaxtyping import Array, Float

Loss: TypeAlias = Literal["huber", "cauchy"]

# k, where each loss bends, in standard deviations.
BEND = {"huber": 1.345, "cauchy": 2.385}


def slope(u: Float[Array, "..."], loss: Literal["l2", "huber", "cauchy"]) -> Float[Array, "..."]:
    """ρ'(u), from 0 to 1."""
    if loss == "l2":
        return jnp.ones_like(u)
    k = BEND[loss]
    if loss == "cauchy":
        return 1 / (1 + u / (k * k))
    inside = u <= k * k
    return jnp.where(inside, 1.0, k / jnp.sqrt(jnp.where(inside, 1.0, u)))


def slack(u: Float[Array, "..."], loss: Literal["l2", "huber", "cauchy"]) -> Float[Array, "..."]:
    """ρ(u) − u ρ'(u) ≥ 0: what the loss is above its reweighted squares."""
    if loss == "l2":
        return jnp.zeros_like(u)
    k = BEND[loss]
    if loss == "cauchy":
        return k * k * jnp.log1p(u / (k * k)) - u * slope(u, loss)
    inside = u <= k * k
    return jnp.where(inside, 0.0, k * jnp.sqrt(jnp.where(inside, 1.0, u)) - k * k)
