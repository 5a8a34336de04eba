"""The small player that a clip is in a notebook.

A notebook keeps every output it has shown, so a long or large clip is thinned: every second, third,
n-th frame, until its numbers fit in 110 kB. What is left out is said below.
"""

import math

import numpy as np

from jaxmotion._checks import traced
from jaxmotion._summary import numbers, some
from jaxmotion.motion import Motion
from jaxmotion.viz.player.arguments import Given
from jaxmotion.viz.player.page import content_of, framed, written

_BYTES = 110_000
_HEIGHT = 380  # pixels
_MOST_JOINTS = 2000


def thumbnail(motion: Motion) -> str | None:
    """A frame with the clip, and a line below it; None for what is no clip to be drawn."""
    if not _is_known(motion):
        return None
    frames, joints, _ = np.shape(motion.rotations)
    a_frame = 6 * (joints + len(motion.skeleton.end_joints)) + 2 * joints
    every = max(1, -(-frames * a_frame // _BYTES))
    kept = motion[::every]
    view = {"title": "", "picked": [], "sideBySide": False, "isSmall": True}
    page = written(content_of(Given({"": kept}, {}, {}, []), view), "jaxmotion")
    thinned = f"{some(len(kept), 'frame')}: every {_ordinal(every)} is here. " if every > 1 else ""
    said = f"{thinned}<code>jaxmotion.viz.player(motion)</code> shows all there is."
    return f"{framed(page, _HEIGHT)}<small>{said}</small>"


def _is_known(motion: Motion) -> bool:
    """Whether it is one clip of numbers, some of them finite; a tree map puts anything there."""
    arrays = motion.rotations, motion.translations, motion.skeleton.end_offsets, motion.frame_time
    if traced(arrays) or not all(numbers(x, 10**9) is not None for x in arrays):
        return False
    joints, ends = motion.num_joints, len(motion.skeleton.end_joints)
    wanted = [(joints, 4), (joints, 3), (ends, 3), ()]
    shapes = [np.shape(x)[-2:] for x in arrays]
    is_one = all(np.ndim(x) == 3 and len(x) for x in arrays[:2]) and 0 < joints <= _MOST_JOINTS
    if not is_one or shapes != wanted or not 0 < float(motion.frame_time) < math.inf:
        return False
    return bool(np.isfinite(np.asarray(motion.translations)).any())


def _ordinal(n: int) -> str:
    ending = "th" if n % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(n % 10, "th")
    return f"{n}{ending}"
