"""The tree of joints a motion moves.

Joint j hangs from ``parents[j] < j`` (the root is joint 0, parent −1) by ``offsets[j]``, in its
parent's frame. Leaves may carry end sites: points, fixed in a joint's frame, that no channel moves.
Topology and names are static; offsets are arrays, so bone lengths can be optimised. What is said
below to be a file fact is kept for the file's sake and tells no two skeletons apart
(:mod:`jaxmotion._file_facts`).
"""

import fnmatch
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import equinox as eqx
import numpy as np
from jaxtyping import Float

from jaxmotion._asf_bone import AsfBone
from jaxmotion._checks import asked_from_inside, floating, one_of
from jaxmotion._file_facts import file_fact
from jaxmotion._plain import printable
from jaxmotion._portable import Portable
from jaxmotion._summary import batched, called, kept_as, numbers, some, tree
from jaxmotion._types import AnyArray

__all__ = ["Conventions", "Skeleton"]

DEFAULT_ROOT_CHANNELS = (
    "Xposition",
    "Yposition",
    "Zposition",
    "Zrotation",
    "Xrotation",
    "Yrotation",
)
DEFAULT_CHANNELS = DEFAULT_ROOT_CHANNELS[3:]
_FOOT = re.compile("ankle|foot|feet|paw|hoof")


@dataclass(frozen=True)
class Conventions:
    """What a clip's numbers mean, as far as its file or format tells; all static.

    **Fields:** ``up``, ``frame_time``, ``angle``: how the skeleton's up axis, the motion's frame
    time and the file's unit of angles are known: "told" (by the file, its format or the caller),
    "guessed" from the motion, or "assumed"; ``metres``: the length of one unit, None where nothing
    tells.
    """

    up: str = "told"
    frame_time: str = "told"
    angle: str = "told"
    metres: float | int | None = None


class Skeleton(Portable):
    """Joint names, tree, offsets and end sites.

    **Fields:**

    - ``names``: one string a joint, unique; static.
    - ``parents``: parent index a joint, −1 for the root, ``parents[j] < j``; static.
    - ``offsets``: f[J, 3], from the parent's origin in the parent's frame, file unit.
    - ``end_offsets``: f[E, 3], end sites in the frame of the joint they hang from. Both have the
      batch axes of the motions that :func:`jaxmotion.stack` or ``jax.vmap`` put together.
    - ``end_joints``: that joint's index, one an end site; static.
    - ``end_labels``: how the file spelt each ("End Site"); a file fact.
    - ``channels``: per joint, the file's channel names in order ("Zrotation"); a file fact.
    - ``asf``: per joint an :class:`~jaxmotion._asf_bone.AsfBone` if the skeleton came from an ASF
      file, else (); a file fact.
    - ``up``: the axis that points up, "x", "y" or "z"; static.
    - ``length_unit``: what the file says of its unit of length (ASF's ``length``), else 1; static.
    - ``encoding``: of the text the names were read from, and are written in again; a file fact.
    - ``conventions``: what is told and what assumed, a :class:`Conventions`; a file fact.

    Printed, it is a tree: names, and how far from its parent each joint and end site is.

    **Raises:** ``ValueError`` when the pieces do not fit together, or offsets are whole numbers.

    **Example:**

        >>> import numpy, jaxmotion as jm
        >>> offsets = numpy.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.25, 0.0, 0.0]])
        >>> arm = jm.Skeleton(["upper", "lower", "hand"], [-1, 0, 1], offsets)
        >>> arm.num_joints, arm.index("hand"), arm.matching("*er"), arm.levels
        (3, 2, (0, 1), ((0,), (1,), (2,)))
        >>> print(arm)
        Skeleton(3 joints from upper, y up, float64, NumPy)
        upper       0
        └─ lower    0.3
           └─ hand  0.25
    """

    names: tuple[str, ...] = eqx.field(static=True)
    parents: tuple[int, ...] = eqx.field(static=True)
    offsets: Float[AnyArray, "*batch joint 3"]
    end_offsets: Float[AnyArray, "*batch end 3"]
    end_joints: tuple[int, ...] = eqx.field(static=True)
    up: str = eqx.field(static=True)
    length_unit: float = eqx.field(static=True)
    end_labels: tuple[str, ...] = file_fact()
    channels: tuple[tuple[str, ...], ...] = file_fact()
    asf: tuple[AsfBone, ...] = file_fact()
    encoding: str = file_fact()
    conventions: Conventions = file_fact()

    def __init__(
        self,
        names: Sequence[str],
        parents: Sequence[int],
        offsets,
        *,
        end_joints: Sequence[int] = (),
        end_offsets=None,
        end_labels: Sequence[str] | None = None,
        channels: Sequence[Sequence[str]] | None = None,
        asf: Sequence[AsfBone] = (),
        up: str = "y",
        length_unit: float = 1.0,
        encoding: str = "utf-8",
        conventions: Conventions | None = None,
    ):
        self.names = tuple(names)
        self.parents = tuple(int(p) for p in parents)
        self.end_joints = tuple(int(j) for j in end_joints)
        ends = offsets[..., :0, :] if end_offsets is None else end_offsets
        # Readers work in float64 whatever JAX has, and make it the caller's type at the end.
        inside = asked_from_inside(__name__)
        self.offsets, self.end_offsets = floating(
            "Skeleton", whole=inside, offsets=offsets, end_offsets=ends
        )
        self.end_labels = tuple(end_labels or ("End Site",) * len(self.end_joints))
        self.channels = tuple(tuple(c) for c in channels) if channels else self._default_channels()
        self.asf = tuple(asf)
        self.up = up
        self.length_unit = float(length_unit)
        self.encoding = encoding
        self.conventions = Conventions() if conventions is None else conventions
        self._check()

    def _default_channels(self):
        return (DEFAULT_ROOT_CHANNELS,) + (DEFAULT_CHANNELS,) * (len(self.names) - 1)

    def _check(self):
        joints = len(self.names)
        if joints == 0:
            raise ValueError("Skeleton: names is empty; a skeleton needs at least a root joint")
        if len(set(self.names)) != joints:
            twice = sorted({n for n in self.names if self.names.count(n) > 1})
            raise ValueError(f"Skeleton: names must be unique; {twice} occur more than once")
        if len(self.parents) != joints or self.parents[0] != -1:
            raise ValueError(
                f"Skeleton: parents must have {joints} entries and begin with -1, "
                f"got {self.parents}"
            )
        for j, p in enumerate(self.parents[1:], 1):
            if not 0 <= p < j:
                raise ValueError(
                    f"Skeleton: parents[{j}] is {p}; each parent must come before its joint"
                )
        batch = np.shape(self.offsets)[:-2]
        if np.shape(self.offsets) != (*batch, joints, 3):
            raise ValueError(
                f"Skeleton: offsets must have shape ({joints}, 3), got {np.shape(self.offsets)}"
            )
        ends = len(self.end_joints)
        if np.shape(self.end_offsets) != (*batch, ends, 3) or len(self.end_labels) != ends:
            raise ValueError(
                f"Skeleton: end_joints names {ends} end sites, but end_offsets has shape "
                f"{np.shape(self.end_offsets)} and end_labels {len(self.end_labels)} entries"
            )
        for i, j in enumerate(self.end_joints):
            if not 0 <= j < joints:
                raise ValueError(
                    f"Skeleton: end_joints[{i}] is {j}; expected a joint, 0..{joints - 1}"
                )
        if len(self.channels) != joints:
            raise ValueError(
                f"Skeleton: channels must have {joints} entries, got {len(self.channels)}"
            )
        if self.asf and len(self.asf) != joints:
            raise ValueError(f"Skeleton: asf must have {joints} entries, got {len(self.asf)}")
        one_of("Skeleton: up", self.up, ("x", "y", "z"))

    @property
    def num_joints(self) -> int:
        """Number of joints, end sites not counted."""
        return len(self.names)

    @property
    def up_axis(self) -> int:
        """Which component of a position is its height: 0, 1 or 2 for ``up`` of x, y or z."""
        return "xyz".index(self.up)

    @property
    def levels(self) -> tuple[tuple[int, ...], ...]:
        """Joints by depth: ``levels[0] == (0,)``, every joint's parent one level up."""
        return levels_of(self.parents)

    @property
    def children(self) -> tuple[tuple[int, ...], ...]:
        """Each joint's children."""
        return _children(self.parents)

    def index(self, name: str) -> int:
        """Index of the joint called ``name``.

        **Arguments:** ``name``: in the skeleton's own spelling.
        **Returns:** the joint's number.
        **Raises:** ``ValueError``, listing the names, if there is none.
        """
        if name not in self.names:
            raise ValueError(f"no joint is called {name!r}; the joints are {', '.join(self.names)}")
        return self.names.index(name)

    def matching(self, *patterns: str) -> tuple[int, ...]:
        """Indices of the joints whose names match one of the shell patterns, such as ``"Left*"``
        (any case).

        **Arguments:** ``patterns``: as of :mod:`fnmatch`, one or more.
        **Returns:** the joints' numbers, in order.
        **Raises:** ``ValueError``, listing the names, for a pattern that none matches.
        """
        found: set[int] = set()
        for pattern in patterns:
            joints = [
                j
                for j, name in enumerate(self.names)
                if fnmatch.fnmatchcase(name.lower(), pattern.lower())
            ]
            if not joints:
                raise ValueError(
                    f"no joint matches {pattern!r}; the joints are {', '.join(self.names)}"
                )
            found.update(joints)
        return tuple(sorted(found))

    def _words(self) -> Iterator[str]:
        (*batch, _, _) = self.offsets.shape
        figure, *rest = self._figure()
        yield batched(batch, "skeleton", figure)
        if self.end_joints:
            yield some(len(self.end_joints), "end site")
        yield from rest
        yield kept_as(self.offsets)

    def _figure(self) -> Iterator[str]:
        """What a clip of it says of it."""
        yield f"{some(self.num_joints, 'joint')} from {called(self.names)}"
        yield f"{self.up} up"

    def __str__(self) -> str:
        names = [printable(name) for name in self.names]
        ends = ["end site"] * len(self.end_joints)
        lengths = _lengths(self.offsets, len(names)) + _lengths(self.end_offsets, len(ends))
        drawn = tree(names + ends, self.parents + self.end_joints, lengths)
        return "\n".join([repr(self), *drawn])


def _lengths(offsets, count: int) -> list[str]:
    """How long each of the offsets is, where that is known and there is one set of them."""
    read = numbers(offsets, 10**6)
    if read is None or read.shape != (count, 3):
        return [""] * count
    return [f"{length:.4g}" for length in np.linalg.norm(read.astype(np.float64), axis=-1)]


def feet_by_name(skeleton: Skeleton) -> tuple[int, ...]:
    """The topmost joint of each chain called ankle, foot, paw or hoof."""
    named = [bool(_FOOT.search(name.lower())) for name in skeleton.names]
    below = [False] * skeleton.num_joints  # a foot, or below one
    for j, parent in enumerate(skeleton.parents):
        below[j] = named[j] or (parent >= 0 and below[parent])
    parents = skeleton.parents
    return tuple(
        j for j in range(skeleton.num_joints) if named[j] and not (j and below[parents[j]])
    )


# Remembered per tree, not in the Skeleton: equinox would count a cached attribute as part of the
# pytree's structure, and every function compiled for the skeleton would be compiled again.
@lru_cache(maxsize=64)
def levels_of(parents: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
    """Joints of a tree by depth, in order of number: ``levels_of(parents)[0] == (0,)``."""
    found: list[list[int]] = [[0]]
    depth = [0] * len(parents)
    for j, p in enumerate(parents[1:], 1):
        depth[j] = depth[p] + 1
        if depth[j] == len(found):
            found.append([])
        found[depth[j]].append(j)
    return tuple(map(tuple, found))


@lru_cache(maxsize=64)
def _children(parents: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
    found: list[list[int]] = [[] for _ in parents]
    for j, p in enumerate(parents[1:], 1):
        found[p].append(j)
    return tuple(map(tuple, found))
