#!/usr/bin/env bash
# bvhsdk 0.2.1: Animation.downSample from 120 to 30 frames a second leaves one frame.
#
# downSample is documented as useful "from 120 fps to 30 fps, for example". It deletes every k-th frame,
# k the number of frames over the number that are too many, rounded. Deleting that way cannot leave
# less than half: for 120 to 30 k is 4/3, rounded to 1, and all frames but the first are deleted. It
# prints a line and returns True, and the file that is written next has one pose. The same from 100
# to 30 or 120 to 24. Where k is rounded up to 2, half of the frames stay whatever was asked: 120 to
# 50 and 60 to 24 give 60 and 30 a second, labelled 50 and 24, which play 1.2 and 1.25 times as long.
# Halving is right.
#
# A root that moves along x at 1 a second for 4 s. Seen: frames and duration below; due are 4 s and a
# frame more than 4 times the rate. For 120 to 30 take every fourth frame. No issue of it was found.
# Fails if that changes.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet bvhsdk==0.2.1 numpy==2.3.5
cd "$folder"
MPLCONFIGDIR="$folder" "$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import bvhsdk
import numpy as np

HEAD = """HIERARCHY
ROOT Hips
{
	OFFSET 0 0 0
	CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
	JOINT Chest
	{
		OFFSET 0 20 0
		CHANNELS 3 Zrotation Xrotation Yrotation
		End Site
		{
			OFFSET 0 20 0
		}
	}
}
MOTION
"""
SECONDS = 4


def down(source, target):
    """Frames, seconds by the labels, and seconds of the motion, which is where the root is."""
    frames = SECONDS * source + 1
    with open("take.bvh", "w") as file:
        file.write(f"{HEAD}Frames: {frames}\nFrame Time: {1 / source:.9f}\n")
        for k in range(frames):
            file.write(f"{k / source:.9f} 0 0 0 0 0 0 0 0\n")
    take = bvhsdk.ReadFile("take.bvh")
    assert take.frames == frames
    assert take.downSample(target) is True
    x = np.asarray(take.root.translation)[:, 0]
    assert len(x) == take.frames and np.isclose(take.frametime, 1 / target)
    return len(x), (len(x) - 1) / target, float(x[-1] - x[0])


print("bvhsdk", version("bvhsdk"))
seen = {}
for source, target in ((120, 60), (120, 30), (120, 24), (100, 30), (120, 50), (60, 24)):
    frames, labelled, motion = seen[source, target] = down(source, target)
    print(
        f"  {source} to {target}: {frames} frames, due {SECONDS * target + 1};"
        f" {labelled:.2f} s long, of {motion:.2f} s of motion"
    )
assert np.allclose(seen[120, 60], (241, 4, 4))
assert seen[120, 30] == seen[120, 24] == seen[100, 30] == (1, 0.0, 0.0)
assert np.allclose(seen[120, 50], (241, 4.8, 4))
assert np.allclose(seen[60, 24], (121, 5, 4))
PYTHON
