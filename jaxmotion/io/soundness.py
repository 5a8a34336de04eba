"""What every format asks of a motion's arrays: finite numbers, unit quaternions; else where not."""

import numpy as np

from jaxmotion.io.errors import quoted
from jaxmotion.motion import Motion

_UNIT_TOLERANCE = 1e-3  # of the squared norm


def check_clip(motion: Motion) -> None:
    """``ValueError`` unless the motion is one clip, with frames, that :func:`trouble` passes."""
    if np.ndim(motion.rotations) != 3:
        raise ValueError(
            f"save: the motion has batch axes, rotations {np.shape(motion.rotations)}; "
            "save one clip at a time"
        )
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
        values = np.asarray(values)
        if not np.isfinite([values.min(initial=0), values.max(initial=0)]).all():
            place = np.argwhere(~np.isfinite(values))[0][:-1]
            return f"{field} of {_place(names, place)} are not finite"
    q = np.asarray(rotations)
    stray = np.abs(np.einsum("...i,...i->...", q, q) - 1.0) > _UNIT_TOLERANCE
    if stray.any():
        place = np.argwhere(stray)[0]
        return f"the rotation of {_place(names, place)} is {q[tuple(place)].tolist()}"
    return ""


def _place(names, index: np.ndarray) -> str:
    *batch, frame, joint = index.tolist()
    clip = f" of clip {', '.join(map(str, batch))}" if batch else ""
    return f"{quoted(names[joint])} at frame {frame}{clip}"
