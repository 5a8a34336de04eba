"""Does a rigid segment have a point at rest? (the idea of Le Callennec & Boulic 2006, our version)

In a window of n frames a segment has the transforms (R_s, d_s). A point x of it stays at one place
c where R_s x + d_s = c for all s; with deviations from the window's means

    S_s = R_s − R̄,   e_s = (R_s x₀ + d_s) − mean        (S_s δ + e_s = 0,   x = x₀ + δ)
    δ   = −(A + n ρ I)⁻¹ g,     A = Σ SᵀS,  g = Σ Sᵀe,  ρ = (still/reach)²
    r²  = Σ ‖S_s δ + e_s‖²/n    the mean square by which the best point near x₀ wanders

The singular values of the stacked S (roots of A's eigenvalues) tell how the segment turns in the
window: none above its threshold, it rests as a whole (a plane); two, it rolls about a line; three,
about a point. A frame belongs to a contact if some window that holds it has r below the threshold:
the union of such windows reaches to the contact's very ends.

    threshold²       (still·L)² + (1.2)²·3σ²
    angle threshold² (5 still)²  + 3 (σ/ℓ)²,  ℓ = L/5, the size of a foot

L limb length, σ the noise of a coordinate, from third differences (a quartile, so that the frames
at rest decide). T frames, C points, lengths in the motion's unit. O(T·C·n).
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxmotion._numerics import safe_norm, safe_sqrt
from jaxmotion.contacts.contact import FREE, LINE, PLANE, POINT

STILL, REACH = 0.006, 0.02  # shares of the limb's length
_NOISE = 1.2
_CHI3_QUARTILE = 1.1012  # of the length of a standard normal vector of three components
_FOOT = 0.2


class Rest(NamedTuple):
    """Per frame and point: ``ratio`` f[T, C], how far the best window's r is from its threshold
    (below 1: at rest), and ``kind`` i8[T, C]."""

    ratio: Float[Array, "time point"]
    kind: Int[Array, "time point"]


def rest(
    positions: Float[Array, "time point 3"],
    rotations: Float[Array, "time point 3 3"],
    size: Float[Array, " point"],
    counts: Bool[Array, " time"],
    window: int,
    tolerance: Float[Array, ""],
) -> Rest:
    """How far each point's segment is from having a fixed point close by.

    **Arguments:** world ``positions`` of the points, ``rotations`` of their joints; ``size``: limb
    lengths; ``counts``: frames that count, the first ones; ``window``: n ≤ T; ``tolerance`` scales
    ``still``.
    """
    still = STILL * tolerance
    square, spin = _window_moments(positions, rotations, size, window, still)
    deviation = noise_level(positions, counts)
    bound = (still * size) ** 2 + _NOISE**2 * 3 * deviation**2
    ratio = safe_sqrt(square / jnp.where(bound > 0, bound, 1))
    whole = counts[window - 1 :, None]
    turning = jax.lax.stop_gradient(jnp.linalg.eigvalsh(spin))
    arm = jnp.where(size > 0, _FOOT * size, 1)
    least = ((5 * still) ** 2 + 3 * (deviation / arm) ** 2)[None, :, None]
    axes = jnp.sum(turning > least, axis=-1)
    kind = jnp.where(axes == 0, PLANE, jnp.where(axes == 3, POINT, LINE))
    kind = jnp.where((ratio < 1) & whole, kind, FREE).astype(jnp.int32)
    ratio = jnp.where(whole, ratio, jnp.inf)
    return Rest(
        _over_windows(ratio, jax.lax.min, np.inf, window),
        _over_windows(kind, jax.lax.max, FREE, window).astype(jnp.int8),
    )


def noise_level(
    positions: Float[Array, "time point 3"], counts: Bool[Array, " time"]
) -> Float[Array, " point"]:
    """σ: white noise of each point's coordinates, from the lower quartile of ‖third differences‖;
    0 for clips too short to tell."""
    if positions.shape[0] < 4:
        return jnp.zeros(positions.shape[1], positions.dtype)
    third = safe_norm(jnp.diff(positions, n=3, axis=0))
    third = jnp.where(counts[3:, None], third, jnp.nan)
    quartile = jnp.nanquantile(third, jnp.asarray(0.25, positions.dtype), axis=0)
    known = jnp.isfinite(quartile)
    return jnp.where(known, quartile / (_CHI3_QUARTILE * math.sqrt(20.0)), 0)


def _window_moments(positions, rotations, size, window, still):
    """r² f[M, C] and A/n f[M, C, 3, 3] of the windows that begin at frames 0..M − 1."""
    count = positions.shape[0] - window + 1
    data = jnp.concatenate([positions[..., None], rotations], axis=-1)  # (T, C, 3, 1 + 3)
    middle = jax.lax.slice_in_dim(data, window // 2, window // 2 + count)

    def shifted(k):
        return jax.lax.dynamic_slice_in_dim(data, k, count) - middle

    def add(total, k):
        return total + shifted(k), None

    def add_square(total, k):
        away = shifted(k) - mean
        return total + jnp.einsum("mcij,mcik->mcjk", away, away), None

    steps = np.arange(window, dtype=np.int32)
    mean = jax.lax.scan(add, jnp.zeros_like(middle), steps)[0] / window
    start = jnp.zeros((*middle.shape[:2], 4, 4), data.dtype)
    moments = jax.lax.scan(add_square, start, steps)[0] / window
    wander, g, spin = moments[..., 0, 0], moments[..., 1:, 0], moments[..., 1:, 1:]
    prior = (still / REACH) ** 2 * jnp.asarray(np.eye(3), data.dtype)
    shift = -_solve3(spin + prior, g)
    most = (REACH * size)[:, None]
    length = safe_norm(shift, keepdims=True)
    shift = shift * jnp.where(length > most, most / jnp.where(length > 0, length, 1), 1)
    turned = jnp.einsum("mcij,mcj->mci", spin, shift)
    square = wander + jnp.sum((2 * g + turned) * shift, axis=-1)
    return jnp.maximum(square, 0), spin


def _solve3(matrix, right):
    """Cramer's rule for symmetric positive definite 3x3 systems."""
    a, b, c = jnp.unstack(matrix, axis=-2)
    bc, ca, ab = jnp.cross(b, c), jnp.cross(c, a), jnp.cross(a, b)
    x, y, z = jnp.unstack(right[..., None], axis=-2)
    return (x * bc + y * ca + z * ab) / jnp.sum(a * bc, axis=-1, keepdims=True)


def _over_windows(values, join, start, window):
    """``join`` over the windows that hold each frame: [M, C] to [T, C]."""
    start = np.asarray(start, values.dtype)
    around = ((window - 1, window - 1), (0, 0))
    return jax.lax.reduce_window(values, start, join, (window, 1), (1, 1), around)
