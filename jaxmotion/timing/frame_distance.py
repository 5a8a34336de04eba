"""Distance between every frame of one clip and every frame of another.

    D[i, j] = √ Σ_f (x[i, f] − y[j, f])²     ``metric="euclidean"``
    D[i, j] =   Σ_f (x[i, f] − y[j, f])²     ``metric="sqeuclidean"``
    D[i, j] =   Σ_k θ(x[i, k], y[j, k])²     ``metric="pose"``, see :func:`pose_distance`

Shapes: x ``(n, f)``, y ``(m, f)`` (poses ``(n, J, 4)``, ``(m, J, 4)``), D ``(n, m)``; units are the
features' own (squared for ``"sqeuclidean"``). Cost O(n m f).

Differences are formed before they are squared. The expansion |x|² + |y|² − 2x·y costs a third less
but is off by √ε|x| where two frames agree (1e-8 in float64, 3e-4 in float32), and it is exactly the
agreeing frames that decide a warp. Sharp bit: the Euclidean distance has a kink where frames agree;
its gradient is zero there.
"""

from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Float

from jaxmotion._checks import counted, no_module, one_of
from jaxmotion._numerics import safe_sqrt
from jaxmotion._types import ArrayLike, Metric, ScalarLike
from jaxmotion.motion import Motion
from jaxmotion.timing.pose_distance import pose_distance, rotations_of

Given: TypeAlias = ArrayLike | Motion | None

_FEATURES_AT_ONCE = 32  # unrolled into one fused pass over the (n, m) accumulator
_ASIDE = 16  # frames more in memory, or features of 2^k frames share their lines of the cache


def frame_distance(
    x: ArrayLike | Motion, y: ArrayLike | Motion, metric: Metric | None = None
) -> Float[Array, "frames_x frames_y"]:
    """All distances between the frames of two clips.

    O(n m f). Differentiable in both modes and to any order; the Euclidean distance has a kink where
    frames agree, and the gradient 0 there.

    **Arguments:** ``x``: features f[n, f], or local rotations f[n, J, 4] with ``metric="pose"``;
    ``y``: features f[m, f], or local rotations f[m, J, 4]; or both of them motions, single clips of
    the same joints, whose rotations are compared; ``metric``: "euclidean", "sqeuclidean", "pose"
    (:func:`pose_distance`), or a function from (x, y) to f[n, m], for example
    ``functools.partial(pose_distance, trim=3)``; by default "pose" of motions and "euclidean" of
    arrays.
    **Returns:** f[n, m], in the features' unit, squared for "sqeuclidean".
    **Raises:** ``ValueError`` for shapes and motions that do not fit, an unknown metric, or one of
    features for motions.
    """
    x, y, metric = compared("frame_distance", x, y, metric, "euclidean")
    x, y = jnp.asarray(x), jnp.asarray(y)
    if callable(metric):
        return metric(x, y)
    one_of("metric (or a function of x and y)", metric, ("euclidean", "sqeuclidean", "pose"))
    if metric == "pose":
        return pose_distance(x, y)
    if x.ndim != 2 or y.ndim != 2 or x.shape[1] != y.shape[1]:
        raise ValueError(
            f"x has shape {x.shape} and y {y.shape}; want (n, f) and (m, f) with the same f"
            " (use jax.vmap for many clips)"
        )
    squared = _squared_distance(x, y)
    if metric == "sqeuclidean":
        return squared
    return safe_sqrt(squared)


def compared(
    caller: str, x: Given, y: Given, metric: Metric | None, default: Metric
) -> tuple[Any, Any, Metric]:
    """What is compared, of two motions their rotations, and by which metric: by default "pose" of
    motions, ``default`` of arrays."""
    if not isinstance(x, Motion) and not isinstance(y, Motion):
        for name, value in (("x", x), ("y", y)):
            no_module(f"{caller}: {name}", value)
        return x, y, default if metric is None else metric
    if metric in ("euclidean", "sqeuclidean"):
        raise ValueError(
            f"{caller}: metric={metric!r} compares features f[frames, features], not motions; "
            "expected 'pose', a function of their rotations, or arrays"
        )
    return *rotations_of(caller, x, y), "pose" if metric is None else metric  # type: ignore


def local_cost(
    x: ArrayLike | None, y: ArrayLike | None, cost: ArrayLike | None, metric: Metric
) -> Array:
    """The cost matrix ``(n, m)``, given or of two clips; ``ValueError`` for neither or both."""
    _frames_of(x, y, cost)
    d = jnp.asarray(cost) if x is None or y is None else frame_distance(x, y, metric)
    if not jnp.issubdtype(d.dtype, jnp.floating):
        raise ValueError(f"cost has dtype {d.dtype}; want float32 or float64")
    return d


def counted_pair(
    caller: str,
    x: ArrayLike | None,
    y: ArrayLike | None,
    cost: ArrayLike | None,
    x_length: ScalarLike | None,
    y_length: ScalarLike | None,
) -> tuple[tuple[Array | None, ...], Array | None, Array | None]:
    """x, y and cost as arrays, and the lengths checked, None for all frames."""
    n, m = _frames_of(x, y, cost)
    clips = tuple(None if given is None else jnp.asarray(given) for given in (x, y, cost))
    if x_length is not None:
        x_length, clips = counted(f"{caller}: x_length", x_length, n, clips)
    if y_length is not None:
        y_length, clips = counted(f"{caller}: y_length", y_length, m, clips)
    return clips, x_length, y_length


def last_frames(d: Array, x_length: Array | None, y_length: Array | None) -> list[Array]:
    """Numbers of the last frames that count of the clips behind a cost matrix."""
    lengths = zip(d.shape, (x_length, y_length), strict=True)
    return [jnp.asarray(n if length is None else length, jnp.int32) - 1 for n, length in lengths]


def _frames_of(x: ArrayLike | None, y: ArrayLike | None, cost: ArrayLike | None) -> tuple[int, int]:
    if cost is not None and x is None and y is None:
        shape = np.shape(cost)
    elif cost is None and x is not None and y is not None:
        shape = np.shape(x)[:1] + np.shape(y)[:1]
    else:
        raise ValueError("want either x and y, or cost=")
    if len(shape) != 2 or 0 in shape:
        raise ValueError(f"cost has shape {shape}; want (n, m), n and m at least 1")
    return shape


@jax.custom_jvp
def _squared_distance(x: Array, y: Array) -> Array:
    return _sum_squares(x, y)


@_squared_distance.defjvp
def _squared_distance_jvp(primals, tangents):
    """2(x_i − y_j)·(ẋ_i − ẏ_j) by matrix products, about a common centre to limit cancellation."""
    (x, y), (x_dot, y_dot) = primals, tangents
    centre = lax.stop_gradient(jnp.mean(y, axis=0))
    x_c, y_c = x - centre, y - centre
    own = jnp.sum(x_c * x_dot, axis=1)[:, None] + jnp.sum(y_c * y_dot, axis=1)[None, :]
    return _squared_distance(x, y), 2 * (own - x_dot @ y_c.T - x_c @ y_dot.T)


@custom_vmap
@jax.jit  # or eager calls would compile the scan every time
def _sum_squares(x: Array, y: Array) -> Array:
    """Σ_f (x_if − y_jf)², a block of features at a time so that the frames of y fill the lanes."""
    features = x.shape[1]
    width = min(features, _FEATURES_AT_ONCE)
    blocks = -(-features // width)
    pad = ((0, 0), (0, blocks * width - features))
    xs = jnp.pad(x, pad).T.reshape(blocks, width, x.shape[0])
    frames = y.shape[0]
    ys = jnp.pad(y, ((0, _ASIDE), pad[1])).T.reshape(blocks, width, frames + _ASIDE)

    def add_block(total, block):
        a, b = block
        for k in range(width):
            total = total + (a[k][:, None] - b[k][None, :frames]) ** 2
        return total, None

    return lax.scan(add_block, jnp.zeros((x.shape[0], y.shape[0]), x.dtype), (xs, ys))[0]


@_sum_squares.def_vmap
def _sum_squares_batched(axis_size, in_batched, x, y):
    """One clip against many is one clip against their frames laid end to end."""
    if in_batched == [True, True]:
        return jnp.sum((x[:, :, None] - y[:, None, :]) ** 2, axis=-1), True
    if in_batched[0]:
        flat = _sum_squares(x.reshape(-1, x.shape[-1]), y)
        return flat.reshape(axis_size, x.shape[1], y.shape[0]), True
    flat = _sum_squares(x, y.reshape(-1, y.shape[-1]))
    return jnp.moveaxis(flat.reshape(x.shape[0], axis_size, y.shape[1]), 1, 0), True
