"""Clips brought near the origin to be worked on: far away, positions have no digits left for feet.

    x' = x - o      o: where the root is in the first frame

Differences of numbers within a factor of two of each other are exact (Sterbenz 1974), so far away
this rounds nothing, and what is worked out from x' is the same wherever the clip is. Answers go
back as changes, x + (y' - x'): what did not change keeps every bit. Nothing depends on which origin
is taken, so o passes no gradient. O(T).
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion._program import one_program
from jaxmotion._types import AnyArray
from jaxmotion.contacts.contact import Contacts
from jaxmotion.motion import Motion


def origin_of(motion: Motion) -> Float[Array, "3"]:
    """o, in the motion's unit and dtype."""
    return _first(motion.translations)


def motion_near(motion: Motion, origin: Float[Array, "3"]) -> Motion:
    """The motion moved by -o."""
    return motion.with_transforms(_moved(motion.translations, -origin))


def moved_as(given: Motion, before: Motion, after: Motion) -> Motion:
    """``after`` back where ``given`` is, whose :func:`motion_near` is ``before``."""
    shift = after.translations[:, 0] - before.translations[:, 0]
    return after.with_transforms(_moved(given.translations, shift))


@one_program()
def _first(translations: AnyArray) -> Array:
    return jax.lax.stop_gradient(translations[0, 0])


@one_program()
def _moved(translations: AnyArray, by: Array) -> Array:
    return translations.at[:, 0].add(by)


def contacts_near(contacts: Contacts, origin: Float[Array, "3"]) -> Contacts:
    """The contacts with targets moved by -o, in the origin's dtype."""
    target = jnp.asarray(contacts.target)
    widest = np.promote_types(target.dtype, origin.dtype)
    moved = target.astype(widest) - origin.astype(widest)
    return eqx.tree_at(lambda c: c.target, contacts, moved.astype(origin.dtype))


def floor_near(motion: Motion, origin: Float[Array, "3"], floor: Any) -> Any:
    """A height moved by -o; what is no number (None, "auto") as it is."""
    if floor is None or isinstance(floor, str):
        return floor
    floor = jnp.asarray(floor)
    widest = np.promote_types(floor.dtype, origin.dtype)
    up = origin[motion.skeleton.up_axis]
    return (floor.astype(widest) - up.astype(widest)).astype(origin.dtype)
