"""Contacts as a list: one entry a contact, from its first frame to its last. NumPy, O(T·C)."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jaxmotion._summary import brief, called, line
from jaxmotion.contacts.contact import Contacts, check_contacts
from jaxmotion.frames.runs import spans

KIND_NAMES = ("free", "point", "line", "plane")


class Interval(NamedTuple):
    """One contact, from its first frame to its last.

    **Fields:** ``point``: name of the point; ``joint``: index of its joint; ``first``, ``last``:
    frames from 0, both in contact; ``kind``: "point", "line" or "plane", the most frequent;
    ``target``: (x, y, z), world, file unit; ``confidence``: the mean over the contact, in [0, 1].
    """

    point: str
    joint: int
    first: int
    last: int
    kind: str
    target: tuple[float, float, float]
    confidence: float

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield called([self.point])
        yield f"frames {brief(self.first)} to {brief(self.last)}"
        yield self.kind
        yield f"at {brief(self.target)}"
        yield f"confidence {brief(self.confidence)}"


def intervals(contacts: Contacts) -> list[Interval]:
    """Every contact, in the order of the points and then of time.

    **Arguments:** ``contacts``: T frames, C points, not traced.
    **Returns:** a list of :class:`Interval`.
    """
    check_contacts(contacts, "intervals")
    mask, kind = np.asarray(contacts.mask), np.asarray(contacts.kind)
    target, confidence = np.asarray(contacts.target), np.asarray(contacts.confidence)
    found = []
    for c, (name, joint) in enumerate(zip(contacts.names, contacts.joints, strict=True)):
        for first, end in spans(mask[:, c]):
            x, y, z = (float(v) for v in target[first, c])
            common = KIND_NAMES[np.bincount(kind[first:end, c], minlength=4).argmax()]
            sure = float(confidence[first:end, c].mean())
            found.append(Interval(name, joint, first, end - 1, common, (x, y, z), sure))
    return found
