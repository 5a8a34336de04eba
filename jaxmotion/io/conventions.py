"""What readers take for granted, who may overrule it, and what writers do about the up axis.

| | up axis | frame rate | angles | length |
|---|---|---|---|---|
| BVH | assumed: y | in the file | degrees | not told |
| ASF/AMC | assumed: y | in few files; else assumed: 120 | in the file; else assumed: degrees | \
a factor |
| AMASS | z | in the file | radians | metres |
| ours | kept, and how it was known | kept, likewise | none | kept |
| glTF | y | by the times of frames | none | metres |
| USD | y or z, in the file | in the file | none | in the file, metres a unit |

All are right-handed; the last two are only written. Every reader takes ``fps=`` and ``up=``, the
one of ASF/AMC ``angle=``; what a caller says is told. ``Skeleton.conventions`` holds what is told
and what assumed.
"""

import math
import warnings
from dataclasses import replace
from os import PathLike

from jaxmotion._checks import one_of
from jaxmotion._entry import a_motion
from jaxmotion.axes import guess_up, reorient
from jaxmotion.io.errors import MotionFileWarning
from jaxmotion.io.formats import Up, UpOut
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Conventions


def seconds_of(fps: float | int | None, reader: str) -> float | None:
    """The frame time that a caller asks for: 1/fps, None for None.

    **Raises:** ``ValueError``, worded for ``reader``, if it is not positive and finite.
    """
    if fps is None:
        return None
    if not (fps > 0 and 0 < 1.0 / fps < math.inf):
        raise ValueError(f"{reader}: fps={fps!r}; expected a positive number")
    return 1.0 / fps


def with_up(motion: Motion, up: Up | None, path: str | PathLike, reader: str) -> Motion:
    """The motion read from ``path``, its up axis as the caller says; nothing is turned.

    "auto" goes by :func:`jaxmotion.guess_up`, and says so in a :class:`MotionFileWarning`.
    **Raises:** ``ValueError``, worded for ``reader``, for another value.
    """
    if up is None:
        return motion
    one_of(f"{reader}: up", up, ("x", "y", "z", "auto"))
    if up != "auto":
        return _known(motion, up, "told")
    guess, skeleton = guess_up(motion), motion.skeleton
    if guess.axis is None:
        text = f"cannot tell the up axis ({guess.reason}); {skeleton.up} is taken"
        found = motion
    else:
        text = f"{guess.axis} points up, by a guess: {guess.reason}"
        found = _known(motion, guess.axis, "guessed")
    warnings.warn(f"{path}: {text}", MotionFileWarning, stacklevel=4)
    return found


def turned_for(motion: Motion, up: UpOut, path: str | PathLike, writer: str) -> Motion:
    """The motion as it goes into the file ``path``, whose format cannot name its up axis: turned so
    that the axis ``up`` points up, or "keep". A :class:`MotionFileWarning` tells of what the file
    will not.

    **Raises:** ``ValueError``, worded for ``writer``, for another value.
    """
    turned = turned_to(motion, up, writer)
    own = motion.skeleton.up
    if turned.skeleton.up != own:
        text = (
            f"turned from {own} up to {turned.skeleton.up} up, as the file cannot say which it is"
        )
        warnings.warn(f"{path}: {text}", MotionFileWarning, stacklevel=4)
    if turned.skeleton.up != "y":
        text = f"{turned.skeleton.up} points up, which the file cannot say: read it with up= (--up)"
        warnings.warn(f"{path}: {text}", MotionFileWarning, stacklevel=4)
    return turned


def turned_to(motion: Motion, up: UpOut, writer: str) -> Motion:
    """The motion turned so that the axis ``up`` points up, or as it is for "keep".

    **Raises:** ``ValueError`` for what is no motion and, worded for ``writer``, for another value.
    """
    a_motion("save", motion)
    one_of(f"{writer}: up", up, ("x", "y", "z", "keep"))
    return motion if up == "keep" else reorient(motion, up)


def _known(motion: Motion, up: str, how: str) -> Motion:
    skeleton = motion.skeleton
    conventions: Conventions = replace(skeleton.conventions, up=how)
    return motion.replace(skeleton=replace(skeleton, up=up, conventions=conventions))
