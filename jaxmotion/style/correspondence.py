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
stays below 2048 × 4096 numbers, time O(T). No more than twice the other's frames are warped.
"""

import math
from typing import Literal, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jaxmotion._posture import counting, upright
from jaxmotion._room import Room
from jaxmotion.motion import Motion
from jaxmotion.quaternion import mean
from jaxmotion.style.root import lean
from jaxmotion.style.statistics import deviations
from jaxmotion.timing.motion_warping import ENOUGH, ROUNDS, SMOOTHNESS, MotionWarp, cut_warp, warped

Warp: TypeAlias = Literal["shared", "per_channel"]
_MOST = 2048
_SLOPE = 2


@eqx.filter_jit
def corresponding(
    source: Motion,
    reference: Motion,
    counts: tuple[Int[Array, ""], Int[Array, ""]],
    steps: tuple[int, int],
    theirs: tuple[int, ...],
    warp: Warp,
) -> tuple[MotionWarp, Float[Array, "source ..."], Float[Array, "reference ..."]]:
    """The warp, and the weight of every frame of both clips: f[T], or with "per_channel", where
    each joint has a warp of its own and the root that of its lean, f[T, J]. ``counts``: how many
    frames of each count; ``steps``: the :func:`strides` of these; ``theirs``: the reference's joint
    for each of the source's, -1 for none."""
    clips = source, reference
    # The bodies go by their lean, whatever their names.
    bodies = source.body_joint, reference.body_joint
    below = [(j, k) for j, k in enumerate(theirs) if j > bodies[0] and k > bodies[1]]
    paired = list(zip(bodies, *below, strict=True))
    channels = [
        lax.stop_gradient(_channels(clip, n)[::k, np.array(joints)])
        for clip, n, k, joints in zip(clips, counts, steps, paired, strict=True)
    ]
    taken = (counts[0] + steps[0] - 1) // steps[0], (counts[1] + steps[1] - 1) // steps[1]
    kind = source.dtype
    smoothness, enough = jnp.full(2, SMOOTHNESS, kind), jnp.asarray(ENOUGH, kind)

    def beside(x: Array, y: Array) -> tuple[MotionWarp, tuple[Array, Array]]:
        found = warped(x, y, taken, True, _SLOPE, smoothness, ROUNDS, enough)
        return found, _pairs(found, taken[1])

    if warp == "shared":
        found, weights = beside(*(x.reshape(len(x), -1) for x in channels))
    else:
        found, weights = jax.vmap(beside, 1, (0, 1))(*channels)
    whole = []
    for clip, w, joints, k in zip(clips, weights, paired, steps, strict=True):
        w = jnp.repeat(w.astype(kind), k, axis=0)[: clip.num_frames]
        if warp == "per_channel":
            every = jnp.ones((clip.num_frames, clip.num_joints), kind)
            w = every.at[:, np.array(joints)].set(w)
        whole.append(w)
    return found, whole[0], whole[1]


def without_room(
    found: MotionWarp, rooms: tuple[Room, Room], steps: tuple[int, int], warp: Warp | None
) -> MotionWarp:
    """The warp of the frames that count, of one of clips in these rooms."""
    source, reference = (
        Room(-(-room.frames // k), room.size) for room, k in zip(rooms, steps, strict=True)
    )
    return cut_warp(found, source, reference, axis=int(warp == "per_channel"))


def strides(source: int, reference: int) -> tuple[int, int]:
    """Every how many frames of each clip are warped."""
    return (
        max(math.ceil(source / _MOST), math.ceil(source / (2 * reference))),
        max(math.ceil(reference / _MOST), math.ceil(reference / (2 * source))),
    )


def _channels(motion: Motion, count: Int[Array, ""]) -> Float[Array, "time joint 3"]:
    """Deviations of every joint; of the body the lean, with a 0."""
    counts = counting(count, motion.num_frames)
    middle = mean(motion.rotations, counts.astype(motion.dtype), method="chordal")
    leant = lean(motion, upright(motion, count))
    leant = leant - jnp.mean(leant, axis=0, where=counts[:, None])
    away = deviations(middle, motion.rotations, count)
    return away.at[:, motion.body_joint].set(jnp.pad(leant, ((0, 0), (0, 1))))


def _pairs(warp: MotionWarp, count: Int[Array, ""]) -> tuple[Array, Array]:
    """How many frames of the other clip each frame stands beside, of ``count`` of the reference."""
    counts = counting(warp.repeats * count, warp.num_refined)
    new = (warp.is_new_pair & counts).astype(warp.runs.dtype)
    ends = warp.source_index, warp.reference_index
    sizes = warp.runs.shape[0], warp.num_refined // warp.repeats
    source, reference = (
        jax.ops.segment_sum(new, at, size) for at, size in zip(ends, sizes, strict=True)
    )
    return source, reference
