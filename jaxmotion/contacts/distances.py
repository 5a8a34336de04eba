"""Targets that one foot can meet: heel and ball as far apart as the body has them.

Contacts found apart have targets whose distance is not quite the foot's (a heel that rises a little
while it still counts as down), and nothing can meet both. The point that comes down later, while
the other one stands, gives way for as long as it stays down:

    g_B <- g_A + |y_B - y_A| (g_B - g_A)/|g_B - g_A|       at its first frame; the same shift after

g: targets; y: the points on the motion. Kovar, Schreiner & Gleicher (2002), first step. O(T C).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxmotion._entry import finite_clip
from jaxmotion._numerics import safe_norm
from jaxmotion.contacts.contact import Contacts, check_frames
from jaxmotion.contacts.nearby import contacts_near, motion_near, origin_of
from jaxmotion.motion import Motion


def fit_distances(motion: Motion, contacts: Contacts) -> Contacts:
    """The contacts with targets moved to distances that ``motion`` has, limb by limb.

    Kovar, Schreiner & Gleicher 2002, first step; the module has the equation.

    **Arguments:** ``motion``: one clip, T frames; ``contacts``: of T frames.
    **Returns:** :class:`Contacts`; only targets in contact differ, and only of limbs that carry two
    points.
    **Raises:** ``ValueError`` when the contacts have another number of frames.
    """
    check_frames(motion, contacts, "fit_distances")
    finite_clip("fit_distances", motion)
    limbs = [limb for limb in dict.fromkeys(contacts.limbs) if limb is not None]
    of_limb = [[c for c, other in enumerate(contacts.limbs) if other == limb] for limb in limbs]
    pairs = np.array([points for points in of_limb if len(points) == 2], int).reshape(-1, 2)
    if not len(pairs):
        return contacts
    origin = origin_of(motion)
    y = contacts.points.positions(motion_near(motion, origin))[:, pairs]
    goal = contacts_near(contacts, origin).target[:, pairs]
    apart = safe_norm(y[:, :, 1] - y[:, :, 0])
    on = contacts.mask[:, pairs]
    shift = jnp.where(on[..., None], move_later(on, goal, apart) - goal, 0)
    target = jnp.asarray(contacts.target, motion.dtype).at[:, pairs].add(shift)
    return eqx.tree_at(lambda c: c.target, contacts, target)


@jax.jit  # or every eager call would compile the scan anew
def move_later(
    on: Bool[Array, "time limb 2"],
    goal: Float[Array, "time limb 2 3"],
    distance: Float[Array, "time limb"],
) -> Float[Array, "time limb 2 3"]:
    """The module's equation for pairs of points, and for all their frames."""

    def project(moving, still, apart):
        line = moving - still
        length = safe_norm(line, keepdims=True)
        unit = line / jnp.where(length > 0, length, 1)
        return jnp.where(length > 0, still + apart[:, None] * unit, moving)

    def step(carry, now):
        before, shift = carry
        on, goal, apart = now
        begins = on & ~before
        shift = jnp.where(begins[..., None], 0, shift)
        first, second = jnp.unstack(goal + shift, axis=1)
        stands = (on & before).T
        fitted_first = project(first, second, apart) - goal[:, 0]
        fitted_second = project(second, first, apart) - goal[:, 1]
        shift_first = jnp.where((begins[:, 0] & stands[1])[:, None], fitted_first, shift[:, 0])
        late = begins[:, 1] & on[:, 0]
        shift_second = jnp.where(late[:, None], fitted_second, shift[:, 1])
        shift = jnp.stack([shift_first, shift_second], axis=1)
        return (on, shift), goal + shift

    start = jnp.zeros(on.shape[1:], bool), jnp.zeros_like(goal[0])
    return jax.lax.scan(step, start, (on, goal, distance))[1]
