#!/usr/bin/env bash
# upc-pymotion 0.3.4: BVH.resample changes the speed of the motion.
#
# BVH.resample(target_fps=...) is documented to resample the animation to another frame rate. Three
# things make the result faster or slower than what it was given, and nothing says so:
# - Between most rates it takes round(frames * ratio) poses from the first frame to the last, both
#   included, and gives them the new frame time. The time between them is another one: 1 s from 120
#   to 30 a second comes out 3.4 % fast, from 30 to 120 2.4 % slow. The shorter the clip the worse.
# - If the target is half of the rate, rounded down, it takes every second frame. 25 to 12 a second
#   is 4 % slow, of any length.
# - If both rates round to the same whole number it sets the frame time only: 29.97 to 30 is 0.1 % fast.
# Halving an even rate is right.
#
# Speeds and frequencies are off by it, and so is what is lined up with sound or another recorder.
# A root that moves along x at 1 a second: x should be the time of the frame. Seen: the speeds below.
# No issue of it was found. Fails if that changes.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet upc-pymotion==0.3.4 numpy==2.3.5
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from pymotion.io.bvh import BVH

HEAD = """HIERARCHY
ROOT Hips
{
	OFFSET 0 0 0
	CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
	End Site
	{
		OFFSET 0 1 0
	}
}
MOTION
"""


def resampled(source, target, seconds):
    frames = round(seconds * source) + 1
    with open("take.bvh", "w") as file:
        file.write(f"{HEAD}Frames: {frames}\nFrame Time: {1 / source!r}\n")
        for k in range(frames):
            file.write(f"{k / source!r} 0 0 0 0 0\n")
    bvh = BVH()
    bvh.load("take.bvh")
    bvh.resample(target_fps=target)
    x = bvh.data["positions"][:, 0, 0]
    times = np.arange(len(x)) * bvh.data["frame_time"]
    return float(x[-1] / times[-1]), len(x)


print("upc-pymotion", version("upc-pymotion"))
seen = {}
for source, target, seconds in (
    (120, 60, 1),
    (120, 30, 1),
    (120, 30, 10),
    (30, 120, 1),
    (60, 24, 1),
    (25, 12, 4),
    (25, 12, 40),
    (30000 / 1001, 30, 4),
):
    speed, count = resampled(source, target, seconds)
    seen[source, target, seconds] = speed
    print(f"{source:.6g} to {target} a second, {seconds} s: {count} frames, speed {speed:.4f}, due 1")
assert abs(seen[120, 60, 1] - 1) < 1e-12
assert abs(seen[120, 30, 1] - 30 / 29) < 1e-12
assert abs(seen[120, 30, 10] - 300 / 299) < 1e-12
assert abs(seen[30, 120, 1] - 120 / 123) < 1e-12
assert abs(seen[60, 24, 1] - 24 / 23) < 1e-12
assert abs(seen[25, 12, 4] - 0.96) < 1e-12
assert abs(seen[25, 12, 40] - 0.96) < 1e-12
assert abs(seen[30000 / 1001, 30, 4] - 1.001) < 1e-12
PYTHON
