"""Where a clip changes its manner: segments of one style each (Wu et al. 2006, their last limit).

Every frame is a point x of few numbers: the principal parts of all joints' deviations from their
means, of the body's lean and of its velocities in body heights a second, which hold 95 % of the
variance, eight at most. A segment of n frames with covariance S about its own mean costs

    n/2 · log det (S + I/100)       what a Gaussian of its own needs to tell its frames

(x has variance 1 over the clip; finer than a tenth of that no manner is)

and the segments are those of least Σ cost + β (segments − 1), by dynamic programming. Frames that
follow each other are alike and steps repeat, so that no formula alone knows β. The clip does: a cut
between two neighbouring seconds gains something everywhere, and few of these cuts are changes.

    β = max(5 · median over frames of such a gain,  ½ · parameters · log frames)

(5 tells 13 clips of one style from 15 pairs joined, on Bandai Namco's; the other is Schwarz's.)

O(T) for the sums; O(K²) for K ≤ 256 places where a cut may be. NumPy, on the host.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmotion import quaternion
from jaxmotion._checks import one_number, static, traced
from jaxmotion._entry import finite_clip
from jaxmotion._posture import upright
from jaxmotion._summary import brief, line
from jaxmotion._types import ScalarLike
from jaxmotion.motion import Motion
from jaxmotion.style.root import HEIGHT, encode
from jaxmotion.style.statistics import deviations

_PARTS, _SHARE = 8, 0.95
_PLACES = 256
_OVER = 5.0  # median gains
_SOFT = 0.01  # of the clip's variance
_FAR = 6.0  # deviations


class StyleSegment(NamedTuple):
    """Frames of one manner, ``motion[start:end]``.

    **Fields:** ``start``, ``end``: frames, the end not included; ``gain``: by how much the cut at
    its start makes all of it cheaper, over what it would by chance, at least 1; 0 of the first.
    """

    start: int
    end: int
    gain: float

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield f"motion[{brief(self.start)}:{brief(self.end)}]"
        yield f"gain {brief(self.gain)}"


@static("max_segments")
def segment_styles(
    motion: Motion, *, max_segments: int = 8, shortest: ScalarLike = 1.0
) -> tuple[StyleSegment, ...]:
    """Cut a clip where its manner changes, to transfer from one part of it.

    O(T). Of known values only.

    **Arguments:** ``motion``: one clip; ``max_segments``: the most there may be; ``shortest``:
    seconds that each lasts at least, a step or two.
    **Returns:** :class:`StyleSegment` in order, together all of the clip; one, where nothing
    changes or the clip is shorter than two of them.
    **Raises:** ``ValueError`` for what is not one clip of finite numbers, no segments, or seconds
    that are not above 0; ``TypeError`` inside ``jit``.

    **Example:** a walk, and the same walk with its arms held up:

        >>> import jax, jaxmotion as jm
        >>> walk = jm.samples.load("walk").motion
        >>> arms = list(walk.skeleton.matching("*Arm"))
        >>> up = walk.rotations.at[:, arms].set(jm.quaternion.exp(jax.numpy.array([1.0, 0, 0])))
        >>> both = jm.concatenate([walk, walk.with_transforms(rotations=up)])
        >>> [(part.start, part.end) for part in jm.style.segment_styles(both)]
        [(0, 240), (240, 480)]
        >>> len(jm.style.segment_styles(walk))
        1
    """
    finite_clip("segment_styles", motion, on_host=True)
    if traced(motion, shortest):
        raise TypeError("segment_styles: segments are a list; call it outside of jit")
    if not (isinstance(max_segments, (int, np.integer)) and max_segments >= 1):
        raise ValueError(f"segment_styles: max_segments={max_segments}; want a number of 1 or more")
    seconds = float(np.asarray(one_number("segment_styles: shortest", shortest)))
    if not 0 < seconds < np.inf:
        raise ValueError(f"segment_styles: shortest={shortest}; want seconds above 0")
    frames = motion.num_frames
    least = max(2 * _PARTS, round(seconds / float(motion.frame_time)))
    whole = (StyleSegment(0, frames, 0.0),)
    if frames < 2 * least or max_segments == 1:
        return whole
    x = _principal(_features(motion))
    if not x.shape[1]:
        return whole
    step = -(-frames // _PLACES)
    places = np.append(np.arange(0, frames - least + 1, step), frames)
    chance = _by_chance(x, least)
    cost = _costs(x, places, least)
    cuts = _cheapest(cost, chance, max_segments)
    ends = [0, *cuts, len(places) - 1]
    gains = [0.0]
    for before, cut, after in zip(ends[:-2], ends[1:-1], ends[2:], strict=True):
        gains.append((cost[before, after] - cost[before, cut] - cost[cut, after]) / chance)
    return tuple(
        StyleSegment(int(places[a]), int(places[b]), float(gain))
        for a, b, gain in zip(ends[:-1], ends[1:], gains, strict=True)
    )


def _features(motion: Motion) -> Float[np.ndarray, "time feature"]:
    body = motion.body_joint
    middle = quaternion.mean(motion.rotations, method="chordal")
    away = np.asarray(deviations(middle, motion.rotations), np.float64)[:, body + 1 :]
    channels = np.array(encode(motion, upright(motion))[0], np.float64)
    channels[:, :2] /= max(abs(channels[:, HEIGHT].mean()), np.finfo(np.float64).tiny)
    path = np.delete(channels, HEIGHT, axis=1)
    x = np.concatenate([away.reshape(len(away), -1), path], axis=1)
    # A jump of the place, as where clips were joined, is no manner.
    middle = np.median(x, axis=0)
    usual = 1.4826 * np.median(np.abs(x - middle), axis=0)
    return np.clip(x, middle - _FAR * usual, middle + _FAR * usual)


def _principal(x: Float[np.ndarray, "time feature"]) -> Float[np.ndarray, "time part"]:
    """Its principal parts, each with variance 1."""
    x = x - x.mean(axis=0)
    _, size, ways = np.linalg.svd(x, full_matrices=False)
    share = np.cumsum(size**2) / max(np.sum(size**2), np.finfo(np.float64).tiny)
    count = min(_PARTS, 1 + int(np.searchsorted(share, _SHARE)))
    moves = size[:count] > 1e-6 * np.sqrt(len(x))
    ways, size = ways[:count][moves], size[:count][moves]
    return x @ ways.T / size * np.sqrt(len(x))


def _sums(x: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Σ x and Σ x xᵀ of the frames before every place."""
    first = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x, axis=0)])
    outer = np.cumsum(x[:, :, None] * x[:, None, :], axis=0)
    second = np.concatenate([np.zeros((1, *outer.shape[1:])), outer])
    return first[places], second[places]


def _cost(count: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Of segments with these sums."""
    n = count[..., None]
    mean = first / n
    covariance = second / n[..., None] - mean[..., :, None] * mean[..., None, :]
    soft = _SOFT * np.eye(first.shape[-1])
    return 0.5 * count * np.linalg.slogdet(covariance + soft)[1]


def _costs(x: np.ndarray, places: np.ndarray, least: int) -> np.ndarray:
    """From every place to every later one; infinite where they are too near."""
    first, second = _sums(x, places)
    table = np.full((len(places), len(places)), np.inf)
    for a in range(len(places)):
        far = np.flatnonzero(places - places[a] >= least)
        if far.size:
            count = (places[far] - places[a]).astype(float)
            table[a, far] = _cost(count, first[far] - first[a], second[far] - second[a])
    return table


def _by_chance(x: np.ndarray, least: int) -> float:
    """β of the module."""
    frames, parts = x.shape
    first, second = _sums(x, np.arange(frames + 1))
    cuts = np.arange(least, frames - least + 1)

    def cost(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return _cost((b - a).astype(float), first[b] - first[a], second[b] - second[a])

    before, after = cuts - least, cuts + least
    nearby = cost(before, after) - cost(before, cuts) - cost(cuts, after)
    parameters = parts * (parts + 3) / 2
    return float(max(_OVER * np.median(nearby), 0.5 * parameters * np.log(frames)))


def _cheapest(cost: np.ndarray, penalty: float, most: int) -> list[int]:
    """The places of the cuts of least total cost."""
    count = len(cost)
    best, came = [cost[0]], [np.zeros(count, int)]
    for _ in range(most - 1):
        through = best[-1][:, None] + cost
        came.append(np.argmin(through, axis=0))
        best.append(np.min(through, axis=0))
    totals = [b[-1] + penalty * k for k, b in enumerate(best)]
    at, cuts = count - 1, []
    for k in range(int(np.argmin(totals)), 0, -1):
        at = int(came[k][at])
        cuts.append(at)
    return cuts[::-1]
