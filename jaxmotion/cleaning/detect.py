"""Errors found: joints that are not where the body has them elsewhere, that jump, that stand still.

    digression   √(M/s · M′/s′) above 1.27, and about such frames all above half of that; M the
                 digression from the neighbours, M′ that from what the other joints foretell
    jump         pairs above 0.42 rad, and above twice what the context shows (the second largest
                 of its clips), but 0.7 rad at most; the frames about a jump of more than 0.7 rad,
                 or a step of more than 0.42 rad and 40 rad/s, that has no pair
    hold         0.125 s and more

    s² = (0.2 rad)² + (the median over the context's clips of their greatest M)²
         + (twice the clip's own median M)²,      so s′

Each is blind where the other is not: neighbours err in poses that the body takes once, the other
joints where a joint goes its own way. Both measures of a second pass leave out what the first pass
found. The measures are ours, the digression Aristidou et al.'s (2018).
"""

from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple, TypeAlias

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxmotion._checks import one_number, static
from jaxmotion._portable import Portable
from jaxmotion._summary import called, line, some
from jaxmotion._types import AnyArray, ScalarLike
from jaxmotion.cleaning.digression import Progress
from jaxmotion.cleaning.groups import as_clips
from jaxmotion.cleaning.jumps import greatest_about
from jaxmotion.cleaning.levels import Evidence, Levels, clean_levels, examined, weighed
from jaxmotion.frames.runs import hysteresis, spans
from jaxmotion.motion import Motion

Detector: TypeAlias = Literal["digression", "jump", "hold", "missing"]

_STRONG, _WEAK = 1.27, 0.635
_FLOOR = 0.2  # radians
_OWN = 2.0
_PAIR, _SUDDEN = 0.42, 0.7  # radians
_FASTEST = 40.0  # radians a second
_ABOUT = 0.1  # seconds
_HOLD = 0.125  # seconds
_USUAL = 2.0


class ErrorRun(NamedTuple):
    """Frames on end with errors in them. ``start``, ``stop``: the first frame and the one after the
    last; ``joints``: names; ``size``: the largest change that would be due, radians;
    ``detectors``: what found them; ``confidence``: from 0.5 to 1."""

    start: int
    stop: int
    joints: tuple[str, ...]
    size: float
    detectors: tuple[Detector, ...]
    confidence: float

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield f"frames {int(self.start)} to {int(self.stop) - 1}"
        yield called([str(name) for name in self.joints], 2)
        yield f"{np.degrees(float(self.size)):.3g}°"
        yield f"{', '.join(map(str, self.detectors))} ({float(self.confidence):.2f})"


class DetectedErrors(Portable):
    """The errors of a clip of T frames.

    **Fields:** ``mask``: bool[T, J]; ``mdm``: f[T, J], from 0 to 1, 0.5 and more where the mask's
    first evidence is; ``digression``: f[T, J], radians; ``by``: bool[T, J] by detector,
    "digression", "jump", "hold" and "missing"; ``motion``: the clip.
    """

    mask: Bool[AnyArray, "time joint"]
    mdm: Float[AnyArray, "time joint"]
    digression: Float[AnyArray, "time joint"]
    by: dict[Detector, Bool[AnyArray, "time joint"]]
    motion: Motion

    @property
    def runs(self) -> tuple[ErrorRun, ...]:
        """Every run of frames in which some joint is in error."""
        mask = np.asarray(self.mask)
        names = self.motion.skeleton.names
        told: dict[Detector, Any] = {name: np.asarray(x) for name, x in self.by.items()}
        mdm, size = np.asarray(self.mdm), np.asarray(self.digression)
        made = []
        for start, stop in spans(mask.any(axis=1)):
            here = slice(start, stop)
            made.append(
                ErrorRun(
                    start,
                    stop,
                    tuple(names[j] for j in np.flatnonzero(mask[here].any(axis=0))),
                    float(size[here][mask[here]].max()),
                    tuple(name for name, found in told.items() if found[here].any()),
                    float(mdm[here][mask[here]].max()),
                )
            )
        return tuple(made)

    def at_least(self, confidence: ScalarLike) -> "DetectedErrors":
        """The errors of at least a confidence: a joint's frames on end, if one of them reaches it.

        **Arguments:** ``confidence``: from 0, which keeps all, to 1.
        **Returns:** the same clip's errors, ``mask`` and ``by`` without the others.
        **Raises:** ``ValueError`` for any other number.

        **Example:**

            >>> import jax, jaxmotion as jm
            >>> walk = jm.samples.load("walk", fps=24.0, num_frames=120).motion
            >>> broken = jm.samples.offset_joints(walk, jax.random.key(0), runs=1).motion
            >>> sure = jm.cleaning.detect_errors(broken).at_least(0.8)
            >>> all(run.confidence >= 0.8 for run in sure.runs)
            True
        """
        least = checked_confidence("at_least", confidence)
        mask = np.asarray(self.mask)
        sure = mask & (np.asarray(self.mdm) >= least)
        kept = hysteresis(jnp.asarray(sure), jnp.asarray(mask))
        told = self.by.items()
        by: dict[Detector, Any] = {name: jnp.asarray(np.asarray(x) & kept) for name, x in told}
        return DetectedErrors(kept, self.mdm, self.digression, by, self.motion)

    def _words(self) -> Iterator[str]:
        yield some(self.mask.shape[0], "frame")
        yield some(self.mask.shape[1], "joint")


@static("k", "passes")
def detect_errors(
    motion: Motion,
    context: Motion | Sequence[Motion] = (),
    *,
    k: int = 8,
    levels: Sequence[Levels] | None = None,
    passes: int = 2,
    progress: Progress | None = None,
) -> DetectedErrors:
    """Find joints that are in error, by what the body does elsewhere.

    On the host; not differentiable, not under ``jit``.

    **Arguments:** ``motion``: one clip, T frames; entries that are not finite are errors;
    ``context``: clips of the same joints, best eight that are much like it; ``k``: how many
    neighbours of each word; ``levels``: what is usual in the context (:func:`clean_levels`), by
    default measured, each of its clips beside the others; ``passes``: 2 to look again without what
    was found; ``progress``: as :func:`digression_map`.
    **Returns:** :class:`DetectedErrors`.
    **Raises:** ``ValueError`` for what is traced, clips or levels of other joints, passes below 1.

    **Example:**

        >>> import jax, jaxmotion as jm
        >>> walk = jm.samples.load("walk", fps=24.0, num_frames=120).motion
        >>> broken = jm.samples.offset_joints(walk, jax.random.key(0), runs=1)
        >>> found = jm.cleaning.detect_errors(broken.motion)
        >>> bool((found.mask == broken.mask).mean() > 0.99)
        True
    """
    caller = "detect_errors"
    if not isinstance(passes, (int, np.integer)) or passes < 1:
        raise ValueError(f"{caller}: passes={passes!r}; expected a whole number of at least 1")
    evidence = examined(caller, motion, context, k, progress)
    return detected(evidence, levels_beside(caller, motion, context, k, levels), motion, passes)


def checked_confidence(caller: str, confidence: ScalarLike) -> float:
    """The number, if it is a confidence; else ``ValueError``."""
    least = float(np.asarray(one_number(f"{caller}: confidence", confidence)))
    if not 0 <= least <= 1:
        raise ValueError(f"{caller}: confidence is {least:g}; expected a number from 0 to 1")
    return least


def levels_beside(
    caller: str,
    motion: Motion,
    context: Motion | Sequence[Motion],
    k: int,
    levels: Sequence[Levels] | None,
) -> Sequence[Levels]:
    """Those given, or of the clips of the context, each beside the others."""
    if levels is not None and any(x.jump.shape != (motion.num_joints,) for x in levels):
        raise ValueError(f"{caller}: levels are not of the motion's {motion.num_joints} joints")
    if levels is not None:
        return levels
    clips = as_clips(context)
    return [clean_levels(clip, clips[:i] + clips[i + 1 :], k=k) for i, clip in enumerate(clips)]


def detected(
    evidence: Evidence, levels: Sequence[Levels], motion: Motion, passes: int = 2
) -> DetectedErrors:
    """The errors of a clip, by what is known of it and what is usual in its context."""
    usual = _Usual.of(levels, motion.num_joints)
    sure = _by_time(evidence, usual)
    everywhere = np.any([*(x[0] for x in sure.values())], axis=0) | evidence.missing
    mask = everywhere
    for _ in range(passes):
        left_out = mask
        found, score, size = _by_digression(evidence, usual, left_out)
        mask = everywhere | found
        if np.array_equal(mask, left_out):
            break  # another look would be the same
    by: dict[Detector, Any] = {"digression": found, "missing": evidence.missing}
    by |= {name: x[0] for name, x in sure.items()}
    ratios = np.max(np.stack([score / _STRONG, *(x[1] for x in sure.values())]), axis=0)
    mdm = np.where(evidence.missing, 1, 1 - 2 ** -(ratios**2))
    kind = motion.dtype
    return DetectedErrors(
        jnp.asarray(mask),
        jnp.asarray(mdm, kind),
        jnp.asarray(size, kind),
        {name: jnp.asarray(x) for name, x in by.items()},
        motion,
    )


class _Usual(NamedTuple):
    """Of each joint, f[J]: what half of the context's clips stay below, or all but one of them."""

    digression: np.ndarray
    foretold: np.ndarray
    jump: np.ndarray

    @classmethod
    def of(cls, levels: Sequence[Levels], joints: int) -> "_Usual":
        if not levels:
            return cls(*(np.zeros(joints) for _ in cls._fields))
        every = {name: np.stack([getattr(x, name) for x in levels]) for name in cls._fields}
        middle = {name: np.median(x, axis=0) for name, x in every.items()}
        second = np.sort(every["jump"], axis=0)[max(len(levels) - 2, 0)]
        return cls(**{**middle, "jump": second})


def _by_digression(evidence: Evidence, usual: _Usual, left_out: np.ndarray):
    """Which entries digress, the score f[T, J] and the size in radians."""
    judged, foretold = weighed(evidence, left_out)
    joints = np.array(evidence.setting.joints, int)
    parts = []
    for residual, level in ((judged.residual, usual.digression), (foretold, usual.foretold)):
        size = np.linalg.norm(residual, axis=-1)
        own = _OWN * np.median(size, axis=0)
        parts.append(size / np.sqrt(_FLOOR**2 + level[joints] ** 2 + own**2))
    shape = evidence.missing.shape
    score, size = np.zeros(shape), np.zeros(shape)
    score[:, joints] = np.sqrt(parts[0] * parts[1])
    size[:, joints] = np.linalg.norm(judged.residual, axis=-1)
    strong, weak = (jnp.asarray(score > x) for x in (_STRONG, _WEAK))
    return np.asarray(hysteresis(strong, weak)), score, size


def _by_time(evidence: Evidence, usual: _Usual) -> dict[Detector, tuple[np.ndarray, np.ndarray]]:
    """Jumps and holds: which entries, and how far above what is usual each is, f[T, J]."""
    fps = float(evidence.setting.motion.fps)
    pair = evidence.pair / np.clip(_USUAL * usual.jump, _PAIR, _SUDDEN)
    alone = np.where(pair > 1, 0, _sudden(evidence, fps, pair > 1))
    hold = evidence.hold / (_HOLD * fps)
    tells = np.isin(np.arange(hold.shape[1]), evidence.setting.joints)
    hold = np.where(tells, hold, 0)
    jump = np.maximum(pair, alone)
    return {"jump": (jump > 1, np.where(jump > 1, jump, 0)), "hold": (hold > 1, hold * (hold > 1))}


def _sudden(evidence: Evidence, fps: float, told: np.ndarray) -> np.ndarray:
    """How sudden the steps about each frame are, of those that no pair tells of."""
    # A small joint may well be fast for the moment of a frame: a foot that comes down.
    fast = np.where(evidence.speed / fps > _PAIR, evidence.speed / _FASTEST, 0)
    step = np.maximum(evidence.jump / _SUDDEN, fast)
    step = np.where((step > 1) & ~told[1:] & ~told[:-1], step, 0)
    about = max(1, round(_ABOUT * fps))
    # The step from frame t to t + 1 tells of frames t − about + 1 to t + about.
    return greatest_about(step, range(1 - about, about + 1), len(told))
