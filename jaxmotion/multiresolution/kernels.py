"""Rotations by components: what every level of a pyramid computes most.

    step(a, b)    = log(a⁻¹b) = ω        dω = M(ω) δ_b − M(ω)ᵀ δ_a
    turned(q, v)  = q·exp(v) = q′        δ′ = exp(v)⁻¹ δ_q exp(v) + Jr(v) dv
    halfway(q, v) = slerp_½(a, b)·exp(v) δ_m = ½(δ_a + δ_b) + ½ tan(θ/4)n × (δ_b − δ_a),  ω = θn

    δ = 2 vec(q̄ dq), the turn of q in its own frame
    exp(v)⁻¹ y exp(v) = (I − a[v]× + b[v]×²) y,   a = sin θ/θ,  θ = ‖v‖
    Jr(v) = I − b[v]× + k[v]×²,    b = (1 − cos θ)/θ²,  k = (1 − a)/θ²
    M(ω)  = I + ½[ω]× + k[ω]×²,    k = (1 − (θ/2)cot(θ/2))/θ²,  θ = ‖ω‖

Derivatives go by turns, three numbers and not four: :class:`Rotations` holds quaternions that no
derivative passes through beside turns that are zero and carry it, from :func:`rotations_of` to
:func:`quaternions_of`. The formulas above (Chirikjian 2012, §10.7) hold wherever q is, so
derivatives of derivatives are right as well; both modes, because differentiating log and exp costs
several times as much.

A gradient keeps little: pulls need steps and vectors only, no quaternions, and a vector that is
cheap to make is made again (:func:`turned_by`, :func:`halfway`).

Full-angle rotation vectors; ω goes the short way round, so the sign of a quaternion does not
matter. No branch, no division by an angle and no library function stands in either: with
t = tan(θ/8), from u = vec(a⁻¹b) and w = |cos(θ/2)| by two half-angle steps,
ω = ±2(1 − t²)(1 + tan²(θ/4))·(atan t/t)·u, and cos(θ/2) and sin(θ/2)/θ follow from the series of
sin and cos at θ/4. Both are smooth in θ².

Sharp bits: quaternions must be unit, v no longer than 2π unless it comes with gains. Everything is
fenced (:mod:`~jaxmotion._autodiff`): shared terms are computed once.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion._autodiff import driven, fenced
from jaxmotion._types import AnyArray
from jaxmotion.frames.count import step_mask
from jaxmotion.quaternion.parts import (
    Parts,
    added,
    conjugate,
    cross,
    dot,
    joined_neighbours,
    neighbours,
    normalized,
    parts_of,
    product,
    scaled,
    subtracted,
    together,
)
from jaxmotion.quaternion.tangent import inverse_jacobian_factor, jacobian_factor


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


def _whole(value: Any) -> tuple:
    return (value,)


def _nothing(like: Parts) -> Parts:
    return tuple(jnp.zeros_like(x) for x in like[:3])


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
    return driven(_turning, _turning_pull, jax.lax.stop_gradient(r.q), r.turn, own=_whole)


def _turning(q: Parts, turn: Parts) -> Parts:
    return scaled(0.5, product(q, (jnp.zeros_like(turn[0]), *turn)))


def _turning_pull(q: Parts, pull: Parts) -> Parts:
    return scaled(0.5, product(conjugate(q), pull)[1:])


def step(a: Rotations, b: Rotations, part: float = 1.0) -> Parts:
    """part·ω, ω = log(a⁻¹b). A gradient keeps this and nothing else."""

    def value(a: Parts, b: Parts) -> Parts:
        return scaled(part, _step(a, b))

    def change(v: Parts, turns: tuple[Parts, Parts]) -> Parts:
        return scaled(part, _step_of_turns(scaled(1 / part, v), turns))

    def pull(v: Parts, pull: Parts) -> tuple[Parts, Parts]:
        return _turns_of_step(scaled(1 / part, v), scaled(part, pull))

    return driven(change, pull, _still(value, a.q, b.q), (a.turn, b.turn), own=_whole)


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
    difference, mean = subtracted(after, before), scaled(0.5, added(before, after))
    twice = cross(omega, cross(omega, difference))
    bent = scaled(_bend_factor(omega), twice)
    return added(added(difference, cross(omega, mean)), bent)


def _turns_of_step(omega: Parts, pull: Parts) -> tuple[Parts, Parts]:
    """The transpose of :func:`_step_of_turns`."""
    factor = fenced(_bend_factor, omega)
    once = cross(omega, pull)
    twice = scaled(factor, cross(omega, once))
    even, odd = added(pull, twice), scaled(0.5, once)
    return tuple(-x - y for x, y in zip(even, odd, strict=True)), subtracted(even, odd)


def steps(r: Rotations, count: Array | None = None) -> tuple[Rotations, Parts]:
    """r, and ω = log(q_i⁻¹q_{i+1}), f[T − 1, J], zero from the last of ``count`` frames on. Go on
    with the r that comes back: cotangents are then summed where they are computed. Neighbours are
    only taken apart inside the fence."""

    def value(q: Parts, count: Array | None) -> Parts:
        return among(count, _step(*neighbours(q)))

    both = _nothing(r.turn), _still(value, r.q, count)
    turn, omega = driven(
        _steps_change, _steps_pull, both, r.turn, (count,), own=lambda value: value[1:]
    )
    return Rotations(r.q, turn), omega


def _steps_change(omega: Parts, count: Array | None, turn: Parts) -> tuple[Parts, Parts]:
    return turn, among(count, _step_of_turns(omega, neighbours(turn)))


def _steps_pull(omega: Parts, count: Array | None, pull: tuple[Parts, Parts]) -> Parts:
    by_turn, by_omega = pull
    before, after = fenced(
        lambda omega, count, y: _turns_of_step(omega, among(count, y)), omega, count, by_omega
    )
    return added(by_turn, joined_neighbours(before, after))


def among(count: Array | None, steps: Parts) -> Parts:
    """The steps between the frames that count, and zeros."""
    if count is None:
        return steps
    real = step_mask(count, len(steps[0]) + 1)[:, None]
    return tuple(jnp.where(real, x, 0) for x in steps)


def halfway(
    r: Rotations, omega: Parts, vector: Callable[..., Parts], by: tuple, at: tuple = ()
) -> tuple[Rotations, Rotations]:
    """r to go on with, as in :func:`steps`, and slerp_½(q_i, q_{i+1})·exp(v_i) the short way round,
    f[T − 1, J], with v = vector(*by, *at) as in :func:`turned_by`; ``omega`` the steps."""
    v = vector(*jax.lax.stop_gradient(by), *at)
    change, pull = _made_again(_halfway_change, _halfway_pull, vector)
    both = _nothing(r.turn), _nothing(v)
    turn, middle = driven(change, pull, both, (r.turn, by), (by, at, (omega,)))
    return Rotations(r.q, turn), Rotations(_still(_halfway, r.q, v), middle)


def _halfway(q: Parts, v: Parts) -> Parts:
    a, b = neighbours(q)
    cosine = dot(a, b)
    scale = jax.lax.rsqrt(2 + 2 * jnp.abs(cosine))
    other = jnp.where(cosine < 0, -scale, scale)
    return _turned(tuple(x * scale + y * other for x, y in zip(a, b, strict=True)), v)


def _halfway_change(omega: Parts, v: Parts, by: tuple[Parts, Parts]) -> tuple[Parts, Parts]:
    turn, dv = by
    before, after = neighbours(turn)
    bent = cross(_quarter_tangent(omega), subtracted(after, before))
    middle = added(added(before, after), bent)
    return turn, _turn_of_turned(v, (scaled(0.5, middle), dv))


def _halfway_pull(omega: Parts, v: Parts, pull: tuple[Parts, Parts]) -> tuple[Parts, Parts]:
    def turns(omega: Parts, v: Parts, pull: Parts) -> tuple[Parts, Parts, Parts]:
        by_middle, by_v = _turns_of_turned(v, pull)
        half = scaled(0.5, by_middle)
        bent = cross(_quarter_tangent(omega), half)
        return added(half, bent), subtracted(half, bent), by_v

    by_turn, by_middle = pull
    before, after, by_v = fenced(turns, omega, v, by_middle)
    return added(by_turn, joined_neighbours(before, after)), by_v


def _quarter_tangent(omega: Parts) -> Parts:
    """tan(θ/4) about the axis of each step."""
    cosine, sine = _half_angle(dot(omega, omega))
    return scaled(sine / (1 + cosine), omega)


def _bend_factor(omega: Parts) -> Array:
    """k of M(ω) = I + ½[ω]× + k[ω]×²."""
    x = dot(omega, omega)
    cosine, sine = _half_angle(x)
    return inverse_jacobian_factor(x, cosine / (2 * sine))


def turned(r: Rotations, v: Parts, gains: Array | None = None) -> Rotations:
    """q·exp(v), or with ``gains`` f[J] q·exp(gains·v), which may be of any length."""
    if gains is None:
        return turned_by(r, lambda v: v, (v,))
    by = r.turn, v, gains
    turn = driven(_turn_of_scaled, _turns_of_scaled, _nothing(v), by, (v, gains))
    return Rotations(_still(_turned, r.q, v, gains), turn)


def turned_by(r: Rotations, vector: Callable[..., Parts], by: tuple, at: tuple = ()) -> Rotations:
    """q·exp(v) of a v = vector(*by, *at) that a gradient does not keep, but makes again when its
    cotangent is there. The derivative goes through ``by``, not through ``at``; give all that
    ``vector`` takes as arguments."""
    v = vector(*jax.lax.stop_gradient(by), *at)
    change, pull = _made_again(_turn_of_turned, _turns_of_turned, vector)
    turn = driven(change, pull, _nothing(v), (r.turn, by), (by, at, ()))
    return Rotations(_still(_turned, r.q, v), turn)


def _made_again(
    change: Callable, pull: Callable, vector: Callable[..., Parts]
) -> tuple[Callable, Callable]:
    """change(*rest, v, (turn, dv)) and its transpose, as maps of a turn and what v is made of."""

    def changed(by: tuple, at: tuple, rest: tuple, d: tuple[Parts, tuple]) -> Any:
        turn, d_by = d
        v, dv = jax.jvp(lambda *by: vector(*by, *at), by, d_by)
        return change(*rest, v, (turn, dv))

    def pulled(by: tuple, at: tuple, rest: tuple, y: Any) -> tuple[Parts, tuple]:
        v, back = jax.vjp(lambda *by: vector(*by, *at), *by)
        turn, by_v = pull(*rest, v, y)
        return turn, back(by_v)

    return changed, pulled


def _turned(q: Parts, v: Parts, gains: Array | None = None) -> Parts:
    v, cosine, sine = _scaled_angle(v, gains)
    return product(q, (cosine, *scaled(sine, v)))


def _scaled_angle(v: Parts, gains: Array | None) -> tuple[Parts, Array, Array]:
    """gains·v, and cos(θ/2) and sin(θ/2)/θ of its length."""
    if gains is None:
        return v, *_half_angle(dot(v, v))
    v = scaled(gains, v)
    x = dot(v, v)
    far = x > np.pi**2
    angle = jnp.sqrt(jnp.where(far, x, 1))
    turns = jax.lax.stop_gradient(jnp.round(angle / (2 * np.pi)))
    rest = angle - 2 * np.pi * turns
    cosine, sine = _half_angle(jnp.where(far, rest * rest, x))
    sign = 1 - 2 * (turns % 2)
    return v, sign * cosine, jnp.where(far, sign * sine * rest / angle, sine)


def _half_angle(x: Array) -> tuple[Array, Array]:
    """cos(θ/2) and sin(θ/2)/θ from θ²."""
    y = x / 16
    sine = _polynomial(_SINE, y)
    return 1 - 2 * y * sine * sine, 0.5 * sine * _polynomial(_COSINE, y)


def _turn_of_turned(v: Parts, by: tuple[Parts, Parts], gains: Array | None = None) -> Parts:
    """The turn of q·exp(v) from that of q and dv: exp(v)⁻¹ δ exp(v) + Jr(v) dv."""
    turn, dv = by
    bent = _bent(v, gains, -1)
    return added(bent(turn)[0], bent(dv)[1])


def _turns_of_turned(v: Parts, pull: Parts, gains: Array | None = None) -> tuple[Parts, Parts]:
    """The transpose of :func:`_turn_of_turned`."""
    return _bent(v, gains, 1)(pull)


def _turn_of_scaled(v: Parts, gains: Array, by: tuple[Parts, Parts, Array]) -> Parts:
    turn, dv, dgains = by
    return _turn_of_turned(v, (turn, added(scaled(gains, dv), scaled(dgains, v))), gains)


def _turns_of_scaled(v: Parts, gains: Array, pull: Parts) -> tuple[Parts, Parts, Array]:
    turn, by = _turns_of_turned(v, pull, gains)
    return turn, scaled(gains, by), jnp.sum(dot(v, by), axis=0)


def _bent(v: Parts, gains: Array | None, sign: int) -> Callable[[Parts], tuple[Parts, Parts]]:
    """y to exp(±v) y exp(±v)⁻¹ = (I ± a[v]× + b[v]×²) y and Jr(∓v) y = (I ± b[v]× + k[v]×²) y."""

    def factors(v: Parts, gains: Array | None) -> tuple[Array, Array]:
        _, cosine, sine = _scaled_angle(v, gains)
        return 2 * cosine * sine, 2 * sine * sine

    a, b = fenced(factors, v, gains)
    v = v if gains is None else scaled(gains, v)
    k = jacobian_factor(dot(v, v), a)

    def bent(y: Parts) -> tuple[Parts, Parts]:
        once = cross(v, y)
        twice = cross(v, once)
        moved = added(y, added(scaled(sign * a, once), scaled(b, twice)))
        return moved, added(y, added(scaled(sign * b, once), scaled(k, twice)))

    return bent
