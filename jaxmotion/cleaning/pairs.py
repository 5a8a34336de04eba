"""Distances of words and targets, as far as they are known: warped, or bounded from below."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jaxmotion.cleaning.bound import WordShape, least_distances
from jaxmotion.frames.padding import program_size
from jaxmotion.timing import dtw, pose_distance

_LANES = 1024  # pairs that are warped at once


class Pool(NamedTuple):
    """All clips end to end: ``poses`` f[P, J, 4], or f[P, J, 6] of points, padded; of every target
    that begins at a frame ``clip`` i32[P] and ``frame`` i32[P] in it, and whether it fits."""

    poses: Array
    clip: np.ndarray
    frame: np.ndarray
    fits: np.ndarray


def pooled(textures: Sequence[Array], shape: WordShape, *, own: bool) -> Pool:
    """The pool of the clips' textures f[T, J, …], of which the first is the words' ``own``."""
    frames = np.concatenate([np.arange(len(x)) for x in textures])
    clip = np.repeat(np.arange(len(textures)), [len(x) for x in textures])
    ends = np.repeat([len(x) for x in textures], [len(x) for x in textures])
    fits = (frames + shape.target <= ends) & ((clip > 0) | own)
    fill = program_size(len(frames)) - len(frames)
    poses = np.concatenate([np.asarray(x) for x in textures])
    poses = np.pad(poses, ((0, fill), (0, 0), (0, 0)), mode="edge")
    clip, frames, fits = (np.pad(x, (0, fill)) for x in (clip, frames, fits))
    return Pool(jax.device_put(poses), clip, frames, fits)


class Pairs:
    """What is known of the distances of a block of words from all targets: ``exact`` f[B, P], +inf
    where not ``done``; ``least`` f[B, P], the bounds where it is not, +inf where nothing fits."""

    def __init__(
        self, d: Array, places: np.ndarray, shape: WordShape, words: int, pool: Pool
    ) -> None:
        self.d, self.places, self.shape, self.fits = d, places, shape, pool.fits
        bounds = np.asarray(_bounds(d, jnp.asarray(places, jnp.int32), shape))[:words]
        self.least = np.where(pool.fits, bounds, np.inf)
        self.exact = np.full_like(self.least, np.inf)
        self.done = np.zeros(self.least.shape, bool)
        self.first = np.append(True, pool.clip[1:] != pool.clip[:-1])
        self.warped = 0

    def warp(self, wanted: np.ndarray) -> bool:
        """Warp the pairs that are not done yet; whether there were any."""
        word, target = np.nonzero(wanted & ~self.done & self.fits)
        if not word.size:
            return False
        for begin in range(0, len(word), _LANES):
            w, t = word[begin : begin + _LANES], target[begin : begin + _LANES]
            found = np.asarray(_costs(self.d, *self._lanes(w, t, _LANES), self.shape))[: len(w)]
            self.exact[w, t] = self.least[w, t] = found
            self.done[w, t] = True
        self.warped += len(word)
        return True

    def minima(self) -> np.ndarray:
        """Which targets are known to be local minima."""
        before = np.full_like(self.least, np.inf)
        after = before.copy()
        before[:, 1:] = np.where(self.first[1:], np.inf, self.least[:, :-1])
        after[:, :-1] = np.where(self.first[1:], np.inf, self.least[:, 1:])
        return self.done & (self.exact < before) & (self.exact <= after)

    def paths(self, targets: np.ndarray) -> np.ndarray:
        """The target's frame beside each frame of the words, i[B, K, N], for targets i[B, K]."""
        words, k = targets.shape
        w, t = np.repeat(np.arange(words), k), targets.ravel()
        found = _middles(self.d, *self._lanes(w, t, len(self.places) * k), self.shape)
        return np.asarray(found)[: len(w)].reshape(words, k, -1)

    def _lanes(self, w: np.ndarray, t: np.ndarray, lanes: int) -> tuple[Array, Array]:
        """First row and column of pairs, filled up."""
        fill = (0, lanes - len(w))
        rows, columns = self.places[np.pad(w, fill, mode="edge")], np.pad(t, fill, mode="edge")
        columns = np.minimum(columns, self.d.shape[1] - self.shape.target)
        return jnp.asarray(rows, jnp.int32), jnp.asarray(columns, jnp.int32)


@partial(jax.jit, static_argnames="trim")
def frame_distances(words: Array, pool: Array, trim: int) -> Float[Array, "row target"]:
    """Trimmed distances, of frames of words from all frames of the pool: of poses, or of points."""
    if words.shape[-1] == 4:
        return pose_distance(words, pool, trim=trim)

    def of_frame(points: Array) -> Float[Array, " target"]:
        terms = jnp.sum((pool - points) ** 2, axis=-1)
        return jnp.sum(terms, axis=-1) - jnp.sum(lax.top_k(terms, trim)[0], axis=-1)

    return lax.map(of_frame, words)


_bounds = jax.jit(least_distances, static_argnums=2)


def _patches(d: Array, rows: Array, columns: Array, shape: WordShape) -> Array:
    sizes = shape.length, shape.target
    return jax.vmap(lambda i, j: lax.dynamic_slice(d, (i, j), sizes))(rows, columns)


def _warped(cost: Array, shape: WordShape):
    return dtw(
        cost=cost, step_pattern="slope3", open_end=True, min_matched=shape.least, normalize="mean"
    )


@partial(jax.jit, static_argnums=3)
def _costs(d: Array, rows: Array, columns: Array, shape: WordShape) -> Float[Array, " pair"]:
    """Distances of words that begin at those rows and targets at those columns."""
    return jax.vmap(lambda cost: _warped(cost, shape).cost)(_patches(d, rows, columns, shape))


@partial(jax.jit, static_argnums=3)
def _middles(d: Array, rows: Array, columns: Array, shape: WordShape) -> Int[Array, "pair frame"]:
    """The middle of the target's frames that stand beside each frame of the word."""

    def of_pair(cost: Array) -> Array:
        found = _warped(cost, shape)
        here = found.path[:, 0] == jnp.arange(shape.length, dtype=jnp.int32)[:, None]
        here &= jnp.arange(found.path.shape[0], dtype=jnp.int32) < found.length
        column = found.path[:, 1]
        first = jnp.min(jnp.where(here, column, shape.target), axis=1)
        last = jnp.max(jnp.where(here, column, -1), axis=1)
        return (first + last) // 2

    return jax.vmap(of_pair)(_patches(d, rows, columns, shape))
