"""How alike clips are, by their words and by their frames alone.

    words     mean over words of X of the distance of the nearest word of Y (:func:`nearest_words`)
    frames    mean over frames x of X of the least D(x, y) over frames y of Y

D is :func:`jaxmotion.timing.pose_distance` of what words are made of (the body without its place
and its yaw), of the joints that tell, one of eight joint terms left out. Clips are compared at
about 24 frames a second in single precision, and padded to a few lengths; O(P·Q·J) for P frames of
the clip and Q of all others, a tile of frames at a time.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion._checks import static, traced
from jaxmotion._posture import upright
from jaxmotion.cleaning.digression import TARGET, WORD, thinned
from jaxmotion.cleaning.groups import joint_groups, one_skeleton
from jaxmotion.cleaning.missing import filled
from jaxmotion.cleaning.neighbours import TRIMMED, nearest_words
from jaxmotion.cleaning.words import texture
from jaxmotion.frames.padding import LONGEST, padded, program_size
from jaxmotion.motion import Motion
from jaxmotion.timing import pose_distance


@static("many")
def most_alike(motion: Motion, clips: Sequence[Motion], many: int = 8) -> tuple[int, ...]:
    """The clips that do most nearly what a clip does: a context for :func:`detect_errors` and
    :func:`repair`.

    On the host; not differentiable, not under ``jit``.

    **Arguments:** ``motion``: one clip; ``clips``: others of the same joints, at any rate;
    ``many``: how many are wanted. Entries that are not finite count as what is about them.
    **Returns:** numbers of clips, most alike first; all of them where there are no more.
    **Raises:** ``ValueError`` for what is traced, clips of other joints, ``many`` below 1.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk, run = (jm.samples.load(x, fps=24.0).motion for x in ("walk", "run"))
        >>> jm.cleaning.most_alike(walk[:60], [run, walk[60:]], many=1)
        (1,)
    """
    if not isinstance(many, (int, np.integer)) or many < 1:
        raise ValueError(f"most_alike: many={many!r}; expected a whole number of at least 1")
    if traced(motion, clips):
        raise ValueError("most_alike: a clip is traced; call it outside of jit and vmap")
    whole = [filled("most_alike", clip)[0] for clip in (motion, *clips)]
    own, *others = (light(clip) for clip in one_skeleton("most_alike", whole))
    joints = joint_groups(own).get("whole", ())
    if not joints:
        return tuple(range(min(many, len(others))))
    stands = upright(own)

    def seen(clip: Motion) -> np.ndarray:
        return np.asarray(texture(clip, joints, stands), np.float32)

    mine = seen(own)
    far = [_distance(mine, seen(clip)) for clip in others]
    return tuple(np.argsort(far, kind="stable")[:many].tolist())


def light(motion: Motion) -> Motion:
    """Every so many-th frame, about 24 a second, in single precision."""
    _, (thin,) = thinned([motion])
    single = jax.tree.map(lambda x: np.asarray(x, np.float32), thin)
    # Made anew, so that what motions keep in JAX's arrays is.
    return single.with_transforms(single.translations, single.rotations)


def _distance(x: np.ndarray, y: np.ndarray) -> float:
    """Mean distance of frames of x f[n, J, 4] from their nearest of y f[m, J, 4]."""
    trim = x.shape[1] // TRIMMED
    total = 0.0
    for part in _tiles(x):
        filled_up = padded(part, program_size(len(part)))
        least = np.full(len(filled_up), np.inf)
        for other in _tiles(y):
            near = _least(filled_up, padded(other, program_size(len(other))), trim)
            least = np.minimum(least, np.asarray(near))
        total += float(least[: len(part)].sum())
    return total / len(x)


def _tiles(x: Any) -> list[Any]:
    return [x[begin : begin + LONGEST] for begin in range(0, len(x), LONGEST)]


@static("joints")
def sequence_distance(
    motion: Motion, other: Motion, *, joints: str | Sequence[int | str] | None = "whole"
) -> float:
    """How far what a clip does is from what another does: 0 where all its words are in it, too.

    On the host; not differentiable, not under ``jit``. Source: Aristidou et al. 2018, §7.

    **Arguments:** ``motion``, ``other``: clips of the same joints, at any rate; ``joints``: as
    :func:`motion_words`.
    **Returns:** the mean over the clip's words of the distance of the nearest word of the other,
    squared half-angle radians; infinite where one of them is too short for words.
    **Raises:** ``ValueError`` for what is traced or not finite, clips of other joints.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk, run = (jm.samples.load(x, fps=24.0).motion for x in ("walk", "run"))
        >>> far = [jm.cleaning.sequence_distance(walk[:40], x) for x in (walk[40:], run)]
        >>> far[0] < far[1]
        True
    """
    _, (own, another) = thinned(one_skeleton("sequence_distance", [motion, other]))
    found = nearest_words(
        own, another, k=1, length=WORD, target=TARGET, joints=joints, own=False
    ).distance
    return float(np.mean(found)) if found.size else float("inf")


@partial(jax.jit, static_argnames="trim")
def _least(x: Array, y: Array, trim: int) -> Float[Array, " row"]:
    return jnp.min(pose_distance(x, y, trim=trim), axis=1)
