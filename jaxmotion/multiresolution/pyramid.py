"""Multiresolution analysis (Lee & Shin 2001, §3, Eq. 11–12): a coarse base and N layers of detail.

    analysis    m⁽ⁿ⁾ = R m⁽ⁿ⁺¹⁾      d⁽ⁿ⁾ = m⁽ⁿ⁺¹⁾ ⊖ E m⁽ⁿ⁾        n = N − 1, …, 0
    synthesis   m⁽ⁿ⁺¹⁾ = E m⁽ⁿ⁾ ⊕ d⁽ⁿ⁾

R smooths and halves, E subdivides (:mod:`~jaxmotion.multiresolution.levels`), ⊕ and ⊖ are in the
body sense of :mod:`jaxmotion.displacement`: details are half-angle rotation vectors and
translations, both in the joint's own frame. A rigid motion of the whole clip therefore moves the
base alike and leaves the details as they are, whatever the coordinates. Synthesis undoes analysis
to rounding.

Sizes: T frames become T//2 + 1, level by level; T = 2ᴺ(k − 1) + 1 gives a base of exactly k frames,
other T are continued by at most one frame a level and cropped again on the way back. ``lazy=True``
skips the smoothing (the paper's lazy form): even frames have no detail, so only odd ones are
stored, T frames and details in all instead of 2T.

O(T·J), N static, one clip (vmap for several), differentiable in motion, times and details. Sharp
bit: compiling costs seven levels at most, not N: levels of more than 150 frames are compiled each
for its own size, up to six, all coarser ones run in one loop over padded arrays.
"""

from collections.abc import Iterator
from functools import partial

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmotion._checks import counted, instance_of, static
from jaxmotion._entry import finite_clip, one_clip
from jaxmotion._file_facts import compiled, file_fact
from jaxmotion._portable import Portable
from jaxmotion._room import Room, room_for
from jaxmotion._summary import batched, kept_as, numbers, some, timing
from jaxmotion._types import AnyArray, ScalarLike
from jaxmotion.displacement import Displacement
from jaxmotion.motion import Motion
from jaxmotion.multiresolution.cascade import ascend, descend
from jaxmotion.multiresolution.levels import finest_level
from jaxmotion.multiresolution.poses import (
    Poses,
    Times,
    Vectors,
    checked_times,
    displacement_of,
    minus,
    motion_of,
    parts_of_displacement,
    plus,
    poses_of,
    spacing_of,
    translations_of,
)
from jaxmotion.multiresolution.schedule import (
    Schedule,
    level_counts,
    level_sizes,
    level_spacings,
)

_SMALLEST_BASE = 4  # frames that a cubic needs
DEEPEST = 6  # default levels: 64 frames between those of the base


class Pyramid(Portable):
    """A motion as base and details.

    **Fields:** ``base``: Motion of k frames, 2ᴺ times the frame time; ``details``: N Displacements
    in the body sense, coarse to fine, each of its level's frames (lazy: of the odd ones);
    ``times``: f[T] of the finest level if unevenly spaced, else None; ``length``: i[], how many
    frames of the finest level count, None for all; ``frames``: number of frames of each level, base
    first, N + 1 numbers, static; ``skips``: how many frames each expansion drops at its front, N
    numbers, static, 0 or (in clips that were continued at their start) 1; ``lazy``: whether nothing
    was smoothed between levels, static; ``frame_time_text``: the motion's, a file fact.
    """

    base: Motion
    details: tuple[Displacement, ...]
    times: Float[AnyArray, "*batch time"] | None
    length: Int[AnyArray, "*batch"] | None
    frames: tuple[int, ...] = eqx.field(static=True)
    skips: tuple[int, ...] = eqx.field(static=True)
    lazy: bool = eqx.field(static=True)
    frame_time_text: str | None = file_fact()

    def _words(self) -> Iterator[str]:
        *batch, coarse, _, _ = self.base.rotations.shape
        yield batched(batch, "clip", some(self.frames[-1], "frame"))
        seconds = numbers(self.base.frame_time)
        if self.times is None and seconds is not None:
            yield from timing(self.frames[-1], seconds / 2**self.levels)
        yield f"{some(self.levels, 'level')} over a base of {coarse}"
        yield from self.base.skeleton._figure()
        yield kept_as(self.base.rotations)

    @property
    def levels(self) -> int:
        """N, the number of layers of detail."""
        return len(self.details)

    def reconstruct(self) -> Motion:
        """The motion that was taken apart, to rounding; its quaternions' signs are aligned.

        **Returns:** a motion of T frames.
        """
        return synthesize(self, jnp.ones((self.levels, self.base.num_joints), self.base.dtype))


@static("levels", "lazy")
def build_pyramid(
    motion: Motion,
    levels: int | None = None,
    *,
    times: Times | None = None,
    lazy: bool = False,
    length: ScalarLike | None = None,
) -> Pyramid:
    """Take a motion apart into a coarse base and N layers of detail.

    Lee & Shin 2001, Eq. 11–12; uneven times §3.4.

    **Arguments:** ``motion``: T ≥ 1 frames, one clip; ``levels``: N, by default as many as leave a
    base of at least 4 frames, but no more than 6; ``times``: f[T], increasing, in any unit, if the
    frames are not evenly spaced; ``lazy``: do not smooth between levels, no extra storage;
    ``length``: how many frames count, traced or not, when the rest is padding (any rotations; what
    comes out there means nothing), so that one compiled function serves clips of many lengths.
    **Returns:** :class:`Pyramid`.
    **Raises:** ``ValueError`` for what is not one clip of finite numbers, levels that the frames do
    not allow, times that are not one a frame or do not increase, or a length outside 1 to T; at run
    time for such times or such a length that are traced.
    """
    one_clip("build_pyramid", motion)
    levels = level_count(motion.num_frames, levels, "build_pyramid")
    count = None
    if length is not None:
        count, motion = counted("build_pyramid: length", length, motion.num_frames, motion)
        count = count.astype(int)
    finite_clip("build_pyramid", motion, length=length)
    times = checked_times(times, motion.num_frames, motion.dtype, "build_pyramid", length)
    if length is not None or times is not None:
        return _build(motion, levels, times, lazy, count)
    room = room_for(motion)
    count = None if room.length is None else jnp.asarray(room.length)
    pyramid = _build(room.fill(motion), levels, None, lazy, count)
    return _cut(pyramid, level_sizes(motion.num_frames, levels)[::-1]) if room.size else pyramid


def _cut(pyramid: Pyramid, frames: list[int]) -> Pyramid:
    """The pyramid of the frames that count: so many of each level, base first."""
    stored = [size // 2 if pyramid.lazy else size for size in frames[1:]]
    details = [
        Room(size, len(detail.rotations)).cut(detail)
        for detail, size in zip(pyramid.details, stored, strict=True)
    ]
    base = Room(frames[0], len(pyramid.base)).cut(pyramid.base)
    return Pyramid(
        base=base,
        details=tuple(details),
        times=None,
        length=None,
        frames=tuple(frames),
        skips=pyramid.skips,
        lazy=pyramid.lazy,
        frame_time_text=pyramid.frame_time_text,
    )


def check_pyramid(pyramid: Pyramid, caller: str) -> None:
    """``ValueError`` unless it is one, of one clip."""
    expected = "a Pyramid (jaxmotion.multiresolution.build_pyramid makes them)"
    instance_of(f"{caller}: pyramid", pyramid, Pyramid, expected)
    one_clip(caller, pyramid.base, "pyramid.base")


def level_count(frames: int, levels: int | None, caller: str) -> int:
    """The number of levels for a clip: the default, or the one asked for if it is possible."""
    sizes = level_sizes(frames)
    if levels is None:
        return min(DEEPEST, sum(size >= _SMALLEST_BASE for size in sizes[1:]))
    if not 0 <= levels < len(sizes):
        raise ValueError(
            f"{caller}: levels={levels}; {frames} frames can be halved 0 to {len(sizes) - 1} times"
        )
    return levels


@compiled
def _build(
    motion: Motion, levels: int, times: Array | None, lazy: bool, length: Array | None
) -> Pyramid:
    count = jnp.asarray(motion.num_frames, int) if length is None else length
    spacing = spacing_of(times, count)
    fine = finest_level(translations_of(motion), motion.rotations, spacing, count)
    moving = motion.translated_joints
    coarse, details = descend(fine, levels, lazy, partial(minus, moving=moving))
    return Pyramid(
        base=motion_of((coarse.translations, coarse.rotations), motion, 2.0**levels),
        details=tuple(displacement_of(d, moving) for d in details[::-1]),
        times=times,
        length=length,
        frames=tuple(level_sizes(motion.num_frames, levels)[::-1]),
        skips=(0,) * levels,
        lazy=lazy,
        frame_time_text=motion.frame_time_text,
    )


@compiled
def synthesize(pyramid: Pyramid, gains: Float[Array, "level joint"]) -> Motion:
    """Base ⊕ details, each level's and joint's times its gain."""
    moving = pyramid.base.translated_joints
    details = [parts_of_displacement(d, moving) for d in pyramid.details]

    def with_detail(poses: Poses, detail: tuple[Vectors, Array]) -> tuple[Poses, None]:
        displacement, gain = detail
        return plus(poses, displacement, gain, moving), None

    data = list(zip(details, gains, strict=True))
    poses, _ = ascend(poses_of(pyramid.base), data, with_detail, schedule_of(pyramid))
    return motion_of(poses, pyramid.base, 0.5**pyramid.levels, pyramid.frame_time_text)


def schedule_of(pyramid: Pyramid) -> Schedule:
    """How many frames each level has, how many count and how far apart they are."""
    frames, length = pyramid.frames, pyramid.length
    counts = level_counts(frames, None if length is None else jnp.asarray(length))
    spacings = level_spacings(spacing_of(pyramid.times, counts[-1]), counts)
    return Schedule(frames, pyramid.skips, counts, spacings, pyramid.lazy)
