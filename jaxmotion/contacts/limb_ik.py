"""Two-bone limbs solved in closed form: knee by the cosine rule, then one swing of the limb.

Bones a = middle − root and b = end − middle, of lengths l₁, l₂, turn so that the end comes to the
target, at distance r from the root. With h the hinge, perpendicular to a, and b's component along h
kept, b turns about h until the interior angle of the joint is θ, where

    cos θ* = (l₁² + l₂² − r²)/(2 l₁ l₂)                          θ* meets the target
    θ = θ₀ + G(θ*) − G(θ₀),   G(x) = min(x, ρ) + (π − ρ)(u⁴/2 − u³ + u),  u = clip((x − ρ)/(π − ρ))

θ₀ the present angle: the change is damped as the limb comes near its full extension (θ > ρ), where
the knee would snap; both bones scale by s = r/‖end − root‖ to make up for it (Kovar, Schreiner &
Gleicher 2002, step 4). Where s would leave [1/(1 + stretch), 1 + stretch] it is cut there, and θ
meets the target without damping if the scaled limb can reach it. At ``stretch`` = 0 the bones keep
their lengths and nothing is damped. Then the shortest arc takes the limb's direction to the
target's, so its swivel stays. Kovar's integral of f from θ₀ is G in closed form.

The hinge is a × b, steadied by ``hinge`` where the limb is so straight that a × b is mostly noise.
The knee bends to the side the hinge says; a limb bent the wrong way is bent back.

Shapes broadcast over leading axes. Any length unit. O(1) a limb. Derivatives are finite everywhere:
at full extension, for bones of length zero, and for a target at the root of the limb.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion._checks import no_module
from jaxmotion._numerics import safe_arctan2, safe_norm, safe_sqrt
from jaxmotion._portable import Portable
from jaxmotion._types import ArrayLike, Quaternion, ScalarLike, Vector3
from jaxmotion.quaternion import multiply, rotate
from jaxmotion.quaternion.arcs import shortest_arc, unit, unit_across

_STEADY = 0.15  # weight of the given hinge against sin of the bend


class LimbTurn(Portable):
    """How to turn a limb, in world axes.

    The turns are put before the joints' world rotations: ``multiply(turn, rotation)``.

    **Fields:** ``root``: f[..., 4], turns both bones about the limb's root; ``middle``: f[..., 4],
    turns the second bone, in total; ``scale``: f[...], of both bones' lengths; ``end``: f[..., 3],
    where the end comes to.
    """

    root: Quaternion
    middle: Quaternion
    scale: Float[Array, "..."]
    end: Vector3


def limb_ik(
    root: ArrayLike,
    middle: ArrayLike,
    end: ArrayLike,
    target: ArrayLike,
    *,
    hinge: ArrayLike | None = None,
    stretch: ScalarLike = 0.0,
    straight: ScalarLike = 2.8,
) -> LimbTurn:
    """Turns that bring the end of a two-bone limb to a target, or as near as it can come.

    Kovar, Schreiner & Gleicher 2002, section 4.4; the module has the equations.

    **Arguments:** ``root``, ``middle``, ``end``, ``target``: f[..., 3], world positions (hip, knee,
    ankle, and where the ankle is to be); ``hinge``: f[..., 3], world, the unit axis about which a
    positive turn of the second bone bends the limb, for limbs that are straight; ``stretch``: share
    by which bones may change length, 0 for not at all; ``straight``: ρ, radians.
    **Returns:** :class:`LimbTurn`.
    **Raises:** ``ValueError`` for points that do not have three components.
    """
    given = {"root": root, "middle": middle, "end": end, "target": target}
    for name, p in given.items():
        no_module(f"limb_ik: {name}", p)
    points = [jnp.asarray(p) for p in given.values()]
    for name, p in zip(given, points, strict=True):
        if p.shape[-1:] != (3,):
            raise ValueError(f"limb_ik: {name} must have shape (..., 3), got {p.shape}")
    root, middle, end, target = points
    upper, lower, wanted = middle - root, end - middle, target - root
    bent, straight_below = bend_axis(upper, lower)
    if hinge is not None:
        bones = safe_norm(upper, keepdims=True) * safe_norm(lower, keepdims=True)
        bent = bent + _STEADY * bones * jnp.asarray(hinge, bent.dtype)
    axis = unit_across(bent, upper, straight_below)
    bend, size = _bend(upper, lower, axis, wanted, stretch, straight)
    lower = rotate(bend, lower)
    swing = shortest_arc(upper + lower, wanted)
    reached = root + size[..., None] * rotate(swing, upper + lower)
    return LimbTurn(swing, multiply(swing, bend), size, reached)


def bend_axis(upper: Vector3, lower: Vector3) -> tuple[Vector3, Float[Array, "... 1"]]:
    """The axis about which two bones bend, times both lengths and the sine of the bend, and the
    length below which it is rounding: the limb is straight."""
    bones = safe_norm(upper, keepdims=True) * safe_norm(lower, keepdims=True)
    return jnp.cross(upper, lower), 64 * float(jnp.finfo(bones.dtype).eps) * bones


def _bend(upper, lower, axis, wanted, stretch, straight):
    """The turn of the second bone about the hinge, and the scale of both bones."""
    along = unit(upper)
    ahead = jnp.cross(axis, along)
    l1, forward = safe_norm(upper), jnp.sum(lower * along, -1)
    sideways = jnp.sum(lower * ahead, -1)
    flat = safe_sqrt(forward**2 + sideways**2)  # of the second bone, in the limb's plane
    squares = l1**2 + jnp.sum(lower**2, -1)
    now = safe_arctan2(sideways, forward)  # π − θ₀, negative if bent the wrong way
    product = 2 * l1 * flat

    def reach_squared(flexion):
        return squares + product * jnp.cos(flexion)

    def flexion_for(r_squared):
        usable = product > 0
        cosine = (r_squared - squares) / jnp.where(usable, product, 1)
        cosine = jnp.clip(jnp.where(usable, cosine, 1), -1, 1)
        # Rounding near a straight limb must not make an infinite derivative.
        floor = 64 * float(jnp.finfo(cosine.dtype).eps)
        return safe_arctan2(safe_sqrt(1 - cosine**2, floor), cosine)

    r_squared = jnp.sum(wanted**2, -1)
    exact = flexion_for(r_squared)
    damped = jnp.abs(now) + _damping(exact, straight) - _damping(jnp.abs(now), straight)
    most = 1 + jnp.asarray(stretch, squares.dtype)
    length = safe_sqrt(jnp.maximum(reach_squared(damped), 0))
    needed = safe_norm(wanted) / jnp.where(length > 0, length, 1)
    size = jnp.clip(jnp.where(length > 0, needed, 1), 1 / most, most)
    flexion = jnp.where(size == needed, damped, flexion_for(r_squared / size**2))
    half = 0.5 * (flexion - now)
    return jnp.concatenate([jnp.cos(half)[..., None], jnp.sin(half)[..., None] * axis], -1), size


def _damping(flexion, straight):
    """−G(π − flexion) up to a constant: how far the flexion goes, with damping near 0."""
    limit = np.pi - jnp.asarray(straight, flexion.dtype)
    u = jnp.clip(1 - flexion / limit, 0, 1)
    return jnp.maximum(flexion, limit) - limit * (u**4 / 2 - u**3 + u)
