"""Smoothest sequence through weighted readings, solved as a chain of (position, velocity).

    minimise over x:   sum_j p_j (v_{j+1} - v_j - c_j)^2     curvature penalty
                     + sum_j n_j (x_j - g_j v_j - z_j)^2     readings
                     + sum_j (r_j v_j^2 - 2 f_j v_j)         speed penalty and push

    x_j  position at frame j = 0 .. T-1      v_j = x_j - x_{j-1}, its backward difference (v_0 = 0)
    p_j  penalty on the change of velocity from frame j to j+1; p_0 = p_{T-1} = 0
    n_j  weight of what was read ``g_j`` frames before frame j, g in [0, 1]
    r_j  weight that keeps v_j small: a first-difference prior
    z, f, c   the reading, the push on v_j and the change of velocity expected, per channel

P is the matrix of that quadratic form. Shapes: frames first; z, f, c and x ``(T, *channels)``;
every coefficient ``(T, *k)``, each axis of ``k`` equal to that channel axis or 1. Coefficients
shared by all channels (``k`` all ones) are factored once. Cost: O(T) time and memory, two passes.

Several readings of one frame are one: with n the sum of their weights w, and g and z the means by
w, what is left is ``r = sum w (g_i - g)^2`` and ``f = -sum w (g_i - g) (z_i - z)``.

Elimination. What frames before j know of ``(x_j, v_j)`` is kept as two squares and a slope,
``a (x - m v - y)^2 + d v^2 - 2 k v``; start from a = m = y = k = 0, d = 1. Then for each frame

    shift          m += 1                            for x_{j-1} = x_j - v_j
    read           A = a + n
                   d += a n (m - g)^2 / A + r        two readings apart tell of the velocity
                   k += a n (m - g) (z - y) / A + f
                   m, y = (a m + n g) / A, (a y + n z) / A
    eliminate v_j  D = d + p, rho = p / D            v_j given v_{j+1}
                   y += m k / D - m rho c            k = rho (k + d c)
                   a = 1 / (1 / a + m^2 / D)         m *= rho     d *= rho

and backwards, from ``x_{T-1} = y`` with v+ = 0,

    x_j = x+ - v+      v_j = (p (v+ - c) + k + a m (x_j - y)) / (D + a m^2)

Covariances, determinant and draws are in ``linalg.chain_covariance``.

This is the information filter of an integrated random walk (Kailath, Sayed and Hassibi, *Linear
Estimation*, 2000, ch. 9-10) with every matrix in factors.

Sharp bits: only positive numbers are added, multiplied and divided, so that float32 keeps its
digits whatever the size of p beside n: from the spline through keys hundreds of frames apart
(p -> 0) to the straight line (p -> infinity). A pentadiagonal LDL^T stores ``6 p + n`` and has lost
n once p passes 1/eps; a plain information matrix of (x, v) has lost the velocity once p falls below
eps. P must be positive definite (two positions read where a curvature penalty carries the chain,
one where a speed penalty does): nothing here checks it. Entry 0 of g and r must be zero. Where
nothing was read before, weights of exactly 0 have no derivative.
"""

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from jaxmotion._portable import Portable
from jaxmotion._summary import line, per_frame


class DifferenceChain(Portable):
    """The coefficients of the quadratic form in the module.

    **Fields:** f[T, *k] each: ``curvature``: p; ``weight``: n; ``back``: g; ``speed``: r.
    """

    curvature: Float[Array, "frames ..."] = eqx.field(converter=jnp.asarray)
    weight: Float[Array, "frames ..."] = eqx.field(converter=jnp.asarray)
    back: Float[Array, "frames ..."] = eqx.field(converter=jnp.asarray)
    speed: Float[Array, "frames ..."] = eqx.field(converter=jnp.asarray)


class Information(NamedTuple):
    """``a (x - m v)^2 + d v^2``: what is known of a state (x, v), all entries >= 0."""

    position: Array
    lever: Array
    velocity: Array

    def __repr__(self) -> str:
        return line(self)


class Gains(NamedTuple):
    """The numbers of the two passes: ``y += take (z - y)``, ``k += pull (z - y)``, ``y += lean k``,
    ``k *= rho``; and back ``v = inverse k + hold (x - y) + slack v+``."""

    take: Array
    pull: Array
    lean: Array
    rho: Array
    inverse: Array
    hold: Array
    slack: Array

    def __repr__(self) -> str:
        return line(self)


class ChainFactor(Portable):
    """What frames 0 .. j know of (x_j, v_j), and the numbers of both passes.

    **Fields:** ``chain``: the coefficients; ``info``: :class:`Information`; ``gains``:
    :class:`Gains`; all f[T, *k].
    """

    chain: DifferenceChain
    info: Information
    gains: Gains

    def _words(self) -> Iterator[str]:
        yield per_frame(self.info.position)

    @property
    def spread(self) -> Array:
        """``D``: precision of v_j given v_{j+1} and all frames before."""
        return self.info.velocity + self.chain.curvature

    @property
    def pivot(self) -> Array:
        """``D + a m^2``: precision of v_j given x_j too."""
        return self.spread + self.info.position * self.info.lever**2

    @property
    def precision(self) -> Array:
        """``a`` of x_{T-1} in the end, ``(*k)``."""
        last = jax.tree.map(lambda entry: entry[-1], self.info)
        return eliminate(last, self.chain.curvature[-1]).position


def over(x: Array, y: Array) -> Array:
    """``x / y``, 0 where y is 0."""
    return jnp.where(y > 0, x / jnp.where(y > 0, y, 1), 0)


def shifted(info: Information) -> Information:
    """The same knowledge, in terms of the next frame's position."""
    return info._replace(lever=info.lever + 1)


def with_reading(info: Information, weight: Array, back: Array, speed: Array) -> Information:
    """Add a reading ``back`` frames before the frame, and a weight ``speed`` on the velocity."""
    a, m, d = info
    total = a + weight
    scale = over(jnp.ones_like(total), total)
    lever = jnp.where(total > 0, (a * m + weight * back) * scale, back)
    return Information(total, lever, d + a * weight * scale * (m - back) ** 2 + speed)


def eliminate(info: Information, curvature: Array) -> Information:
    """Drop v for the next velocity, which differs from it with precision ``curvature``."""
    a, m, d = info
    spread = d + curvature
    pivot = spread + a * m * m
    rho = over(curvature, spread)
    return Information(jnp.where(pivot > 0, a * over(spread, pivot), a), m * rho, d * rho)


@jax.jit
def chain_factor(chain: DifferenceChain) -> ChainFactor:
    """Eliminate frame after frame.

    O(T). Differentiable, as a scan.

    **Arguments:** ``chain``: the coefficients.
    **Returns:** :class:`ChainFactor`.
    """
    return with_gains(chain, known(at_rest(chain), chain))


def with_gains(chain: DifferenceChain, info: Information) -> ChainFactor:
    """The gains of all frames at once: a scan that keeps less runs faster."""
    return ChainFactor(chain, info, gains(before(info, chain.curvature), info, chain))


def at_rest(chain: DifferenceChain) -> Information:
    """Before frame 0, which has no velocity."""
    nothing = nothing_known(chain)
    return nothing._replace(velocity=nothing.velocity + 1)


def nothing_known(chain: DifferenceChain) -> Information:
    """Of one state, each entry of the coefficients' shape ``k``."""
    shape = jnp.broadcast_shapes(*(leaf.shape[1:] for leaf in jax.tree.leaves(chain)))
    return Information(*[jnp.zeros(shape, chain.weight.dtype)] * 3)


def known(start: Information, chain: DifferenceChain, reverse: bool = False) -> Information:
    """What is known once each frame is read, before its velocity is eliminated."""

    def step(info, frame):
        seen = with_reading(shifted(info), frame.weight, frame.back, frame.speed)
        return eliminate(seen, frame.curvature), seen

    return lax.scan(step, start, chain, reverse=reverse)[1]


def gains(earlier: Information, seen: Information, frame: DifferenceChain) -> Gains:
    """Of frames, from what is known of them before and once they are read."""
    a, m, d = seen
    spread = d + frame.curvature
    inverse = 1 / (spread + a * m * m)
    take = over(frame.weight, a)
    pull = take * earlier.position * (earlier.lever - frame.back)
    lean, rho = over(m, spread), over(frame.curvature, spread)
    return Gains(take, pull, lean, rho, inverse, a * m * inverse, frame.curvature * inverse)


@jax.jit
def chain_smooth(
    chain: DifferenceChain,
    readings: Float[Array, "frames ..."],
    push: Float[Array, "frames ..."] | None = None,
) -> Array:
    """The minimiser x of the module's quadratic form.

    What is read with weight 0 does not count, but must be finite. Exact for readings that are all
    equal. Derivatives in everything, of any order and in both modes, are implicit: another solve
    with the same factor, never a differentiated scan. A weight of 0 has none. O(T) a channel.

    **Arguments:** ``chain``: the coefficients; ``readings``: z, f[T, *channels]; ``push``: f, f[T,
    *channels], None for zero.
    **Returns:** f[T, *channels].
    """
    return smoothest(chain_factor, _substituted, chain, readings, push)


def smoothest(factored, solve, chain: DifferenceChain, z: Array, f: Array | None) -> Array:
    """``solve(factored(chain), z, f, None, level)`` with the derivatives of a minimiser.

    ``level``: a constant near x; solving for the rest keeps digits. It changes nothing else.
    """
    # Any level will do: the first reading costs nothing.
    first = jnp.argmax(chain.weight > 0, axis=0, keepdims=True)
    level = jnp.take_along_axis(z, jnp.broadcast_to(first, (1, *z.shape[1:])), axis=0)[0]
    return _smoothest(factored, solve, chain, z, f, lax.stop_gradient(level))


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _smoothest(factored, solve, chain, z, f, level) -> Array:
    return solve(factored(chain), z, f, None, level)


@partial(_smoothest.defjvp, symbolic_zeros=True)
def _smoothest_jvp(factored, solve, primals, tangents):
    """The factor is shared by the value and its derivatives."""
    (chain, z, f, level), (rate, dz, df, _) = primals, tangents
    primals = chain, factored(chain), z, f, None, level
    return _solved_jvp(solve, primals, (rate, None, dz, df, None, None))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _solved(solve, chain: DifferenceChain, factor: ChainFactor, z, f, c, level) -> Array:
    """``solve``, which is linear in z, f and c; ``chain`` carries the derivatives of ``factor``.

    Where JAX takes loops apart it drops the rule; the function's own derivative is the same.
    """
    return solve(factor, z, f, c, level)


@partial(_solved.defjvp, symbolic_zeros=True)
def _solved_jvp(solve, primals, tangents):
    """The tangent minimises the same form with other readings, pushes and changes of velocity."""
    (chain, factor, z, f, c, level), (rate, _, dz, df, dc, _) = primals, tangents
    x = _solved(solve, chain, factor, z, f, c, level)
    v = jnp.concatenate([jnp.zeros_like(x[:1]), x[1:] - x[:-1]])
    miss = x - chain.back * v - z
    terms_z, terms_f, terms_c = ([] if _is_zero(t) else [t] for t in (dz, df, dc))
    if not _is_zero(rate.weight):
        terms_z.append(-over(rate.weight, chain.weight) * miss)
    if not _is_zero(rate.back):
        terms_z.append(rate.back * v)
        terms_f.append(chain.weight * rate.back * miss)
    if not _is_zero(rate.speed):
        terms_f.append(-rate.speed * v)
    if not _is_zero(rate.curvature):
        bend = jnp.pad(v[2:] - v[1:-1], [(1, x.shape[0] > 1)] + [(0, 0)] * (x.ndim - 1))
        bend = bend if c is None else bend - c
        terms_c.append(-over(rate.curvature, chain.curvature) * bend)
    none = jnp.zeros_like(x)
    dz = sum(terms_z, none)
    df, dc = (sum(terms, none) if terms else None for terms in (terms_f, terms_c))
    return x, _solved(solve, chain, factor, dz, df, dc, None)


def _is_zero(tangent) -> bool:
    return tangent is None or isinstance(tangent, SymbolicZero)


def shares(factor: ChainFactor) -> tuple[Array, Array, Array]:
    """Of a change of velocity c: what it takes from y and adds to k, and takes from k on the way
    back, each ``(T, *k)``."""
    curvature, (_, lever, velocity) = factor.chain.curvature, factor.info
    return lever * factor.gains.rho, velocity * factor.gains.rho, curvature


def _substituted(factor: ChainFactor, z, f, c, level) -> Array:
    """Forwards and back, linear in z, f and c; None for what is zero."""
    level = jnp.zeros((), z.dtype) if level is None else level

    def forward(state, inputs):
        y, k = state
        z, f, c, by = inputs
        apart = z - level - y
        y, k = y + by.take * apart, k + by.pull * apart
        k = k if f is None else k + f
        y_next, k_next, k_back = y + by.lean * k, by.rho * k, k
        if c is not None:
            c, (toward, change, ahead) = c
            y_next, k_next, k_back = y_next - toward * c, k_next + change * c, k - ahead * c
        return (y_next, k_next), by.inverse * k_back - by.hold * y

    def backward(state, inputs):
        x, v = state
        slack, hold, offset = inputs
        x = x - v
        return (x, slack * v + hold * x + offset), x + level

    zero = jnp.zeros_like(z[0])
    c = None if c is None else (c, shares(factor))
    (end, _), offsets = lax.scan(forward, (zero, zero), (z, f, c, factor.gains))
    back = factor.gains.slack, factor.gains.hold, offsets
    return lax.scan(backward, (end, zero), back, reverse=True)[1]


def before(info: Information, curvature: Array) -> Information:
    """What frames 0 .. j - 1 know of (x_j, v_j), from what 0 .. j do."""
    after = shifted(eliminate(info, curvature))
    return jax.tree.map(lambda e: jnp.concatenate([jnp.zeros_like(e[:1]), e[:-1]]), after)
