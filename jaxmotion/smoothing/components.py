"""Rotations as signals for a linear smoother, and back.

    chordal   the four components of quaternions whose signs are settled; back by renormalising
    rotvec    the three of log(q), which break where the logarithm wraps; back by exp

Where smoothed components cancel (‖x‖ < 1e−6) there is no rotation, and the identity is returned.
Shapes: rotations f[Nd, ..., 4], signals f[Nd, ..., C]. O(Nd).
"""

from typing import Literal, TypeAlias

import jax.numpy as jnp
from jaxtyping import Array

from jaxmotion import quaternion
from jaxmotion._checks import known
from jaxmotion._numerics import safe_norm
from jaxmotion._program import one_program
from jaxmotion._types import AnyArray, ArrayLike
from jaxmotion.frames.runs import held

Coordinates: TypeAlias = Literal["chordal", "rotvec"]
Signs: TypeAlias = Literal["nearest", "input", "min_energy"]


def to_components(
    q: AnyArray,
    weights: AnyArray | None,
    index: ArrayLike | None = None,
    method: Coordinates = "chordal",
    signs: Signs = "nearest",
) -> Array:
    """What the linear smoother works on. Samples of weight 0 take a neighbour's value; ``index``:
    where the data stand in time; ``signs`` as ``smooth_quaternions``."""
    if weights is not None:
        q = held(q, per_component(weights, q) > 0)
    if signs != "input":
        q = _signed_in_time(q, None if index is None else known(index), signs)
    return q if method == "chordal" else quaternion.log(q)


@one_program("method")
def from_components(x: Array, method: Coordinates = "chordal") -> Array:
    """Back from smoothed components."""
    if method == "rotvec":
        return quaternion.exp(x)
    cancelled = safe_norm(x, keepdims=True) < 1e-6
    return quaternion.normalize(jnp.where(cancelled, 0, x))


def per_component(weights: AnyArray, q: AnyArray) -> Array:
    """Weights (Nd,) or (Nd, ...) with unit axes up to q's rank."""
    return weights.reshape(weights.shape + (1,) * (q.ndim - weights.ndim))


@one_program("signs")
def _signed_in_time(q: AnyArray, index: ArrayLike | None, signs: Signs) -> Array:
    least = signs == "min_energy"
    if index is None:
        return quaternion.least_energy_signs(q) if least else quaternion.align_signs(q)
    index = jnp.asarray(index)
    in_time = jnp.argsort(index)
    ordered, times = q[in_time], index[in_time].astype(q.dtype)
    signed = (
        quaternion.least_energy_signs(ordered, times) if least else quaternion.align_signs(ordered)
    )
    return signed[jnp.argsort(in_time)]
