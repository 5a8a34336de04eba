"""Edited motions from layers (Eom et al. 2019, §5.2): M′ = Mᵇ ⊕ W(t)·δᶜ [⊕ ρ·δʳ] (Eq. 16, 17).

W scales every joint's control displacement by α: 0 leaves the base, 1 denoises, more exaggerates,
less attenuates, negative mirrors the style. α differs by joint for local style, and by frame for
style that comes and goes. O(T·J), differentiable in everything.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion import spacetime
from jaxmotion._checks import instance_of, one_of, static
from jaxmotion._entry import one_clip, skeleton_of
from jaxmotion._file_facts import compiled
from jaxmotion._numerics import safe_norm
from jaxmotion._program import keepable
from jaxmotion._types import AnyArray, ArrayLike, ScalarLike
from jaxmotion.contacts import Contacts
from jaxmotion.contacts.contact import check_kept
from jaxmotion.displacement import Displacement, minus, plus
from jaxmotion.layers.decompose import (
    MotionLayers,
    check_method,
    checked_layers,
    checked_weights,
    cut_tuning,
    layers_of,
    with_room,
    without_noise,
)
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton
from jaxmotion.smoothing import MotionPrior, MotionTuning, outlier_weights
from jaxmotion.smoothing.lgs import check_positive
from jaxmotion.smoothing.repeats import dropped_frames
from jaxmotion.smoothing.tuning import Prior


@static("keep_contacts")
def synthesize(
    layers: MotionLayers,
    alpha: ArrayLike = 1.0,
    residual: ArrayLike = 0.0,
    *,
    translation_alpha: ArrayLike | None = None,
    keep_contacts: Contacts | bool = False,
) -> Motion:
    """The motion with its control layer scaled and its residual layer kept or dropped.

    O(T·J), differentiable in everything. Source: Eom et al. 2019, Eq. 16, 17.

    **Arguments:** ``layers``: of one clip, by :func:`decompose`; ``alpha``: gain of the control
    layer: a scalar, per joint f[J], or per frame and joint f[T, J] (f[T, 1] for all joints);
    ``residual``: gain of the residual, likewise: 0 removes the noise, 1 keeps it;
    ``translation_alpha``: gain of the translations if it is to differ from ``alpha``;
    ``keep_contacts``: True finds what touched in the original and restores it
    (:func:`jaxmotion.spacetime.keep_contacts`, Eq. 18), :class:`~jaxmotion.contacts.Contacts` are
    restored as given (under ``jit`` only these).
    **Returns:** a motion of the layers' shape; ``synthesize(layers, 1, 1)`` is the original.
    **Raises:** ``ValueError`` for what are no layers of one clip, a gain of another shape, contacts
    of another length.

    **Example:**

        >>> import jaxmotion as jm
        >>> layers = jm.decompose(jm.samples.load("walk").motion[:16])
        >>> calm = jm.synthesize(layers, alpha=0.5)
        >>> original = jm.synthesize(layers, 1.0, residual=1.0)
        >>> calm.rotations.shape == original.rotations.shape
        True
    """
    expected = "MotionLayers (jaxmotion.decompose makes them)"
    instance_of("synthesize: layers", layers, MotionLayers, expected)
    one_clip("synthesize", layers.base, "layers.base")
    moving = alpha if translation_alpha is None else translation_alpha
    check_kept(layers.base, keep_contacts, "synthesize")
    edit = _edited("synthesize", layers, alpha, residual, moving)
    if keep_contacts is False:
        return edit
    one = jnp.ones((), layers.base.dtype)
    original = _synthesize(layers, one, one, one)
    return spacetime.keep_contacts(edit, original=original, contacts=keep_contacts)


def _edited(
    caller: str, layers: MotionLayers, alpha: ArrayLike, residual: ArrayLike, moving: ArrayLike
) -> Motion:
    return _synthesize(
        layers,
        _gain(f"{caller}: alpha", alpha, layers.base),
        _gain(f"{caller}: translation_alpha", moving, layers.base),
        _gain(f"{caller}: residual", residual, layers.base),
    )


@compiled
def _synthesize(layers: MotionLayers, turning: Array, moving: Array, residual: Array) -> Motion:
    rotations = layers.control.scale(turning).rotations
    control = Displacement(layers.control.scale(moving).translations, rotations)
    return plus(plus(layers.base, control), layers.residual.scale(residual))


@static("tune", "robust")
def denoise(
    motion: Motion,
    *,
    tune: bool = True,
    lam: ScalarLike | None = None,
    sigma: ScalarLike | None = None,
    strength: ArrayLike = 1.0,
    max_change: ScalarLike | None = None,
    method: Literal["chordal", "geodesic"] = "chordal",
    prior: Prior | MotionPrior = "student",
    robust: bool = False,
    weights: ArrayLike | None = None,
    length: ScalarLike | None = None,
) -> Motion:
    """Remove the noise of the capture: the residual layer of :func:`decompose`.

    Sudden moves stay as they are: a toe that flicks, a blow that lands. So do sudden errors, which
    ``robust`` and :func:`jaxmotion.check` are for. Up to three frames that repeat the one before,
    of a body that moves, were dropped by the capture and are made anew. O(T·J), differentiable in
    the motion and ``strength``; what is learned is a constant. Source: Eom et al. 2019, §5.2
    (α = 1) and §6.2.

    **Arguments:** ``motion``: one clip of T ≥ 1 frames; ``tune``: learn the smoother's parameters
    from the clip, per joint, by restricted evidence; False takes the paper's λ = σ = 1 for the
    control layer; ``lam``, ``sigma``: that layer's parameters, scalars or f[J], and nothing is
    learned (one left out is 1); ``strength``: the share of the residual that is removed, 1 for all,
    0 for none, a scalar, f[J] or f[T, J]; ``max_change``: radians by which no joint is turned more,
    whatever was learned (of its noise less is removed there); ``method``: as :func:`decompose`;
    ``prior``: what is learned of second differences: "student", heavy tails that tell sudden moves
    from noise, or "gaussian", the paper's (:func:`~jaxmotion.smoothing.tune`); or what clean clips
    of the same joints tell of how they turn together (:func:`~jaxmotion.smoothing.motion_prior`),
    for rotations, with heavy tails; ``robust``: find spikes first and bridge them
    (``weights=smoothing.outlier_weights(motion)`` does the same, and ``smoothing.bridged`` lists
    what was bridged); ``weights``, ``length``: as :func:`decompose`.
    **Returns:** a motion of the same shape.
    **Raises:** as :func:`decompose` and :func:`synthesize`.

    **Example:**

        >>> import jax, jaxmotion as jm
        >>> motion = jm.samples.load("walk").motion[:16]
        >>> noisy = jm.samples.add_noise(motion, jax.random.key(0), rotation=0.05).motion
        >>> clean = jm.denoise(noisy)
        >>> off = [jm.quaternion.distance(m.rotations, motion.rotations) for m in (clean, noisy)]
        >>> bool(off[0].mean() < 0.7 * off[1].mean())
        True
    """
    given = tune, lam, sigma, strength, max_change, method, prior, robust, weights, length
    return denoised(motion, *given).motion


class Denoised(NamedTuple):
    """``motion``: what :func:`denoise` returns; ``tuning``: what it learned of the noise, None if
    it learned nothing; ``weights``: f[T, J], 0 for spikes, None unless it looked for them;
    ``dropped``: bool[T], the frames made anew, None if it learned nothing."""

    motion: Motion
    tuning: MotionTuning | None
    weights: Array | None
    dropped: Array | None


def denoised(
    motion: Motion,
    tune: bool = True,
    lam: ScalarLike | None = None,
    sigma: ScalarLike | None = None,
    strength: ArrayLike = 1.0,
    max_change: ScalarLike | None = None,
    method: Literal["chordal", "geodesic"] = "chordal",
    prior: Prior | MotionPrior = "student",
    robust: bool = False,
    weights: ArrayLike | None = None,
    length: ScalarLike | None = None,
) -> Denoised:
    """:func:`denoise`, and what it learned; arguments and errors as there."""
    check_method(method, "denoise")
    motion, weights = checked_weights(motion, weights, length, "denoise")
    learning = tune and lam is None and sigma is None
    prior, together = _prior_of(motion, prior, learning)
    for name, value in (("lam", lam), ("sigma", sigma), ("max_change", max_change)):
        if value is not None:
            check_positive(f"denoise: {name}", value)
    removed = _gain("denoise: strength", strength, motion)
    room, motion, weights = with_room(
        motion, weights, length, method, removed, lam, sigma, max_change
    )
    kept = 1.0 - (room.fill(removed) if removed.ndim == 2 else removed)
    most = None if max_change is None else jnp.asarray(max_change, motion.dtype)
    trusted = None
    if robust:
        weights = outlier_weights(motion, weights=weights)
        trusted = room.cut(weights)
    if learning:
        found = _without_noise(motion, weights, kept, most, together, prior, method)
        tuning, clean, dropped = found
        return Denoised(room.cut(clean), cut_tuning(room, tuning), trusted, room.cut(dropped))
    given = (np.pi / 2, *(1.0 if value is None else value for value in (lam, sigma)))
    gamma, lam_c, sigma_c = (jnp.asarray(value, motion.dtype) for value in given)
    layers = layers_of(motion, weights, gamma, lam_c, sigma_c, method=method)
    kept = _kept(layers.residual, kept, most)
    return Denoised(room.cut(_edited("denoise", layers, 1.0, kept, 1.0)), None, trusted, None)


def _prior_of(
    motion: Motion, prior: Prior | MotionPrior, learning: bool
) -> tuple[Prior, Array | None]:
    """What is said of second differences, and how the motion's joints turn together."""
    if not isinstance(prior, MotionPrior):
        one_of("denoise: prior", prior, ("student", "gaussian"))
        return prior, None
    if not learning:
        raise ValueError(
            "denoise: a MotionPrior is for what is learned; leave out tune=False, lam= and sigma="
        )
    return "student", jnp.asarray(prior.of(motion.skeleton), motion.dtype)


@keepable
@compiled
def _without_noise(
    motion: Motion,
    weights: Array | None,
    kept: Array,
    most: Array | None,
    together: Array | None,
    prior: Prior,
    method: Literal["chordal", "geodesic"],
) -> tuple[MotionTuning, Motion, Array]:
    """What is learned; the tuned layers' base ⊕ control ⊕ a share of the residual, for which no
    base is needed; the frames that were dropped."""
    tuning, clean = without_noise(motion, "evidence", 2, prior, weights, method, together)
    noise = minus(motion, clean)
    clean = plus(clean, noise.scale(_kept(noise, kept, most)))
    return tuning, clean, dropped_frames(motion, weights)


def _kept(noise: Displacement, kept: Array, most: Array | None) -> Array:
    """The share of the noise that stays, so that what goes turns no joint by more than ``most``."""
    if most is None:
        return kept
    angle = safe_norm(noise.rotations)
    far = angle > most
    return jnp.maximum(kept, jnp.where(far, 1 - most / jnp.where(far, angle, 1), 0))


@static("keep_contacts")
def stylize(
    motion: Motion,
    alpha: ArrayLike,
    *,
    residual: ArrayLike = 0.0,
    gamma: ScalarLike = np.pi / 2,
    length: ScalarLike | None = None,
    keep_contacts: Contacts | bool = False,
) -> Motion:
    """Exaggerate (α > 1) or attenuate (α < 1) the style of a motion.

    :func:`decompose`, then :func:`synthesize`. Source: Eom et al. 2019, §5.2.

    **Arguments:** ``motion``: one clip of T ≥ 1 frames; ``alpha``, ``residual``: gains of the
    control layer and of the residual, as :func:`synthesize`; :func:`joint_weights` makes an
    ``alpha`` from names; ``gamma``, ``length``: as :func:`decompose`; ``keep_contacts``: True finds
    what touches in ``motion`` and restores it, contacts are restored as given, as
    :func:`synthesize`.
    **Returns:** a motion of the same shape.
    **Raises:** as :func:`decompose` and :func:`synthesize`.

    **Example:**

        >>> import jaxmotion as jm
        >>> motion = jm.samples.load("walk").motion[:16]
        >>> arms = jm.joint_weights(motion.skeleton, {"*Arm": 2.0})
        >>> jm.stylize(motion, arms).rotations.shape
        (16, 22, 4)
    """
    one_clip("stylize", motion)
    check_kept(motion, keep_contacts, "stylize", length)
    motion, weights, gamma = checked_layers("stylize", motion, gamma, None, length)
    gains = [
        _gain("stylize: alpha", alpha, motion),
        _gain("stylize: residual", residual, motion),
    ]
    room, roomy, weights = with_room(motion, weights, length, "chordal", gamma, gains)
    alpha, residual = (room.fill(x) if x.ndim == 2 else x for x in gains)
    one = jnp.ones((), motion.dtype)
    layers = layers_of(roomy, weights, gamma, one, one)
    edit = room.cut(_edited("stylize", layers, alpha, residual, alpha))
    return spacetime.keep_contacts(edit, original=motion, contacts=keep_contacts, length=length)


def joint_weights(
    skeleton: Skeleton | Motion, gains: Mapping[str, float], *, default: float = 1.0
) -> Float[AnyArray, " joint"]:
    """One gain a joint from name patterns: ``joint_weights(skeleton, {"*Arm*": 2.0})``.

    **Arguments:** ``skeleton``: J joints, or a motion of them; ``gains``: shell patterns (any case)
    to gains; a later pattern overrides an earlier one; ``default``: for joints no pattern matches.
    **Returns:** f[J], in the type of the skeleton's offsets.
    **Raises:** ``ValueError``, listing the joints, when a pattern matches none, and for gains
    without patterns.

    **Example:**

        >>> import jaxmotion as jm
        >>> skeleton = jm.samples.load("walk").motion.skeleton
        >>> gains = jm.joint_weights(skeleton, {"left*": 2.0, "*Hand": 0.0})
        >>> [float(gains[skeleton.index(name)]) for name in ("Hips", "LeftArm", "LeftHand")]
        [1.0, 2.0, 0.0]
    """
    skeleton = skeleton_of("joint_weights", skeleton)
    expected = """patterns and their gains, as in {"*Arm*": 2.0}"""
    instance_of("joint_weights: gains", gains, Mapping, expected)
    weights = np.full(skeleton.num_joints, default)
    for pattern, gain in gains.items():
        weights[list(skeleton.matching(pattern))] = gain
    return jnp.asarray(weights, skeleton.offsets.dtype)


def _gain(name: str, value: ArrayLike, motion: Motion) -> Array:
    value = jnp.asarray(value, motion.dtype)
    frames, joints = motion.num_frames, motion.num_joints
    if value.shape not in ((), (joints,), (frames, joints), (frames, 1)):
        raise ValueError(
            f"{name} has shape {value.shape}; expected a scalar, ({joints},) per joint or "
            f"({frames}, {joints}) per frame and joint"
        )
    return value
