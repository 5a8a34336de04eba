"""Rotations by components: what every level of a pyramid computes most.

    step(a, b)    = log(a⁻¹b) = ω        dω = M(ω) δ_b − M(ω)ᵀ δ_a
    turned(q, v)  = q·exp(v) = q′        δ′ = exp(v)⁻¹ δ_q exp(v) + Jr(v) dv
    halfway(q, v) = slerp_½(a, b)·exp(v) δ_m = ½(δ_a + δ_b) + ½ tan(θ/4)n × (δ_b − δ_a),  ω = θn

    δ = 2 vec(q̄ dq), the turn of q in its own frame; c = cos(θ/2), s = sin(θ/2)/θ, θ = ‖v‖ ≤ 2π
    Jr(v) = I − 2s²[v]× + k[v]×²,   k = (1 − 2sc)/θ²
    M(ω)  = I + ½[ω]× + k[ω]×²,     k = (1 − (θ/2)cot(θ/2))/θ²,  θ = ‖ω‖

Derivatives go by turns, three numbers and not four: :class:`Rotations` holds quaternions that no
derivative passes through beside turns that are zero and carry it, from :func:`rotations_of` to
:func:`quaternions_of`. The formulas above (Chirikjian 2012, §10.7) hold wherever q is, so
derivatives of derivatives are right as well; both modes, because differentiating log and exp costs
several times as much.

Quaternions are tuples (w, x, y, z) and vectors tuples (x, y, z) of arrays f[T, J]: nothing is
stacked between an operation and the next. Full-angle rotation vectors; ω goes the short way round,
so the sign of a quaternion does not matter.

No branch, no division by an angle and no library function stands in either: with t = tan(θ/8),
from u = vec(a⁻¹b) and w = |cos(θ/2)| by two half-angle steps, ω = ±2(1 − t²)(1 + tan²(θ/4))·
(atan t/t)·u, and c, s follow from the series of sin and cos at θ/4. Both are smooth in θ².

Sharp bits: quaternions must be unit, v no longer than 2π (:func:`wrapped`). Everything is fenced
(:mod:`~jaxmotion.multiresolution.linear`): shared terms are computed once.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion._numerics import series_switch
from jaxmotion._types import AnyArray
from jaxmotion.multiresolution.linear import driven, fenced, linear
from jaxmotion.quaternion.algebra import normalized, product, rotated

Parts = tuple[Array, ...]


class Rotations(NamedTuple):
    """Unit quaternions ``q`` without a derivative, and their ``turn`` δ: zero, with one."""

    q: Parts
    turn: Parts


def _arctan_series(terms: int) -> np.ndarray:
    """atan(t)/t as a polynomial of t² on 0 ≤ t ≤ tan(π/8), by interpolation."""
    top = np.tan(np.pi / 8) ** 2
    fit = np.polynomial.Chebyshev.interpolate(
        lambda x: np.arctan(np.sqrt(x)) / np.sqrt(x), terms - 1, (0, top)
    )
    return fit.convert(kind=np.polynomial.Polynomial).coef


_ARCTAN = _arctan_series(14)
_SINE = np.cumprod([1.0] + [-1.0 / (2 * k * (2 * k + 1)) for k in range(1, 12)])
_COSINE = np.cumprod([1.0] + [-1.0 / (2 * k * (2 * k - 1)) for k in range(1, 12)])


def _still(f: Callable[..., Any], *args: Any) -> Any:
    """f(*args) that no derivative passes through."""
    return fenced(f, *jax.lax.stop_gradient(args))


def _nothing(like: Parts) -> Parts:
    return tuple(jnp.zeros_like(x) for x in like[:3])


def parts_of(x: Float[AnyArray, "*rest n"]) -> Parts:
    """f[..., n] to n times f[...]; XLA sees that :func:`together` undoes it."""
    return tuple(jnp.unstack(jnp.moveaxis(jnp.asarray(x), -1, 0)))


def together(parts: Parts) -> Float[Array, "*rest n"]:
    """The inverse of :func:`parts_of`."""
    return jnp.moveaxis(jnp.stack(parts), 0, -1)


def rotations_of(q: Float[AnyArray, "*rest 4"]) -> Rotations:
    """q/‖q‖ with its turn; the zero quaternion becomes the identity (derivative 0)."""
    q = jnp.asarray(q)
    unit = normalized(parts_of(jax.lax.stop_gradient(q)))
    return Rotations(unit, driven(_own_turn, _own_pull, _nothing(unit), q, (q,)))


def _own_turn(q: Array, dq: Array) -> Parts:
    """δ = 2 vec(q̄ dq)/‖q‖²."""
    parts = parts_of(q)
    return scaled(2 * _inverse_square(parts), product(conjugate(parts), parts_of(dq))[1:])


def _own_pull(q: Array, pull: Parts) -> Array:
    parts = parts_of(q)
    turn = jnp.zeros_like(pull[0]), *scaled(2 * _inverse_square(parts), pull)
    return together(product(parts, turn))


def _inverse_square(q: Parts) -> Array:
    square = dot(q, q)
    return jnp.where(square > 0, 1 / jnp.where(square > 0, square, 1), 0)


def quaternions_of(r: Rotations) -> Parts:
    """q with its derivative ½ q·(0, δ)."""
    return driven(_turning, _turning_pull, jax.lax.stop_gradient(r.q), r.turn, own=True)


def _turning(q: Parts, turn: Parts) -> Parts:
    return scaled(0.5, product(q, (jnp.zeros_like(turn[0]), *turn)))


def _turning_pull(q: Parts, pull: Parts) -> Parts:
    return scaled(0.5, product(conjugate(q), pull)[1:])


def step(a: Rotations, b: Rotations) -> Parts:
    """ω = log(a⁻¹b)."""
    return driven(
        _step_of_turns, _turns_of_step, _still(_step, a.q, b.q), (a.turn, b.turn), own=True
    )


def _step(a: Parts, b: Parts) -> Parts:
    w, x, y, z = product(conjugate(a), b)
    sign = jnp.where(w < 0, -1.0, 1.0).astype(w.dtype)
    quarter = (x * x + y * y + z * z) / (1 + jnp.abs(w)) ** 2
    eighth = quarter / (1 + jnp.sqrt(1 + quarter)) ** 2
    factor = 2 * (1 - eighth) * (1 + quarter) * _polynomial(_ARCTAN, eighth)
    return scaled(sign * factor, (x, y, z))


def _polynomial(coefficients: np.ndarray, x: Array) -> Array:
    total = jnp.full_like(x, coefficients[-1])
    for c in coefficients[-2::-1]:
        total = total * x + float(c)
    return total


def _step_of_turns(omega: Parts, turns: tuple[Parts, Parts]) -> Parts:
    """dω of the two rotations' turns: M(ω) δ_b − M(ω)ᵀ δ_a."""
    before, after = turns
    difference = tuple(v - u for u, v in zip(before, after, strict=True))
    mean = tuple(0.5 * (u + v) for u, v in zip(before, after, strict=True))
    twice = cross(omega, cross(omega, difference))
    bent = scaled(_inverse_jacobian_factor(dot(omega, omega)), twice)
    return added(added(difference, cross(omega, mean)), bent)


def _turns_of_step(omega: Parts, pull: Parts) -> tuple[Parts, Parts]:
    """The transpose of :func:`_step_of_turns`."""
    factor = fenced(lambda omega: _inverse_jacobian_factor(dot(omega, omega)), omega)
    once = cross(omega, pull)
    twice = scaled(factor, cross(omega, once))
    even, odd = added(pull, twice), scaled(0.5, once)
    by_before = tuple(-x - y for x, y in zip(even, odd, strict=True))
    by_after = tuple(x - y for x, y in zip(even, odd, strict=True))
    return by_before, by_after


def steps(r: Rotations, count: Array | None = None) -> Parts:
    """ω = log(q_i⁻¹q_{i+1}), f[T − 1, J], zero from the last of ``count`` frames on; neighbours are
    only taken apart inside the fence."""

    def value(q: Parts, count: Array | None) -> Parts:
        return among(count, _step(*neighbours(q)))

    omega = _still(value, r.q, count)
    return driven(_steps_change, _steps_pull, omega, r.turn, (count,), own=True)


def _steps_change(omega: Parts, count: Array | None, turn: Parts) -> Parts:
    return among(count, _step_of_turns(omega, neighbours(turn)))


def _steps_pull(omega: Parts, count: Array | None, pull: Parts) -> Parts:
    turns = fenced(
        lambda omega, count, y: _turns_of_step(omega, among(count, y)), omega, count, pull
    )
    return joined_neighbours(*turns)


def among(count: Array | None, steps: Parts) -> Parts:
    """The steps between the frames that count, and zeros."""
    if count is None:
        return steps
    real = jnp.arange(len(steps[0]))[:, None] < count - 1
    return tuple(jnp.where(real, x, 0) for x in steps)


def halfway(r: Rotations, omega: Parts, v: Parts) -> Rotations:
    """slerp_½(q_i, q_{i+1})·exp(v_i), the short way round: f[T − 1, J]; ``omega`` the steps."""
    turn = driven(_halfway_change, _halfway_pull, _nothing(v), (r.turn, v), (omega, v))
    return Rotations(_still(_halfway, r.q, v), turn)


def _halfway(q: Parts, v: Parts) -> Parts:
    a, b = neighbours(q)
    cosine = dot(a, b)
    scale = jax.lax.rsqrt(2 + 2 * jnp.abs(cosine))
    other = jnp.where(cosine < 0, -scale, scale)
    return _turned(tuple(x * scale + y * other for x, y in zip(a, b, strict=True)), v)


def _halfway_change(omega: Parts, v: Parts, by: tuple[Parts, Parts]) -> Parts:
    turn, dv = by
    before, after = neighbours(turn)
    difference = tuple(y - x for x, y in zip(before, after, strict=True))
    middle = added(added(before, after), cross(_quarter_tangent(omega), difference))
    return _turn_of_turned(v, (scaled(0.5, middle), dv))


def _halfway_pull(omega: Parts, v: Parts, pull: Parts) -> tuple[Parts, Parts]:
    def turns(omega: Parts, v: Parts, pull: Parts) -> tuple[Parts, Parts, Parts]:
        by_middle, by_v = _turns_of_turned(v, pull)
        half = scaled(0.5, by_middle)
        bent = cross(_quarter_tangent(omega), half)
        return added(half, bent), tuple(x - y for x, y in zip(half, bent, strict=True)), by_v

    before, after, by_v = fenced(turns, omega, v, pull)
    return joined_neighbours(before, after), by_v


def _quarter_tangent(omega: Parts) -> Parts:
    """tan(θ/4) about the axis of each step."""
    cosine, sine = _half_angle(dot(omega, omega))
    return scaled(sine / (1 + cosine), omega)


def neighbours(q: Parts) -> tuple[Parts, Parts]:
    """All frames but the last, and all but the first."""
    return tuple(x[:-1] for x in q), tuple(x[1:] for x in q)


def joined_neighbours(a: Parts, b: Parts) -> Parts:
    """The transpose of :func:`neighbours`."""
    return tuple(
        jnp.concatenate([x[:1], x[1:] + y[:-1], y[-1:]]) for x, y in zip(a, b, strict=True)
    )


def _inverse_jacobian_factor(x: Array) -> Array:
    far = x > series_switch(x.dtype)
    cosine, sine = _half_angle(x)
    near = 1 / 12 + x * (1 / 720 + x / 30240)
    return jnp.where(far, (1 - cosine / (2 * sine)) / jnp.where(far, x, 1), near)


def turned(r: Rotations, v: Parts) -> Rotations:
    """q·exp(v)."""
    turn = driven(_turn_of_turned, _turns_of_turned, _nothing(v), (r.turn, v), (v,))
    return Rotations(_still(_turned, r.q, v), turn)


def _turned(q: Parts, v: Parts) -> Parts:
    cosine, sine = _half_angle(dot(v, v))
    return product(q, (cosine, *scaled(sine, v)))


def _half_angle(x: Array) -> tuple[Array, Array]:
    """cos(θ/2) and sin(θ/2)/θ from θ²."""
    y = x / 16
    sine = _polynomial(_SINE, y)
    return 1 - 2 * y * sine * sine, 0.5 * sine * _polynomial(_COSINE, y)


@jax.custom_jvp
def wrapped(v: Parts) -> Parts:
    """Another rotation vector of the same rotation, no longer than π (to rounding)."""
    return fenced(lambda v: scaled(1 - _whole_turns(v)[0], v), v)


@wrapped.defjvp
def _wrapped_jvp(primals, tangents):
    (v,), (dv,) = primals, tangents

    def change(v, dv):
        taken, square = _whole_turns(v)
        return added(scaled(1 - taken, dv), scaled(taken / square * dot(v, dv), v))

    # The matrix of change is symmetric.
    return wrapped(v), linear(change, lambda v, pull: (change(v, pull),), (v,), (dv,))


def _whole_turns(v: Parts) -> tuple[Array, Array]:
    """2πn/θ for the n whole turns in v, and θ² (1 if there are none)."""
    square = dot(v, v)
    turns = jnp.round(jnp.sqrt(square) / (2 * np.pi))
    square = jnp.where(turns > 0, square, 1)
    return 2 * np.pi * turns * jax.lax.rsqrt(square), square


def _turn_of_turned(v: Parts, by: tuple[Parts, Parts]) -> Parts:
    """The turn of q·exp(v) from that of q and dv: exp(v)⁻¹ δ exp(v) + Jr(v) dv."""
    turn, dv = by
    c, s, k = _right_jacobian(v)
    once = cross(v, dv)
    moved = added(dv, added(scaled(-2 * s * s, once), scaled(k, cross(v, once))))
    return added(rotated(conjugate((c, *scaled(s, v))), turn), moved)


def _turns_of_turned(v: Parts, pull: Parts) -> tuple[Parts, Parts]:
    """The transpose of :func:`_turn_of_turned`."""
    c, s, k = fenced(_right_jacobian, v)
    once = cross(v, pull)
    by_v = added(pull, added(scaled(2 * s * s, once), scaled(k, cross(v, once))))
    return rotated((c, *scaled(s, v)), pull), by_v


def _right_jacobian(v: Parts) -> tuple[Array, Array, Array]:
    """c, s and k of Jr(v)."""
    x = dot(v, v)
    c, s = _half_angle(x)
    far = x > series_switch(x.dtype)
    near = 1 / 6 - x * (1 / 120 - x / 5040)
    return c, s, jnp.where(far, (1 - 2 * s * c) / jnp.where(far, x, 1), near)


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


def scaled(factor: Array | float, v: Parts) -> Parts:
    """factor · v."""
    return tuple(factor * x for x in v)
