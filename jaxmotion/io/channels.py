"""BVH channel names: which column is which axis of a joint, in any order, any number.

"Xposition" … "Zrotation", any case. Rotation channels, read from first to last, are intrinsic
turns about the moving axes: (Zrotation, Xrotation, Yrotation) is the Euler order "ZXY". One or two
rotation channels are the first turns of a full order whose others are zero.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from jaxmotion._plain import quoted

_AXES = "xyz"


class JointChannels(NamedTuple):
    """Where a joint's numbers stand among its channels.

    - ``positions``: (channel, axis) of each position channel;
    - ``rotations``: channel of each rotation, in order;
    - ``order``: the full Euler order they begin ("ZXY"), "" if there is none.
    """

    positions: tuple[tuple[int, int], ...]
    rotations: tuple[int, ...]
    order: str


def parse_channels(names: Sequence[str]) -> JointChannels:
    """Understand a joint's channel names.

    **Raises:** ``ValueError``, saying what is wrong with them: an unknown name, a position twice,
    rotations that are no Euler order.
    """
    positions: list[tuple[int, int]] = []
    rotations: list[int] = []
    letters = ""
    for slot, name in enumerate(names):
        axis, kind = _AXES.find(name[:1].lower()), name[1:].lower()
        if axis < 0 or kind not in ("position", "rotation"):
            raise ValueError(f"the channel {quoted(name)}")
        if kind == "rotation":
            rotations.append(slot)
            letters += _AXES[axis].upper()
        elif axis in (taken for _, taken in positions):
            raise ValueError(f"the channel {quoted(name)} twice")
        else:
            positions.append((slot, axis))
    repeated = any(a == b for a, b in pairwise(letters))
    if len(letters) > 3 or repeated:
        raise ValueError(f"rotation channels about {', '.join(letters)}")
    return JointChannels(tuple(positions), tuple(rotations), _completed(letters))


def with_all_rotations(names: Sequence[str]) -> tuple[str, ...]:
    """The channels, with the rotations that are missing of three added at the end."""
    known = parse_channels(names)
    order = known.order or "ZXY"
    return (*names, *(f"{letter}rotation" for letter in order[len(known.rotations) :]))


def with_all_positions(names: Sequence[str]) -> tuple[str, ...]:
    """The channels, with the positions that are missing of three put in front."""
    known = {axis for _, axis in parse_channels(names).positions}
    return (*(f"{'XYZ'[a]}position" for a in range(3) if a not in known), *names)


def without_positions(names: Sequence[str]) -> tuple[str, ...]:
    """The channels that are rotations."""
    return tuple(names[slot] for slot in parse_channels(names).rotations)


def _completed(letters: str) -> str:
    rest = "".join(letter for letter in "XYZ" if letter not in letters)
    return (letters + rest)[:3] if letters else ""
