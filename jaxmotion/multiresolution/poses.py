"""Motions by component and back, ⊕ and ⊖ on them, and what entries of this package check."""

from collections.abc import Mapping
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmotion._checks import known, require
from jaxmotion._entry import finite_clip, one_clip
from jaxmotion._types import AnyArray, ScalarLike
from jaxmotion.displacement import Displacement
from jaxmotion.frames.count import step_mask
from jaxmotion.motion import Motion
from jaxmotion.multiresolution.kernels import (
    FrameParts,
    Rotations,
    aligned,
    quaternions_of,
    rotations_of,
    step,
    turned,
)
from jaxmotion.quaternion.parts import (
    Parts,
    added,
    conjugate,
    parts_of,
    rotated,
    scaled,
    subtracted,
    together,
)

Times: TypeAlias = Float[AnyArray, " time"]
Poses: TypeAlias = tuple[Parts, Rotations]
Vectors: TypeAlias = tuple[Parts, Parts]


def minus(poses: Poses, reference: Poses, moving: tuple[int, ...]) -> Vectors:
    """poses ⊖ reference in the body sense (Lee & Shin, Eq. 3); ``moving``: the joints that the
    translations are of."""
    (p, q), (e, r) = poses, reference
    return rotated(conjugate(_of(r, moving)), subtracted(p, e)), step(r, q, 0.5)


def plus(
    poses: Poses, displacement: Vectors, gains: Float[Array, " joint"], moving: tuple[int, ...]
) -> Poses:
    """poses ⊕ gains · displacement in the body sense (Lee & Shin, Eq. 2); ``gains`` f[J]."""
    (p, r), (u, v) = poses, displacement
    u = scaled(gains[np.asarray(moving, int)], u)
    return added(p, rotated(_of(r, moving), u)), turned(r, v, 2 * gains)


def _of(rotations: Rotations, joints: tuple[int, ...]) -> Parts:
    """The quaternions of some joints."""
    everyone = joints == tuple(range(rotations.tangent[0].shape[1]))
    some = slice(None) if everyone else np.asarray(joints, int)
    return quaternions_of(jax.tree.map(lambda x: x[:, some], rotations))


def spacing_of(
    times: Float[AnyArray, " time"] | None, count: Int[Array, ""]
) -> Float[Array, " step"] | None:
    """Time from frame to frame, 1 past the frames that count."""
    if times is None:
        return None
    times = jnp.asarray(times)
    return jnp.where(step_mask(count, len(times)), times[1:] - times[:-1], 1)


def poses_of(motion: Motion) -> Poses:
    """A motion's transforms by component, translations of its translated joints only."""
    return translations_of(motion), rotations_of(motion.rotations)


def translations_of(motion: Motion) -> FrameParts:
    """Translations of the translated joints by component."""
    moving = np.asarray(motion.translated_joints, int)
    return parts_of(jnp.asarray(motion.translations)[:, moving])


def motion_of(poses: Poses, like: Motion, rate: float, text: str | None = None) -> Motion:
    """A motion from transforms by component, its frame time that of ``like`` times ``rate``; joints
    that are not translated stay where they are in ``like``."""
    p, rotations = poses
    frames = rotations.num_frames
    rest = jnp.asarray(like.translations)[:1]
    rest = jnp.broadcast_to(rest, (frames, *rest.shape[1:]))
    return like.replace(
        translations=spread(p, like.translated_joints, rest),
        rotations=together(quaternions_of(aligned(rotations))),
        frame_time=jnp.asarray(rate, like.dtype) * like.frame_time,
        frame_time_text=text,
    )


def spread(
    parts: Parts, joints: tuple[int, ...], rest: Float[Array, "time joint 3"]
) -> Float[Array, "time joint 3"]:
    """Vectors of some joints among those of the ``rest``."""
    some = together(parts)
    return some if some.shape == rest.shape else rest.at[:, np.asarray(joints, int)].set(some)


def displacement_of(parts: Vectors, moving: tuple[int, ...]) -> Displacement:
    """A displacement from vectors by component; joints that are not moving get zero."""
    v = together(parts[1])
    return Displacement(spread(parts[0], moving, jnp.zeros_like(v)), v, "body")


def parts_of_displacement(displacement: Displacement, moving: tuple[int, ...]) -> Vectors:
    """The inverse of :func:`displacement_of`."""
    u = displacement.translations[:, np.asarray(moving, int)]
    return parts_of(u), parts_of(displacement.rotations)


def checked_times(
    times: Times | None, frames: int, dtype, caller: str, length: ScalarLike | None = None
) -> Array | None:
    """Times in the motion's dtype, one a frame, increasing over the ``length`` frames that count
    (None for all): ``ValueError``, or an error at run time for traced ones."""
    if times is None:
        return None
    if np.shape(times) != (frames,):
        raise ValueError(
            f"{caller}: times has shape {np.shape(times)}; expected ({frames},), one a frame"
        )
    return increasing(known(times).astype(dtype), caller, length)


def increasing(times: Times, caller: str, length: ScalarLike | None = None) -> Array:
    """The times of some frames, as :func:`checked_times`."""
    given = known(times)
    if given.ndim != 1:
        raise ValueError(f"{caller}: times has shape {given.shape}; expected (T,), one a frame")
    falling = ~(given[1:] > given[:-1])
    if length is not None:
        count = known(length)
        falling = falling & (np.arange(1, len(given), dtype=count.dtype) < count)
    message = f"{caller}: times must increase from frame to frame"
    return require(jnp.asarray(given), falling.any(), message)


def checked_alike(
    caller: str, clips: Mapping[str, Motion], *, on_host: bool = False, finite: bool = True
) -> tuple[Motion, ...]:
    """The clips, given by the names of their arguments, if each is one clip of the joints and frame
    time of the first, and of finite numbers: ``ValueError``, or an error at run time for traced
    frame times."""
    for name, clip in clips.items():
        check = finite_clip if finite else one_clip
        check(caller, clip, name, on_host=on_host)
    first, *others = clips.values()
    return first, *(_alike(caller, first, other) for other in others)


def _alike(caller: str, first: Motion, second: Motion) -> Motion:
    if second.skeleton.names != first.skeleton.names:
        raise ValueError(
            f"{caller}: the clips have different joints, {list(first.skeleton.names)} and "
            f"{list(second.skeleton.names)}"
        )
    one, other = known(first.frame_time), known(second.frame_time)
    message = f"{caller}: the clips must have one frame time; resample one of them"
    return require(second, abs(one - other) > 1e-4 * one, message, got=f"{one} and {other}")
