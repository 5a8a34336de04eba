"""Least distances that motion words can have: what lets a search leave most pairs out.

The distance of a word of N frames to a target of M is the mean of D along a path of 1 to R + 1
cells in every row i (R steps on end along one axis at most), of the columns

    max(⌊i/(R + 1)⌋, c − R − (R + 1)(N − 1 − i))  to  min(M − 1, (R + 1) i + R)

where c is the least last column. With m_i the least of D there, a mean is at least

    L = min over 1 ≤ w_i ≤ R + 1 of Σ w_i m_i / Σ w_i,   the θ where Σ g(m_i − θ) = 0,
    g(x) = x above 0, (R + 1) x below.

Newton's steps come down to it from the mean of m; after a few, θ + Σ g(m_i − θ)/N is no more than
L, as the slope is N at least. Sliding minima are made by doubling, a tile of columns at a time that
stays in a core's cache. O(N) a pair.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

_NEWTON = 3
_COLUMNS = 2048  # a tile
_ROUNDING = 1e-5  # of the bound, for what sums in float32 leave


class WordShape(NamedTuple):
    """Static: ``length`` N of words, ``target`` M of what they are compared with, the most steps on
    end along one axis ``run`` R, and ``least`` frames of the target to be matched, c + 1."""

    length: int
    target: int
    run: int
    least: int

    def columns(self, i: int) -> tuple[int, int]:
        """First and last column that a path may have in row i."""
        per_row = self.run + 1
        last_row = self.length - 1
        first = max(i // per_row, self.least - 1 - self.run - per_row * (last_row - i), 0)
        return first, min(self.target - 1, per_row * i + self.run)


def least_distances(
    d: Float[Array, "row target"], starts: Int[Array, " word"], shape: WordShape
) -> Float[Array, "word target"]:
    """L, or a little less, of the words that begin at rows ``starts`` of d, and targets that begin
    at every column; of those that go beyond the last column anything."""
    columns, beyond = d.shape[1], shape.target - 1
    tiles = -(-columns // _COLUMNS)
    fill = tiles * _COLUMNS + beyond - columns
    filled = jnp.pad(d, ((0, 0), (0, fill)), constant_values=jnp.inf)

    def one_tile(first: Array) -> Array:
        tile = lax.dynamic_slice_in_dim(filled, first, _COLUMNS + beyond, axis=1)
        return _of_tile(tile, starts, shape)

    found = lax.map(one_tile, _COLUMNS * jnp.arange(tiles, dtype=jnp.int32))
    return jnp.moveaxis(found, 0, 1).reshape(len(starts), -1)[:, :columns]


def _of_tile(
    d: Float[Array, "row column"], starts: Int[Array, " word"], shape: WordShape
) -> Float[Array, "word target"]:
    """L of the targets that end within the tile."""
    targets = d.shape[1] - shape.target + 1
    columns = [shape.columns(i) for i in range(shape.length)]
    slid: dict[int, Array] = {1: d}
    for first, last in columns:
        _slide(slid, last - first + 1)

    def of_word(start: Array) -> Array:
        minima = [
            lax.dynamic_slice(slid[last - first + 1], (start + i, np.int32(first)), (1, targets))[0]
            for i, (first, last) in enumerate(columns)
        ]
        return _least_mean(minima, shape)

    # Word after word: rows that are gathered for all of them are read number by number.
    return lax.map(of_word, starts)


def _least_mean(minima: list[Array], shape: WordShape) -> Float[Array, " target"]:
    """L of the least of D in every row."""
    one, most = (jnp.asarray(x, minima[0].dtype) for x in (1, shape.run + 1))
    theta = sum(minima) / shape.length
    for _ in range(_NEWTON):
        weights = [jnp.where(m < theta, most, one) for m in minima]
        theta = sum(w * m for w, m in zip(weights, minima, strict=True)) / sum(weights)
    away = [m - theta for m in minima]
    below = sum(jnp.where(x < 0, most * x, x) for x in away)
    return (1 - _ROUNDING) * (theta + jnp.minimum(below, 0) / shape.length)


def _slide(slid: dict[int, Array], width: int) -> None:
    """Add the minima over ``width`` columns on end to those there are."""
    half = 1
    while 2 * half <= width:
        _join(slid, 2 * half, half)
        half *= 2
    _join(slid, width, half)


def _join(slid: dict[int, Array], width: int, part: int) -> None:
    """Minima over ``width`` columns of two of ``part`` each, which overlap or meet."""
    if width not in slid:
        targets = slid[1].shape[1] - width + 1
        apart = width - part
        slid[width] = jnp.minimum(slid[part][:, :targets], slid[part][:, apart : apart + targets])
