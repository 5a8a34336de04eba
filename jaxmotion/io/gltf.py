"""glTF 2.0 binary (.glb), written only: a skeleton and its animation, for other programs.

| what | how |
|---|---|
| a joint | a node with the joint's name and, at rest, its offset; no mesh is needed |
| an end site | a leaf node ``<joint>_end``: bones get their lengths from it |
| all of them | one skin, its inverse bind matrices minus the places at rest: an armature |
| rotation | a channel a joint, (x, y, z, w), linear in between |
| translation | a channel for every joint that leaves its offset: the whole local translation |
| time | one accessor, seconds from 0, with its bounds |

glTF is in metres and Y up, by its specification: lengths are multiplied by the metres of a unit,
and a motion that has another axis up is turned. Numbers are float32, as glTF stores them: places
are good to some 1e-7 of their distance from the origin, a rotation to 1e-7. Names are kept as they
are. What glTF has no place for stays behind: Euler orders, an ASF's axes and limits, labels of end
sites.

Blender keeps its scene's frame rate and range when it imports a .glb: set them before. Needs
``pygltflib``: ``pip install 'jaxmotion[gltf]'``.

Source: Khronos, glTF 2.0 specification (2021).
"""

import math
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from jaxmotion._plain import printable
from jaxmotion.io.atomic import atomic_write
from jaxmotion.io.conventions import turned_to
from jaxmotion.io.formats import UpOut, extra_of
from jaxmotion.io.interchange import (
    Figure,
    check,
    figure_of,
    first_few,
    metres_of,
    rate_of,
    warn_of,
)
from jaxmotion.motion import Motion

__all__ = ["save_glb"]

_FLOAT = 5126
_LONGEST_NAME = 63  # bytes of UTF-8 that Blender keeps
_LARGEST = 2**32 - 2**20  # bytes: a .glb counts them in 32 bits


def save_glb(
    motion: Motion,
    path: str | PathLike,
    *,
    metres: float | int | None = None,
    overwrite: bool = True,
    up: UpOut = "y",
) -> None:
    """Write a motion to a .glb file, whole or not at all.

    **Arguments:** ``motion``: one clip; ``path``: the file; ``metres``: of a unit of the motion's
    lengths (0.01 for centimetres), which are multiplied by it; by default what the motion knows
    (``skeleton.conventions``), else a guess from the figure's height, with a warning;
    ``overwrite``: whether a file of that name may be replaced; ``up``: the axis to point up, to
    which the motion is turned with a warning (:func:`jaxmotion.reorient`), or "keep"; glTF is y up.
    **Raises:** ``ValueError`` for several clips, no frames, NaN, rotations that are no unit
    quaternions, what float32 cannot hold, a name that is no text, or another ``metres`` or ``up``;
    ``ImportError`` without pygltflib; ``FileExistsError`` and other ``OSError`` from writing.

    **Example:**

        >>> import os, tempfile, jaxmotion as jm
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     jm.save(jm.samples.load("walk").motion, f"{folder}/walk.glb", metres=1.0)
        ...     os.path.getsize(f"{folder}/walk.glb") > 50_000
        True
    """
    gltf = extra_of(".glb")
    check(motion)
    turned = turned_to(motion, up, "save_glb")
    metres = metres_of(motion, metres, path, "save_glb")
    figure = figure_of(turned, metres, "save_glb")
    whole = _bytes(gltf, figure, printable(Path(path).stem))
    _tell(path, motion.skeleton.up, turned.skeleton.up, figure)
    with atomic_write(path, overwrite=overwrite) as file:
        for part in whole:
            file.write(part)


def viewer_note(motion: Motion) -> str:
    """What a viewer does with the motion's frame rate, for people.

    Blender's rate is fps / base; its glTF importer (5.0.1) places keys by fps · base.
    """
    rate = rate_of(motion)
    fps = math.ceil(rate)
    before, after = f"{fps} frames a second", ""
    if rate < fps:
        before += f" with base {rate / fps:.6f}"
        after = f" and base {fps / rate:.6f} after it"
    return (
        "Blender keeps its scene's frame rate and range when it imports a .glb: set "
        f"{before}, and the last frame, before{after}"
    )


def _bytes(gltf: Any, figure: Figure, name: str) -> list[bytes | bytearray]:
    """The file, in parts."""
    frames, joints = figure.rotations.shape[:2]
    blocks = _blocks(figure)
    sizes = [block.nbytes for block in blocks]
    if sum(sizes) > _LARGEST:
        raise ValueError(f"save_glb: {frames} frames make a file over 4 GB; save parts of the clip")
    starts = np.cumsum([0, *sizes]).tolist()
    views = [
        gltf.BufferView(buffer=0, byteOffset=start, byteLength=size)
        for start, size in zip(starts, sizes, strict=False)
    ]
    times = blocks[1]
    accessors = [
        _accessor(gltf, 0, len(figure.names), "MAT4"),
        _accessor(gltf, 1, frames, "SCALAR", min=[float(times[0])], max=[float(times[-1])]),
    ]
    samplers, channels = [], []
    animated = [(joint, "rotation", 2, 16 * frames * joint) for joint in range(joints)]
    animated += [
        (joint, "translation", 3, 12 * frames * place) for place, joint in enumerate(figure.moving)
    ]
    for joint, target, view, start in animated:
        kind = "VEC4" if target == "rotation" else "VEC3"
        where = gltf.AnimationChannelTarget(node=joint, path=target)
        channels.append(gltf.AnimationChannel(sampler=len(samplers), target=where))
        samplers.append(
            gltf.AnimationSampler(input=1, output=len(accessors), interpolation="LINEAR")
        )
        accessors.append(_accessor(gltf, view, frames, kind, byteOffset=start))
    children: list[list[int]] = [[] for _ in figure.names]
    for node, parent in enumerate(figure.parents[1:], 1):
        children[parent].append(node)
    whole = gltf.GLTF2(
        asset=gltf.Asset(version="2.0", generator="jaxmotion"),
        scene=0,
        scenes=[gltf.Scene(nodes=[0])],
        nodes=[
            gltf.Node(name=title, translation=place, children=below)
            for title, place, below in zip(
                figure.names, figure.rest.tolist(), children, strict=True
            )
        ],
        skins=[
            gltf.Skin(
                name=name,
                joints=list(range(len(figure.names))),
                inverseBindMatrices=0,
                skeleton=0,
            )
        ],
        animations=[gltf.Animation(name=name, channels=channels, samplers=samplers)],
        accessors=accessors,
        bufferViews=views,
        buffers=[gltf.Buffer(byteLength=starts[-1])],
    )
    whole.set_binary_blob(b"".join(block.tobytes() for block in blocks))
    return whole.save_to_bytes()


def _blocks(figure: Figure) -> list[np.ndarray]:
    """Inverse bind matrices, times, rotations and translations, joint by joint, float32."""
    frames = len(figure.rotations)
    times = (np.arange(frames) / figure.rate).astype(np.float32)
    if not (np.diff(times) > 0).all() or not np.isfinite(times).all():
        raise ValueError(
            f"save_glb: {frames} frames at {figure.rate:g} a second are too many to be told apart "
            "by float32 seconds; save parts of the clip"
        )
    inverse = np.tile(np.eye(4, dtype=np.float32), (len(figure.names), 1, 1))
    inverse[:, 3, :3] = -figure.rest_positions  # by columns: the fourth one is the translation
    turns = figure.rotations[..., [1, 2, 3, 0]].transpose(1, 0, 2)
    places = figure.translations[:, list(figure.moving)].transpose(1, 0, 2)
    blocks = [inverse, times, turns, places] if figure.moving else [inverse, times, turns]
    return [np.ascontiguousarray(block, "<f4") for block in blocks]


def _accessor(gltf: Any, view: int, count: int, kind: str, **more: Any) -> Any:
    return gltf.Accessor(bufferView=view, componentType=_FLOAT, count=count, type=kind, **more)


def _tell(path: str | PathLike, own: str, up: str, figure: Figure) -> None:
    """Warn of what a reader will not find as it was."""
    if up != own:
        warn_of(path, f"turned from {own} up to {up} up{', as glTF is' if up == 'y' else ''}")
    if up != "y":
        warn_of(path, f"{up} points up, but readers of glTF take it that y does")
    long = [name for name in figure.names if len(name.encode()) > _LONGEST_NAME]
    if long:
        warn_of(
            path,
            f"names of more than {_LONGEST_NAME} bytes, which Blender cuts off: "
            f"{first_few(printable(name) for name in long)}",
        )
