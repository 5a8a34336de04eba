"""Half the frames and back, on motions: R and E of Lee & Shin 2001, §3.3–3.4.

The formulas stand in :mod:`~jaxmotion.multiresolution.levels`. T frames become T//2 + 1, K frames
become 2K − 1 or, on request, one less; every second of them is one of the given. Differentiable in
the motion and the times. One clip; vmap for several.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmotion._checks import no_module, static
from jaxmotion._entry import finite_clip
from jaxmotion._file_facts import compiled
from jaxmotion.motion import Motion
from jaxmotion.multiresolution.cascade import merged
from jaxmotion.multiresolution.levels import (
    coarser_spacing,
    continued,
    expanded,
    level_of,
    reduced,
)
from jaxmotion.multiresolution.poses import (
    Times,
    checked_times,
    increasing,
    motion_of,
    poses_of,
    spacing_of,
)


def reduce(motion: Motion, *, times: Times | None = None) -> Motion:
    """R: the clip smoothed and at half its rate.

    Lee & Shin 2001, Eq. 13.

    **Arguments:** ``motion``: T frames, one clip; ``times``: f[T], increasing, if unevenly spaced
    (those of the result are :func:`coarser_times`).
    **Returns:** a motion of T//2 + 1 frames, twice the frame time; the last of an even T lies one
    step past the end, where the clip is continued by Eq. 6. One frame stays one.
    **Raises:** ``ValueError`` for what is not one clip of finite numbers, or times that are not one
    a frame or do not increase; at run time for traced times that do not.
    """
    finite_clip("reduce", motion)
    times = checked_times(times, motion.num_frames, motion.dtype, "reduce")
    return _reduce(motion, times)


@static("num_frames")
def expand(motion: Motion, num_frames: int | None = None, *, times: Times | None = None) -> Motion:
    """E: the clip at twice its rate, by subdivision; every second frame is one of the given.

    Lee & Shin 2001, Eq. 15–18.

    **Arguments:** ``motion``: K frames, one clip; ``num_frames``: 2K − 1 (the default) or 2K − 2;
    ``times``: f[num_frames] of the result, increasing, if unevenly spaced.
    **Returns:** a motion of ``num_frames`` frames, half the frame time. One frame stays one.
    **Raises:** ``ValueError`` for what is not one clip of finite numbers, another number of frames,
    or times that are not one a frame or do not increase; at run time for traced times that do not.
    """
    finite_clip("expand", motion)
    whole = 2 * motion.num_frames - 1
    fewest = max(whole - 1, 1)
    frames = whole if num_frames is None else num_frames
    if not fewest <= frames <= whole:
        raise ValueError(
            f"expand: num_frames={num_frames}; {motion.num_frames} frames become {fewest} to "
            f"{whole}"
        )
    return _expand(motion, frames, checked_times(times, frames, motion.dtype, "expand"))


@static("octaves")
def upsample(motion: Motion, octaves: int = 1) -> Motion:
    """2^octaves times the frames a second, by :func:`expand`.

    **Arguments:** ``motion``: T frames, one clip; ``octaves``: 0 or more, static.
    **Returns:** a motion of (T − 1)·2^octaves + 1 frames.
    **Raises:** ``ValueError`` for negative octaves or what is not one clip of finite numbers.
    """
    finite_clip("upsample", motion)
    for _ in range(_octaves("upsample", octaves)):
        motion = expand(motion)
    return motion


@static("octaves")
def downsample(motion: Motion, octaves: int = 1) -> Motion:
    """1/2^octaves of the frames a second, smoothed before each halving, by :func:`reduce`.

    **Arguments:** ``motion``: T frames, one clip; ``octaves``: 0 or more, static.
    **Returns:** a motion; each halving makes T//2 + 1 frames of T.
    **Raises:** ``ValueError`` for negative octaves or what is not one clip of finite numbers.
    """
    finite_clip("downsample", motion)
    for _ in range(_octaves("downsample", octaves)):
        motion = reduce(motion)
    return motion


def coarser_times(times: Times) -> Float[Array, " coarse"]:
    """The times of :func:`reduce`'s frames.

    Every second one, and one past the end of an even number of them. Lee & Shin 2001, §3.4.

    **Arguments:** ``times``: f[T], increasing, any unit.
    **Returns:** f[T//2 + 1].
    **Raises:** ``ValueError`` for times that are not f[T] or do not increase; at run time for
    traced times that do not.
    """
    no_module("coarser_times: times", times)
    times = increasing(times, "coarser_times")
    if len(times) < 2:
        return times
    count = jnp.asarray(len(times), int)
    spacing = coarser_spacing(times[1:] - times[:-1], count)
    return jnp.concatenate([times[:1], times[0] + jnp.cumsum(spacing)])


@compiled
def _reduce(motion: Motion, times: Array | None) -> Motion:
    if motion.num_frames < 2:
        return motion
    count = jnp.asarray(motion.num_frames, int)
    coarse = reduced(level_of(*poses_of(motion), spacing_of(times, count), count))
    return motion_of((coarse.translations, coarse.rotations), motion, 2.0)


@compiled
def _expand(motion: Motion, frames: int, times: Array | None) -> Motion:
    if motion.num_frames < 2:
        return motion
    poses, count = poses_of(motion), jnp.asarray(motion.num_frames, int)
    spacing = fine = None
    if times is not None:
        finer = jnp.asarray(frames, int)
        h = spacing_of(times, finer)
        assert h is not None
        spacing, fine = coarser_spacing(h, finer), continued(h, finer)
    even, odd = expanded(level_of(*poses, spacing, count), fine)
    return motion_of(merged(even, odd, frames), motion, 0.5)


def _octaves(caller: str, octaves: int) -> int:
    if octaves < 0:
        raise ValueError(f"{caller}: octaves={octaves}; expected 0 or more")
    return octaves
