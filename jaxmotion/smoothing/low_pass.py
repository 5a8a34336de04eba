"""A low-pass filter without phase: the LGS with half its gain at a frequency.

    gain(f) = 1/(1 + λσ² (2 sin πfΔ)⁴)        λσ² = 1/(2 sin πcΔ)⁴        gain(c) = ½

c: the cutoff in hertz, Δ the frame time; at most half the frame rate counts. O(T).

With the scale "half", in which motions are smoothed, λ counts half:   sin πcΔ = 1/√(2λσ)
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxmotion._types import ArrayLike, ScalarLike
from jaxmotion.smoothing.lgs import lgs


def low_pass(
    x: Float[Array, "time *channels"],
    hertz: float,
    frame_time: ScalarLike,
    counts: Bool[Array, " time"] | None = None,
) -> Float[Array, "time *channels"]:
    """``x`` without what is faster than ``hertz``; clips of under three frames as they are.

    **Arguments:** ``x``: f[T, *channels]; ``hertz``: where half the gain is left; ``frame_time``:
    seconds; ``counts``: bool[T], which frames are known, all by default.
    **Returns:** f[T, *channels].
    **Raises:** as ``lgs``.
    """
    if x.shape[0] < 3 or x.size == 0:
        return x
    sine = jnp.sin(jnp.pi * jnp.minimum(hertz * jnp.asarray(frame_time), 0.5))
    if counts is None:
        return lgs(x, 0.25 / sine**2, 1.0, scale="unit").mean
    few = jnp.sum(counts) < 3
    weights = (counts | few).astype(x.dtype)
    smooth = lgs(x, 0.25 / sine**2, 1.0, weights=weights, scale="unit").mean
    return jnp.where(few, x, smooth)


def half_gain(product: ArrayLike, frame_time: float) -> Float[np.ndarray, "..."]:
    """Hertz at which a smoothed motion keeps half; half the frame rate if all of it keeps more.

    **Arguments:** ``product``: λσ, scale "half", order 2; ``frame_time``: seconds.
    **Returns:** f64[...], hertz.
    """
    sine = 1 / np.sqrt(2 * np.asarray(product, np.float64))
    return np.asarray(np.arcsin(np.minimum(sine, 1.0)) / (np.pi * frame_time))
