"""Pad clips to a few sizes, so that one compiled function serves clips of many lengths.

    sizes 16, 24, 32, 48, 64, 96, 128, …        (powers of two and the halves between)

A clip ``(T, ...)`` is padded to the next size by repeating its last frame and travels with its
true length T; functions that take ``x_length`` and ``y_length`` ignore the rest, exactly. From 16
frames on at most a third of a bucket is padding, and clips of up to T frames need about
2 log₂(T/16) compilations. Cost O(T).
"""

import numpy as np
from jaxtyping import Shaped

from jaxmotion._checks import traced
from jaxmotion._types import AnyArray


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


def in_buckets(*clips: AnyArray) -> tuple[AnyArray, ...]:
    """The clips, of two frames or more and not traced, each padded to its bucket, as NumPy
    arrays; others as they are (one frame does not determine what comes after it)."""
    if traced(clips):
        return clips
    clips = tuple(map(np.asarray, clips))  # type: ignore[assignment]
    return tuple(padded(c) if len(c) > 1 else c for c in clips)
