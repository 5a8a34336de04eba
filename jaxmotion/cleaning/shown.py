"""What neighbours show in place of a run of frames in error: by all of them, or by one.

Where the context itself jumps (the flips of a retargeting come again and again), the median of
poses goes from one kind to the other. What turns faster than 20 rad/s is not put in: one neighbour
is then, and nothing where that does so as well.
"""

from collections.abc import Iterator
from typing import Literal, TypeAlias, get_args

import numpy as np
from jaxtyping import Bool, Float

from jaxmotion.cleaning.digression import at_every_frame
from jaxmotion.cleaning.elsewhere import Poses, elsewhere, median_pose, medoid_pose, poses
from jaxmotion.cleaning.jumps import turns
from jaxmotion.cleaning.levels import Evidence
from jaxmotion.cleaning.neighbours import Neighbours
from jaxmotion.cleaning.turns import between, vectors_between

Method: TypeAlias = Literal["median", "medoid", "nearest_end"]
METHODS: tuple[Method, ...] = get_args(Method)

_CHUNK = 64  # frames
_FASTEST = 20.0  # radians a second


class Shown:
    """The poses to put in place of what is ``wrong`` bool[T, J] in ``leans`` f[T, J, 4]."""

    def __init__(
        self,
        evidence: Evidence,
        wrong: Bool[np.ndarray, "time joint"],
        leans: Float[np.ndarray, "time joint 4"],
        method: Method,
    ) -> None:
        self.evidence, self.leans, self.method = evidence, leans, method
        setting = evidence.setting
        self.column = {joint: n for n, joint in enumerate(setting.joints)}
        out = (wrong | evidence.missing)[:, np.array(setting.joints, int)]
        self.left_out = out[:: setting.step]
        if method != "nearest_end" and evidence.found:
            self.middle, self.there = self._middles(
                median_pose if method == "median" else medoid_pose
            )

    def over(self, joint: int, start: int, stop: int) -> np.ndarray | None:
        """Poses f[n, 4] of a run of a joint and of the frames on both sides that there are; None
        where nothing is shown of one of them, or what is shown leaps."""
        first, last = max(start - 1, 0), min(stop + 1, len(self.leans))
        if joint not in self.column:
            return None  # as every joint where nothing moves
        column = self.column[joint]
        if self.method != "nearest_end" and self.there[first:last, column].all():
            poses = self.middle[first:last, column]
            if not self._leaps(poses):
                return poses
        beside = np.array([first < start, stop < last])
        poses = self._nearest_end(column, first, last, beside)
        return None if poses is None or self._leaps(poses) else poses

    def _leaps(self, poses: np.ndarray) -> bool:
        speed = turns(poses[:, None]) * float(self.evidence.setting.motion.fps)
        return bool(speed.max(initial=0) > _FASTEST)

    def _middles(self, middle) -> tuple[np.ndarray, np.ndarray]:
        """One pose for every frame and joint that tells, of all groups that hold the joint."""
        setting = self.evidence.setting
        frames = len(setting.textures[0])
        every = [
            (elsewhere(found, frames), np.isin(setting.joints, setting.groups[name]))
            for name, found in self.evidence.found.items()
        ]
        made, there = [], []
        for begin in range(0, frames, _CHUNK):
            parts = [
                poses(
                    type(shown)(*(x[begin : begin + _CHUNK] for x in shown)),
                    setting.textures,
                    self.left_out,
                )
                for shown, _ in every
            ]
            counts = [part.counts & holds for part, (_, holds) in zip(parts, every, strict=True)]
            together = Poses(
                np.concatenate([part.rotations for part in parts], axis=1),
                np.concatenate(counts, axis=1),
            )
            made.append(middle(together))
            there.append(together.counts.any(axis=1))
        frames = len(self.leans)
        shown, known = (
            at_every_frame(np.concatenate(x), frames, setting.step) for x in (made, there)
        )
        return shown, known

    def _nearest_end(
        self, column: int, first: int, last: int, beside: Bool[np.ndarray, "2"]
    ) -> np.ndarray | None:
        """Of one neighbour, that whose first and last pose are nearest to the clip's, if these are
        ``beside`` the run: an end of the clip is in error itself."""
        setting = self.evidence.setting
        joint = setting.joints[column]
        rows = np.arange(first, last) / setting.step
        middle = rows.mean()
        candidates = [
            tried
            for name, found in self.evidence.found.items()
            if joint in setting.groups[name]
            for tried in self._candidates(found, column, rows, middle)
        ]
        if not candidates:
            return None
        every = np.stack(candidates, axis=1)
        ends = np.repeat(self.leans[[first, last - 1], joint][:, None], every.shape[1], axis=1)
        away = vectors_between(every[[0, -1]], ends)
        return every[:, np.sum(away[beside] ** 2, axis=(0, 2)).argmin()]

    def _candidates(
        self, found: Neighbours, column: int, rows: np.ndarray, middle: float
    ) -> Iterator[np.ndarray]:
        """What each neighbour of a word about the middle shows, at its pace, and on at that of the
        clip; not what is wrong itself."""
        textures = self.evidence.setting.textures
        starts, clips, warps = (np.asarray(x) for x in (found.starts, found.clip, found.warp))
        length = warps.shape[-1]
        for word in np.flatnonzero((starts <= middle) & (middle < starts + length)):
            for clip, warp in zip(clips[word], warps[word], strict=True):
                if clip < 0:
                    continue
                inside = rows - starts[word]
                at = np.interp(inside, np.arange(length), warp)
                at += np.minimum(inside, 0) + np.maximum(inside - (length - 1), 0)
                q = textures[clip][:, column]
                if at[0] < 0 or at[-1] > len(q) - 1:
                    continue
                low = np.minimum(at.astype(int), max(len(q) - 2, 0))
                high = np.minimum(low + 1, len(q) - 1)
                if clip == 0 and self.left_out[np.concatenate([low, high]), column].any():
                    continue
                yield between(q[low], q[high], (at - low).astype(q.dtype))
