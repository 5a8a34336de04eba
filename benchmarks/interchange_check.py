"""Motions written as .glb, .usda and .usdc, opened by Blender and three.js, and validated.

    python -m venv blender && blender/bin/pip install bpy==5.0.1      (Python 3.11)
    mkdir node && (cd node && npm install three gltf-validator)
    python benchmarks/interchange_check.py [FOLDER] --blender blender/bin/python --node node

Neither is an extra of this package or part of its tests; either may be left out. A row a clip and
format: the largest distance over frames of a joint or end site from forward kinematics in float64,
over the figure's height; the limit is 1e-5. Then what the validators say: the Khronos one of .glb,
usd-core's of USD. Exit status 1 if a file misses or a validator finds an error.

FOLDER is one of captures (CONTRIBUTING.md); without it there are made-up clips only.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import jax
import numpy as np

import jaxmotion as jm
from jaxmotion.io.interchange import figure_of, rate_of
from jaxmotion.io.usd import _identifiers

LIMIT = 1e-5
FRAMES = 200
HERE = Path(__file__).parent
CAPTURES = (
    ("bandai/kick_normal_001.bvh", 0.01),
    ("bandai/dance-short_normal_001.bvh", 0.01),
    ("cmu/01_01.bvh", 0.0254 / 0.45),
    ("cmu/02_01.amc", 0.0254 / 0.45),
    ("cmu_dance/005_05.bvh", 0.01),
    ("quirks/mocapnet_49_04.bvh", 0.01),
)


def clips(folder: Path | None) -> dict[str, tuple[jm.Motion, float]]:
    """Motions and metres a unit."""
    walk = jm.samples.load("walk", num_frames=FRAMES).motion
    found = {
        "walk": (walk, 1.0),
        "walk, z up": (jm.reorient(walk, "z"), 1.0),
        "one frame": (walk[:1], 1.0),
        "29.97 a second": (walk.replace(frame_time=1001 / 30000), 1.0),
        "names": (renamed(walk), 1.0),
        "every joint translated": (jiggled(walk), 1.0),
    }
    for name, metres in CAPTURES if folder else ():
        if (path := folder / name).is_file():
            found[name] = (jm.load(path)[:FRAMES], metres)
    return found


def renamed(motion: jm.Motion) -> jm.Motion:
    """Names that formats trip over."""
    names = list(motion.skeleton.names)
    names[:8] = ["mixamorig:Hips", "a b", "a.b", "a-b", "a_b", "1st", "骨", "x/y[0]"]
    skeleton = motion.skeleton
    return motion.replace(
        skeleton=jm.Skeleton(
            names,
            skeleton.parents,
            skeleton.offsets,
            end_joints=skeleton.end_joints,
            end_offsets=skeleton.end_offsets,
        )
    )


def jiggled(motion: jm.Motion) -> jm.Motion:
    """Every joint's translation moves, in six channels as it were."""
    waves = np.random.default_rng(0).uniform(0.5, 2.0, (motion.num_joints, 3))
    times = np.asarray(motion.times)[:, None, None]
    moved = np.asarray(motion.translations) + 0.03 * np.sin(2 * np.pi * waves * times)
    everywhere = tuple(range(motion.num_joints))
    return motion.replace(translations=moved, translated_joints=everywhere)


def world(motion: jm.Motion) -> np.ndarray:
    """Places of joints, then end sites, f64[T, N, 3]: products of matrices in NumPy."""
    w, x, y, z = np.moveaxis(np.asarray(motion.rotations, np.float64), -1, 0)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 3, 0, 1)
    place = np.array(motion.translations, np.float64)
    for joint, parent in enumerate(motion.skeleton.parents[1:], 1):
        place[:, joint] = place[:, parent] + np.einsum(
            "tab,tb->ta", turn[:, parent], place[:, joint]
        )
        turn[:, joint] = turn[:, parent] @ turn[:, joint]
    ends = list(motion.skeleton.end_joints)
    offsets = np.asarray(motion.skeleton.end_offsets, np.float64)
    tips = place[:, ends] + np.einsum("teab,eb->tea", turn[:, ends], offsets)
    return np.concatenate([place, tips], axis=1)


def in_blender(python: str, jobs: list[dict]) -> None:
    """Have Blender open every job's source; what it says itself is kept from sight."""
    command = [python, str(HERE / "interchange_in_blender.py")]
    lines = "".join(json.dumps(job) + "\n" for job in jobs)
    done = subprocess.run(command, input=lines, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr[-3000:])


def in_three(node: Path, jobs: list[dict], folder: Path) -> None:
    """Have three.js open every job's source."""
    listed = folder / "jobs.json"
    listed.write_text(json.dumps(jobs))
    script = HERE / "interchange_in_three.mjs"
    done = subprocess.run(
        ["node", str(script), str(listed)], cwd=node, capture_output=True, text=True
    )
    if done.returncode:
        sys.exit(done.stderr[-3000:])


def usd_findings(path: Path) -> list[str]:
    """What usd-core's validators find."""
    from pxr import Usd, UsdValidation

    known = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = UsdValidation.ValidationContext(known).Validate(Usd.Stage.Open(str(path)))
    return [f"{error.GetName()}: {error.GetMessage()}" for error in found]


def main() -> None:
    """The table, and the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--blender", help="a Python with bpy")
    parser.add_argument("--node", type=Path, help="a folder with three and gltf-validator")
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore", jm.io.MotionFileWarning)
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        jobs = written(clips(asked.folder), Path(folder))
        for reader, run in (("blender", asked.blender), ("three", asked.node)):
            if run is None:
                continue
            for job in jobs:
                job["target"] = job["source"] + f".{reader}.json"
            sent = [{k: v for k, v in job.items() if k not in ("world", "names")} for job in jobs]
            if reader == "blender":
                in_blender(run, sent)
            else:
                in_three(run, sent, Path(folder))
            for job in jobs:
                wrong += not reported(job, reader)
        for job in jobs:
            if not job["source"].endswith(".glb"):
                for text in usd_findings(Path(job["source"])):
                    wrong += 1
                    print(f"{job['clip']:32} {job['source'][-4:]} usd-core: {text}")
    sys.exit(bool(wrong))


def written(found: dict[str, tuple[jm.Motion, float]], folder: Path) -> list[dict]:
    """Every clip in every format, with what is expected of its readers."""
    jobs = []
    for number, (clip, (motion, metres)) in enumerate(found.items()):
        for suffix in ("glb", "usda", "usdc"):
            path = folder / f"clip{number}.{suffix}"
            jm.save(motion, path, metres=metres)
            there = jm.reorient(motion) if suffix == "glb" else motion
            names = figure_of(there, 1.0, "").names
            jobs.append(
                {
                    "clip": clip,
                    "source": str(path),
                    "frames": motion.num_frames,
                    "rate": rate_of(motion),
                    "turned": there.skeleton.up == "y",
                    "world": metres * world(there),
                    "names": list(names) if suffix == "glb" else _identifiers(names),
                }
            )
    return jobs


def reported(job: dict, reader: str) -> bool:
    """Print how far a reader is off, and whether that will do."""
    answer = json.loads(Path(job["target"]).read_text())
    got, want, names = np.array(answer["positions"]), job["world"], job["names"]
    if reader == "three" and not job["turned"]:  # it turns z up to y up, as it should
        want = want[..., [0, 2, 1]] * [1, 1, -1]
    height = np.median(np.ptp(want, axis=1).max(axis=-1))
    kept = sorted(answer["names"]) == sorted(names)
    by_name = [answer["names"].index(name) for name in names] if kept else range(len(names))
    error = np.inf
    if got.shape == want.shape:
        error = np.abs(got[:, by_name] - want).max() / height
    loud = [m for m in answer.get("messages", ()) if m[0] < 2]
    said = "; ".join(f"{code} {where}" for _, code, where in loud[:3])
    suffix = job["source"].rpartition(".")[2]
    print(
        f"{job['clip']:34} {suffix:5} {reader:8} {error:8.1e}"
        f"{'' if kept else '  other names'}  {said}"
    )
    return error <= LIMIT and not loud


if __name__ == "__main__":
    main()
