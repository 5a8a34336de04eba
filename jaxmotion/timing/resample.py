"""Another frame rate, another number of frames, keys spread into a clip.

    lgs      the linear Gaussian smoother in continuous time (:mod:`jaxmotion.timing.spline`):
             components of signed quaternions, renormalised (Eom et al. 2019, Eq. 11, §5.3)
    cubic    Hermite's cubic on the same components, slopes from the neighbouring frames
    slerp    constant angular speed between frames, the short way; translations straight

What decides the result, and what was chosen:

- *When.* ``fps``: frames at j/fps, all that the clip's duration (T − 1)·frame_time holds; the
  first pose stays the first, and less than a new frame of the end is left over. (Files round their
  rates: an end missed by 1/20 frame counts as met; by half a frame, if the frame time is a rounding
  of 1/n and the end would be met at n, as with 0.033333 for 1/30.) ``num_frames``: the duration is
  kept exactly, the first and last poses are the clip's. ``index``: source frame i belongs at frame
  index[i]. Beyond the outermost poses motion goes on straight.
- *λσ*, ``smoothing``: 0 keeps every pose it is given. Only the product matters. Above 0, waves of
  frequency √(2/λσ)/2π a source frame lose half their height, so lowering the rate to a share r
  of the old one without folding fast jitter into slow wants λσ = 2/(π r)².
- *Signs* decide which way round a turn goes: "min_energy" keeps a turn of 200° from key to key that
  SLERP and "nearest" make −160° (:func:`jaxmotion.quaternion.least_energy_signs`).

Why not Eq. 6 on the new frames, with the data between them as rows (1 − f, f) of A: the chord
between two frames is not the curve, and near f = ½ those rows do not see jitter from frame to
frame. From 24 to 23.976 fps at λσ = 10⁻² a wave of 1 Hz is off by 9·10⁻³ of its height and white
noise of rms 1 comes out at 2, peaks at 13; here it is off by 10⁻⁵, and the noise comes out at 0.9.

O(T·J + N·J). Clips are padded to a few lengths on the way in, unless they are traced, so that one
compilation serves many (:mod:`jaxmotion.frames.padding`).
"""

from typing import Literal, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmotion import quaternion
from jaxmotion._checks import known, one_of, require, static, traced
from jaxmotion._entry import finite_clip
from jaxmotion._numerics import safe_norm
from jaxmotion._program import keepable, one_program
from jaxmotion._room import Room, room_for
from jaxmotion._types import AnyArray, ArrayLike, ScalarLike
from jaxmotion.frames.padding import program_size
from jaxmotion.motion import Motion
from jaxmotion.quaternion.sign_choice import signed
from jaxmotion.timing.spline import local_slopes, read_curve, smoothed_knots

Method: TypeAlias = Literal["lgs", "slerp", "cubic"]
Signs: TypeAlias = Literal["nearest", "input", "min_energy"]

_NEARLY = 0.05  # frames that may be missing at the end
_MOST = 0.5  # of them, where the frame time was rounded
_LOOSEST = 0.01  # share of a frame time that rounding it may have changed


class Reading(NamedTuple):
    """Where frames are read: ``spacing`` f[T − 1] between the poses given, and for every new frame
    the ``interval`` i32[N] it lies in and the ``fraction`` f[N] of the way through it."""

    spacing: AnyArray
    interval: AnyArray
    fraction: AnyArray


@static("num_frames")
def resample(
    motion: Motion,
    *,
    fps: ScalarLike | None = None,
    num_frames: int | None = None,
    index: ArrayLike | None = None,
    method: Method = "lgs",
    smoothing: ScalarLike = 0.0,
    signs: Signs = "min_energy",
) -> Motion:
    """A clip at another frame rate, of another number of frames, or from sparse keys.

    One of ``fps``, ``num_frames`` and ``index`` decides when frames are read. O(T·J + N·J).
    Differentiable in the motion, ``index`` and ``smoothing``. Source: Eom et al. 2019, Eq. 11,
    §5.3.

    **Arguments:**

    - ``motion``: one clip of T frames.
    - ``fps``: the new rate; the module says which frames fit. Under ``jax.jit`` a traced frame time
      does not tell their number: give ``num_frames`` there.
    - ``num_frames``: N; the duration is kept, and the frame time follows.
    - ``index``: f[T], strictly increasing, whole or fractional: where on the new timeline each
      frame belongs. With it ``num_frames`` is the length of that timeline (up to the last key when
      left out), and ``fps`` its rate (the motion's when left out).
    - ``method``: "lgs", "cubic" or "slerp".
    - ``smoothing``: λσ ≥ 0 of "lgs", a scalar or f[J], in frames of the source (of the new timeline
      with ``index``).
    - ``signs``: "min_energy", "nearest" or the "input"'s own (no matter to "slerp").

    **Returns:** a motion of N frames with its frame time.
    **Raises:** ``ValueError`` for what is not one clip of finite numbers, unknown choices,
    arguments that do not fit together, an ``index`` that does not increase or a negative
    ``smoothing``; at run time for the last two when traced.

    **Example:**

        >>> import jaxmotion as jm
        >>> motion = jm.samples.load("walk").motion[:16]
        >>> finer = jm.resample(motion, num_frames=31)
        >>> round(float(motion.fps)), round(float(finer.fps)), len(finer)
        (60, 120, 31)
    """
    finite_clip("resample", motion)
    _check_choice(method, signs, fps, num_frames)
    if index is not None:
        reading = _reading_of_keys(index, motion.num_frames, num_frames, motion.dtype)
        frame_time = motion.frame_time if fps is None else 1.0 / jnp.asarray(fps, motion.dtype)
        return read_motion(
            motion, reading, frame_time, method=method, smoothing=smoothing, signs=signs
        )
    at, frame_time = resampled_frames(motion, fps, num_frames)
    reading = even_reading(at, motion.num_frames, motion.dtype)
    return read_motion(motion, reading, frame_time, method=method, smoothing=smoothing, signs=signs)


def resampled_frames(
    motion: Motion, fps: ScalarLike | None, num_frames: int | None
) -> tuple[Float[AnyArray, " result"], ScalarLike]:
    """The frame of the clip, a fraction too, that each frame of the result shows, and the result's
    frame time; arguments as :func:`resample`."""
    frames = motion.num_frames
    if fps is not None and num_frames is None:
        seconds = _concrete("motion.frame_time", motion.frame_time)
        step = 1.0 / (_concrete("fps", fps) * seconds)
        lost = _rounded_off(np.asarray(motion.frame_time)) / seconds
        num_frames = frames_within((frames - 1) / step, lost * (frames - 1) / step)
        frame_time = 1.0 / _concrete("fps", fps)
    elif num_frames is not None and fps is None:
        step = (frames - 1) / max(num_frames - 1, 1)
        frame_time = motion.frame_time * (step if step > 0 else 1.0)
    else:
        raise ValueError(
            f"resample: fps={fps}, num_frames={num_frames}; expected one of them, or an index"
        )
    return known(step * np.arange(num_frames)), frame_time


def frames_within(duration: float, lost: float = 0.0) -> int:
    """How many frames a clip of ``duration`` frame times has, both ends counted, where ``lost`` of
    them may be due to rounding."""
    return int(np.floor(duration + min(_NEARLY + lost, _MOST))) + 1


def _rounded_off(frame_time: np.ndarray) -> float:
    """Seconds missing from a frame time that is a rounding of 1/n or 1.001/n, n whole; 0 if it is
    none, or of so few digits that it would be one of something."""
    seconds = float(frame_time)
    decimals = len(np.format_float_positional(frame_time.dtype.type(frame_time)).partition(".")[2])
    if 0.5 * 10.0**-decimals > _LOOSEST * seconds:
        return 0.0
    for unit in (1.0, 1.001):
        whole = unit / max(round(unit / seconds), 1)
        if frame_time.dtype.type(round(whole, decimals)) == frame_time:
            return max(whole - seconds, 0.0)
    return 0.0


def even_reading(at: Float[AnyArray, " reading"], frames: int, dtype) -> Reading:
    """Where to read a clip of evenly spaced frames at the positions ``at``, counted in frames."""
    at = known(at)
    xp = jnp if traced(at) else np
    interval = xp.clip(xp.floor(at), 0, max(frames - 2, 0))
    fraction = (at - interval).astype(dtype)
    return Reading(xp.ones(frames - 1, dtype), interval.astype(np.int32), fraction)  # type: ignore


def read_motion(
    motion: Motion,
    reading: Reading,
    frame_time: ScalarLike,
    *,
    method: Method = "lgs",
    smoothing: ScalarLike = 0.0,
    signs: Signs = "min_energy",
    count: Int[Array, ""] | None = None,
) -> Motion:
    """A motion read where ``reading`` says, as a clip of ``frame_time``; what :func:`resample` and
    time warps end in, options as there. ``count``: how many of its frames count, None for all."""
    if np.shape(smoothing) not in ((), (motion.num_joints,)):
        raise ValueError(
            f"smoothing has shape {np.shape(smoothing)}; expected a scalar or "
            f"({motion.num_joints},), one a joint"
        )
    if method != "lgs" and (traced(smoothing) or np.any(known(smoothing) != 0)):
        raise ValueError(f"resample: method={method!r} takes no smoothing=, only 'lgs' does")
    negative = ~(known(smoothing) >= 0).all()
    message = "resample: smoothing must be λσ of 0 or more"
    motion = require(motion, negative, message, got=smoothing)
    smoothing = jnp.asarray(smoothing, motion.dtype)
    frames, wanted = motion.num_frames, reading.fraction.shape[0]
    moved = motion.translated_joints
    room = room_for(motion, reading, smoothing, longest=np.inf)
    given, for_result = room.fill(motion), Room(wanted)
    if room.size:
        for_result = Room(wanted, program_size(wanted))
        reading = _padded(reading, room.size - 1, for_result.size)
    h, interval, fraction = jax.device_put(tuple(reading))
    rotations = given.rotations
    translations, place = _about_place(given.translations, moved)
    if method == "slerp":
        poses = _slerp(translations, rotations, interval, fraction)
    else:
        if smoothing.ndim:
            of_moved = smoothing[np.asarray(moved, np.int32)]
            smoothing = jnp.concatenate([jnp.repeat(of_moved, 3), jnp.repeat(smoothing, 4)])
        length = jnp.asarray(frames, jnp.int32) if count is None else count
        curve = _curve(translations, rotations, h, smoothing, length, method, signs)
        poses = _read(h, *curve, interval, fraction, len(moved))
    new_translations = for_result.cut(_put_back(given.translations, place, poses[0], moved))
    new_rotations = for_result.cut(poses[1])
    rate = {} if frame_time is motion.frame_time else {"frame_time": frame_time}
    return motion.replace(translations=new_translations, rotations=new_rotations, **rate)


@one_program("moved")
def _about_place(
    translations: Float[AnyArray, "time joint 3"], moved: tuple[int, ...]
) -> tuple[Float[Array, "time moved 3"], Float[Array, "1 moved 3"]]:
    """What moves, about the place where it is, and that place: of a clip that is far from the
    origin its first positions, where no other is further from them than half of what they are,
    else 0. Taking it off is exact then (Sterbenz), so that float32 keeps how positions change and
    adding it gives the clip back.
    """
    translations = jnp.asarray(translations)[:, np.asarray(moved, np.int32)]
    start = jax.lax.stop_gradient(translations[:1])
    far = jnp.all(jnp.abs(translations - start) <= jnp.abs(start) / 2, axis=0, keepdims=True)
    place = jnp.where(far, start, 0)
    return translations - place, place


@one_program("moved")
def _put_back(
    translations: Float[Array, "time joint 3"],
    place: Float[Array, "1 moved 3"],
    new: Float[Array, "reading moved 3"],
    moved: tuple[int, ...],
) -> Float[Array, "reading joint 3"]:
    """The first frame in every frame, but for what moves."""
    still = jnp.broadcast_to(translations[:1], (len(new), *translations.shape[1:]))
    return still.at[:, np.asarray(moved, np.int32)].set(place + new)


@keepable
@eqx.filter_jit
def _curve(
    translations: Float[Array, "time moved 3"],
    rotations: Float[Array, "time joint 4"],
    h: Float[Array, " spacing"],
    smoothing: Float[Array, "..."],
    length: Int[Array, ""],
    method: Method,
    signs: Signs,
) -> tuple[Array, Array]:
    """Values and slopes of all channels at the poses given, each f[T, 3 moved + 4 J]."""
    if signs == "min_energy":
        times = jnp.concatenate([jnp.zeros(1, h.dtype), jnp.cumsum(h)])
        rotations = signed(rotations, times, length)
    elif signs == "nearest":
        rotations = quaternion.align_signs(rotations)
    frames = rotations.shape[0]
    y = jnp.concatenate([translations.reshape(frames, -1), rotations.reshape(frames, -1)], axis=1)
    if method == "cubic":
        return y, local_slopes(h, y, length)
    return smoothed_knots(h, y, smoothing, length)


@eqx.filter_jit
def _read(
    h: Array, values: Array, slopes: Array, interval: Array, fraction: Array, moved: int
) -> tuple[Array, Array]:
    """Translations f[N, moved, 3] and rotations f[N, J, 4] of the curve."""
    split = 3 * moved
    # Read apart, as XLA would gather once more for each user of what is read together.
    translations = read_curve(h, values[:, :split], slopes[:, :split], interval, fraction)
    q = read_curve(h, values[:, split:], slopes[:, split:], interval, fraction)
    q = q.reshape(q.shape[0], -1, 4)
    norm = safe_norm(q, keepdims=True)
    cancelled = norm < 1e-6
    unit = jnp.where(
        cancelled, quaternion.identity(dtype=q.dtype), q / jnp.where(cancelled, 1, norm)
    )
    return translations.reshape(q.shape[0], moved, 3), unit


@eqx.filter_jit
def _slerp(
    translations: Array, rotations: Array, interval: Array, fraction: Array
) -> tuple[Array, Array]:
    after = jnp.minimum(interval + 1, rotations.shape[0] - 1)
    t = fraction[:, None]
    start, end = translations[interval], translations[after]
    moved = start + t[..., None] * (end - start)
    return moved, quaternion.slerp(rotations[interval], rotations[after], t)


def _reading_of_keys(index: ArrayLike, keys: int, num_frames: int | None, dtype) -> Reading:
    """Where to read poses that stand at the frames ``index``."""
    if num_frames is None and traced(index):
        raise ValueError("resample: num_frames is needed when index is traced")
    xp = jnp if traced(index) else np
    knots = jnp.asarray(index, dtype) if traced(index) else np.asarray(index, np.float64)
    if knots.shape != (keys,):
        raise ValueError(
            f"resample: index has shape {knots.shape}; expected ({keys},), one a frame"
        )
    bad = ~(xp.all(xp.diff(knots) > 0) & xp.all(xp.isfinite(knots)))
    knots = require(knots, bad, "resample: index must increase strictly")
    count = frames_within(float(knots[-1])) if num_frames is None else num_frames
    at = xp.arange(count, dtype=knots.dtype)
    interval = xp.clip(xp.searchsorted(knots, at, side="right") - 1, 0, max(keys - 2, 0))
    spacing = xp.diff(knots)
    width = spacing[interval] if keys > 1 else 1
    fraction = (at - knots[interval]) / width
    parts = spacing.astype(dtype), interval.astype(np.int32), fraction.astype(dtype)
    return Reading(*parts)  # type: ignore


def _padded(reading: Reading, intervals: int, readings: int) -> Reading:
    h, interval, fraction = (np.asarray(part) for part in reading)
    more = (0, readings - fraction.shape[0])
    h = np.pad(h, (0, intervals - h.shape[0]), constant_values=1)
    return Reading(h, np.pad(interval, more), np.pad(fraction, more))  # type: ignore


def _check_choice(method: str, signs: str, fps, num_frames: int | None) -> None:
    one_of("resample: method", method, ("lgs", "slerp", "cubic"))
    one_of("resample: signs", signs, ("nearest", "input", "min_energy"))
    if num_frames is not None and num_frames < 1:
        raise ValueError(f"resample: num_frames={num_frames}; expected at least 1")
    if fps is not None and not traced(fps) and not 0 < float(fps) < np.inf:
        raise ValueError(f"resample: fps={fps}; expected a rate above 0")


def _concrete(name: str, value: ScalarLike) -> float:
    if traced(value):
        raise ValueError(
            f"resample: {name} is traced and does not tell the number of frames; give num_frames"
        )
    return float(value)
