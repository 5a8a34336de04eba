"""What neighbours show in place of each frame: the poses that the body has elsewhere.

Every word that covers a frame has K neighbours, and each of them, along its warp, one frame: S
poses for a frame, S = K times the words that cover one. Their mean is Aristidou's mean texture T̄,
their median what a frame in error is replaced by. O(T·S·J).
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxmotion import quaternion
from jaxmotion.cleaning.neighbours import Neighbours
from jaxmotion.cleaning.stored import taken

_CHUNK = 256  # frames whose poses are gathered at once


class Elsewhere(NamedTuple):
    """Of each frame the places shown: ``clip`` i[T, S], −1 where there is none, and ``frame``."""

    clip: Int[np.ndarray, "time pose"]
    frame: Int[np.ndarray, "time pose"]


def elsewhere(found: Neighbours, frames: int) -> Elsewhere:
    """The places that the neighbours of a clip of so many frames show in place of each."""
    starts, clip, warp = (np.asarray(x) for x in (found.starts, found.clip, found.warp))
    words, k = clip.shape
    length = warp.shape[-1]
    if not words:
        none = np.full((frames, k), -1)
        return Elsewhere(none, none)
    at = starts[:, None] + np.arange(length)
    slot = np.arange(words)[:, None] - np.searchsorted(starts, at - length + 1)
    shape = frames, int(slot.max()) + 1, k
    clips, places = np.full(shape, -1), np.full(shape, -1)
    clips[at, slot] = clip[:, None]
    places[at, slot] = np.moveaxis(warp, -1, 1)
    return Elsewhere(clips.reshape(frames, -1), places.reshape(frames, -1))


class Poses(NamedTuple):
    """Of each frame the poses shown: ``rotations`` f[T, S, J, 4], ``counts`` bool[T, S, J]."""

    rotations: Float[np.ndarray, "time pose joint 4"]
    counts: Bool[np.ndarray, "time pose joint"]


def poses(
    shown: Elsewhere, textures: Sequence[np.ndarray], left_out: Bool[np.ndarray, "time joint"]
) -> Poses:
    """The poses at those places in clips' ``textures`` f[T, J, 4], of which the first is the own;
    entries of that which are ``left_out`` do not count, unless all of a frame's are such."""
    there = shown.clip >= 0
    rotations = taken(textures, *(np.where(there, x, 0) for x in shown))
    counts = np.repeat(there[..., None], rotations.shape[2], axis=2)
    out = left_out[np.where(shown.clip == 0, shown.frame, 0)] & (shown.clip == 0)[..., None]
    kept = counts & ~out
    return Poses(rotations, np.where(kept.any(axis=1, keepdims=True), kept, counts))


def mean_texture(
    shown: Elsewhere, textures: Sequence[np.ndarray], left_out: Bool[np.ndarray, "time joint"]
) -> tuple[Float[np.ndarray, "time joint 4"], Bool[np.ndarray, "time joint"]]:
    """T̄, and which of it there is: elsewhere it is the own texture."""
    frames = len(shown.clip)
    means, judged = [], []
    for begin in range(0, frames, _CHUNK):
        part = Elsewhere(*(x[begin : begin + _CHUNK] for x in shown))
        rotations, counts = poses(part, textures, left_out)
        fill = (0, _CHUNK - len(rotations))
        filled = np.pad(rotations, (fill, (0, 0), (0, 0), (0, 0)), mode="edge")
        weights = np.pad(counts, (fill, (0, 0), (0, 0)), mode="edge").astype(rotations.dtype)
        means.append(np.asarray(_mean(filled, weights))[: len(rotations)])
        judged.append(counts.any(axis=1))
    mean, known = np.concatenate(means), np.concatenate(judged)
    return np.where(known[..., None], mean, textures[0]), known


@jax.jit
def _mean(rotations: Array, weights: Array) -> Array:
    return quaternion.mean(rotations, weights, axis=1, method="chordal")


def median_pose(shown: Poses) -> Float[np.ndarray, "time joint 4"]:
    """Componentwise median of the poses, on the first one's hemisphere and of length 1."""
    rotations, counts = shown
    first = np.take_along_axis(rotations, counts.argmax(axis=1)[:, None, :, None], axis=1)
    opposite = np.sum(rotations * first, axis=-1, keepdims=True) < 0
    seen = np.where(opposite, -rotations, rotations)
    ordered = np.sort(np.where(counts[..., None], seen, np.inf), axis=1)
    many = counts.sum(axis=1)
    low, high = (
        np.take_along_axis(ordered, np.maximum(n, 0)[:, None, :, None], axis=1)[:, 0]
        for n in ((many - 1) // 2, many // 2)
    )
    middle = (low + high) / 2
    middle[many == 0] = [1, 0, 0, 0]
    return middle / np.linalg.norm(middle, axis=-1, keepdims=True)


def medoid_pose(shown: Poses) -> Float[np.ndarray, "time joint 4"]:
    """The pose whose angles to the others are the least together."""
    rotations, counts = shown
    cosine = np.abs(np.einsum("tsjc,trjc->tsrj", rotations, rotations))
    apart = np.arccos(np.minimum(cosine, 1)) * counts[:, None]
    total = np.where(counts, apart.sum(axis=2), np.inf)
    best = total.argmin(axis=1)[:, None, :, None]
    return np.take_along_axis(rotations, best, axis=1)[:, 0]
