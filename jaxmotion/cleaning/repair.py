"""Errors repaired: joints put where the body has them elsewhere in words like this one.

A mask that was found is grown at both ends of each run to the largest jump near by. There

    q′(t) = M(t) exp(e(t)),     e from log(M⁻¹ q) of the frame before the run to the one after it

M is what the neighbours show (own entries in error left out), by ``method``

    median        the componentwise median of all poses shown
    medoid        the pose shown that is nearest to all others, frame by frame
    nearest_end   one neighbour for a run, that whose ends lie nearest to those of the run

e goes linearly; at an end of the clip the other end's holds, and without either it is 0. Joints
that tell nothing, and frames that nothing is shown of, go the short way between the run's ends. The
body's yaw goes so too: neighbours face anywhere. With ``contacts``, a limb is of that method whose
planted points are nearest to where they are held, run by run; then it brings them there: ankles and
what hangs from them keep their turns.

Source: Aristidou et al. 2018, §5, whose quadratic Savitzky–Golay filter over the edges is
``blend="savgol"``. O(T·S·J) for S poses shown.
"""

from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from jaxmotion._checks import known, one_of, static
from jaxmotion._entry import one_clip
from jaxmotion._portable import Portable
from jaxmotion._summary import called, line
from jaxmotion._types import AnyArray, ArrayLike, ScalarLike
from jaxmotion.cleaning.body import as_lean, from_lean
from jaxmotion.cleaning.detect import (
    DetectedErrors,
    checked_confidence,
    detected,
    levels_beside,
)
from jaxmotion.cleaning.digression import Progress
from jaxmotion.cleaning.jumps import jumps
from jaxmotion.cleaning.levels import Evidence, Levels, examined
from jaxmotion.cleaning.missing import bridged
from jaxmotion.cleaning.planted import nearest_to_contacts, planted_again
from jaxmotion.cleaning.savgol import smoothed
from jaxmotion.cleaning.shown import METHODS, Method, Shown
from jaxmotion.cleaning.turns import angles_between, turned, vectors_between
from jaxmotion.contacts import Contacts
from jaxmotion.frames.runs import spans
from jaxmotion.motion import Motion

Blend: TypeAlias = Literal["residual", "savgol"]

_NEAR = 0.1  # seconds within which a run's end is at a jump
_JUMP = 0.1  # radians


class RepairedRun(NamedTuple):
    """What became of a run of frames in error. ``start``, ``stop``: the first frame and the one
    after the last; ``joints``: names; ``change``: the largest turn, radians; ``jump_before``,
    ``jump_after``: the largest jump of these joints in the run and at its ends, radians."""

    start: int
    stop: int
    joints: tuple[str, ...]
    change: float
    jump_before: float
    jump_after: float

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield f"frames {int(self.start)} to {int(self.stop) - 1}"
        yield called([str(name) for name in self.joints], 2)
        yield f"turned by {np.degrees(float(self.change)):.3g}°"
        jumps = (np.degrees(float(x)) for x in (self.jump_before, self.jump_after))
        yield "jumps by {:.3g}° before, {:.3g}° after".format(*jumps)


class Repaired(Portable):
    """A clip of T frames, repaired.

    **Fields:** ``motion``: the clip, bit for bit as it was where ``mask`` bool[T, J] is not set;
    ``before``: as it was given; ``errors``: :class:`DetectedErrors`, all that were found, None
    where a mask was given.
    """

    motion: Motion
    mask: Bool[AnyArray, "time joint"]
    before: Motion
    errors: DetectedErrors | None

    @property
    def runs(self) -> tuple[RepairedRun, ...]:
        """Every run of frames in which some joint was repaired, before and after."""
        mask, names = np.asarray(self.mask), self.motion.skeleton.names
        old, new = (np.asarray(known(x.rotations)) for x in (self.before, self.motion))
        change = angles_between(old, new)
        leaps = [np.pad(jumps(x), ((1, 1), (0, 0))) for x in (old, new)]
        made = []
        for start, stop in spans(mask.any(axis=1)):
            joints = np.flatnonzero(mask[start:stop].any(axis=0))
            largest = [float(np.nan_to_num(x[start : stop + 1, joints]).max()) for x in leaps]
            turn = float(np.nan_to_num(change[start:stop, joints]).max())
            made.append(RepairedRun(start, stop, tuple(names[j] for j in joints), turn, *largest))
        return tuple(made)

    def _words(self) -> Iterator[str]:
        yield from self.motion._words()


@static("k", "method", "blend")
def repair(
    motion: Motion,
    context: Motion | Sequence[Motion] = (),
    *,
    mask: ArrayLike | None = None,
    contacts: Contacts | None = None,
    joint_mask: ArrayLike | None = None,
    method: Method = "median",
    blend: Blend = "residual",
    confidence: ScalarLike = 0.0,
    k: int = 8,
    levels: Sequence[Levels] | None = None,
    progress: Progress | None = None,
) -> Repaired:
    """Find errors and repair them by what the body does elsewhere.

    On the host; not differentiable, not under ``jit``.

    **Arguments:**

    - ``motion``, ``context``, ``k``, ``levels``, ``progress``: as :func:`detect_errors`.
    - ``mask``: bool[T, J], entries in error that are known; by default they are found. Entries that
      are not finite are repaired either way.
    - ``contacts``: of the clip as it should be, whose points limbs are brought back to.
    - ``joint_mask``: bool[J], which joints may be changed; by default all.
    - ``method``: what is put in place of a joint: the componentwise "median" of what neighbours
      show, their "medoid", or the one neighbour whose ends fit best, "nearest_end". Where
      ``contacts`` say which of them stands best, of a limb that one.
    - ``blend``: "residual", or "savgol" for the paper's filter of 9 frames over the edges, which
      changes 4 frames beside each run as well.
    - ``confidence``: the least of errors to repair, from 0 to 1; those found below it stay as they
      are (:meth:`DetectedErrors.at_least`).

    **Returns:** :class:`Repaired`; the motion given, bit for bit, where nothing is in error.
    **Raises:** ``ValueError`` as :func:`detect_errors`; for masks of other shapes, contacts of
    another number of frames, a confidence that is none, or unknown names.

    **Example:**

        >>> import jax, jaxmotion as jm
        >>> walk = jm.samples.load("walk", fps=24.0, num_frames=120).motion
        >>> broken = jm.samples.offset_joints(walk, jax.random.key(0), runs=1).motion
        >>> fixed = jm.cleaning.repair(broken).motion
        >>> before, after = (jm.metrics.pose_error(walk, x).sum() for x in (broken, fixed))
        >>> bool(after < 0.05 * before)
        True
    """
    caller = "repair"
    one_of(f"{caller}: method", method, METHODS)
    one_of(f"{caller}: blend", blend, ("residual", "savgol"))
    least = checked_confidence(caller, confidence)
    one_clip(caller, motion, on_host=True)
    shape = np.shape(motion.rotations)[:2]
    free = _mask(caller, "joint_mask", joint_mask, shape[1:])
    known_wrong = None if mask is None else _mask(caller, "mask", mask, shape)
    evidence, errors = examined(caller, motion, context, k, progress), None
    if known_wrong is None:
        usual = levels_beside(caller, motion, context, k, levels)
        errors = detected(evidence, usual, motion)
    ways: Any = {"contacts": contacts, "method": method, "blend": blend, "confidence": least}
    return repaired(evidence, motion, errors, known_wrong, free, **ways)


def repaired(
    evidence: Evidence,
    motion: Motion,
    errors: DetectedErrors | None,
    known_wrong: Bool[np.ndarray, "time joint"] | None,
    free: Bool[np.ndarray, " joint"],
    *,
    contacts: Contacts | None = None,
    method: Method = "median",
    blend: Blend = "residual",
    confidence: ScalarLike = 0.0,
) -> Repaired:
    """A clip without the ``errors`` of some ``confidence`` that were found, or what is known to be
    wrong, by what is known of it."""
    if errors is not None:
        sure = np.asarray(errors.at_least(confidence).mask)
        left = np.asarray(errors.mask) & ~sure
        wrong = _grown(sure, evidence.jump, float(motion.fps)) & ~left
    else:
        wrong = evidence.missing if known_wrong is None else known_wrong | evidence.missing
    wrong = wrong & free
    if not wrong.any():
        return Repaired(motion, jnp.asarray(wrong), motion, errors)
    kept, changed = _put_back(wrong, evidence, method, blend)
    if contacts is not None:
        others = (_put_back(wrong, evidence, x, blend)[0] for x in METHODS if x != method)
        kept = nearest_to_contacts([kept, *others], contacts, changed)
        kept, changed = planted_again(kept, contacts, changed, free)
    wrong = changed
    kept = _as_given(motion, kept, evidence.missing & ~wrong)
    return Repaired(kept, jnp.asarray(wrong), motion, errors)


def _as_given(given: Motion, made: Motion, still_missing: np.ndarray) -> Motion:
    """The motion made, but what is missing and may not be changed missing."""
    if not still_missing.any():
        return made
    gone = still_missing[..., None]
    pairs = zip(
        (given.translations, given.rotations), (made.translations, made.rotations), strict=True
    )
    return made.with_transforms(*(jnp.where(gone, a, b) for a, b in pairs))


def _mask(caller: str, name: str, values: ArrayLike | None, shape: tuple[int, ...]) -> np.ndarray:
    if values is None:
        return np.ones(shape, bool)
    if np.shape(values) != shape:
        raise ValueError(f"{caller}: {name} has shape {np.shape(values)}; expected {shape}")
    return np.array(values, bool)


def _grown(mask: np.ndarray, jump: np.ndarray, fps: float) -> np.ndarray:
    """The mask, the ends of its runs moved out to the largest jump near by, or by a frame."""
    leap = np.pad(jump, ((1, 1), (0, 0)))  # into each frame
    near = max(1, round(_NEAR * fps))
    grown = mask.copy()
    for joint in np.flatnonzero(mask.any(axis=0)):
        into = leap[:, joint]
        for start, stop in spans(mask[:, joint]):
            before = into[max(start - near, 0) : start + near + 1]
            first = max(start - near, 0) + int(before.argmax())
            after = into[max(stop - near, 0) : stop + near + 1]
            last = max(stop - near, 0) + int(after.argmax())
            first = first if before.max() > _JUMP else start - 1
            last = last if after.max() > _JUMP else stop + 1
            grown[max(min(first, start), 0) : max(last, stop), joint] = True
    return grown


def _put_back(
    wrong: np.ndarray, evidence: Evidence, method: Method, blend: Blend
) -> tuple[Motion, np.ndarray]:
    """The motion with what is wrong replaced, and what was replaced."""
    motion = evidence.setting.motion
    leans = as_lean(motion)
    made = bridged(leans, ~wrong)
    shown = Shown(evidence, wrong, leans, method)
    for joint in np.flatnonzero(wrong.any(axis=0)).tolist():
        for start, stop in spans(wrong[:, joint]):
            poses = shown.over(joint, start, stop)
            if poses is None:
                continue
            here = slice(start, stop)
            if blend == "residual":
                made[here, joint] = _met(poses, leans[:, joint], start, stop)
            else:
                made[here, joint] = poses[start > 0 :][: stop - start]
    if blend == "savgol":
        made, wrong = smoothed(made, wrong)
    rotations = from_lean(motion, made, wrong)
    kept = np.where(wrong[..., None], rotations, known(motion.rotations))
    return motion.with_transforms(rotations=jax.device_put(kept)), wrong


def _met(poses: np.ndarray, q: np.ndarray, start: int, stop: int) -> np.ndarray:
    """``poses``, of a run and the frames on both sides that there are, turned to meet q there."""
    first, last = max(start - 1, 0), min(stop, len(q) - 1)
    ends = vectors_between(poses[[0, -1]], q[[first, last]])
    before, after = start > 0, stop < len(q)
    if not (before or after):
        return poses
    way = np.arange(1, stop - start + 1) / (stop - start + 1)
    way = (way if before else np.ones_like(way)) if after else np.zeros_like(way)
    bend = ends[0] + way[:, None].astype(q.dtype) * (ends[1] - ends[0])
    return turned(poses[int(before) :][: stop - start], bend)
