"""Another timing for a motion: slower where much happens, through given times, from rest to rest.

    result frame j  ──ease──▶  warped time  ──warp⁻¹──▶  source time  ──smoother──▶  pose

    warp   u(i) = i + a (T − 1) Σ_{k<i} s_k / Σ_k s_k    s_k = Σ_joints θ_k + Σ_moved ‖Δp_k‖ / L

θ_k: angle (radians) a joint turns from frame k to k + 1, Δp_k: its translation's change, L: the
mean bone, which makes a length an angle; s is averaged over neighbours within about 0.1 s. a:
``amount``, the share by which the clip grows. All maps increase (:mod:`jaxmotion.timing.time_maps`)
and poses are read from the smoother in continuous time (:mod:`jaxmotion.timing.resample`). Layers
then run on the retimed signal, because stretched noise is slower noise. Source: Eom et al. 2019,
§5.3 and Fig. 9, which do not say how frames are handed out.

How long it gets: (1 + a) times the clip, plus half of what is eased; with ``num_frames`` the whole
result is stretched to that, so ``num_frames=len(motion)`` keeps the duration. The frame time stays.
With ``keep_contacts`` what touched in the source touches when its frame is shown. O(T·J).
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmotion import quaternion, spacetime
from jaxmotion._checks import known, require, static, traced
from jaxmotion._entry import finite_clip
from jaxmotion._numerics import safe_norm
from jaxmotion._program import keepable
from jaxmotion._types import AnyArray, ArrayLike, ScalarLike
from jaxmotion.contacts import Contacts, detect
from jaxmotion.frames.padding import in_buckets, program_size
from jaxmotion.layers.synthesize import stylize
from jaxmotion.motion import Motion
from jaxmotion.timing.resample import Method, Signs, even_reading, frames_within, read_motion
from jaxmotion.timing.time_maps import eased, read_backwards, slowed_by_speed

_MEMORY = 0.1  # seconds over which speed is averaged
_NEARLY = 1e-3  # frames; times are written with few digits


@static("num_frames", "keep_contacts")
def time_warp(
    motion: Motion,
    *,
    amount: ScalarLike | None = None,
    pairs: ArrayLike | None = None,
    ease: Sequence[ScalarLike] = (0.0, 0.0),
    num_frames: int | None = None,
    method: Method = "lgs",
    smoothing: ScalarLike = 0.0,
    signs: Signs = "min_energy",
    alpha: ArrayLike | None = None,
    residual: ScalarLike = 1.0,
    keep_contacts: Contacts | bool = False,
) -> Motion:
    """A clip with another timing.

    O(T·J). Differentiable in motion, ``amount``, ``pairs`` and ``ease``. Source: Eom et al. §5.3.

    **Arguments:**

    - ``motion``: one clip of T ≥ 1 frames.
    - ``amount``: a ≥ 0, slow down where displacements are large; 0.25 makes the clip a quarter
      longer, (N − 1)/(T − 1) − 1 makes it N frames; 0 (None) changes nothing.
    - ``pairs``: instead, f[K, 2] of (time in the source, time in the result), seconds, both
      strictly increasing: what happens then happens at that time, and speed never jumps. The clip
      starts at 0, and after the last pair takes the time it takes.
    - ``ease``: seconds of the result over which it leaves rest, and comes to rest.
    - ``num_frames``: of the result, which is stretched to them; by default those of (1 + a) times
      the duration and half of what is eased; needed where that is traced.
    - ``method``, ``smoothing``, ``signs``: as :func:`jaxmotion.resample`.
    - ``alpha``, ``residual``: gains of style and noise of the retimed signal, as
      :func:`jaxmotion.stylize`; without them it is left as it is.
    - ``keep_contacts``: True restores what touches in ``motion`` in the result
      (:func:`jaxmotion.spacetime.keep_contacts`); or contacts of ``motion`` (under ``jit`` only
      these).

    **Returns:** a motion of the same frame time.
    **Raises:** ``ValueError`` for what is not one finite clip, arguments that do not fit together,
    times that fall, a negative ``amount`` or ``ease``, a traced duration; at run time if traced.

    **Example:**

        >>> import jaxmotion as jm
        >>> slower = jm.time_warp(jm.samples.load("walk").motion[:16], amount=1.0)
        >>> len(slower)
        31
    """
    finite_clip("time_warp", motion)
    at = warped_frames(motion, amount=amount, pairs=pairs, ease=ease, num_frames=num_frames)
    reading = even_reading(at, motion.num_frames, motion.dtype)
    result = retimed = read_motion(
        motion, reading, motion.frame_time, method=method, smoothing=smoothing, signs=signs
    )
    if alpha is not None or not isinstance(residual, (int, float)) or residual != 1:
        result = stylize(retimed, 1.0 if alpha is None else alpha, residual=residual)
    if keep_contacts is False:
        return result
    contacts = detect(motion) if keep_contacts is True else keep_contacts
    return spacetime.keep_contacts(result, original=retimed, contacts=contacts.at_frames(at))


def warped_frames(
    motion: Motion,
    *,
    amount: ScalarLike | None = None,
    pairs: ArrayLike | None = None,
    ease: Sequence[ScalarLike] = (0.0, 0.0),
    num_frames: int | None = None,
) -> Float[AnyArray, " result"]:
    """The frame of the clip, a fraction too, that each frame of the result shows; arguments as
    :func:`time_warp`, which they are checked for."""
    if amount is not None and pairs is not None:
        raise ValueError("time_warp: amount and pairs are both given; expected one of them")
    frames, dtype = motion.num_frames, motion.dtype
    if pairs is not None:
        knots, places = _knots_of_pairs(pairs, motion)
        duration = knots[-1]
    else:
        amount = _checked_amount(0.0 if amount is None else amount, dtype)
        knots = _landing(motion, amount)
        places = jnp.arange(knots.shape[0], dtype=dtype)
        duration = (1 + amount) * (frames - 1)
    ease_in, ease_out = _ease_in_frames(ease, jnp.asarray(motion.frame_time), duration)
    total = duration + (ease_in + ease_out) / 2
    if num_frames is None:
        num_frames, step = frames_within(_concrete(total)), 1.0
    elif num_frames < 1:
        raise ValueError(f"time_warp: num_frames={num_frames}; expected at least 1")
    else:
        step = total / max(num_frames - 1, 1)
    step = jnp.asarray(step, dtype)
    count = program_size(num_frames)
    at = _source_times(knots, places, step, ease_in, ease_out, duration, count)
    return known(at)[:num_frames]


@keepable
@eqx.filter_jit
def _source_times(
    knots: Float[Array, " knot"],
    places: Float[Array, " knot"],
    step: Float[Array, ""],
    ease_in: Float[Array, ""],
    ease_out: Float[Array, ""],
    duration: Float[Array, ""],
    count: int,
) -> Float[Array, " frame"]:
    at = step * jnp.arange(count, dtype=places.dtype)
    return read_backwards(knots, places, eased(at, ease_in, ease_out, duration))


def _landing(motion: Motion, amount: Array) -> Float[Array, " frame"]:
    """u, where the frames of the clip (padded, unless it is traced) land when it is slowed."""
    translations, rotations = in_buckets(motion.translations, motion.rotations)
    moved = np.asarray(motion.translated_joints, np.int32)
    return _slowed(
        translations[:, moved],
        rotations,
        jnp.asarray(motion.skeleton.offsets, motion.dtype),
        amount,
        _MEMORY / motion.frame_time,
        jnp.asarray(motion.num_frames, jnp.int32),
    )


@jax.jit
def _slowed(
    translations: Float[Array, "time moved 3"],
    rotations: Float[Array, "time joint 4"],
    offsets: Float[Array, "joint 3"],
    amount: Float[Array, ""],
    memory: Float[Array, ""],
    length: Int[Array, ""],
) -> Float[Array, " time"]:
    turns = quaternion.distance(rotations[:-1], rotations[1:])
    moves = safe_norm(jnp.diff(translations, axis=0))
    bone = jnp.sum(safe_norm(offsets[1:])) / max(offsets.shape[0] - 1, 1)
    speed = jnp.sum(turns, axis=1) + jnp.sum(moves, axis=1) / jnp.where(bone > 0, bone, 1)
    return slowed_by_speed(speed, amount, memory, length)


def _knots_of_pairs(pairs: ArrayLike, motion: Motion) -> tuple[Array, Array]:
    """Warped and source times of the pairs, the start and the end, in frames."""
    unknown = traced(pairs, motion.frame_time)
    xp, end = (jnp if unknown else np), motion.num_frames - 1
    given = xp.asarray(pairs, motion.dtype if unknown else np.float64)
    if given.ndim != 2 or given.shape[1] != 2 or not given.shape[0]:
        raise ValueError(
            f"time_warp: pairs have shape {given.shape}; expected (K, 2), K at least 1"
        )
    frame_time = motion.frame_time if unknown else float(motion.frame_time)
    given = given / frame_time
    if not unknown and given[0, 0] == given[0, 1] == 0:
        given = given[1:]
    knots = xp.concatenate([xp.zeros((1, 2), given.dtype), given])
    if unknown or knots[-1, 0] < end - _NEARLY:  # the clip runs on at its own speed
        onward = knots[-1:] + (end - knots[-1, 0])
        knots = xp.concatenate([knots, onward])
    wrong = (xp.diff(knots, axis=0) <= 0).any() | ~xp.isfinite(knots).all()
    wrong = wrong | (knots[-1, 0] > end + _NEARLY)
    message = "time_warp: pairs must increase in both columns, from 0 to the end of the clip"
    if not unknown:
        message = f"{message}, {end * frame_time:g} s"
    knots = require(knots, wrong, message, got=pairs)
    source, warped = jnp.asarray(knots, motion.dtype).T
    return warped, source


def _ease_in_frames(ease: Sequence[ScalarLike], frame_time: Array, duration: Array) -> list[Array]:
    if len(ease) != 2:
        raise ValueError(f"time_warp: ease={ease}; expected seconds at the start and at the end")
    eases = [jnp.asarray(e, frame_time.dtype) / frame_time for e in ease]
    negative, long = (eases[0] < 0) | (eases[1] < 0), eases[0] + eases[1] > 2 * duration
    message = (
        "time_warp: ease must be 0 or more seconds, together at most twice the clip's duration"
    )
    return require(eases, negative | long, message, got=ease)


def _concrete(duration: ScalarLike) -> float:
    if traced(duration):
        raise ValueError("time_warp: traced arguments decide the duration; give num_frames")
    return float(duration)


def _checked_amount(amount: ScalarLike, dtype) -> Array:
    message = "time_warp: amount must be 0 or more"
    share = known(amount)
    wrong = ~((share >= 0) & (share < np.inf))
    return require(jnp.asarray(amount, dtype), wrong, message, got=amount)
