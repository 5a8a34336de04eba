"""A floor: no point is below it.

    rows   sqrt(b) max(floor - height, 0) / L        C a frame        J   -sqrt(b) height' / L, or 0

b: the weight of a depth of one body length L. A point at the very floor is not below. O(T C d).
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmotion.motion import Motion
from jaxmotion.spacetime.terms.term import Pose, Slopes, Term


class FloorTerm(Term):
    """``height``: of the floor, file unit; ``pull``: sqrt(b)."""

    height: Float[Array, ""]
    pull: Float[Array, ""]

    def rows(self, pose: Pose) -> Float[Array, "time row"]:
        return self.pull * self._depth(pose.motion, pose.points) / pose.length

    def jacobian(self, pose: Pose, slopes: Slopes) -> Float[Array, "time row d"]:
        up = pose.motion.skeleton.up_axis
        sunk = jnp.where(pose.points[..., up] < self.height, -self.pull, 0)
        return sunk[..., None] * slopes.points[:, :, up]

    def report(self, motion: Motion, points: Float[Array, "time point 3"]) -> dict[str, Array]:
        return {"penetration": self._depth(motion, points)}

    def _depth(self, motion: Motion, points: Array) -> Float[Array, "time point"]:
        return jnp.maximum(self.height - points[..., motion.skeleton.up_axis], 0)
