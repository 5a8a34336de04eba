"""BVH files that jaxmotion writes, in other programs: what docs/files.md says of them, asserted.

    python -m venv peers && peers/bin/pip install . upc-pymotion pybvh bvhsdk bvhio
    python -m venv blender && blender/bin/pip install bpy==5.0.1      (Python 3.11)
    mkdir node && (cd node && npm install three)
    peers/bin/python benchmarks/files_elsewhere.py [--blender blender/bin/python] [--node node]

Small files that it makes itself, each with one thing that programs disagree on. Every program that
is there reads each; what it makes of it is one line: the largest distance of a joint from forward
kinematics over the figure's height ("right" below 1e-4), names, frame time. Then each writes the
files that it has read, and jaxmotion reads those. Exit status 1 if something is not as EXPECTED or
WRITTEN say. What is not there is skipped, with a word; nothing of this is part of CI.
"""

import argparse
import contextlib
import importlib
import io
import json
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxmotion as jm

jax.config.update("jax_enable_x64", True)
warnings.simplefilter("ignore")

RIGHT = 1e-4
POSITIONS = ("Xposition", "Yposition", "Zposition")
NAMES = ("Hips", "Spine", "Head", "LeftArm", "LeftHand", "RightArm", "RightHand")
PARENTS = (-1, 0, 1, 1, 3, 1, 5)
OFFSETS = ((0, 0, 0), (0, 10, 1), (0, 25, 0), (8, 18, 0), (22, -1, 2), (-8, 18, 0), (-22, -1, 2))


@dataclass
class Read:
    """What a program made of a file; ``None`` for what it does not tell."""

    names: list[str]
    positions: np.ndarray
    frame_time: float | None


def turns(order: str) -> tuple[str, ...]:
    """Rotation channels of an order."""
    return tuple(f"{letter}rotation" for letter in order)


def clip(
    channels: dict[int, tuple[str, ...]] | None = None,
    names: tuple[str, ...] = NAMES,
    root: tuple[float, float, float] = (0, 0, 0),
    frame_time: float = 1 / 30,
    moved: tuple[int, ...] = (),
    tip: float = 6.0,
    ends: tuple[int, ...] = (2, 4, 6),
) -> jm.Motion:
    """Seven joints, twelve frames, every joint turning about all axes or those told."""
    rng = np.random.default_rng(0)
    offsets = np.array((root, *OFFSETS[1:]), float)
    every = [(POSITIONS if j == 0 else ()) + turns("ZXY") for j in range(7)]
    for joint, told in (channels or {}).items():
        every[joint] = told
    angles = rng.uniform(-50, 50, (12, 7, 3))
    for joint, told in enumerate(every):
        letters = [name[0] for name in told if name.endswith("rotation")]
        angles[:, joint, len(letters) :] = 0
    orders = [_full([n[0] for n in told if n.endswith("rotation")]) for told in every]
    rotations = np.stack(
        [
            np.asarray(jm.quaternion.from_euler(jnp.asarray(angles[:, j]), order, degrees=True))
            for j, order in enumerate(orders)
        ],
        1,
    )
    translations = np.tile(offsets, (12, 1, 1))
    translations[:, 0] += rng.normal((3, 90, -5), size=(12, 3))
    for joint in moved:
        translations[:, joint] += rng.normal(size=(12, 3))
    skeleton = jm.Skeleton(
        names,
        PARENTS,
        offsets,
        channels=every,
        end_joints=ends,
        end_offsets=((0, tip, 0),) * len(ends),
    )
    return jm.Motion(
        skeleton,
        translations,
        rotations,
        frame_time,
        translated_joints=(0, *moved),
    )


def _full(letters: list[str]) -> str:
    return "".join([*letters, *(a for a in "XYZ" if a not in letters)])


# Options of jm.save.
SAVED: dict[str, Any] = {"the same, still_positions=False": {"still_positions": False}}
SIX = {j: POSITIONS + turns("ZXY") for j in range(7)}
CASES: dict[str, Callable[[], jm.Motion]] = {
    "usual": clip,
    "orders ZXY XYZ ZYX YXZ": lambda: clip(
        {1: turns("XYZ"), 2: turns("ZYX"), 3: turns("YXZ"), 4: turns("XYZ")}
    ),
    "orders XZY YZX": lambda: clip({1: turns("XZY"), 3: turns("YZX")}),
    "positions that are OFFSET": lambda: clip(SIX),
    "the same, still_positions=False": lambda: clip(SIX),
    "positions that move": lambda: clip(SIX, moved=(1, 3, 4)),
    "positions on one joint": lambda: clip({3: SIX[3]}, moved=(3,)),
    "position of one axis": lambda: clip({3: ("Yposition", *turns("ZXY"))}, moved=()),
    "a root with OFFSET": lambda: clip(root=(1, 80, 2)),
    "rotations first": lambda: clip({0: turns("ZXY") + POSITIONS}),
    "positions in order ZXY": lambda: clip(
        {0: ("Zposition", "Xposition", "Yposition", *turns("ZXY"))}
    ),
    "one rotation channel": lambda: clip({4: ("Xrotation",)}),
    "no channels": lambda: clip({4: ()}),
    "names with blanks": lambda: clip(names=("Hips", "Low Back", *NAMES[2:])),
    "names with colons": lambda: clip(names=tuple(f"mixamorig:{n}" for n in NAMES)),
    "positions, orders ZXY XYZ YXZ": lambda: clip(
        SIX | {1: POSITIONS + turns("XYZ"), 3: POSITIONS + turns("YXZ")}, moved=(1, 3)
    ),
    "leaves without end sites": lambda: clip(ends=(2,)),
    "end sites of length 0": lambda: clip(tip=0.0),
    "0.0083333 s": lambda: clip(frame_time=0.0083333),
    "0.0417083750417 s": lambda: clip(frame_time=0.0417083750417),
    "0.016683350016683 s": lambda: clip(frame_time=0.016683350016683),
}


def by_pymotion(path: Path, target: Path) -> Read:
    """upc-pymotion: its own fk, from quaternions; written as it was read."""
    from pymotion.io.bvh import BVH
    from pymotion.ops.skeleton import fk

    bvh = BVH()
    bvh.load(str(path))
    rotations, positions, parents, offsets, _, _ = bvh.get_data()
    bvh.save(str(target))
    places, _ = fk(rotations, positions[:, 0], offsets, parents)
    return Read(list(map(str, bvh.data["names"])), places, bvh.data["frame_time"])


def by_pybvh(path: Path, target: Path) -> Read:
    """pybvh: joint_positions."""
    import pybvh

    bvh = pybvh.read_bvh_file(path)
    bvh.write(target)
    return Read(list(bvh.joint_names), bvh.joint_positions(), bvh.frame_time)


def by_bvhsdk(path: Path, target: Path) -> Read:
    """bvhsdk: getPosition of every joint and frame."""
    from bvhsdk import bvh

    found = bvh.ReadFile(str(path))
    bvh.WriteBVH(found, str(target.parent), target.stem, refTPose=False)
    joints = list(found.getlistofjoints())
    places = [[joint.getPosition(frame) for joint in joints] for frame in range(found.frames)]
    return Read([joint.name for joint in joints], np.array(places), found.frametime)


def by_bvhio(path: Path, target: Path) -> Read:
    """bvhio: loadPose and the world's positions."""
    import bvhio

    time = bvhio.readAsBvh(str(path)).FrameTime
    root = bvhio.readAsHierarchy(str(path))
    bvhio.writeHierarchy(str(target), root, time, frames=12)
    joints = [joint for joint, _, _ in root.layout()]
    places = []
    for frame in range(12):
        root.loadPose(frame)
        places.append([list(joint.PositionWorld) for joint in joints])
    return Read([joint.Name for joint in joints], np.array(places), time)


IN_BLENDER = """
import json, sys, bpy
for line in sys.stdin:
    path = json.loads(line)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    try:
        bpy.ops.import_anim.bvh(filepath=path, axis_forward="Y", axis_up="Z", update_scene_fps=True)
        [figure] = [thing for thing in bpy.data.objects if thing.type == "ARMATURE"]
        places = []
        for frame in range(1, 13):
            bpy.context.scene.frame_set(frame)
            places.append([list(figure.matrix_world @ b.head) for b in figure.pose.bones])
        render = bpy.context.scene.render
        answer = [[b.name for b in figure.pose.bones], places, render.fps_base / render.fps]
        answer.append(bpy.app.version_string)
        bpy.ops.export_anim.bvh(filepath=path[:-4] + ".Blender.bvh", frame_start=1, frame_end=12)
    except Exception as error:
        answer = str(error).strip().splitlines()[-2:][0]
    print("\\nanswer:" + json.dumps(answer), flush=True)
"""

IN_THREE = """
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";
const at = (place) => import(pathToFileURL(`${process.cwd()}/node_modules/three/${place}`).href);
const THREE = await at("build/three.module.js");
const { BVHLoader } = await at("examples/jsm/loaders/BVHLoader.js");
for (const path of JSON.parse(process.argv[1])) {
  let answer;
  try {
    const { skeleton, clip } = new BVHLoader().parse(readFileSync(path, "utf8"));
    const root = skeleton.bones[0];
    const mixer = new THREE.AnimationMixer(root);
    const action = mixer.clipAction(clip);
    action.setLoop(THREE.LoopOnce);
    action.clampWhenFinished = true;
    action.play();
    const bones = skeleton.bones.filter((bone) => bone.name !== "ENDSITE");
    const times = Array.from(clip.tracks[0].times);
    const places = times.map((time) => {
      action.reset();
      mixer.setTime(time);
      root.updateMatrixWorld(true);
      return bones.map((bone) => bone.getWorldPosition(new THREE.Vector3()).toArray());
    });
    answer = [bones.map((bone) => bone.name), places, times[1] - times[0]];
  } catch (error) { answer = String(error); }
  console.log("answer:" + JSON.stringify(answer));
}
"""


def answers(command: list[str], given: str, folder: Path | None = None) -> list:
    """Lines of JSON that another program answers."""
    done = subprocess.run(command, input=given, capture_output=True, text=True, cwd=folder)
    if done.returncode:
        sys.exit(done.stderr[-2000:])
    lines = [line for line in done.stdout.splitlines() if line.startswith("answer:")]
    return [json.loads(line.removeprefix("answer:")) for line in lines]


def outcome(read: Read, motion: jm.Motion) -> tuple[str, str]:
    """In a word, and in figures."""
    want = np.asarray(jm.forward_kinematics(motion).positions)
    height = np.ptp(want[..., 1], axis=1).max()
    if read.positions.shape != want.shape:
        return "wrong", f"shape {read.positions.shape}"
    off = float(np.abs(read.positions - want).max() / height)
    words = ["right" if off < RIGHT else "wrong"]
    if read.names != list(motion.skeleton.names):
        words.append("names")
    if read.frame_time is not None and abs(read.frame_time / float(motion.frame_time) - 1) > 1e-7:
        words.append("rate")
    told = f"{off:.1e}, {read.names[1]!r}, {read.frame_time!r}"
    return " ".join(words), told


def main() -> None:
    """Both tables, and the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blender", help="a Python with bpy")
    parser.add_argument("--node", type=Path, help="a folder with three")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        sys.exit(bool(run(Path(folder), asked.blender, asked.node)))


def run(folder: Path, blender: str | None, node: Path | None) -> int:
    """How many things are not as said."""
    paths, motions = [], {}
    for number, (case, made) in enumerate(CASES.items()):
        path = folder / f"case{number}.bvh"
        jm.save(made(), path, **SAVED.get(case, {}))
        motions[case] = jm.load(path)
        np.testing.assert_allclose(motions[case].translations, made().translations)
        assert jm.quaternion.distance(motions[case].rotations, made().rotations).max() < 1e-9
        paths.append(path)
    wrong = 0
    for package, module, reader in (
        ("upc-pymotion", "pymotion", by_pymotion),
        ("pybvh", "pybvh", by_pybvh),
        ("bvhsdk", "bvhsdk", by_bvhsdk),
        ("bvhio", "bvhio", by_bvhio),
    ):
        try:
            importlib.import_module(module)
        except ImportError as error:
            print(f"{package}: skipped, {error}")
            continue
        print(f"{package} {version(package)}")
        found = []
        for path in paths:
            with contextlib.redirect_stdout(io.StringIO()):
                try:
                    found.append(reader(path, path.with_suffix(f".{package}.bvh")))
                except Exception as error:
                    found.append(f"{type(error).__name__}: {error}")
        wrong += told(package, found, motions)
        wrong += written(package, paths, motions)
    if blender:
        found = answers(
            [blender, "-c", IN_BLENDER], "".join(f"{json.dumps(str(p))}\n" for p in paths)
        )
        print("Blender", found[0][3])
        wrong += told("Blender", [_read(a) for a in found], motions)
        wrong += written("Blender", paths, motions)
    else:
        print("Blender: skipped, no --blender")
    if node:
        listed = json.dumps([str(path.resolve()) for path in paths])
        command = ["node", "--input-type=module", "-e", IN_THREE, listed]
        print(
            "three", json.loads((node / "node_modules/three/package.json").read_text())["version"]
        )
        wrong += told("three", [_read(a) for a in answers(command, "", node)], motions)
    else:
        print("three: skipped, no --node")
    return wrong


def _read(answer) -> Read | str:
    if isinstance(answer, str):
        return answer
    return Read(answer[0], np.array(answer[1]), answer[2])


def told(program: str, found: list, motions: dict[str, jm.Motion]) -> int:
    """Print what a program made of every case; how many are not as expected."""
    wrong = 0
    for (case, motion), read in zip(motions.items(), found, strict=True):
        word, figures = ("refused", read) if isinstance(read, str) else outcome(read, motion)
        due = EXPECTED.get(program, {}).get(case, "right")
        wrong += word != due
        print(f"  {'   ' if word == due else 'NO '}{case:31} {word:18} {figures[:90]}")
    return wrong


def written(program: str, paths: list[Path], motions: dict[str, jm.Motion]) -> int:
    """Print what jaxmotion reads of what a program wrote; how many are not as expected."""
    wrong = 0
    for (case, motion), path in zip(motions.items(), paths, strict=True):
        source = path.with_suffix(f".{program}.bvh")
        if not source.exists() or case not in WRITTEN_CASES:
            continue
        text = source.read_text()
        try:
            back = jm.load(source, up="y")
        except jm.io.MotionFileError as error:
            word, figures = "refused", str(error)[-80:]
        else:
            word, figures = changed(back, motion, text)
        due = WRITTEN.get(program, {}).get(case, "right")
        wrong += word != due
        print(f"  {'   ' if word == due else 'NO '}{case:31} written: {word:28} {figures}")
    return wrong


def changed(back: jm.Motion, motion: jm.Motion, text: str) -> tuple[str, str]:
    """What is not as it was, in words and in figures."""
    want = np.asarray(jm.forward_kinematics(motion).positions)
    got = np.asarray(jm.forward_kinematics(back).positions)
    height = np.ptp(want[..., 1], axis=1).max()
    off = np.inf
    if got.shape == want.shape:
        off = float(np.abs(got - want).max() / height)
    words = ["right" if off < RIGHT else "wrong"]
    orders, positions = (
        [
            [tuple(n for n in names if n.endswith(kind)) for names in m.skeleton.channels]
            for m in (back, motion)
        ]
        for kind in ("rotation", "position")
    )
    if orders[0] != orders[1]:
        words.append("orders")
    if positions[0] != positions[1]:
        words.append("positions")
    if abs(float(back.frame_time) / float(motion.frame_time) - 1) > 1e-7:
        words.append("rate")
    if back.skeleton.end_joints != motion.skeleton.end_joints:
        words.append("ends")
    row = text.strip().splitlines()[-1].split()
    digits = max(len(number.partition(".")[2]) for number in row)
    order = "".join(name[0] for name in orders[0][1])
    [time] = [line for line in text.splitlines() if "Frame Time" in line]
    ends = [back.skeleton.names[j] for j in back.skeleton.end_joints]
    return " ".join(
        words
    ), f"{off:.1e}, ends {len(ends)}, {digits} decimals, {order}, {time.strip()}"


WRITTEN_CASES = (
    "usual",
    "orders ZXY XYZ ZYX YXZ",
    "positions that move",
    "positions, orders ZXY XYZ YXZ",
    "rotations first",
    "leaves without end sites",
    "names with blanks",
    "0.0417083750417 s",
    "0.0083333 s",
)
# Where it is not "right": figure, names, frame time.
EXPECTED: dict[str, dict[str, str]] = {
    "upc-pymotion": {
        "positions that move": "wrong",
        "positions on one joint": "wrong",
        "rotations first": "refused",
        "position of one axis": "refused",
        "one rotation channel": "refused",
        "no channels": "refused",
        "names with blanks": "right names",
        "positions, orders ZXY XYZ YXZ": "wrong",
    },
    "pybvh": {
        "positions that are OFFSET": "refused",
        "positions that move": "refused",
        "positions on one joint": "refused",
        "position of one axis": "refused",
        "positions in order ZXY": "refused",
        "positions, orders ZXY XYZ YXZ": "refused",
        "one rotation channel": "refused",
        "no channels": "refused",
        "names with blanks": "right names",
        "0.0083333 s": "right rate",
    },
    "bvhsdk": {
        "orders XZY YZX": "refused",
        "position of one axis": "refused",
        "one rotation channel": "refused",
        "no channels": "refused",
    },
    "bvhio": {
        "names with blanks": "right names",
    },
    "Blender": {
        "position of one axis": "wrong",
        "one rotation channel": "refused",
        "names with blanks": "right names",
    },
    "three": {
        "positions that are OFFSET": "wrong",
        "positions that move": "wrong",
        "positions on one joint": "wrong",
        "position of one axis": "wrong",
        "a root with OFFSET": "wrong",
        "names with blanks": "right names",
        "names with colons": "wrong",
        "positions, orders ZXY XYZ YXZ": "wrong",
    },
}
# What is not as it was when jaxmotion reads what they wrote.
WRITTEN: dict[str, dict[str, str]] = {
    "upc-pymotion": {
        "usual": "right rate",
        "orders ZXY XYZ ZYX YXZ": "right rate",
        "positions that move": "right rate",
        "names with blanks": "right rate",
        "positions, orders ZXY XYZ YXZ": "wrong orders rate",
        "leaves without end sites": "right rate ends",
        "0.0083333 s": "right rate",
        "0.0417083750417 s": "right rate",
    },
    "pybvh": {
        "0.0083333 s": "right rate",
    },
    "bvhsdk": {
        "usual": "right positions rate",
        "orders ZXY XYZ ZYX YXZ": "right positions rate",
        "positions that move": "right rate",
        "rotations first": "right positions rate",
        "names with blanks": "right positions rate",
        "positions, orders ZXY XYZ YXZ": "right rate",
        "leaves without end sites": "refused",
        "0.0083333 s": "right positions rate",
        "0.0417083750417 s": "right positions rate",
    },
    "bvhio": {
        "orders ZXY XYZ ZYX YXZ": "right orders",
        "positions that move": "right positions",
        "positions, orders ZXY XYZ YXZ": "right orders positions",
        "leaves without end sites": "right ends",
    },
    "Blender": {
        "usual": "right positions rate",
        "orders ZXY XYZ ZYX YXZ": "right positions rate",
        "positions that move": "right rate",
        "rotations first": "right positions rate",
        "names with blanks": "right positions rate",
        "positions, orders ZXY XYZ YXZ": "right rate",
        "leaves without end sites": "right positions rate ends",
        "0.0083333 s": "right positions rate",
        "0.0417083750417 s": "right positions rate",
    },
}

if __name__ == "__main__":
    main()
