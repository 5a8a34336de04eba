"""Clips padded to a few sizes (:mod:`jaxmotion.frames.padding`), arrays or motions."""

from typing import TypeVar

import numpy as np
from jaxtyping import Array

from jaxmotion._checks import no_module, static
from jaxmotion._entry import one_clip
from jaxmotion.frames.padding import padded
from jaxmotion.motion import Motion

Clip = TypeVar("Clip", Array, np.ndarray, Motion)


@static("size")
def pad_to_bucket(clip: Clip, size: int | None = None) -> tuple[Clip, int]:
    """Repeat the last frame up to a clip's bucket.

    **Arguments:** ``clip``: an array (frames, ...), or a motion, one clip; ``size``: frames of the
    padded clip, the clip's :func:`bucket_size` when omitted.
    **Returns:** the padded clip (size, ...) and the number of frames that count, both to be passed
    on.
    **Raises:** ``ValueError`` for an empty clip, a batch of motions, or a size smaller than the
    clip.
    """
    if isinstance(clip, Motion):
        one_clip("pad_to_bucket", clip, "clip")
        longer = clip.with_transforms(padded(clip.translations, size), padded(clip.rotations, size))
        return longer, clip.num_frames
    no_module("pad_to_bucket: clip", clip)
    return padded(clip, size), clip.shape[0]  # type: ignore
