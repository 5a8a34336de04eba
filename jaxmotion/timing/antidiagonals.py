"""A matrix laid out for dynamic programming: strips of rows, each read along its anti-diagonals.

    strips[s, i, j]  = D[s h + i, j]                     h rows a strip; ∞ below the last row
    skewed[k, i]     = strip[i, k − i],  0 ≤ k < m + h − 1             ∞ outside the strip

The cells of an anti-diagonal i + j = k do not depend on each other, so a sweep takes one of them a
step as a vector of h numbers. Whole matrices have long anti-diagonals that are half empty and leave
the cache before they are used again; a strip's are short and nearly full. Strips follow each other,
each handed the last row of the one before. On 1000 x 1000 cells strips are 2 to 3 times as fast as
none. Cost O(n m); the trailing axes, if any, are carried along.
"""

import jax.numpy as jnp
from jaxtyping import Array

_MOST_ROWS = 200


def strip_rows(n: int, most: int = _MOST_ROWS) -> int:
    """h, the rows of each strip of a matrix of n rows."""
    return -(-n // -(-n // most))


def in_strips(matrix: Array, most: int = _MOST_ROWS) -> Array:
    """``(n, m, ...)`` to ``(strips, h, m, ...)`` with h at most ``most``."""
    n, m, *rest = matrix.shape
    h = strip_rows(n, most)
    padding = [(0, -n % h), (0, 0), *([(0, 0)] * len(rest))]
    return jnp.pad(matrix, padding, constant_values=jnp.inf).reshape(-1, h, m, *rest)


def skew(strip: Array) -> Array:
    """``(h, m, ...)`` to ``(m + h − 1, h, ...)``."""
    h, m, *rest = strip.shape
    padding = [(0, 0), (0, h), *([(0, 0)] * len(rest))]
    wide = jnp.pad(strip, padding, constant_values=jnp.inf)
    shifted = wide.reshape(h * (h + m), *rest)[: h * (h + m - 1)]
    return jnp.swapaxes(shifted.reshape(h, h + m - 1, *rest), 0, 1)


def unskew(skewed: Array, m: int) -> Array:
    """``(m + h − 1, h)`` back to ``(h, m)``."""
    h = skewed.shape[1]
    return jnp.pad(skewed.T.reshape(-1), (0, h)).reshape(h, h + m)[:, :m]


def entering(row: Array, h: int, outside: float | int) -> Array:
    """What a strip's sweep meets above its first row, step by step.

    ``row (m, ...)`` is the last row of the strip before. Entry k ``(m + h − 1, ...)`` stands above
    the cell that is taken next, (0, k + 1).
    """
    padding = [(0, h)] + [(0, 0)] * (row.ndim - 1)
    return jnp.pad(row[1:], padding, constant_values=outside)
