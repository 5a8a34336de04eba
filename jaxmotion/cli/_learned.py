"""What smoothers learned of a clip, in rows for a report: λ and σ beside hertz and degrees.

``hertz`` is what a smoother keeps half of. σ of turns counts half angles about each axis; in
``degrees`` it is the noise about each axis, whole. Joints that keep still have taught nothing.
"""

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion.cli._work import Learned
    from jaxmotion.layers import MotionLayers
    from jaxmotion.smoothing import MotionTuning

HALF_ANGLE = 2 * math.degrees(1)  # degrees
_STILL = 1e-8  # radians


def of_noise(motion: "Motion", length: int, tuning: "MotionTuning | None") -> "Learned":
    """The tables ``turns`` and ``translations`` of the joints of a padded clip; nothing where
    nothing was learned."""
    import numpy as np

    from jaxmotion.metrics import turn

    if tuning is None:
        return {}
    rotations = np.asarray(motion.rotations)[:length]
    translations = np.asarray(motion.translations)[:length]
    turned = (turn(rotations, rotations[:1]) > _STILL).any(axis=0)
    moved = (translations != translations[:1]).any(axis=(0, 2))
    turning, moving = tuning.rotations, tuning.translations
    sides = {
        "turns": (np.flatnonzero(turned), turning, "degrees", HALF_ANGLE),
        "translations": (np.flatnonzero(moved), moving, "length", 1.0),
    }
    return {
        name: [
            {
                "joint": motion.skeleton.names[j],
                **_smoother(learned.lam[j], learned.sigma[j], motion),
                unit: scale * float(learned.sigma[j]),
            }
            for j in joints
        ]
        for name, (joints, learned, unit, scale) in sides.items()
    }


def of_base(layers: "MotionLayers") -> "Learned":
    """The base's smoothness, of the body or of every joint."""
    import numpy as np

    base = layers.base
    parameters = np.broadcast_arrays(layers.lam, layers.sigma, layers.saturated)
    if not parameters[0].ndim:
        lam, sigma, saturated = parameters
        return {**_smoother(lam, sigma, base), "saturated": bool(saturated)}
    rows = zip(base.skeleton.names, *parameters, strict=True)
    return {
        "base": [
            {"joint": name, **_smoother(lam, sigma, base), "saturated": bool(saturated)}
            for name, lam, sigma, saturated in rows
        ]
    }


def _smoother(lam: Any, sigma: Any, motion: "Motion") -> dict[str, float]:
    from jaxmotion.smoothing.low_pass import half_gain

    lam, sigma = float(lam), float(sigma)
    hertz = float(half_gain(lam * sigma, float(motion.frame_time)))
    return {"lam": lam, "sigma": sigma, "hertz": hertz}
