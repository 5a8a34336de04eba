"""An edit that keeps the contacts of what it was made from (Eom et al. 2019, §4.3, Eq. 18).

    contacts of the original  ──targets a foot can meet──▶  satisfy on the edit

Where and when points touched before the edit, they touch after it; the rest of the edit stays, and
what changes fades within about a fifth of a second: slower than ``satisfy`` would, so that no joint
has to hurry much more than it does in the edit. Places are the original's: an edit that moves
the body elsewhere for good is brought back. A clip without contacts, or a skeleton without feet,
comes back as it is.

Contacts are found with :func:`jaxmotion.contacts.detect`, or given. Cost as
:func:`jaxmotion.spacetime.satisfy`, O(T) for a body.
"""

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jaxtyping import Array

from jaxmotion import spacetime
from jaxmotion._checks import counted, static, traced, warn
from jaxmotion._entry import finite_clip, one_clip
from jaxmotion._file_facts import compiled
from jaxmotion._room import Room
from jaxmotion._types import ScalarLike
from jaxmotion.contacts import Contacts, detect, fit_distances
from jaxmotion.contacts.contact import check_frames, check_kept
from jaxmotion.contacts.nearby import contacts_near, motion_near, moved_as, origin_of
from jaxmotion.motion import Motion
from jaxmotion.spacetime.report import cut, roomy

if TYPE_CHECKING:
    from jaxmotion.spacetime.report import Report
    from jaxmotion.spacetime.solve import Weights

_FADE = 0.2  # seconds
_SIZE, _ROOT = 1.25e-7, 8.0


class ConvergenceWarning(UserWarning):
    """The iteration of :func:`keep_contacts` had not come to rest when its steps were used up."""


@static("contacts")
def keep_contacts(
    edit: Motion,
    original: Motion,
    contacts: Contacts | bool = True,
    *,
    length: ScalarLike | None = None,
) -> Motion:
    """The edit with the contacts of the original.

    ``keep_contacts(edit, original=motion)`` or, in this order, ``keep_contacts(edit, motion)``.

    **Arguments:** ``edit``: one clip of T frames, what is to be changed; ``original``: one of T
    frames and the same skeleton, what ``edit`` was made from, whose contacts it gets; ``contacts``:
    those to keep, T frames, or True to find them on the original (outside of ``jit`` and ``vmap``),
    or False for none; ``length``: number of frames that count, the first ones, for padded clips.
    **Returns:** a motion of the edit's shape. Differentiable in the edit and the targets.
    **Raises:** ``ValueError`` for what is not one clip of finite numbers (at run time where it is
    traced), clips or contacts of different lengths, or traced clips without contacts. **Warns:**
    :class:`ConvergenceWarning`, outside of ``jit`` and ``vmap``, where the steps did not come to
    rest; :func:`restore` tells it inside too.

    Source: Eom, Choi and Noh 2019, section 4.3.
    """
    one_clip("keep_contacts", edit, "edit")
    one_clip("keep_contacts", original, "original")
    check_kept(original, contacts, "keep_contacts", length)
    if contacts is False:
        return edit
    edit, count = _counted("keep_contacts", edit, "edit", length)
    finite_clip("keep_contacts", original, "original", length=count)
    if contacts is True:
        contacts = detect(original, length=count)
    check_frames(edit, contacts, "keep_contacts")
    answer, report = _restored(edit, contacts, None, count)
    if not traced(report.converged) and not report.converged:
        warn(
            "keep_contacts",
            f"contacts are not at rest after {int(report.num_steps)} steps: points are up to "
            f"{float(jnp.max(report.position_error)):.3g} (the file's unit) from their places",
            ConvergenceWarning,
        )
    return answer


def restore(
    motion: Motion,
    contacts: Contacts,
    *,
    weights: "Weights | None" = None,
    length: ScalarLike | None = None,
) -> "tuple[Motion, Report]":
    """:func:`~jaxmotion.spacetime.satisfy` with targets that the feet can meet.

    **Arguments:** ``motion``: one clip, T frames; ``contacts``: T frames, found on the motion or on
    what it was edited from, targets in its unit; ``weights``: by default those of a change that
    fades in 0.2 s; ``length``: as :func:`keep_contacts`.
    **Returns:** the motion and a :class:`~jaxmotion.spacetime.Report`. Differentiable in motion,
    targets and weights.
    **Raises:** as ``satisfy``; ``ValueError`` for a length that is no number of the clip's frames.

    Source: Eom, Choi and Noh 2019, Eq. 18.
    """
    check_frames(motion, contacts, "restore")
    motion, count = _counted("restore", motion, "motion", length)
    return _restored(motion, contacts, weights, count)


def _counted(
    caller: str, motion: Motion, name: str, length: ScalarLike | None
) -> tuple[Motion, Array | None]:
    """The clip, checked, and how many of its frames count, None for all."""
    count = None
    if length is not None:
        count, motion = counted(f"{caller}: length", length, motion.num_frames, motion)
    return finite_clip(caller, motion, name, length=count, at_run_time=True), count


def _restored(
    motion: Motion, contacts: Contacts, weights: "Weights | None", length: Array | None
) -> "tuple[Motion, Report]":
    if weights is None:
        weights = spacetime.Weights(size=_SIZE, bend=_SIZE * _FADE**4, root=_ROOT)
    room = Room(motion.num_frames)
    if length is None:
        room, motion, contacts = roomy(motion, contacts, weights)
    start, fitted = _aimed(motion, contacts)
    answer, report = spacetime.satisfy(start, fitted, weights=weights, length=room.length or length)
    return cut(room, _moved_as(motion, start, answer), report)


@compiled
def _aimed(motion: Motion, contacts: Contacts) -> tuple[Motion, Contacts]:
    """The clip and targets that its feet can meet, near the origin once for both steps, or far away
    the targets' rounding would come between."""
    origin = origin_of(motion)
    start = motion_near(motion, origin)
    return start, fit_distances(start, contacts_near(contacts, origin))


_moved_as = compiled(moved_as)
