"""Products, inverses and rotations of vectors.

A quaternion is q = (w, x, y, z), Hamilton's product, acting on vectors by q v q⁻¹. All functions
broadcast over leading axes and cost O(n).

The arithmetic is that of :mod:`~jaxmotion.quaternion.parts`, by component.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmotion._numerics import safe_norm
from jaxmotion._program import one_program
from jaxmotion._types import AnyArray, Quaternion, Vector3
from jaxmotion.quaternion.parts import product, rotated, running_signs, together


def components(a: Float[AnyArray, "... n"], size: int, name: str) -> tuple[Array, ...]:
    """One array a component of the last axis: (..., n) → n arrays (...).

    **Raises:** ``ValueError`` that calls the array ``name`` unless n is ``size``.
    """
    return tuple(jnp.unstack(ending_in(a, (size,), name), axis=-1))


def ending_in(a: Float[AnyArray, "..."], axes: tuple[int, ...], name: str) -> Array:
    """``a`` as an array.

    **Raises:** ``ValueError`` that calls the array ``name`` unless ``axes`` are its last axes.
    """
    a = jnp.asarray(a)
    if a.shape[-len(axes) :] != axes:
        raise ValueError(
            f"{name} must have shape (..., {', '.join(map(str, axes))}), got {a.shape}"
        )
    return a


def leading_axis(axis: int, shape: tuple[int, ...], caller: str) -> int:
    """``axis`` counted from the front, if it is one before the last of ``shape``.

    **Raises:** ``ValueError`` otherwise.
    """
    if not -len(shape) <= axis < len(shape) - 1 or axis == -1:
        raise ValueError(
            f"{caller}: axis={axis} of an array of shape {shape}; "
            "expected an axis before the last, which holds the components"
        )
    return axis % len(shape)


@one_program()
def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product a ⊗ b: the rotation b followed by a (in fixed axes).

    **Arguments:** ``a``, ``b``: f[..., 4], broadcast against each other; need not be unit.
    **Returns:** f[..., 4].
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    return together(product(components(a, 4, "a"), components(b, 4, "b")))


@one_program()
def conjugate(q: Quaternion) -> Quaternion:
    """(w, −x, −y, −z): the inverse rotation of a unit quaternion.

    **Arguments:** ``q``: f[..., 4].
    **Returns:** f[..., 4].
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    w, x, y, z = components(q, 4, "q")
    return together((w, -x, -y, -z))


@one_program()
def inverse(q: Quaternion) -> Quaternion:
    """q̄/‖q‖², the multiplicative inverse of any non-zero quaternion.

    **Arguments:** ``q``: f[..., 4], not zero.
    **Returns:** f[..., 4].
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    q = jnp.asarray(q)
    return conjugate(q) / jnp.sum(q * q, axis=-1, keepdims=True)


@one_program()
def normalize(q: Quaternion) -> Quaternion:
    """q/‖q‖.

    The zero quaternion, which is no rotation, becomes the identity (gradient 0); one that holds NaN
    stays NaN.

    **Arguments:** ``q``: f[..., 4].
    **Returns:** f[..., 4], unit.
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    q = ending_in(q, (4,), "normalize: q")
    norm = safe_norm(q, keepdims=True)
    zero = norm == 0
    unit = q / jnp.where(zero, 1.0, norm)
    return jnp.where(zero, identity(dtype=q.dtype), unit)


def identity(shape: tuple[int, ...] = (), dtype=None) -> Quaternion:
    """The identity rotation (1, 0, 0, 0), repeated.

    **Arguments:** ``shape``: of the leading axes; ``dtype``: float32 or float64, JAX's default when
    absent.
    **Returns:** f[*shape, 4].
    """
    return jnp.broadcast_to(jnp.array([1.0, 0.0, 0.0, 0.0], dtype=dtype), (*shape, 4))


@one_program()
def rotate(q: Quaternion, v: Vector3) -> Vector3:
    """Rotate vectors: q v q⁻¹ for unit q, by v + 2w(u×v) + 2u×(u×v) with q = (w, u).

    **Arguments:** ``q``: f[..., 4], unit; ``v``: f[..., 3], broadcast against q.
    **Returns:** f[..., 3], in v's unit.
    **Raises:** ``ValueError`` where the last axis is not 4 and 3.
    """
    return together(rotated(components(q, 4, "q"), components(v, 3, "v")))


@one_program()
def between(a: Quaternion, b: Quaternion) -> Quaternion:
    """a⁻¹ ⊗ b, the rotation that takes a to b in a's own frame: multiply(a, between(a, b)) = b.

    **Arguments:** ``a``, ``b``: f[..., 4], unit, broadcast.
    **Returns:** f[..., 4].
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    return multiply(conjugate(a), b)


@one_program()
def half_angle_between(
    a: Quaternion, b: Quaternion
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Of the rotation a⁻¹b by θ: (sin²(θ/2), cos(θ/2)), accurate near 0 as a dot product is not.

    Cheaper than :func:`between`: nothing is put together and taken apart again.

    **Arguments:** ``a``, ``b``: f[..., 4], unit, broadcast.
    **Returns:** two f[...]; the cosine is negative where a and b lie in different hemispheres.
    **Raises:** ``ValueError`` where the last axis is not 4.
    """
    w, x, y, z = components(a, 4, "a")
    cosine, x, y, z = product((w, -x, -y, -z), components(b, 4, "b"))
    return x * x + y * y + z * z, cosine


@one_program("axis")
def align_signs(q: Quaternion, axis: int = 0) -> Quaternion:
    """Choose between q and −q so that neighbours along ``axis`` lie in one hemisphere.

    The first sample keeps its sign; sample i is negated whenever its dot product with the (already
    aligned) sample i−1 is negative. Computed as a running product of signs, O(T). No gradient
    passes through the choice. Source: Lee & Shin 2001, §3.2.

    **Arguments:** ``q``: f[..., 4]; ``axis``: the axis to walk along, not the last.
    **Returns:** the same rotations, f[..., 4].
    **Raises:** ``ValueError`` for an axis that is none before the last, or a last axis that is not
    4.
    """
    q = jnp.asarray(q)
    axis = leading_axis(axis, q.shape, "align_signs")
    signs = running_signs(components(jnp.moveaxis(q, axis, 0), 4, "q"))
    return q * jnp.moveaxis(signs[..., None], 0, axis)
