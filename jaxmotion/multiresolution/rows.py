"""Linear maps of frames whose transposes are written out.

    every_second  x₀ x₂ x₄ …, and R rows from one on
    interleaved   e₀ o₀ e₁ o₁ …
    window_sums   y_i = Σ_m w_m e_{stride·i + m},  e = x continued beyond both ends

Each takes vectors by component, f[T, J] each. JAX transposes every slice to the whole array
padded with zeros, and XLA then looks at every element to see whether it is padding; here a
transpose is one pass over the rows. O(T·J).
"""

from functools import partial
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmotion._autodiff import linear
from jaxmotion.quaternion.parts import Parts

Rows: TypeAlias = Float[Array, "row joint"]
Weights: TypeAlias = tuple[float, ...] | tuple[Float[Array, "row 1"], ...]

_slice = partial(jax.lax.dynamic_slice_in_dim, axis=0)
_update = partial(jax.lax.dynamic_update_slice_in_dim, axis=0)


class Ends(NamedTuple):
    """How x f[N, J] goes on, linearly: before its first row by F rows, ``front`` f[F, R] times its
    first R; and from row ``stop`` on by B, ``back`` f[B, R] times the R from ``start`` on."""

    front: Float[Array, "before near"]
    back: Float[Array, "behind near"]
    start: Int[Array, ""]
    stop: Int[Array, ""]


def every_second(x: Parts, start: Int[Array, ""], rows: int) -> tuple[Parts, Parts]:
    """Every second row from the first on, and ``rows`` rows from ``start`` on."""

    def change(start: Array, x: Parts) -> tuple[Parts, Parts]:
        return tuple(y[::2] for y in x), tuple(_slice(y, start, rows) for y in x)

    def pull(start: Array, pull: tuple[Parts, Parts]) -> tuple[Parts]:
        return (tuple(back(e, some, start) for e, some in zip(*pull, strict=True)),)

    def back(
        even: Float[Array, "half joint"], some: Float[Array, "near joint"], start: Array
    ) -> Rows:
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


def _longer(x: Float[Array, "given joint"], rows: int) -> Rows:
    """x with rows of zeros to have so many."""
    missing = rows - len(x)
    return jnp.concatenate([x, jnp.zeros((missing, *x.shape[1:]), x.dtype)]) if missing else x


def _merged(even: Float[Array, "even joint"], odd: Float[Array, "odd joint"]) -> Rows:
    pairs = jnp.stack([even[: len(odd)], odd], axis=1).reshape(-1, *even.shape[1:])
    return jnp.concatenate([pairs, even[len(odd) :]])


def window_sums(x: Parts, weights: Weights, ends: Ends, stride: int = 1) -> Parts:
    """Σ_m w_m e_{stride·i + m} for as many i as there are rows; ``stride`` 1 or 2. The weights are
    numbers (then ``ends`` pass no gradient), or f[rows, 1] where they differ by row."""

    def value(ends: Ends, x: Parts) -> Parts:
        return tuple(_sums(_continued(y, ends), weights, stride) for y in x)

    def pull(ends: Ends, pull: Parts) -> tuple[Parts]:
        rows = len(x[0]) + len(ends.front) + len(ends.back)
        return (tuple(_pulled(_spread(y, numbers, stride, rows), ends) for y in pull),)

    numbers = [w for w in weights if isinstance(w, float)]
    if len(numbers) < len(weights):
        return value(ends, x)
    return linear(value, pull, (ends,), (x,))


def _continued(x: Rows, ends: Ends) -> Float[Array, "longer joint"]:
    """x with F rows in front and room for B behind, all that ``ends`` says."""
    front, back = len(ends.front), len(ends.back)
    before = _combined(ends.front, x[: ends.front.shape[1]])
    longer = jnp.concatenate([before, x, jnp.zeros((back, *x.shape[1:]), x.dtype)])
    beyond = _combined(ends.back, _slice(x, ends.start, ends.back.shape[1]))
    return _update(longer, beyond, ends.stop + front)


def _pulled(pull: Float[Array, "longer joint"], ends: Ends) -> Rows:
    """The transpose of :func:`_continued`."""
    front, back = len(ends.front), len(ends.back)
    beyond = _slice(pull, ends.stop + front, back)
    x = _update(pull, jnp.zeros_like(beyond), ends.stop + front)[front : len(pull) - back]
    x = _added_rows(x, _combined(ends.front.T, pull[:front]), 0)
    return _added_rows(x, _combined(ends.back.T, beyond), ends.start)


def _added_rows(x: Rows, rows: Float[Array, "near joint"], start: Int[Array, ""] | int) -> Rows:
    return _update(x, _slice(x, start, len(rows)) + rows, start)


def _combined(
    matrix: Float[Array, "out near"], rows: Float[Array, "near joint"]
) -> Float[Array, "out joint"]:
    """matrix @ rows, of a handful of rows."""
    return jnp.sum(matrix[:, :, None] * rows, axis=1)


def _sums(x: Float[Array, "longer joint"], weights: Weights, stride: int) -> Rows:
    rows = (len(x) - len(weights)) // stride + 1
    return sum(
        (w * x[m : m + stride * (rows - 1) + 1 : stride] for m, w in enumerate(weights)),
        start=jnp.zeros((), x.dtype),
    )


def _spread(
    pull: Rows, weights: list[float], stride: int, rows: int
) -> Float[Array, "longer joint"]:
    """The transpose of :func:`_sums` of so many rows."""
    if stride == 2:
        even = _spread(pull, weights[::2], 1, (rows + 1) // 2)
        return _merged(even, _spread(pull, weights[1::2], 1, rows // 2))
    taps, given = len(weights), len(pull)
    reach = taps - 1
    spare = jnp.zeros((rows - given - reach, *pull.shape[1:]), pull.dtype)
    if given < 2 * taps:
        return jnp.concatenate([_padded_sum(pull, weights), spare])
    inner = sum(
        (w * pull[reach - m : given - m] for m, w in enumerate(weights)),
        start=jnp.zeros((), pull.dtype),
    )
    front = _padded_sum(pull[:reach], weights)[:reach]
    back = _padded_sum(pull[given - reach :], weights)[reach:]
    return jnp.concatenate([front, inner, back, spare])


def _padded_sum(pull: Rows, weights: list[float]) -> Float[Array, "longer joint"]:
    """Σ_m w_m x_{k−m}, zeros before and after x."""
    reach = len(weights) - 1
    return sum(
        (w * jnp.pad(pull, ((m, reach - m), (0, 0))) for m, w in enumerate(weights)),
        start=jnp.zeros((), pull.dtype),
    )
