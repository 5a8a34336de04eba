"""AMASS .npz files: SMPL-family body motion as rotation vectors, Z up.

    rotation_j(t) = exp(poses[t, 3j : 3j + 3]),  root position(t) = offsets[0] + trans[t]

| poses | model | joints |
|---|---|---|
| (T, 66) | body only | 22 |
| (T, 72) | SMPL | 24: the body and two hands |
| (T, 156) | SMPL-H | 52: the body and two hands of 15 joints |
| (T, 165) | SMPL-X | 55: the body, jaw, eyes and two hands |

The bone lengths are *not in the file*: they follow from ``betas`` and ``gender`` through a body
model that cannot be shipped. Pass ``offsets=`` (the model's joints at rest, each less its parent)
for true ones; otherwise a nominal adult stands in, whose rest pose is the models' T-pose (in their
own frame: Y up, facing Z, left hand towards X) with rounded average proportions, scaled to
``height``. Rotations do not depend on it; world positions of everything but the pelvis do.
``betas``, ``gender`` and other arrays are not read, and nothing is ever unpickled.

Source: Mahmood et al. 2019 (AMASS); Loper et al. 2015 (SMPL); Romero et al. 2017 (SMPL-H).
"""

from os import PathLike
from typing import Literal

import jax.numpy as jnp
import numpy as np

from jaxmotion.io.archive import Archive
from jaxmotion.io.errors import MotionFileError
from jaxmotion.io.euler_blocks import products
from jaxmotion.io.npz import MARK
from jaxmotion.io.precision import float_type
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton

_RATES = ("mocap_framerate", "mocap_frame_rate", "mocap_frequency")
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
    """Whether an .npz file is to be read as AMASS: it holds ``poses`` and is not ours.

    **Raises:** :class:`MotionFileError` if it is no .npz file; ``OSError`` if it cannot be opened.
    """
    names = Archive(path).names
    return MARK not in names and "poses" in names


def load_amass(
    path: str | PathLike,
    *,
    offsets=None,
    height: float | int = _NOMINAL_HEIGHT,
    up: Literal["y", "z"] = "z",
    dtype=None,
) -> Motion:
    """Read an AMASS motion.

    **Arguments:** ``offsets``: f[J, 3], metres, of the subject's joints from their parents at rest
    (the pelvis from the model's origin); by default the nominal adult's (see the module) of
    ``height`` metres; ``up``: "z" keeps the file's world, "y" turns it so that Y points up
    (x, y, z) → (x, z, −y); ``dtype``: float32 or float64, by default JAX's.
    **Returns:** a :class:`~jaxmotion.Motion` in metres, ``skeleton.up`` as asked.
    **Raises:** :class:`MotionFileError` for a file that cannot be understood; ``OSError`` for one
    that cannot be opened; ``ValueError`` for impossible arguments.
    """
    if up not in ("y", "z"):
        raise ValueError(f"load_amass: up={up!r}; expected 'y' or 'z'")
    dtype = float_type(dtype)
    archive = Archive(path)
    poses = _numbers(archive, "poses", "rotation vectors (T, 66), (T, 72), (T, 156) or (T, 165)")
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
    rate = _frame_rate(archive)
    with np.errstate(over="ignore", invalid="ignore"):
        rotations = _exp(poses.reshape(len(poses), len(table), 3))
    positions = rest[0] + trans
    if up == "y":
        positions = positions[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
        quarter = np.sqrt(0.5) * np.array([[1.0, -1.0, 0.0, 0.0]])
        rotations[:, :1] = products(quarter, rotations[:, :1], np.eye(1, 4))
    translations = np.broadcast_to(rest, (*rotations.shape[:-1], 3)).copy()
    translations[:, 0] = positions
    seconds = np.array(1.0 / rate)
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
        up=up,
    )
    return Motion(
        skeleton,
        translations,
        rotations,
        seconds,
        translated_joints=(0,),
    )


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


def _numbers(archive: Archive, name: str, what: str) -> np.ndarray:
    array = archive.read(name, what)
    if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
        found = f"{name!r} of dtype {array.dtype}"
        if array.dtype.kind == "f":
            found = f"entries of {name!r} that are not finite"
        raise MotionFileError(archive.path, found, expected=f"finite numbers, {what}")
    return array.astype(np.float64)


def _frame_rate(archive: Archive) -> float:
    name = next((name for name in _RATES if name in archive.names), _RATES[0])
    rate = _numbers(archive, name, "frames a second")
    if rate.size != 1 or not rate.item() > 0:
        raise MotionFileError(
            archive.path, f"{name} = {rate.tolist()}", expected="one positive number"
        )
    return rate.item()


def _exp(vectors: np.ndarray) -> np.ndarray:
    """Unit quaternions of rotation vectors: (..., 3) → (..., 4)."""
    half = 0.5 * np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * vectors], axis=-1)
