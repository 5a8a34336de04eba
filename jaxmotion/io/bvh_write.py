"""What a BVH file of a motion says: its channels, its hierarchy, its rows of text.

The channels are the skeleton's own wherever they can say what the motion does (:func:`plan`).
Rows come out in blocks of some 500 frames, so a long clip never stands in memory as text.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jaxmotion._plain import quoted
from jaxmotion.io.bvh_hierarchy import keyword_and_value, parse_number, reads_back
from jaxmotion.io.channels import (
    parse_channels,
    with_all_positions,
    with_all_rotations,
    without_positions,
)
from jaxmotion.io.decimal_text import number_text, table_text
from jaxmotion.io.euler_blocks import angle_blocks, frame_blocks, one_branch
from jaxmotion.io.soundness import check_clip
from jaxmotion.io.text import encoding_for
from jaxmotion.motion import Motion
from jaxmotion.skeleton import DEFAULT_CHANNELS, DEFAULT_ROOT_CHANNELS, Skeleton


class Plan(NamedTuple):
    """What to write.

    ``channels``: of every joint; ``offsets``: f[J, 3]; ``order``: joints depth first, as written;
    ``partial``: angles f64[T, k] in radians of the joints with one or two rotation channels;
    ``extended``: names of the joints whose channels are more than the skeleton says; ``moving``: of
    those that keep the positions that were to be left out, as they move.
    """

    channels: tuple[tuple[str, ...], ...]
    offsets: np.ndarray
    order: tuple[int, ...]
    partial: dict[int, np.ndarray]
    extended: tuple[str, ...]
    moving: tuple[str, ...]


def plan(motion: Motion, *, still_positions: bool = True) -> Plan:
    """Decide the channels; ``ValueError`` for a motion that no BVH file can hold.

    ``still_positions``: whether joints that never move keep their position channels.
    """
    check_clip(motion)
    skeleton = motion.skeleton
    _check_skeleton(skeleton)
    wanted, offsets = _bvh_channels(skeleton), np.array(skeleton.offsets)
    moved, rotations = _moved_axes(motion), np.asarray(motion.rotations)
    moving = ()
    if not still_positions:
        still = _still_joints(motion)
        offsets[still] = np.asarray(motion.translations)[0, still]
        for joint in still:
            wanted[joint] = without_positions(wanted[joint]) or DEFAULT_CHANNELS
            moved[joint] = set()
        moving = tuple(
            skeleton.names[joint]
            for joint in range(1, skeleton.num_joints)
            if joint not in still and (moved[joint] or parse_channels(wanted[joint]).positions)
        )
    channels, partial = [], {}
    for joint, names in enumerate(wanted):
        known = parse_channels(names)
        if moved[joint] - {axis for _, axis in known.positions}:
            names = with_all_positions(names)
        if len(known.rotations) < 3:
            angles = _partial_angles(rotations[:, joint : joint + 1], names)
            if angles is None:
                names = with_all_rotations(names)
            else:
                partial[joint] = angles
        channels.append(names)
    if not any(channels):
        channels[0] = DEFAULT_ROOT_CHANNELS
        partial.pop(0)
    extended = tuple(
        name for name, a, b in zip(skeleton.names, wanted, channels, strict=True) if a != b
    )
    return Plan(tuple(channels), offsets, _depth_first(skeleton), partial, extended, moving)


def header_text(motion: Motion, plan: Plan) -> bytes:
    """Everything above the rows, in the encoding that the names came in."""
    lines = ["HIERARCHY"]
    lines += _hierarchy_lines(motion.skeleton, plan)
    lines += ["MOTION", f"Frames: {motion.num_frames}", f"Frame Time: {_frame_time_text(motion)}"]
    text = "\n".join(lines) + "\n"
    return text.encode(encoding_for(text, motion.skeleton.encoding))


def frames_text(motion: Motion, plan: Plan) -> Iterator[bytes]:
    """The rows, some hundred at a time."""
    rotations = np.asarray(motion.rotations)
    translations = np.asarray(motion.translations).reshape(motion.num_frames, -1)
    first_column = _first_columns(plan)
    sources, targets, groups = [], [], {}
    for joint in plan.order:
        known, base = parse_channels(plan.channels[joint]), first_column[joint]
        sources += [3 * joint + axis for _, axis in known.positions]
        targets += [base + slot for slot, _ in known.positions]
        if known.rotations and joint not in plan.partial:
            members, slots = groups.setdefault(known.order, ([], []))
            members.append(joint)
            slots += [base + slot for slot in known.rotations]
    turning = np.ones(sum(map(len, plan.channels)), bool)
    turning[targets] = False
    blocks = [
        (slots, angle_blocks(rotations[:, members], order))
        for order, (members, slots) in groups.items()
    ]
    for block in frame_blocks(motion.num_frames):
        values = np.empty((block.stop - block.start, len(turning)))
        values[:, targets] = translations[block, sources]
        for slots, angles in blocks:
            values[:, slots] = np.rad2deg(next(angles)).reshape(len(values), -1)
        for joint, angles in plan.partial.items():
            known = parse_channels(plan.channels[joint])
            slots = [first_column[joint] + slot for slot in known.rotations]
            values[:, slots] = np.rad2deg(angles[block])
        yield table_text(values, turning, single=rotations.dtype == np.float32)


def _check_skeleton(skeleton: Skeleton) -> None:
    for name in skeleton.names:
        if not reads_back(name):
            raise ValueError(
                f"save: the joint name {quoted(name)} cannot be written; expected text without "
                "braces and line ends, and without blanks in front or behind"
            )
    for label in skeleton.end_labels:
        if not reads_back(label) or keyword_and_value(label)[0] != "end":
            raise ValueError(
                f"save: the end site {quoted(label)} cannot be written; expected 'End Site'"
            )
    offsets = np.concatenate([np.ravel(skeleton.offsets), np.ravel(skeleton.end_offsets)])
    if not np.isfinite(offsets).all():
        raise ValueError("save: offsets and end_offsets must be finite")


def _bvh_channels(skeleton: Skeleton) -> list[tuple[str, ...]]:
    """The skeleton's channels, or BVH's usual ones where they are another format's: there a joint
    without any is one that does not turn, here one that many programs refuse."""
    known = [_are_bvhs(names) for names in skeleton.channels]
    usual = [DEFAULT_ROOT_CHANNELS, *[DEFAULT_CHANNELS] * (skeleton.num_joints - 1)]
    return [
        names if mine and (names or all(known)) else default
        for names, mine, default in zip(skeleton.channels, known, usual, strict=True)
    ]


def _are_bvhs(names: tuple[str, ...]) -> bool:
    try:
        parse_channels(names)
    except ValueError:
        return False
    return True


def _still_joints(motion: Motion) -> list[int]:
    """Joints but the root whose translation is one and the same in all frames."""
    translations = np.asarray(motion.translations)
    steady = (translations.max(0) == translations.min(0)).all(-1)
    steady[[j for j in range(motion.num_joints) if j not in motion.translated_joints]] = True
    return [j for j in np.flatnonzero(steady).tolist() if j]


def _moved_axes(motion: Motion) -> list[set[int]]:
    """Per joint the axes along which it leaves its offset by more than rounding."""
    offsets = np.asarray(motion.skeleton.offsets)
    slack = 4 * np.finfo(motion.dtype).eps * np.abs(offsets).max()
    translations = np.asarray(motion.translations)
    high, low = translations.max(0) - offsets, translations.min(0) - offsets
    moved = (high > slack) | (low < -slack)
    return [set(np.flatnonzero(axes).tolist()) for axes in moved]


def _partial_angles(rotations: np.ndarray, names) -> np.ndarray | None:
    """Angles [T, k] by which k < 3 rotation channels express rotations [T, 1, 4], if they can."""
    known = parse_channels(names)
    used = len(known.rotations)
    tolerance = 1e-10 if rotations.dtype == np.float64 else 1e-5
    if used == 0:
        still = 2 * np.abs(rotations[..., 1:]).max() <= tolerance
        return np.zeros((len(rotations), 0)) if still else None
    angles = np.concatenate(list(angle_blocks(rotations, known.order)))[:, 0]
    angles = one_branch(angles, slot=2)
    if np.abs(np.remainder(angles[:, used:] + np.pi, 2 * np.pi) - np.pi).max() > tolerance:
        return None
    return angles[:, :used]


def _depth_first(skeleton: Skeleton) -> tuple[int, ...]:
    order, stack = [], [0]
    while stack:
        joint = stack.pop()
        order.append(joint)
        stack += reversed(skeleton.children[joint])
    return tuple(order)


def _first_columns(plan: Plan) -> dict[int, int]:
    first, base = {}, 0
    for joint in plan.order:
        first[joint] = base
        base += len(plan.channels[joint])
    return first


def _hierarchy_lines(skeleton: Skeleton, plan: Plan) -> Iterator[str]:
    """Lines from ROOT to its last brace; end sites and children in the order they came in."""
    channels, offsets, end_offsets = plan.channels, plan.offsets, np.asarray(skeleton.end_offsets)
    stack: list[tuple[str, int, int]] = [("joint", 0, 0)]
    arranged = _arranged(skeleton)
    while stack:
        kind, which, depth = stack.pop()
        indent = "\t" * depth
        if kind == "close":
            yield f"{indent}}}"
            continue
        if kind == "joint":
            title = f"{'JOINT' if depth else 'ROOT'} {skeleton.names[which]}"
            offset = offsets[which]
        else:
            title, offset = skeleton.end_labels[which], end_offsets[which]
        yield f"{indent}{title}"
        yield f"{indent}{{"
        yield f"{indent}\tOFFSET {' '.join(map(number_text, offset))}"
        stack.append(("close", which, depth))
        if kind == "joint":
            yield f"{indent}\tCHANNELS {' '.join([str(len(channels[which])), *channels[which]])}"
            stack += [(kind, item, depth + 1) for kind, item in reversed(arranged[which])]


def _arranged(skeleton: Skeleton) -> list[list[tuple[str, int]]]:
    """What stands inside each joint: a child goes before the end sites that come after its own."""
    never = len(skeleton.end_joints)
    earliest = [never] * skeleton.num_joints
    inside: list[list[tuple[int, str, int]]] = [[] for _ in skeleton.names]
    for end, joint in enumerate(skeleton.end_joints):
        earliest[joint] = min(earliest[joint], end)
        inside[joint].append((end, "end", end))
    for joint in range(skeleton.num_joints - 1, 0, -1):
        parent = skeleton.parents[joint]
        earliest[parent] = min(earliest[parent], earliest[joint])
    for joint, children in enumerate(skeleton.children):
        key = 0
        for child in children:
            key = max(key, earliest[child] if earliest[child] < never else key)
            inside[joint].append((key, "joint", child))
    return [
        [(kind, item) for _, kind, item in sorted(items, key=lambda entry: entry[0])]
        for items in inside
    ]


def _frame_time_text(motion: Motion) -> str:
    """The file's own text while it still says the motion's frame time."""
    seconds = motion.dtype.type(motion.frame_time)
    text = motion.frame_time_text
    kept = parse_number(text) if text is not None else None
    if text is not None and kept is not None and seconds == motion.dtype.type(kept):
        return text
    return number_text(seconds)
