"""What public functions ask of the motions they are given: one check each, one wording for all.

    a_motion       that it is a Motion, with any batch axes in front
    one_clip       and no batch: f[T, J, 3], f[T, J, 4]
    finite_clip    and finite numbers, where one that is not would spoil joints and frames beside it
    for_people     a Motion of known numbers, for what tells people of it
    check_result   two clips of one shape, as it was and as it is now, that are known
    skeleton_of    a skeleton, or that of a motion

What works on each frame and joint by itself (kinematics, displacements, measures) takes numbers
that are not finite and gives such numbers back where they were. Finite numbers are looked for where
a look costs nothing: NumPy, O(T·J), of known arrays that lie on no accelerator. Under ``jit`` the
functions that smooth look when the program runs (``at_run_time``); others give NaN for NaN there.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxmotion._checks import at_hand, instance_of, known, require, traced
from jaxmotion._plain import quoted
from jaxmotion._types import AnyArray, ArrayLike, ScalarLike
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton

MISSING = " (give missing samples weight 0)"


def a_motion(caller: str, motion: Any, name: str = "motion") -> None:
    """``ValueError`` unless ``motion`` is one, whose name as an argument of ``caller`` is told."""
    if isinstance(motion, Motion):
        return
    hint = "jaxmotion.load reads files"
    if isinstance(getattr(motion, "motion", None), Motion):
        hint = "its .motion"
    elif isinstance(motion, (list, tuple)):
        hint = "one of them, or jaxmotion.stack makes a batch of clips"
    elif hasattr(motion, "shape"):
        hint = "jaxmotion.Motion(skeleton, translations, rotations, frame_time)"
    instance_of(f"{caller}: {name}", motion, Motion, f"a jaxmotion.Motion ({hint})")


def for_people(caller: str, motion: Any, name: str = "motion") -> None:
    """``ValueError`` unless ``motion`` is one; ``TypeError`` if it is traced, for what is worked
    out by NumPy."""
    a_motion(caller, motion, name)
    if traced(motion):
        raise TypeError(
            f"{caller}: NumPy measures it, which is not for jit, vmap or grad; call it on what "
            "they return. In a loss, jaxmotion.forward_kinematics and ContactPoints.positions say "
            "where joints and feet are"
        )


def one_clip(caller: str, motion: Motion, name: str = "motion", *, on_host: bool = False) -> None:
    """``ValueError`` unless ``motion`` is one, and a single clip; ``on_host``: for functions of
    known values only, which ``jax.vmap`` cannot map."""
    a_motion(caller, motion, name)
    if axes := np.shape(motion.rotations)[:-3]:
        way = "take them one by one" if on_host else "use jax.vmap"
        which = "" if name == "motion" else f" for {name}"
        raise ValueError(f"{caller}: one clip at a time{which}, got batch axes {axes}; {way}")


def finite_clip(
    caller: str,
    motion: Motion,
    name: str = "motion",
    *,
    weights: ArrayLike | None = None,
    length: ScalarLike | None = None,
    at_run_time: bool = False,
    on_host: bool = False,
    hint: str = "",
) -> Motion:
    """The motion, which is :func:`one_clip` of finite numbers: ``ValueError``, or with
    ``at_run_time`` an error at run time for what is traced. Samples of weight 0 (f[T] or f[T, J])
    and frames from ``length`` on do not count. ``hint``: what else to do about them."""
    one_clip(caller, motion, name, on_host=on_host)
    check_weights(caller, motion, weights)
    return finite_numbers(caller, motion, name, weights, length, at_run_time, hint)


def finite_numbers(
    caller: str,
    motion: Motion,
    name: str = "motion",
    weights: ArrayLike | None = None,
    length: ScalarLike | None = None,
    at_run_time: bool = False,
    hint: str = "",
) -> Motion:
    """:func:`finite_clip` of what is one clip, with weights that fit it."""
    if traced(motion.rotations, motion.translations, weights, length):
        if at_run_time:
            arrays = motion.rotations, motion.translations
            odd = [_is_odd(values, weights, length) for values in arrays]
            message = f"{caller}: {name} holds values that are not finite{hint}"
            motion = require(motion, odd[0] | odd[1], message)
        return motion
    count = None if length is None else int(np.asarray(length))
    for field in ("translations", "rotations"):
        values = at_hand(getattr(motion, field))
        if values is None:
            continue
        found = not_finite(motion.skeleton.names, field, values[:count], weights)
        if found:
            raise ValueError(f"{caller}: {name}.{found}; expected finite numbers{hint}")
    return motion


def check_weights(caller: str, motion: Motion, weights: ArrayLike | None) -> None:
    """``ValueError`` for weights that are neither f[T] nor f[T, J]."""
    frames, joints = motion.num_frames, motion.num_joints
    if weights is not None and np.shape(weights) not in ((frames,), (frames, joints)):
        raise ValueError(
            f"{caller}: weights have shape {np.shape(weights)}; expected ({frames},) or "
            f"({frames}, {joints})"
        )


def check_result(caller: str, motion: Motion, result: Motion, *others: Any) -> None:
    """``ValueError`` unless ``motion`` and ``result`` are single clips of one shape; ``TypeError``
    where these, or ``others``, are traced: for lists of what became of a clip."""
    one_clip(caller, motion, on_host=True)
    one_clip(caller, result, "result", on_host=True)
    if motion.rotations.shape != result.rotations.shape:
        raise ValueError(
            f"{caller}: result has rotations of shape {result.rotations.shape}; expected those of "
            f"motion, {motion.rotations.shape}"
        )
    if traced(motion, result, *others):
        raise TypeError(
            f"{caller}: a list cannot be made inside of jit; call it on what jit returns"
        )


def _is_odd(values: AnyArray, weights: ArrayLike | None, length: ScalarLike | None) -> Any:
    odd = ~jnp.isfinite(values)
    if weights is not None:
        w = known(weights)
        odd &= w.reshape(w.shape + (1,) * (odd.ndim - w.ndim)) > 0
    if length is not None:
        odd &= (np.arange(values.shape[0]) < known(length))[:, None, None]
    return jnp.any(odd)


def not_finite(
    names: tuple[str, ...], field: str, values: np.ndarray, weights: ArrayLike | None = None
) -> str:
    """The first joint and frame of f[..., T, J, _] that is not finite, in words, "rotations of
    'Hips' at frame 3 are not finite"; "" if there is none. Samples of weight 0, f[T] or f[T, J], do
    not count."""
    if np.isfinite([values.min(initial=0), values.max(initial=0)]).all():
        return ""
    odd = ~np.isfinite(values).all(axis=-1)
    if weights is not None:
        w = np.asarray(weights)[: len(values)]
        odd &= (w.reshape(w.shape + (1,) * (2 - w.ndim))) > 0
    places = np.argwhere(odd)
    return f"{field} of {place_of(names, places[0])} are not finite" if len(places) else ""


def place_of(names: tuple[str, ...], index: np.ndarray) -> str:
    """(..., frame, joint) in words: "'Hips' at frame 3 of clip 1"."""
    *batch, frame, joint = index.tolist()
    clip = f" of clip {', '.join(map(str, batch))}" if batch else ""
    return f"{quoted(names[joint])} at frame {frame}{clip}"


def skeleton_of(caller: str, skeleton: Any) -> Skeleton:
    """The skeleton, or that of a motion."""
    if isinstance(skeleton, Motion):
        return skeleton.skeleton
    expected = "a jaxmotion.Skeleton (motion.skeleton) or a motion"
    instance_of(f"{caller}: skeleton", skeleton, Skeleton, expected)
    return skeleton
