"""Where each contact point should be, and how firmly: contacts with soft borders.

    in contact        weight 1,        goal = target
    outside, at most r seconds away    weight h(s/r),  goal = y + target(b) - y(b)
    else              weight 0

y(t): the point on the clip as given; b: the nearest contact frame, s seconds away; h(u) = 1 - 3u^2
+ 2u^3. Around a contact the point keeps its own path, carried along by the correction at the
border, and ever more loosely: no force begins or ends with a jump. Between two contacts closer than
2r the offsets of both are mixed by their weights, and the larger weight holds. O(T C).
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxmotion.frames.runs import last_before, next_after


def ramped_goals(
    positions: Float[Array, "time point 3"],
    target: Float[Array, "time point 3"],
    mask: Bool[Array, "time point"],
    frame_time: Float[Array, ""],
    ramp: Float[Array, ""],
) -> tuple[Float[Array, "time point 3"], Float[Array, "time point"]]:
    """(goals, weights) of the module's table. ``ramp``: r, seconds, at least 0."""
    time = mask.shape[0]
    frame = jnp.broadcast_to(jnp.arange(time, dtype=jnp.int32)[:, None], mask.shape)
    before, after = last_before(mask), next_after(mask)
    offset = jnp.where(mask[..., None], target - positions, 0)

    def side(border, exists):
        seconds = jnp.abs(frame - border).astype(frame_time.dtype) * frame_time
        u = jnp.where(seconds < ramp, seconds / jnp.where(ramp > 0, ramp, 1), 1)
        weight = jnp.where(exists, 1 - u * u * (3 - 2 * u), 0)
        rows = jnp.clip(border, 0, time - 1)[..., None]
        return weight, jnp.take_along_axis(offset, rows, axis=0)

    left, offset_left = side(before, before >= 0)
    right, offset_right = side(after, after < time)
    total = left + right
    share = (left / jnp.where(total > 0, total, 1))[..., None]
    goal = positions + share * offset_left + (1 - share) * offset_right
    weight = jnp.where(mask, 1, jnp.maximum(left, right))
    return jnp.where(mask[..., None], target, goal), weight.astype(positions.dtype)
