"""The LGS on rotations and on whole motions (Eom et al. 2019, Eq. 11 and Fig. 6).

    chordal   x = lgs of the four components of sign-aligned quaternions, renormalised      Eq. 11
    rotvec    x = exp(lgs of log(q)): the exponential-map baseline; breaks where log wraps   Fig. 6
    geodesic  the exact minimiser on the rotations (``geodesic``), a Gauss-Newton solve      Eq. 9

Signs decide which way round a filter goes between two keys, so neighbours in time are first put in
one hemisphere (``signs="nearest"``; frames of weight 0 take no part in it) or, for sparse keys and
turns past half a circle, given the signs of least energy (``signs="min_energy"``). O(T·J). With
``window=`` the components are cross-faded between windows before they are renormalised.

Where smoothed components cancel (‖x‖ < 1e−6, only with λσ so large that samples half a turn apart
are averaged) there is no mean rotation, and the identity is returned.
"""

from typing import Literal, TypeAlias

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmotion._checks import no_module, one_of, static
from jaxmotion._entry import MISSING, finite_clip, one_clip
from jaxmotion._types import ArrayLike, Quaternion, ScalarLike
from jaxmotion.motion import Motion
from jaxmotion.smoothing.chordal import chordal, linear_mean
from jaxmotion.smoothing.components import Signs, from_components, to_components
from jaxmotion.smoothing.design import Design

Method: TypeAlias = Literal["chordal", "rotvec", "geodesic"]


@static("num_frames", "order", "window")
def smooth_quaternions(
    q: Quaternion,
    lam: ScalarLike,
    sigma: ScalarLike,
    *,
    index: ArrayLike | None = None,
    num_frames: int | None = None,
    order: Literal[1, 2] = 2,
    weights: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    scale: Literal["half", "unit"] = "half",
    method: Method = "chordal",
    signs: Signs = "nearest",
    window: int | None = None,
) -> Quaternion:
    """Smooth or resample rotations along axis 0.

    O(T·J). Differentiable as :func:`~jaxmotion.smoothing.lgs`; no gradient passes through the
    signs. Source: Eom et al. 2019, Eq. 11 ("geodesic": Eq. 9).

    **Arguments:** ``q``: f[Nd, ..., 4], unit; ``lam``, ``sigma``: scalars, or broadcasting with q's
    middle axes (per joint), traced or not; ``index``, ``num_frames``, ``order``, ``scale``: as
    :func:`~jaxmotion.smoothing.lgs`; ``weights``: f[Nd] or f[Nd, ...] per joint, 0 for missing
    data, whatever q holds there; ``stiffness``: f[Nf] or f[Nf, ...] per joint, what λ is multiplied
    by at every frame; ``method``: "chordal" (the components are smoothed, and renormalised),
    "rotvec" (rotation vectors are) or "geodesic" (exact on rotations, slower); ``signs``: "nearest"
    hemisphere along time, the "input"'s own, or "min_energy"
    (:func:`~jaxmotion.quaternion.least_energy_signs`; give it no weights but an index, which then
    must not repeat); ``window``: frames solved together, half of them shared with the next window
    and cross-faded (paper: 120; see :func:`~jaxmotion.smoothing.windowed_lgs`; no index); None for
    all at once.
    **Returns:** f[Nf, ..., 4], unit.
    **Raises:** ``ValueError`` for shapes and options that do not fit; as
    :func:`~jaxmotion.smoothing.lgs` and, for "geodesic", :func:`~jaxmotion.smoothing.geodesic`.
    """
    no_module("smooth_quaternions: q", q, "jaxmotion.smoothing.smooth_motion takes motions")
    _check_options(method, signs, weights, stiffness, window)
    q = jnp.asarray(q)
    if q.ndim < 2 or q.shape[-1] != 4:
        raise ValueError(f"smooth_quaternions: q must have shape (T, ..., 4), got {q.shape}")
    weights = None if weights is None else jnp.asarray(weights, q.dtype)
    design = Design(index, num_frames, order, scale)
    if method == "geodesic":
        return _geodesic(q, lam, sigma, design, weights)
    firm = None if stiffness is None else jnp.asarray(stiffness, q.dtype)
    options = {"method": method, "signs": signs, "window": window}
    return chordal(q, lam, sigma, design, weights=weights, stiffness=firm, **options)


def _geodesic(
    q: Quaternion, lam: ScalarLike, sigma: ScalarLike, design: Design, weights: Array | None
) -> Quaternion:
    """The exact smoother, for rotations of any middle axes."""
    from jaxmotion.smoothing.geodesic_regression import geodesic  # optimistix imports slowly

    joints = q.reshape(q.shape[0], -1, 4)
    if weights is not None and weights.ndim > 1:
        weights = jnp.broadcast_to(weights, q.shape[:-1]).reshape(joints.shape[:-1])
    gains = (
        p if np.ndim(p) == 0 else jnp.broadcast_to(jnp.asarray(p), q.shape[1:-1]).ravel()
        for p in (lam, sigma)
    )
    x = geodesic(joints, *gains, weights=weights, **design._asdict()).mean
    return x.reshape(x.shape[0], *q.shape[1:])


@static("num_frames", "order", "window")
def smooth_motion(
    motion: Motion,
    lam: ScalarLike,
    sigma: ScalarLike,
    *,
    index: ArrayLike | None = None,
    num_frames: int | None = None,
    order: Literal[1, 2] = 2,
    weights: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    scale: Literal["half", "unit"] = "half",
    method: Method = "chordal",
    signs: Signs = "nearest",
    window: int | None = None,
    translation_lam: ScalarLike | None = None,
    translation_sigma: ScalarLike | None = None,
) -> Motion:
    """Smooth every joint's rotation, and the translations of the joints that are translated.

    O(T·J). Differentiable as :func:`smooth_quaternions`. Source: Eom et al. 2019, Eq. 11.

    **Arguments:** ``motion``: one clip, T frames, J joints; ``lam``, ``sigma``: scalars or f[J],
    traced or not (σ is in radians for chordal components' half angles and in length units for
    translations; only λσ matters to the mean); ``translation_lam``, ``translation_sigma``: those of
    the translations if they are to differ; ``weights``: f[T] or f[T, J], 0 for missing;
    ``stiffness``: f[Nf] or f[Nf, J]; ``index``, ``num_frames``, ``order``, ``scale``, ``method``,
    ``signs``, ``window``: as :func:`smooth_quaternions`.
    **Returns:** a motion of ``num_frames`` frames and the same frame time.
    **Raises:** ``ValueError`` for what is not one clip; as :func:`smooth_quaternions`.
    """
    one_clip("smooth_motion", motion)
    _check_options(method, signs, weights, stiffness, window)
    motion = finite_clip("smooth_motion", motion, weights=weights, at_run_time=True, hint=MISSING)
    return smoothed_clip(
        motion,
        lam,
        sigma,
        translation_lam=translation_lam,
        translation_sigma=translation_sigma,
        weights=weights,
        stiffness=stiffness,
        design=Design(index, num_frames, order, scale),
        method=method,
        signs=signs,
        window=window,
    )


def smoothed_clip(
    motion: Motion,
    lam: ScalarLike,
    sigma: ScalarLike,
    *,
    translation_lam: ScalarLike | None = None,
    translation_sigma: ScalarLike | None = None,
    weights: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    design: Design,
    method: Method = "chordal",
    signs: Signs = "nearest",
    window: int | None = None,
) -> Motion:
    """:func:`smooth_motion` of a clip that is checked."""
    moving_lam = lam if translation_lam is None else translation_lam
    moving_sigma = sigma if translation_sigma is None else translation_sigma
    given = {"lam": lam, "sigma": sigma}
    given |= {"translation_lam": moving_lam, "translation_sigma": moving_sigma}
    for name, value in given.items():
        _check_gain(name, value, motion.num_joints)
    weights, stiffness = (
        None if x is None else jnp.asarray(x, motion.dtype) for x in (weights, stiffness)
    )
    moved = np.asarray(motion.translated_joints, int)
    y = motion.translations[:, moved]

    def solve(y: Array, turned: np.ndarray) -> Array:
        """``y``: rotations of the joints ``turned``, then translations of those that move."""
        joints = np.concatenate([turned, moved])
        of_y, firm = (
            x if x is None or x.ndim == 1 else x[:, joints, None] for x in (weights, stiffness)
        )
        gains = (
            _of_both(lam, moving_lam, turned, moved),
            _of_both(sigma, moving_sigma, turned, moved),
        )
        return linear_mean(y, *gains, design, window, weights=of_y, stiffness=firm)

    if method == "geodesic":
        rotations = _geodesic(jnp.asarray(motion.rotations), lam, sigma, design, weights)
        y = solve(y, np.zeros(0, int)) if moved.size else y
    else:
        # One solve for both: translations are given a spare component, and stand as more joints.
        joints = motion.num_joints
        x = to_components(motion.rotations, weights, design.index, method, signs)
        spare = jnp.zeros((*y.shape[:2], x.shape[-1] - 3), y.dtype)
        y = jnp.concatenate([x, jnp.concatenate([y, spare], -1)], axis=1)
        x = solve(y, np.arange(joints))
        rotations, y = from_components(x[:, :joints], method), x[:, joints:, :3]
    shape = (rotations.shape[0], motion.num_joints, 3)
    translations = jnp.broadcast_to(motion.translations[:1], shape)
    if moved.size:
        translations = translations.at[:, moved].set(y)
    return motion.with_transforms(translations, rotations)


def geodesic_limit(order: Literal[1, 2], dtype) -> float:
    """The largest λσ (order 1: λσ²) that ``method="geodesic"`` serves: half of what one sample adds
    to the normal equations is lost to rounding, beside 16 (λσ/2)² (order 1: 8 λσ²) of the prior."""
    eps = float(jnp.finfo(dtype).eps)
    return (1 / (8 * eps)) ** 0.5 if order == 2 else 1 / (16 * eps)


def _check_options(
    method: Method,
    signs: Signs,
    weights: ArrayLike | None,
    stiffness: ArrayLike | None,
    window: int | None,
) -> None:
    one_of("method", method, ("chordal", "rotvec", "geodesic"))
    one_of("signs", signs, ("nearest", "input", "min_energy"))
    if signs == "min_energy" and weights is not None:
        raise ValueError("signs='min_energy' with weights; give an index")
    if stiffness is not None and (method == "geodesic" or window is not None):
        raise ValueError("stiffness= is for method='chordal' or 'rotvec' without window=")
    if method == "geodesic" and (window is not None or signs == "min_energy"):
        raise ValueError("method='geodesic' takes no window= and no signs='min_energy'")


def _of_both(
    turning: ScalarLike, moving: ScalarLike, turned: np.ndarray, moved: np.ndarray
) -> ScalarLike:
    """A parameter of some joints' rotations and others' translations, with a component axis."""
    if turning is moving and np.ndim(turning) == 0:
        return turning
    parts = (
        jnp.broadcast_to(jnp.asarray(x)[joints] if np.ndim(x) else jnp.asarray(x), len(joints))
        for x, joints in ((turning, turned), (moving, moved))
    )
    return jnp.concatenate(list(parts))[:, None]


def _check_gain(name: str, value: ScalarLike, joints: int) -> None:
    if np.shape(value) not in ((), (joints,)):
        raise ValueError(
            f"smooth_motion: {name} has shape {np.shape(value)}; expected a scalar or ({joints},), "
            "one a joint"
        )
