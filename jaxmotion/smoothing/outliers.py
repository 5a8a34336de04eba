"""Weights that take spikes and other gross errors out of a capture.

Iteratively reweighted least squares: the smoother is learned and run, and every sample weighed by
how far it lies from what its neighbours say,

    w = ρ'(u²),   u = ‖y − ŷ‖ / (s √(1 − h))        ρ: huber or cauchy, smoothing/losses.py

    ŷ  the smoother's mean         h  leverage of the sample: how much of ŷ is y itself
    s  robust scale of a group: the median of ‖y − ŷ‖/√(1 − h) over that of a normal vector's
       length, of the clip or of the 15 frames around, whichever is more, and at least a seventh
       of the steps that ŷ makes around it: where a clean capture moves fast, its neighbours miss
       a sample by more, and that is no error

λ and σ are learned anew each round by restricted evidence under the weights (``tune``), so that
spikes neither widen σ nor hold λ down. Samples of weight under 0.1 (about seven scales out under
"cauchy") are given weight 0: missing. Four rounds, O(T·J) each, one compiled loop. No gradient
passes through the weights. Of one sample more than the prior's order (three, for order 2) none can
be told to be the wrong one: all are trusted.

How far a sample lies out does not tell a spike from a foot that pushes off, at 30 frames a second.
A motion's are told by their shape (:mod:`jaxmotion.smoothing.spikes`): weight 0 or all of it.
"""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion._checks import no_module, one_of, static
from jaxmotion._entry import MISSING, finite_clip
from jaxmotion._program import keepable
from jaxmotion._types import ArrayLike
from jaxmotion.motion import Motion
from jaxmotion.smoothing.design import check_known
from jaxmotion.smoothing.lgs import lgs
from jaxmotion.smoothing.losses import BEND, Loss, slope
from jaxmotion.smoothing.spikes import spikes
from jaxmotion.smoothing.tuning import tune_signal

_ROUNDS = 4
_LEAST = 0.1
# Median length of a standard normal vector of 1, 2 and 3 components; unit quaternions move in 3.
_MEDIAN_LENGTH = (0.6745, 1.1774, 1.5382)
_AROUND = 7
_STEPS = 1 / 7


@static("order")
def outlier_weights(
    y: ArrayLike | Motion,
    *,
    loss: Loss = "cauchy",
    weights: ArrayLike | None = None,
    order: Literal[1, 2] = 2,
) -> Float[Array, "frame *joint"]:
    """How far each sample can be trusted, to be given to a smoother as ``weights``.

    Of a signal, by how far it lies from what its neighbours say, O(T·J) a round; of a motion, 0 for
    the spikes, of one to three frames, of a joint's rotation or translation, O(T·J) in all
    (:func:`bridged` lists them).
    No gradient passes through the weights.

    **Arguments:** ``y``: f[T, J, C] of J groups of C channels, f[T] one channel, or one clip;
    ``loss``: of samples of a signal that lie far out, "huber" (trusted less) or "cauchy" (not at
    all); ``weights``: f[T] or f[T, J], ≥ 0, what is known beforehand, 0 for missing; ``order``: of
    the signal's smoother.
    **Returns:** f[T, J] in [0, 1] times ``weights`` (f[T] for a single channel).
    **Raises:** ``ValueError`` for an unknown loss or shape; as :func:`~jaxmotion.smoothing.lgs` for
    bad data and weights.
    """
    one_of("outlier_weights: loss", loss, BEND)
    if isinstance(y, Motion):
        y = finite_clip("outlier_weights", y, "y", weights=weights, at_run_time=True, hint=MISSING)
        check_known("outlier_weights: y", y.rotations, weights, order=order)
        return _without_spikes(y, _given(weights, jnp.asarray(y.translations)))
    no_module("outlier_weights: y", y)
    y = jnp.asarray(y)
    if y.ndim not in (1, 3):
        raise ValueError(f"outlier_weights: y has shape {y.shape}; expected (T, J, C) or (T,)")
    check_known("outlier_weights: y", y, weights, order=order)
    grouped = y.reshape(y.shape[0], -1, y.shape[-1] if y.ndim == 3 else 1)
    found = _reweighted(grouped, _given(weights, grouped), loss, order)
    return found if y.ndim == 3 else found[:, 0]


def _given(weights: ArrayLike | None, y: Array) -> Array:
    weights = jnp.ones((), y.dtype) if weights is None else jnp.asarray(weights, y.dtype)
    weights = weights[:, None] if weights.ndim == 1 else weights
    return jnp.broadcast_to(weights, y.shape[:2])


@eqx.filter_jit
def _without_spikes(motion: Motion, given: Array) -> Array:
    """``given``, 0 at the spikes of a joint's rotation and of its translation."""
    there = given > 0
    bad = spikes(motion.rotations, there, motion.frame_time, turning=True)
    if moved := list(motion.translated_joints):
        moving = motion.translations[:, np.asarray(moved)]
        jumps = spikes(moving, there[:, np.asarray(moved)], motion.frame_time, turning=False)
        bad = bad.at[:, np.asarray(moved)].max(jumps)
    return jnp.where(bad, 0, jax.lax.stop_gradient(given))


@keepable
@eqx.filter_jit
def _reweighted(y: Array, given: Array, loss: Loss, order: Literal[1, 2]) -> Array:
    y, given = jax.lax.stop_gradient((y, given))
    told = jnp.sum(given > 0, axis=0) > order + 1

    def reweigh(_, weights):
        tuned = tune_signal(y, weights=weights, order=order)
        post = lgs(
            y,
            tuned.lam[:, None],
            tuned.sigma[:, None],
            order=order,
            weights=weights[..., None],
        )
        trust = _trust(y, post.fitted, post.leverage[..., 0], given, weights, loss)
        return given * jnp.where(told, trust, 1)

    return jax.lax.fori_loop(0, _ROUNDS, reweigh, given)


def _trust(
    y: Array,
    fitted: Array,
    leverage: Array,
    given: Array,
    weights: Array,
    loss: Loss,
) -> Array:
    """ρ'(u²) of every sample, 0 where it is small."""
    eps, tiny = float(jnp.finfo(y.dtype).eps), float(jnp.finfo(y.dtype).tiny)
    there = given[..., None] > 0
    rounding = 8 * eps * jnp.sqrt(jnp.max(jnp.where(there, y * y, 0), axis=(0, 2))) + tiny
    distance = jnp.linalg.norm(jnp.where(there, y - fitted, 0), axis=-1)
    distance = jnp.where(distance > rounding, distance, 0)  # what nothing contradicts has h = 1
    distance = distance / jnp.sqrt(jnp.clip(1 - leverage, min=eps))
    used = jnp.where(there[..., 0] & (weights > 0), distance, jnp.nan)
    step = jnp.linalg.norm(jnp.diff(fitted, axis=0, prepend=fitted[:1]), axis=-1)
    step = jnp.where(there[..., 0], step, jnp.nan)
    usual = jnp.maximum(jnp.nanmedian(used, axis=0), jnp.nan_to_num(_median_around(used)))
    usual = usual / _MEDIAN_LENGTH[min(y.shape[-1], 3) - 1]
    scale = jnp.maximum(usual, _STEPS * jnp.nan_to_num(_median_around(step)))
    u = distance / jnp.maximum(scale, rounding)
    trust = slope(u * u, loss)
    return jnp.where(trust < _LEAST, 0, trust)


def _median_around(x: Array) -> Array:
    """Median of the samples about each frame that are there (not NaN)."""
    padded = jnp.pad(x, ((_AROUND, _AROUND), (0, 0)), constant_values=jnp.nan)
    window = np.arange(x.shape[0])[:, None] + np.arange(2 * _AROUND + 1)
    return jnp.nanmedian(padded[window], axis=1)
