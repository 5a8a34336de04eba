"""λ and σ of the smoother learned from the data, one pair a clip, joint or channel.

The mean of the LGS depends on ρ alone (ρ = λσ for order 2, λσ² for order 1), so each criterion is
minimised over s = log ρ; σ then follows in closed form, and λ from both. N data of positive weight,
m the dimension of the prior's null space (2 or 1), n = N − m, H the smoother's hat matrix:

    evidence   F = n log(J/n) + log det(σ²P) − Σ log σ²r_j      σ² = J/n
               −2 log of the restricted likelihood, the prior's level and slope integrated out and
               σ profiled out; J is the least energy and r_j the prior's precisions (see ``lgs``)
    gcv        F = log RSS − 2 log(1 − tr H/N)                   σ² = RSS/(N − tr H)
    holdout    F = log Σ ‖y_i − ŷ_i without its fold‖²           σ² as for gcv
               five interleaved folds

F is looked at a decade apart, and the two decades around the least are bisected on the sign of
dF/ds, exact by forward mode (one derivative serves all groups, as each depends on its own s only):
one loop of 18 looks, O(N) each, so that the smoother is compiled once. With ``prior="student"``
second differences have heavy tails, learned along with λ and σ (:mod:`.heavy_tails`): a stiffness
by frame tells sudden moves from noise. The result is a constant: no gradient passes through
``tune`` (to tune by a loss of your own, differentiate the smoother with respect to λ and σ, and by
frame to its ``stiffness`` and ``weights``; through the tails :func:`.student_stiffness` leads).

Craven & Wahba 1979 (GCV); Patterson & Thompson 1971 (restricted likelihood); Eom et al. 2019, §6.2
names the choice of λ as future work.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion._checks import no_module, one_of, static
from jaxmotion._entry import MISSING, finite_clip
from jaxmotion._portable import Portable
from jaxmotion._program import keepable
from jaxmotion._summary import brief
from jaxmotion._types import AnyArray, ArrayLike
from jaxmotion.motion import Motion
from jaxmotion.smoothing.components import to_components
from jaxmotion.smoothing.design import check_known
from jaxmotion.smoothing.heavy_tails import Look, Tails, Told, no_bends, settle
from jaxmotion.smoothing.lgs import Posterior, lgs

Criterion: TypeAlias = Literal["evidence", "gcv", "holdout"]
Per: TypeAlias = Literal["clip", "joint", "channel"]
Prior: TypeAlias = Literal["gaussian", "student"]

# ρ from 10⁻² (the data themselves) to 10⁵ (a straight line over seconds), a decade apart. The
# criteria change over decades of ρ (the effective number of parameters goes as ρ^(-1/2)).
_STEP = math.log(10.0)
_GRID = _STEP * np.arange(-2.0, 6.0)
_BISECTIONS = 9
_FOLDS = 5
# Noise leaves a quaternion's length as it is, so that one of its four components has none.
NOISY_SHARE = math.sqrt(4 / 3)


class Tuning(Portable):
    """What is learned of one signal.

    **Fields:** ``lam``, ``sigma``: what to give the smoother, shaped by ``per``: f[] for "clip",
    f[J] for "joint" (the first channel axis), f[*channels] for "channel"; ``score``: the criterion
    there, likewise. With ``prior="student"``, else None: ``dof``, the degrees of freedom ν of
    second differences, likewise (100 for a Gaussian's tails), and ``stiffness``, f[Nf, *those].
    """

    lam: Float[Array, "..."]
    sigma: Float[Array, "..."]
    score: Float[Array, "..."]
    dof: Float[Array, "..."] | None = None
    stiffness: Float[Array, "frames ..."] | None = None


class MotionTuning(Portable):
    """What is learned of a motion.

    **Fields:** ``rotations``: a :class:`Tuning`, σ in half angles about each axis;
    ``translations``: one with σ in file units; f[J] each, or f[] for "clip". Joints that are not
    translated get λ = σ = 1.
    """

    rotations: Tuning
    translations: Tuning

    def _words(self) -> Iterator[str]:
        for name, learned in (("rotations", self.rotations), ("translations", self.translations)):
            yield f"{name} λ={brief(learned.lam)} σ={brief(learned.sigma)}"


@static("num_frames", "order")
def tune(
    y: ArrayLike | Motion,
    *,
    criterion: Criterion = "evidence",
    per: Per = "joint",
    index: ArrayLike | None = None,
    num_frames: int | None = None,
    weights: ArrayLike | None = None,
    order: Literal[1, 2] = 2,
    scale: Literal["half", "unit"] = "half",
    prior: Prior = "gaussian",
) -> Tuning | MotionTuning:
    """Learn λ and σ from noisy data.

    Data too short to learn from (n ≤ 0) get ρ = 1; data that keep still but for rounding (8 eps of
    their size), which hold neither noise nor movement, ρ = σ = 1 (rotations of a motion: σ =
    √(4/3), as all of them are scaled). 18 looks (22 for "student"), O(Nd + Nf) each. No gradient
    passes through the result.

    **Arguments:** ``y``: f[Nd, *channels], or a motion; ``criterion``: "evidence" (restricted
    likelihood), "gcv" (generalised cross-validation) or "holdout" (five folds); ``per``: how much
    shares one pair, "clip", "joint" (the first channel axis; a signal without one counts as one
    joint) or "channel" (not of a motion); ``index``, ``num_frames``, ``weights``, ``order``,
    ``scale``: as :func:`~jaxmotion.smoothing.lgs`; ``prior``: second differences are "gaussian", as
    in the paper, or "student": sudden moves are told from noise (:mod:`.heavy_tails`), by evidence
    and for order 2; the joints of a motion then tell each other of their noise, rotations and
    translations apart, as far as they agree.
    **Returns:** :class:`Tuning`, or for a motion :class:`MotionTuning`, ready for
    :func:`smooth_quaternions` and :func:`smooth_motion`.
    **Raises:** ``ValueError`` for unknown options; as :func:`~jaxmotion.smoothing.lgs` for bad
    data.
    """
    options = {"criterion": criterion, "per": per, "order": order, "scale": scale}
    options |= {"index": index, "num_frames": num_frames, "prior": prior}
    if isinstance(y, Motion):
        if per == "channel":
            raise ValueError("tune: per='channel' needs a signal; a motion has 'clip' or 'joint'")
        y = finite_clip("tune", y, "y", weights=weights, at_run_time=True, hint=MISSING)
        return tune_clip(y, weights, **options)
    no_module("tune: y", y)
    return tune_signal(jnp.asarray(y), weights=weights, **options)


def tune_clip(
    motion: Motion,
    weights: ArrayLike | None,
    *,
    per: Per = "joint",
    index: ArrayLike | None = None,
    order: Literal[1, 2] = 2,
    **options,
) -> MotionTuning:
    """:func:`tune` for a clip that is checked, with its options."""
    options |= {"per": per, "index": index, "order": order}
    weights = None if weights is None else jnp.asarray(weights, motion.dtype)
    components = to_components(motion.rotations, weights, index)
    turning = tune_signal(components, weights=weights, share=True, **options)
    lam, sigma = turning.lam / NOISY_SHARE ** (3 - order), turning.sigma * NOISY_SHARE
    turning = replace(turning, lam=lam, sigma=sigma)
    moved = np.asarray(motion.translated_joints, int)
    of_joints = jax.tree.map(jnp.ones_like, turning)
    if not moved.size:
        return MotionTuning(turning, of_joints)
    if weights is not None and np.ndim(weights) > 1:
        weights = jnp.asarray(weights)[:, moved]
    moving = tune_signal(motion.translations[:, moved], weights=weights, share=True, **options)
    if per == "joint":
        moving = jax.tree.map(lambda all, x: all.at[..., moved].set(x), of_joints, moving)
    return MotionTuning(turning, moving)


def tune_signal(
    y: Float[AnyArray, "data *channels"],
    *,
    criterion: Criterion = "evidence",
    per: Per = "joint",
    index: ArrayLike | None = None,
    num_frames: int | None = None,
    weights: ArrayLike | None = None,
    order: Literal[1, 2] = 2,
    scale: Literal["half", "unit"] = "half",
    prior: Prior = "gaussian",
    share: bool = False,
    most: float | None = None,
) -> Tuning:
    """:func:`tune` for a signal f[Nd, *channels], with its options; ``share``: with "student",
    whether the groups have a noise of one source (:mod:`.heavy_tails`); ``most``: the
    largest that σ may be, with which J/σ² + n log σ² stands for n log(J/n)."""
    one_of("tune: criterion", criterion, ("evidence", "gcv", "holdout"))
    one_of("tune: per", per, ("clip", "joint", "channel"))
    one_of("tune: prior", prior, ("gaussian", "student"))
    if prior == "student" and (criterion, order) != ("evidence", 2):
        raise ValueError("tune: prior='student' is learned by criterion='evidence' for order=2")
    channels = y.shape[1:]
    kept = {"clip": (), "joint": channels[:1], "channel": channels}[per]
    grouped = y.reshape(y.shape[0], int(np.prod(kept)), -1)
    check_known("tune: y", y, weights, index, num_frames, order)
    weights = None if weights is None else jnp.asarray(weights, y.dtype)
    if weights is not None and weights.ndim > 1:
        spread = weights.reshape(weights.shape + (1,) * (y.ndim - weights.ndim))
        weights = jnp.broadcast_to(spread, y.shape).reshape(grouped.shape)
    options = criterion, num_frames, order, scale, prior, share, most
    found = _tune(grouped, weights, index, *options)
    return jax.tree.map(lambda x: x.reshape(*x.shape[:-1], *kept), found)


@keepable
@eqx.filter_jit
def _tune(
    y, weights, index, criterion: str, num_frames, order, scale, prior: str, share: bool, most
) -> Tuning:
    """``y`` f[Nd, G, C]; one pair for each of the G groups."""
    y, weights = jax.lax.stop_gradient((y, weights))
    base = jnp.ones((y.shape[0], 1, 1), y.dtype)
    if weights is not None:
        base = weights[:, None, None] if weights.ndim == 1 else weights
    present = jnp.broadcast_to(jnp.where(base > 0, 1, 0).astype(y.dtype), y.shape)
    y = jnp.where(present > 0, y, 0)
    # Rounding in y is noise that no smoothing can remove; it keeps the logarithms finite.
    count = jnp.sum(present, axis=(0, 2))
    size = jnp.sum(present * y * y, axis=(0, 2))
    floor = (8 * jnp.finfo(y.dtype).eps) ** 2 * jnp.where(size > 0, size, count)
    free = count - order * y.shape[2]
    mean = jnp.sum(present * y, axis=0) / jnp.maximum(jnp.sum(present, axis=0), 1)
    still = jnp.sum(present * (y - mean) ** 2, axis=(0, 2)) <= floor

    def smooth(s, weights, stiffness=None) -> Posterior:
        return lgs(
            y,
            jnp.exp(s)[:, None],
            jnp.ones((), y.dtype),
            index=index,
            num_frames=num_frames,
            order=order,
            weights=weights,
            stiffness=None if stiffness is None else stiffness[:, :, None],
            scale=scale,
        )

    def evaluate(s, stiffness=None, told: Told | None = None):
        """F of every group; σ² and the smoother."""
        post = smooth(s, weights, stiffness)
        if criterion == "evidence":
            energy = jnp.sum(post.energy, axis=1)
            rest = -2 * jnp.sum(post.log_evidence, axis=1) - energy
            energy, data = energy + floor, free
            if most is not None:
                variance = jnp.minimum(energy / jnp.maximum(data, 1), most**2)
                return data * jnp.log(variance) + energy / variance + rest, (variance, post)
            if told is not None:
                energy, data = energy + told.count * told.variance, free + told.count
            return data * jnp.log(energy) + rest, (energy / jnp.maximum(data, 1), post)
        rss = floor + jnp.sum(base * present * (y - post.fitted) ** 2, axis=(0, 2))
        trace = jnp.sum(jnp.broadcast_to(post.leverage, y.shape) * present, axis=(0, 2))
        degrees = jnp.clip(count - trace, min=jnp.finfo(y.dtype).eps * count)
        if criterion == "gcv":
            return jnp.log(rss) - 2 * jnp.log(degrees / count), (rss / degrees, post)
        return jnp.log(floor + _held_out(smooth, s, y, base * present)), (rss / degrees, post)

    learnable = jnp.where((free > 0) & ~still, 1, 0).astype(y.dtype)
    tails, frames = Tails(None, None), y.shape[0] if num_frames is None else num_frames
    if prior == "student" and frames > 2:
        unit = 0.25 if scale == "half" else 1.0
        grid = jnp.asarray(_GRID, y.dtype)
        look, tails = settle(evaluate, learnable, free, grid, frames, unit, share)
    else:
        look = _bisected(evaluate, learnable)
        tails = no_bends(learnable, frames) if prior == "student" else tails
    sigma = jnp.where(still, 1, jnp.sqrt(look.variance))
    variance = jnp.where(still, 1, look.variance)
    lam = jnp.exp(look.s) / (sigma if order == 2 else variance)
    return Tuning(lam, sigma, look.score, *tails)


def _bisected(evaluate, learnable: Float[Array, " group"]) -> Look:
    """The last look of the module's search."""
    grid = jnp.asarray(_GRID, learnable.dtype)

    def probe(state, k):
        """One look at the criterion: along the grid first, then halving the best bracket."""
        least, low, high = state
        on_grid = k < len(_GRID)
        s = jnp.where(on_grid, grid[jnp.minimum(k, len(_GRID) - 1)], 0.5 * (low + high))
        s = learnable * s
        score, slope, (variance, _) = jax.jvp(evaluate, (s,), (jnp.ones_like(s),), has_aux=True)
        better = on_grid & (score < least)
        beyond = ~on_grid & (slope >= 0)
        before = ~on_grid & (slope < 0)
        low = jnp.where(before, s, jnp.where(better, jnp.maximum(s - _STEP, grid[0]), low))
        high = jnp.where(beyond, s, jnp.where(better, jnp.minimum(s + _STEP, grid[-1]), high))
        return (jnp.where(better, score, least), low, high), Look(s, score, variance)

    everywhere = jnp.ones_like(learnable)
    start = (jnp.inf * everywhere, grid[0] * everywhere, grid[-1] * everywhere)
    looks = jnp.arange(len(_GRID) + _BISECTIONS + 1)
    return jax.tree.map(lambda x: x[-1], jax.lax.scan(probe, start, looks)[1])


def _held_out(smooth, s: Array, y: Array, weights: Array) -> Array:
    """Weighted squared errors of each fold predicted from the others, per group."""
    fold = (np.arange(y.shape[0]) % _FOLDS)[:, None, None]

    def errors(k):
        residual = y - smooth(s, jnp.where(fold == k, 0, weights)).fitted
        return jnp.sum(jnp.where(fold == k, weights * residual**2, 0), axis=(0, 2))

    return jnp.sum(jax.lax.map(errors, jnp.arange(_FOLDS)), axis=0)
