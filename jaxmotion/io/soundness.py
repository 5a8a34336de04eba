"""What every format asks of a motion's arrays: finite numbers, unit quaternions; else where not."""

import numpy as np

from jaxmotion._entry import not_finite, one_clip, place_of
from jaxmotion.motion import Motion

_UNIT_TOLERANCE = 1e-3  # of the squared norm


def check_clip(motion: Motion) -> None:
    """``ValueError`` unless the motion is one clip, with frames, that :func:`trouble` passes."""
    one_clip("save", motion, on_host=True)
    if motion.num_frames == 0:
        raise ValueError("save: the motion has no frames")
    check_arrays(motion)


def check_arrays(motion: Motion) -> None:
    """``ValueError`` for a frame time that is none, or arrays that :func:`trouble` tells of."""
    seconds = np.asarray(motion.frame_time)
    if not ((seconds > 0) & (seconds < np.inf)).all():
        raise ValueError(f"save: frame_time={seconds}; expected a positive, finite number")
    found = trouble(motion.skeleton.names, motion.translations, motion.rotations)
    if found:
        raise ValueError(
            f"save: {found}; expected finite numbers and unit quaternions "
            "(quaternion.normalize makes them)"
        )


def trouble(names, translations, rotations) -> str:
    """The first joint and frame whose translation or rotation is not finite, or rotation not a unit
    quaternion, in words; "" if there is none. Arrays [..., T, J, 3] and [..., T, J, 4]."""
    for field, values in (("translations", translations), ("rotations", rotations)):
        if found := not_finite(names, field, np.asarray(values)):
            return found
    q = np.asarray(rotations)
    stray = np.abs(np.einsum("...i,...i->...", q, q) - 1.0) > _UNIT_TOLERANCE
    if stray.any():
        place = np.argwhere(stray)[0]
        return f"the rotation of {place_of(names, place)} is {q[tuple(place)].tolist()}"
    return ""
