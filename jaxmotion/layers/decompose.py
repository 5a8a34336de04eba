"""Motion layers (Eom et al. 2019, §4.1, §4.2): M = (Mᵇ ⊕ δᶜ) ⊕ δʳ.

    base      Mᵇ = LGS(M; λᵇ, σᵇ), the smoothest motion all of whose displacements are unambiguous
    control   δᶜ = LGS(δ; λᶜ, σᶜ), what an animator turns up and down; δ = M ⊖ Mᵇ    Eq. 12, 13, 15
    residual  δʳ, what is left: noise

With ``tune`` noise is taken out first: M̂ = LGS(M), λ and σ learned for every joint, Mᵇ = LGS(M̂),
δᶜ = M̂ ⊖ Mᵇ and δʳ = M ⊖ M̂. In the paper's order the base of a fast clip, which cannot be smooth,
keeps the noise of all joints, and no smoothing of δ can take it out again.

λᵇ and σᵇ climb the ladder λ_k = r^k, σ_k = r^k/10, r = √2 (Eq. 14). A rotation displacement longer
than γ is close to turning the other way round, so the climb stops at the first rung where any
frame's ‖v‖ exceeds γ, and the rung below is the base (the lowest rung is always allowed). A calm
motion never gets there: at λσ = 10⁶ the base is as good as a straight line, and ``saturated`` says
that the climb ended at the top (the exact smoother ends it at λσ = 1000 in float32, where its
digits end). No gradient passes through the choice of the rung.

⊕ is the world sense of :mod:`jaxmotion.displacement` (p + u, q·exp(v), full angle). Rungs are tried
one after the other, each O(T·J).
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxmotion import quaternion
from jaxmotion._checks import counted, known, one_number, one_of, require, static, traced
from jaxmotion._entry import MISSING, check_weights, finite_numbers, one_clip
from jaxmotion._file_facts import compiled
from jaxmotion._portable import Portable
from jaxmotion._program import keepable
from jaxmotion._room import Room, room_for
from jaxmotion._summary import brief
from jaxmotion._types import ArrayLike, ScalarLike
from jaxmotion.displacement import Displacement, minus
from jaxmotion.frames.count import counted_weights
from jaxmotion.motion import Motion
from jaxmotion.smoothing import MotionTuning, lgs
from jaxmotion.smoothing.components import from_components, to_components
from jaxmotion.smoothing.design import Design
from jaxmotion.smoothing.lgs import check_positive
from jaxmotion.smoothing.repeats import without_repeats
from jaxmotion.smoothing.rotations import geodesic_limit, smoothed_clip
from jaxmotion.smoothing.together import smoothed_together
from jaxmotion.smoothing.tuning import Criterion, Prior, tune_clip

_RATIO = np.sqrt(2.0)
_LAM_0, _SIGMA_0 = 1.0, 0.1
_TOP_PRODUCT = 1e6
RUNGS = 1 + int(np.floor(np.log(_TOP_PRODUCT / (_LAM_0 * _SIGMA_0)) / np.log(_RATIO**2)))


class MotionLayers(Portable):
    """``base`` ⊕ ``control`` ⊕ ``residual`` is the motion that was decomposed.

    **Fields:** ``base``: Motion; ``control``, ``residual``: Displacements f[T, J, 3] each; ``lam``,
    ``sigma``: the base's parameters, f[] or f[J] by scope; ``saturated``: bool[] or bool[J],
    whether the search ended at its upper bound with every ‖v‖ ≤ γ; ``tuning``: what was learned of
    the noise, as :func:`~jaxmotion.smoothing.tune` gives it, else None.

    **Example:**

        >>> import jaxmotion as jm
        >>> motion = jm.samples.load("walk").motion[:16]
        >>> layers = jm.decompose(motion)
        >>> layers.control.rotations.shape, layers.tuning
        ((16, 22, 3), None)
    """

    base: Motion
    control: Displacement
    residual: Displacement
    lam: Float[Array, "..."]
    sigma: Float[Array, "..."]
    saturated: Bool[Array, "..."]
    tuning: MotionTuning | None

    def _words(self) -> Iterator[str]:
        yield from self.base._words()
        yield f"base λ={brief(self.lam)} σ={brief(self.sigma)}"


@static("order")
def decompose(
    motion: Motion,
    *,
    gamma: ScalarLike = np.pi / 2,
    lam_c: ScalarLike = 1.0,
    sigma_c: ScalarLike = 1.0,
    scope: Literal["global", "per_joint"] = "global",
    order: Literal[1, 2] = 2,
    tune: Criterion | None = None,
    prior: Prior = "gaussian",
    method: Literal["chordal", "geodesic"] = "chordal",
    weights: ArrayLike | None = None,
    length: ScalarLike | None = None,
) -> MotionLayers:
    """Split a motion into base, controllable and residual layers.

    Each rung that is tried costs O(T·J). Differentiable in the motion, ``lam_c`` and ``sigma_c``;
    no gradient passes through the choice of the rung. Source: Eom et al. 2019, §4.1, Eq. 12 to 15.

    **Arguments:** ``motion``: one clip of T ≥ 1 frames; ``gamma``: bound on ‖v‖ in radians, in (0,
    π), the paper's π/2; ``lam_c``, ``sigma_c``: parameters of the control layer, scalars or f[J],
    the paper's 1; ``scope``: "global", one base for the body, or "per_joint", a rung of its own for
    every joint (its translation follows); ``order``: of the smoother; ``tune``: take out the noise
    first, with λ and σ learned per joint and apart for rotations and translations by this criterion
    ("evidence", "gcv" or "holdout", see :mod:`jaxmotion.smoothing.tuning`), and take no ``lam_c``
    and ``sigma_c``; ``prior``: with ``tune``, "gaussian" or "student", which tells sudden moves
    from noise, as :func:`~jaxmotion.smoothing.tune`; ``method``: rotations are smoothed by Eq. 11,
    "chordal", or exactly by Eq. 9, "geodesic" (``smoothing.geodesic``; the rung is chosen by Eq. 11
    either way); ``weights``: f[T] or f[T, J], ≥ 0, how far each sample is trusted, 0 for missing
    (``smoothing.outlier_weights``); γ binds samples of positive weight; ``length``: how many frames
    count, traced or not, when the rest is padding (any rotations; what comes out there means
    nothing), so that one compiled function serves clips of many lengths.
    **Returns:** :class:`MotionLayers`.
    **Raises:** ``ValueError`` for what is not one clip, an unknown scope, method, order or
    criterion, a γ outside (0, π), weights of another shape or negative, NaN in the motion at
    positive weight, ``lam_c`` or ``sigma_c`` not positive, or a length that is not from 1 to T; at
    run time for traced ones, and as ``smoothing.lgs`` and ``smoothing.geodesic``.

    **Example:**

        >>> import jaxmotion as jm
        >>> motion = jm.samples.load("walk").motion[:16]
        >>> layers = jm.decompose(motion)
        >>> whole = jm.displacement.plus(layers.base, layers.control)
        >>> whole = jm.displacement.plus(whole, layers.residual)
        >>> bool(jm.quaternion.distance(whole.rotations, motion.rotations).max() < 1e-3)
        True
    """
    one_of("decompose: scope", scope, ("global", "per_joint"))
    check_method(method, "decompose")
    motion, weights, gamma = checked_layers("decompose", motion, gamma, weights, length)
    ones = not traced(lam_c, sigma_c) and np.all(known(lam_c) == 1) and np.all(known(sigma_c) == 1)
    if tune is not None and not ones:
        raise ValueError("decompose: tune= learns λ and σ; it takes no lam_c= and no sigma_c=")
    if tune is None and prior != "gaussian":
        raise ValueError("decompose: prior= is of what tune= learns; give both")
    check_positive("decompose: lam_c", lam_c)
    check_positive("decompose: sigma_c", sigma_c)
    lam_c, sigma_c = (jnp.asarray(p, motion.dtype) for p in (lam_c, sigma_c))
    room, motion, weights = with_room(motion, weights, length, method, gamma, lam_c, sigma_c)
    layers = layers_of(motion, weights, gamma, lam_c, sigma_c, scope, order, tune, prior, method)

    def of_frames(layers):
        return layers.base, layers.control, layers.residual

    layers = room.cut(layers, of_frames)
    return replace(layers, tuning=cut_tuning(room, layers.tuning))


def cut_tuning(room: Room, tuning: MotionTuning | None) -> MotionTuning | None:
    """What was learned, of the frames that count."""
    if tuning is None or tuning.rotations.stiffness is None:
        return tuning

    def by_frame(tuning):
        return tuning.rotations.stiffness, tuning.translations.stiffness

    return room.cut(tuning, by_frame)


def with_room(
    motion: Motion, weights: Array | None, length: ScalarLike | None, method: str, *given
) -> tuple[Room, Motion, Array | None]:
    """Room for what :func:`checked_weights` returned, and the two in it; ``given``: whatever else
    may be traced. None for the exact smoother: stiff in float32, it has no digits for a long tail
    without data."""
    room = Room(motion.num_frames)
    if method == "chordal":
        room = room_for(motion, weights, given, length=length)
    if room.size:
        weights = None if weights is None else room.fill(weights)
        count = jnp.asarray(room.frames, jnp.int32)
        weights = counted_weights(weights, count, room.size, motion.dtype)
    return room, room.fill(motion), weights


def checked_layers(
    caller: str,
    motion: Motion,
    gamma: ScalarLike,
    weights: ArrayLike | None,
    length: ScalarLike | None,
) -> tuple[Motion, Array | None, Array]:
    """What :func:`checked_weights` returns and γ, for ``caller``, whose name is in the errors."""
    motion, weights = checked_weights(motion, weights, length, caller)
    angle = one_number(f"{caller}: gamma", gamma)
    outside = ~((angle > 0) & (angle < np.pi))
    message = f"{caller}: gamma must be an angle between 0 and π"
    motion = require(motion, outside, message, got=gamma)
    return motion, weights, jnp.asarray(gamma, motion.dtype)


def check_method(method: str, caller: str) -> None:
    """``ValueError`` unless layers can be had by this method."""
    one_of(f"{caller}: method", method, ("chordal", "geodesic"))


def checked_weights(
    motion: Motion, weights: ArrayLike | None, length: ScalarLike | None, caller: str
) -> tuple[Motion, Array | None]:
    """The motion, its ``length`` checked, and ``weights``, 0 from frame ``length`` on; None where
    all count.

    **Raises:** ``ValueError`` for what is not one clip, weights that are neither f[T] nor f[T, J],
    weights and motions known to be wrong, at run time for motions that are traced; as ``counted``.
    The smoothers look at traced weights.
    """
    one_clip(caller, motion)
    if weights is not None:
        check_weights(caller, motion, weights)
        given, weights = known(weights), jnp.asarray(weights, motion.dtype)
        if not traced(given):
            wrong = ~((given >= 0) & (given < np.inf)).all()
            require(None, wrong, f"{caller}: weights must be finite and >= 0", got=given)
    if length is not None:
        count, motion = counted(f"{caller}: length", length, motion.num_frames, motion)
        weights = counted_weights(weights, count, motion.num_frames, motion.dtype)
    hint = "" if caller == "stylize" else MISSING  # it takes no weights
    return finite_numbers(caller, motion, weights=weights, at_run_time=True, hint=hint), weights


@keepable
@compiled
def layers_of(
    motion: Motion,
    weights: Array | None,
    gamma: Array,
    lam_c: Array,
    sigma_c: Array,
    scope: Literal["global", "per_joint"] = "global",
    order: Literal[1, 2] = 2,
    criterion: Criterion | None = None,
    prior: Prior = "gaussian",
    method: Literal["chordal", "geodesic"] = "chordal",
) -> MotionLayers:
    """:func:`decompose` of what is checked."""
    motion = motion.with_transforms(rotations=quaternion.align_signs(motion.rotations))
    tuning, clean = None, motion
    if criterion is not None:
        tuning, clean = without_noise(motion, criterion, order, prior, weights, method)
    rungs = _rungs_of(method, order, motion.dtype)
    constant = jax.lax.stop_gradient(clean.rotations)
    rung, saturated = _climb(constant, weights, gamma, scope, order, rungs)
    lam, sigma = _rung_parameters(rung, motion.dtype)
    base = smoothed_clip(
        clean, lam, sigma, design=Design(order=order), weights=weights, method=method
    )
    whole = minus(clean, base)
    if criterion is not None:
        return MotionLayers(base, whole, minus(motion, clean), lam, sigma, saturated, tuning)
    # One smoother for both: f[T, J, 2, 3], each joint's translation and rotation apart.
    both = jnp.stack([whole.translations, whole.rotations], axis=2)
    lam_c, sigma_c = (p.reshape(p.shape + (1,) * (3 - p.ndim)) for p in (lam_c, sigma_c))
    of_both = weights
    if weights is not None and weights.ndim > 1:
        of_both = weights[:, :, None, None]
    smooth = lgs(both, lam_c, sigma_c, order=order, weights=of_both).mean
    control = Displacement(smooth[:, :, 0], smooth[:, :, 1])
    left = quaternion.between(quaternion.exp(control.rotations), quaternion.exp(whole.rotations))
    residual = Displacement(whole.translations - control.translations, quaternion.log(left))
    return MotionLayers(base, control, residual, lam, sigma, saturated, None)


def without_noise(
    motion: Motion,
    criterion: Criterion,
    order: Literal[1, 2],
    prior: Prior,
    weights: Array | None,
    method: Literal["chordal", "geodesic"],
    together: Array | None = None,
) -> tuple[MotionTuning, Motion]:
    """M̂: what is learned of the noise, joint by joint (``smoothing.tune``), and the motion smoothed
    accordingly, the joints ``together`` if a prior has their covariance. ``weights`` as
    :func:`checked_weights` gives them; dropped frames count for nothing. O(T·J)."""
    weights = without_repeats(motion, weights)
    tuning = tune_clip(motion, weights, criterion=criterion, order=order, prior=prior)
    turning, moving = tuning.rotations, tuning.translations
    lam = turning.lam
    if method == "geodesic":  # still joints learn a smoother that is as stiff as can be
        most = geodesic_limit(order, motion.dtype) / turning.sigma ** (3 - order)
        firmest = 1.0 if turning.stiffness is None else jnp.max(turning.stiffness, axis=0)
        lam = jnp.minimum(lam, most / firmest)
    clean = smoothed_clip(
        motion,
        lam,
        turning.sigma,
        translation_lam=moving.lam,
        translation_sigma=moving.sigma,
        stiffness=turning.stiffness,
        translation_stiffness=moving.stiffness,
        design=Design(order=order),
        weights=weights,
        method=method,
    )
    if together is not None:
        whole_angles = 2 * turning.sigma
        clean = smoothed_together(motion, clean, whole_angles, together, weights)
    return tuning, clean


def _rungs_of(method: str, order: Literal[1, 2], dtype) -> int:
    """How many rungs there are, for the exact smoother as many as keep its digits."""
    if method == "chordal":
        return RUNGS
    lam, sigma = (start * _RATIO ** np.arange(RUNGS) for start in (_LAM_0, _SIGMA_0))
    return int(np.sum(lam * sigma ** (3 - order) <= geodesic_limit(order, dtype)))


def _climb(
    rotations: Array,
    weights: Array | None,
    gamma: Array,
    scope: str,
    order: Literal[1, 2],
    rungs: int,
):
    """The last rung before the first whose displacements pass γ, and whether there was none."""
    joints = rotations.shape[1] if scope == "per_joint" else 1
    components = to_components(rotations, weights)
    of_components = weights
    if weights is not None and weights.ndim > 1:
        of_components = weights[:, :, None]

    def exceeds(k):
        lam, sigma = _rung_parameters(k, rotations.dtype)
        base = lgs(components, lam, sigma, order=order, weights=of_components).mean
        angle = quaternion.distance(from_components(base), rotations)
        if weights is not None:
            angle = jnp.where(weights.reshape(weights.shape[0], -1) > 0, angle, 0)
        length = jnp.max(angle, axis=0)
        return (length if scope == "per_joint" else jnp.max(length)[None]) > gamma

    def climbing(state):
        k, stopped, _ = state
        return (k < rungs) & ~jnp.all(stopped)

    def try_rung(state):
        k, stopped, best = state
        stopped = stopped | exceeds(k)
        return k + 1, stopped, jnp.where(stopped, best, k)

    start = (0, jnp.zeros(joints, bool), jnp.zeros(joints, int))
    _, stopped, best = jax.lax.while_loop(climbing, try_rung, start)
    return (best, ~stopped) if scope == "per_joint" else (best[0], ~stopped[0])


def _rung_parameters(k: Array, dtype) -> tuple[Array, Array]:
    growth = jnp.asarray(_RATIO, dtype) ** jnp.asarray(k, dtype)
    return _LAM_0 * growth, _SIGMA_0 * growth
