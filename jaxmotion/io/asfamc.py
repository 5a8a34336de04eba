"""Acclaim motion (.amc) and its skeleton (.asf), both ways.

| file | what |
|---|---|
| :mod:`jaxmotion.io.asf` | skeleton in: names, offsets, axes, dofs, limits, units |
| :mod:`jaxmotion.io.asf_write` | skeleton out, from any offsets |
| :mod:`jaxmotion.io.amc` | the motion's table, in and out |
| :mod:`jaxmotion.io.asf_dofs` | q = C R C⁻¹: the table's dofs ↔ local transforms |

Dofs that a bone lacks, or a file leaves out, are 0. A bone counts as translated if its translation
is ever more than a millionth of the longest offset; the root always does. Angles are degrees or
radians as the AMC (else the ASF) says. Lengths stay in the file's unit; ``Skeleton.length_unit``
keeps its factor (CMU: 0.45; a length divided by it is in inches). Few files tell their frame rate
(``:SAMPLES-PER-SECOND``); CMU's is 120.

Writing keeps dofs, limits and axes. A rotation or translation that a bone's dofs cannot express
gets the missing ones added after them, with whole-range limits, so nothing is lost: smoothing a
knee of one dof makes it a knee of three. A :class:`~jaxmotion.io.MotionFileWarning` names the
joints. Where a joint that is not translated is off its offset by rounding (of the file it came
from), the bone is made to fit the joint's first frame. A skeleton from elsewhere gets bones that
fit its offsets, axes along the world's and dofs in the order of its BVH channels. Angles are
unwrapped along time and rounded to 10⁻¹² degrees, less than their conversion costs, so that a
file's own decimals come back; lengths are exact; float32 motions are written with nine digits.
O(T·J).

Source: Acclaim, "Skeleton File Definition V1.10" (1995); Meredith & Maddock 2001.
"""

import os
import warnings
from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Literal

import jax.numpy as jnp
import numpy as np

from jaxmotion._asf_bone import AsfBone
from jaxmotion._checks import one_of
from jaxmotion._plain import printable
from jaxmotion.io.amc import read_amc, write_amc
from jaxmotion.io.asf import read_asf
from jaxmotion.io.asf_dofs import dofs_from_transforms, places, transforms_from_dofs
from jaxmotion.io.asf_write import asf_bones, asf_names, asf_text
from jaxmotion.io.atomic import atomic_write, in_the_way
from jaxmotion.io.conventions import seconds_of, turned_for, with_up
from jaxmotion.io.errors import MotionFileError, MotionFileWarning
from jaxmotion.io.formats import Up, UpOut
from jaxmotion.io.precision import float_type
from jaxmotion.io.printed_digits import LARGEST_ROUNDING, SINGLE_PRECISION
from jaxmotion.io.soundness import check_clip
from jaxmotion.io.text import encoding_for
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Conventions, Skeleton

__all__ = ["load_amc", "save_amc"]

_DECIMALS = 12
_ASSUMED_FPS = 120.0


def load_amc(
    path: str | PathLike,
    *,
    asf: str | PathLike | None = None,
    fps: float | int | None = None,
    up: Up | None = None,
    angle: Literal["deg", "rad"] | None = None,
    dtype=None,
    encoding: str | None = None,
) -> Motion:
    """Read an AMC motion and its ASF skeleton.

    **Arguments:** ``path``: the .amc file; ``asf``: the skeleton's file; by default the one beside
    ``path`` with its stem, or with the stem up to an underscore (``02_05.amc`` → ``02.asf``), or
    the folder's only one; ``fps``: frames a second, by default what the file says, else 120;
    ``up``: the axis that points up, which no file says, or "auto" for a guess; y is assumed;
    ``angle``: "deg" or "rad", by default what the AMC says, else the ASF, else degrees; ``dtype``:
    float32 or float64, by default JAX's; ``encoding``: of the .asf's names ("gbk"), by default told
    from their bytes (:mod:`jaxmotion.io.text`).
    **Returns:** a :class:`~jaxmotion.Motion`; ``skeleton.asf`` and ``skeleton.channels`` hold the
    bones' axes, limits and dofs.
    **Raises:** :class:`MotionFileError` for a file that cannot be understood, or no ASF;
    ``OSError`` for one that cannot be opened; ``ValueError`` for a dtype that is not available, or
    an impossible ``fps``, ``up`` or ``angle``.
    """
    asked = seconds_of(fps, "load_amc")
    if angle is not None:
        one_of("load_amc: angle", angle, ("deg", "rad"))
    path = Path(path)
    dtype = float_type(dtype)
    asf = asf_beside(path) if asf is None else Path(asf)
    skeleton, asf_unit = read_asf(asf, encoding, angle)
    widths = {n: len(d) for n, d in zip(skeleton.names, skeleton.channels, strict=True)}
    table = read_amc(path, widths, skeleton.encoding)
    columns = table.columns
    unit = angle or table.unit or asf_unit
    if unit != "rad":
        dofs = dict(zip(skeleton.names, skeleton.channels, strict=True))
        columns = {n: _in_radians(v, dofs[n]) for n, v in columns.items()}
    seconds = np.array(asked or 1.0 / (table.fps or _ASSUMED_FPS))
    rate = "told" if asked or table.fps else "assumed"
    with np.errstate(over="ignore", invalid="ignore"):
        transforms = transforms_from_dofs(skeleton, columns, table.num_frames)
        moved = _moved_joints(skeleton, transforms[0])
        arrays = (skeleton.offsets, skeleton.end_offsets, *transforms, seconds)
        arrays = [np.asarray(array).astype(dtype) for array in arrays]
    if not all(np.isfinite(array).all() for array in arrays) or arrays[-1] <= 0:
        raise MotionFileError(
            path,
            "lengths, translations or a frame rate that are too large or too small",
            expected=f"numbers that are finite in {dtype}",
        )
    offsets, end_offsets, translations, rotations, seconds = map(jnp.asarray, arrays)
    motion = Motion(
        Skeleton(
            skeleton.names,
            skeleton.parents,
            offsets,
            end_joints=skeleton.end_joints,
            end_offsets=end_offsets,
            channels=skeleton.channels,
            asf=skeleton.asf,
            length_unit=skeleton.length_unit,
            encoding=skeleton.encoding,
            conventions=Conventions("assumed", rate, angle="told" if unit else "assumed"),
        ),
        translations,
        rotations,
        seconds,
        translated_joints=moved,
    )
    return with_up(motion, up, path, "load_amc")


def save_amc(
    motion: Motion,
    path: str | PathLike,
    *,
    asf: str | PathLike | None = None,
    overwrite: bool = True,
    up: UpOut = "y",
) -> None:
    """Write an AMC motion and its ASF skeleton, each whole or not at all.

    **Arguments:** ``motion``: one clip; ``path``: the .amc file; ``asf``: where the skeleton goes,
    by default ``path`` with the suffix .asf; ``overwrite``: whether files of those names may be
    replaced; ``up``: the axis that points up in the file, to which the motion is turned
    (:func:`jaxmotion.reorient`) with a warning, or "keep".
    **Raises:** ``ValueError`` for several clips, no frames, NaN, rotations that are no unit
    quaternions, one name for both files, or another ``up``; ``FileExistsError`` and other
    ``OSError`` from writing.
    """
    path = Path(path)
    asf = path.with_suffix(".asf") if asf is None else Path(asf)
    if os.path.realpath(asf) == os.path.realpath(path):
        raise ValueError(f"save_amc: path and asf are both {printable(path)}; give two names")
    check_clip(motion)
    if existing := [p for p in (path, asf) if in_the_way(p, overwrite)]:
        raise FileExistsError(f"{printable(existing[0])} exists; pass overwrite=True to replace it")
    motion = turned_for(motion, up, path, "save_amc")
    skeleton, translations = _at_rest(motion)
    bones = asf_bones(skeleton)
    dofs, values = dofs_from_transforms(skeleton, bones, translations, np.asarray(motion.rotations))
    _report_added(path, skeleton, dofs)
    columns = {
        name: _in_degrees(table, names)
        for name, names, table in zip(asf_names(skeleton), dofs, values, strict=True)
        if names
    }
    limits = [_limits(bone, names) for bone, names in zip(bones, dofs, strict=True)]
    text = asf_text(skeleton, bones, dofs, limits)
    encoding = encoding_for(text, skeleton.encoding)
    digits = "%r" if motion.dtype == np.float64 else "%.9g"
    with (
        atomic_write(asf, overwrite=overwrite) as asf_file,
        atomic_write(path, overwrite=overwrite) as amc_file,
    ):
        asf_file.write(text.encode(encoding))
        write_amc(amc_file, columns, _fps_text(np.asarray(motion.frame_time)), digits, encoding)


def asf_beside(path: Path) -> Path:
    """The skeleton's file of an .amc file, as :func:`load_amc` finds it."""
    os.stat(path)  # that it is there at all is the first to say
    found = sorted(p for p in path.parent.iterdir() if p.suffix.lower() == ".asf")
    by_stem = {p.stem.lower(): p for p in found}
    stem = path.stem.lower()
    while stem:
        if stem in by_stem:
            return by_stem[stem]
        stem = stem.rpartition("_")[0]
    if len(found) == 1:
        return found[0]
    raise MotionFileError(
        path,
        f"{len(found) or 'no'} .asf files beside it, none of its name",
        expected=f"its skeleton, such as {path.stem.partition('_')[0]}.asf",
        hint="pass the skeleton's file: asf=...",
    )


def _moved_joints(skeleton: Skeleton, translations: np.ndarray) -> tuple[int, ...]:
    """The root, and the joints that leave their offset by more than single precision rounds."""
    apart = np.abs(translations - np.asarray(skeleton.offsets)).max(axis=(0, 2))
    longest = np.abs(np.asarray(skeleton.offsets)[1:]).max(initial=0.0)
    return (0, *(1 + np.flatnonzero(apart[1:] > SINGLE_PRECISION * longest)).tolist())


def _at_rest(motion: Motion) -> tuple[Skeleton, np.ndarray]:
    """The skeleton and translations [T, J, 3] with every joint that is not translated, and but for
    rounding at its offset, where its first frame puts it, which is the one that counts."""
    offsets, translations = np.array(motion.skeleton.offsets), np.array(motion.translations)
    apart = np.abs(translations - offsets).max(axis=(0, 2))
    still = apart <= LARGEST_ROUNDING * np.abs(offsets[1:]).max(initial=0.0)
    still[[0, *motion.translated_joints]] = False
    offsets[still] = translations[:, still] = translations[0, still]
    return replace(motion.skeleton, offsets=offsets), translations


def _turning(dofs: Sequence[str]) -> np.ndarray:
    return np.array([kind == "r" for kind, _ in places(dofs)], bool)


def _in_radians(values: np.ndarray, dofs: Sequence[str]) -> np.ndarray:
    return np.where(_turning(dofs), np.radians(values), values)


def _in_degrees(values: np.ndarray, dofs: Sequence[str]) -> np.ndarray:
    return np.where(_turning(dofs), np.round(np.degrees(values), _DECIMALS), values)


def _report_added(path: Path, skeleton: Skeleton, dofs: Sequence[Sequence[str]]) -> None:
    if not skeleton.asf:
        return
    pairs = zip(skeleton.names, skeleton.channels, dofs, strict=True)
    changed = [name for name, before, after in pairs if len(after) > len(before)]
    if changed:
        warnings.warn(
            f"{path}: degrees of freedom were added, so that nothing is lost, to "
            f"{', '.join(changed)}",
            MotionFileWarning,
            stacklevel=3,
        )


def _limits(bone: AsfBone, dofs: Sequence[str]) -> tuple[tuple[float, float], ...]:
    """The bone's limits, and whole ranges for the dofs that were added."""
    if not bone.limits:
        return ()
    whole = [(-180.0, 180.0) if name[0] in "rR" else (-np.inf, np.inf) for name in dofs]
    return (*bone.limits, *whole[len(bone.limits) :])


def _fps_text(frame_time: np.ndarray) -> str:
    """The shortest decimal that reads back as this frame time in its dtype."""
    text = ""
    for digits in range(1, 18):
        text = repr(float(f"{1.0 / float(frame_time):.{digits}g}"))
        if frame_time.dtype.type(1.0 / float(text)) == frame_time:
            break
    return text
