"""Several clips in one motion: side by side, or one after the other.

A batch is a motion all of whose arrays have the batch axes in front, those of the skeleton too:
what ``jax.vmap`` takes and gives. So ``jax.vmap(f)(batch)`` needs no ``in_axes``, what it returns
is a batch again, and clip i is ``jax.tree.map(lambda x: x[i], batch)``. Kinematics, displacements
and most measures take a batch as it is; other functions take one clip at a time, and say so.

Clips of other lengths stand in a batch with their last frame repeated; how many of their frames
count goes beside it, to functions that take ``length=``.
"""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from jaxmotion._checks import at_hand, fault, instance_of, known, raise_faults
from jaxmotion._entry import one_clip
from jaxmotion._types import AnyArray
from jaxmotion.frames.padding import padded
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton

__all__ = ["concatenate", "stack"]

_ALIKE = 1e-4  # of the frame time, and of the longest bone: what files round
_STATIC = ("names", "parents", "end_joints", "up", "length_unit")


def stack(clips: Sequence[Motion]) -> tuple[Motion, Int[Array, " clip"]]:
    """Clips side by side, as a batch for ``jax.vmap``, and how many frames of each count.

    Shorter clips are padded by repeating their last frame. Every array of the batch has the clips
    in front, bone lengths and frame times too, which may differ from clip to clip. File facts
    (:mod:`jaxmotion._file_facts`) are those of the first.

    **Arguments:** ``clips``: one or more, of one dtype, and of one skeleton but for its offsets.
    **Returns:** a motion of B clips, rotations f[B, T, J, 4], and their lengths, i32[B], for
    ``length=``; a joint may be translated that is in one of them.
    **Raises:** ``ValueError`` for no clips, what is not one clip, skeletons or dtypes that differ.

    **Example:**

        >>> import jax, jaxmotion as jm
        >>> walk = jm.samples.load("walk").motion
        >>> batch, lengths = jm.stack([walk[:16], walk[20:32]])
        >>> batch.rotations.shape, lengths.tolist()
        ((2, 16, 22, 4), [16, 12])
        >>> clean = jax.vmap(lambda clip, length: jm.denoise(clip, length=length))(batch, lengths)
        >>> second = jax.tree.map(lambda x: x[1], clean)[:12]
        >>> second.rotations.shape
        (12, 22, 4)
    """
    clips = _alike("stack", clips)
    lengths = np.array([clip.num_frames for clip in clips], np.int32)
    longest = int(lengths.max())
    clips = [
        clip.with_transforms(
            *(padded(_seen(x), longest) for x in (clip.translations, clip.rotations))
        )
        for clip in clips
    ]
    return jax.tree.map(lambda *x: _joined(np.stack, jnp.stack, x), *clips), jnp.asarray(lengths)


def concatenate(clips: Sequence[Motion]) -> Motion:
    """Clips one after the other, as they are; :func:`jaxmotion.multiresolution.stitch` hides seams.

    **Arguments:** ``clips``: one or more, of one dtype, skeleton and frame time, bone lengths and
    times as far as files round them.
    **Returns:** a motion of all their frames, with the first's skeleton, frame time and file facts;
    a joint may be translated that is in one of them.
    **Raises:** ``ValueError`` for no clips, what is not one clip, skeletons, dtypes or frame times
    that differ; at run time for traced frame times.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk").motion
        >>> len(jm.concatenate([walk[:16], walk[100:120]]))
        36
    """
    clips = _alike("concatenate", clips)
    first, *others = clips
    faults = []
    for clip in others:
        if not _same_bones(first.skeleton, clip.skeleton):
            raise ValueError("concatenate: the clips' skeletons have bones of different lengths")
        one, other = known(first.frame_time), known(clip.frame_time)
        message = "concatenate: the clips must have one frame time; jaxmotion.resample one of them"
        faults += fault(abs(one - other) > _ALIKE * one, message, got=f"{one} and {other} s")
    arrays = zip(*((clip.translations, clip.rotations) for clip in clips), strict=True)
    whole = first.with_transforms(*(_joined(np.concatenate, jnp.concatenate, x) for x in arrays))
    return raise_faults(whole, faults)


def _alike(caller: str, clips: Sequence[Motion]) -> list[Motion]:
    """The clips, each one clip, of one dtype and kind of skeleton, with the same joints said to be
    translated."""
    instance_of(f"{caller}: clips", clips, Sequence, "a list of clips")
    clips = list(clips)
    if not clips:
        raise ValueError(f"{caller}: clips is empty; expected at least one clip")
    for i, clip in enumerate(clips):
        one_clip(caller, clip, f"clips[{i}]")
        for what in _STATIC:
            wanted, found = (getattr(c.skeleton, what) for c in (clips[0], clip))
            if wanted != found:
                raise ValueError(
                    f"{caller}: clips[{i}] has another skeleton than clips[0]: {what} {found}; "
                    f"expected {wanted}"
                )
        if clip.dtype != clips[0].dtype:
            raise ValueError(
                f"{caller}: clips[{i}] is {clip.dtype}, clips[0] {clips[0].dtype}; "
                "motion.astype makes them one dtype"
            )
    moving = tuple(sorted({j for clip in clips for j in clip.translated_joints}))
    return [clip.replace(translated_joints=moving) for clip in clips]


def _joined(on_host: Callable, traced: Callable, arrays: Sequence[AnyArray]) -> Array:
    """Arrays put together, without a program where all are at hand."""
    seen = [at_hand(x) for x in arrays]
    return traced(arrays) if any(x is None for x in seen) else jnp.asarray(on_host(seen))


def _seen(array: AnyArray) -> AnyArray:
    """The array as NumPy's if it is at hand."""
    seen = at_hand(array)
    return array if seen is None else seen  # type: ignore[return-value]


def _same_bones(first: Skeleton, second: Skeleton) -> bool:
    """Whether offsets agree, as far as they are known."""
    for name in ("offsets", "end_offsets"):
        one, other = (at_hand(getattr(skeleton, name)) for skeleton in (first, second))
        if one is None or other is None:
            continue
        longest = np.abs(one[1:] if name == "offsets" else one).max(initial=0)
        apart = np.abs(one - other)[1 if name == "offsets" else 0 :]
        if apart.max(initial=0) > _ALIKE * longest:
            return False
    return True
