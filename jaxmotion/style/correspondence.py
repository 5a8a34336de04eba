"""Which frames of two clips do the same, as weights for their statistics (Wu et al. 2006, §4).

Iterative motion warping (``timing.motion_warping``) sets every frame of a refined reference beside
one of the source; each pair of frames counts once. So a frame's weight is the number of frames of
the other clip that it stands beside, and the statistics of the weighted clips are those of the
warped ones, the recursive mean too: n steps of slerp towards one rotation by 1/k, 1/(k + 1), .. are
one by its share. The same map is then applied to every copy of a source frame, so that the reverse
warp, which averages them, gives back the frame it began with.

The channels are the deviations of all joints below the body's from their means, and its lean; where
it goes and which way do not count. Clips of more than 2048 frames, and one of more than twice
the other's length, are warped at every k-th frame, which stands for the k that begin there: memory
stays below 2048 × 4096 numbers, time O(T).
"""

import math
from typing import Literal, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jaxmotion.motion import Motion
from jaxmotion.quaternion import mean
from jaxmotion.style.root import body_of, lean, upright
from jaxmotion.style.statistics import deviations
from jaxmotion.timing import MotionWarp, motion_warping

Warp: TypeAlias = Literal["shared", "per_channel"]
_MOST = 2048


def corresponding(
    source: Motion, reference: Motion, theirs: tuple[int, ...], warp: Warp
) -> tuple[MotionWarp, Float[Array, "source ..."], Float[Array, "reference ..."]]:
    """The warp, and the weight of every frame of both clips: f[T], or with "per_channel", where
    each joint has a warp of its own and the root that of its lean, f[T, J]. ``theirs``: the
    reference's joint for each of the source's, -1 for none."""
    sizes = source.num_frames, reference.num_frames
    steps = strides(*sizes)
    # The bodies go by their lean, whatever their names.
    bodies = body_of(source), body_of(reference)
    below = [(j, k) for j, k in enumerate(theirs) if j > bodies[0] and k > bodies[1]]
    paired = list(zip(bodies, *below, strict=True))
    channels = [
        lax.stop_gradient(_channels(clip)[::k, np.array(joints)])
        for clip, joints, k in zip((source, reference), paired, steps, strict=True)
    ]
    if warp == "shared":
        found = motion_warping(*(x.reshape(len(x), -1) for x in channels))
        weights = _pairs(found)
    else:
        found = jax.vmap(motion_warping, in_axes=(1, 1))(*channels)
        weights = jax.vmap(_pairs, out_axes=1)(found)
    whole = []
    for clip, w, joints, k in zip((source, reference), weights, paired, steps, strict=True):
        w = jnp.repeat(w.astype(clip.dtype), k, axis=0)[: clip.num_frames]
        if warp == "per_channel":
            every = jnp.ones((clip.num_frames, clip.num_joints), clip.dtype)
            w = every.at[:, np.array(joints)].set(w)
        whole.append(w)
    return found, whole[0], whole[1]


def strides(source: int, reference: int) -> tuple[int, int]:
    """Every how many frames of each clip are warped."""
    return (
        max(math.ceil(source / _MOST), math.ceil(source / (2 * reference))),
        max(math.ceil(reference / _MOST), math.ceil(reference / (2 * source))),
    )


def _channels(motion: Motion) -> Float[Array, "time joint 3"]:
    """Deviations of every joint; of the body the lean, with a 0."""
    middle = mean(motion.rotations, method="chordal")
    leant = lean(motion, upright(motion))
    leant = jnp.pad(leant - jnp.mean(leant, axis=0), ((0, 0), (0, 1)))
    return deviations(middle, motion.rotations).at[:, body_of(motion)].set(leant)


def _pairs(warp: MotionWarp) -> tuple[Array, Array]:
    """How many frames of the other clip each frame stands beside."""
    new = warp.is_new_pair.astype(warp.runs.dtype)
    ends = warp.source_index, warp.reference_index
    sizes = warp.runs.shape[0], warp.num_refined // warp.repeats
    source, reference = (
        jax.ops.segment_sum(new, at, size) for at, size in zip(ends, sizes, strict=True)
    )
    return source, reference
