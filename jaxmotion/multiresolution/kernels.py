"""Rotations by components: what every level of a pyramid computes most.

    step(a, b)   = log(a⁻¹b) = ω     dω = M(ω) δ_b − M(ω)ᵀ δ_a
    turned(q, v) = q·exp(v) = q′     δ′ = exp(v)⁻¹ δ_q exp(v) + Jr(v) dv
    slerp_½(a, b) = m                δ_m = ½(δ_a + δ_b) + ½ tan(θ/4)n × (δ_b − δ_a),  ω = θn

    δ = 2 vec(q̄ dq), the turn of q in its own frame; c = cos(θ/2), s = sin(θ/2)/θ, θ = ‖v‖ ≤ 2π
    Jr(v) = I − 2s²[v]× + k[v]×²,   k = (1 − 2sc)/θ²
    M(ω)  = I + ½[ω]× + k[ω]×²,     k = (1 − (θ/2)cot(θ/2))/θ²,  θ = ‖ω‖

Quaternions are tuples (w, x, y, z) and vectors tuples (x, y, z) of arrays f[T, J]: nothing is
stacked between an operation and the next. Full-angle rotation vectors; ω goes the short way round,
so the sign of a quaternion does not matter. Derivatives (Chirikjian 2012, §10.7) are written out,
both modes, because differentiating log and exp costs several times as much.

No branch, no division by an angle and no library function stands in either: with t = tan(θ/8),
from u = vec(a⁻¹b) and w = |cos(θ/2)| by two half-angle steps, ω = ±2(1 − t²)(1 + tan²(θ/4))·
(atan t/t)·u, and c, s follow from the series of sin and cos at θ/4. Both are smooth in θ².

Sharp bits: quaternions must be unit, v no longer than 2π (:func:`wrapped`). XLA fuses elementwise
chains without limit on a CPU, and computes what several consumers share once for each, which makes
a gradient explode in time and code; it does not fuse across a branch, so all operations and their
derivatives are branches of a condition that always holds (:func:`fenced`). Derivatives have
transposes of their own (:func:`linear`), fed by arguments and results and nothing else.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmotion._numerics import series_switch
from jaxmotion.quaternion.algebra import normalized, product, rotated

Parts = tuple[Array, ...]


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


def fenced(f: Callable[..., Any], *args: Any) -> Any:
    """f(*args), computed once and stored, whoever uses it."""
    always = jax.lax.optimization_barrier(jnp.asarray(True))
    shapes = jax.eval_shape(f, *args)

    def never(*_):
        return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)

    return jax.lax.cond(always, f, never, *args)


@jax.custom_jvp
def unit(q: Parts) -> Parts:
    """q/‖q‖; the zero quaternion becomes the identity (derivative 0)."""
    return normalized(q)


@unit.defjvp
def _unit_jvp(primals, tangents):
    (q,), (dq,) = primals, tangents
    u, square = unit(q), dot(q, q)
    inverse = jnp.where(square > 0, jax.lax.rsqrt(jnp.where(square > 0, square, 1)), 0)

    def change(u, inverse, dq):
        along = dot(u, dq)
        return tuple(inverse * (d - along * c) for d, c in zip(dq, u, strict=True))

    # The matrix of change is symmetric.
    return u, linear(
        change, lambda u, inverse, pull: (change(u, inverse, pull),), (u, inverse), (dq,)
    )


@jax.custom_jvp
def step(a: Parts, b: Parts) -> Parts:
    """ω = log(a⁻¹b)."""
    return fenced(_step, a, b)


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


@step.defjvp
def _step_jvp(primals, tangents):
    (a, b), (da, db) = primals, tangents
    omega = step(a, b)
    return omega, linear(_step_change, _step_pull, (a, b, omega), (da, db))


def _step_change(a: Parts, b: Parts, omega: Parts, da: Parts, db: Parts) -> Parts:
    return _step_of_turns(omega, own_turn(a, da), own_turn(b, db))


def _step_pull(a: Parts, b: Parts, omega: Parts, pull: Parts) -> tuple[Parts, Parts]:
    by_a, by_b = _turns_of_step(omega, pull)
    return own_pull(a, by_a), own_pull(b, by_b)


def _step_of_turns(omega: Parts, before: Parts, after: Parts) -> Parts:
    """dω of the two rotations' turns: M(ω) δ_b − M(ω)ᵀ δ_a."""
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


@jax.custom_jvp
def steps(q: Parts) -> Parts:
    """ω = log(q_i⁻¹q_{i+1}), f[T − 1, J]; neighbours are only taken apart inside the fence."""
    return fenced(lambda q: _step(*neighbours(q)), q)


@steps.defjvp
def _steps_jvp(primals, tangents):
    (q,), (dq,) = primals, tangents
    omega = steps(q)

    def change(q, omega, dq):
        return _step_of_turns(omega, *neighbours(own_turn(q, dq)))

    def pull(q, omega, pull):
        turns = fenced(_turns_of_step, omega, pull)
        return (own_pull(q, joined_neighbours(*turns)),)

    return omega, linear(change, pull, (q, omega), (dq,))


@jax.custom_jvp
def halfway(q: Parts, v: Parts) -> Parts:
    """slerp_½(q_i, q_{i+1})·exp(v_i), the short way round: f[T − 1, J]."""

    def value(q, v):
        a, b = neighbours(q)
        cosine = dot(a, b)
        scale = jax.lax.rsqrt(2 + 2 * jnp.abs(cosine))
        other = jnp.where(cosine < 0, -scale, scale)
        return _turned(tuple(x * scale + y * other for x, y in zip(a, b, strict=True)), v)

    return fenced(value, q, v)


@halfway.defjvp
def _halfway_jvp(primals, tangents):
    (q, v), (dq, dv) = primals, tangents
    result = halfway(q, v)

    def change(q, v, result, dq, dv):
        before, after = neighbours(own_turn(q, dq))
        difference = tuple(y - x for x, y in zip(before, after, strict=True))
        middle = added(added(before, after), cross(_quarter_tangent(q), difference))
        return turning(result, _turn_of_turned(v, scaled(0.5, middle), dv))

    def pull(q, v, result, pull):
        before, after, by_v = fenced(turns, q, v, result, pull)
        return own_pull(q, joined_neighbours(before, after)), by_v

    def turns(q, v, result, pull):
        by_middle, by_v = _turns_of_turned(v, turning_pull(result, pull))
        half = scaled(0.5, by_middle)
        bent = cross(_quarter_tangent(q), half)
        return added(half, bent), tuple(x - y for x, y in zip(half, bent, strict=True)), by_v

    return result, linear(change, pull, (q, v, result), (dq, dv))


def _quarter_tangent(q: Parts) -> Parts:
    """tan(θ/4) about the axis of each step."""
    before, after = neighbours(q)
    w, *x = product(conjugate(before), after)
    return scaled(jnp.where(w < 0, -1.0, 1.0).astype(w.dtype) / (1 + jnp.abs(w)), tuple(x))


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


@jax.custom_jvp
def turned(q: Parts, v: Parts) -> Parts:
    """q·exp(v)."""
    return fenced(_turned, q, v)


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


@turned.defjvp
def _turned_jvp(primals, tangents):
    (q, v), (dq, dv) = primals, tangents
    result = turned(q, v)

    def change(q, v, result, dq, dv):
        return turning(result, _turn_of_turned(v, own_turn(q, dq), dv))

    def pull(q, v, result, pull):
        by_q, by_v = _turns_of_turned(v, turning_pull(result, pull))
        return own_pull(q, by_q), by_v

    return result, linear(change, pull, (q, v, result), (dq, dv))


def _turn_of_turned(v: Parts, turn: Parts, dv: Parts) -> Parts:
    """The turn of q·exp(v) from that of q and dv: exp(v)⁻¹ δ exp(v) + Jr(v) dv."""
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


def linear(change: Callable, pull: Callable, at: tuple, tangents: tuple) -> Any:
    """change(*at, *tangents), linear in the tangents, whose transpose is pull(*at, cotangents).

    Left to JAX, the transpose is fed by dozens of stored intermediates. It takes one from its
    user only for a linear solve, so this is one: y − L x = 0, x = t.
    """

    def system(unknown):
        y, x = unknown
        return jax.tree.map(jnp.subtract, y, change(*at, *x)), x

    def solve(_, known):
        return fenced(change, *at, *known[1]), known[1]

    def solve_transposed(_, known):
        y, x = known
        return y, jax.tree.map(jnp.add, x, fenced(pull, *at, y))

    # Zero, but of the tangents as well: all or none of what is known must be.
    total = jnp.sum(jax.tree.leaves(tangents)[0])
    zero = jnp.where(False, total, jnp.zeros_like(total))
    shapes = jax.eval_shape(change, *at, *tangents)
    nothing = jax.tree.map(lambda x: jnp.broadcast_to(zero, x.shape), shapes)
    known = (nothing, tangents)
    return jax.lax.custom_linear_solve(system, known, solve, solve_transposed)[0]


def conjugate(q: Parts) -> Parts:
    """q̄."""
    w, x, y, z = q
    return w, -x, -y, -z


def own_turn(q: Parts, dq: Parts) -> Parts:
    """δ = 2 vec(q̄ dq)."""
    return scaled(2.0, product(conjugate(q), dq)[1:])


def own_pull(q: Parts, pull: Parts) -> Parts:
    """The transpose of :func:`own_turn`."""
    return scaled(4.0, turning(q, pull))


def turning(q: Parts, turn: Parts) -> Parts:
    """dq = ½ q·(0, δ), the inverse of :func:`own_turn`."""
    return scaled(0.5, product(q, (jnp.zeros_like(turn[0]), *turn)))


def turning_pull(q: Parts, pull: Parts) -> Parts:
    """The transpose of :func:`turning`."""
    return scaled(0.25, own_turn(q, pull))


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
