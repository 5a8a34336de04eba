"""How well errors are found and repaired, where what was in error is known.

    recall       found of what is in error
    precision    in error of what is found;  at another share π of errors than in the clip, with f
                 the false alarms among what is sound, π R/(π R + (1 − π) f)
    pose error   Σ_joints ‖log_half(q⁻¹ q̂)‖², of each frame (Aristidou et al. 2018, Eq. 2), where
                 log_half is half the rotation vector

A word is in error, or found, when any of its entries is. NumPy on the host, O(T·J).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmotion._checks import no_module
from jaxmotion._entry import check_result
from jaxmotion._summary import line
from jaxmotion._types import ArrayLike
from jaxmotion.cleaning.words import check_sizes, word_starts
from jaxmotion.metrics.measures import turn
from jaxmotion.motion import Motion


class DetectionScores(NamedTuple):
    """Shares from 0 to 1; NaN of nothing. ``recall``, ``precision``, ``false_alarms``: of words;
    ``entry_recall``, ``entry_precision``: of joints in frames; ``words``, ``in_error``: how many
    words there are, and how many are in error."""

    recall: float
    precision: float
    false_alarms: float
    entry_recall: float
    entry_precision: float
    words: int
    in_error: int

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield f"{int(self.in_error)} of {int(self.words)} words in error"
        yield f"recall {float(self.recall):.3f}, precision {float(self.precision):.3f}"
        yield f"of entries {float(self.entry_recall):.3f}, {float(self.entry_precision):.3f}"

    def precision_at(self, prevalence: float) -> float:
        """The precision where that share of the words is in error."""
        right, wrong = prevalence * self.recall, (1 - prevalence) * self.false_alarms
        return right / (right + wrong) if right + wrong > 0 else float("nan")


def detection_scores(
    found: ArrayLike, truth: ArrayLike, *, length: int = 15, stride: int = 5
) -> DetectionScores:
    """How much of what is in error was found, and how much else.

    **Arguments:** ``found``, ``truth``: bool[T, J]; ``length``, ``stride``: of words, frames.
    **Returns:** :class:`DetectionScores`.
    **Raises:** ``ValueError`` for masks of other shapes, numbers that make no words.

    **Example:**

        >>> import numpy as np, jaxmotion as jm
        >>> truth = np.zeros((40, 2), bool)
        >>> truth[10:20, 1] = True
        >>> jm.metrics.detection_scores(np.roll(truth, 2, axis=0), truth).entry_recall
        0.8
    """
    for name, value in (("found", found), ("truth", truth)):
        no_module(f"detection_scores: {name}", value)
    a, b = (np.asarray(x, bool) for x in (found, truth))
    if a.ndim != 2 or a.shape != b.shape:
        raise ValueError(
            f"detection_scores: found has shape {a.shape}, truth {b.shape}; expected (T, J) of both"
        )
    check_sizes("detection_scores", length, stride)
    frames = word_starts(len(a), length, stride)[:, None] + np.arange(length)
    in_word, wrong = (np.any(np.any(x, axis=1)[frames], axis=1) for x in (a, b))
    return DetectionScores(
        _share(in_word & wrong, wrong),
        _share(in_word & wrong, in_word),
        _share(in_word & ~wrong, ~wrong),
        _share(a & b, b),
        _share(a & b, a),
        len(wrong),
        int(wrong.sum()),
    )


def _share(part: np.ndarray, whole: np.ndarray) -> float:
    return float(part.sum() / whole.sum()) if whole.any() else float("nan")


def pose_error(motion: Motion, result: Motion) -> Float[np.ndarray, " time"]:
    """How far poses are from those they should be, joints together: Aristidou et al. 2018, Eq. 2.

    **Arguments:** ``motion``, ``result``: clips of T frames of the same joints.
    **Returns:** f64[T], squared half-angle radians.
    **Raises:** ``ValueError`` for clips of other shapes; ``TypeError`` under ``jit``.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk").motion
        >>> float(jm.metrics.pose_error(walk, walk).max())
        0.0
    """
    check_result("pose_error", motion, result)
    return np.sum((turn(motion.rotations, result.rotations) / 2) ** 2, axis=-1)
