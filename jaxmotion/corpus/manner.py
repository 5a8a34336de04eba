"""The manner of a corpus (:mod:`jaxmotion.style.statistics`), with one clip in memory at a time.

    q̄   the chordal mean over all frames
    C   Σ v vᵀ / N, v of each clip about q̄, its signs going on from frame to frame
    root's channels: mean and deviation over all frames; ω̄ from Σ |q̇|² and Σ tr C

What ``motion_style(list(corpus), mean="chordal")`` is, to rounding. Clips go to JAX at a few
lengths. O(frames · J).
"""

from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmotion import quaternion
from jaxmotion._posture import counting, upright
from jaxmotion._room import room_for
from jaxmotion._types import AnyArray
from jaxmotion.corpus.statistics import mean_rotations
from jaxmotion.motion import Motion
from jaxmotion.style import MotionStyle
from jaxmotion.style.root import encode, rounding
from jaxmotion.style.statistics import STILL, deviations

if TYPE_CHECKING:
    from jaxmotion.corpus.view import View


def corpus_style(view: "View") -> MotionStyle:
    """The manner of some clips together."""
    kind = view.frame_time.dtype
    middle = jax.device_put(mean_rotations(view).astype(kind))
    stands, square, turned, steps, rows = None, 0.0, 0.0, 0, []
    smallest = np.zeros(6)
    for k in range(len(view.numbers)):
        clip = view.motion(k)
        room = room_for(clip, longest=np.inf)
        clip = room.fill(clip)
        if stands is None:
            stands = upright(clip, room.count)
        found = _of_clip(clip, middle, jnp.asarray(stands, kind), room.count)
        wide = [np.asarray(x, np.float64) for x in found]
        square, turned = square + wide[0], turned + wide[1]
        of_root = wide[2][: room.frames]
        rows.append((of_root.sum(axis=0), ((of_root - of_root.mean(axis=0)) ** 2).sum(axis=0)))
        rows[-1] = (room.frames, *rows[-1])
        smallest = np.maximum(smallest, wide[3])
        steps += room.frames - 1
    count = sum(n for n, _, _ in rows)
    mean = sum(total for _, total, _ in rows) / count
    spread = sum(m2 + n * (total / n - mean) ** 2 for n, total, m2 in rows) / count
    covariance = square / count
    below = slice(clip.body_joint + 1, None)
    far = np.trace(np.asarray(covariance)[below], axis1=-2, axis2=-1).sum()
    fast = np.asarray(turned)[below].sum() / max(steps, 1) / float(view.frame_time) ** 2
    tempo = 0.0 if far <= STILL**2 else np.sqrt(fast / far)
    deviation = np.where(spread > smallest**2, np.sqrt(spread), 0)
    skeleton = view.store.settings.skeleton
    arrays = (covariance, mean, deviation, np.asarray(stands), np.asarray(tempo))
    cast = [jnp.asarray(np.asarray(x).astype(kind)) for x in arrays]
    return MotionStyle(skeleton.names, middle, *cast, up=skeleton.up)


@eqx.filter_jit
def _of_clip(
    clip: Motion,
    middle: Float[AnyArray, "joint 4"],
    stands: Float[AnyArray, "3"],
    count: Int[Array, ""],
) -> tuple[Array, Array, Array, Array]:
    """Σ v vᵀ f[J, 3, 3] and Σ |turn|² f[J] over the frames that count, the root's channels
    f[T, 6], and what of them is rounding f[6]."""
    counts = counting(count, clip.num_frames)[:, None]
    v = jnp.where(counts[..., None], deviations(middle, clip.rotations, count), 0)
    turn = quaternion.log(quaternion.between(clip.rotations[:-1], clip.rotations[1:]))
    turned = jnp.sum(jnp.where(counts[1:], jnp.sum(turn**2, axis=-1), 0), axis=0)
    channels = encode(clip, stands, count)[0]
    return jnp.einsum("tja,tjb->jab", v, v), turned, channels, rounding(clip)
