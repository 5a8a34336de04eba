"""The linear smoother on rotations: components smoothed and put back (Eom et al. 2019, Eq. 11).

    x = back(lgs of components(q))       :mod:`~jaxmotion.smoothing.components` has both

With a window the components are cross-faded between windows before they go back. O(T·J).
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmotion._types import ArrayLike, Quaternion, ScalarLike
from jaxmotion.smoothing.components import (
    Coordinates,
    Signs,
    from_components,
    per_component,
    to_components,
)
from jaxmotion.smoothing.design import Design
from jaxmotion.smoothing.lgs import lgs
from jaxmotion.smoothing.windowed import windowed_lgs


def chordal(
    q: Quaternion,
    lam: ScalarLike,
    sigma: ScalarLike,
    design: Design,
    *,
    weights: Array | None = None,
    stiffness: Array | None = None,
    method: Coordinates = "chordal",
    signs: Signs = "nearest",
    window: int | None = None,
) -> Quaternion:
    """Smoothed rotations f[Nf, ..., 4]; arguments as ``smooth_quaternions``, checked there."""
    x = linear_mean(
        to_components(q, weights, design.index, method, signs),
        _on_components(lam),
        _on_components(sigma),
        design,
        window,
        weights=None if weights is None else _squeezed(per_component(weights, q)),
        stiffness=None if stiffness is None else per_component(stiffness, q),
    )
    return from_components(x, method)


def linear_mean(
    y: Array,
    lam: ScalarLike,
    sigma: ScalarLike,
    design: Design,
    window: int | None,
    *,
    weights: ArrayLike | None,
    stiffness: ArrayLike | None,
) -> Array:
    """The smoother's mean, all at once or window by window.

    **Raises:** ``ValueError`` for a window on a design that resamples; as both smoothers.
    """
    if window is None:
        options = design._asdict()
        return lgs(y, lam, sigma, weights=weights, stiffness=stiffness, **options).mean
    if design.index is not None or design.num_frames not in (None, y.shape[0]):
        raise ValueError(
            f"window={window}: windows do not resample; expected no index and num_frames None, "
            f"got num_frames={design.num_frames}"
        )
    options = {"order": design.order, "scale": design.scale, "weights": weights}
    return windowed_lgs(y, lam, sigma, window=window, **options)


def _squeezed(weights: Array) -> Array:
    """Weights shared by all channels as a vector, so that they are factored once."""
    return weights if weights.size != weights.shape[0] else weights.reshape(-1)


def _on_components(parameter: ScalarLike) -> ScalarLike:
    """A scalar as it is; per joint with a component axis."""
    return parameter if np.ndim(parameter) == 0 else jnp.asarray(parameter)[..., None]
