"""How well the solvers of :mod:`jaxmotion.spacetime.solve` met what was asked, and room for them:
clips and contacts padded to one of a few sizes, answers and reports cut."""

from collections.abc import Iterator, Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxmotion._portable import Portable
from jaxmotion._room import Room, room_for
from jaxmotion._summary import brief, some
from jaxmotion._types import AnyArray
from jaxmotion.contacts import ContactPoints, Contacts
from jaxmotion.contacts.contact import over_time
from jaxmotion.frames.count import frame_mask
from jaxmotion.motion import Motion
from jaxmotion.spacetime.terms.term import Term


class Report(Portable):
    """How well it went.

    **Fields:**

    - ``position_error``: f[T, C], distance to the target in contact, 0 elsewhere; file unit.
    - ``penetration``: f[T, C], depth below the floor, file unit; 0 without a floor.
    - ``limit_excess``: f[T, J], radians beyond the limits; 0 without.
    - ``cost_before``, ``cost``: E of the clip as given, and of the answer.
    - ``num_steps``: iterations (levels, if hierarchical); ``converged``: whether they reached the
      tolerance (always, if hierarchical: it takes a fixed number).
    """

    position_error: Float[AnyArray, "time point"]
    penetration: Float[AnyArray, "time point"]
    limit_excess: Float[AnyArray, "time joint"]
    cost_before: Float[Array, ""]
    cost: Float[Array, ""]
    num_steps: Int[Array, ""]
    converged: Bool[Array, ""]

    def _words(self) -> Iterator[str]:
        *_, frames, points = self.position_error.shape
        yield some(frames, "frame")
        yield some(points, "point")
        yield f"cost {brief(self.cost_before)} to {brief(self.cost)}"
        yield f"num_steps={brief(self.num_steps)}"
        yield f"converged={brief(self.converged)}"


class Solution(eqx.Module):
    """E before and after, iterations, and whether they came to rest."""

    before: Float[Array, ""]
    after: Float[Array, ""]
    steps: Int[Array, ""]
    converged: Bool[Array, ""]


def report_of(
    answer: Motion,
    points: ContactPoints,
    terms: Sequence[Term],
    count: Int[Array, ""] | None,
    solution: Solution,
) -> Report:
    """What the terms say of the answer, in the frames that count."""
    y = points.positions(answer)
    none = jnp.zeros(y.shape[:2], y.dtype)
    nothing = jnp.zeros(answer.rotations.shape[:2], answer.dtype)
    fields = {"position_error": none, "penetration": none, "limit_excess": nothing}
    for term in terms:
        fields |= term.report(answer, y)
    if count is not None:
        counts = frame_mask(count, answer.num_frames)[:, None]
        fields = {name: jnp.where(counts, x, 0) for name, x in fields.items()}
    return Report(
        **fields,
        cost_before=solution.before,
        cost=solution.after,
        num_steps=solution.steps,
        converged=solution.converged,
    )


def roomy(motion: Motion, contacts: Contacts, *given) -> tuple[Room, Motion, Contacts]:
    """Room for a clip and its contacts, and both in it; ``given``: what else may be traced."""
    room = room_for(motion, contacts, given)
    return room, room.fill(motion), room.fill(contacts, over_time)


def cut(room: Room, answer: Motion, report: Report) -> tuple[Motion, Report]:
    """The frames that count of what came out."""

    def by_frame(report):
        return report.position_error, report.penetration, report.limit_excess

    return room.cut(answer), room.cut(report, by_frame)
