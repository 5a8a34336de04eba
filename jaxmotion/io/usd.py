"""USD (.usda text, .usdc binary), written only: a UsdSkel skeleton and its animation.

    SkelRoot ─┬─ Skeleton   joints, jointNames, bindTransforms, restTransforms → Animation
              ├─ Animation  translations, rotations (samples at codes 0 … T − 1), scales
              └─ Guide      a triangle that nothing renders: without a mesh three.js shows no bones

A joint is a path of identifiers, the last of which is its own: what an identifier cannot hold is
written as ``_``, and repeats are numbered, with a warning; ``jointNames`` keeps the names as they
are. An end site is a joint ``<joint>_end`` that never moves.

Lengths stay as they are, ``metersPerUnit`` says the unit; ``upAxis`` says Y or Z, as the data are.
``timeCodesPerSecond`` is the frame rate, and frame t is at code t. Numbers are float32, as UsdSkel
stores them: places are good to some 1e-7 of their distance from the origin, a rotation to 1e-7.
What UsdSkel has no place for stays behind: Euler orders, an ASF's axes and limits, labels of end
sites.

Blender puts code t on its own frame t and keeps its scene's rate: set it. Needs ``usd-core``: ``pip
install 'jaxmotion[usd]'``.

Source: Pixar, Universal Scene Description, UsdSkel schemas.
"""

import importlib
import shutil
import tempfile
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
    unique,
    warn_of,
)
from jaxmotion.motion import Motion

__all__ = ["save_usd"]

_BLENDERS_RATE = 24.0


def save_usd(
    motion: Motion,
    path: str | PathLike,
    *,
    metres: float | int | None = None,
    overwrite: bool = True,
    up: UpOut = "keep",
) -> None:
    """Write a motion to a .usda (text) or .usdc (binary) file, whole or not at all.

    **Arguments:** ``motion``: one clip; ``path``: the file; ``metres``: of a unit of the motion's
    lengths (0.01 for centimetres), which the file says; by default what the motion knows
    (``skeleton.conventions``), else a guess from the figure's height, with a warning;
    ``overwrite``: whether a file of that name may be replaced; ``up``: the axis to point up, to
    which the motion is turned (:func:`jaxmotion.reorient`), or "keep"; USD knows y and z, and from
    x a motion is turned to y, with a warning.
    **Raises:** ``ValueError`` for several clips, no frames, NaN, rotations that are no unit
    quaternions, what float32 cannot hold, a name that is no text, another suffix, ``metres`` or
    ``up``; ``ImportError`` without usd-core; ``FileExistsError`` and other ``OSError`` from
    writing.

    **Example:**

        >>> import tempfile, jaxmotion as jm
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     jm.save(jm.samples.load("walk").motion, f"{folder}/walk.usda", metres=1.0)
        ...     print(open(f"{folder}/walk.usda").readline().strip())
        #usda 1.0
    """
    _pxr()
    suffix = Path(path).suffix.lower()
    if suffix not in (".usda", ".usdc"):
        raise ValueError(f"save_usd: the suffix {suffix!r}; expected '.usda' or '.usdc'")
    check(motion)
    turned = turned_to(motion, up, "save_usd")
    if turned.skeleton.up == "x":
        turned = turned_to(turned, "y", "save_usd")
        warn_of(path, "turned from x up to y up, as USD knows only y and z")
    metres = metres_of(motion, metres, path, "save_usd")
    figure = figure_of(turned, 1.0, "save_usd")
    identifiers = _identifiers(figure.names)
    changed = [
        f"{printable(name)} as {written}"
        for name, written in zip(motion.skeleton.names, identifiers, strict=False)
        if name != written
    ]
    if changed:
        warn_of(path, f"names in other letters, but for jointNames: {first_few(changed)}")
    stage = _stage(figure, identifiers, metres, turned.skeleton.up, printable(Path(path).stem))
    layer = stage.GetRootLayer()  # which goes when its stage does
    with atomic_write(path, overwrite=overwrite) as file:
        if suffix == ".usda":
            file.write(layer.ExportToString().encode())
        else:
            _copy_binary(layer, file)


def viewer_note(motion: Motion) -> str:
    """What a viewer does with the motion's frame rate, for people; "" if it is right."""
    rate = rate_of(motion)
    if rate == _BLENDERS_RATE:
        return ""
    return (
        "Blender keeps its scene's frame rate when it imports USD, and puts frame t on its own "
        f"frame t: set {rate:.6g} frames a second, or the clip plays at another speed"
    )


def _pxr() -> Any:
    """usd-core's package, with the modules that are used here."""
    pxr = extra_of(".usda")
    for module in ("Gf", "Sdf", "Usd", "UsdGeom", "UsdSkel", "Vt"):
        importlib.import_module(f"pxr.{module}")
    return pxr


def _identifiers(names: tuple[str, ...]) -> list[str]:
    """What the joints' paths say for the names: identifiers, no two alike."""
    pxr = _pxr()
    taken: set[str] = {name for name in names if pxr.Sdf.Path.IsValidIdentifier(name)}
    found = []
    for name in names:
        if name in taken and pxr.Sdf.Path.IsValidIdentifier(name):
            found.append(name)
            continue
        found.append(unique(_identifier(name), taken))
    return found


def _identifier(name: str) -> str:
    pxr = _pxr()
    letters = (c if pxr.Sdf.Path.IsValidIdentifier(f"_{c}") else "_" for c in name)
    spelt = "".join(letters) or "_"
    return spelt if pxr.Sdf.Path.IsValidIdentifier(spelt) else f"_{spelt}"


def _stage(figure: Figure, identifiers: list[str], metres: float, up: str, name: str) -> Any:
    """The whole file, in memory."""
    pxr = _pxr()
    frames = len(figure.rotations)
    stage = pxr.Usd.Stage.CreateInMemory()
    stage.SetTimeCodesPerSecond(figure.rate)
    stage.SetFramesPerSecond(figure.rate)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(frames - 1)
    pxr.UsdGeom.SetStageUpAxis(stage, up.upper())
    pxr.UsdGeom.SetStageMetersPerUnit(stage, metres)
    root = pxr.UsdSkel.Root.Define(stage, pxr.Sdf.Path(f"/{_identifier(name)}"))
    stage.SetDefaultPrim(root.GetPrim())
    paths = _joint_paths(identifiers, figure.parents)
    below = root.GetPath().AppendChild
    skeleton = pxr.UsdSkel.Skeleton.Define(stage, below("Skeleton"))
    skeleton.CreateJointsAttr(pxr.Vt.TokenArray(paths))
    skeleton.CreateJointNamesAttr(pxr.Vt.TokenArray(list(figure.names)))
    skeleton.CreateBindTransformsAttr(_moves(figure.rest_positions))
    skeleton.CreateRestTransformsAttr(_moves(figure.rest))
    animation = pxr.UsdSkel.Animation.Define(stage, below("Animation"))
    animation.CreateJointsAttr(pxr.Vt.TokenArray(paths))
    animation.CreateScalesAttr(pxr.Vt.Vec3hArray(len(paths), pxr.Gf.Vec3h(1)))
    _sample(stage.GetRootLayer(), animation, figure)
    binding = pxr.UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    _guide(pxr.UsdGeom.Mesh.Define(stage, below("Guide")), skeleton)
    return stage


def _joint_paths(identifiers: list[str], parents: tuple[int, ...]) -> list[str]:
    paths: list[str] = []
    for own, parent in zip(identifiers, parents, strict=True):
        paths.append(f"{paths[parent]}/{own}" if parent >= 0 else own)
    return paths


def _moves(places: np.ndarray) -> Any:
    """Matrices that take the origin to the places, as USD has them: the last row is the place."""
    pxr = _pxr()
    matrices = np.tile(np.eye(4), (len(places), 1, 1))
    matrices[:, 3, :3] = places
    return pxr.Vt.Matrix4dArray.FromNumpy(matrices)


def _sample(layer: Any, animation: Any, figure: Figure) -> None:
    """Translations and rotations of all nodes at every frame."""
    pxr = _pxr()
    frames, joints = figure.rotations.shape[:2]
    places = np.tile(figure.rest.astype(np.float32), (frames, 1, 1))
    places[:, :joints] = figure.translations
    turns = np.zeros((frames, len(figure.names), 4), np.float32)
    turns[..., 3] = 1
    turns[:, :joints] = figure.rotations[..., [1, 2, 3, 0]]  # w is last in memory
    there = animation.CreateTranslationsAttr().GetPath()
    turned = animation.CreateRotationsAttr().GetPath()
    with pxr.Sdf.ChangeBlock():
        for frame in range(frames):
            layer.SetTimeSample(there, float(frame), pxr.Vt.Vec3fArray.FromNumpy(places[frame]))
            layer.SetTimeSample(turned, float(frame), pxr.Vt.QuatfArray.FromNumpy(turns[frame]))


def _guide(mesh: Any, skeleton: Any) -> None:
    """A triangle of no area, bound to the root."""
    pxr = _pxr()
    points = pxr.Vt.Vec3fArray(3, pxr.Gf.Vec3f(0))
    mesh.CreatePointsAttr(points)
    mesh.CreateExtentAttr(pxr.UsdGeom.PointBased.ComputeExtent(points))
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    mesh.CreateSubdivisionSchemeAttr(pxr.UsdGeom.Tokens.none)
    mesh.CreatePurposeAttr(pxr.UsdGeom.Tokens.guide)
    binding = pxr.UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateGeomBindTransformAttr(pxr.Gf.Matrix4d(1))
    binding.CreateJointIndicesPrimvar(False, 1).Set([0, 0, 0])
    binding.CreateJointWeightsPrimvar(False, 1).Set([1.0, 1.0, 1.0])


def _copy_binary(layer: Any, file: Any) -> None:
    """usd-core writes binary files by name only: to a folder of its own, and from there."""
    with tempfile.TemporaryDirectory(prefix="jaxmotion-") as folder:
        there = Path(folder) / "motion.usdc"
        if not layer.Export(str(there)):
            raise OSError(f"usd-core could not write {there}")
        with open(there, "rb") as whole:
            shutil.copyfileobj(whole, file)
