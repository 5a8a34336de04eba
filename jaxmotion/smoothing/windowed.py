"""Smoothing in overlapping windows, cross-faded (Eom, Choi and Noh, 2019, section 5.1).

    x_k   the LGS of frames  k stride .. k stride + window - 1,  each window on its own
    x     x_k where one window reaches; where two do, (1 - s) x_k + s x_{k+1}

    s = 1 / (1 + exp(-u)),  u evenly from -steepness to +steepness over the overlapping frames

Shapes: y and x ``(T, *channels)``; the windows ride along as one more channel axis, so the
recursion runs over ``window`` frames whatever T is. Cost O(T) time and memory.

The paper windows (120 frames, stride 60) because its full solve grows with T^4. ``lgs`` is O(T)
already and exact: windows are for its results and for shorter recursions on parallel machines.
The paper does not give the sigmoid's steepness; 6 reaches within 0.3 % of each end.

Sharp bits: a window knows nothing beyond its ends. Unit scale, noise of std 0.15: off the full
solve by at most 0.001 at lam sigma = 10, by 0.1 at 100; wrong beyond. The last window is filled up
with missing frames: for order 1, whose printed C counts the end differences once, its last
difference then counts twice. Every window needs data at two or more frames (order 1: one).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion._checks import no_module, static
from jaxmotion._program import one_program
from jaxmotion._types import ArrayLike, ScalarLike
from jaxmotion.smoothing.lgs import lgs


@static("window", "stride", "order")
def windowed_lgs(
    y: ArrayLike,
    lam: ArrayLike,
    sigma: ArrayLike,
    *,
    window: int = 120,
    stride: int | None = None,
    steepness: float = 6.0,
    order: int = 2,
    weights: ArrayLike | None = None,
    scale: str = "half",
) -> Float[Array, "frames *channels"]:
    """Posterior mean of the LGS, window by window.

    O(T). Differentiable in y, lam, sigma and weights, in both modes. Source: Eom et al. 2019, §5.1.

    **Arguments:** ``y``: f[T, *channels]; ``lam``, ``sigma``, ``order``, ``weights``, ``scale``: as
    :func:`~jaxmotion.smoothing.lgs`; ``window``: frames solved together, at least 4; a clip no
    longer than that is solved whole; ``stride``: frames from one window to the next, from half the
    window to the window less 2; None for half the window; ``steepness``: half the sigmoid's range,
    > 0.
    **Returns:** f[T, *channels], in y's dtype.
    **Raises:** ``ValueError`` where ``window``, ``stride``, ``steepness`` do not fit; as
    :func:`~jaxmotion.smoothing.lgs`, where "data at 2 or more distinct frames" is asked of every
    window.
    """
    no_module("windowed_lgs: y", y, "jaxmotion.smoothing.smooth_motion takes motions")
    y = jnp.asarray(y)
    stride = _checked_stride(window, stride)
    if not (steepness > 0 and np.isfinite(steepness)):
        raise ValueError(f"steepness={steepness}: want a positive number")
    for name, value in (("lam", lam), ("sigma", sigma)):
        if np.ndim(value) > max(y.ndim - 1, 0):
            raise ValueError(
                f"{name} has shape {np.shape(value)}: want a scalar or an array that broadcasts "
                f"to the channels of y, {y.shape[1:]}"
            )
    if y.ndim == 0 or y.shape[0] <= window:
        return lgs(y, lam, sigma, order=order, weights=weights, scale=scale).mean
    frames = y.shape[0]
    cut = (window, stride, 1 + -(-(frames - window) // stride))
    pieces = lgs(
        _cut(y, *cut),
        lam,
        sigma,
        order=order,
        weights=_cut_weights(weights, y.ndim, frames, cut),
        scale=scale,
    ).mean
    return _join(pieces, frames, stride, steepness)


def _checked_stride(window: int, stride: int | None) -> int:
    if window < 4:
        raise ValueError(f"window={window}: want at least 4 frames")
    if stride is None:
        return -(-window // 2)
    if not window <= 2 * stride <= 2 * (window - 2):
        raise ValueError(
            f"stride={stride}: want from {-(-window // 2)}, half the window, to {window - 2}"
        )
    return stride


def _cut(y: Array | np.ndarray, window: int, stride: int, count: int) -> Array | np.ndarray:
    """The windows, ``(window, count, ...)``; zeros beyond the clip. NumPy stays NumPy, whose
    values are checked at once."""
    missing = window + (count - 1) * stride - y.shape[0]
    pad = jnp.pad if isinstance(y, jax.Array) else np.pad
    y = pad(y, [(0, missing)] + [(0, 0)] * (y.ndim - 1))
    return y[np.arange(window)[:, None] + stride * np.arange(count)]


def _cut_weights(
    weights: ArrayLike | None, ndim: int, frames: int, cut: tuple[int, int, int]
) -> ArrayLike | None:
    """Weights of the windows, 0 beyond the clip; None where all are 1."""
    window, stride, count = cut
    if weights is None and frames == window + (count - 1) * stride:
        return None
    weights = np.ones(frames) if weights is None else weights
    if np.shape(weights)[:1] != (frames,) or np.ndim(weights) not in (1, ndim):
        raise ValueError(
            f"weights have shape {np.shape(weights)}: want ({frames},) or an array that broadcasts "
            "over the channels of y"
        )
    pieces = _cut(weights if isinstance(weights, jax.Array) else np.asarray(weights), *cut)
    return pieces.reshape(pieces.shape + (1,) * (ndim + 1 - pieces.ndim))


@one_program("frames", "stride")
def _join(x: Array, frames: int, stride: int, steepness: ScalarLike) -> Array:
    """Cross-fade windows ``(window, count, ...)`` into ``(window + (count - 1) stride, ...)``; the
    first ``frames`` of it."""
    window, count = x.shape[:2]
    overlap = window - stride
    u = jnp.asarray(steepness, x.dtype) * jnp.linspace(-1, 1, overlap, dtype=x.dtype)
    rise = jax.nn.sigmoid(u).reshape(overlap, *[1] * (x.ndim - 1))
    head, middle, tail = x[:overlap], x[overlap:stride], x[stride:]
    faded = (1 - rise) * tail[:, :-1] + rise * head[:, 1:]
    head = jnp.concatenate([head[:, :1], faded], axis=1)
    blocks = jnp.moveaxis(jnp.concatenate([head, middle], axis=0), 1, 0)
    joined = jnp.concatenate([blocks.reshape(count * stride, *x.shape[2:]), tail[:, -1]], axis=0)
    return joined[:frames]
