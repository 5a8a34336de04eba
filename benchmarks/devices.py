"""Every room on the device that JAX finds, in both precisions, one clip and 64: beside the CPU.

    python benchmarks/devices.py [--frames 240] [--rounds 5] [--batches 1,64] [--only denoise,dtw]

Writes benchmarks/results/devices-DATE-DEVICE.json, a row a function, precision and batch: seconds
to compile, milliseconds a run (median of the rounds, warm), clips a second, and the same of the
CPU where the device is another; with the device, versions and date. Where there is no accelerator
it runs on the CPU and says so.
"""

import argparse
import datetime
import json
import platform
import statistics
import sys
import time
from importlib.metadata import version
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxmotion as jm

RESULTS = Path(__file__).parent / "results"
PACKAGES = ("jax", "jaxlib", "equinox", "numpy", "jaxmotion")


def moved(clip):
    """Derivative of a loss through kinematics."""

    def loss(q):
        return jnp.sum(jm.forward_kinematics(clip.with_transforms(rotations=q)).positions ** 2)

    return jax.grad(loss)(clip.rotations)


def smoothed(clip, parallel):
    """Rotations by their components."""
    return jm.smoothing.lgs(clip.rotations, 4.0, 1.0, parallel=parallel).mean


FUNCTIONS = {
    "forward_kinematics": lambda clip: jm.forward_kinematics(clip).positions,
    "kinematics' gradient": moved,
    "lgs frame by frame": lambda clip: smoothed(clip, parallel=False),
    "lgs in parallel": lambda clip: smoothed(clip, parallel=True),
    "denoise with λσ given": lambda clip: jm.denoise(clip, tune=False).rotations,
    "denoise": lambda clip: jm.denoise(clip).rotations,
    "decompose": lambda clip: jm.decompose(clip).base.rotations,
    "build_pyramid": jm.multiresolution.build_pyramid,
    "dtw": lambda clip: jm.timing.dtw(clip.rotations[:, 1], clip.rotations[::-1, 1]).cost,
    "pose_distance": lambda clip: jm.timing.pose_distance(clip.rotations, clip.rotations),
}


def batch_of(clips, frames, dtype):
    walk = jm.samples.load("walk", num_frames=frames, dtype=dtype).motion
    noisy = [
        jm.samples.add_noise(walk, jax.random.key(k), rotation=0.02).motion for k in range(clips)
    ]
    return jm.stack(noisy)[0]


def timed(function, batch, device, rounds):
    """Seconds to compile, and the median of a warm run."""
    there = jax.device_put(batch, device)
    program = jax.jit(jax.vmap(function))
    begun = time.perf_counter()
    compiled = program.lower(there).compile()
    compiling = time.perf_counter() - begun
    jax.block_until_ready(compiled(there))
    spent = []
    for _ in range(rounds):
        begun = time.perf_counter()
        jax.block_until_ready(compiled(there))
        spent.append(time.perf_counter() - begun)
    return compiling, statistics.median(spent)


def rows(args, device, cpu):
    for name, function in FUNCTIONS.items():
        if args.only and name not in args.only:
            continue
        for dtype in (np.float32, np.float64):
            for clips in args.batches:
                batch = batch_of(clips, args.frames, dtype)
                row = {"function": name, "dtype": np.dtype(dtype).name, "clips": clips}
                compiling, spent = timed(function, batch, device, args.rounds)
                row |= {"compile_s": compiling, "ms": 1e3 * spent, "clips_a_second": clips / spent}
                if device.platform != "cpu":
                    _, there = timed(function, batch, cpu, args.rounds)
                    row |= {"cpu_ms": 1e3 * there, "times_as_fast": there / spent}
                print(json.dumps(row), flush=True)
                yield row


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--batches", type=lambda x: [int(n) for n in x.split(",")], default=[1, 64])
    parser.add_argument("--only", type=lambda x: x.split(","), default=[])
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    device, cpu = jax.devices()[0], jax.devices("cpu")[0]
    if device.platform == "cpu":
        print("no accelerator: this is the CPU", file=sys.stderr)
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    record = {
        "date": today,
        "device": device.device_kind,
        "platform": device.platform,
        "host": f"{platform.machine()}, Python {platform.python_version()}",
        "versions": {name: version(name) for name in PACKAGES},
        "frames": args.frames,
        "joints": 22,
        "rows": list(rows(args, device, cpu)),
    }
    args.out.mkdir(exist_ok=True, parents=True)
    name = device.device_kind.lower().replace(" ", "-").replace("/", "-")
    path = args.out / f"devices-{today}-{name}.json"
    path.write_text(json.dumps(record, indent=1) + "\n")
    print(path)


if __name__ == "__main__":
    main()
