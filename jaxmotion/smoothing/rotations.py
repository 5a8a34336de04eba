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

from functools import partial
from typing import Literal, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmotion._checks import known, no_module, one_of, static
from jaxmotion._entry import MISSING, finite_clip, one_clip
from jaxmotion._program import one_program
from jaxmotion._types import AnyArray, ArrayLike, Quaternion, ScalarLike
from jaxmotion.motion import Motion
from jaxmotion.smoothing.chordal import chordal, linear_mean
from jaxmotion.smoothing.components import Coordinates, Signs, from_components, to_components
from jaxmotion.smoothing.design import Design, frame_count
from jaxmotion.smoothing.lgs import check_positive, checked_stiffness

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
    and cross-faded (paper: 120; see :func:`~jaxmotion.smoothing.windowed_lgs`; no index, no
    stiffness); None for all at once.
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
    if stiffness is not None:
        frames = frame_count(index, num_frames, q.shape[0])
        stiffness = checked_stiffness(stiffness, frames, q.shape[1:-1], q.dtype)
    if method == "geodesic":
        return _geodesic(q, lam, sigma, design, weights, stiffness)
    options = {"method": method, "signs": signs, "window": window}
    return chordal(q, lam, sigma, design, weights=weights, stiffness=stiffness, **options)


def _geodesic(
    q: Quaternion,
    lam: ScalarLike,
    sigma: ScalarLike,
    design: Design,
    weights: Array | None,
    stiffness: Array | None,
) -> Quaternion:
    """The exact smoother, for rotations of any middle axes."""
    from jaxmotion.smoothing.geodesic_regression import geodesic  # optimistix imports slowly

    def in_a_row(value, lead):
        """A parameter's middle axes as one of joints; ``lead``: how many axes are before them."""
        if value is None or np.ndim(value) <= lead:
            return value
        value = jnp.asarray(value)
        before = value.shape[:lead]
        return jnp.broadcast_to(value, before + q.shape[1:-1]).reshape(*before, -1)

    gains = in_a_row(lam, 0), in_a_row(sigma, 0)
    by_frame = {"weights": in_a_row(weights, 1), "stiffness": in_a_row(stiffness, 1)}
    x = geodesic(q.reshape(q.shape[0], -1, 4), *gains, **by_frame, **design._asdict()).mean
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
    translation_stiffness: ArrayLike | None = None,
) -> Motion:
    """Smooth every joint's rotation, and the translations of the joints that are translated.

    O(T·J). Differentiable as :func:`smooth_quaternions`. Source: Eom et al. 2019, Eq. 11.

    **Arguments:** ``motion``: one clip, T frames, J joints; ``lam``, ``sigma``: scalars or f[J],
    traced or not (σ is in radians for chordal components' half angles and in length units for
    translations; only λσ matters to the mean); ``weights``: f[T] or f[T, J], 0 for missing;
    ``stiffness``: f[Nf] or f[Nf, J]; ``translation_lam``, ``translation_sigma``,
    ``translation_stiffness``: those of the translations if they are to differ; ``index``,
    ``num_frames``, ``order``, ``scale``, ``method``, ``signs``, ``window``: as
    :func:`smooth_quaternions`.
    **Returns:** a motion of ``num_frames`` frames and the same frame time.
    **Raises:** ``ValueError`` for what is not one clip; as :func:`smooth_quaternions`.
    """
    one_clip("smooth_motion", motion)
    firm = stiffness if translation_stiffness is None else translation_stiffness
    _check_options(method, signs, weights, firm, window)
    motion = finite_clip("smooth_motion", motion, weights=weights, at_run_time=True, hint=MISSING)
    return smoothed_clip(
        motion,
        lam,
        sigma,
        translation_lam=translation_lam,
        translation_sigma=translation_sigma,
        weights=weights,
        stiffness=stiffness,
        translation_stiffness=translation_stiffness,
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
    translation_stiffness: ArrayLike | None = None,
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
        _check_shape(name, value, (), motion.num_joints)
    firm = _stiffnesses(stiffness, translation_stiffness, design, motion)
    weights = None if weights is None else jnp.asarray(weights, motion.dtype)
    still = motion.translations
    joints, moves = motion.num_joints, motion.translated_joints
    moved = np.asarray(moves, int)

    def solve(y: Array, turned: np.ndarray) -> Array:
        """``y``: rotations of the joints ``turned``, then translations of those that move."""
        by_frame = partial(_of_both, turned=turned, moved=moved, lead=1)
        return linear_mean(
            y,
            _of_both(lam, moving_lam, turned, moved),
            _of_both(sigma, moving_sigma, turned, moved),
            design,
            window,
            weights=None if weights is None else by_frame(weights, weights),
            stiffness=None if firm is None else by_frame(*firm),
        )

    if method == "geodesic":
        turning = None if firm is None else firm[0]
        rotations = _geodesic(jnp.asarray(motion.rotations), lam, sigma, design, weights, turning)
        y = solve(still[:, moved], np.zeros(0, int)) if moved.size else None
        return motion.with_transforms(_moved(still, y, rotations.shape[0], moves), rotations)
    index = None if design.index is None else known(design.index)
    x = _side_by_side(motion.rotations, still, weights, index, moves, method, signs)
    translations, rotations = _apart(solve(x, np.arange(joints)), still, moves, method)
    return motion.with_transforms(translations, rotations)


@one_program("moved", "method", "signs")
def _side_by_side(
    rotations: AnyArray,
    translations: AnyArray,
    weights: Array | None,
    index: AnyArray | None,
    moved: tuple[int, ...],
    method: Coordinates,
    signs: Signs,
) -> Array:
    """One signal for one solve: translations are given a spare component, and stand as more
    joints."""
    x = to_components(rotations, weights, index, method, signs)
    y = translations[:, np.asarray(moved, int)]
    spare = jnp.zeros((*y.shape[:2], x.shape[-1] - 3), y.dtype)
    return jnp.concatenate([x, jnp.concatenate([y, spare], -1)], axis=1)


@one_program("moved", "method")
def _apart(
    x: Array, translations: AnyArray, moved: tuple[int, ...], method: Coordinates
) -> tuple[Array, Array]:
    """All translations, and the rotations, of what is solved for."""
    joints = translations.shape[1]
    y = x[:, joints:, :3] if moved else None
    return _moved(translations, y, x.shape[0], moved), from_components(x[:, :joints], method)


@one_program("frames", "moved")
def _moved(translations: AnyArray, y: Array | None, frames: int, moved: tuple[int, ...]) -> Array:
    """The first frame's translations in all, and ``y`` for the joints that are moved."""
    found = jnp.broadcast_to(translations[:1], (frames, *translations.shape[1:]))
    return found if y is None else found.at[:, np.asarray(moved, int)].set(y)


def geodesic_limit(order: Literal[1, 2], dtype) -> float:
    """The largest λσ (order 1: λσ²) that ``method="geodesic"`` serves: half of what one sample adds
    to the normal equations is lost to rounding, beside 16 (λσ/2)² (order 1: 8 λσ²) of the prior.
    With a stiffness, λ is that of the stiffest frame."""
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
    if stiffness is not None and window is not None:
        raise ValueError("stiffness= takes no window=")
    if method == "geodesic" and (window is not None or signs == "min_energy"):
        raise ValueError("method='geodesic' takes no window= and no signs='min_energy'")


def _stiffnesses(
    turning: ArrayLike | None, moving: ArrayLike | None, design: Design, motion: Motion
) -> tuple[Array, Array] | None:
    """That of the rotations and that of the translations, checked; the same array twice where
    translations have none of their own."""
    if turning is None and moving is None:
        return None
    frames = frame_count(design.index, design.num_frames, motion.num_frames)
    turning = np.ones(frames) if turning is None else turning
    for name, value in {"stiffness": turning, "translation_stiffness": moving}.items():
        if value is not None:
            _check_shape(name, value, (frames,), motion.num_joints)
            check_positive(f"smooth_motion: {name}", value)
    turning = jnp.asarray(turning, motion.dtype)
    return turning, turning if moving is None else jnp.asarray(moving, motion.dtype)


def _of_both(
    turning: ScalarLike, moving: ScalarLike, turned: np.ndarray, moved: np.ndarray, lead: int = 0
) -> ScalarLike:
    """A parameter of some joints' rotations and others' translations, with a component axis;
    ``lead``: how many axes it has before that of the joints, which it may lack."""
    if turning is moving and np.ndim(turning) == lead:
        return turning

    # What NumPy does, it does without a program.
    by = jnp if isinstance(turning, jax.Array) or isinstance(moving, jax.Array) else np

    def part(x, joints):
        x = by.asarray(x)
        x = x[..., joints] if x.ndim > lead else x[..., None]
        return by.broadcast_to(x, (*x.shape[:-1], len(joints)))

    return by.concatenate([part(turning, turned), part(moving, moved)], axis=-1)[..., None]


def _check_shape(name: str, value: ArrayLike, lead: tuple[int, ...], joints: int) -> None:
    """``ValueError`` unless ``value`` has the axes ``lead``, and then one of joints or none."""
    if np.shape(value) not in (lead, (*lead, joints)):
        raise ValueError(
            f"smooth_motion: {name} has shape {np.shape(value)}; expected {lead or 'a scalar'} or "
            f"{(*lead, joints)}, one a joint"
        )
