"""Confine an edit to some joints and frames, and to a part of its strength.

    M′ = M ⊕ w·(E ⊖ M)            M original, E edited, w ∈ [0, 1] per frame and joint

⊕, ⊖ in the world sense of :mod:`jaxmotion.displacement`. Where w = 0 the result is M bit for bit,
where w = 1 it is E (its quaternions in M's hemisphere), and between it goes the short way round.
O(T·J), differentiable in M, E and w (w's derivative is that of the formula; at w = 0 and 1 it is
zero, because there the result is a copy).
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion._checks import static
from jaxmotion._entry import a_motion, skeleton_of
from jaxmotion._file_facts import compiled
from jaxmotion._types import ArrayLike
from jaxmotion.displacement import minus, plus
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton

__all__ = ["confine", "selection_weights"]


def confine(original: Motion, edited: Motion, weight: ArrayLike) -> Motion:
    """The original where ``weight`` is 0, the edit where it is 1, and in between in between.

    **Arguments:** ``original``, ``edited``: clips of one shape, T frames, J joints, leading batch
    axes allowed; ``weight``: a scalar, f[J], f[T, 1] or f[T, J], in [0, 1]; values outside count as
    0 or 1.
    **Returns:** a motion of the same shape, with the edit's skeleton.
    **Raises:** ``ValueError`` for shapes that do not fit.
    """
    a_motion("confine", original, "original")
    a_motion("confine", edited, "edited")
    if original.rotations.shape != edited.rotations.shape:
        raise ValueError(
            f"confine: original has shape {original.rotations.shape}, edited "
            f"{edited.rotations.shape} (time, joint, 4); they must agree"
        )
    weight = jnp.asarray(weight, original.dtype)
    frames, joints = original.num_frames, original.num_joints
    if weight.shape not in ((), (joints,), (frames, 1), (frames, joints)):
        raise ValueError(
            f"confine: weight has shape {weight.shape}; expected a scalar, ({joints},) per joint, "
            f"({frames}, 1) per frame or ({frames}, {joints})"
        )
    return _confine(original, edited, jnp.broadcast_to(weight, (frames, joints)))


@compiled
def _confine(original: Motion, edited: Motion, weight: Array) -> Motion:
    cosine = jnp.sum(original.rotations * edited.rotations, axis=-1, keepdims=True)
    turned = edited.with_transforms(
        rotations=jnp.where(cosine < 0, -edited.rotations, edited.rotations)
    )
    between = plus(original, minus(turned, original).scale(weight))
    none, all_ = weight[..., None] <= 0, weight[..., None] >= 1

    def choose(a, b, partly):
        return jnp.where(none, a, jnp.where(all_, b, partly))

    return edited.with_transforms(
        choose(original.translations, turned.translations, between.translations),
        choose(original.rotations, turned.rotations, between.rotations),
    )


@static("num_frames", "fade")
def selection_weights(
    skeleton: Skeleton | Motion,
    num_frames: int,
    *,
    joints: Sequence[str] = (),
    frames: tuple[int | None, int | None] = (None, None),
    fade: int = 0,
    strength: float = 1.0,
) -> Float[np.ndarray, "time joint"]:
    """Weights for :func:`confine` from names and a range of frames.

    **Arguments:** ``skeleton``: J joints, or a motion of them; ``num_frames``: T; ``joints``: shell
    patterns, any case, all joints if there is none; ``frames``: (first, end) as in
    ``motion[first:end]``; ``fade``: frames, inside the range, over which the weight rises and falls
    as ½ − ½cos (none at an end of the clip, and at most half the range); ``strength``: of the edit
    inside, from 0 to 1.
    **Returns:** f64[T, J].
    **Raises:** ``ValueError`` for a pattern that matches nothing, an empty range, a negative fade
    or a strength outside [0, 1].
    """
    skeleton = skeleton_of("selection_weights", skeleton)
    if not 0 <= strength <= 1:
        raise ValueError(f"selection_weights: strength={strength}; expected a number from 0 to 1")
    if fade < 0:
        raise ValueError(f"selection_weights: fade={fade}; expected a number of frames")
    first, end, _ = slice(*frames).indices(num_frames)
    if first >= end:
        raise ValueError(
            f"selection_weights: frames={frames}; the range leaves none of the {num_frames} frames"
        )
    time = np.arange(num_frames)
    window = ((time >= first) & (time < end)).astype(np.float64)
    ramp = min(fade, (end - first) // 2) + 1.0
    distance = np.full(num_frames, ramp)
    if first > 0:
        distance = np.minimum(distance, time - first + 1)
    if end < num_frames:
        distance = np.minimum(distance, end - time)
    window *= np.where(distance < ramp, 0.5 - 0.5 * np.cos(np.pi * distance / ramp), 1.0)
    chosen = np.zeros(skeleton.num_joints)
    chosen[list(skeleton.matching(*(joints or ("*",))))] = strength
    return window[:, None] * chosen
