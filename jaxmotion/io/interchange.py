"""What a glTF or USD file of a motion holds, before it is spelt in either: a figure of nodes.

    nodes         the joints, then a node for every end site, called ``<joint>_end``
    rest          where each node is at rest, from its parent: the offsets, no rotations
    transforms    float32, which is all that both formats store; quaternions (w, x, y, z) of norm 1,
                  each on the side of the one before
    rate          frames a second: what the frame time was meant to say (:func:`rate_of`)
    unit          metres a unit of length: told, kept from the file, or guessed (:func:`metres_of`)

A joint that is never off its offset by more than rounding has no translations of its own; its rest
is then where its first frame puts it, which is the one that counts. O(T·J).

Source: measured with Blender 5.0.1, three.js 0.187, usd-core 26.11 and the Khronos validator.
"""

import math
import warnings
from collections.abc import Iterable
from os import PathLike
from typing import NamedTuple

import numpy as np

from jaxmotion._checks import one_number
from jaxmotion._plain import quoted
from jaxmotion.axes.guess import sampled_positions
from jaxmotion.io.errors import MotionFileWarning
from jaxmotion.io.printed_digits import LARGEST_ROUNDING
from jaxmotion.io.soundness import check_clip
from jaxmotion.motion import Motion

_NTSC = 1000 / 1001  # film and video at 23.976, 29.97, 59.94 frames a second
# Units that files come in, metres, and how tall an adult may be for them: no two fit one figure.
_UNITS = (
    (1.0, "a metre", (1.1, 2.3)),
    (0.01, "a centimetre", (1.1, 2.3)),
    (0.001, "a millimetre", (1.1, 2.3)),
    (0.0254, "an inch", (1.3, 2.1)),
    (0.0254 / 0.45, "an inch over 0.45, as CMU's", (1.1, 2.3)),
)
_ADULT = 1.7


class Figure(NamedTuple):
    """Nodes and how they move.

    ``names``, ``parents``: of N nodes, J joints first; ``rest``: f64[N, 3]; ``translations``:
    f32[T, J, 3]; ``rotations``: f32[T, J, 4]; ``moving``: the joints whose translations are not
    their rest in all frames; ``rate``: frames a second.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    rest: np.ndarray
    translations: np.ndarray
    rotations: np.ndarray
    moving: tuple[int, ...]
    rate: float

    @property
    def rest_positions(self) -> np.ndarray:
        """Where the nodes are at rest, f64[N, 3]."""
        positions = self.rest.copy()
        for node, parent in enumerate(self.parents[1:], 1):
            positions[node] += positions[parent]
        return positions


def figure_of(motion: Motion, scale: float, writer: str) -> Figure:
    """The figure of a clip, lengths times ``scale``.

    **Raises:** ``ValueError``, worded for ``writer``, for numbers that float32 cannot hold, or a
    name that is no text.
    """
    skeleton = motion.skeleton
    rest = np.array(skeleton.offsets, np.float64)
    translations = np.array(motion.translations, np.float64)
    still = np.ones(len(rest), bool)
    still[list(motion.translated_joints)] = False
    translations[:, still] = translations[0, still]
    near = np.abs(translations[0] - rest).max(axis=-1) <= _rounding(rest)
    rest[still & near] = translations[0, still & near]
    moving = np.flatnonzero((translations != rest).any(axis=(0, 2)))
    rest = np.concatenate([rest, np.asarray(skeleton.end_offsets, np.float64)])
    with np.errstate(over="ignore"):
        moved = (scale * translations).astype(np.float32)
        far = not np.isfinite((scale * rest).astype(np.float32)).all()
    if far or not np.isfinite(moved).all():
        raise ValueError(f"{writer}: lengths that are too large for float32, which the file holds")
    return Figure(
        _node_names(skeleton.names, skeleton.end_joints, writer),
        (*skeleton.parents, *skeleton.end_joints),
        scale * rest,
        moved,
        _continued(np.asarray(motion.rotations, np.float64)),
        tuple(moving.tolist()),
        rate_of(motion),
    )


def _rounding(offsets: np.ndarray) -> float:
    """By how much a joint may be off its offset without being moved there."""
    return LARGEST_ROUNDING * np.abs(offsets[1:]).max(initial=0.0)


def check(motion: Motion) -> None:
    """``ValueError`` unless the motion is one clip of finite numbers, its skeleton's too."""
    check_clip(motion)
    skeleton = motion.skeleton
    offsets = np.concatenate([np.ravel(skeleton.offsets), np.ravel(skeleton.end_offsets)])
    if not np.isfinite(offsets).all():
        raise ValueError("save: offsets and end_offsets must be finite")


def rate_of(motion: Motion) -> float:
    """Frames a second, as they were meant.

    A frame time that was printed with a few decimals stands for the whole rate, or the one of
    video (n · 1000 / 1001), whose frame time is printed so: 0.0333333 for 30, 0.008333 for 120. Any
    other is the shortest decimal number whose frame time is the motion's in its dtype.
    """
    seconds = np.asarray(motion.frame_time)
    rate = 1.0 / float(seconds)
    for whole in (round(rate), round(rate / _NTSC) * _NTSC):
        if whole > 0 and any(
            seconds == seconds.dtype.type(round(1.0 / whole, decimals)) for decimals in range(5, 16)
        ):
            return float(whole)
    for digits in range(1, 18):
        shortest = float(f"{rate:.{digits}g}")
        if seconds.dtype.type(1.0 / shortest) == seconds:
            return shortest
    return rate


def metres_of(
    motion: Motion, asked: float | int | None, path: str | PathLike, writer: str
) -> float:
    """Metres a unit of length: as ``asked``, else as the motion knows it, else guessed.

    The guess is the unit in which the figure is as tall as an adult, and a
    :class:`MotionFileWarning` says it. Tall is the median over up to 64 frames of the longest side
    of the box around the figure, so that it may also lie.
    **Raises:** ``ValueError``, worded for ``writer``, if ``asked`` is no length.
    """
    if asked is not None:
        number = one_number(f"{writer}: metres", asked)
        if number.dtype.kind not in "iuf" or not 0 < number < math.inf:
            raise ValueError(
                f"{writer}: metres={asked!r}; expected metres a unit of length, above 0"
            )
        return float(number)
    known = motion.skeleton.conventions.metres
    if known is not None:
        return float(known)
    tall = _height(motion)
    metres, unit = _likely_unit(tall)
    how = f"its joints then span {metres * tall:.2g} m" if tall > 0 else "nothing shows it"
    text = f"a unit of length is taken for {unit}, by a guess: {how}; metres= (--metres) tells it"
    warnings.warn(f"{path}: {text}", MotionFileWarning, stacklevel=4)
    return metres


def warn_of(path: str | PathLike, text: str) -> None:
    """A :class:`MotionFileWarning` at the line that calls ``save``."""
    warnings.warn(f"{path}: {text}", MotionFileWarning, stacklevel=4)


def first_few(words: Iterable[str], shown: int = 3) -> str:
    """Some of the words, and how many more there are."""
    words = list(words)
    more = f" and {len(words) - shown} more" if len(words) > shown else ""
    return ", ".join(words[:shown]) + more


def unique(wanted: str, taken: set[str], join: str = "_") -> str:
    """``wanted``, or it with the first number from 2 that makes a name that is not ``taken``; it is
    taken from then on."""
    name, number = wanted, 1
    while name in taken:
        number += 1
        name = f"{wanted}{join}{number}"
    taken.add(name)
    return name


def _node_names(names, end_joints, writer: str) -> tuple[str, ...]:
    for name in names:
        if "\0" in name or any("\ud800" <= character <= "\udfff" for character in name):
            raise ValueError(
                f"{writer}: the joint name {quoted(name)} cannot be written; expected text"
            )
    taken = set(names)
    return (*names, *(unique(f"{names[joint]}_end", taken) for joint in end_joints))


def _continued(q: np.ndarray) -> np.ndarray:
    """Unit quaternions f32[T, J, 4] that turn alike, each at most a right angle from the last."""
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    turned = np.einsum("tjc,tjc->tj", q[1:], q[:-1]) < 0
    signs = np.where(np.cumsum(turned, axis=0) % 2, -1.0, 1.0)
    q[1:] *= signs[..., None]
    return q.astype(np.float32)


def _height(motion: Motion) -> float:
    points, tips, _, _ = sampled_positions(motion)
    boxes = np.ptp(np.concatenate([points, tips], axis=1), axis=1)
    return float(np.median(boxes.max(axis=-1)))


def _likely_unit(tall: float) -> tuple[float, str]:
    """Metres a unit and what it is called; what is no adult is in the plain unit nearest to one."""
    for metres, unit, (least, most) in _UNITS:
        if least <= metres * tall <= most:
            return metres, unit
    if not tall > 0:
        return _UNITS[0][:2]
    return min(_UNITS[:3], key=lambda row: abs(math.log(row[0] * tall / _ADULT)))[:2]
