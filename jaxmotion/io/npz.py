"""Our own .npz: a :class:`~jaxmotion.Motion` as it is, bit for bit.

| array | holds |
|---|---|
| ``jaxmotion_motion`` | version of this layout, an integer |
| ``translations``, ``rotations``, ``frame_time`` | the motion's arrays, in their own dtypes |
| ``offsets``, ``end_offsets`` | the skeleton's |
| ``static`` | a text, JSON: every static field of motion, skeleton and ASF bones |

Nothing is pickled, in or out. Any leading batch axes are kept. Deflated unless asked otherwise.
"""

import json
from dataclasses import asdict, replace
from os import PathLike
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxmotion._asf_bone import AsfBone
from jaxmotion._plain import quoted
from jaxmotion.io.archive import Archive, write_archive
from jaxmotion.io.atomic import atomic_write
from jaxmotion.io.conventions import seconds_of, turned_to, with_up
from jaxmotion.io.errors import MotionFileError
from jaxmotion.io.formats import Up, UpOut
from jaxmotion.io.precision import float_type
from jaxmotion.io.soundness import check_arrays, trouble
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Conventions, Skeleton

__all__ = ["load_npz", "save_npz"]

MARK = "jaxmotion_motion"
_VERSION = 1
_ARRAYS = ("translations", "rotations", "frame_time", "offsets", "end_offsets")
_ASF = ("axis", "axis_order", "direction", "length", "limits")


def save_npz(
    motion: Motion,
    path: str | PathLike,
    *,
    overwrite: bool = True,
    compress: bool = True,
    up: UpOut = "keep",
) -> None:
    """Write a motion to an .npz file, whole or not at all.

    **Arguments:** ``motion``: one clip or a batch; ``path``: the file; ``overwrite``: whether a
    file of that name may be replaced; ``compress``: deflate the arrays (about half the size, ten
    times the time); ``up``: the axis to point up, to which the motion is turned, or "keep".
    **Raises:** ``ValueError`` if an array has NaN or infinite entries, a rotation is not a unit
    quaternion, a frame time is not positive, or for another ``up``; ``FileExistsError`` and other
    ``OSError`` from writing.
    """
    motion = turned_to(motion, up, "save_npz")
    skeleton = motion.skeleton
    static = {
        "translated_joints": motion.translated_joints,
        "frame_time_text": motion.frame_time_text,
        "names": skeleton.names,
        "parents": skeleton.parents,
        "end_joints": skeleton.end_joints,
        "end_labels": skeleton.end_labels,
        "channels": skeleton.channels,
        "asf": [{name: getattr(bone, name) for name in _ASF} for bone in skeleton.asf],
        "up": skeleton.up,
        "length_unit": skeleton.length_unit,
        "encoding": skeleton.encoding,
        "conventions": asdict(skeleton.conventions),
    }
    arrays = {
        MARK: np.array(_VERSION),
        "static": np.array(json.dumps(static)),
        "translations": np.asarray(motion.translations),
        "rotations": np.asarray(motion.rotations),
        "frame_time": np.asarray(motion.frame_time),
        "offsets": np.asarray(skeleton.offsets),
        "end_offsets": np.asarray(skeleton.end_offsets),
    }
    check_arrays(motion)
    for name in ("offsets", "end_offsets"):
        if not np.isfinite(arrays[name]).all():
            raise ValueError(f"save_npz: {name} has entries that are not finite; repair them first")
    with atomic_write(path, overwrite=overwrite) as file:
        write_archive(file, arrays, compress=compress)


def load_npz(
    path: str | PathLike, *, dtype=None, fps: float | int | None = None, up: Up | None = None
) -> Motion:
    """Read a motion from an .npz file that :func:`save_npz` wrote.

    **Arguments:** ``path``: the file; ``dtype``: float32 or float64 for every array; by default
    they keep their own (float64 becomes float32 where JAX has it disabled); ``fps``: frames a
    second, to overrule the file's; ``up``: the axis that points up, to overrule it likewise, or
    "auto" for a guess.
    **Returns:** a :class:`~jaxmotion.Motion`, batch axes and all.
    **Raises:** :class:`MotionFileError` for a file that cannot be understood; ``OSError`` for one
    that cannot be opened; ``ValueError`` for a dtype that is not available, or an impossible
    ``fps`` or ``up``.
    """
    seconds = seconds_of(fps, "load_npz")
    wanted = None if dtype is None else float_type(dtype)
    archive = Archive(path)
    version = archive.read(MARK, "the layout's version: a motion that jaxmotion saved")
    if version.shape != () or version.dtype.kind not in "iu" or int(version) != _VERSION:
        raise MotionFileError(
            path,
            f"layout version {quoted(str(version))}",
            expected=f"version {_VERSION}",
            hint="update jaxmotion; the file was written by another version",
        )
    static = _static(archive)
    arrays = {name: jnp.asarray(archive.floats(name, wanted)) for name in _ARRAYS}
    try:
        motion = _assemble(static, arrays)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise MotionFileError(
            path,
            f"fields that do not fit together ({error})",
            expected="what save_npz wrote",
            hint="save the motion again",
        ) from error
    found = trouble(motion.skeleton.names, motion.translations, motion.rotations)
    if found:
        raise MotionFileError(path, found, expected="rotations that are unit quaternions")
    if seconds is not None:
        motion = _at_rate(motion, seconds)
    return with_up(motion, up, path, "load_npz")


def _at_rate(motion: Motion, seconds: float) -> Motion:
    skeleton = motion.skeleton
    told = replace(skeleton.conventions, frame_time="told")
    return motion.replace(
        skeleton=replace(skeleton, conventions=told),
        frame_time=jnp.full_like(motion.frame_time, seconds),
    )


def _static(archive: Archive) -> dict[str, Any]:
    text = archive.read("static", "the static fields as JSON text")
    try:
        static = json.loads(str(text))
    except (ValueError, RecursionError) as error:
        found = f"static fields that are no JSON ({error})"
        raise MotionFileError(archive.path, found, expected="JSON text") from error
    if not isinstance(static, dict):
        raise MotionFileError(archive.path, quoted(str(text)), expected="a JSON object")
    return static


def _assemble(static: dict[str, Any], arrays: dict[str, Any]) -> Motion:
    fields = _tuples(static)
    names, joints = fields["names"], fields["translated_joints"]
    ends, text = fields["end_joints"], fields["frame_time_text"]
    encoding = fields.get("encoding", "utf-8")
    lone = (encoding,) if text is None else (encoding, text)
    words = [names, fields["end_labels"], *fields["channels"], lone]
    if not all(isinstance(row, tuple) and all(isinstance(w, str) for w in row) for row in words):
        raise TypeError("names that are no lists of texts")
    if not all(type(number) is int for number in (*fields["parents"], *ends, *joints)):
        raise TypeError("an index that is no whole number")
    if not all(0 <= j < len(names) for j in (*ends, *joints)):
        raise ValueError(f"an index beyond the {len(names)} joints")
    frame_time, rotations = arrays["frame_time"], arrays["rotations"]
    if frame_time.shape not in ((), rotations.shape[:-3]) or not (frame_time > 0).all():
        raise ValueError(f"a frame time {frame_time}")
    skeleton = Skeleton(
        names,
        fields["parents"],
        arrays["offsets"],
        end_joints=ends,
        end_offsets=arrays["end_offsets"],
        end_labels=fields["end_labels"],
        channels=fields["channels"],
        asf=[_bone(bone) for bone in fields["asf"]],
        up=fields["up"],
        length_unit=_finite(fields["length_unit"]),
        encoding=encoding,
        conventions=_conventions(fields.get("conventions", {})),
    )
    return Motion(
        skeleton,
        arrays["translations"],
        rotations,
        frame_time,
        translated_joints=joints,
        frame_time_text=text,
    )


def _conventions(fields: dict[str, Any]) -> Conventions:
    found = Conventions(**fields)
    ways = (found.up, found.frame_time, found.angle)
    if not all(way in ("told", "guessed", "assumed") for way in ways):
        raise ValueError(f"conventions {ways}")
    if found.metres is None:
        return found
    if not 0 < float(found.metres) < np.inf:
        raise ValueError(f"a unit of {found.metres} metres")
    return replace(found, metres=float(found.metres))


def _bone(fields: dict[str, Any]) -> AsfBone:
    (x, y, z), (a, b, c) = (map(_finite, fields[name]) for name in ("axis", "direction"))
    order = fields["axis_order"]
    if sorted(order) != ["X", "Y", "Z"]:
        raise ValueError(f"axis order {order!r}")
    limits = tuple((float(low), float(high)) for low, high in fields["limits"])
    if np.isnan(limits).any():
        raise ValueError("limits that are no numbers")
    return AsfBone((x, y, z), order, (a, b, c), _finite(fields["length"]), limits)


def _finite(value: Any) -> float:
    number = float(value)
    if not np.isfinite(number):
        raise ValueError(f"the number {number}")
    return number


def _tuples(value: Any) -> Any:
    """JSON's lists as tuples, all the way down."""
    if isinstance(value, list):
        return tuple(_tuples(item) for item in value)
    if isinstance(value, dict):
        return {key: _tuples(item) for key, item in value.items()}
    return value
