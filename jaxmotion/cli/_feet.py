"""What an edit does to the feet: how they slide before and after, and the contacts that are kept.

Slides are measured where the original's feet touch, in the original, in the edit and in the result.
Contacts are restored if the edit slides visibly more than the original, unless the user decides.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jaxmotion.cli._terminal import Notice

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion.contacts import Contacts

_VISIBLE = 0.04  # of the leg's length a second: some 3 cm/s for a person


@dataclass(frozen=True)
class Skate:
    """Mean speeds of points in contact, file unit a second.

    **Fields:** ``before``: in the original; ``edited``: in the edit; ``after``: in the result;
    ``kept``: whether contacts were restored in it, ``contacts`` how many, and ``root`` the furthest
    that this moved the root, file unit; ``metres``: the file's unit, ``None`` where it is not told.
    """

    before: float
    edited: float
    after: float
    kept: bool
    metres: float | None
    contacts: int = 0
    root: float = 0.0

    def __str__(self) -> str:
        scale, unit = (1.0, " a second") if self.metres is None else (100 * self.metres, " cm/s")
        speeds = (self.before, self.after, self.edited)
        before, after, edited = (f"{scale * speed:.3g}" for speed in speeds)
        kept = f" (contacts kept; else {edited})" if self.kept and edited != before else ""
        return f"feet slid at {before}, now {after}{unit}{kept}"


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
    length: int,
    keep: bool | None,
    find: "Callable[[Motion, int], Contacts]" = find_feet,
    *,
    restore: "Callable[[Motion, Motion, Contacts, int], Motion]" = keep_contacts,
    within: "Callable[[Motion], Motion] | None" = None,
) -> "tuple[Motion, Skate | None]":
    """The edit, with the original's contacts if they are to be kept, and how feet slide, ``None``
    if none touch.

    **Arguments:** ``original``, ``edited``: padded clips of one shape, of which the first
    ``length`` frames count; ``keep``: ``None`` to keep contacts that slide visibly more; ``find``:
    finds them; ``restore(edited, original, contacts, length)`` has them stand still; ``within``:
    leaves of what that changed what is wanted.
    """
    import numpy as np

    from jaxmotion.metrics import foot_skate

    block = in_blocks(original, length)
    contacts = find(block, length)
    if not np.asarray(contacts.mask).any():
        if keep:
            warnings.warn("no feet found that touch: no contacts are kept", Notice, stacklevel=2)
        return edited, None
    before = foot_skate(block, contacts)
    plain = foot_skate(in_blocks(edited, length), contacts)
    metres = original.skeleton.conventions.metres
    if keep is None:
        keep = plain > before + _VISIBLE * _leg(original, contacts)
    if not keep:
        return edited, Skate(before, plain, plain, False, metres)
    kept = restore(edited, original, for_frames(contacts, edited), length)
    kept = kept if within is None else within(kept)
    after = foot_skate(in_blocks(kept, length), contacts)
    roots = (np.asarray(clip.translations)[:length, 0] for clip in (edited, kept))
    moved = np.linalg.norm(np.subtract(*roots), axis=-1).max()
    return kept, Skate(before, plain, after, True, metres, _count(contacts), float(moved))


def _count(contacts: "Contacts") -> int:
    """How often a point comes to touch."""
    import numpy as np

    mask = np.asarray(contacts.mask)
    return int(mask[0].sum() + (mask[1:] & ~mask[:-1]).sum())


def _leg(motion: "Motion", contacts: "Contacts") -> float:
    """Length of the longest limb above a point, in the first frame."""
    import numpy as np

    bones = np.linalg.norm(np.asarray(motion.translations)[0], axis=-1)
    limbs = [limb for limb in contacts.limbs if limb is not None]
    return max((float(bones[middle] + bones[end]) for _, middle, end in limbs), default=0.0)


def in_blocks(motion: "Motion", length: int) -> "Motion":
    """The frames that count, padded to one of very few lengths, in NumPy arrays."""
    import numpy as np

    from jaxmotion.frames.padding import padded, program_size

    parts = (np.asarray(x)[:length] for x in (motion.translations, motion.rotations))
    size = program_size(length)
    return motion.with_transforms(*(padded(part, size) for part in parts))  # type: ignore[arg-type]


def for_frames(contacts: "Contacts", motion: "Motion") -> "Contacts":
    """Contacts found on a clip, for the frames of the same clip padded otherwise."""
    import jax.numpy as jnp

    return contacts.at_frames(jnp.arange(motion.num_frames, dtype=float))
