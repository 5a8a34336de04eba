"""Smoothest sequence through weighted observations, solved as a chain of (position, velocity).

    minimise over x:   sum_j p_j (v_{j+1} - v_j)^2                       curvature penalty
                     + sum_j [n0_j x_j^2 - 2 n1_j x_j v_j + n2_j v_j^2]  observations, speed penalty
                     - 2 sum_j b_j x_j

that is, solve ``P x = b`` for the pentadiagonal P of that quadratic form.

    x_j  position at frame j = 0 .. T-1      v_j = x_j - x_{j-1}, its backward difference (v_0 = 0)
    p_j  penalty on the change of velocity from frame j to j+1; p_0 = p_{T-1} = 0
    n    information added at frame j: an observation of weight w placed ``g`` frames before frame j
         reads x_j - g v_j and adds (w, w g, w g^2); a first-difference prior q v_j^2 adds q to n2

Shapes: frames first, ``(T, *channels)``; every coefficient ``(T, *k)``, each axis of ``k`` equal to
that channel axis or 1. Coefficients shared by all channels (``k`` all ones) are factored once.
Cost: O(T) time and memory, two passes over the data.

Elimination. Keep the information matrix ``[[a, b], [b, d]]`` and vector ``(h, k)`` of the state
``(x_j, v_j)`` given all frames before; start from a = b = 0, d = 1. Then for each frame

    observe        a += n0          b -= n1      d += n2             h += b_j
    eliminate v_j  a' = a - b beta  b' = rho b   d' = rho d          h' = h - beta k  k' = rho k
    x_j = x+ - v+  a  = a'          b = b' - a'  d = d' - 2 b' + a'  h  = h'          k  = k' - h'

with ``D = d + p``, ``beta = b / D``, ``rho = p / D``; and backwards, from ``x_{T-1} = h / a`` with
v+ = 0,

    x_j = x+ - v+  v_j = rho v+ - beta x_j + k / D

Noise of variance 1/D in place of ``k / D`` draws from N(0, 1/P); the second moment of that
recursion is the selected inverse of P; ``det P = a_{T-1} prod D_j``. These are the information
filter and the backward smoother of an integrated random walk (Kailath, Sayed and Hassibi, *Linear
Estimation*, 2000, ch. 9-10).

Sharp bits: this order of elimination is what keeps float32 usable. A plain pentadiagonal LDL^T
stores ``6 p + n0`` and has lost ``n0`` once p passes 1/eps; here they never share a sum. P must be
positive definite (two observed positions where a curvature penalty carries the chain, one where a
speed penalty does): nothing here checks it. Entry 0 of n1 and n2 must be zero.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, PRNGKeyArray

from jaxmotion._portable import Portable


class DifferenceChain(Portable):
    """The matrix P of the quadratic form above: ``p, n0, n1, n2``, each ``(T, *k)``."""

    curvature: Float[Array, "frames ..."] = eqx.field(converter=jnp.asarray)
    position: Float[Array, "frames ..."] = eqx.field(converter=jnp.asarray)
    cross: Float[Array, "frames ..."] = eqx.field(converter=jnp.asarray)
    speed: Float[Array, "frames ..."] = eqx.field(converter=jnp.asarray)


class State(NamedTuple):
    """Symmetric 2x2 matrix over (position, velocity): information ``a, b, d``, or covariance."""

    position: Array
    cross: Array
    velocity: Array


class ChainFactor(eqx.Module):
    """``p``, ``beta``, ``1/D`` of every frame ``(T, *k)``; ``precision``: ``a`` of the last."""

    curvature: Float[Array, "frames ..."]
    beta: Float[Array, "frames ..."]
    inverse_pivot: Float[Array, "frames ..."]
    precision: Float[Array, "..."]


def eliminate(info: State, curvature: Array) -> tuple[State, Array, Array]:
    """Drop v_j, then write x_j as x+ - v+: information of the next state, ``beta`` and ``1/D``."""
    a, b, d = info
    inverse_pivot = 1 / (d + curvature)
    beta, rho = b * inverse_pivot, curvature * inverse_pivot
    a, b, d = a - b * beta, rho * b, rho * d
    return State(a, b - a, d - 2 * b + a), beta, inverse_pivot


@jax.jit
def chain_factor(chain: DifferenceChain) -> ChainFactor:
    """Eliminate frame after frame, O(T). Differentiable, as a scan."""
    inputs = (chain.curvature, chain.position, chain.cross, chain.speed)
    shape = jnp.broadcast_shapes(*(leaf.shape[1:] for leaf in inputs))

    def step(info, inputs):
        p, n0, n1, n2 = inputs
        seen = State(info.position + n0, info.cross - n1, info.velocity + n2)
        info, beta, inverse_pivot = eliminate(seen, p)
        return info, (beta, inverse_pivot)

    zero = jnp.zeros(shape, chain.position.dtype)
    last, gains = lax.scan(step, State(zero, zero, zero + 1), inputs)
    return ChainFactor(chain.curvature, *gains, last.position)


@jax.jit
def chain_matvec(chain: DifferenceChain, x: Float[Array, "frames ..."]) -> Array:
    """``P x``, written with differences so that a smooth ``x`` loses no digits."""
    if x.shape[0] == 1:
        return chain.position * x
    cross, v = chain.cross[1:], x[1:] - x[:-1]
    bend = chain.curvature[1:-1] * (v[1:] - v[:-1])
    along_v = chain.speed[1:] * v - cross * x[1:] + _shifted(bend, 1) - _shifted(bend, 0)
    return chain.position * x + _shifted(along_v - cross * v, 1) - _shifted(along_v, 0)


def _shifted(x: Array, before: int) -> Array:
    """``x`` with one frame of zeros, before it or after it."""
    return jnp.pad(x, [(before, 1 - before)] + [(0, 0)] * (x.ndim - 1))


@jax.jit
def chain_solve(chain: DifferenceChain, b: Float[Array, "frames ..."]) -> Array:
    """Solve ``P x = b``; ``b`` and ``x`` are ``(T, *channels)``. Exact when ``b = P constant``.

    Derivatives in ``b`` and in every coefficient, of any order and in both modes, are implicit:
    another solve with the same factor, never a differentiated scan.
    """
    fixed = lax.stop_gradient(chain)
    factor, weight = chain_factor(fixed), row_sums(fixed)

    def solve(_, b):
        return _substitute(factor, weight, b)

    return lax.custom_linear_solve(partial(chain_matvec, chain), b, solve, symmetric=True)


def row_sums(chain: DifferenceChain) -> Array:
    """``P 1``."""
    return (chain.position - chain.cross).at[:-1].add(chain.cross[1:])


def level_of(weight: Array, b: Array) -> Array:
    """A constant near x, from ``weight = P 1``: solving for the rest keeps digits."""
    # Any level will do: the first observed frame's own value costs nothing.
    first = jnp.argmax(weight > 0, axis=0, keepdims=True)
    seen = jnp.take_along_axis(b, jnp.broadcast_to(first, (1, *b.shape[1:])), axis=0)[0]
    return seen / jnp.take_along_axis(weight, first, axis=0)[0]


def _substitute(factor: ChainFactor, weight: Array, b: Array) -> Array:
    """Substitute ``b - level * (P 1)`` forwards and back; the level is added at the end."""
    level = level_of(weight, b)

    def forward(data, inputs):
        h, k = data
        p, beta, inverse_pivot, n, b = inputs
        h, offset = h + (b - n * level) - beta * k, k * inverse_pivot
        return (h, p * offset - h), offset

    def backward(state, inputs):
        x, v = state
        p, beta, inverse_pivot, offset = inputs
        x = x - v
        return (x, p * inverse_pivot * v - beta * x + offset), x + level

    gains = (factor.curvature, factor.beta, factor.inverse_pivot)
    zero = jnp.zeros_like(level)
    (h, _), offsets = lax.scan(forward, (zero, zero), (*gains, weight, b))
    _, x = lax.scan(backward, (h / factor.precision, zero), (*gains, offsets), reverse=True)
    return x


@jax.jit
def chain_covariance(factor: ChainFactor) -> State:
    """Selected inverse of P: covariance of every (x_j, v_j), each entry ``(T, *k)``.

    Gives the lag-one covariance too: ``cov(x_{j-1}, x_j) = position_j - cross_j``. Frame 0 has no
    velocity: zeros. Differentiable, as a scan.
    """

    def backward(cov, gains):
        p, beta, inverse_pivot = gains
        rho = p * inverse_pivot
        before = cov.position - 2 * cov.cross + cov.velocity  # var(x+ - v+)
        lagged = cov.cross - cov.velocity  # cov(x+ - v+, v+)
        cross = rho * lagged - beta * before
        velocity = rho * rho * cov.velocity - 2 * rho * beta * lagged + beta * beta * before
        cov = State(before, cross, velocity + inverse_pivot)
        return cov, cov

    zero = jnp.zeros_like(factor.precision)
    gains = (factor.curvature, factor.beta, factor.inverse_pivot)
    _, cov = lax.scan(backward, State(1 / factor.precision, zero, zero), gains, reverse=True)
    return State(cov.position, cov.cross.at[0].set(0), cov.velocity.at[0].set(0))


@jax.custom_jvp
def chain_log_det(chain: DifferenceChain) -> Array:
    """``log det P``, shape ``k``; its derivative is read off the selected inverse."""
    return _log_det(chain_factor(chain))


def _log_det(factor: ChainFactor) -> Array:
    return jnp.log(factor.precision) - jnp.sum(jnp.log(factor.inverse_pivot), axis=0)


@chain_log_det.defjvp
def _chain_log_det_jvp(primals, tangents):
    (chain,), (change,) = primals, tangents
    factor = chain_factor(chain)
    cov = chain_covariance(factor)
    rate = jnp.sum(change.curvature[1:-1] * _bend_variance(factor, cov), axis=0) + jnp.sum(
        change.position * cov.position - 2 * change.cross * cov.cross + change.speed * cov.velocity,
        axis=0,
    )
    return _log_det(factor), rate


def _bend_variance(factor: ChainFactor, cov: State) -> Array:
    """Variance of ``v_{j+1} - v_j``, j = 1 .. T-2, off the back substitution."""
    beta, inverse_pivot = factor.beta[1:-1], factor.inverse_pivot[1:-1]
    slack = 1 - factor.curvature[1:-1] * inverse_pivot - beta
    position, cross, velocity = (entry[2:] for entry in cov)
    return (
        beta * beta * position + 2 * beta * slack * cross + slack * slack * velocity + inverse_pivot
    )


@partial(jax.jit, static_argnames="channels")
def chain_sample(factor: ChainFactor, key: PRNGKeyArray, channels: tuple[int, ...]) -> Array:
    """One draw of N(0, 1/P), ``(T, *channels)``, independent over channels. Differentiable."""
    gains = (factor.curvature, factor.beta, factor.inverse_pivot)
    frames, dtype = factor.beta.shape[0], factor.beta.dtype
    noise = jax.random.normal(key, (frames + 1, *channels), dtype)

    def backward(state, inputs):
        x, v = state
        p, beta, inverse_pivot, noise = inputs
        x = x - v
        v = p * inverse_pivot * v - beta * x + jnp.sqrt(inverse_pivot) * noise
        return (x, v), x

    end = (noise[-1] / jnp.sqrt(factor.precision), jnp.zeros_like(noise[-1]))
    return lax.scan(backward, end, (*gains, noise[:-1]), reverse=True)[1]
