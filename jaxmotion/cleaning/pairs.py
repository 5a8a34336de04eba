"""Distances of words and targets, as far as they are known: warped, or bounded from below.

On as many devices as there are: each has some of a block's words, and all targets. What is computed
goes through ``jax.shard_map`` over the axis of devices that arrays begin with, of one too; nothing
goes from device to device, and each does what one alone would do.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float, Int

from jaxmotion.cleaning.bound import WordShape, least_distances
from jaxmotion.timing import dtw, pose_distance

_LANES = 1024  # pairs that are warped at once, by each device


def devices() -> Mesh:
    """Those of this process, or the one that is the default."""
    chosen = jax.config.jax_default_device  # type: ignore[attr-defined]
    found = [chosen] if isinstance(chosen, jax.Device) else jax.local_devices(backend=chosen)
    return Mesh(np.array(found), ("device",))


class Pool(NamedTuple):
    """Clips end to end: ``poses`` f[P, J, 4], or f[P, J, 6] of points, padded; of every target
    that begins at a frame ``clip`` i[P] and ``frame`` i[P] in it, and whether it fits."""

    poses: Array
    clip: np.ndarray
    frame: np.ndarray
    fits: np.ndarray


def pooled(
    textures: Sequence[np.ndarray],
    numbers: Sequence[int],
    shape: WordShape,
    *,
    size: int,
    dtype: np.dtype,
    mesh: Mesh,
) -> Pool:
    """The pool of clips' textures f[T, J, …], which have these ``numbers``, filled up to ``size``
    frames."""
    lengths = [len(x) for x in textures]
    frames = np.concatenate([np.arange(n) for n in lengths])
    clip, ends = np.repeat(np.array(numbers, int), lengths), np.repeat(lengths, lengths)
    fits = frames + shape.target <= ends
    fill = size - len(frames)
    poses = np.concatenate(textures).astype(dtype, copy=False)
    poses = np.pad(poses, ((0, fill), (0, 0), (0, 0)), mode="edge")
    clip, frames, fits = (np.pad(x, (0, fill)) for x in (clip, frames, fits))
    return Pool(jax.device_put(poses, NamedSharding(mesh, PartitionSpec())), clip, frames, fits)


class Pairs:
    """What is known of the distances of a block of words from all targets: ``exact`` f[B, P], +inf
    where not ``done``; ``least`` f[B, P], the bounds where it is not, +inf where nothing fits.

    ``d``: f[D, R, P], the frames of each device's words from all frames; ``places``: i[D, B/D], the
    row that each word begins at; ``words``: how many of them count."""

    def __init__(
        self, d: Array, places: np.ndarray, shape: WordShape, words: int, pool: Pool, mesh: Mesh
    ) -> None:
        self.d, self.places, self.shape, self.fits = d, places.astype(np.int32), shape, pool.fits
        self.mesh = mesh
        bounds = np.asarray(_bounds(d, self.places, shape, mesh))
        bounds = bounds.reshape(places.size, -1)[:words]
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
        devices, words = self.places.shape
        ends = np.searchsorted(word, words * np.arange(1, devices + 1))[:, None]
        firsts = np.append(0, ends[:-1])[:, None]
        for begin in range(0, int((ends - firsts).max()), _LANES):
            at = firsts + begin + np.arange(_LANES)
            inside = at < ends
            at = np.where(inside, at, np.minimum(firsts, len(word) - 1))
            found = np.asarray(_costs(self.d, *self._lanes(word[at], target[at]), *self._static))
            w, t = word[at[inside]], target[at[inside]]
            self.exact[w, t] = self.least[w, t] = found[inside]
        self.done[word, target] = True
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
        filled = np.pad(targets, ((0, self.places.size - words), (0, 0)), mode="edge")
        w = np.repeat(np.arange(self.places.size), k).reshape(len(self.places), -1)
        lanes = self._lanes(w, filled.reshape(w.shape))
        found = np.asarray(_middles(self.d, *lanes, *self._static))
        return found.reshape(self.places.size, k, -1)[:words]

    @property
    def _static(self) -> tuple[WordShape, Mesh]:
        return self.shape, self.mesh

    def _lanes(self, w: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First row and column of pairs i[D, L]."""
        rows = np.take_along_axis(self.places, w % self.places.shape[1], axis=1)
        return rows, np.minimum(t, self.d.shape[-1] - self.shape.target).astype(np.int32)


def _on_each(function: Callable, mesh: Mesh, shared: int = 0) -> Callable:
    """The function on every device's part of the arrays; the last ``shared`` are each one's."""

    def one(*arrays: Any) -> Array:
        own = len(arrays) - shared
        return function(*(x[0] for x in arrays[:own]), *arrays[own:])[None]

    def all_of_them(*arrays: Any) -> Array:
        apart, whole = PartitionSpec("device"), PartitionSpec()
        specs = (len(arrays) - shared) * (apart,) + shared * (whole,)
        return jax.shard_map(one, mesh=mesh, in_specs=specs, out_specs=apart, check_vma=False)(
            *arrays
        )

    return all_of_them


@partial(jax.jit, static_argnames=("trim", "mesh"))
def frame_distances(
    words: Float[Any, "device row joint _"], pool: Array, trim: int, mesh: Mesh
) -> Float[Array, "device row target"]:
    """Trimmed distances, of frames of words from all frames of the pool: of poses, or of points."""
    return _on_each(partial(_frame_distances, trim=trim), mesh, shared=1)(words, pool)


def _frame_distances(words: Array, pool: Array, trim: int) -> Float[Array, "row target"]:
    if words.shape[-1] == 4:
        return pose_distance(words, pool, trim=trim)

    def of_frame(points: Array) -> Float[Array, " target"]:
        terms = jnp.sum((pool - points) ** 2, axis=-1)
        return jnp.sum(terms, axis=-1) - jnp.sum(lax.top_k(terms, trim)[0], axis=-1)

    return lax.map(of_frame, words)


@partial(jax.jit, static_argnums=(2, 3))
def _bounds(d: Array, starts: Array, shape: WordShape, mesh: Mesh) -> Array:
    return _on_each(partial(least_distances, shape=shape), mesh)(d, starts)


def _patches(d: Array, rows: Array, columns: Array, shape: WordShape) -> Array:
    sizes = shape.length, shape.target
    return jax.vmap(lambda i, j: lax.dynamic_slice(d, (i, j), sizes))(rows, columns)


def _warped(cost: Array, shape: WordShape):
    return dtw(
        cost=cost, step_pattern="slope3", open_end=True, min_matched=shape.least, normalize="mean"
    )


@partial(jax.jit, static_argnums=(3, 4))
def _costs(
    d: Array, rows: Array, columns: Array, shape: WordShape, mesh: Mesh
) -> Float[Array, "device pair"]:
    """Distances of words that begin at those rows and targets at those columns."""

    def of_pairs(d: Array, rows: Array, columns: Array) -> Array:
        return jax.vmap(lambda cost: _warped(cost, shape).cost)(_patches(d, rows, columns, shape))

    return _on_each(of_pairs, mesh)(d, rows, columns)


@partial(jax.jit, static_argnums=(3, 4))
def _middles(
    d: Array, rows: Array, columns: Array, shape: WordShape, mesh: Mesh
) -> Int[Array, "device pair frame"]:
    """The middle of the target's frames that stand beside each frame of the word."""

    def of_pair(cost: Array) -> Array:
        found = _warped(cost, shape)
        here = found.path[:, 0] == jnp.arange(shape.length, dtype=jnp.int32)[:, None]
        here &= jnp.arange(found.path.shape[0], dtype=jnp.int32) < found.length
        column = found.path[:, 1]
        first = jnp.min(jnp.where(here, column, shape.target), axis=1)
        last = jnp.max(jnp.where(here, column, -1), axis=1)
        return (first + last) // 2

    def of_pairs(d: Array, rows: Array, columns: Array) -> Array:
        return jax.vmap(of_pair)(_patches(d, rows, columns, shape))

    return _on_each(of_pairs, mesh)(d, rows, columns)
