"""Linear maps of frames whose transposes are written out.

    every_second  x₀ x₂ x₄ …, and R rows from one on
    interleaved   e₀ o₀ e₁ o₁ …
    window_sums   y_i = Σ_m w_m e_{stride·i + m},  e = x continued beyond both ends

Each takes vectors by component, tuples of f[T, J]. JAX transposes every slice to the whole array
padded with zeros, and XLA then looks at every element to see whether it is padding; here a
transpose is one pass over the rows. O(T·J).
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmotion.multiresolution.linear import linear
from jaxmotion.multiresolution.parts import Parts

_slice = partial(jax.lax.dynamic_slice_in_dim, axis=0)
_update = partial(jax.lax.dynamic_update_slice_in_dim, axis=0)


class Ends(NamedTuple):
    """How x f[N, J] goes on, linearly: before its first row by F rows, ``front`` f[F, R] times its
    first R; and from row ``stop`` on by B, ``back`` f[B, R] times the R from ``start`` on."""

    front: Array
    back: Array
    start: Array
    stop: Array


def every_second(x: Parts, start: Array, rows: int) -> tuple[Parts, Parts]:
    """Every second row from the first on, and ``rows`` rows from ``start`` on."""

    def change(start: Array, x: Parts) -> tuple[Parts, Parts]:
        return tuple(y[::2] for y in x), tuple(_slice(y, start, rows) for y in x)

    def pull(start: Array, pull: tuple[Parts, Parts]) -> tuple[Parts]:
        return (tuple(back(e, some, start) for e, some in zip(*pull, strict=True)),)

    def back(even: Array, some: Array, start: Array) -> Array:
        whole = _merged(even, jnp.zeros_like(even[: len(x[0]) // 2]))
        return _added_rows(whole, some, start)

    return linear(change, pull, (start,), (x,))


def interleaved(even: Parts, odd: Parts, rows: int) -> Parts:
    """even₀ odd₀ even₁ …, the first ``rows`` of them: of K and K − 1 rows, or K and K."""

    def change(even: Parts, odd: Parts) -> Parts:
        return tuple(_merged(e, o)[:rows] for e, o in zip(even, odd, strict=True))

    def pull(pull: Parts) -> tuple[Parts, Parts]:
        return (
            tuple(_longer(y[::2], len(even[0])) for y in pull),
            tuple(_longer(y[1::2], len(odd[0])) for y in pull),
        )

    return linear(change, pull, (), (even, odd))


def _longer(x: Array, rows: int) -> Array:
    """x with rows of zeros to have so many."""
    missing = rows - len(x)
    return jnp.concatenate([x, jnp.zeros((missing, *x.shape[1:]), x.dtype)]) if missing else x


def _merged(even: Array, odd: Array) -> Array:
    pairs = jnp.stack([even[: len(odd)], odd], axis=1).reshape(-1, *even.shape[1:])
    return jnp.concatenate([pairs, even[len(odd) :]])


def window_sums(
    x: Parts, weights: tuple[float, ...] | tuple[Array, ...], ends: Ends, stride: int = 1
) -> Parts:
    """Σ_m w_m e_{stride·i + m} for as many i as there are rows; ``stride`` 1 or 2. The weights are
    numbers (then ``ends`` pass no gradient), or f[rows, 1] where they differ by row."""

    def value(ends: Ends, x: Parts) -> Parts:
        return tuple(_sums(y, weights, ends, stride) for y in x)

    def pull(ends: Ends, pull: Parts) -> tuple[Parts]:
        return (tuple(_pulled(y, numbers, ends, stride, len(x[0])) for y in pull),)

    numbers = [w for w in weights if isinstance(w, float)]
    if len(numbers) < len(weights):
        return value(ends, x)
    return linear(value, pull, (ends,), (x,))


def _sums(x: Array, weights: tuple, ends: Ends, stride: int) -> Array:
    """Rows whose window lies within x by slices, the others one by one."""
    front, back, taps = len(ends.front), len(ends.back), len(weights)
    rows = (len(x) + front + back - taps) // stride + 1
    first, last = -(-front // stride), (front + len(x) - taps) // stride + 1
    stop = ends.stop + front
    before = _combined(ends.front, x[: ends.front.shape[1]])
    beyond = _combined(ends.back, _slice(x, ends.start, ends.back.shape[1]))

    def some(i: Array) -> Array:
        e = stride * i[:, None] + jnp.arange(taps)
        own = _rows(x, e - front) + _rows(before, e)
        behind = (e >= stop) & (e < stop + back)
        continued = jnp.where(behind[:, :, None], _rows(beyond, e - stop), own)
        w = [w if isinstance(w, float) else w[i] for w in weights]
        return sum((v * continued[:, m] for m, v in enumerate(w)), start=jnp.zeros((), x.dtype))

    def inner() -> Array:
        return sum(
            (
                (w if isinstance(w, float) else w[first:last])
                * x[stride * first - front + m :][: stride * (last - first - 1) + 1 : stride]
                for m, w in enumerate(weights)
            ),
            start=jnp.zeros((), x.dtype),
        )

    by_end = -((taps - 1 - stop) // stride), (back + taps - 2) // stride + 1
    return _assembled(rows, (first, last), inner, some, [by_end])


def _pulled(y: Array, weights: list[float], ends: Ends, stride: int, rows: int) -> Array:
    """The transpose of :func:`_sums` of so many rows, likewise."""
    (front, reach), back = ends.front.shape, len(ends.back)
    stop = ends.stop

    def spread(e: Array) -> Array:
        i = e[:, None] - jnp.arange(len(weights))
        whole = jnp.where(i % stride == 0, i // stride, -1)
        return jnp.sum(jnp.asarray(weights, y.dtype)[:, None] * _rows(y, whole), axis=1)

    before, beyond = spread(jnp.arange(front)), spread(stop + front + jnp.arange(back))

    def some(j: Array) -> Array:
        replaced = (j >= stop) & (j < stop + back)
        own = jnp.where(replaced[:, None], 0, spread(j + front))
        by_front = _rows(_combined(ends.front.T, before), j)
        return own + by_front + _rows(_combined(ends.back.T, beyond), j - ends.start)

    # Row stride·k + c takes the weights q, q + stride, … of the sums from k + shift backwards.
    classes = [((c + front) % stride, (c + front) // stride) for c in range(stride)]
    longest = -(-len(weights) // stride)
    lowest, highest = classes[0][1], classes[-1][1]
    first, last = max(longest - 1 - lowest, 0), min(len(y) - highest, rows // stride)

    def inner() -> Array:
        sums = [
            sum(
                (
                    w * y[first + shift - m : last + shift - m]
                    for m, w in enumerate(weights[q::stride])
                ),
                start=jnp.zeros((), y.dtype),
            )
            for q, shift in classes
        ]
        return jnp.stack(sums, axis=1).reshape(-1, y.shape[1])

    near = [(0, reach), (ends.start, ends.back.shape[1]), (stop, back)]
    return _assembled(rows, (stride * first, stride * last), inner, some, near)


def _assembled(
    rows: int,
    within: tuple[int, int],
    inner: Callable[[], Array],
    some: Callable[[Array], Array],
    near: list[tuple[Array | int, int]],
) -> Array:
    """So many rows: inner() for those from ``within[0]`` to ``within[1]``, some(indices) for the
    rest and for those ``near`` an end, (first, how many)."""
    first, last = within
    if last <= first:
        return some(jnp.arange(rows))
    near = [(0, first), (last, rows - last), *near]
    sizes = [min(size, rows) for _, size in near]
    starts = [jnp.clip(start, 0, rows - size) for (start, _), size in zip(near, sizes, strict=True)]
    pairs = list(zip(starts, sizes, strict=True))
    few = some(jnp.concatenate([start + jnp.arange(size) for start, size in pairs]))
    middle = inner()
    x = _update(jnp.zeros((rows, *middle.shape[1:]), middle.dtype), middle, first)
    for (start, _), some_rows in zip(pairs, jnp.split(few, np.cumsum(sizes)[:-1]), strict=True):
        x = _update(x, some_rows, start)
    return x


def _rows(x: Array, index: Array) -> Array:
    """Some rows, zeros where there are none."""
    inside = (index >= 0) & (index < len(x))
    return jnp.where(inside[..., None], jnp.take(x, index, axis=0, mode="clip"), 0)


def _added_rows(x: Array, rows: Array, start: Array | int) -> Array:
    return _update(x, _slice(x, start, len(rows)) + rows, start)


def _combined(matrix: Array, rows: Array) -> Array:
    """matrix @ rows, of a handful of rows."""
    return jnp.sum(matrix[:, :, None] * rows, axis=1)
