"""Frames before the first datum and after the last, of which nothing is told.

Going on there without any change costs the prior nothing, so that the answer between the data does
not depend on them, and beyond goes on at the speed it has at the end (order 2) or stays (order 1).
In a solve they do harm: n frames that hang one from the other take log10(n⁴) digits.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from jaxmotion import quaternion
from jaxmotion._types import Quaternion
from jaxmotion.smoothing.design import Observations


class Ends(NamedTuple):
    """Frames of the first and the last datum of every joint, or of all."""

    first: Int[Array, " #joints"]
    last: Int[Array, " #joints"]

    def inside(self, frames: int) -> Bool[Array, "frames #joints"]:
        """Which frames lie between."""
        frame = jnp.arange(frames)[:, None]
        return (frame >= self.first) & (frame <= self.last)

    def continued(self, x: Quaternion, order: int) -> Quaternion:
        """Rotations x f[frames, joints, 4], those beyond as what lies between goes on."""
        frame, joint = jnp.arange(len(x))[:, None], jnp.arange(x.shape[1])
        first, last = (jnp.broadcast_to(end, x.shape[1:2]) for end in self)
        second = jnp.minimum(first + order - 1, last)
        last_but_one = jnp.maximum(last - order + 1, first)

        def on(end: Array, beside: Array) -> Array:
            here = x[end, joint]
            step = quaternion.log(quaternion.between(x[beside, joint], here))
            away = jnp.abs(frame - end)[..., None].astype(x.dtype)
            return quaternion.multiply(here, quaternion.exp(away * step))

        before, after = (frame < first)[..., None], (frame > last)[..., None]
        return jnp.where(before, on(first, second), jnp.where(after, on(last, last_but_one), x))


def ends_of(seen: Observations, counts: Bool[Array, "data #joints"]) -> Ends:
    """Those of the data that count; of a joint without any, all frames lie between."""
    told = jnp.zeros((seen.num_frames, counts.shape[1]), bool)
    for at in seen.frames:
        told = told.at[at].max(counts)
    return Ends(jnp.argmax(told, axis=0), len(told) - 1 - jnp.argmax(told[::-1], axis=0))
