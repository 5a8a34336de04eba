"""AMASS .npz files: SMPL-family body motion as rotation vectors, in metres, Z up.

    rotation_j(t) = exp(poses[t, 3j : 3j + 3]),  root position(t) = offsets[0] + trans[t]

| poses | model | joints |
|---|---|---|
| (T, 66) | body only | 22 |
| (T, 72) | SMPL | 24: the body and two hands |
| (T, 156) | SMPL-H | 52: the body and two hands of 15 joints |
| (T, 165) | SMPL-X | 55: the body, jaw, eyes and two hands |

Where there is no ``poses``, it is put together from ``root_orient`` (T, 3), ``pose_body`` (T, 63)
and, as far as they are there, ``pose_jaw`` (T, 3), ``pose_eye`` (T, 6) and ``pose_hand`` (T, 90);
joints of the smallest model that has them all, and that no array turns, stay at rest.

The bone lengths are *not in the file*: they follow from ``betas`` and ``gender`` through a body
model that cannot be shipped. Pass ``offsets=`` (the model's joints at rest, each less its parent)
for true ones; otherwise a nominal adult stands in, whose rest pose is the models' T-pose (in their
own frame: Y up, facing Z, left hand towards X) with rounded average proportions, scaled to
``height``. Rotations do not depend on it; world positions of everything but the pelvis do.
``betas``, ``gender`` and other arrays are not read, and nothing is ever unpickled.

Source: Mahmood et al. 2019 (AMASS); Loper et al. 2015 (SMPL); Romero et al. 2017 (SMPL-H).
"""

from os import PathLike

import jax.numpy as jnp
import numpy as np

from jaxmotion.io.archive import Archive
from jaxmotion.io.conventions import seconds_of, with_up
from jaxmotion.io.errors import MotionFileError
from jaxmotion.io.formats import Up
from jaxmotion.io.npz import MARK
from jaxmotion.io.precision import float_type
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Conventions, Skeleton

__all__ = ["load_amass"]

_RATES = ("mocap_framerate", "mocap_frame_rate", "mocap_frequency")
_POSES = "rotation vectors (T, 66), (T, 72), (T, 156) or (T, 165)"
# The parts of split poses in SMPL-X's order, and how wide they are.
_PARTS = {"root_orient": 3, "pose_body": 63, "pose_jaw": 3, "pose_eye": 6, "pose_hand": 90}
_NEEDED, _FACE_PARTS = ("root_orient", "pose_body"), ("pose_jaw", "pose_eye")
_NOMINAL_HEIGHT = 1.70

Offset = tuple[float, float, float]
Rows = tuple[tuple[str, str, Offset | None], ...]

# Name, parent, offset from it in metres; the left side and the middle. The right side mirrors x.
_BODY: Rows = (
    ("pelvis", "", (0.0, -0.23, 0.03)),
    ("left_hip", "pelvis", (0.06, -0.09, -0.01)),
    ("right_hip", "pelvis", None),
    ("spine1", "pelvis", (0.0, 0.12, -0.03)),
    ("left_knee", "left_hip", (0.045, -0.38, 0.005)),
    ("right_knee", "right_hip", None),
    ("spine2", "spine1", (0.0, 0.135, 0.0)),
    ("left_ankle", "left_knee", (-0.015, -0.4, -0.04)),
    ("right_ankle", "right_knee", None),
    ("spine3", "spine2", (0.0, 0.055, 0.025)),
    ("left_foot", "left_ankle", (0.04, -0.06, 0.12)),
    ("right_foot", "right_ankle", None),
    ("neck", "spine3", (0.0, 0.215, -0.04)),
    ("left_collar", "spine3", (0.075, 0.115, -0.03)),
    ("right_collar", "spine3", None),
    ("head", "neck", (0.0, 0.085, 0.05)),
    ("left_shoulder", "left_collar", (0.115, 0.04, -0.01)),
    ("right_shoulder", "right_collar", None),
    ("left_elbow", "left_shoulder", (0.26, -0.01, -0.02)),
    ("right_elbow", "right_shoulder", None),
    ("left_wrist", "left_elbow", (0.25, 0.01, 0.0)),
    ("right_wrist", "right_elbow", None),
)
_HANDS: Rows = (
    ("left_hand", "left_wrist", (0.085, -0.01, -0.015)),
    ("right_hand", "right_wrist", None),
)
_FACE: Rows = (
    ("jaw", "head", (0.0, -0.005, 0.0)),
    ("left_eye_smplhf", "head", (0.03, 0.06, 0.075)),
    ("right_eye_smplhf", "head", None),
)
# A finger's first joint from the wrist, and the steps to its second and third.
_FINGERS = {
    "index": ((0.1, -0.01, 0.025), (0.032, 0.0, 0.001), (0.023, 0.0, 0.0)),
    "middle": ((0.105, -0.005, 0.0), (0.032, 0.0, -0.001), (0.024, 0.0, -0.001)),
    "pinky": ((0.085, -0.015, -0.045), (0.017, 0.0, -0.005), (0.016, 0.0, -0.005)),
    "ring": ((0.095, -0.01, -0.025), (0.029, 0.0, -0.003), (0.024, 0.0, -0.003)),
    "thumb": ((0.04, -0.015, 0.03), (0.024, 0.0, 0.02), (0.024, 0.0, 0.015)),
}


def is_amass(path: str | PathLike) -> bool:
    """Whether an .npz file is to be read as AMASS: it holds poses, whole or in parts; not ours.

    **Raises:** :class:`MotionFileError` if it is no .npz file; ``OSError`` if it cannot be opened.
    """
    names = Archive(path).names
    return MARK not in names and ("poses" in names or set(_NEEDED) <= set(names))


def load_amass(
    path: str | PathLike,
    *,
    offsets=None,
    height: float | int = _NOMINAL_HEIGHT,
    fps: float | int | None = None,
    up: Up | None = None,
    dtype=None,
) -> Motion:
    """Read an AMASS motion.

    **Arguments:** ``path``: the file; ``offsets``: f[J, 3], metres, of the subject's joints from
    their parents at rest (the pelvis from the model's origin); by default those of a nominal adult
    of ``height`` metres; ``height``: of the nominal adult, metres; ``fps``: frames a
    second, to overrule the file's or where it tells none; ``up``: the axis that points up in the
    file, by default z, as in AMASS itself, or "auto" for a guess (:func:`jaxmotion.reorient` turns
    the motion); ``dtype``: float32 or float64, by default JAX's.
    **Returns:** a :class:`~jaxmotion.Motion` in metres.
    **Raises:** :class:`MotionFileError` for a file that cannot be understood; ``OSError`` for one
    that cannot be opened; ``ValueError`` for impossible arguments.
    """
    dtype = float_type(dtype)
    seconds = seconds_of(fps, "load_amass")
    archive = Archive(path)
    poses = _poses(archive)
    tables = {3 * len(table): table for table in map(_joints, (22, 24, 52, 55))}
    if poses.ndim != 2 or poses.shape[1] not in tables or len(poses) == 0:
        raise MotionFileError(
            path,
            f"poses of shape {poses.shape}",
            expected="(T, 66), (T, 72), (T, 156) or (T, 165) with frames",
            hint="SMPL, SMPL-H and SMPL-X bodies are understood",
        )
    table = tables[poses.shape[1]]
    trans = _numbers(archive, "trans", "root translations (T, 3)")
    if trans.shape != (len(poses), 3):
        raise MotionFileError(
            path, f"trans of shape {trans.shape}", expected=f"({len(poses)}, 3) like the poses"
        )
    rest = _rest(table, height) if offsets is None else np.asarray(offsets, np.float64)
    if rest.shape != (len(table), 3) or not np.isfinite(rest).all():
        raise ValueError(
            f"load_amass: offsets of shape {rest.shape}; expected ({len(table)}, 3), finite"
        )
    seconds = np.array(seconds or 1.0 / _frame_rate(archive))
    with np.errstate(over="ignore", invalid="ignore"):
        rotations = _exp(poses.reshape(len(poses), len(table), 3))
    translations = np.broadcast_to(rest, (*rotations.shape[:-1], 3)).copy()
    translations[:, 0] += trans
    with np.errstate(over="ignore"):
        arrays = [array.astype(dtype) for array in (rest, translations, rotations, seconds)]
    if not all(np.isfinite(array).all() for array in arrays) or arrays[-1] <= 0:
        raise MotionFileError(
            path,
            "rotation vectors, translations or a frame rate that are too large or too small",
            expected=f"numbers that are finite in {dtype}",
        )
    rest, translations, rotations, seconds = map(jnp.asarray, arrays)
    places = {name: j for j, (name, _, _) in enumerate(table)}
    skeleton = Skeleton(
        [name for name, _, _ in table],
        [places.get(parent, -1) for _, parent, _ in table],
        rest,
        up="z",
        conventions=Conventions(metres=1.0),
    )
    motion = Motion(skeleton, translations, rotations, seconds, translated_joints=(0,))
    return with_up(motion, up, path, "load_amass")


def _joints(count: int) -> list[tuple[str, str, Offset]]:
    """Name, parent and nominal offset of each joint of the model that has ``count`` of them."""
    rows = list(_BODY)
    if count == 24:
        rows += _HANDS
    if count == 55:
        rows += _FACE
    for side in ("left", "right") if count > 24 else ():
        for finger, steps in _FINGERS.items():
            parent = f"{side}_wrist"
            for number, step in enumerate(steps, 1):
                name = f"{side}_{finger}{number}"
                rows.append((name, parent, step if side == "left" else None))
                parent = name
    given = {name: offset for name, _, offset in rows if offset}
    return [(name, parent, offset or _mirrored(name, given)) for name, parent, offset in rows]


def _mirrored(name: str, given: dict[str, Offset]) -> Offset:
    x, y, z = given[name.replace("right", "left")]
    return (-x, y, z)


def _rest(table, height: float | int) -> np.ndarray:
    if not 0 < height < np.inf:
        raise ValueError(f"load_amass: height={height!r}; expected metres, above 0")
    return height / _NOMINAL_HEIGHT * np.array([offset for _, _, offset in table])


def _poses(archive: Archive) -> np.ndarray:
    """The rotation vectors f64[T, 3 J], in one array of the file or in parts."""
    if "poses" in archive.names:
        return _numbers(archive, "poses", _POSES)
    present = [name for name in _PARTS if name in archive.names or name in _NEEDED]
    parts = {name: _numbers(archive, name, f"(T, {_PARTS[name]})") for name in present}
    frames = len(parts["root_orient"]) if parts["root_orient"].ndim else 0
    for name, part in parts.items():
        if part.shape != (frames, _PARTS[name]) or frames == 0:
            raise MotionFileError(
                archive.path,
                f"{name} of shape {part.shape}",
                expected=f"({frames or 'T'}, {_PARTS[name]}) with frames",
            )
    if any(name in parts for name in _FACE_PARTS):
        wanted = tuple(_PARTS)
    else:
        wanted = tuple(name for name in _PARTS if name not in _FACE_PARTS and name in parts)
    zeros = {name: np.zeros((frames, _PARTS[name])) for name in wanted}
    return np.concatenate([parts.get(name, zeros[name]) for name in wanted], axis=1)


def _numbers(archive: Archive, name: str, what: str) -> np.ndarray:
    array = archive.read(name, what)
    if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
        found = f"{name!r} of dtype {array.dtype}"
        if array.dtype.kind == "f":
            found = f"entries of {name!r} that are not finite"
        raise MotionFileError(archive.path, found, expected=f"finite numbers, {what}")
    return array.astype(np.float64)


def _frame_rate(archive: Archive) -> float:
    name = next((name for name in _RATES if name in archive.names), None)
    if name is None:
        raise MotionFileError(
            archive.path,
            f"no array {', '.join(map(repr, _RATES[:-1]))} or {_RATES[-1]!r}",
            expected="one of them, frames a second",
            hint="tell the rate: fps=30 (--fps 30), or what is right",
        )
    rate = _numbers(archive, name, "frames a second")
    if rate.size != 1 or not rate.item() > 0:
        raise MotionFileError(
            archive.path, f"{name} = {rate.tolist()}", expected="one positive number"
        )
    return rate.item()


def _exp(vectors: np.ndarray) -> np.ndarray:
    """Unit quaternions of rotation vectors: (..., 3) → (..., 4)."""
    half = 0.5 * np.linalg.norm(vectors, axis=-1, keepdims=True)
    over = np.divide(np.sin(half), half, out=np.ones_like(half), where=half > 0)
    return np.concatenate([np.cos(half), 0.5 * over * vectors], axis=-1)
