"""Vectors and quaternions by component: tuples (x, y, z) and (w, x, y, z) of arrays.

Nothing is stacked between an operation and the next, so that XLA runs over whole arrays. Stacked
on the front and moved to the back, the parts become the last axis: XLA turns the move into index
arithmetic, so every component is a long vector; stacking on a last axis of four is up to ten times
slower on a CPU.
"""

from collections.abc import Sequence
from typing import TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmotion._types import AnyArray

Parts: TypeAlias = tuple[Float[Array, "..."], ...]


def parts_of(x: Float[AnyArray, "*rest n"]) -> Parts:
    """f[..., n] to n times f[...]; XLA sees that :func:`together` undoes it."""
    return tuple(jnp.unstack(jnp.moveaxis(jnp.asarray(x), -1, 0)))


def together(parts: Sequence[Float[Array, "..."]]) -> Float[Array, "... n"]:
    """The inverse of :func:`parts_of`; parts are broadcast against each other."""
    return jnp.moveaxis(jnp.stack(jnp.broadcast_arrays(*parts)), 0, -1)


def neighbours(q: Parts) -> tuple[Parts, Parts]:
    """All frames but the last, and all but the first."""
    return tuple(x[:-1] for x in q), tuple(x[1:] for x in q)


def joined_neighbours(a: Parts, b: Parts) -> Parts:
    """The transpose of :func:`neighbours`."""
    return tuple(
        jnp.concatenate([x[:1], x[1:] + y[:-1], y[-1:]]) for x, y in zip(a, b, strict=True)
    )


def product(a: Sequence[Array], b: Sequence[Array]) -> Parts:
    """Hamilton's product a ⊗ b."""
    w, x, y, z = a
    W, X, Y, Z = b
    return (
        w * W - x * X - y * Y - z * Z,
        w * X + x * W + y * Z - z * Y,
        w * Y - x * Z + y * W + z * X,
        w * Z + x * Y - y * X + z * W,
    )


def normalized(q: Sequence[Array]) -> Parts:
    """q/‖q‖, the identity for zero; for callers who have a derivative of their own."""
    w, x, y, z = q
    squared = w * w + x * x + y * y + z * z
    zero = squared == 0
    scale = jax.lax.rsqrt(jnp.where(zero, 1, squared))
    return jnp.where(zero, 1, scale * w), scale * x, scale * y, scale * z


def rotated(q: Sequence[Array], v: Sequence[Array]) -> Parts:
    """q v q⁻¹ for unit q, by v + 2w(u×v) + 2u×(u×v) with q = (w, u)."""
    w, x, y, z = q
    a, b, c = v
    d, e, f = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return (a + w * d + y * f - z * e, b + w * e + z * d - x * f, c + w * f + x * e - y * d)


def running_signs(q: Sequence[Array]) -> Array:
    """What ``quaternion.align_signs`` multiplies each sample of axis 0 by."""
    dots = sum((c[1:] * c[:-1] for c in q[1:]), start=q[0][1:] * q[0][:-1])
    flips = jnp.where(dots < 0, -1.0, 1.0).astype(dots.dtype)
    return jnp.cumprod(jnp.concatenate([jnp.ones_like(q[0][:1]), flips]), axis=0)


def conjugate(q: Parts) -> Parts:
    """q̄."""
    w, x, y, z = q
    return w, -x, -y, -z


def dot(a: Parts, b: Parts) -> Array:
    """Σ a_i b_i."""
    return sum((x * y for x, y in zip(a[1:], b[1:], strict=True)), start=a[0] * b[0])


def cross(a: Parts, b: Parts) -> Parts:
    """a × b."""
    x, y, z = a
    u, v, w = b
    return y * w - z * v, z * u - x * w, x * v - y * u


def added(a: Parts, b: Parts) -> Parts:
    """a + b."""
    return tuple(x + y for x, y in zip(a, b, strict=True))


def subtracted(a: Parts, b: Parts) -> Parts:
    """a − b."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


def scaled(factor: Array | float, v: Parts) -> Parts:
    """factor · v."""
    return tuple(factor * x for x in v)
