"""Pad clips to a few sizes, so that one compiled function serves clips of many lengths.

    buckets    16, 24, 32, 48, 64, 96, 128, …    powers of two and the halves between: for yourself
    programs   128, 512, 2048                    then the buckets: what eager calls use

A clip ``(T, ...)`` is padded to the next size by repeating its last frame and travels with its
true length T; functions that take ``length``, ``x_length`` and ``y_length`` ignore the rest,
exactly. From 16 frames on at most a third of a bucket is padding, and clips of up to T frames need
about 2 log₂(T/16) compilations; programs waste more of little work and compile less. Cost O(T).
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np
from jaxtyping import Shaped

from jaxmotion._checks import static, traced
from jaxmotion._types import AnyArray

_SIZES = (128, 512, 2048)
LONGEST = _SIZES[-1]  # frames that take less time than compiling


@static("num_frames", "smallest")
def bucket_size(num_frames: int, smallest: int = 16) -> int:
    """The smallest of ``smallest · (1, 1½, 2, 3, 4, 6, 8, …)`` that holds a clip.

    **Arguments:** ``num_frames``: of the clip, at least 1; ``smallest``: the least size, even.
    **Returns:** frames of the padded clip.
    **Raises:** ``ValueError`` for no frames, or a ``smallest`` that is odd or below 2.
    """
    if num_frames < 1 or smallest < 2 or smallest % 2:
        raise ValueError(
            f"num_frames={num_frames}, smallest={smallest}; want at least 1 and an even number"
        )
    size = smallest
    while size < num_frames:
        if size + size // 2 >= num_frames:
            return size + size // 2
        size *= 2
    return size


def padded(
    clip: Shaped[AnyArray, "frames ..."], size: int | None = None
) -> Shaped[AnyArray, "size ..."]:
    """The clip, its last frame repeated up to ``size``, its :func:`bucket_size` when omitted."""
    frames = clip.shape[0]
    size = bucket_size(frames) if size is None else size
    if size < frames:
        raise ValueError(f"size={size}; want at least the clip's {frames} frames")
    return clip[np.minimum(np.arange(size), frames - 1)]


# Whether eager calls are computed at one of a few sizes; of the current thread or task.
_shared: ContextVar[bool] = ContextVar("jaxmotion buckets", default=True)


@static("shared")
@contextmanager
def buckets(shared: bool) -> Iterator[None]:
    """Inside this ``with``, whether eager calls share compiled programs between clips of many
    lengths, as they do outside.

    A call with a clip that is not traced pads it to 128, 512 or 2048 frames, computes with
    ``length=``, and cuts the result: the same numbers to rounding, and clips of up to 2048 frames
    need three compilations. Longer ones have their own size, and nothing is padded under your
    own ``jax.jit``, or with ``length=`` given. A length that is computed over and over eagerly is
    computed faster at its own size.

    **Arguments:** ``shared``: False computes every clip at its own size.
    **Returns:** a context manager.

    **Example:**

        >>> import jaxmotion as jm
        >>> motion = jm.samples.load("walk").motion[:16]
        >>> with jm.buckets(False):  # compiles for 16 frames
        ...     calm = jm.stylize(motion, 0.5)
    """
    token = _shared.set(shared)
    try:
        yield
    finally:
        _shared.reset(token)


def program_size(frames: int) -> int:
    """The size at which an eager call computes a clip: compiling takes so much longer than a short
    clip that one of four times the length costs nothing beside it."""
    return next((size for size in _SIZES if frames <= size), bucket_size(frames))


def shares_programs(frames: int, *given: Any) -> bool:
    """Whether an eager call of a clip of so many frames is computed at its :func:`program_size`:
    not where anything ``given`` is traced, nor for one frame, which does not determine what comes
    after it."""
    return frames > 1 and _shared.get() and not traced(given)


def in_buckets(*clips: AnyArray, size: Callable[[int], int] = program_size) -> tuple[AnyArray, ...]:
    """The clips, of two frames or more and not traced, each padded to its ``size``, as NumPy
    arrays; others as they are."""

    def filled(clip: Any) -> AnyArray:
        return padded(clip, size(len(clip))) if shares_programs(len(clip)) else clip

    return clips if traced(clips) else tuple(filled(np.asarray(clip)) for clip in clips)
