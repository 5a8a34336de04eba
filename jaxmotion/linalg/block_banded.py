"""Symmetric positive definite block-banded systems: Cholesky factors in O(T d^3).

    blocks[t, k] = P[t + k, t],   k = 0 .. w         d x d blocks, one block column of P a row

    factor    S_t = P_tt - sum_k G_{t,t-k} G_{t,t-k}^T,  S_t^-1 = R_t^T R_t      Schur complement
              G_{t+k,t} = (P_{t+k,t} - sum_l G_{t+k,t-l} G_{t,t-l}^T) R_t^T
              L_{t+k,t} = G_{t+k,t} R_t
    solve     z_t = b_t - sum_k L_{t,t-k} z_{t-k}
              x_t = R_t^T R_t z_t - sum_k L_{t+k,t}^T x_{t+k}
    inverse   Z_{t+k,t} = -sum_l Z_{t+k,t+l} L_{t+l,t}
              Z_tt = R_t^T R_t - sum_l L_{t+l,t}^T Z_{t+l,t}
    log det   -2 sum_t sum_i log (R_t)_ii

with k, l = 1 .. w, R_t the inverse of the lower Cholesky factor of S_t, L unit lower block
triangular and Z = P^-1, of which only the band of P is formed (Takahashi, Fagan and Chin, 1973; the
block form as in Meurant, 1992). Blocks below the last row of P are ignored.

Shapes: ``blocks (T, w + 1, d, d, *k)`` and ``b (T, d, *lanes)``, each axis of ``k`` equal to that
lane axis or 1. Lanes are independent systems solved side by side, and the fast way to have many:
they come last, so that every operation on a component of a block is one long vector. The bandwidth
w is static and small. Blocks up to 4 x 4 are unrolled into component arithmetic, larger ones go
through LAPACK. Cost O(T w^2 d^3) to factor, O(T w d^2) to solve, a lane.

Sharp bits: P must be positive definite, else an error with ``throw=True`` and a not-a-number
result with ``throw=False``. Diagonal blocks must be symmetric; derivatives are those of symmetric
changes. Digits are lost as the condition of P. Differentiable in blocks and right-hand side, in
both modes; solve and log-determinant have implicit derivatives of any order.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxmotion._checks import require, static
from jaxmotion._portable import Portable
from jaxmotion._types import AnyArray

_LARGEST_UNROLLED = 4


class BlockBandedFactor(Portable):
    """L and the inverse roots of D in the factor of P.

    **Fields:** ``multipliers``: f[T, w, d, d, *k], ``multipliers[t, k-1] = L[t + k, t]``;
    ``roots``: f[T, d, d, *k], ``roots[t] = R_t``, with ``R_t S_t R_t^T = I``.
    """

    multipliers: Float[Array, "time w d d *k"]
    roots: Float[Array, "time d d *k"]


@static("throw")
def block_banded_factor(
    blocks: Float[AnyArray, "time band d d *k"], *, throw: bool = True
) -> BlockBandedFactor:
    """Factor P.

    O(T w² d³) a lane. Differentiable, as a scan of length T.

    **Arguments:** ``blocks``: f[T, w + 1, d, d, *k], of P: ``blocks[t, k] = P[t + k, t]``;
    ``throw``: whether a P that is not positive definite is an error, else the factor is not a
    number.
    **Returns:** :class:`BlockBandedFactor`.
    **Raises:** with ``throw``, ``ValueError`` when P is not positive definite, at run time when it
    is traced.
    """
    return _checked_factor(blocks, throw, "block_banded_factor")


def _checked_factor(
    blocks: Float[AnyArray, "time band d d *k"], throw: bool, caller: str
) -> BlockBandedFactor:
    factor = _factor(blocks)
    if not throw:
        return factor
    message = f"{caller}: blocks: the block-banded matrix is not positive definite"
    return require(factor, ~jnp.all(jnp.isfinite(factor.roots)), message)


def block_banded_matvec(
    blocks: Float[AnyArray, "time band d d *k"], x: Float[AnyArray, "rows size *lanes"]
) -> Float[Array, "rows size *lanes"]:
    """``P x``.

    O(T w d²) a lane. Differentiable.

    **Arguments:** ``blocks``: f[T, w + 1, d, d] or f[T, w + 1, d, d, *k], P; ``x``: f[T, d,
    *lanes].
    **Returns:** f[T, d, *lanes].
    **Raises:** ``ValueError`` for shapes that do not fit.
    """
    blocks = _aligned(blocks, x)
    apply, apply_transposed = jax.vmap(_apply), jax.vmap(_apply_transposed)
    total = apply(blocks[:, 0], x)
    for k in range(1, min(blocks.shape[1], x.shape[0])):
        below = blocks[:-k, k]
        total = total.at[k:].add(apply(below, x[:-k]))
        total = total.at[:-k].add(apply_transposed(below, x[k:]))
    return total


@static("throw")
def block_banded_solve(
    blocks: Float[AnyArray, "time band d d *k"],
    b: Float[AnyArray, "rows size *lanes"],
    *,
    throw: bool = True,
) -> Float[Array, "rows size *lanes"]:
    """Solve ``P x = b``.

    O(T w² d³) to factor, O(T w d²) to solve, a lane. Derivatives are implicit, of any order.

    **Arguments:** ``blocks``: f[T, w + 1, d, d] or f[T, w + 1, d, d, *k], P; ``b``: f[T, d,
    *lanes]; ``throw``: as :func:`block_banded_factor`.
    **Returns:** f[T, d, *lanes].
    **Raises:** ``ValueError`` for shapes that do not fit; as :func:`block_banded_factor`.
    """
    blocks = _aligned(blocks, b)
    factor = _checked_factor(lax.stop_gradient(blocks), throw, "block_banded_solve")

    def solve(_, b):
        return block_banded_substitute(factor, b)

    return lax.custom_linear_solve(partial(block_banded_matvec, blocks), b, solve, symmetric=True)


def block_banded_log_det(blocks: Float[AnyArray, "time band d d *k"]) -> Float[Array, "*k"]:
    """``log det P``.

    O(T w² d³) a lane. Its derivative is read off the selected inverse.

    **Arguments:** ``blocks``: f[T, w + 1, d, d, *k], P.
    **Returns:** f[*k]; not a number when P is not positive definite.
    """
    return _log_det(blocks)


@jax.custom_jvp
def _log_det(blocks: Float[Array, "time band d d *k"]) -> Float[Array, "*k"]:
    diagonal = jnp.diagonal(_factor(blocks).roots, axis1=1, axis2=2)
    return -2 * jnp.sum(jnp.log(diagonal), axis=(0, -1))


@_log_det.defjvp
def _log_det_jvp(primals, tangents):
    (blocks,), (change,) = primals, tangents
    inverse = block_banded_selected_inverse(_factor(blocks))
    rate = jnp.sum(jnp.where(_inside(blocks), change * inverse, 0), axis=(0, 2, 3))
    return _log_det(blocks), 2 * jnp.sum(rate, axis=0) - rate[0]


@jax.jit
def block_banded_selected_inverse(
    factor: BlockBandedFactor,
) -> Float[Array, "time band d d *k"]:
    """The band of ``P^-1``.

    O(T w² d³) a lane. Differentiable, as a scan.

    **Arguments:** ``factor``: of P.
    **Returns:** f[T, w + 1, d, d, *k], stored as ``blocks`` is, zero below the last row.
    """
    w = factor.multipliers.shape[1]
    pivots = jax.vmap(_multiply_transposed_left)(factor.roots, factor.roots)

    def column(window, inputs):
        # window[r][c] = Z[t+1+r, t+1+c] for c <= r < w.
        lower, pivot = inputs

        def z(r, c):
            return window[r][c] if c <= r else jnp.swapaxes(window[c][r], 0, 1)

        below = [
            -sum((_multiply(z(i, k), lower[k]) for k in range(w)), start=zero) for i in range(w)
        ]
        for k in range(w):
            pivot = pivot - _multiply_transposed_left(lower[k], below[k])
        band = [pivot, *below]
        grown = [[band[0]], *([band[r], *window[r - 1]] for r in range(1, w))]
        return grown[:w], tuple(band)

    zero = jnp.zeros_like(factor.roots[0])
    start = [[zero] * (r + 1) for r in range(w)]
    _, band = lax.scan(column, start, (factor.multipliers, pivots), reverse=True)
    blocks = jnp.stack(band, axis=1)
    return jnp.where(_inside(blocks), blocks, 0)


@jax.jit
def block_banded_substitute(
    factor: BlockBandedFactor, b: Float[AnyArray, "time d *lanes"]
) -> Float[Array, "time d *lanes"]:
    """Solve ``P x = b`` given the factor.

    O(T w d²) a lane. Differentiable, as two scans.

    **Arguments:** ``factor``: of P; ``b``: f[T, d, *lanes].
    **Returns:** f[T, d, *lanes].
    """
    w = factor.multipliers.shape[1]

    def forward(owed, inputs):
        # owed[k]: subtracted from b at row t + k.
        lower, b = inputs
        z = b - owed[0] if w else b
        taken = [_apply(lower[k], z) for k in range(w)]
        return [taken[k] + owed[k + 1] if k + 1 < w else taken[k] for k in range(w)], z

    def backward(after, inputs):
        lower, y = inputs
        x = y - sum(_apply_transposed(lower[k], after[k]) for k in range(w))
        return [x, *after][:w], x

    zero = jnp.zeros_like(b[0])
    _, z = lax.scan(forward, [zero] * w, (factor.multipliers, b))
    y = jax.vmap(_apply_transposed)(factor.roots, jax.vmap(_apply)(factor.roots, z))
    return lax.scan(backward, [zero] * w, (factor.multipliers, y), reverse=True)[1]


@jax.jit
def _factor(blocks: Float[AnyArray, "time band d d *k"]) -> BlockBandedFactor:
    """Right-looking elimination; the carry holds what earlier columns take off the next w ones."""
    w = blocks.shape[1] - 1

    def column(owed, block):
        # owed[c][r]: subtracted from P[t+r, t+c], for c <= r < w.
        left = [block[r] - owed[0][r] if r < w else block[r] for r in range(w + 1)]
        root = _inverse_cholesky(left[0])
        under = [_multiply_transposed_right(left[r], root) for r in range(1, w + 1)]

        def taken(c, r):
            product = _multiply_transposed_right(under[r], under[c])
            return product + owed[c + 1][r + 1] if r + 1 < w else product

        owed = [[taken(c, r) if c <= r else None for r in range(w)] for c in range(w)]
        return owed, (root, tuple(under))

    blocks = jnp.where(_inside(blocks), blocks, 0)
    zero = jnp.zeros_like(blocks[0, 0])
    start = [[zero if c <= r else None for r in range(w)] for c in range(w)]
    roots, under = lax.scan(column, start, blocks)[1]
    if not w:
        return BlockBandedFactor(jnp.zeros_like(blocks[:, :0]), roots)
    lower = [jax.vmap(_multiply)(block, roots) for block in under]
    return BlockBandedFactor(jnp.stack(lower, axis=1), roots)


def _inverse_cholesky(s: Float[Array, "d d *k"]) -> Float[Array, "d d *k"]:
    """R, lower triangular with ``R s R^T = I``; not a number where s is not positive definite."""
    d = s.shape[0]
    if d > _LARGEST_UNROLLED:
        lower = jnp.linalg.cholesky(jnp.moveaxis(s, (0, 1), (-2, -1)))
        eye = jnp.broadcast_to(jnp.eye(d, dtype=s.dtype), lower.shape)
        root = lax.linalg.triangular_solve(lower, eye, left_side=True, lower=True)
        return jnp.moveaxis(root, (-2, -1), (0, 1))
    zero = jnp.zeros_like(s[0, 0])
    low = [[zero] * d for _ in range(d)]
    root = [[zero] * d for _ in range(d)]
    for j in range(d):
        pivot = lax.rsqrt(s[j, j] - sum((low[j][k] ** 2 for k in range(j)), start=zero))
        for i in range(j + 1, d):
            low[i][j] = (s[i, j] - sum(low[i][k] * low[j][k] for k in range(j))) * pivot
        for c in range(j):
            root[j][c] = -pivot * sum(low[j][k] * root[k][c] for k in range(c, j))
        root[j][j] = pivot
    return jnp.stack([jnp.stack(row) for row in root])


# Products of small blocks with lanes behind them: (d, d, *k) times (d, d, *k) or (d, *lanes).
# The sum over the inner index is unrolled, so that it fuses into one pass over the lanes.


def _multiply(a: Array, b: Array) -> Array:
    if a.shape[0] > _LARGEST_UNROLLED:
        return jnp.einsum("ij...,jk...->ik...", a, b)
    return sum((a[:, j, None] * b[j] for j in range(1, a.shape[1])), start=a[:, 0, None] * b[0])


def _multiply_transposed_left(a: Array, b: Array) -> Array:
    return _multiply(jnp.swapaxes(a, 0, 1), b)


def _multiply_transposed_right(a: Array, b: Array) -> Array:
    return _multiply(a, jnp.swapaxes(b, 0, 1))


def _apply(a: Array, x: Array) -> Array:
    if a.shape[0] > _LARGEST_UNROLLED:
        return jnp.einsum("ij...,j...->i...", a, x)
    return sum((a[:, j] * x[j] for j in range(1, a.shape[1])), start=a[:, 0] * x[0])


def _apply_transposed(a: Array, x: Array) -> Array:
    return _apply(jnp.swapaxes(a, 0, 1), x)


def _inside(blocks: Array) -> Array:
    """True where the block ``[t, k]`` is a row of P, that is ``t + k < T``."""
    time, band = blocks.shape[:2]
    inside = jnp.arange(time)[:, None] + jnp.arange(band) < time
    return inside.reshape(time, band, *[1] * (blocks.ndim - 2))


def _aligned(blocks: AnyArray, b: AnyArray) -> AnyArray:
    """Give shared blocks the lane axes of ``b``; check that the two fit."""
    lanes = b.shape[2:]
    if blocks.ndim == 4:
        blocks = blocks.reshape(*blocks.shape, *[1] * len(lanes))
    k = blocks.shape[4:]
    fits = len(k) == len(lanes) and all(s in (1, n) for s, n in zip(k, lanes, strict=True))
    if blocks.ndim < 4 or (blocks.shape[0], *blocks.shape[2:4]) != (*b.shape[:2], b.shape[1]):
        fits = False
    if not fits:
        raise ValueError(
            f"blocks {blocks.shape} do not fit the right-hand side {b.shape}: want blocks "
            "(T, w + 1, d, d) or (T, w + 1, d, d, *k) and right-hand side (T, d, *lanes), "
            "axes of k 1 or equal"
        )
    return blocks
