"""Contacts: points are where they should be, as firmly as the frame asks.

    rows   sqrt(a w) (y - goal) / L        3C a frame        J   sqrt(a w) y' / L

y: the points; goal, w: :mod:`jaxmotion.spacetime.goals`, w = 1 in contact; a: the weight of a miss
by one body length L. O(T C d).
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxmotion._numerics import safe_norm
from jaxmotion.contacts import Contacts
from jaxmotion.motion import Motion
from jaxmotion.spacetime.goals import ramped_goals
from jaxmotion.spacetime.terms.term import Pose, Slopes, Term


class ContactTerm(Term):
    """``pull``: sqrt(a w); ``mask``: where a point is in contact, and its goal the target."""

    goal: Float[Array, "time point 3"]
    pull: Float[Array, "time point"]
    mask: Bool[Array, "time point"]

    def rows(self, pose: Pose) -> Float[Array, "time row"]:
        missed = self.pull[..., None] * (pose.points - self.goal) / pose.length
        return missed.reshape(len(missed), 3 * self.pull.shape[1])

    def jacobian(self, pose: Pose, slopes: Slopes) -> Float[Array, "time row d"]:
        frames, points, _, d = slopes.points.shape
        return (self.pull[..., None, None] * slopes.points).reshape(frames, 3 * points, d)

    def report(self, motion: Motion, points: Float[Array, "time point 3"]) -> dict[str, Array]:
        error = safe_norm(points - self.goal)
        # A distance that is all rounding has no direction in which to grow.
        rounding = 16 * float(jnp.finfo(points.dtype).eps) * jnp.max(jnp.abs(points), axis=-1)
        return {"position_error": jnp.where(self.mask & (error > rounding), error, 0)}

    @property
    def firmness(self) -> Float[Array, " time"]:
        return jnp.max(self.pull, axis=1, initial=0) ** 2


def contact_term(
    motion: Motion,
    contacts: Contacts,
    target: Float[Array, "time point 3"],
    weight: Float[Array, ""],
    ramp: Float[Array, ""],
) -> ContactTerm:
    """The term of a clip's contacts. ``target``: theirs, finite everywhere; ``ramp``: seconds."""
    positions = contacts.points.positions(motion)
    mask = jnp.asarray(contacts.mask)
    goal, share = ramped_goals(positions, target, mask, motion.frame_time, ramp)
    # sqrt has no slope at weight 0, where there is nothing to differentiate.
    some = share > 0
    pull = jnp.where(some, jnp.sqrt(weight * jnp.where(some, share, 1)), 0)
    return ContactTerm(goal, pull, mask)
