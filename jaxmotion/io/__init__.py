"""Files in, files out: :func:`load` and :func:`save` choose the format by the file's suffix.

| suffix | read | written | module |
|---|---|---|---|
| ``.bvh`` | yes | yes | :mod:`jaxmotion.io.bvh` |
| ``.amc`` (with its ``.asf``) | yes | yes | :mod:`jaxmotion.io.asfamc` |
| ``.npz`` | yes, ours and AMASS | ours | :mod:`jaxmotion.io.npz`, :mod:`jaxmotion.io.amass` |
| ``.glb`` (glTF 2.0) | no | yes | :mod:`jaxmotion.io.gltf` |
| ``.usda``, ``.usdc`` (USD) | no | yes | :mod:`jaxmotion.io.usd` |

The table is :mod:`jaxmotion.io.formats`. What is only written is for other programs, and needs an
extra: ``pip install 'jaxmotion[gltf]'`` or ``'jaxmotion[usd]'``. Files are parsed in float64; a
file is written whole or not at all. Trouble with a file's contents is a :class:`MotionFileError`
(path, line, frame, what was found, what was expected, what to try); a repair, or a change that the
format forced, is a :class:`MotionFileWarning`. What a format leaves open (the up axis, a frame
rate) is assumed, can be told, and is kept: :mod:`jaxmotion.io.conventions`.

Public are the names of this room, and the readers and writers of the modules in the table; the
other modules are the library's own.
"""

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from jaxmotion.io import formats
from jaxmotion.io.errors import MotionFileError, MotionFileWarning
from jaxmotion.io.formats import Up, UpOut

if TYPE_CHECKING:
    from jaxmotion.motion import Motion

__all__ = ["MotionFileError", "MotionFileWarning", "load", "save"]


def load(
    path: str | PathLike,
    *,
    dtype=None,
    fps: float | int | None = None,
    up: Up | None = None,
    **format_options,
) -> "Motion":
    """Read a motion file.

    Files are parsed in float64 and trouble with their contents says where, what was expected and
    what to try; see the module for the formats.

    **Arguments:** ``path``: the file, its suffix telling the format; ``dtype``: of the arrays,
    float32 or float64, by default float64 if JAX has 64-bit types enabled, else float32 (our own
    ``.npz`` keeps the dtypes it holds); ``fps``: frames a second, to overrule the file or where it
    tells none; ``up``: the axis that points up in the file, "x", "y" or "z", or "auto" for a guess
    with a warning, by default what the file or its format says, else y (nothing is turned: see
    :func:`jaxmotion.reorient`); ``format_options``: passed on to the format's own reader
    (:func:`~jaxmotion.io.bvh.load_bvh`, :func:`~jaxmotion.io.asfamc.load_amc`,
    :func:`~jaxmotion.io.npz.load_npz`, :func:`~jaxmotion.io.amass.load_amass`).
    **Returns:** a :class:`~jaxmotion.Motion`, lengths in the file's unit.
    **Raises:** :class:`MotionFileError` for a file that cannot be understood or a suffix that is
    not one that is read; ``OSError`` for one that cannot be opened; ``ValueError`` for a dtype
    that is not available, or an impossible ``fps`` or ``up``.

    **Example:**

        >>> import tempfile, jaxmotion as jm
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     jm.save(jm.samples.load("walk").motion, f"{folder}/walk.bvh")
        ...     motion = jm.load(f"{folder}/walk.bvh")
        >>> motion.rotations.shape, round(float(motion.fps), 1)
        ((240, 22, 4), 60.0)
    """
    return formats.reader(Path(path))(path, dtype=dtype, fps=fps, up=up, **format_options)


def save(
    motion: "Motion",
    path: str | PathLike,
    *,
    overwrite: bool = True,
    up: UpOut | None = None,
    **format_options,
) -> None:
    """Write a motion file, whole or not at all.

    **Arguments:** ``motion``: one clip; ``path``: the file, its suffix telling the format;
    ``overwrite``: whether a file of that name may be replaced; ``up``: the axis that is to point up
    in the file, to which the motion is turned, or "keep"; by default y, with a warning where that
    is another, in formats that cannot say it (BVH, AMC, glTF), and "keep" in others;
    ``format_options``: passed on to the format's own writer (:func:`~jaxmotion.io.bvh.save_bvh`,
    :func:`~jaxmotion.io.asfamc.save_amc`, :func:`~jaxmotion.io.npz.save_npz`,
    :func:`~jaxmotion.io.gltf.save_glb`, :func:`~jaxmotion.io.usd.save_usd`): the last two take
    ``metres``, of a unit of length.
    **Raises:** :class:`MotionFileError` for a suffix that is not one of the table's; ``ValueError``
    for a motion that the format cannot hold, or an impossible ``up``; ``ImportError`` for glTF
    without pygltflib and USD without usd-core; ``FileExistsError`` and other ``OSError`` from
    writing.

    **Example:**

        >>> import os, tempfile, jaxmotion as jm
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     jm.save(jm.samples.load("walk").motion, f"{folder}/walk.npz")
        ...     os.listdir(folder)
        ['walk.npz']
    """
    if up is not None:
        format_options["up"] = up
    formats.writer(Path(path))(motion, path, overwrite=overwrite, **format_options)
