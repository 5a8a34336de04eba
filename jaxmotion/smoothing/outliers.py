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
"cauchy") are given weight 0: missing. Rotations begin without the samples that turn away from
their neighbours, so that a spike's sign decides no other sample's. Four rounds, O(T·J) each, one
compiled loop. No gradient passes through the weights. Of one sample more than the prior's order
(three, for order 2) none can be told to be the wrong one: all are trusted.
"""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion import quaternion
from jaxmotion._checks import no_module, one_of, static
from jaxmotion._entry import MISSING, finite_clip
from jaxmotion._types import ArrayLike
from jaxmotion.motion import Motion
from jaxmotion.smoothing.components import to_components
from jaxmotion.smoothing.design import check_known
from jaxmotion.smoothing.lgs import lgs
from jaxmotion.smoothing.losses import BEND, Loss, slope
from jaxmotion.smoothing.tuning import tune_signal

_ROUNDS = 4
_LEAST = 0.1
# Median length of a standard normal vector of 1, 2 and 3 components; unit quaternions move in 3.
_MEDIAN_LENGTH = (0.6745, 1.1774, 1.5382)
_AWAY = 3.0
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

    O(T·J) a round. No gradient passes through the weights.

    **Arguments:** ``y``: f[T, J, C] of J groups of C channels, f[T] one channel, or one clip;
    ``loss``: of samples that lie far out, "huber" (trusted less) or "cauchy" (not at all);
    ``weights``: f[T] or f[T, J], ≥ 0, what is known beforehand, 0 for missing; ``order``: of the
    smoother.
    **Returns:** f[T, J] in [0, 1] times ``weights`` (f[T] for a single channel); of a motion's
    joint, the lesser of its rotation's and its translation's.
    **Raises:** ``ValueError`` for an unknown loss or shape; as :func:`~jaxmotion.smoothing.lgs` for
    bad data and weights.
    """
    one_of("outlier_weights: loss", loss, BEND)
    if isinstance(y, Motion):
        y = finite_clip("outlier_weights", y, "y", weights=weights, at_run_time=True, hint=MISSING)
        check_known("outlier_weights: y", y.rotations, weights, order=order)
        rotations, translations = jnp.asarray(y.rotations), jnp.asarray(y.translations)
        given = _given(weights, translations)
        trusted = _reweighted(rotations, given, loss, order, True)
        moved = np.asarray(y.translated_joints, int)
        if not moved.size:
            return trusted
        moving = _reweighted(translations[:, moved], given[:, moved], loss, order, False)
        return trusted.at[:, moved].min(moving)
    no_module("outlier_weights: y", y)
    y = jnp.asarray(y)
    if y.ndim not in (1, 3):
        raise ValueError(f"outlier_weights: y has shape {y.shape}; expected (T, J, C) or (T,)")
    check_known("outlier_weights: y", y, weights, order=order)
    grouped = y.reshape(y.shape[0], -1, y.shape[-1] if y.ndim == 3 else 1)
    found = _reweighted(grouped, _given(weights, grouped), loss, order, False)
    return found if y.ndim == 3 else found[:, 0]


def _given(weights: ArrayLike | None, y: Array) -> Array:
    weights = jnp.ones((), y.dtype) if weights is None else jnp.asarray(weights, y.dtype)
    weights = weights[:, None] if weights.ndim == 1 else weights
    return jnp.broadcast_to(weights, y.shape[:2])


@eqx.filter_jit
def _reweighted(y: Array, given: Array, loss: Loss, order: Literal[1, 2], turning: bool) -> Array:
    y, given = jax.lax.stop_gradient((y, given))
    told = jnp.sum(given > 0, axis=0) > order + 1

    def reweigh(_, weights):
        signal = to_components(y, weights) if turning else y
        tuned = tune_signal(signal, weights=weights, order=order)
        post = lgs(
            signal,
            tuned.lam[:, None],
            tuned.sigma[:, None],
            order=order,
            weights=weights[..., None],
        )
        # Samples left out are judged as they are, on the side of the fit.
        opposite = turning & (jnp.sum(y * post.fitted, axis=-1, keepdims=True) < 0)
        residual = jnp.where(opposite, -y, y) - post.fitted
        trust = _trust(y, post.fitted, residual, post.leverage[..., 0], given, weights, loss)
        return given * jnp.where(told, trust, 1)

    first = given * jnp.where(_turns_away(y, given > 0), 0, 1).astype(y.dtype) if turning else given
    return jax.lax.fori_loop(0, _ROUNDS, reweigh, first)


def _trust(
    y: Array,
    fitted: Array,
    residual: Array,
    leverage: Array,
    given: Array,
    weights: Array,
    loss: Loss,
) -> Array:
    """ρ'(u²) of every sample, 0 where it is small."""
    eps, tiny = float(jnp.finfo(y.dtype).eps), float(jnp.finfo(y.dtype).tiny)
    there = given[..., None] > 0
    rounding = 8 * eps * jnp.sqrt(jnp.max(jnp.where(there, y * y, 0), axis=(0, 2))) + tiny
    distance = jnp.linalg.norm(jnp.where(there, residual, 0), axis=-1)
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


def _turns_away(q: Array, there: Array) -> Array:
    """Samples far from both neighbours, which are near each other (at the ends: far from the only
    neighbour, which is near its own); by angle, so signs are free."""
    nothing = jnp.full((1, q.shape[1]), jnp.nan, q.dtype)
    step = jnp.where(there[:-1] & there[1:], quaternion.distance(q[:-1], q[1:]), jnp.nan)
    since, until = jnp.concatenate([nothing, step]), jnp.concatenate([step, nothing])
    across = jnp.where(there[:-2] & there[2:], quaternion.distance(q[:-2], q[2:]), jnp.nan)
    across = jnp.concatenate([nothing, across, nothing])[: q.shape[0]]
    beside = jnp.fmin(jnp.roll(until, -1, axis=0), jnp.roll(since, 1, axis=0))
    near = jnp.where(jnp.isnan(across), beside, across)
    return jnp.fmin(since, until) > _AWAY * (near + jnp.nanmedian(since, axis=0))
