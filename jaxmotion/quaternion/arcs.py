"""Arcs: the shortest turn from one direction to another, and the part of a turn about an axis.

    shortest arc    (1 + a·b, a × b)/‖…‖            takes direction a to b
    twist           (w, (u·n) n)/‖…‖               of q = (w, u) = swing ⊗ twist about n

The swing, q ⊗ twist⁻¹, turns about an axis perpendicular to n. Shapes broadcast over leading axes;
O(1) each. Derivatives are finite everywhere, for opposite directions and for directions and twists
that do not exist, too.
"""

import jax.numpy as jnp
import numpy as np

from jaxmotion._numerics import safe_norm
from jaxmotion._program import one_program
from jaxmotion._types import ArrayLike, Quaternion, Vector3
from jaxmotion.quaternion.algebra import normalize


@one_program()
def shortest_arc(source: Vector3, goal: Vector3) -> Quaternion:
    """The shortest rotation f[..., 4] from one direction f[..., 3], of any length, to another; none
    if either has no length; half a turn about some perpendicular axis if they are opposite."""
    a, b = unit(source), unit(goal)
    known = (jnp.sum(a * a, -1) > 0) & (jnp.sum(b * b, -1) > 0)
    cosine = jnp.where(known, jnp.sum(a * b, -1), 1)
    across = jnp.where(known[..., None], jnp.cross(a, b), 0)
    opposite = cosine < -1 + 64 * float(jnp.finfo(cosine.dtype).eps)
    turned = unit_across(jnp.zeros_like(a), a, 0.0)
    real = jnp.where(opposite, 0, 1 + cosine)
    vector = jnp.where(opposite[..., None], turned, across)
    return normalize(jnp.concatenate([real[..., None], vector], axis=-1))


@one_program()
def twist(q: Quaternion, axis: Vector3) -> Quaternion:
    """The turn f[..., 4] about the unit ``axis`` f[..., 3] in q; none where q swings it round by
    half a turn, so that every twist would do."""
    q, axis = jnp.asarray(q), jnp.asarray(axis)
    along = jnp.sum(q[..., 1:] * axis, axis=-1, keepdims=True) * axis
    return normalize(jnp.concatenate([q[..., :1], along], axis=-1))


@one_program()
def unit(v: Vector3) -> Vector3:
    """v/‖v‖, 0 for 0."""
    v = jnp.asarray(v)
    length = safe_norm(v, keepdims=True)
    return v / jnp.where(length > 0, length, 1)


@one_program()
def unit_across(v: Vector3, line: Vector3, noise: ArrayLike) -> Vector3:
    """Unit vector along v's part perpendicular to the line; some perpendicular if that part is no
    longer than the noise."""
    v, along = jnp.asarray(v), unit(line)
    # Least of the line's components: the axis that is farthest from it.
    spare = jnp.asarray(np.eye(3), v.dtype)[jnp.argmin(jnp.abs(along), axis=-1)]
    spare = spare - jnp.sum(spare * along, -1, keepdims=True) * along
    rest = v - jnp.sum(v * along, -1, keepdims=True) * along
    length = safe_norm(rest, keepdims=True)
    usable = length > jnp.asarray(noise, v.dtype)
    return jnp.where(usable, rest / jnp.where(usable, length, 1), unit(spare))
