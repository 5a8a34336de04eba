"""Sudden moves told from noise: second differences with heavy tails, learned with λ and σ.

A limb at rest that flicks for two frames and rests again is no Gaussian process: smoothed as one,
it is either noise all over, and the flick is smeared, or rough all over, and the noise stays. With
a scale u_t of its own for every frame, shared by a joint's C channels,

    x''_t | u_t ~ N(0, τ²/u_t),    u_t ~ Gamma(ν/2, ν/2)       x''_t is Student's t of ν degrees

and given u the smoother is the linear one whose stiffness is √u. What the frames tell of u is again
a Gamma (variational Bayes, by blocks x and u):

    E u_t = (ν + C)/(ν + z_t),    z_t = E ‖x''_t‖²/τ²      mean and variance of the smoother's bend

ν solves log(ν/2) + 1 - ψ(ν/2) + mean(E log u - E u) = 0. Large ν is the Gaussian.

s = log ρ, and with it λ and σ, is looked for along the grid first, u as the data themselves have
it: begun with u = 1, a flick would be called noise and stay so. Then every look at the slope of the
evidence takes a step of s, halved where the slope turns round, and u and ν are learned from that
look's smoother. One loop, O(N) a look.

One capture made the noise of all joints. Where the grid's σ² of the groups lie close together, each
is told what the others found, as n₀ more data of their median variance σ₀²:

    J + n₀σ₀²  for J  and  n + n₀  for n,    n₀ = 2/v ≤ n      v the variance of log σ²

(an inverse gamma prior; v from the quartiles, so that a few groups unlike the others do not count).
A joint that moves sharply, whose own data tell little of its noise, has the noise of the others,
and one whose data tell of another keeps it; where every joint has its own, v is large and n₀ small.

Tipping & Lawrence 2005 (variational Student's t); Lange, Little & Taylor 1989 (its degrees).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import digamma
from jaxtyping import Array, Bool, Float

from jaxmotion.frames.runs import last_before, next_after
from jaxmotion.smoothing.lgs import Posterior

_LEAST, _MOST = 1.0, 100.0  # degrees of freedom
DOF = 2.0  # to begin with
_HALVINGS = 12
_STEPS = 14
_FEW = 4  # groups that can tell each other anything
_QUARTILES = 1.349  # how far apart they are for a Gaussian of deviation 1
_FIRST, _LONGER, _SHORTER = 0.7, 1.2, 0.5  # steps of s


class Look(NamedTuple):
    """One look at every group: s, F and σ² there, f[G] each."""

    s: Float[Array, " group"]
    score: Float[Array, " group"]
    variance: Float[Array, " group"]


class Told(NamedTuple):
    """What the groups tell each other: f[G] each, n₀ and σ₀² of the module."""

    count: Float[Array, " group"]
    variance: Float[Array, " group"]


class Tails(NamedTuple):
    """What is learned of second differences.

    **Fields:** ``dof``: ν, f[G]; ``stiffness``: √(E u), f[Nf, G], 1 where no data tell.
    """

    dof: Float[Array, " group"] | None
    stiffness: Float[Array, "frames group"] | None


class _Search(NamedTuple):
    """f[G] each: the s to look at; the least F of the grid, its s and its σ²; the step of s, its
    sense."""

    s: Array
    least: Array
    best: Array
    variance: Array
    step: Array
    sense: Array


def settle(
    evaluate: Callable[[Array, Array, Told], tuple[Array, tuple[Array, Posterior]]],
    learnable: Float[Array, " group"],
    free: Float[Array, " group"],
    grid: Float[Array, " look"],
    frames: int,
    unit: float,
    share: bool,
) -> tuple[Look, Tails]:
    """s and the tails of every group, learned together.

    **Arguments:** ``evaluate``: (s, stiffness, what groups are told) to F, and to σ² and the
    smoother of data f[Nd, G, C] for a σ of 1; ``learnable``: 1 for groups that say something, 0 for
    those that get s = 0; ``free``: n of every group; ``grid``: of s, where to look first;
    ``frames``: Nf, three or more; ``unit``: the square that the prior's rows (1, -2, 1) are scaled
    by; ``share``: whether groups tell each other of their noise.
    """
    every = jnp.ones_like(learnable)
    nothing = Told(0 * every, every)
    _, (_, rough) = evaluate(grid[0] * every, jnp.ones((frames, len(every)), every.dtype), nothing)
    known = known_bends(rough) & (learnable > 0)
    channels = rough.mean.shape[-1]
    first = _tails(usual_bends(rough, known), DOF * every, known, channels)

    def look(state, k):
        search, tails = state
        on_grid = k < len(grid)
        told = nothing
        if share:
            told = _told_by_all(search.variance, jnp.where(on_grid, 0, learnable), free)
        score, slope, (variance, post) = jax.jvp(
            lambda s: evaluate(s, tails.stiffness, told), (search.s,), (every,), has_aux=True
        )
        better = on_grid & (score < search.least)
        best = jnp.where(better, search.s, search.best)
        sense = jnp.where(slope < 0, every, -every)
        longer = jnp.where(sense * search.sense < 0, _SHORTER, _LONGER)
        step = search.step * jnp.where(on_grid, 1, longer)
        ahead = jnp.clip(search.s + sense * step, grid[0], grid[-1])
        along = jnp.where(k < len(grid) - 1, grid[jnp.minimum(k + 1, len(grid) - 1)], best)
        nearby = _Search(
            learnable * jnp.where(on_grid, along, ahead),
            jnp.where(better, score, search.least),
            best,
            jnp.where(better, variance, search.variance),
            step,
            jnp.where(on_grid, 0, sense),
        )

        def learned():
            z = unit * jnp.exp(2 * search.s) * expected_bends(post, variance)
            return _tails(z, tails.dof, known, channels)

        after = jax.lax.cond(on_grid, lambda: tails, learned)
        return (nearby, after), (Look(search.s, score, variance), tails)

    nought = 0 * every
    start = _Search(learnable * grid[0], jnp.inf * every, nought, every, _FIRST * every, nought)
    looks = jnp.arange(len(grid) + _STEPS)
    _, found = jax.lax.scan(look, (start, first), looks)
    return jax.tree.map(lambda x: x[-1], found)


def _told_by_all(variance: Array, learnable: Array, free: Array) -> Told:
    """What all groups that say something say together; nothing where they are fewer than four."""
    logs = jnp.where(learnable > 0, jnp.log(variance), jnp.nan)
    low, middle, high = jnp.nanquantile(logs, jnp.asarray([0.25, 0.5, 0.75], logs.dtype))
    spread = jnp.maximum((high - low) / _QUARTILES, float(jnp.finfo(logs.dtype).eps))
    enough = jnp.sum(learnable) >= _FEW
    count = jnp.where(enough, jnp.minimum(2 / spread**2, free), 0)
    return Told(count, jnp.where(enough, jnp.exp(middle), 1) * jnp.ones_like(free))


def no_bends(learnable: Float[Array, " group"], frames: int) -> Tails:
    """The tails of clips of one or two frames."""
    return Tails(
        _MOST * jnp.ones_like(learnable), jnp.ones((frames, len(learnable)), learnable.dtype)
    )


def known_bends(post: Posterior) -> Bool[Array, "bends group"]:
    """Which bends the data tell of: at a frame that is seen, between others that are."""
    seen = jnp.any(post.readings > 0, axis=-1)
    since, until = last_before(seen) >= 0, next_after(seen) < len(seen)
    return since[:-2] & seen[1:-1] & until[2:]


def usual_bends(rough: Posterior, known: Bool[Array, "bends group"]) -> Float[Array, "bends group"]:
    """z to begin with: ‖x″‖² over its median, which counts as C."""
    bends = _squared_bends(rough)
    usual = jnp.nanmedian(jnp.where(known, bends, jnp.nan), axis=0)
    # Rounding of the data bends as well: what is usual is no less.
    rounding = (8 * float(jnp.finfo(bends.dtype).eps)) ** 2
    usual = jnp.maximum(usual, rounding * jnp.max(jnp.sum(rough.mean**2, axis=-1), axis=0))
    return rough.mean.shape[-1] * bends / jnp.where(known & (usual > 0), usual, 1)


def expected_bends(post: Posterior, variance: Array | float = 1.0) -> Float[Array, "bends group"]:
    """E ‖x″‖² over ``variance``, which the smoother's own is a multiple of already."""
    loose = jnp.sum(jnp.broadcast_to(post.bend_variance, post.mean[2:].shape), axis=-1)
    return _squared_bends(post) / variance + loose


def _squared_bends(post: Posterior) -> Float[Array, "bends group"]:
    """‖x″‖² of the mean."""
    return jnp.sum(jnp.diff(post.mean, n=2, axis=0) ** 2, axis=-1)


def _tails(z: Array, dof: Array, known: Array, channels: int) -> Tails:
    """E u where second differences are z times what they should be in square, and the ν of those
    that data tell of."""
    shape, rate = (dof + channels) / 2, (dof + z) / 2
    logs = digamma(shape) - jnp.log(rate) - shape / rate
    count = jnp.maximum(jnp.sum(known, axis=0, dtype=z.dtype), 1)
    mean = jnp.sum(jnp.where(known, logs, 0), axis=0) / count

    def halve(_, ends):
        low, high = ends
        middle = (low + high) / 2
        half = jnp.exp(middle) / 2
        more = jnp.log(half) + 1 - digamma(half) + mean > 0
        return jnp.where(more, middle, low), jnp.where(more, high, middle)

    ends = (jnp.full_like(dof, np.log(_LEAST)), jnp.full_like(dof, np.log(_MOST)))
    low, high = jax.lax.fori_loop(0, _HALVINGS, halve, ends)
    softest = float(jnp.finfo(z.dtype).eps) ** 0.5
    scales = jnp.where(known, jnp.maximum(jnp.sqrt(shape / rate), softest), 1)
    return Tails(jnp.exp((low + high) / 2), jnp.pad(scales, ((1, 1), (0, 0)), constant_values=1))
