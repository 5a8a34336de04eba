"""The quadratic Savitzky–Golay filter that Aristidou et al. 2018 blend repairs with."""

import numpy as np
from jaxtyping import Bool, Float

from jaxmotion.cleaning.jumps import greatest_about
from jaxmotion.cleaning.turns import on_one_hemisphere

_WINDOW = 9  # frames


def smoothed(
    rotations: Float[np.ndarray, "time joint 4"], mask: Bool[np.ndarray, "time joint"]
) -> tuple[Float[np.ndarray, "time joint 4"], Bool[np.ndarray, "time joint"]]:
    """The rotations, filtered where the mask is set and half a window beside, and that mask. Each
    window's quaternions are taken on one hemisphere; beyond the ends of the clip its beginning and
    end go on turned about (2x(0) − x(t))."""
    half, frames = _WINDOW // 2, len(rotations)
    powers = np.arange(-half, half + 1)[:, None] ** np.arange(3)
    weights = np.linalg.pinv(powers)[0].astype(rotations.dtype)
    q = on_one_hemisphere(rotations)
    before, after = q[half:0:-1], q[-2 : -half - 2 : -1]
    fit = min(half, len(before)), min(half, len(after))
    q = np.concatenate([2 * q[:1] - before, q, 2 * q[-1:] - after])
    at = np.clip(np.arange(frames)[:, None] + np.arange(_WINDOW) - half + fit[0], 0, len(q) - 1)
    fitted = np.einsum("w,twjc->tjc", weights, q[at])
    fitted /= np.linalg.norm(fitted, axis=-1, keepdims=True)
    wide = greatest_about(mask, range(-half, half + 1), frames)
    return np.where(wide[..., None], fitted, rotations), wide
