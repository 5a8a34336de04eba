"""Captures through Blender: written by jaxmotion, imported and exported by Blender, and read again.

    python -m venv blender && blender/bin/pip install bpy==5.0.1      (Python 3.11)
    python benchmarks/blender_round_trip.py FOLDER --blender blender/bin/python [--frames 300]

``bpy`` wants NumPy 1 and JAX wants NumPy 2, so it has a Python of its own, is no extra of this
package and no part of its tests. A line a file, and at the end the largest error; exit status 1 if
a file misses. The error is the largest distance over all frames of a joint's world position from
where it was, by name, over the figure's height (the median over the frames); the limit is 1e-5.

What Blender does to numbers, and what is written for it (``--plain`` leaves out all three):

- It turns a file that is Y up to its own Z up, and with it the axes of all bones, in single
  precision: 1e-5 of the height, 1e-4 where it is asked for quaternions. So the file is written Z
  up, and imported as it stands (Y forward, Z up).
- It makes Euler angles of single precision matrices twice, in the bone's axes and in the file's.
  Where the middle angle is near 90°, its cosine c, that costs 1e-7/c rad. So a joint that comes
  near gets the Euler order that stays away furthest in both; a root that is upright in a world
  that is Z up always does if its middle angle is X.
- A position axis without a channel becomes 0, not OFFSET, and a joint with one or two rotation
  channels stops the import. So channels come by threes, every end site is an "End Site", and names
  are in UTF-8.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import warnings
from contextlib import suppress
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import jax
import numpy as np

import jaxmotion as jm
from jaxmotion.io.channels import parse_channels

LIMIT = 1e-5
FRAME_TIME_LIMIT = 5.1e-7  # Blender writes six decimals
AS_IT_STANDS = {"axis_forward": "Y", "axis_up": "Z"}
AS_BY_DEFAULT = {"axis_forward": "-Z", "axis_up": "Y"}
NEAR = 0.995  # the sine of the middle angle: within 6° of 90°


def for_blender(motion: jm.Motion) -> jm.Motion:
    """The motion with the channels that Blender reads right and keeps precise."""
    skeleton, turns = motion.skeleton, matrices(motion.rotations)
    channels = []
    for joint, names in enumerate(skeleton.channels):
        try:
            known = parse_channels(names)
        except ValueError:  # another format's
            known = parse_channels(())
        order = steady_order(turns[:, joint], bone_axes(skeleton, joint), known.order or "ZXY")
        placed = known.positions or joint in motion.translated_joints
        positions = [f"{axis}position" for axis in "XYZ"] if placed else []
        channels.append((*positions, *(f"{axis}rotation" for axis in order)))
    facts = {
        "channels": tuple(channels),
        "end_labels": ("End Site",) * len(skeleton.end_joints),
        "encoding": "utf-8",
    }
    return replace(motion, skeleton=replace(skeleton, **facts))


def steady_order(turns: np.ndarray, bone: np.ndarray, own: str) -> str:
    """``own``, or the Euler order furthest from its singularity over all frames, if that is near.

    Turns about i, then j, then k are singular where R[i, k] = ±1; Blender's importer makes angles
    in the reverse order of the same turns in the axes of the bone.
    """
    in_file = np.abs(turns).max(axis=0)
    in_bone = np.abs(bone.T @ turns @ bone).max(axis=0)
    sines = {}
    for order in ("".join(axes) for axes in permutations("XYZ")):
        i, k = "XYZ".index(order[0]), "XYZ".index(order[2])
        sines[order] = max(in_file[i, k], in_bone[k, i])
    return own if sines.get(own, 1.0) <= NEAR else min(sines, key=sines.__getitem__)


def bone_axes(skeleton: jm.Skeleton, joint: int) -> np.ndarray:
    """Blender's rest axes of the joint's bone, columns: y along the bone, by the shortest turn."""
    ends = [e for e, j in enumerate(skeleton.end_joints) if j == joint]
    children = list(skeleton.children[joint])
    tail = np.zeros(3)
    if ends:
        tail = np.asarray(skeleton.end_offsets, np.float64)[ends[-1]]
    elif children:
        tail = np.asarray(skeleton.offsets, np.float64)[children].mean(axis=0)
    length = np.linalg.norm(tail)
    x, y, z = tail / length if length > 1e-3 else (0.0, 1.0, 0.0)
    if y < 1e-9 - 1:
        return np.diag([-1.0, -1.0, 1.0])
    c = 1 / (1 + y)
    return np.array([[1 - c * x * x, x, -c * x * z], [-x, y, -z], [-c * x * z, z, 1 - c * z * z]])


def matrices(rotations) -> np.ndarray:
    """Rotation matrices f64[..., 3, 3] of quaternions [..., 4]."""
    w, x, y, z = np.moveaxis(np.asarray(rotations, np.float64), -1, 0)
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def world_positions(motion: jm.Motion) -> np.ndarray:
    """World positions f64[T, J, 3] from all translations as they are, in a world that is Z up.

    In NumPy: every file has another shape, and its own compile would take longer than this.
    """
    positions = np.array(motion.translations, np.float64)
    turns = matrices(motion.rotations)
    for joint, parent in enumerate(motion.skeleton.parents[1:], 1):
        step = (turns[:, parent] @ positions[:, joint, :, None])[..., 0]
        positions[:, joint] = positions[:, parent] + step
        turns[:, joint] = turns[:, parent] @ turns[:, joint]
    up = "xyz".index(motion.skeleton.up)
    if up != 2:
        height = positions[..., up].copy()
        positions[..., up], positions[..., 2] = -positions[..., 2], height
    return positions


def figure_height(motion: jm.Motion, positions: np.ndarray) -> float:
    """Median over the frames of the figure's side along z, or the longest if up is not known."""
    sides = np.median(np.ptp(positions, axis=1), axis=0)
    return float(sides[2] if motion.skeleton.conventions.up == "guessed" else sides.max())


class Blender:
    """A Python that has ``bpy``, and answers one job after another."""

    def __init__(self, python: str):
        half = Path(__file__).with_name("blender_in_and_out.py")
        self.process = subprocess.Popen(
            [python, str(half)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.communicate()

    def round_trip(self, source: Path, target: Path, frames: int, axes: dict[str, str]) -> str:
        """Import ``source``, export ``target``; "done", or what went wrong."""
        job = {"source": str(source), "target": str(target), "frames": frames, "axes": axes}
        assert self.process.stdout is not None
        with suppress(BrokenPipeError):
            print(json.dumps(job), file=self.process.stdin, flush=True)
        for line in self.process.stdout:
            if line.startswith("answer:"):
                return line.removeprefix("answer:").strip()
        raise SystemExit("Blender's Python ended; does it have bpy?")


def error_of(path: Path, blender: Blender, folder: Path, frames: int | None, plain: bool):
    """The error as a share of the height, and a line for people."""
    try:
        motion = jm.load(path, up="auto")[:frames]
    except jm.io.MotionFileError as error:
        return np.inf, str(error)
    sent, back = folder / "sent.bvh", folder / "back.bvh"
    written = motion if plain else for_blender(jm.reorient(motion, "z"))
    jm.save(written, sent, up="y" if plain else "z")
    axes = AS_BY_DEFAULT if plain else AS_IT_STANDS
    answer = blender.round_trip(sent, back, len(motion), axes)
    if answer != "done":
        return np.inf, answer
    returned = jm.load(back, up="z")
    theirs = ["_".join(name.split()) for name in motion.skeleton.names]
    missing = set(theirs) - set(returned.skeleton.names)
    if missing or len(returned) != len(motion):
        return np.inf, f"{len(returned)} of {len(motion)} frames, without {sorted(missing)[:8]}"
    late = abs(float(returned.frame_time) - float(motion.frame_time))
    if late > FRAME_TIME_LIMIT:
        return np.inf, f"frame time {float(returned.frame_time)}, not {float(motion.frame_time)}"
    before = world_positions(motion)
    after = world_positions(returned)[:, [returned.skeleton.index(name) for name in theirs]]
    height = figure_height(motion, before)
    if not height > 0:
        return np.inf, "a figure without height"
    errors = np.linalg.norm(after - before, axis=-1) / height
    frame, joint = np.unravel_index(errors.argmax(), errors.shape)
    return errors.max(), (
        f"{len(motion)} frames, {motion.num_joints} joints, height {height:.4g}; usual "
        f"{np.median(errors.max(axis=1)):.1e}, worst {motion.skeleton.names[joint]}, frame {frame}"
    )


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="searched for .bvh and .amc, with its folders")
    parser.add_argument("--blender", default=sys.executable, help="a Python that has bpy")
    parser.add_argument("--pattern", default="**/*", help="of the files below the folder")
    parser.add_argument("--limit", type=int, help="files at most")
    parser.add_argument("--frames", type=int, help="frames of a file at most; all by default")
    parser.add_argument("--plain", action="store_true", help="own channels, Blender's defaults")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore", jm.io.MotionFileWarning)
    paths = sorted(options.folder.glob(options.pattern))
    paths = [path for path in paths if path.suffix.lower() in (".bvh", ".amc")][: options.limit]
    if not paths:
        parser.error(f"no .bvh and no .amc file in {options.folder}")
    found = []
    with tempfile.TemporaryDirectory() as folder, Blender(options.blender) as blender:
        for path in paths:
            error, line = error_of(path, blender, Path(folder), options.frames, options.plain)
            name = path.relative_to(options.folder)
            found.append((error, name))
            print(f"{error:.2e} {'ok  ' if error <= LIMIT else 'MISS'} {name}: {line}", flush=True)
    worst = sorted(found, reverse=True)
    missed = sum(not error <= LIMIT for error, _ in found)
    print(f"{len(found)} files, {missed} miss {LIMIT:g} of the height; the largest errors:")
    for error, name in worst[:5]:
        print(f"    {error:.2e} {name}")
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
