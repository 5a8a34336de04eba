"""The linear Gaussian smoother in continuous time: cubic splines, their slopes, and reading them.

    minimise   Σ_i (y_i − x(t_i))² + (λσ/2)² ∫ x″(t)² dt
    (R + (λσ/2)² QᵀQ) Γ = Qᵀy,      x_i = y_i − (λσ/2)² (QΓ)_i,      Γ_0 = Γ_{n−1} = 0

t_i: knots, h_i = t_{i+1} − t_i; y_i: data ``(n, *channels)``; x: the curve, Γ_i = x″(t_i); Qᵀ takes
divided second differences, rows (1/h_{i−1}, −1/h_{i−1} − 1/h_i, 1/h_i); R is tridiagonal, with
(h_{i−1} + h_i)/3 and h_i/6. It is Eom et al. 2019, Eq. 6 (half scale) on an ever finer grid of
frames: cubic between knots, straight beyond them. λσ = 0 passes through the data (the natural cubic
spline); otherwise, with knots a frame apart, slow waves keep their height and those of frequency
√(2/λσ)/2π a frame lose half of it. Sources: Reinsch 1967; Green & Silverman 1994, §2.3.

A curve is held by its values and slopes at the knots and read by Hermite's formula, as is the
simpler one of :func:`local_slopes`. ``length`` knots count, the rest is padding whose spacings are
positive. O(n) to solve, O(1) a reading. Differentiable in everything, in both modes; the number of
the interval in which a reading lies passes none, and needs none.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmotion.linalg import banded_solve


def smoothed_knots(
    h: Float[Array, " interval"],
    y: Float[Array, "knot *channels"],
    smoothing: Float[Array, "..."],
    length: Int[Array, ""],
) -> tuple[Array, Array]:
    """Values and slopes of the smoothing spline at its knots, each ``(n, *channels)``.

    ``smoothing`` is λσ ≥ 0 in the unit of ``h``: a scalar, or with y's channel axes (1 or equal).
    """
    if y.shape[0] == 1:
        return y, jnp.zeros_like(y)
    h = h.reshape(-1, *[1] * (y.ndim - 1))
    if y.shape[0] == 2:
        slope = jnp.diff(y, axis=0) / h
        return y, jnp.concatenate([slope, slope])
    gain = (smoothing / 2) ** 2
    knot = jnp.arange(y.shape[0], dtype=length.dtype).reshape(-1, *[1] * (y.ndim - 1))
    inside = knot[1:-1] < length - 1
    a, b = 1 / h[:-1], 1 / h[1:]
    main = (h[:-1] + h[1:]) / 3 + gain * (a**2 + (a + b) ** 2 + b**2)
    next_one = h[1:] / 6 - gain * b * (a + 2 * b + _next(b))
    after_next = gain * b * _next(b)
    bands = [
        jnp.where(inside, main, 1),
        jnp.where(inside & _next(inside), next_one, 0),
        jnp.where(inside & _next(_next(inside)), after_next, 0),
    ]
    bends = jnp.where(inside, jnp.diff(jnp.diff(y, axis=0) / h, axis=0), 0)
    bend = banded_solve(jnp.stack(jnp.broadcast_arrays(*bands), axis=1), bends)
    ends = jnp.zeros_like(y[:1])
    bend = jnp.concatenate([ends, bend, ends])
    flux = jnp.diff(bend, axis=0) / h
    x = y - gain * jnp.diff(jnp.concatenate([ends, flux, ends]), axis=0)
    chord = jnp.diff(x, axis=0) / h
    first = chord[:1] - h[:1] * (2 * bend[:1] + bend[1:2]) / 6
    return x, jnp.concatenate([first, chord + h * (bend[:-1] + 2 * bend[1:]) / 6])


def local_slopes(
    h: Float[Array, " interval"], y: Float[Array, "knot *channels"], length: Int[Array, ""]
) -> Float[Array, "knot *channels"]:
    """Slopes of the parabola through each knot and its neighbours, of the chord at the ends."""
    if y.shape[0] == 1:
        return jnp.zeros_like(y)
    h = h.reshape(-1, *[1] * (y.ndim - 1))
    chord = jnp.diff(y, axis=0) / h
    middle = (h[1:] * chord[:-1] + h[:-1] * chord[1:]) / (h[:-1] + h[1:])
    slope = jnp.concatenate([chord[:1], middle, chord[-1:]])
    knot = jnp.arange(y.shape[0], dtype=length.dtype).reshape(-1, *[1] * (y.ndim - 1))
    return jnp.where(knot == length - 1, jnp.concatenate([chord[:1], chord]), slope)


def monotone_slopes(
    h: Float[Array, " interval"], y: Float[Array, " knot"]
) -> Float[Array, " knot"]:
    """Slopes that keep an increasing curve increasing: weighted harmonic means of the chords beside
    each knot, the chord itself at the ends (Fritsch & Butland 1984)."""
    chord = jnp.diff(y) / h
    before, after = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    middle = (before + after) / (before / chord[:-1] + after / chord[1:])
    return jnp.concatenate([chord[:1], middle, chord[-1:]])


def read_curve(
    h: Float[Array, " interval"],
    x: Float[Array, "knot *channels"],
    slope: Float[Array, "knot *channels"],
    interval: Int[Array, " reading"],
    fraction: Float[Array, " reading"],
) -> Float[Array, "reading *channels"]:
    """The curve at ``fraction`` of the way through each ``interval``, straight beyond its ends."""
    if x.shape[0] == 1:
        return jnp.broadcast_to(x, (fraction.shape[0], *x.shape[1:]))
    column = (-1, *[1] * (x.ndim - 1))
    h = h[interval].reshape(column)
    fraction = fraction.reshape(column)
    u = jnp.clip(fraction, 0, 1)
    beyond = (fraction - u) * h
    rest = 1 - u
    start, end = x[interval], x[interval + 1]
    leave, arrive = slope[interval], slope[interval + 1]
    curve = rest**2 * ((1 + 2 * u) * start + u * h * leave)
    curve = curve + u**2 * ((1 + 2 * rest) * end - rest * h * arrive)
    return curve + beyond * jnp.where(fraction <= 0, leave, arrive)


def _next(values: Array) -> Array:
    """Entry i of the result is entry i + 1; a zero (False) enters at the end."""
    return jnp.concatenate([values[1:], jnp.zeros_like(values[:1])])
