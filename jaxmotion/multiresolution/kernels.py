"""Rotations by components: what every level of a pyramid computes most.

    step(a, b)    = log(a⁻¹b) = ω        dω = M(ω) δ_b − M(ω)ᵀ δ_a
    turned(q, v)  = q·exp(v) = q′        δ′ = exp(v)⁻¹ δ_q exp(v) + Jr(v) dv
    halfway(q, v) = slerp_½(a, b)·exp(v) δ_m = ½(δ_a + δ_b) + ½ tan(θ/4)n × (δ_b − δ_a),  ω = θn

    δ = 2 vec(q̄ dq), the turn of q in its own frame
    exp(v)⁻¹ y exp(v) = (I − a[v]× + b[v]×²) y,   a = sin θ/θ,  θ = ‖v‖
    Jr(v) = I − b[v]× + k[v]×²,    b = (1 − cos θ)/θ²,  k = (1 − a)/θ²
    M(ω)  = I + ½[ω]× + k[ω]×²,    k = (1 − (θ/2)cot(θ/2))/θ²,  θ = ‖ω‖

Derivatives go by δ, three numbers and not four: :class:`Rotations` holds quaternions that are
constants to derivatives beside a ``tangent`` that is zero and carries them, from
:func:`rotations_of` to :func:`quaternions_of`. The formulas above (Chirikjian 2012, §10.7) hold
wherever q is, so derivatives of derivatives are right as well; both modes, because differentiating
log and exp costs several times as much.

``Parts`` are arrays of any one shape, four a quaternion and three a vector; where time matters
of ``frame``s, f[T, ...], or of the ``step``s from each to the next, f[T − 1, ...]. Functions in
pairs ``_x_change`` and ``_x_pull`` are what a derivative does forwards and backwards, by the
contract of :mod:`~jaxmotion._autodiff`.

A gradient keeps little: pulls need steps and vectors only, no quaternions, and a vector that is
cheap to make is made again (:func:`turned_by`, :func:`halfway`).

The values are those of :mod:`~jaxmotion.multiresolution.log_exp`. Sharp bits: quaternions must be
unit, v no longer than 2π unless it comes with gains. Everything is fenced
(:mod:`~jaxmotion._autodiff`): shared terms are computed once.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmotion._autodiff import driven, fenced
from jaxmotion._types import AnyArray
from jaxmotion.frames.count import step_mask
from jaxmotion.multiresolution.log_exp import half_angle, log_between, scaled_angle, times_exp
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
    running_signs,
    scaled,
    subtracted,
    together,
)
from jaxmotion.quaternion.tangent import inverse_jacobian_factor, jacobian_factor

FrameParts: TypeAlias = tuple[Float[Array, "frame *rest"], ...]
StepParts: TypeAlias = tuple[Float[Array, "step *rest"], ...]


class Rotations(NamedTuple):
    """Unit quaternions, four parts, ``constant`` to derivatives, and their ``tangent`` δ, three
    parts: zero, but what derivatives pass through. :func:`quaternions_of` has both."""

    constant: Parts
    tangent: Parts

    @property
    def num_frames(self) -> int:
        """T."""
        return len(self.tangent[0])


def _constant(f: Callable[..., Any], *args: Any) -> Any:
    """f(*args), a constant to derivatives."""
    return fenced(f, *jax.lax.stop_gradient(args))


def _whole(value: Any) -> tuple:
    return (value,)


def _nothing(like: Parts) -> Parts:
    return tuple(jnp.zeros_like(x) for x in like[:3])


def rotations_of(q: Float[AnyArray, "*rest 4"]) -> Rotations:
    """q/‖q‖ with its tangent; the zero quaternion becomes the identity (derivative 0)."""
    q = jnp.asarray(q)
    unit = normalized(parts_of(jax.lax.stop_gradient(q)))
    return Rotations(unit, driven(_own_change, _own_pull, _nothing(unit), q, (q,)))


def _own_change(q: Float[Array, "*rest 4"], dq: Float[Array, "*rest 4"]) -> Parts:
    """δ = 2 vec(q̄ dq)/‖q‖²."""
    parts = parts_of(q)
    return scaled(2 * _inverse_square(parts), product(conjugate(parts), parts_of(dq))[1:])


def _own_pull(q: Float[Array, "*rest 4"], pull: Parts) -> Float[Array, "*rest 4"]:
    parts = parts_of(q)
    tangent = jnp.zeros_like(pull[0]), *scaled(2 * _inverse_square(parts), pull)
    return together(product(parts, tangent))


def _inverse_square(q: Parts) -> Float[Array, "..."]:
    square = dot(q, q)
    return jnp.where(square > 0, 1 / jnp.where(square > 0, square, 1), 0)


def quaternions_of(r: Rotations) -> Parts:
    """q with its derivative ½ q·(0, δ)."""
    q = jax.lax.stop_gradient(r.constant)
    return driven(_differential_change, _differential_pull, q, r.tangent, own=_whole)


def _differential_change(q: Parts, tangent: Parts) -> Parts:
    return scaled(0.5, product(q, (jnp.zeros_like(tangent[0]), *tangent)))


def _differential_pull(q: Parts, pull: Parts) -> Parts:
    return scaled(0.5, product(conjugate(q), pull)[1:])


def step(a: Rotations, b: Rotations, part: float = 1.0) -> Parts:
    """part·ω, ω = log(a⁻¹b). A gradient keeps this and nothing else."""

    def value(a: Parts, b: Parts) -> Parts:
        return scaled(part, log_between(a, b))

    def change(v: Parts, tangents: tuple[Parts, Parts]) -> Parts:
        return scaled(part, _step_change(scaled(1 / part, v), tangents))

    def pull(v: Parts, pull: Parts) -> tuple[Parts, Parts]:
        return _step_pull(scaled(1 / part, v), scaled(part, pull))

    omega = _constant(value, a.constant, b.constant)
    return driven(change, pull, omega, (a.tangent, b.tangent), own=_whole)


def _step_change(omega: Parts, tangents: tuple[Parts, Parts]) -> Parts:
    """dω of the two rotations' tangents: M(ω) δ_b − M(ω)ᵀ δ_a."""
    before, after = tangents
    difference, mean = subtracted(after, before), scaled(0.5, added(before, after))
    twice = cross(omega, cross(omega, difference))
    bent = scaled(_bend_factor(omega), twice)
    return added(added(difference, cross(omega, mean)), bent)


def _step_pull(omega: Parts, pull: Parts) -> tuple[Parts, Parts]:
    """The transpose of :func:`_step_change`."""
    factor = fenced(_bend_factor, omega)
    once = cross(omega, pull)
    twice = scaled(factor, cross(omega, once))
    even, odd = added(pull, twice), scaled(0.5, once)
    return tuple(-x - y for x, y in zip(even, odd, strict=True)), subtracted(even, odd)


def steps(r: Rotations, count: Int[Array, ""] | None = None) -> tuple[Rotations, StepParts]:
    """r, and ω = log(q_i⁻¹q_{i+1}), zero from the last of ``count`` frames on. Go on
    with the r that comes back: cotangents are then summed where they are computed. Neighbours are
    only taken apart inside the fence."""

    def value(q: FrameParts, count: Int[Array, ""] | None) -> StepParts:
        return among(count, log_between(*neighbours(q)))

    both = _nothing(r.tangent), _constant(value, r.constant, count)
    tangent, omega = driven(
        _steps_change, _steps_pull, both, r.tangent, (count,), own=lambda value: value[1:]
    )
    return Rotations(r.constant, tangent), omega


def _steps_change(
    omega: StepParts, count: Int[Array, ""] | None, tangent: FrameParts
) -> tuple[FrameParts, StepParts]:
    return tangent, among(count, _step_change(omega, neighbours(tangent)))


def _steps_pull(
    omega: StepParts, count: Int[Array, ""] | None, pull: tuple[FrameParts, StepParts]
) -> FrameParts:
    by_tangent, by_omega = pull
    before, after = fenced(
        lambda omega, count, y: _step_pull(omega, among(count, y)), omega, count, by_omega
    )
    return added(by_tangent, joined_neighbours(before, after))


def among(count: Int[Array, ""] | None, steps: StepParts) -> StepParts:
    """The steps between the frames that count, and zeros."""
    if count is None:
        return steps
    real = step_mask(count, len(steps[0]) + 1)[:, None]
    return tuple(jnp.where(real, x, 0) for x in steps)


def halfway(
    r: Rotations, omega: StepParts, vector: Callable[..., StepParts], by: tuple, at: tuple = ()
) -> tuple[Rotations, Rotations]:
    """r to go on with, as in :func:`steps`, and slerp_½(q_i, q_{i+1})·exp(v_i) the short way round,
    one a step, with v = vector(*by, *at) as in :func:`turned_by`; ``omega`` the steps."""
    v = vector(*jax.lax.stop_gradient(by), *at)
    change, pull = _made_again(_halfway_change, _halfway_pull, vector)
    both = _nothing(r.tangent), _nothing(v)
    tangent, middle = driven(change, pull, both, (r.tangent, by), (by, at, (omega,)))
    return Rotations(r.constant, tangent), Rotations(_constant(_halfway, r.constant, v), middle)


def _halfway(q: FrameParts, v: StepParts) -> StepParts:
    a, b = neighbours(q)
    cosine = dot(a, b)
    scale = jax.lax.rsqrt(2 + 2 * jnp.abs(cosine))
    other = jnp.where(cosine < 0, -scale, scale)
    return times_exp(tuple(x * scale + y * other for x, y in zip(a, b, strict=True)), v)


def _halfway_change(
    omega: StepParts, v: StepParts, by: tuple[FrameParts, StepParts]
) -> tuple[FrameParts, StepParts]:
    tangent, dv = by
    before, after = neighbours(tangent)
    bent = cross(_tan_of_quarter(omega), subtracted(after, before))
    middle = added(added(before, after), bent)
    return tangent, _turned_change(v, (scaled(0.5, middle), dv))


def _halfway_pull(
    omega: StepParts, v: StepParts, pull: tuple[FrameParts, StepParts]
) -> tuple[FrameParts, StepParts]:
    def pulls(omega: StepParts, v: StepParts, pull: StepParts) -> tuple[StepParts, ...]:
        by_middle, by_v = _turned_pull(v, pull)
        half = scaled(0.5, by_middle)
        bent = cross(_tan_of_quarter(omega), half)
        return added(half, bent), subtracted(half, bent), by_v

    by_tangent, by_middle = pull
    before, after, by_v = fenced(pulls, omega, v, by_middle)
    return added(by_tangent, joined_neighbours(before, after)), by_v


def _tan_of_quarter(omega: Parts) -> Parts:
    """tan(θ/4) about the axis of each step."""
    cosine, sine = half_angle(dot(omega, omega))
    return scaled(sine / (1 + cosine), omega)


def _bend_factor(omega: Parts) -> Float[Array, "..."]:
    """k of M(ω) = I + ½[ω]× + k[ω]×²."""
    x = dot(omega, omega)
    cosine, sine = half_angle(x)
    return inverse_jacobian_factor(x, cosine / (2 * sine))


def turned(r: Rotations, v: Parts, gains: Float[Array, "*joint"] | None = None) -> Rotations:
    """q·exp(v), or with ``gains`` f[J] q·exp(gains·v), which may be of any length."""
    if gains is None:
        return turned_by(r, lambda v: v, (v,))
    by = r.tangent, v, gains
    tangent = driven(_scaled_change, _scaled_pull, _nothing(v), by, (v, gains))
    return Rotations(_constant(times_exp, r.constant, v, gains), tangent)


def turned_by(r: Rotations, vector: Callable[..., Parts], by: tuple, at: tuple = ()) -> Rotations:
    """q·exp(v) of a v = vector(*by, *at) that a gradient does not keep, but makes again when its
    cotangent is there. The derivative goes through ``by``, not through ``at``; give all that
    ``vector`` takes as arguments."""
    v = vector(*jax.lax.stop_gradient(by), *at)
    change, pull = _made_again(_turned_change, _turned_pull, vector)
    tangent = driven(change, pull, _nothing(v), (r.tangent, by), (by, at, ()))
    return Rotations(_constant(times_exp, r.constant, v), tangent)


def aligned(r: Rotations) -> Rotations:
    """The same rotations, neighbours in time in one hemisphere."""
    q = jax.lax.stop_gradient(r.constant)
    return Rotations(scaled(running_signs(q), q), r.tangent)


def _made_again(
    change: Callable, pull: Callable, vector: Callable[..., Parts]
) -> tuple[Callable, Callable]:
    """change(*rest, v, (tangent, dv)) and its transpose, as maps of a tangent and of what v is made
    of."""

    def changed(by: tuple, at: tuple, rest: tuple, d: tuple[Parts, tuple]) -> Any:
        tangent, d_by = d
        v, dv = jax.jvp(lambda *by: vector(*by, *at), by, d_by)
        return change(*rest, v, (tangent, dv))

    def pulled(by: tuple, at: tuple, rest: tuple, y: Any) -> tuple[Parts, tuple]:
        v, back = jax.vjp(lambda *by: vector(*by, *at), *by)
        tangent, by_v = pull(*rest, v, y)
        return tangent, back(by_v)

    return changed, pulled


def _turned_change(
    v: Parts, by: tuple[Parts, Parts], gains: Float[Array, "*joint"] | None = None
) -> Parts:
    """The tangent of q·exp(v) from that of q and dv: exp(v)⁻¹ δ exp(v) + Jr(v) dv."""
    tangent, dv = by
    bent = _bent(v, gains, -1)
    return added(bent(tangent)[0], bent(dv)[1])


def _turned_pull(
    v: Parts, pull: Parts, gains: Float[Array, "*joint"] | None = None
) -> tuple[Parts, Parts]:
    """The transpose of :func:`_turned_change`."""
    return _bent(v, gains, 1)(pull)


def _scaled_change(
    v: FrameParts,
    gains: Float[Array, "*joint"],
    by: tuple[FrameParts, FrameParts, Float[Array, "*joint"]],
) -> FrameParts:
    tangent, dv, dgains = by
    return _turned_change(v, (tangent, added(scaled(gains, dv), scaled(dgains, v))), gains)


def _scaled_pull(
    v: FrameParts, gains: Float[Array, "*joint"], pull: FrameParts
) -> tuple[FrameParts, FrameParts, Float[Array, "*joint"]]:
    tangent, by = _turned_pull(v, pull, gains)
    return tangent, scaled(gains, by), jnp.sum(dot(v, by), axis=0)


def _bent(
    v: Parts, gains: Float[Array, "*joint"] | None, sign: int
) -> Callable[[Parts], tuple[Parts, Parts]]:
    """y to exp(±v) y exp(±v)⁻¹ = (I ± a[v]× + b[v]×²) y and Jr(∓v) y = (I ± b[v]× + k[v]×²) y."""

    def factors(v: Parts, gains: Array | None) -> tuple[Array, Array]:
        _, cosine, sine = scaled_angle(v, gains)
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
