#!/usr/bin/env bash
# bvhtoolbox 0.1.3: bvh2csv --scale scales a joint's position once for every joint above it.
#
# The option is documented as a factor for root position and offsets, to switch from centimetres to
# metres. write_joint_positions multiplies each joint's position in the world by it, and the joint
# below starts from the product. So the root is scaled once, what a child has of it twice, a grandchild
# three times: with 0.01 only the root walks, and every other joint stays near the origin, about its
# own OFFSET away. Scale 1, the default, is right.
#
# A leg of 40 and 45 cm below a root at (10, 95, 200). Expected in metres: the ankle at (0.1, 0.1, 2).
# Seen: (0.00001, -0.45391, 0.0002). Scale the CSV afterwards. No issue of it was found. Fails if that
# changes.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet bvhtoolbox==0.1.3 transforms3d==0.4.2 numpy==2.3.5
cd "$folder"
cat >leg.bvh <<'BVH'
HIERARCHY
ROOT Hips
{
	OFFSET 0 0 0
	CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
	JOINT Knee
	{
		OFFSET 0 -40 0
		CHANNELS 3 Zrotation Xrotation Yrotation
		JOINT Ankle
		{
			OFFSET 0 -45 0
			CHANNELS 3 Zrotation Xrotation Yrotation
			End Site
			{
				OFFSET 0 0 10
			}
		}
	}
}
MOTION
Frames: 2
Frame Time: 0.04
10 95 200 0 0 0 0 0 0 0 0 0
20 95 200 0 30 0 0 0 0 0 0 0
BVH
"$folder/venv/bin/python" - <<'PYTHON'
import os
from importlib.metadata import version

import numpy as np
from bvhtoolbox.convert.bvh2csv import main as bvh2csv


def converted(scale):
    """Frames by joints by axes; the columns are the time and then x, y and z a joint."""
    os.mkdir(f"scale_{scale}")
    assert bvh2csv(["--position", "--scale", scale, "--out", f"scale_{scale}", "leg.bvh"])
    rows = np.loadtxt(f"scale_{scale}/leg_pos.csv", delimiter=",", skiprows=1)
    return rows[:, 1:].reshape(len(rows), 3, 3)


sine, cosine = np.sin(np.radians(30)), np.cos(np.radians(30))
centimetres = np.array(
    [
        [[10, 95, 200], [10, 55, 200], [10, 10, 200]],
        [
            [20, 95, 200],
            [20, 95 - 40 * cosine, 200 - 40 * sine],
            [20, 95 - 85 * cosine, 200 - 85 * sine],
        ],
    ]
)
print("bvhtoolbox", version("bvhtoolbox"))
plain, scaled = converted("1"), converted("0.01")
for j, name in enumerate(("Hips", "Knee", "Ankle")):
    print(f"{name}, first frame: {plain[0, j]} cm, with --scale 0.01 {scaled[0, j]}, due {plain[0, j] / 100}")
root, thigh, shank = np.diff(centimetres, axis=1, prepend=0).swapaxes(0, 1)
s = 0.01
compounded = np.stack([s * root, s**2 * root + s * thigh, s**3 * root + s**2 * thigh + s * shank], 1)
assert np.allclose(plain, centimetres, atol=1e-4)
assert np.allclose(scaled, compounded, atol=1e-4)
assert np.allclose(scaled[:, 0], plain[:, 0] / 100, atol=1e-4)
assert np.abs(scaled[:, 1:] - plain[:, 1:] / 100).max() > 1
PYTHON
