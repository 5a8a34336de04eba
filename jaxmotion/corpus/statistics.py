"""What is usual in a corpus, joint by joint, in one pass over its frames.

    q̄   chordal mean of a joint's rotations: the first eigenvector of Σ q qᵀ, which the shards have
    v   log(q̄⁻¹ q), a rotation vector in the mean's own frame, half a turn at most
    C   Σ v vᵀ / N;  σ = √tr C, radians;  lower, upper: least and greatest of each component
    ω   √(Σ (turn from a frame to the next / frame time)² / steps), radians a second

and mean, deviation, least and greatest of translations. Every frame counts alike. Of v's components
a histogram is kept, from which :meth:`CorpusStatistics.limits` leaves outliers out. Sums are
float64, of about four thousand frames at a time: O(frames · J), memory O(J).
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxmotion._portable import Portable
from jaxmotion._summary import some
from jaxmotion._types import AnyArray
from jaxmotion.corpus.matching import multiplied
from jaxmotion.spacetime import JointLimits

if TYPE_CHECKING:
    from jaxmotion.corpus.view import View

_CHUNK = 4096  # frames
_BINS = 512  # from −π to π


class CorpusStatistics(Portable):
    """What is usual in a corpus.

    **Fields:**

    - ``joints``: J names; ``clips``, ``frames``: how many; static.
    - ``lengths``: i32[C], frames of each clip; ``frame_time``: f[], seconds.
    - ``rotation_mean``: f[J, 4], the chordal mean; ``rotation_covariance``: f[J, 3, 3], radians
      squared, of the rotation vectors about it, in its own frame; ``rotation_lower``,
      ``rotation_upper``: f[J, 3], radians, least and greatest of their components.
    - ``turn_counts``: i64[J, 3, 512], how many frames have a component in each 512th of −π to π
      (NumPy's).
    - ``angular_speed``: f[J], root mean square, radians a second.
    - ``translation_mean``, ``translation_deviation``, ``translation_lower``,
      ``translation_upper``: f[J, 3], the file's unit.
    """

    joints: tuple[str, ...] = eqx.field(static=True)
    clips: int = eqx.field(static=True)
    frames: int = eqx.field(static=True)
    lengths: Int[AnyArray, " clip"]
    frame_time: Float[AnyArray, ""]
    rotation_mean: Float[AnyArray, "joint 4"]
    rotation_covariance: Float[AnyArray, "joint 3 3"]
    rotation_lower: Float[AnyArray, "joint 3"]
    rotation_upper: Float[AnyArray, "joint 3"]
    turn_counts: Int[AnyArray, "joint 3 bin"]
    angular_speed: Float[AnyArray, " joint"]
    translation_mean: Float[AnyArray, "joint 3"]
    translation_deviation: Float[AnyArray, "joint 3"]
    translation_lower: Float[AnyArray, "joint 3"]
    translation_upper: Float[AnyArray, "joint 3"]

    @property
    def rotation_deviation(self) -> Float[AnyArray, " joint"]:
        """σ of every joint, the root mean square turn from its mean, radians, f[J]."""
        c = np.asarray(self.rotation_covariance)
        return jnp.asarray(np.sqrt(np.trace(c, axis1=-2, axis2=-1)), c.dtype)

    @property
    def seconds(self) -> float:
        """Of all clips together."""
        return self.frames * float(self.frame_time)

    def limits(self, *, margin: float = 0.05, coverage: float = 1.0) -> JointLimits:
        """Joint limits that the corpus keeps: :func:`jaxmotion.spacetime.learn_limits` of all of
        its clips.

        **Arguments:** ``margin``: radians added on every side; ``coverage``: share of the frames
        that the box holds in each component, in (0, 1]; below 1 it is exact to a bin, 0.012
        radians.
        **Returns:** :class:`~jaxmotion.spacetime.JointLimits` of J joints, the root's infinite.
        **Raises:** ``ValueError`` for a bad coverage.
        """
        if not 0 < coverage <= 1:
            raise ValueError(f"limits: coverage={coverage}; expected a share in (0, 1]")
        kind = self.rotation_lower.dtype
        lower, upper = (np.array(x) for x in (self.rotation_lower, self.rotation_upper))
        if coverage < 1:
            counts = np.asarray(self.turn_counts)
            shares = np.cumsum(counts, axis=-1) / counts.sum(axis=-1, keepdims=True)
            edges = np.linspace(-np.pi, np.pi, _BINS + 1)
            outside = (1 - coverage) / 2
            first = np.argmax(shares > outside, axis=-1)
            last = np.argmax(shares >= 1 - outside, axis=-1)
            lower, upper = np.maximum(lower, edges[first]), np.minimum(upper, edges[last + 1])
        lower, upper = lower - margin, upper + margin
        lower[0], upper[0] = -np.inf, np.inf
        return JointLimits(jnp.asarray(lower, kind), jnp.asarray(upper, kind), self.rotation_mean)

    def _words(self) -> Iterator[str]:
        yield some(self.clips, "clip")
        yield some(self.frames, "frame")
        yield some(len(self.joints), "joint")


def mean_rotations(view: "View") -> np.ndarray:
    """q̄ of every joint over all frames, f64[J, 4]."""
    total = np.zeros((view.joints, 4, 4))
    for k in view.numbers.tolist():
        total += view.store.moments(k)
    mean = np.linalg.eigh(total)[1][..., -1]
    return np.where(mean[:, :1] < 0, -mean, mean)


def corpus_statistics(view: "View") -> CorpusStatistics:
    """The statistics of some clips."""
    lengths, mean = view.lengths, mean_rotations(view)
    sums = _Sums(mean, float(view.frame_time))
    for k in range(len(lengths)):
        clip = view.clip(k)
        for first in range(0, len(clip.rotations), _CHUNK):
            frames = slice(first, first + _CHUNK)
            sums.add(
                clip.rotations[frames].astype(np.float64),
                clip.translations(frames).astype(np.float64),
                clip.rotations[max(first - 1, 0) : first + _CHUNK].astype(np.float64),
            )
    kind = view.frame_time.dtype
    fields = {name: jnp.asarray(x.astype(kind)) for name, x in sums.results().items()}
    skeleton = view.store.settings.skeleton
    return CorpusStatistics(
        joints=skeleton.names,
        clips=len(lengths),
        frames=int(lengths.sum()),
        lengths=jnp.asarray(lengths.astype(np.int32)),
        frame_time=jnp.asarray(view.frame_time),
        turn_counts=sums.counts,  # pyright: ignore[reportArgumentType]
        **fields,
    )


class _Sums:
    """What grows from one piece of a clip to the next."""

    def __init__(self, mean: np.ndarray, frame_time: float):
        joints = len(mean)
        self.mean, self.frame_time = mean, frame_time
        self.back = mean * [1.0, -1.0, -1.0, -1.0]
        self.frames = self.steps = 0
        self.square, self.speed = np.zeros((joints, 3, 3)), np.zeros(joints)
        self.counts = np.zeros((joints, 3, _BINS), np.int64)
        self.least, self.most = np.full((2, joints, 6), np.inf)
        self.most = -self.most
        self.about = np.full((joints, 3), np.nan)  # where translations are, for the digits
        self.moved, self.moved_square = np.zeros((2, joints, 3))

    def add(self, q: np.ndarray, t: np.ndarray, with_last: np.ndarray) -> None:
        v = _log(multiplied(np.broadcast_to(self.back, q.shape), q))
        both = np.concatenate([v, t], axis=-1)
        self.least = np.minimum(self.least, both.min(axis=0))
        self.most = np.maximum(self.most, both.max(axis=0))
        by_joint = v.transpose(1, 2, 0)
        self.square += by_joint @ by_joint.transpose(0, 2, 1)
        bins = np.clip((v + np.pi) * (_BINS / (2 * np.pi)), 0, _BINS - 1).astype(np.int64)
        bins += _BINS * np.arange(bins[0].size).reshape(bins[0].shape)
        self.counts += np.bincount(bins.ravel(), minlength=self.counts.size).reshape(
            self.counts.shape
        )
        if not self.frames:
            self.about = t[0].copy()
        away = t - self.about
        self.moved += away.sum(axis=0)
        self.moved_square += (away**2).sum(axis=0)
        self.frames += len(q)
        back = with_last[:-1] * [1.0, -1.0, -1.0, -1.0]
        self.speed += (_log(multiplied(back, with_last[1:])) ** 2).sum(axis=(0, 2))
        self.steps += len(back)

    def results(self) -> dict[str, np.ndarray]:
        away = self.moved / self.frames
        spread = np.maximum(self.moved_square / self.frames - away**2, 0)
        return {
            "rotation_mean": self.mean,
            "rotation_covariance": self.square / self.frames,
            "rotation_lower": self.least[:, :3],
            "rotation_upper": self.most[:, :3],
            "angular_speed": np.sqrt(self.speed / max(self.steps, 1)) / self.frame_time,
            "translation_mean": away + self.about,
            "translation_deviation": np.sqrt(spread),
            "translation_lower": self.least[:, 3:],
            "translation_upper": self.most[:, 3:],
        }


def _log(q: np.ndarray) -> np.ndarray:
    """Rotation vectors f[..., 3] of quaternions, the short way."""
    q = np.where(q[..., :1] < 0, -q, q)
    sine = np.sqrt(np.sum(q[..., 1:] ** 2, axis=-1, keepdims=True))
    angle = 2 * np.arctan2(sine, q[..., :1])
    return q[..., 1:] * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0)
