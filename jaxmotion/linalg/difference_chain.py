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

Noise of variance ``1 / (D + a m^2)`` in place of the data draws from N(0, 1/P); ``det P`` is the
product of those pivots and of the last a. The same pass from the other end, with ``1 - g`` for g,
gives what later frames know of (x_j, v_j), ``alpha (x + mu v)^2 + beta v^2``, and the two together
every marginal:

    var v = 1 / (d + beta + a alpha (m + mu)^2 / (a + alpha))
    var x = var v (a m^2 + alpha mu^2 + d + beta) / (a + alpha)
    cov(x, v) = var v (a m - alpha mu) / (a + alpha)

These are the information filters of an integrated random walk (Kailath, Sayed and Hassibi, *Linear
Estimation*, 2000, ch. 9-10) with every matrix in factors.

Sharp bits: only positive numbers are added, multiplied and divided, so that float32 keeps its
digits whatever the size of p beside n: from the spline through keys hundreds of frames apart
(p -> 0) to the straight line (p -> infinity). A pentadiagonal LDL^T stores ``6 p + n`` and has lost
n once p passes 1/eps; a plain information matrix of (x, v) has lost the velocity once p falls below
eps. P must be positive definite (two positions read where a curvature penalty carries the chain,
one where a speed penalty does): nothing here checks it. Entry 0 of g and r must be zero. Where
nothing was read before, weights of exactly 0 have no derivative.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float, PRNGKeyArray

from jaxmotion._portable import Portable


class DifferenceChain(Portable):
    """The coefficients ``p, n, g, r`` of the quadratic form above, each ``(T, *k)``."""

    curvature: Float[Array, "frames ..."] = eqx.field(converter=jnp.asarray)
    weight: Float[Array, "frames ..."] = eqx.field(converter=jnp.asarray)
    back: Float[Array, "frames ..."] = eqx.field(converter=jnp.asarray)
    speed: Float[Array, "frames ..."] = eqx.field(converter=jnp.asarray)


class Information(NamedTuple):
    """``a (x - m v)^2 + d v^2``: what is known of a state (x, v), all entries >= 0."""

    position: Array
    lever: Array
    velocity: Array


class State(NamedTuple):
    """Covariance of a state (position, velocity), symmetric, 2 by 2."""

    position: Array
    cross: Array
    velocity: Array


class Knowledge(NamedTuple):
    """What two sides know of one state (x, v): ``later`` as ``a (x + m v)^2 + d v^2``."""

    earlier: Information
    later: Information

    def covariance(self, back: Array | float = 0.0) -> State:
        """Covariance of ``(x - back v, v)``."""
        (a, m, d), (alpha, mu, beta) = self.earlier, self.later
        m, mu = m - back, mu + back
        share, other = a / (a + alpha), alpha / (a + alpha)
        velocity = 1 / (d + beta + a * other * (m + mu) ** 2)
        position = (share * m * m + other * mu * mu + (d + beta) / (a + alpha)) * velocity
        return State(position, (share * m - other * mu) * velocity, velocity)


class ChainFactor(eqx.Module):
    """What frames 0 .. j know of (x_j, v_j), each entry of ``info`` ``(T, *k)``."""

    chain: DifferenceChain
    info: Information

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
    """Eliminate frame after frame, O(T). Differentiable, as a scan."""
    nothing = _nothing(chain)
    start = nothing._replace(velocity=nothing.velocity + 1)
    return ChainFactor(chain, _known(start, chain))


def _nothing(chain: DifferenceChain) -> Information:
    shape = jnp.broadcast_shapes(*(leaf.shape[1:] for leaf in jax.tree.leaves(chain)))
    return Information(*[jnp.zeros(shape, chain.weight.dtype)] * 3)


def _known(start: Information, chain: DifferenceChain, reverse: bool = False) -> Information:
    """What is known once each frame is read, before its velocity is eliminated."""

    def step(info, chain):
        seen = with_reading(shifted(info), chain.weight, chain.back, chain.speed)
        return eliminate(seen, chain.curvature), seen

    return lax.scan(step, start, chain, reverse=reverse)[1]


@jax.jit
def chain_smooth(
    chain: DifferenceChain,
    readings: Float[Array, "frames ..."],
    push: Float[Array, "frames ..."] | None = None,
) -> Array:
    """The minimiser x ``(T, *channels)`` for readings z and a push f ``(T, *channels)``.

    What is read with weight 0 does not count, but must be finite. Exact for readings that are all
    equal. Derivatives in everything, of any order and in both modes, are implicit: another solve
    with the same factor, never a differentiated scan. A weight of 0 has none.
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


class Gains(NamedTuple):
    """The numbers of the two passes, ``(T, *k)``: ``y += take (z - y)``, ``k += pull (z - y)``,
    ``y += lean k``, ``k *= rho``; ``v = inverse k + hold (x - y) + slack v+``."""

    take: Array
    pull: Array
    lean: Array
    rho: Array
    inverse: Array
    hold: Array
    slack: Array


def gains(factor: ChainFactor) -> Gains:
    """Vectorised over frames."""
    chain, (a, m, _) = factor.chain, factor.info
    earlier, spread, inverse = _before(factor), factor.spread, 1 / factor.pivot
    take = over(chain.weight, a)
    pull = take * earlier.position * (earlier.lever - chain.back)
    lean, rho = over(m, spread), over(chain.curvature, spread)
    return Gains(take, pull, lean, rho, inverse, a * m * inverse, chain.curvature * inverse)


def expected(factor: ChainFactor, c: Array | None) -> tuple[Array, Array, Array] | None:
    """What a change of velocity c takes from y and adds to k, and takes from k on the way back."""
    if c is None:
        return None
    lever, velocity = factor.info.lever, factor.info.velocity
    rho = over(factor.chain.curvature, factor.spread)
    return lever * rho * c, velocity * rho * c, factor.chain.curvature * c


def _substituted(factor: ChainFactor, z, f, c, level) -> Array:
    """Forwards and back, linear in z, f and c; None for what is zero."""
    by = gains(factor)
    level = jnp.zeros((), z.dtype) if level is None else level

    def forward(state, inputs):
        y, k = state
        z, f, c, by = inputs
        apart = z - level - y
        y, k = y + by.take * apart, k + by.pull * apart
        k = k if f is None else k + f
        y_next, k_next, k_back = y + by.lean * k, by.rho * k, k
        if c is not None:
            toward, change, ahead = c
            y_next, k_next, k_back = y_next - toward, k_next + change, k - ahead
        return (y_next, k_next), by.inverse * k_back - by.hold * y

    def backward(state, inputs):
        x, v = state
        slack, hold, offset = inputs
        x = x - v
        return (x, slack * v + hold * x + offset), x + level

    zero = jnp.zeros_like(z[0])
    (end, _), offsets = lax.scan(forward, (zero, zero), (z, f, expected(factor, c), by))
    return lax.scan(backward, (end, zero), (by.slack, by.hold, offsets), reverse=True)[1]


def _before(factor: ChainFactor) -> Information:
    """What frames 0 .. j - 1 know of (x_j, v_j)."""
    after = shifted(eliminate(factor.info, factor.chain.curvature))
    return jax.tree.map(lambda e: jnp.concatenate([jnp.zeros_like(e[:1]), e[:-1]]), after)


def chain_knowledge(factor: ChainFactor) -> Knowledge:
    """What is known of (x_j, v_j) from either side, ``(T, *k)``. Differentiable, as scans."""
    return knowledge(factor, _known_after(factor))


def _known_after(factor: ChainFactor) -> Information:
    """What frames j + 1 .. know of (x_j, v_{j+1}), as ``a (x + m v)^2 + d v^2``, j = 0 .. T-2."""
    known = _known(_nothing(factor.chain), mirrored(factor.chain), reverse=True)
    return jax.tree.map(lambda entry: entry[1:], known)


def mirrored(chain: DifferenceChain) -> DifferenceChain:
    """The coefficients as the pass from the last frame to the first meets them, frames in order."""
    curvature = jnp.concatenate([jnp.zeros_like(chain.curvature[:1]), chain.curvature[:-1]])
    return DifferenceChain(curvature, chain.weight, 1 - chain.back, chain.speed)


def knowledge(factor: ChainFactor, after: Information) -> Knowledge:
    """Both sides of every (x_j, v_j), from what frames j + 1 .. know of (x_j, v_{j+1})."""
    later = eliminate(after, factor.chain.curvature[:-1])
    last = jax.tree.map(lambda e: jnp.zeros_like(e[-1:]), factor.info)
    return Knowledge(factor.info, jax.tree.map(lambda *e: jnp.concatenate(e), later, last))


@jax.jit
def chain_covariance(factor: ChainFactor) -> State:
    """Selected inverse of P: covariance of every (x_j, v_j), each entry ``(T, *k)``.

    Gives the lag-one covariance too: ``cov(x_{j-1}, x_j) = position_j - cross_j``. Frame 0 has no
    velocity: zeros. Differentiable, as scans.
    """
    position, cross, velocity = chain_knowledge(factor).covariance()
    return State(position, cross.at[0].set(0), velocity.at[0].set(0))


def chain_squared_inverse(factor: ChainFactor) -> Array:
    """Diagonal of P^-2, ``sum_i cov(x_i, x_j)^2``, ``(T, *k)``, O(T): how fast the variance of
    each position falls as weight is added on all."""
    chain, after = factor.chain, _known_after(factor)
    (a, m, d), (alpha, mu, beta) = sides = knowledge(factor, after)
    _, cross, v = sides.covariance()
    share, other, both = a / (a + alpha), alpha / (a + alpha), (d + beta) / (a + alpha)
    near = v * (other * mu * (m + mu) + both)  # cov(x - m v, x)
    far = v * (share * m * (m + mu) + both)  # cov(x + mu v, x)

    none = jax.tree.map(lambda e: jnp.zeros_like(e[:1]), factor.info)
    backwards = ChainFactor(
        jax.tree.map(lambda e: e[::-1], mirrored(chain)),
        jax.tree.map(lambda none, e: jnp.concatenate([e[::-1], none]), none, after),
    )
    earlier, _ = _weighed(factor, jnp.zeros_like(chain.back))
    _, later = _weighed(backwards, jnp.ones_like(chain.back))
    later = jax.tree.map(lambda none, e: jnp.concatenate([e[:-1][::-1], none]), State(*none), later)
    return _form(earlier, near, cross) + _form(later, far, -cross)


def _form(state: State, x: Array, v: Array) -> Array:
    return state.position * x * x + 2 * state.cross * x * v + state.velocity * v * v


def _weighed(factor: ChainFactor, back: Array) -> tuple[State, State]:
    """What unit weights on all that lies ``back`` frames before a frame add to the information of
    (x - m v, v): with the frame's own, and once its velocity is eliminated, about the next."""
    by, (_, m, _), earlier = gains(factor), factor.info, _before(factor)
    turned = m - earlier.lever
    kept = factor.spread * by.inverse

    def step(state, inputs):
        turned, arm, kept, hold, rho = inputs
        a, c, d = state
        d = d + 2 * c * turned + a * turned * turned + arm * arm
        c = c + a * turned + arm
        a = a + 1
        seen = State(a, c, d)
        after = State(_form(seen, kept, hold), rho * (c * kept + d * hold), rho * rho * d)
        return after, (seen, after)

    none = jax.tree.map(lambda e: jnp.zeros_like(e[0]), factor.info)
    inputs = (turned, m - back, kept, by.hold, by.rho)
    return lax.scan(step, State(*none), inputs)[1]


@jax.custom_jvp
def chain_log_det(chain: DifferenceChain) -> Array:
    """``log det P``, shape ``k``; its derivative is read off the selected inverse."""
    return _log_det(chain_factor(chain))


def _log_det(factor: ChainFactor) -> Array:
    return jnp.log(factor.precision) + jnp.sum(jnp.log(factor.pivot), axis=0)


@chain_log_det.defjvp
def _chain_log_det_jvp(primals, tangents):
    (chain,), (change,) = primals, tangents
    factor = chain_factor(chain)
    after = _known_after(factor)
    x, cross, v = knowledge(factor, after).covariance(chain.back)
    rate = change.weight * x - 2 * chain.weight * change.back * cross + change.speed * v
    bends = change.curvature[1:-1] * _bend_variance(factor, after)
    return _log_det(factor), jnp.sum(rate, axis=0) + jnp.sum(bends, axis=0)


def _bend_variance(factor: ChainFactor, after: Information) -> Array:
    """Variance of ``v_{j+1} - v_j``, j = 1 .. T-2, from both sides of the bend."""
    a, m, d = jax.tree.map(lambda e: e[1:-1], factor.info)
    alpha, mu, beta = jax.tree.map(lambda e: e[1:], after)
    both = a * over(alpha, a + alpha)
    moved = both * (m + mu) ** 2 + d + beta
    share, other = over(d, moved), over(beta, moved)
    known = both * (mu * mu * share + m * m * other) + beta * share
    return 1 / (factor.chain.curvature[1:-1] + known)


@partial(jax.jit, static_argnames="channels")
def chain_sample(factor: ChainFactor, key: PRNGKeyArray, channels: tuple[int, ...]) -> Array:
    """One draw of N(0, 1/P), ``(T, *channels)``, independent over channels. Differentiable.

    Steps from frame to frame are written out from where the frames before hold on, not from the
    position, which may be far away while it is drawn between two distant readings.
    """
    a, m, _ = factor.info
    pivot, rho = factor.pivot, over(factor.chain.curvature, factor.spread)
    earlier = _before(factor)
    ahead = over(
        earlier.position * (earlier.lever - 1) - factor.chain.weight * (1 - factor.chain.back), a
    )  # m - 1, no digits lost
    frames, dtype = m.shape[0], m.dtype
    noise = jax.random.normal(key, (frames + 1, *channels), dtype)

    def backward(state, inputs):
        x, v = state
        m, ahead, rho, loose, hold, width, noise = inputs
        v = rho * v
        apart = x - m * v
        noise = width * noise
        v = v + hold * apart + noise
        return (loose * apart - m * noise + ahead * v, v), x

    gains = (m, ahead, rho, factor.spread / pivot, a * m / pivot, 1 / jnp.sqrt(pivot))
    end = noise[-1] / jnp.sqrt(factor.precision)
    start = (end, jnp.zeros_like(end))
    return lax.scan(backward, start, (*gains, noise[:-1]), reverse=True)[1]
