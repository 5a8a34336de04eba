"""Differences of rotations as vectors, with derivatives cheap enough to probe.

    relative(a, b, c) = log(exp(a)^-1 c exp(b)) = w          radians, |w| <= pi

    dw = M(w) Jr(b) db - M(w)^T Jr(a) da + (what c contributes),    M = Jr^-1
    Jr(v)   = I - (1 - cos t)/t^2 [v]x + (t - sin t)/t^3 [v]x^2     t = |v|
    M(w)    = I + 1/2 [w]x + k [w]x^2,   k = (1 - t/2 cot(t/2))/t^2  t = |w|

Jr is the right Jacobian of the rotation group: exp(v + dv) = exp(v) exp(Jr(v) dv) to first order
(Chirikjian, *Stochastic Models, Information Theory, and Lie Groups*, vol. 2, 2012, section 10.7).

Shapes: rotation vectors ``(n, 3, lanes)``, the blocks of ``linalg.block_banded``; quaternions
``(n, lanes, 4)``. O(n lanes). Sharp bits: written with cross products of whole components, because
differentiating log and exp through quaternions costs some ten times as much a product. w jumps
where the angle passes pi, as log does.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from jaxmotion import quaternion
from jaxmotion._numerics import cos_half, series_switch, sin_half_over
from jaxmotion._types import Quaternion

Vectors = Float[Array, "n 3 lanes"]


@jax.custom_jvp
def relative(a: Vectors, b: Vectors | None, c: Quaternion) -> Vectors:
    """log(exp(a)^-1 c exp(b)); ``b`` None stands for zero."""
    turned = quaternion.multiply(quaternion.exp(_component_last(-a)), c)
    if b is not None:
        turned = quaternion.multiply(turned, quaternion.exp(_component_last(b)))
    return component_first(quaternion.log(turned))


def _relative_jvp(primals, tangents):
    a, b, c = primals
    da, db, dc = tangents
    w = relative(a, b, c)
    dw = jnp.zeros_like(w)
    if not _is_zero(da):
        dw = dw - inverse_jacobian(w, _jacobian(a, da), transpose=True)
    if b is not None and not _is_zero(db):
        dw = dw + inverse_jacobian(w, _jacobian(b, db))
    if not _is_zero(dc):
        dw = dw + jax.jvp(lambda c: _plain(a, b, c), (c,), (dc,))[1]
    return w, dw


relative.defjvp(_relative_jvp, symbolic_zeros=True)
_plain = relative.fun


def inverse_jacobian(w: Vectors, v: Vectors, *, transpose: bool = False) -> Vectors:
    """M(w) v, or its transpose M(w)^T v = M(-w) v."""
    x = jnp.sum(w * w, axis=1)
    far = x > series_switch(x.dtype)
    half_cot = cos_half(x) / (2 * sin_half_over(x))
    near = 1 / 12 + x * (1 / 720 + x / 30240)
    k = jnp.where(far, (1 - half_cot) / jnp.where(far, x, 1), near)
    return _with_crosses(w, -0.5 if transpose else 0.5, k, v)


def component_first(v: Float[Array, "n lanes 3"]) -> Vectors:
    """Lanes last, as the block solver wants them."""
    return jnp.moveaxis(v, -1, 1)


def _component_last(v: Vectors) -> Float[Array, "n lanes 3"]:
    return jnp.moveaxis(v, 1, -1)


def _jacobian(w: Vectors, v: Vectors) -> Vectors:
    """Jr(w) v."""
    x = jnp.sum(w * w, axis=1)
    far = x > series_switch(x.dtype)
    half = sin_half_over(x)
    sinc = 2 * half * cos_half(x)
    near = 1 / 6 - x * (1 / 120 - x / 5040)
    second = jnp.where(far, (1 - sinc) / jnp.where(far, x, 1), near)
    return _with_crosses(w, -2 * half * half, second, v)


def _with_crosses(w: Vectors, first: Array | float, second: Array, v: Vectors) -> Vectors:
    """v + first w x v + second w x (w x v), component by component: long vectors, one pass."""
    w0, v0 = jnp.moveaxis(w, 1, 0), jnp.moveaxis(v, 1, 0)
    once = _cross(w0, v0)
    twice = _cross(w0, once)
    parts = [v0[i] + first * once[i] + second * twice[i] for i in range(3)]
    return jnp.moveaxis(jnp.stack(parts), 0, 1)


def _cross(a: Sequence[Array] | Array, b: Sequence[Array] | Array) -> list[Array]:
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def _is_zero(tangent) -> bool:
    return isinstance(tangent, SymbolicZero)
