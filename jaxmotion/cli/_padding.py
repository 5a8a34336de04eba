"""Clips at a few lengths on their way through a command, so that a folder of clips of many lengths
needs a few compilations, not one each."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion.contacts import Contacts


def pad(motion: "Motion") -> "tuple[Motion, int]":
    """The clip at the next of a few lengths, in NumPy arrays, and how many frames count."""
    from jaxmotion.frames.padding import in_buckets

    padded = motion.with_transforms(*in_buckets(motion.translations, motion.rotations))
    return padded, motion.num_frames


def unpadded(motion: "Motion", length: int) -> "Motion":
    """The frames that count, in NumPy arrays."""
    import numpy as np

    return motion.with_transforms(
        np.asarray(motion.translations)[:length], np.asarray(motion.rotations)[:length]
    )


def unpadded_contacts(contacts: "Contacts", length: int) -> "Contacts":
    """Contacts of the frames that count, in NumPy arrays."""
    import equinox as eqx
    import numpy as np

    from jaxmotion.contacts.contact import over_time

    parts = [np.asarray(part)[:length] for part in over_time(contacts)]
    return eqx.tree_at(over_time, contacts, tuple(parts))
