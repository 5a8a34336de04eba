"""Where another key would help most: greedy, exact choice by the smoother's variance.

    add an observation of std sigma at frame i:   Var_j -> Var_j - Cov_ij^2 / (Var_i + sigma^2)

    gain_i = sum_j Cov_ij^2 / (Var_i + sigma^2)        total variance it removes

    Var, Cov  posterior of the frames given the keys there are     sigma  noise of a key

Each round takes the frame of the largest gain, adds its observation, and starts again: every
choice is exact for the posterior after the ones before it. The values of the keys play no part.

Cost O(Nf) a round, all candidates at once: with v(e) the variances once every frame is observed
with precision e more, sum_j Cov_ij^2 = -dv_i/de at 0, one derivative of the selected inverse.

Eom et al. (2019, section 6.2) name this use of the variance as future work. The greedy choice is
Krause, Singh and Guestrin's (*Near-optimal sensor placements in Gaussian processes*, 2008).

Sharp bits: with lam, sigma or weights per channel, gains are summed over the distinct channels of
the variance, in the unit of y. Ties go to the earliest frame.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jaxmotion._checks import known, require, static
from jaxmotion._portable import Portable
from jaxmotion._types import ArrayLike
from jaxmotion.linalg import (
    DifferenceChain,
    chain_covariance,
    chain_factor,
    chain_squared_inverse,
)
from jaxmotion.smoothing.lgs import Posterior


class KeySuggestions(Portable):
    """Frames for new keys, and what is left of the variance with them.

    **Fields:** ``frames``: i32[n], best first; ``variance``: f[n, Nf, *k], of every frame after
    each of them is observed, with channel axes where the posterior's variance has them.
    """

    frames: Int[Array, " keys"]
    variance: Float[Array, "keys frames ..."]


@static("n")
def suggest_keys(
    posterior: Posterior, n: int, *, candidates: ArrayLike | None = None
) -> KeySuggestions:
    """The ``n`` frames where one more observation lowers the total variance most, each once.

    O(n Nf). Source: Krause, Singh & Guestrin 2008; Eom et al. 2019, §6.2 names it as future work.

    **Arguments:** ``posterior``: of :func:`~jaxmotion.smoothing.lgs`; a new key has its ``sigma``
    and weight 1; ``n``: how many, static; ``candidates``: bool[Nf], the frames that may be chosen;
    None for all, observed ones too.
    **Returns:** :class:`KeySuggestions`.
    **Raises:** ``ValueError`` when ``n`` is not from 1 to the number of frames, or ``candidates``
    are not bool[Nf] with n true; at run time for traced ones with fewer.
    """
    frames = posterior.mean.shape[0]
    if not 1 <= n <= frames:
        raise ValueError(f"n={n}: want from 1 to {frames}, the number of frames")
    allowed = known(np.ones(frames, bool) if candidates is None else candidates)
    if allowed.shape != (frames,) or allowed.dtype != bool:
        raise ValueError(
            f"candidates are {allowed.dtype} {allowed.shape}: want bool ({frames},), one a frame"
        )
    message = f"candidates hold fewer than n={n} frames"
    return _suggest(require(posterior, allowed.sum() < n, message), n, jnp.asarray(allowed))


@eqx.filter_jit
def _suggest(posterior: Posterior, n: int, allowed: Array) -> KeySuggestions:
    chain, sigma = posterior._chain, posterior._sigma  # the chain is sigma^2 times the precision
    shape = jnp.broadcast_shapes(*(leaf.shape for leaf in jax.tree.leaves(chain)))
    chain = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, shape), chain)
    axes = tuple(range(1, len(shape)))

    def round_(state, _):
        chain, allowed = state
        factor = chain_factor(chain)
        v = chain_covariance(factor).position
        gains = jnp.sum(sigma**2 * chain_squared_inverse(factor) / (v + 1), axis=axes)
        best = jnp.argmax(jnp.where(allowed, gains, -jnp.inf))
        return (_with_key(chain, best), allowed.at[best].set(False)), (best, v)

    (chain, _), (chosen, before) = lax.scan(round_, (chain, allowed), length=n)
    after = chain_covariance(chain_factor(chain)).position
    after = jnp.concatenate([before[1:], after[None]])
    return KeySuggestions(chosen, jax.vmap(posterior._per_frame)(after))


def _with_key(chain: DifferenceChain, frame: Array) -> DifferenceChain:
    """One more reading of weight 1, on the frame; with what was read before, it is one reading."""
    weight, back = chain.weight[frame], chain.back[frame]
    apart = weight * back / (weight + 1)
    return DifferenceChain(
        chain.curvature,
        chain.weight.at[frame].add(1),
        chain.back.at[frame].set(apart),
        chain.speed.at[frame].add(apart * back),
    )
