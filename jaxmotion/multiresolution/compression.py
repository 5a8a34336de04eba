"""Motion compression with a stated error: quantised details of the lazy pyramid.

    code_n = round(d⁽ⁿ⁾/step),  d⁽ⁿ⁾ = m_odd⁽ⁿ⁺¹⁾ ⊖ E m̂⁽ⁿ⁾,   m̂_odd⁽ⁿ⁺¹⁾ = E m̂⁽ⁿ⁾ ⊕ step·code_n

m̂ is what the decoder will have, so an error on a coarse level does not grow on the finer ones, and
every frame is coded once: a translation is off by at most half a step in each component, a rotation
by at most as much as its vector (the exponential map does not expand), ‖error‖ ≤ √3·step/2. The
steps are chosen so that both stay within the tolerances. Details below half a step are dropped: a
smooth motion leaves mostly zeros, which deflate packs. Lee & Shin 2001 name compression as a use of
the representation (§1); the closed loop and the bound are ours.

The base is kept as it is. O(T·J). On the host: not for tracing, no gradient.
"""

import zlib
from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmotion import quaternion
from jaxmotion._checks import static
from jaxmotion._entry import finite_clip
from jaxmotion._file_facts import compiled, file_fact
from jaxmotion._portable import Portable
from jaxmotion._summary import some
from jaxmotion._types import AnyArray
from jaxmotion.displacement import Displacement
from jaxmotion.motion import Motion
from jaxmotion.multiresolution.cascade import ascend, descend
from jaxmotion.multiresolution.levels import finest_level
from jaxmotion.multiresolution.poses import (
    Poses,
    Times,
    Vectors,
    checked_times,
    minus,
    motion_of,
    plus,
    poses_of,
    spacing_of,
    translations_of,
)
from jaxmotion.multiresolution.pyramid import Pyramid, level_count, schedule_of
from jaxmotion.multiresolution.schedule import level_sizes
from jaxmotion.quaternion.parts import together

_LARGEST_CODE = 2**31 - 1


class CompressedMotion(Portable):
    """A base and integers: a motion within stated errors.

    **Fields:** ``base``: Motion, the coarsest level; ``codes``: per level, coarse to fine,
    (translations i[n, P, 3] of the P translated joints, rotations i[n, J, 3]); ``steps``: what one
    unit of each is worth, file unit and radians; ``times``: f[T] if the frames are unevenly spaced,
    else None; ``num_bytes``: of codes (deflated) and base, static; ``ratio``: bytes of the motion's
    translated joints and rotations over that, static; ``translation_error``, ``rotation_error``:
    the largest of any joint and frame, measured, file unit and radians, static; ``frames``: number
    of frames of each level, base first, static; ``frame_time_text``: the motion's, a file fact.
    """

    base: Motion
    codes: tuple[tuple[Int[np.ndarray, "_ moving 3"], Int[np.ndarray, "_ joint 3"]], ...]
    steps: tuple[float, float]
    times: Float[AnyArray, " time"] | None
    num_bytes: int = eqx.field(static=True)
    ratio: float = eqx.field(static=True)
    translation_error: float = eqx.field(static=True)
    rotation_error: float = eqx.field(static=True)
    frames: tuple[int, ...] = eqx.field(static=True)
    frame_time_text: str | None = file_fact()

    def _words(self) -> Iterator[str]:
        yield some(self.frames[-1], "frame")
        yield from self.base.skeleton._figure()
        yield f"{self.num_bytes} bytes, {self.ratio:.3g}× smaller"
        yield f"within {self.rotation_error:.2g} rad and {self.translation_error:.2g}"

    def decompress(self) -> Motion:
        """The motion, within the errors.

        **Returns:** a motion of the original's T frames.
        """
        moving = np.asarray(self.base.translated_joints, int)
        details = []
        for shifts, turns in self.codes:
            u = np.zeros((*turns.shape[:2], 3), self.base.dtype)
            u[:, moving] = self.steps[0] * shifts
            v = (0.5 * self.steps[1] * turns).astype(self.base.dtype)
            details.append(Displacement(jnp.asarray(u), jnp.asarray(v), "body"))
        return Pyramid(
            base=self.base,
            details=tuple(details),
            times=self.times,
            length=None,
            frames=self.frames,
            skips=(0,) * len(details),
            lazy=True,
            frame_time_text=self.frame_time_text,
        ).reconstruct()


@static("levels")
def compress(
    motion: Motion,
    *,
    rotation_tolerance: float | int,
    translation_tolerance: float | int,
    levels: int | None = None,
    times: Times | None = None,
) -> CompressedMotion:
    """Quantise a motion so that no joint is off by more than the tolerances.

    Lee & Shin 2001, §1, name this use; the closed loop and the bound are ours. On the host, not for
    tracing.

    **Arguments:** ``motion``: T ≥ 1 frames, one clip; ``rotation_tolerance``: radians, of each
    joint in its parent's frame; ``translation_tolerance``: file unit, likewise; both positive;
    ``levels``, ``times``: as :func:`build_pyramid`.
    **Returns:** :class:`CompressedMotion`, which tells its size and its errors.
    **Raises:** ``ValueError`` for tolerances that are not positive, or so small that a detail does
    not fit 32 bits, what is not one clip of finite numbers, and ``levels`` or ``times`` as
    :func:`build_pyramid`.
    """
    finite_clip("compress", motion, on_host=True)
    for name, value in (("rotation", rotation_tolerance), ("translation", translation_tolerance)):
        if not value > 0:
            raise ValueError(f"compress: {name}_tolerance={value}; expected a positive number")
    levels = level_count(motion.num_frames, levels, "compress")
    times = checked_times(times, motion.num_frames, motion.dtype, "compress")
    # A hair less, so that rounding in the arithmetic stays within the tolerance too.
    steps = (
        (2 - 1e-3) / np.sqrt(3) * translation_tolerance,
        (2 - 1e-3) / np.sqrt(3) * rotation_tolerance,
    )
    pyramid, codes, decoded = _quantise(
        motion, levels, times, *(jnp.asarray(s, motion.dtype) for s in steps)
    )
    largest = max((float(np.abs(c).max(initial=0)) for pair in codes for c in pair), default=0.0)
    if not largest < _LARGEST_CODE:
        raise ValueError(
            f"compress: rotation_tolerance={rotation_tolerance}, "
            f"translation_tolerance={translation_tolerance}; details of {largest:.3g} steps do not "
            "fit 32 bits"
        )
    packed = tuple((_narrow(u), _narrow(v)) for u, v in codes)
    shift = np.linalg.norm(np.asarray(decoded.translations - motion.translations), axis=-1)
    turn = np.asarray(quaternion.distance(decoded.rotations, motion.rotations))
    size = len(motion.translated_joints) * 3 + motion.num_joints * 4
    item = np.dtype(motion.dtype).itemsize
    deflated = sum(len(zlib.compress(_by_channel(c), 9)) for pair in packed for c in pair)
    num_bytes = deflated + pyramid.base.num_frames * size * item
    return CompressedMotion(
        base=pyramid.base,
        codes=packed,
        steps=(float(steps[0]), float(steps[1])),
        times=times,
        num_bytes=num_bytes,
        ratio=motion.num_frames * size * item / num_bytes,
        translation_error=float(shift.max(initial=0.0)),
        rotation_error=float(turn.max(initial=0.0)),
        frames=pyramid.frames,
        frame_time_text=motion.frame_time_text,
    )


@compiled
def _quantise(
    motion: Motion, levels: int, times: Array | None, shift_step: Array, turn_step: Array
) -> tuple[Pyramid, list[tuple[Array, Array]], Motion]:
    """The pyramid's base, the codes (whole numbers, not integers yet) and what they decode to."""
    moving = motion.translated_joints
    count = jnp.asarray(motion.num_frames, int)
    spacing = spacing_of(times, count)
    fine = finest_level(translations_of(motion), motion.rotations, spacing, count)
    coarse, wanted = descend(fine, levels, True, lambda odd, _: odd)
    pyramid = Pyramid(
        base=motion_of((coarse.translations, coarse.rotations), motion, 2.0**levels),
        details=(),
        times=times,
        length=None,
        frames=tuple(level_sizes(motion.num_frames, levels)[::-1]),
        skips=(0,) * levels,
        lazy=True,
        frame_time_text=motion.frame_time_text,
    )

    unscaled = jnp.ones(motion.num_joints, motion.dtype)

    def coded(expanded: Poses, odd: Poses) -> tuple[Poses, Vectors]:
        u, v = minus(odd, expanded, moving)
        codes = (
            tuple(jnp.round(x / shift_step) for x in u),
            tuple(jnp.round(2 * x / turn_step) for x in v),
        )
        displacement = (
            tuple(shift_step * x for x in codes[0]),
            tuple(0.5 * turn_step * x for x in codes[1]),
        )
        return plus(expanded, displacement, unscaled, moving), codes

    poses, codes = ascend(poses_of(pyramid.base), wanted[::-1], coded, schedule_of(pyramid))
    odd = [size // 2 for size in pyramid.frames[1:]]
    cut = [
        (together(u)[:rows], together(v)[:rows]) for (u, v), rows in zip(codes, odd, strict=True)
    ]
    return pyramid, cut, motion_of(poses, motion, 1.0)


def _narrow(codes: Array) -> np.ndarray:
    """Whole numbers in the smallest integer type that holds them."""
    whole = np.rint(np.asarray(codes, np.float64)).astype(np.int64)
    return whole.astype(np.min_scalar_type(-int(np.abs(whole).max(initial=0)) - 1))


def _by_channel(codes: np.ndarray) -> bytes:
    """Each channel's values together, which deflate packs better."""
    return np.ascontiguousarray(np.moveaxis(codes, 0, -1)).tobytes()
