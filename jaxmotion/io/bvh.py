"""BVH files (Biovision hierarchy): a tree of joints, and a row of channel values a frame.

Reading. Position channels replace OFFSET, axis by axis; axes without one keep OFFSET. Rotation
channels, in degrees, become a local unit quaternion, q = q₁(θ₁) q₂(θ₂) q₃(θ₃), intrinsic, in the
file's order for that joint. A joint counts as translated if a position value leaves OFFSET by more
than rounding: half a unit of the last digit that positions are printed with, and of OFFSET's (but
at most a hundredth of the longest offset), and for arithmetic in single precision a millionth of
the longest offset, or of the root's farthest coordinate if that is more: Blender works in the
world. The root always does. The values are kept as they are, for the file; algorithms
read a joint that is not translated at its first frame.

Names, channel names and order, end sites and the text of the frame time are kept. Read without
complaint: any mixture of channels, any white space between words, CRLF, byte-order marks (UTF-8,
UTF-16), a DOS end-of-file mark, names in other encodings than UTF-8, exponents, no line end at the
end of the file. Repaired, with a :class:`~jaxmotion.io.MotionFileWarning`: a frame count that is
not the number of rows (the rows count), a last row that is cut off (dropped), text after the last
row (left out), a name used twice (numbered).

Writing. Translations are exact (the shortest decimals that read back as the same number); angles
are unwrapped against the frame before and rounded to 10⁻¹² degrees, so rotations come back to
better than 10⁻¹² rad and a file's own decimals come back as they were. Nothing of a motion is lost:
where a joint's channels cannot express what it does, the missing rotations are added after its
channels, the missing positions in front of them, with a warning that names the joints. Channels
that are not BVH's (a skeleton from another format) become BVH's usual ones, and so does their
absence there. Joints are written depth first, names in the encoding they were read from where that
can write them and will be told from them again, else in UTF-8.

Memory: the file's text and the motion's arrays; both ways work through it in small blocks.
"""

import re
import warnings
from collections import deque
from collections.abc import Iterator
from os import PathLike

import jax
import numpy as np

from jaxmotion._plain import quoted
from jaxmotion.io import bvh_write
from jaxmotion.io.atomic import atomic_write
from jaxmotion.io.bvh_frames import (
    Frames,
    find_rows,
    parse_header,
    parse_rows,
    row_texts,
)
from jaxmotion.io.bvh_hierarchy import Hierarchy, parse_hierarchy, parse_number
from jaxmotion.io.conventions import seconds_of, turned_for, with_up
from jaxmotion.io.errors import MotionFileError, MotionFileWarning, read_file
from jaxmotion.io.euler_blocks import quaternions
from jaxmotion.io.formats import Up, UpOut
from jaxmotion.io.precision import float_type
from jaxmotion.io.printed_digits import (
    LARGEST_ROUNDING,
    SINGLE_PRECISION,
    PrintedDigits,
    printed_digits,
)
from jaxmotion.io.text import decoded, plain_bytes
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Conventions, Skeleton

__all__ = ["load_bvh", "save_bvh"]

# First on its line or after a brace; elsewhere it is a joint's name.
_MOTION = re.compile(rb"(?:^[ \t\v\f]*|\}\s*)(MOTION)(?=\s|\Z)", re.IGNORECASE | re.MULTILINE)
_MOST_POSES_A_BYTE = 100


def load_bvh(
    path: str | PathLike,
    *,
    dtype=None,
    frame_time: float | None = None,
    fps: float | int | None = None,
    up: Up | None = None,
    encoding: str | None = None,
) -> Motion:
    """Read a BVH file; see the module for what is kept, accepted and repaired.

    **Arguments:** ``path``: the file; ``dtype``: of the arrays, as :func:`jaxmotion.load`;
    ``frame_time``, in seconds, or ``fps``, frames a second: to overrule the file's; ``up``: the
    axis that points up, which BVH does not say, or "auto" for a guess; y is assumed; ``encoding``:
    of the names ("gbk"), by default told from their bytes (:mod:`jaxmotion.io.text`).
    **Returns:** a :class:`~jaxmotion.Motion`, lengths in the file's unit.
    **Raises:** :class:`~jaxmotion.io.MotionFileError` for a file that cannot be understood, or an
    impossible ``frame_time``; ``OSError`` for one that cannot be opened; ``ValueError`` for ``fps``
    and ``frame_time`` together, or other impossible arguments.
    """
    dtype = float_type(dtype)
    if fps is not None and frame_time is not None:
        raise ValueError(f"load_bvh: fps={fps} and frame_time={frame_time}; give one of them")
    frame_time = frame_time if fps is None else seconds_of(fps, "load_bvh")
    data = plain_bytes(path, read_file(path))
    word = _MOTION.search(data)
    top = data[: word.start(1)] if word else data
    text, encoding = decoded(path, top, encoding)
    hierarchy = parse_hierarchy(path, text)
    if word is None:
        line = data.count(b"\n") + 1
        raise MotionFileError(
            path,
            "the end of the file",
            expected="MOTION after the hierarchy",
            hint="the file may be cut off; export it again",
            line=line,
        )
    frames = parse_header(path, data, word.end(1))
    seconds, spelt = _frame_time(path, frames, frame_time, dtype)
    if np.abs(hierarchy.offsets).max() > np.finfo(dtype).max:
        raise _too_large(path, dtype)
    translations, rotations, moved = _read_frames(path, data, frames, hierarchy, dtype)
    skeleton = Skeleton(
        hierarchy.names,
        hierarchy.parents,
        jax.device_put(hierarchy.offsets.astype(dtype)),
        end_joints=hierarchy.end_joints,
        end_offsets=jax.device_put(hierarchy.end_offsets.astype(dtype)),
        end_labels=hierarchy.end_labels,
        channels=hierarchy.channels,
        encoding=encoding,
        conventions=Conventions(up="assumed"),
    )
    motion = Motion(
        skeleton,
        jax.device_put(translations),
        jax.device_put(rotations),
        seconds,
        translated_joints=moved,
        frame_time_text=spelt,
    )
    return with_up(motion, up, path, "load_bvh")


def save_bvh(
    motion: Motion,
    path: str | PathLike,
    *,
    overwrite: bool = True,
    up: UpOut = "y",
    still_positions: bool = True,
) -> None:
    """Write a BVH file, whole or not at all; see the module for what is written how.

    **Arguments:** ``motion``: one clip of at least one frame, finite; ``path``: the file;
    ``overwrite``: whether a file of that name may be replaced; ``up``: the axis that points up in
    the file, to which the motion is turned (:func:`jaxmotion.reorient`) with a warning, or "keep";
    ``still_positions``: whether joints that never move keep their position channels. Programs that
    add positions to OFFSET, or take none but the root's, need ``False``: such a joint's place
    becomes its OFFSET, so the world positions are the same; joints that move keep theirs, and a
    :class:`~jaxmotion.io.MotionFileWarning` names them.
    **Raises:** ``ValueError`` for a motion that BVH cannot hold (batched, no frames, not finite,
    rotations that are no unit quaternions, names with braces or line ends), or another ``up``;
    ``FileExistsError`` and other ``OSError`` from writing.
    """
    motion = turned_for(motion, up, path, "save_bvh")
    plan = bvh_write.plan(motion, still_positions=still_positions)
    if plan.extended:
        warnings.warn(
            f"{path}: channels were added to {len(plan.extended)} joints so that nothing is lost: "
            f"{', '.join(plan.extended[:8])}",
            MotionFileWarning,
            stacklevel=2,
        )
    if plan.moving:
        warnings.warn(
            f"{path}: positions were kept of the joints that move, {len(plan.moving)} in all: "
            f"{', '.join(plan.moving[:8])}",
            MotionFileWarning,
            stacklevel=2,
        )
    with atomic_write(path, overwrite=overwrite) as file:
        file.write(bvh_write.header_text(motion, plan))
        for piece in bvh_write.frames_text(motion, plan):
            file.write(piece)


def _frame_time(path, frames: Frames, given: float | None, dtype) -> tuple[float, str | None]:
    seconds = parse_number(frames.frame_time_text) if given is None else float(given)
    if seconds is None or not 0 < dtype.type(seconds) < np.inf:
        comma = "write decimal points, not commas; or " if "," in frames.frame_time_text else ""
        raise MotionFileError(
            path,
            f"Frame Time: {quoted(frames.frame_time_text)}" if given is None else f"{given}",
            expected="a positive, finite number of seconds",
            hint=f"{comma}pass frame_time=1/30 (or what is right) to load",
            line=frames.line,
        )
    return seconds, frames.frame_time_text if given is None else None


def _read_frames(path, data: bytes, frames: Frames, hierarchy: Hierarchy, dtype):
    """Translations [T, J, 3], rotations [T, J, 4] in ``dtype``, and the translated joints."""
    rows = find_rows(path, data, frames, hierarchy)
    joints = len(hierarchy.names)
    if rows.count * joints > _MOST_POSES_A_BYTE * len(data):
        raise MotionFileError(
            path,
            f"{joints} joints, nearly all without channels, and {rows.count} frames",
            expected="a motion that does not outgrow its file beyond measure",
        )
    translations = np.empty((rows.count, 3 * joints), dtype)
    rotations = np.empty((rows.count, joints, 4), dtype)
    translations[:] = hierarchy.offsets.reshape(-1)
    rotations[:] = (1, 0, 0, 0)
    columns, targets, groups = _column_map(hierarchy)
    rest = hierarchy.offsets.reshape(-1)[targets]
    apart = np.zeros(len(targets))
    begun = deque()

    def finish() -> None:
        frames, joints, result = begun.popleft()
        rotations[frames, joints] = result()

    for start, values in parse_rows(path, data, frames, rows, hierarchy):
        if np.abs(values).max() > np.finfo(dtype).max:
            raise _too_large(path, dtype)
        here = slice(start, start + len(values))
        positions = values[:, columns]
        np.maximum(apart, np.abs(positions - rest).max(0), out=apart)
        translations[here, targets] = positions
        for (order, used), (members, slots) in groups.items():
            angles = np.zeros((len(values), len(members), 3))
            angles[..., :used] = values[:, slots]
            if np.abs(angles).max() > 720.0:
                angles = np.fmod(angles, 720.0)
            begun.append((here, members, quaternions(np.deg2rad(angles), order, dtype)))
        while len(begun) > len(groups):
            finish()
    while begun:
        finish()
    texts = row_texts(data, frames, rows)
    moved = _moved_joints(hierarchy, columns, targets // 3, rest, apart, texts)
    return translations.reshape(rows.count, joints, 3), rotations, moved


def _moved_joints(
    hierarchy: Hierarchy,
    columns: np.ndarray,
    joints: np.ndarray,
    rest: np.ndarray,
    apart: np.ndarray,
    texts: Iterator[bytes],
) -> tuple[int, ...]:
    """The root, and the joints that leave their offset by more than rounding.

    ``columns``: of the position channels; ``joints``, ``rest``: their joints and offsets;
    ``apart``: the most that each is ever from its offset; ``texts``: the rows. These are looked at
    only where they matter, and no further than that: more rows may show more digits, not fewer.
    """
    longest = np.abs(hierarchy.offsets[1:]).max(initial=0.0)
    farthest = (apart + np.abs(rest))[joints == 0].max(initial=longest)
    single = SINGLE_PRECISION * farthest
    suspects = {*joints[apart > single].tolist()} - {0}
    of_offsets = printed_digits(" ".join(hierarchy.offset_texts[1:]).encode()).rounding(rest)
    digits = PrintedDigits()
    while True:
        rounding = np.minimum(digits.rounding(rest) + of_offsets, LARGEST_ROUNDING * longest)
        moved = {*joints[apart > single + rounding].tolist()} - {0}
        text = next(texts, None) if moved != suspects else None
        if text is None:
            return (0, *sorted(moved))
        shown = printed_digits(text, hierarchy.columns, columns[joints > 0])
        digits = digits.and_those(shown)


def _column_map(hierarchy: Hierarchy):
    """Columns of positions and where they go (3·joint + axis); joints by Euler order.

    Groups: {(order, rotation channels): (joints, columns [joints, rotation channels])}.
    """
    columns, targets, groups, base = [], [], {}, 0
    for joint, layout in enumerate(hierarchy.layout):
        for slot, axis in layout.positions:
            columns.append(base + slot)
            targets.append(3 * joint + axis)
        if layout.rotations:
            members, slots = groups.setdefault((layout.order, len(layout.rotations)), ([], []))
            members.append(joint)
            slots.append([base + slot for slot in layout.rotations])
        base += len(hierarchy.channels[joint])
    return np.array(columns, int), np.array(targets, int), groups


def _too_large(path, dtype) -> MotionFileError:
    return MotionFileError(
        path, f"numbers beyond {np.finfo(dtype).max:.1e}", expected=f"numbers that fit {dtype}"
    )
