"""What an edit does to the feet: how they slide before and after, and the contacts that are kept.

Slides are measured where the original's feet touch, in the original, in the edit and in the result.
Contacts are restored if the edit slides visibly more than the original, unless the user decides.

Another timing alone changes how fast feet slide: an edit of timing is compared with the original's
own frames in the new timing, each as the nearest of the edit shows it, and only between frames that
touch: how a foot comes and goes is no slide.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from jaxmotion._plain import some
from jaxmotion.cli._padding import pad, unpadded
from jaxmotion.cli._terminal import Notice

if TYPE_CHECKING:
    from jax import Array

    from jaxmotion import Motion
    from jaxmotion._types import ArrayLike
    from jaxmotion.contacts import Contacts

_VISIBLE = 0.04  # of the leg's length a second: some 3 cm/s for a person


@dataclass(frozen=True)
class Skate:
    """Mean speeds of points in contact, file unit a second.

    **Fields:** ``before``: in the original; ``edited``: in the edit; ``after``: in the result;
    ``kept``: whether contacts were restored in it, ``contacts`` how many, and ``root`` the furthest
    that this moved the root, file unit; ``metres``: the file's unit, ``None`` where it is not told;
    ``timed``: in the original's frames in the timing of the edit, if that is another.
    """

    before: float
    edited: float
    after: float
    kept: bool
    metres: float | None
    contacts: int = 0
    root: float = 0.0
    timed: float | None = None

    def __str__(self) -> str:
        scale, unit = (1.0, " a second") if self.metres is None else (100 * self.metres, " cm/s")
        speeds = (self.before, self.after, self.edited, self.timed or 0.0)
        before, after, edited, timed = (f"{scale * speed:.3g}" for speed in speeds)
        many = some(self.contacts, "contact")
        otherwise = f"; else {edited}" if edited != before else ""
        kept = f" ({many} kept{otherwise})" if self.kept else ""
        timing = f" ({timed} in the new timing)" if self.timed is not None else ""
        return f"feet slid at {before}{timing}, now {after}{unit}{kept}"


def find_feet(motion: "Motion", length: int) -> "Contacts":
    """Contacts of the feet of a padded clip."""
    from jaxmotion.contacts import detect

    return detect(motion, length=length)


def keep_contacts(
    edited: "Motion", original: "Motion", contacts: "Contacts", length: int
) -> "Motion":
    """The library's: the contacts of the original in an edit of it."""
    from jaxmotion import spacetime

    return spacetime.keep_contacts(edited, original, contacts, length=length)


def with_contacts(
    original: "Motion",
    edited: "Motion",
    contacts: "Contacts",
    length: int,
    keep: bool | None,
    *,
    restore: "Callable[[Motion, Motion, Contacts, int], Motion]" = keep_contacts,
    within: "Callable[[Motion], Motion] | None" = None,
) -> "tuple[Motion, Skate | None]":
    """The edit, with the original's contacts if they are to be kept, and how feet slide, ``None``
    if none touch.

    **Arguments:** ``original``, ``edited``: padded clips of one shape, of which the first
    ``length`` frames count; ``contacts``: of the original; ``keep``: ``None`` to keep contacts
    that slide visibly more; ``restore(edited, original, contacts, length)`` has them stand still;
    ``within``: leaves of what that changed what is wanted.
    """
    import numpy as np

    from jaxmotion.contacts import intervals
    from jaxmotion.metrics import foot_skate

    if not np.asarray(contacts.mask).any():
        if keep:
            warnings.warn("no feet found that touch: no contacts are kept", Notice, stacklevel=2)
        return edited, None
    before = foot_skate(original, contacts)
    plain = foot_skate(edited, contacts)
    metres = original.skeleton.conventions.metres
    if keep is None:
        keep = plain > before + _VISIBLE * _leg(original, contacts)
    if not keep:
        return edited, Skate(before, plain, plain, False, metres)
    kept = restore(edited, original, contacts, length)
    kept = kept if within is None else within(kept)
    after = foot_skate(kept, contacts)
    roots = (np.asarray(clip.translations)[:length, 0] for clip in (edited, kept))
    moved = np.linalg.norm(np.subtract(*roots), axis=-1).max()
    return kept, Skate(before, plain, after, True, metres, len(intervals(contacts)), float(moved))


def with_feet(
    original: "Motion", edited: "Motion", keep: bool | None
) -> "tuple[Motion, Skate | None]":
    """:func:`with_contacts` of the feet, for clips that are not padded."""
    before, length = pad(original)
    contacts = find_feet(before, length)
    kept, skate = with_contacts(before, pad(edited)[0], contacts, length, keep)
    return unpadded(kept, length), skate


def with_timed_feet(
    original: "Motion", retimed: "Motion", source_frames: "ArrayLike", keep: bool | None
) -> "tuple[Motion, Skate | None]":
    """:func:`with_feet` for an edit of timing: ``source_frames`` f[N], the frame of the original, a
    fraction too, that each of its N frames shows."""
    import jax.numpy as jnp
    import numpy as np

    from jaxmotion.metrics import foot_skate

    before, frames = pad(original)
    edited, length = pad(retimed)
    contacts = find_feet(before, frames)
    at = np.clip(np.round(np.asarray(source_frames, float), 6), 0, frames - 1)
    at = at[np.minimum(np.arange(edited.num_frames), length - 1)]
    nearest = np.rint(at).astype(int)
    shown = edited.with_transforms(before.translations[nearest], before.rotations[nearest])
    carried = _carried(contacts, jnp.asarray(at), length)
    kept, skate = with_contacts(shown, edited, carried, length, keep)
    if skate is not None:
        own = foot_skate(before, contacts)
        skate = replace(skate, before=own, timed=skate.before)
    return unpadded(kept, length), skate


def _carried(contacts: "Contacts", at: "Array", length: int) -> "Contacts":
    """The contacts for frames that show the times ``at``, the first ``length`` of which count: what
    touches in the frames before and after touches between them."""
    import equinox as eqx
    import jax.numpy as jnp
    import numpy as np

    before, after = (contacts.at_frames(beside(at)).mask for beside in (jnp.floor, jnp.ceil))
    mask = before & after & (np.arange(len(at)) < length)[:, None]
    return eqx.tree_at(lambda c: c.mask, contacts.at_frames(at), mask)


def _leg(motion: "Motion", contacts: "Contacts") -> float:
    """Length of the longest limb above a point, in the first frame."""
    import numpy as np

    bones = np.linalg.norm(np.asarray(motion.translations)[0], axis=-1)
    limbs = [limb for limb in contacts.limbs if limb is not None]
    return max((float(bones[middle] + bones[end]) for _, middle, end in limbs), default=0.0)
