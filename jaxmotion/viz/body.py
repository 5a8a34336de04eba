"""Which points are the figure's: a root that stays on the floor while the body goes is none of it.

A link to a parent is loose if its length varies by more than a fiftieth: no bone. Points that bones
hold together are a part; the largest part is the body, if it has half of the points at least, else
all of them are.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

_LOOKED_AT = 64  # frames
_STRETCH = 0.02  # of a link's length: what varies more is no bone


class Body(NamedTuple):
    """``points``: bool[P], those of the body; ``loose``: bool[P], whose link to the parent is no
    bone; ``first``: the number of the body's first point, in its skeleton's order."""

    points: Bool[np.ndarray, " point"]
    loose: Bool[np.ndarray, " point"]
    first: int

    def drawn(self, parents: Sequence[int]) -> Bool[np.ndarray, " point"]:
        """Of which points the link to the parent is to be seen: not one out of the body."""
        above = np.array(parents)
        return (above >= 0) & ~(self.loose & ~self.points[above])


def body_of(points: Float[np.ndarray, "time point 3"], parents: Sequence[int]) -> Body:
    """The body of a clip in the world; ``parents``: of joints, then of end sites, −1 of the root.
    Poses that are not finite do not count."""
    poses, above = some_poses(points), np.array(parents)
    count = len(above)
    loose = np.zeros(count, bool)
    if len(poses):
        long = np.linalg.norm(poses - poses[:, above], axis=-1)
        loose = (np.ptp(long, axis=0) > _STRETCH * long.max(axis=0)) & (above >= 0)
    part = np.arange(count)
    # Joints follow their parents, end sites all joints.
    for p, parent in enumerate(parents):
        if parent >= 0 and not loose[p]:
            part[p] = part[parent]
    inside = part == np.bincount(part, minlength=1).argmax()
    if 2 * inside.sum() < count:
        inside = np.ones(count, bool)
    return Body(inside, loose, int(np.flatnonzero(inside)[0]))


def some_poses(points: Float[np.ndarray, "time point 3"]) -> Float[np.ndarray, "pose point 3"]:
    """A few whole poses."""
    whole = points[np.isfinite(points).all(axis=(1, 2))]
    return whole[:: 1 + len(whole) // _LOOKED_AT]
