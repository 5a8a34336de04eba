"""Symmetric positive definite banded systems: ``P = L D L^T`` in O(n).

    bands[j, i] = P[j + i, j],   i = 0 .. w          lower band storage, one row per column of P

    factor    d_j = P_jj - sum_k L_{j,j-k}^2 d_{j-k}
              L_{j+i,j} = (P_{j+i,j} - sum_k L_{j+i,j-k} L_{j,j-k} d_{j-k}) / d_j
    inverse   Z_{j+i,j} = [i = 0] / d_j - sum_k L_{j+k,j} Z_{j+i,j+k},   j = n-1 .. 0

with k = 1 .. w, L unit lower triangular, D = diag(d) and Z = P^-1, of which only the band of P is
formed (Takahashi, Fagan and Chin, 1973). Entries of ``bands`` below the last row of P are ignored.

Shapes: ``bands (n, w + 1)`` shared by all channels of ``b (n, *channels)``, or ``(n, w + 1, *k)``
with each axis of ``k`` equal to that channel axis or 1. The bandwidth w is static and small: the
recursions over it are unrolled. Cost O(n w^2) to factor, O(n w) per channel to solve.

Sharp bits: P must be positive definite, else an error with ``throw=True`` and a not-a-number result
with ``throw=False``.
Digits are lost as the condition of P: a float32 solve with second differences of weight 1e4 is
worthless, and ``difference_chain`` is the solver for those. Differentiable in bands and right-hand
side, in both modes and to any order; solving and log-determinant have implicit derivatives (one
solve, one selected inverse).
"""

from functools import partial

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from jaxmotion._checks import require, static
from jaxmotion._portable import Portable
from jaxmotion._types import AnyArray

_INDEFINITE = "bands: the banded matrix is not positive definite"


class BandedFactor(Portable):
    """``P = L D L^T``, L unit lower triangular, D diagonal.

    **Fields:** ``multipliers``: f[n, w, *k], ``multipliers[j, i-1] = L[j + i, j]``; ``pivots``:
    f[n, *k], ``pivots[j] = D_jj > 0``, not a number where P is not positive definite.
    """

    multipliers: Float[Array, "n w *k"]
    pivots: Float[Array, "n *k"]


@static("throw")
def banded_factor(bands: Float[AnyArray, "n band *k"], *, throw: bool = True) -> BandedFactor:
    """Factor ``P = L D L^T``.

    O(n w²). Differentiable, as a scan of length n.

    **Arguments:** ``bands``: f[n, w + 1, *k], of P: ``bands[j, i] = P[j + i, j]``; ``throw``:
    whether a P that is not positive definite is an error, else its pivots are not numbers.
    **Returns:** :class:`BandedFactor`.
    **Raises:** with ``throw``, ``ValueError`` when P is not positive definite, at run time when it
    is traced.
    """
    factor, indefinite = _factor(bands)
    return require(factor, indefinite, f"banded_factor: {_INDEFINITE}") if throw else factor


@jax.jit
def banded_matvec(bands: Float[AnyArray, "n band *k"], x: Float[AnyArray, "n *channels"]) -> Array:
    """``P x``.

    O(n w) a channel. Differentiable.

    **Arguments:** ``bands``: f[n, w + 1] or f[n, w + 1, *k], P; ``x``: f[n, *channels].
    **Returns:** f[n, *channels].
    **Raises:** ``ValueError`` for shapes that do not fit.
    """
    bands, x = _aligned(bands, x)
    total = bands[:, 0] * x
    for i in range(1, min(bands.shape[1], x.shape[0])):
        below = bands[:-i, i]
        total = total.at[i:].add(below * x[:-i]).at[:-i].add(below * x[i:])
    return total


@static("throw")
def banded_solve(
    bands: Float[AnyArray, "n band *k"], b: Float[AnyArray, "_ *channels"], *, throw: bool = True
) -> Array:
    """Solve ``P x = b``.

    O(n w²) to factor and O(n w) a channel. Derivatives are implicit, of any order and in both
    modes.

    **Arguments:** ``bands``: f[n, w + 1] or f[n, w + 1, *k], P; ``b``: f[n, *channels]; ``throw``:
    as :func:`banded_factor`.
    **Returns:** f[n, *channels], not a number where P is not positive definite.
    **Raises:** ``ValueError`` for shapes that do not fit; as :func:`banded_factor`.
    """
    bands, factor, indefinite = _aligned_factor(bands, b)
    if throw:  # of the factor, which is smaller than what is solved for
        factor = require(factor, indefinite, f"banded_solve: {_INDEFINITE}")
    return _solve(bands, factor, b)


@jax.jit
def _aligned_factor(bands: Array, b: Array) -> tuple[Array, BandedFactor, Bool[Array, ""]]:
    bands, _ = _aligned(bands, b)
    return bands, *_factor(lax.stop_gradient(bands))


@jax.jit
def _solve(bands: Array, factor: BandedFactor, b: Array) -> Array:
    def solve(_, b):
        return _substitute(factor, b)

    return lax.custom_linear_solve(partial(banded_matvec, bands), b, solve, symmetric=True)


def banded_log_det(bands: Float[AnyArray, "n band *k"]) -> Array:
    """``log det P``.

    O(n w²). Its derivative is read off the selected inverse.

    **Arguments:** ``bands``: f[n, w + 1, *k], P.
    **Returns:** f[*k]; not a number when P is not positive definite.
    """
    return _log_det(bands)


@jax.custom_jvp
def _log_det(bands: Float[AnyArray, "n band *k"]) -> Array:
    return jnp.sum(jnp.log(_factor(bands)[0].pivots), axis=0)


@_log_det.defjvp
def _log_det_jvp(primals, tangents):
    (bands,), (change,) = primals, tangents
    inside = _inside(bands)
    inverse = banded_selected_inverse(_factor(bands)[0])
    rate = jnp.where(inside, change * inverse, 0)
    return _log_det(bands), jnp.sum(2 * rate, axis=(0, 1)) - jnp.sum(rate[:, 0], axis=0)


@jax.jit
def banded_selected_inverse(factor: BandedFactor) -> Float[Array, "n band *k"]:
    """The band of ``P^-1``.

    O(n w²). Differentiable, as a scan.

    **Arguments:** ``factor``: of P.
    **Returns:** f[n, w + 1, *k], stored as ``bands`` is, zero below the last row.
    """
    w = factor.multipliers.shape[1]

    def column(window, inputs):
        # window[r][c] = Z[j+1+r, j+1+c] for c <= r < w.
        lower, pivot = inputs

        def z(r, c):
            return window[max(r, c)][min(r, c)]

        below = [-sum(lower[k] * z(i, k) for k in range(w)) for i in range(w)]
        diagonal = 1 / pivot - sum(lower[k] * below[k] for k in range(w))
        band = [diagonal, *below]
        grown = [[band[0]], *([band[r], *window[r - 1]] for r in range(1, w))]
        return grown[:w], jnp.stack(band)

    zero = jnp.zeros_like(factor.pivots[0])
    start = [[zero] * (r + 1) for r in range(w)]
    _, bands = lax.scan(column, start, (factor.multipliers, factor.pivots), reverse=True)
    return jnp.where(_inside(bands), bands, 0)


@jax.jit
def _factor(bands: Float[AnyArray, "n band *k"]) -> tuple[BandedFactor, Bool[Array, ""]]:
    """Right-looking elimination; the carry holds what earlier columns take off the next w ones.
    And whether some P is not positive definite."""
    w = bands.shape[1] - 1

    def column(owed, band):
        # owed[c][i]: subtracted from P[j+c+i, j+c], for 0 <= c, 0 <= i <= w-1-c.
        first = [*owed[0], 0] if w else [0]
        pivot = band[0] - first[0]
        under = [band[i] - first[i] for i in range(1, w + 1)]
        lower = [entry / pivot for entry in under]
        owed = [*(row for row in owed[1:]), []]
        owed = [
            [
                (owed[c][i] if i < len(owed[c]) else 0) + lower[c + i] * under[c]
                for i in range(w - c)
            ]
            for c in range(w)
        ]
        stacked = jnp.stack(lower) if w else jnp.zeros((0, *band.shape[1:]), band.dtype)
        return owed, (stacked, pivot)

    bands = jnp.where(_inside(bands), bands, 0)
    zero = jnp.zeros_like(bands[0, 0])
    start = [[zero] * (w - c) for c in range(w)]
    lower, pivots = lax.scan(column, start, bands)[1]
    definite = jnp.all(pivots > 0, axis=0)
    return BandedFactor(lower, jnp.where(definite, pivots, jnp.nan)), ~jnp.all(definite)


@jax.jit
def _substitute(factor: BandedFactor, b: Array) -> Array:
    w = factor.multipliers.shape[1]

    def forward(owed, inputs):
        # owed[i]: subtracted from b at row j + i.
        lower, pivot, b = inputs
        z = b - owed[0] if w else b
        owed = [(owed[i] if i < w else 0) + lower[i - 1] * z for i in range(1, w + 1)]
        return owed, z / pivot

    def backward(after, inputs):
        lower, z = inputs
        x = z - sum(lower[i] * after[i] for i in range(w))
        return [x, *after][:w], x

    zero = jnp.zeros_like(b[0])
    _, z = lax.scan(forward, [zero] * w, (factor.multipliers, factor.pivots, b))
    return lax.scan(backward, [zero] * w, (factor.multipliers, z), reverse=True)[1]


def _inside(bands: Array) -> Array:
    """True where the band entry ``[j, i]`` is a row of P, that is ``j + i < n``."""
    n, band = bands.shape[:2]
    inside = jnp.arange(n)[:, None] + jnp.arange(band) < n
    return inside.reshape(n, band, *[1] * (bands.ndim - 2))


def _aligned(bands: Array, b: Array) -> tuple[Array, Array]:
    """Give shared bands the channel axes of ``b``; check that the two fit."""
    channels = b.shape[1:]
    if bands.ndim == 2:
        bands = bands.reshape(*bands.shape, *[1] * len(channels))
    k = bands.shape[2:]
    fits = len(k) == len(channels) and all(s in (1, c) for s, c in zip(k, channels, strict=True))
    if bands.shape[0] != b.shape[0] or not fits:
        raise ValueError(
            f"bands {bands.shape} do not fit the right-hand side {b.shape}: want bands "
            "(n, w + 1) or (n, w + 1, *k) and right-hand side (n, *channels), axes of k 1 or equal"
        )
    return bands, b
