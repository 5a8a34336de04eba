"""Soft words: distances, neighbours and masks that training can follow.

    distance     of a word of N frames to a target of M, over the paths of "slope3" from both first
                 frames to the word's last and a frame of the target after its middle:
                 S_j = −γ log Σ_paths to j exp(−Σ D/γ), C_j the cells such a path is expected to
                 have, and softmin_γ′ over ends j of S_j/C_j, γ′ = γ/N
    neighbours   w_v = σ((τ − d_v)/β)/K, τ such that they add up to 1
    mask         σ((M/s − 1)/width)

As γ, β and the width go to 0 these become the distance of :func:`nearest_words`, 1/K on each of the
K nearest, and M > s. Everything has finite derivatives in both modes, also at equal poses. A word
costs O(N·M) and each target is on a lane of its own.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.scipy.special import logsumexp
from jaxtyping import Array, Float

from jaxmotion._checks import no_module, one_number, require, static
from jaxmotion._types import AnyArray, ArrayLike, ScalarLike
from jaxmotion.timing import pose_distance

_FAR = 1e3  # in units of γ, above all costs of a pair: the cost of what no path reaches
_BISECTIONS = 60


@static("trim", "least")
def soft_word_distances(
    words: ArrayLike,
    targets: ArrayLike,
    *,
    gamma: ScalarLike = 0.01,
    trim: int = 0,
    least: int | None = None,
) -> Float[Array, "word target"]:
    """How far words are from targets, for losses.

    Differentiable in rotations and γ in both modes. O(W·V·N·M·J).

    **Arguments:** ``words``: f[W, N, J, 4], ``targets``: f[V, M, J, 4], unit quaternions;
    ``gamma``: γ > 0, squared half-angle radians; ``trim``: how many of the largest joint terms are
    left out of a pair of frames; ``least``: how many frames of a target must be matched, by default
    more than half.
    **Returns:** f[W, V], squared half-angle radians; it may be negative for a large γ.
    **Raises:** ``ValueError`` for shapes that do not fit, a γ that is not above 0, at run time if
    traced; a ``least`` of more than M.

    **Example:**

        >>> import jax, jaxmotion as jm
        >>> walk = jm.samples.load("walk", fps=24.0, num_frames=96).motion
        >>> words = jm.cleaning.motion_words(walk, joints="whole").rotations
        >>> near = jm.cleaning.soft_word_distances(words[:2], words[4:], gamma=1e-3)
        >>> near.shape
        (2, 14)
    """
    caller = "soft_word_distances"
    for name, x in (("words", words), ("targets", targets)):
        no_module(f"{caller}: {name}", x)
    words, targets = jnp.asarray(words), jnp.asarray(targets)
    for name, x in (("words", words), ("targets", targets)):
        if x.ndim != 4 or x.shape[-1] != 4 or x.shape[2] != words.shape[2]:
            raise ValueError(
                f"{caller}: {name} have shape {x.shape}; expected (words, frames, joints, 4)"
            )
    columns = targets.shape[1]
    least = columns // 2 + 1 if least is None else least
    if not 1 <= least <= columns:
        raise ValueError(f"{caller}: least={least}; expected 1 to {columns}")
    wanted = one_number(f"{caller}: gamma", gamma)
    words = require(words, ~(wanted > 0), f"{caller}: gamma must be above 0", got=gamma)
    return _distances(words, targets, jnp.asarray(gamma, words.dtype), trim, least)


@static("k")
def soft_neighbours(
    distances: ArrayLike, *, k: int = 8, beta: ScalarLike = 0.01
) -> Float[Array, "*batch target"]:
    """How much each target is one of the K nearest: weights that add up to 1.

    Differentiable in both modes. O(V) a word.

    **Arguments:** ``distances``: f[..., V]; ``k``: K, less than V; ``beta``: β > 0, in the
    distances' unit.
    **Returns:** f[..., V], each at most 1/K.
    **Raises:** ``ValueError`` for a K that is not below V, a β that is not above 0, at run time if
    traced.

    **Example:**

        >>> import jax.numpy as jnp, jaxmotion as jm
        >>> near = jnp.array([0.1, 0.5, 0.2, 0.9])
        >>> jm.cleaning.soft_neighbours(near, k=2, beta=1e-3).round(3).tolist()
        [0.5, 0.0, 0.5, 0.0]
    """
    caller = "soft_neighbours"
    no_module(f"{caller}: distances", distances)
    d = jnp.asarray(distances)
    if not (isinstance(k, (int, np.integer)) and d.ndim >= 1 and 1 <= k < d.shape[-1]):
        raise ValueError(f"{caller}: k={k}; expected 1 or more, below the {d.shape[-1:]} targets")
    wanted = one_number(f"{caller}: beta", beta)
    d = require(d, ~(wanted > 0), f"{caller}: beta must be above 0", got=beta)
    return _weights(d, jnp.asarray(beta, d.dtype), int(k))


def soft_mask(
    digression: ArrayLike, scale: ArrayLike = 0.5, *, width: ScalarLike = 0.1
) -> Float[Array, "*batch joint"]:
    """How likely each entry is in error: ½ where it digresses by the scale.

    **Arguments:** ``digression``: f[..., J], radians; ``scale``: s > 0, one number or f[J];
    ``width``: > 0, of the change from 0 to 1, as a share of the scale.
    **Returns:** f[..., J], from 0 to 1.
    **Raises:** ``ValueError`` for a scale or width that is not above 0, at run time if traced.

    **Example:**

        >>> import jaxmotion as jm
        >>> jm.cleaning.soft_mask([0.1, 0.5, 2.0]).round(3).tolist()
        [0.0, 0.5, 1.0]
    """
    no_module("soft_mask: digression", digression)
    m = jnp.asarray(digression)
    m = m if jnp.issubdtype(m.dtype, jnp.floating) else m.astype(float)
    wanted = one_number("soft_mask: width", width)
    m = require(m, ~(wanted > 0), "soft_mask: width must be above 0", got=width)
    s = jnp.asarray(scale, m.dtype)
    m = require(m, ~jnp.all(s > 0), "soft_mask: scale must be above 0", got=scale)
    return jax.nn.sigmoid((m / s - 1) / jnp.asarray(width, m.dtype))


@partial(jax.jit, static_argnums=(3, 4))
def _distances(words, targets, gamma, trim: int, least: int) -> Float[Array, "word target"]:
    def of_word(word: Array) -> Float[Array, " target"]:
        every = targets.reshape(-1, *targets.shape[2:])
        d = pose_distance(word, every, trim=trim)
        d = d.reshape(word.shape[0], targets.shape[0], targets.shape[1])
        return jax.vmap(lambda cost: _word_distance(cost, gamma, least), 1)(d)

    return lax.map(of_word, words)


def _word_distance(d: Float[Array, "row column"], gamma, least: int) -> Float[Array, ""]:
    """The soft distance of one pair."""
    rows, columns = d.shape
    most = lax.stop_gradient((rows + columns) * jnp.max(d) + _FAR * gamma)
    far = jnp.full(columns, most)
    none = jnp.zeros(columns, d.dtype)
    # The seven states of a cell: a diagonal step, one to three down, one to three along. A path
    # comes to the first cell by a diagonal from a cell of cost 0 before it.
    first = (far.at[0].set(d[0, 0]), none.at[0].set(1))
    start = _along(d[0], [first, *[(far, none)] * 3], gamma, most)

    def row(states, cost):
        diagonal = _step(cost, _shift(_soft_least(states, gamma), most))
        down = [_step(cost, _soft_least([states[0], *states[4:]], gamma))]
        down += [_step(cost, states[s]) for s in (1, 2)]
        return _along(cost, [diagonal, *down], gamma, most), None

    states, _ = lax.scan(row, start, d[1:])
    total, cells = _soft_least(states, gamma)
    ends = jnp.arange(columns) >= least - 1
    mean = jnp.where(ends, total / jnp.where(ends, jnp.maximum(cells, 1), 1), 0)
    weight = gamma / rows
    return -weight * logsumexp(jnp.where(ends, -mean / weight, -jnp.inf))


def _along(cost, entered, gamma, far):
    """All seven states of a row, from those that are entered from the row before."""
    one = _step(cost, _shift(_soft_least(entered, gamma), far))
    two = _step(cost, _shift(one, far))
    return [*entered, one, two, _step(cost, _shift(two, far))]


def _step(cost, state):
    total, cells = state
    return total + cost, cells + 1


def _shift(state, far):
    """The state of the column before."""
    total, cells = state
    return (
        jnp.concatenate([far[None], total[:-1]]),
        jnp.concatenate([jnp.zeros((1,), cells.dtype), cells[:-1]]),
    )


def _soft_least(states, gamma):
    """−γ log Σ exp(−S/γ) over the states, and the cells that are expected."""
    total = jnp.stack([s[0] for s in states])
    cells = jnp.stack([s[1] for s in states])
    share = jax.nn.softmax(-total / gamma, axis=0)
    return -gamma * logsumexp(-total / gamma, axis=0), jnp.sum(share * cells, axis=0)


@partial(jax.jit, static_argnums=2)
def _weights(d: AnyArray, beta, k: int):
    """σ((τ − d)/β)/K with τ by bisection, and by one step of Newton's that derivatives follow."""
    fixed, width = lax.stop_gradient((d, beta))
    low = jnp.min(fixed, axis=-1, keepdims=True) - 50 * width
    high = jnp.max(fixed, axis=-1, keepdims=True) + 50 * width

    def halve(_, bounds):
        low, high = bounds
        middle = (low + high) / 2
        over = jnp.sum(jax.nn.sigmoid((middle - fixed) / width), -1, keepdims=True) > k
        return jnp.where(over, low, middle), jnp.where(over, middle, high)

    low, high = lax.fori_loop(0, _BISECTIONS, halve, (low, high))
    tau = (low + high) / 2
    on = jax.nn.sigmoid((tau - d) / beta)
    slope = lax.stop_gradient(jnp.sum(on * (1 - on), axis=-1, keepdims=True)) / width
    floor = jnp.finfo(d.dtype).tiny
    tau = tau - (jnp.sum(on, axis=-1, keepdims=True) - k) / jnp.maximum(slope, floor)
    return jax.nn.sigmoid((tau - d) / beta) / k
