"""log and exp of rotations by component, without a branch: the values of a pyramid's kernels.

    log_between(a, b) = log(a⁻¹b) = ω        times_exp(q, v, g) = q·exp(g v)

Full-angle rotation vectors; ω goes the short way round, so the sign of a quaternion does not
matter. No branch, no division by an angle and no library function stands in either: with
t = tan(θ/8), from u = vec(a⁻¹b) and w = |cos(θ/2)| by two half-angle steps,
ω = ±2(1 − t²)(1 + tan²(θ/4))·(atan t/t)·u, and cos(θ/2) and sin(θ/2)/θ follow from the series of
sin and cos at θ/4. Both are smooth in θ². XLA runs over whole arrays; O(1) a rotation.

Sharp bits: quaternions must be unit, v no longer than 2π unless it comes with gains. Derivatives
are for :mod:`~jaxmotion.multiresolution.kernels` to say.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion.quaternion.parts import Parts, conjugate, dot, product, scaled


def _arctan_series(terms: int) -> Float[np.ndarray, " term"]:
    """atan(t)/t as a polynomial of t² on 0 ≤ t ≤ tan(π/8), by interpolation."""
    top = np.tan(np.pi / 8) ** 2
    fit = np.polynomial.Chebyshev.interpolate(
        lambda x: np.arctan(np.sqrt(x)) / np.sqrt(x), terms - 1, (0, top)
    )
    return fit.convert(kind=np.polynomial.Polynomial).coef


_ARCTAN = _arctan_series(14)
_SINE = np.cumprod([1.0] + [-1.0 / (2 * k * (2 * k + 1)) for k in range(1, 12)])
_COSINE = np.cumprod([1.0] + [-1.0 / (2 * k * (2 * k - 1)) for k in range(1, 12)])


def log_between(a: Parts, b: Parts) -> Parts:
    """ω = log(a⁻¹b)."""
    w, x, y, z = product(conjugate(a), b)
    sign = jnp.where(w < 0, -1.0, 1.0).astype(w.dtype)
    quarter = (x * x + y * y + z * z) / (1 + jnp.abs(w)) ** 2
    eighth = quarter / (1 + jnp.sqrt(1 + quarter)) ** 2
    factor = 2 * (1 - eighth) * (1 + quarter) * _polynomial(_ARCTAN, eighth)
    return scaled(sign * factor, (x, y, z))


def _polynomial(
    coefficients: Float[np.ndarray, " term"], x: Float[Array, "*rest"]
) -> Float[Array, "*rest"]:
    total = jnp.full_like(x, coefficients[-1])
    for c in coefficients[-2::-1]:
        total = total * x + float(c)
    return total


def times_exp(q: Parts, v: Parts, gains: Float[Array, "*joint"] | None = None) -> Parts:
    """q·exp(v), or q·exp(gains·v) of any length."""
    v, cosine, sine = scaled_angle(v, gains)
    return product(q, (cosine, *scaled(sine, v)))


def scaled_angle(
    v: Parts, gains: Float[Array, "*joint"] | None
) -> tuple[Parts, Float[Array, "..."], Float[Array, "..."]]:
    """gains·v, and cos(θ/2) and sin(θ/2)/θ of its length."""
    if gains is None:
        return v, *half_angle(dot(v, v))
    v = scaled(gains, v)
    x = dot(v, v)
    far = x > np.pi**2
    angle = jnp.sqrt(jnp.where(far, x, 1))
    whole = jax.lax.stop_gradient(jnp.round(angle / (2 * np.pi)))
    rest = angle - 2 * np.pi * whole
    cosine, sine = half_angle(jnp.where(far, rest * rest, x))
    sign = 1 - 2 * (whole % 2)
    return v, sign * cosine, jnp.where(far, sign * sine * rest / angle, sine)


def half_angle(x: Float[Array, "*rest"]) -> tuple[Float[Array, "*rest"], Float[Array, "*rest"]]:
    """cos(θ/2) and sin(θ/2)/θ from θ²."""
    y = x / 16
    sine = _polynomial(_SINE, y)
    return 1 - 2 * y * sine * sine, 0.5 * sine * _polynomial(_COSINE, y)
