"""What a chain of (position, velocity) knows: covariances, determinant, draws; O(T).

P and all symbols are those of ``linalg.difference_chain``. Its pass from frame 0 leaves what frames
up to j know of (x_j, v_j), ``a (x - m v)^2 + d v^2``. The same pass from the other end, with
``1 - g`` for g, leaves what later frames know, ``alpha (x + mu v)^2 + beta v^2``, and both together
every marginal of N(0, 1/P):

    var v     = 1 / (d + beta + a alpha (m + mu)^2 / (a + alpha))
    var x     = var v (a m^2 + alpha mu^2 + d + beta) / (a + alpha)
    cov(x, v) = var v (a m - alpha mu) / (a + alpha)

The pivots ``D + a m^2`` of the elimination are the precisions of v_j given x_j and v_{j+1}: draws
go from frame to frame with that noise, and ``det P`` is their product and that of the last a.

Sharp bits: variances are sums, products and quotients of positive numbers, so that a small one
beside huge ones (keys beside the middle of a long gap) keeps its digits. Covariances are
differences, and keep those of their size.
"""

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from jaxmotion._summary import line, per_frame
from jaxmotion._types import Key
from jaxmotion.linalg.difference_chain import (
    ChainFactor,
    DifferenceChain,
    Information,
    at_rest,
    before,
    chain_factor,
    eliminate,
    gains,
    known,
    nothing_known,
    over,
    shifted,
    with_reading,
)


class State(NamedTuple):
    """Covariance of a state (position, velocity), symmetric, 2 by 2."""

    position: Array
    cross: Array
    velocity: Array

    def __repr__(self) -> str:
        return line(self)


class Knowledge(NamedTuple):
    """What two sides know of one state (x, v).

    **Fields:** ``earlier``: :class:`Information` of the frames up to it, ``a (x - m v)^2 + d v^2``;
    ``later``: of those after it, as ``a (x + m v)^2 + d v^2``.
    """

    earlier: Information
    later: Information

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield per_frame(self.earlier.position)

    def covariance(self, back: Array | float = 0.0) -> State:
        """Covariance of ``(x - back v, v)``.

        **Arguments:** ``back``: frames before the frame, a scalar or f[T, *k].
        **Returns:** :class:`State`, each entry f[T, *k].
        """
        (a, m, d), (alpha, mu, beta) = self.earlier, self.later
        m, mu = m - back, mu + back
        share, other = a / (a + alpha), alpha / (a + alpha)
        velocity = 1 / (d + beta + a * other * (m + mu) ** 2)
        position = (share * m * m + other * mu * mu + (d + beta) / (a + alpha)) * velocity
        return State(position, (share * m - other * mu) * velocity, velocity)


@jax.jit
def chain_knowledge(factor: ChainFactor) -> Knowledge:
    """What is known of (x_j, v_j) from either side.

    O(T). Differentiable, as scans.

    **Arguments:** ``factor``: of the chain.
    **Returns:** :class:`Knowledge`, each entry f[T, *k].
    """
    return knowledge(factor, _known_after(factor))


def _known_after(factor: ChainFactor) -> Information:
    """What frames j + 1 .. know of (x_j, v_{j+1}), as ``a (x + m v)^2 + d v^2``, j = 0 .. T-2."""
    seen = known(nothing_known(factor.chain), mirrored(factor.chain), reverse=True)
    return jax.tree.map(lambda entry: entry[1:], seen)


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
    """Selected inverse of P: covariance of every (x_j, v_j).

    Gives the lag-one covariance too: ``cov(x_{j-1}, x_j) = position_j - cross_j``. Frame 0 has no
    velocity: zeros. O(T). Differentiable, as scans.

    **Arguments:** ``factor``: of the chain.
    **Returns:** :class:`State`, each entry f[T, *k].
    """
    position, cross, velocity = chain_knowledge(factor).covariance()
    return State(position, cross.at[0].set(0), velocity.at[0].set(0))


@jax.jit
def chain_squared_inverse(factor: ChainFactor) -> Array:
    """Diagonal of P^-2, ``sum_i cov(x_i, x_j)^2``.

    It is how fast the variance of each position falls as weight is added on all. O(T).

    **Arguments:** ``factor``: of the chain.
    **Returns:** f[T, *k].
    """
    chain, after = factor.chain, _known_after(factor)
    (a, m, d), (alpha, mu, beta) = sides = knowledge(factor, after)
    _, cross, v = sides.covariance()
    share, other, both = a / (a + alpha), alpha / (a + alpha), (d + beta) / (a + alpha)
    near = v * (other * mu * (m + mu) + both)  # cov(x - m v, x)
    far = v * (share * m * (m + mu) + both)  # cov(x + mu v, x)

    earlier, _ = _weighed(at_rest(chain), chain, 0)
    _, later = _weighed(nothing_known(chain), mirrored(chain), 1, reverse=True)
    later = jax.tree.map(lambda e: jnp.concatenate([e[1:], jnp.zeros_like(e[:1])]), later)
    return _form(earlier, near, cross) + _form(later, far, -cross)


def _form(state: State, x: Array, v: Array) -> Array:
    return state.position * x * x + 2 * state.cross * x * v + state.velocity * v * v


def _weighed(
    start: Information, chain: DifferenceChain, back: int, reverse: bool = False
) -> tuple[State, State]:
    """What unit weights on all that lies ``back`` frames before a frame add to the information of
    (x - m v, v): with the frame's own, and once its velocity is eliminated, of the next."""

    def step(state, frame):
        info, (a, c, d) = state
        earlier = shifted(info)
        seen = with_reading(earlier, frame.weight, frame.back, frame.speed)
        by = gains(earlier, seen, frame)
        turned, arm = seen.lever - earlier.lever, seen.lever - back
        d = d + 2 * c * turned + a * turned * turned + arm * arm
        c = c + a * turned + arm
        added = State(a + 1, c, d)
        kept = (seen.velocity + frame.curvature) * by.inverse
        after = State(
            _form(added, kept, by.hold),
            by.rho * (c * kept + d * by.hold),
            by.rho * by.rho * d,
        )
        return (eliminate(seen, frame.curvature), after), (added, after)

    return lax.scan(step, (start, State(*nothing_known(chain))), chain, reverse=reverse)[1]


def chain_bend_variance(factor: ChainFactor) -> Array:
    """Variance of every second difference, ``v_{j+1} - v_j``.

    O(T). Differentiable, as scans.

    **Arguments:** ``factor``: of the chain.
    **Returns:** f[T - 2, *k], of the frames but the first and the last.
    """
    return _bend_variance(factor, _known_after(factor))


def chain_log_det(chain: DifferenceChain) -> Array:
    """``log det P``.

    O(T). Its derivative is read off the selected inverse.

    **Arguments:** ``chain``: the coefficients.
    **Returns:** f[*k].
    """
    return _log_det(chain)


@jax.custom_jvp
def _log_det(chain: DifferenceChain) -> Array:
    return _log_det_of(chain_factor(chain))


def _log_det_of(factor: ChainFactor) -> Array:
    return jnp.log(factor.precision) + jnp.sum(jnp.log(factor.pivot), axis=0)


@_log_det.defjvp
def _log_det_jvp(primals, tangents):
    (chain,), (change,) = primals, tangents
    factor = chain_factor(chain)
    after = _known_after(factor)
    x, cross, v = knowledge(factor, after).covariance(chain.back)
    rate = change.weight * x - 2 * chain.weight * change.back * cross + change.speed * v
    bends = change.curvature[1:-1] * _bend_variance(factor, after)
    return _log_det_of(factor), jnp.sum(rate, axis=0) + jnp.sum(bends, axis=0)


def _bend_variance(factor: ChainFactor, after: Information) -> Array:
    """Variance of ``v_{j+1} - v_j``, j = 1 .. T-2, from both sides of the bend."""
    a, m, d = jax.tree.map(lambda e: e[1:-1], factor.info)
    alpha, mu, beta = jax.tree.map(lambda e: e[1:], after)
    both = a * over(alpha, a + alpha)
    moved = both * (m + mu) ** 2 + d + beta
    share, other = over(d, moved), over(beta, moved)
    precision = both * (mu * mu * share + m * m * other) + beta * share
    return 1 / (factor.chain.curvature[1:-1] + precision)


@partial(jax.jit, static_argnames="channels")
def chain_sample(factor: ChainFactor, key: Key, channels: tuple[int, ...]) -> Array:
    """One draw of N(0, 1/P), independent over channels.

    Steps from frame to frame are written out from where the frames before hold on, not from the
    position, which may be far away while it is drawn between two distant readings. O(T) a channel.
    Differentiable.

    **Arguments:** ``factor``: of the chain; ``key``: a key of :mod:`jax.random`; ``channels``:
    shape of the channels, static.
    **Returns:** f[T, *channels].
    """
    a, m, _ = factor.info
    by, pivot, earlier = factor.gains, factor.pivot, before(factor.info, factor.chain.curvature)
    # m - 1, no digits lost.
    ahead = over(
        earlier.position * (earlier.lever - 1) - factor.chain.weight * (1 - factor.chain.back), a
    )
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

    numbers = (m, ahead, by.rho, factor.spread / pivot, by.hold, 1 / jnp.sqrt(pivot))
    end = noise[-1] / jnp.sqrt(factor.precision)
    start = (end, jnp.zeros_like(end))
    return lax.scan(backward, start, (*numbers, noise[:-1]), reverse=True)[1]
