"""Right Jacobians of the rotation group, and differences of rotations cheap enough to probe.

    Jr(v)   = I - (1 - cos t)/t^2 [v]x + (t - sin t)/t^3 [v]x^2     t = |v|
    M(w)    = I + 1/2 [w]x + k [w]x^2,   k = (1 - t/2 cot(t/2))/t^2  t = |w|,    M = Jr^-1

    relative(a, b, c) = log(exp(a)^-1 c exp(b)) = w          radians, |w| <= pi
    dw = M(w) Jr(b) db - M(w)^T Jr(a) da + (what c contributes)

exp(v + dv) = exp(v) exp(Jr(v) dv) to first order (Chirikjian, *Stochastic Models, Information
Theory, and Lie Groups*, vol. 2, 2012, section 10.7).

Jacobians take vectors by component (:mod:`~jaxmotion.quaternion.parts`); :func:`relative` takes
``(n, 3, lanes)``, the blocks of ``linalg.block_banded``, and quaternions ``(n, lanes, 4)``. O(n
lanes). Sharp bits: written with cross products of whole components, because differentiating log and
exp through quaternions costs some ten times as much a product. w jumps where the angle passes pi,
as log does.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from jaxmotion._numerics import cos_half, series_switch, sin_half_over
from jaxmotion._types import Quaternion
from jaxmotion.quaternion.algebra import multiply
from jaxmotion.quaternion.explog import exp, log
from jaxmotion.quaternion.parts import Parts, added, cross, dot, scaled

Vectors = Float[Array, "n 3 lanes"]


def jacobian(v: Parts, y: Parts) -> Parts:
    """Jr(v) y, radians."""
    x = dot(v, v)
    half = sin_half_over(x)
    second = jacobian_factor(x, 2 * half * cos_half(x))
    return _with_crosses(v, -2 * half * half, second, y)


def jacobian_factor(x: Float[Array, "..."], sinc: Float[Array, "..."]) -> Float[Array, "..."]:
    """(t - sin t)/t^3 from x = t^2 and sinc = sin t / t."""
    far = x > series_switch(x.dtype)
    near = 1 / 6 - x * (1 / 120 - x / 5040)
    return jnp.where(far, (1 - sinc) / jnp.where(far, x, 1), near)


def inverse_jacobian(w: Parts, y: Parts, *, transpose: bool = False) -> Parts:
    """M(w) y, or its transpose M(w)^T y = M(-w) y."""
    x = dot(w, w)
    k = inverse_jacobian_factor(x, cos_half(x) / (2 * sin_half_over(x)))
    return _with_crosses(w, -0.5 if transpose else 0.5, k, y)


def inverse_jacobian_factor(
    x: Float[Array, "..."], half_cotangent: Float[Array, "..."]
) -> Float[Array, "..."]:
    """k from x = t^2 and t/2 cot(t/2)."""
    far = x > series_switch(x.dtype)
    near = 1 / 12 + x * (1 / 720 + x / 30240)
    return jnp.where(far, (1 - half_cotangent) / jnp.where(far, x, 1), near)


def _with_crosses(w: Parts, first: Array | float, second: Array, y: Parts) -> Parts:
    """y + first w x y + second w x (w x y)."""
    once = cross(w, y)
    return added(added(y, scaled(first, once)), scaled(second, cross(w, once)))


@jax.custom_jvp
def relative(a: Vectors, b: Vectors | None, c: Quaternion) -> Vectors:
    """log(exp(a)^-1 c exp(b)); ``b`` None stands for zero."""
    turned = multiply(exp(_component_last(-a)), c)
    if b is not None:
        turned = multiply(turned, exp(_component_last(b)))
    return component_first(log(turned))


def _relative_jvp(primals, tangents):
    a, b, c = primals
    da, db, dc = tangents
    w = relative(a, b, c)
    dw = jnp.zeros_like(w)
    if not _is_zero(da):
        dw = dw - on_blocks(inverse_jacobian, w, on_blocks(jacobian, a, da), transpose=True)
    if b is not None and not _is_zero(db):
        dw = dw + on_blocks(inverse_jacobian, w, on_blocks(jacobian, b, db))
    if not _is_zero(dc):
        dw = dw + jax.jvp(lambda c: _plain(a, b, c), (c,), (dc,))[1]
    return w, dw


relative.defjvp(_relative_jvp, symbolic_zeros=True)
_plain = relative.fun


def on_blocks(function: Callable[..., Parts], *vectors: Vectors, **options) -> Vectors:
    """A function of vectors by component, of blocks."""
    parts = function(*(tuple(jnp.unstack(jnp.moveaxis(v, 1, 0))) for v in vectors), **options)
    return jnp.moveaxis(jnp.stack(parts), 0, 1)


def component_first(v: Float[Array, "n lanes 3"]) -> Vectors:
    """Lanes last, as the block solver wants them."""
    return jnp.moveaxis(v, -1, 1)


def _component_last(v: Vectors) -> Float[Array, "n lanes 3"]:
    return jnp.moveaxis(v, 1, -1)


def _is_zero(tangent) -> bool:
    return isinstance(tangent, SymbolicZero)
