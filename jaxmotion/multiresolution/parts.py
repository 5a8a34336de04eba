"""Vectors and quaternions by component: tuples (x, y, z) and (w, x, y, z) of arrays f[T, J].

Nothing is stacked between an operation and the next, so that XLA runs over whole arrays.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmotion._types import AnyArray

Parts = tuple[Array, ...]


def parts_of(x: Float[AnyArray, "*rest n"]) -> Parts:
    """f[..., n] to n times f[...]; XLA sees that :func:`together` undoes it."""
    return tuple(jnp.unstack(jnp.moveaxis(jnp.asarray(x), -1, 0)))


def together(parts: Parts) -> Float[Array, "*rest n"]:
    """The inverse of :func:`parts_of`."""
    return jnp.moveaxis(jnp.stack(parts), 0, -1)


def neighbours(q: Parts) -> tuple[Parts, Parts]:
    """All frames but the last, and all but the first."""
    return tuple(x[:-1] for x in q), tuple(x[1:] for x in q)


def joined_neighbours(a: Parts, b: Parts) -> Parts:
    """The transpose of :func:`neighbours`."""
    return tuple(
        jnp.concatenate([x[:1], x[1:] + y[:-1], y[-1:]]) for x, y in zip(a, b, strict=True)
    )


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
