"""What pictures ask of what they are given: known values, joints by name, and words for units."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jaxmotion._checks import one_of, traced
from jaxmotion._entry import finite_clip
from jaxmotion._plain import printable
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton

_UNITS = {1.0: "metres", 0.01: "cm", 0.001: "mm", 0.0254: "inches", 0.3048: "feet"}


def known_only(caller: str, **values: Any) -> None:
    """``ValueError`` if any of the values is traced."""
    for name, value in values.items():
        if traced(value):
            raise ValueError(
                f"{caller}: {name} is traced; pictures are of known values, made outside of jit"
            )


def known_clip(caller: str, motion: Any, name: str = "motion") -> Motion:
    """The motion, a single known clip of finite numbers: ``ValueError`` otherwise."""
    finite_clip(caller, motion, name, on_host=True)
    known_only(caller, **{name: motion})
    return motion


def named_clips(caller: str, motions: Any) -> dict[str, Motion]:
    """Clips by their names, which print: of one clip, "" for its name."""
    if not isinstance(motions, Mapping):
        return {"": known_clip(caller, motions)}
    if not motions:
        raise ValueError(f"{caller}: motions is empty; expected at least one clip")
    clips = {
        printable(name): known_clip(caller, clip, f"motions[{name!r}]")
        for name, clip in motions.items()
    }
    if len(clips) < len(motions):
        raise ValueError(f"{caller}: names {list(motions)} look the same when they are shown")
    return clips


def joint_number(caller: str, skeleton: Skeleton, joint: int | str) -> int:
    """The number of a joint that is given by it or by its name."""
    if isinstance(joint, str):
        return skeleton.index(joint)
    if not 0 <= joint < skeleton.num_joints:
        raise ValueError(f"{caller}: joint={joint}; expected 0 to {skeleton.num_joints - 1}")
    return int(joint)


def joint_numbers(
    caller: str, skeleton: Skeleton, joints: Sequence[int | str] | None, default: Sequence[int]
) -> list[int]:
    """The numbers of some joints, ``default`` for None."""
    if joints is None:
        return list(default)
    if isinstance(joints, str) or not len(joints):
        raise ValueError(f"{caller}: joints={joints!r}; expected a list of some joints")
    return [joint_number(caller, skeleton, joint) for joint in joints]


def axis_number(caller: str, axis: str | None, spread: np.ndarray) -> int:
    """Which component ``axis`` names, None: that of the largest ``spread``, f[3]."""
    one_of(f"{caller}: axis", axis, ("x", "y", "z", None))
    return int(np.argmax(spread)) if axis is None else "xyz".index(axis)


def unit_of(skeleton: Skeleton) -> str:
    """The unit of length in words."""
    metres = skeleton.conventions.metres
    if metres is None:
        return "file's unit"
    return _UNITS.get(float(metres), f"{float(metres):.4g} m")
