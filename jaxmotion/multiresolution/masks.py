"""Masks for orientation filters: coefficients a₋ₖ … aₖ that sum to 1 (Lee & Shin 2001, §3.1, §3.3).

    smoothing   δ − (−1)ʲ λ Δ²ʲ/(2j)!             gain 1 − λ(2 − 2cos ω)ʲ/(2j)!
    binomial    C(2k, k + m)/4ᵏ                    gain cos²ᵏ(ω/2)
    band pass   a windowed band that keeps DC      gain 1 at 0 and between two frequencies

δ is the identity, L = Δ² the second difference, ω radians a frame. With λ = 1 and j = 2 the first
is (−1, 4, 18, 4, −1)/24, the paper's filter between levels. At uneven times the differences are
divided differences h̄²ʲ·w over the 2j + 1 knots around a frame, w_m = 1/∏_{n≠m}(t_m − t_n), h̄ the
knots' mean spacing: one λ then means the same on every level, and polynomials of degree below 2j
pass unchanged.

Masks are f[2k + 1], or f[T, 2k + 1] with one row a frame. O(k), or O(T·k²) for uneven times. Sharp
bits: the sign of Lʲ alternates with j (the printed rule amplifies at odd j); the gain falls below
−1, so that smoothing again and again explodes, when λ > 2(2j)!/4ʲ.
"""

from math import comb, factorial

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion._checks import static
from jaxmotion._types import AnyArray, ScalarLike
from jaxmotion.frames.ends import steps_around
from jaxmotion.multiresolution.poses import increasing


@static("power")
def smoothing_mask(
    power: int = 2,
    strength: ScalarLike = 1.0,
    *,
    times: Float[AnyArray, " time"] | None = None,
) -> Float[AnyArray, "*time width"]:
    """Smoothing by the j-th power of the Laplacian: δ − (−1)ʲ λ Lʲ/(2j)!.

    Lee & Shin 2001, Eq. 8–9.

    **Arguments:** ``power``: j ≥ 1; ``strength``: λ; (2j)!/4ʲ removes the fastest oscillation (½
    for j = 1, 1.5 for j = 2); ``times``: f[T], increasing, where frames are not evenly spaced.
    **Returns:** f[2j + 1], or f[T, 2j + 1] for times.
    **Raises:** ``ValueError`` for a power below 1, or times that are not f[T] or do not increase;
    at run time for traced times that do not.
    """
    if power < 1:
        raise ValueError(f"smoothing_mask: power={power}; expected a whole number of at least 1")
    sign = -1.0 if power % 2 else 1.0
    width = 2 * power + 1
    centre = np.zeros(width)
    centre[power] = 1.0
    if times is None:
        signs = (-1.0) ** np.arange(width)
        binomials = np.array([comb(2 * power, m) for m in range(width)], np.float64)
        pattern = sign * signs * binomials / factorial(2 * power)
        if not isinstance(strength, Array):
            return centre - float(strength) * pattern  # type: ignore[return-value]
        return jnp.asarray(centre, strength.dtype) - strength * jnp.asarray(pattern, strength.dtype)
    times = increasing(times, "smoothing_mask")
    if times.shape[0] < 2:
        return jnp.broadcast_to(jnp.asarray(centre, times.dtype), (*times.shape, width))
    weights = divided_difference(knots_around(times, power))
    return jnp.asarray(centre, times.dtype) - sign * jnp.asarray(strength, times.dtype) * weights


@static("half_width")
def binomial_mask(half_width: int) -> Float[np.ndarray, " width"]:
    """The smooth bell C(2k, k + m)/4ᵏ.

    **Arguments:** ``half_width``: k ≥ 0, in frames.
    **Returns:** f64[2k + 1], symmetric.
    **Raises:** ``ValueError`` for a negative half-width.
    """
    if half_width < 0:
        raise ValueError(f"binomial_mask: half_width={half_width}; expected 0 or more")
    row = [comb(2 * half_width, m) for m in range(2 * half_width + 1)]
    return np.array(row, np.float64) / 4.0**half_width


@static("half_width")
def band_pass_mask(low: float, high: float, half_width: int) -> Float[np.ndarray, " width"]:
    """What moves at ``low`` to ``high`` cycles a frame, about the slow pose.

    An orientation filter must keep a constant pose, so its gain at frequency 0 is 1 whatever the
    band: the mask is a Hamming-windowed band plus as much of the window itself, the slowest bell of
    this width (about 2/half_width cycles a frame wide), as makes the sum 1.

    **Arguments:** ``low``, ``high``: cycles a frame, 0 ≤ low < high ≤ ½; ``half_width``: k ≥ 1, in
    frames; more is sharper.
    **Returns:** f64[2k + 1], symmetric.
    **Raises:** ``ValueError`` for a band or a half-width outside that.
    """
    if not 0 <= low < high <= 0.5 or half_width < 1:
        raise ValueError(
            f"band_pass_mask: low={low}, high={high}, half_width={half_width}; expected "
            "0 <= low < high <= 0.5 cycles a frame and a half-width of at least 1"
        )
    m = np.arange(-half_width, half_width + 1)
    window = 0.54 + 0.46 * np.cos(np.pi * m / half_width)
    band = window * (2 * high * np.sinc(2 * high * m) - 2 * low * np.sinc(2 * low * m))
    return band + (1.0 - band.sum()) * window / window.sum()


def knots_around(times: Float[AnyArray, " time"], reach: int) -> Float[AnyArray, "time width"]:
    """Times of the 2·reach + 1 frames around each of T ≥ 2, steps mirrored at the ends, as
    multiples of their mean spacing from the middle one."""
    steps = (times[1:] - times[:-1])[steps_around(len(times) - 1, reach, reach)]
    extended = jnp.concatenate([jnp.zeros(1, times.dtype), jnp.cumsum(steps)])
    knots = extended[np.arange(len(times))[:, None] + np.arange(2 * reach + 1)]
    spacing = (knots[:, -1:] - knots[:, :1]) / (2 * reach)
    return (knots - knots[:, reach : reach + 1]) / spacing


def divided_difference(knots: Float[AnyArray, "time width"]) -> Float[AnyArray, "time width"]:
    """Coefficients 1/∏_{n≠m}(t_m − t_n) of the divided difference over each row of knots."""
    gaps = knots[:, :, None] - knots[:, None, :]
    return 1 / jnp.prod(gaps + jnp.eye(knots.shape[1], dtype=knots.dtype), axis=2)
