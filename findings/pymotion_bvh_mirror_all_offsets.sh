#!/usr/bin/env bash
# upc-pymotion 0.3.4: BVH.mirror(mode="all") keeps the offsets as they were, so its figure is no mirror image.
#
# Mode "all" is documented in pymotion.ops.skeleton.mirror as a perfect mirror that also mirrors the
# topology: it returns mirrored offsets and end sites with the rotations. The method BVH.mirror calls
# it, sets the rotations and the root, and drops the offsets and end sites. What is then in the
# object, and in the file that save writes, has mirrored rotations on a skeleton that is not
# mirrored: neither the mirror image nor the motion. Nothing says so.
#
# A figure of two arms that reach 5 from the root, in random poses. By the function every joint is
# where its mirror image is, to 1e-6. Seen by the method: joints 5 away from it and more, whether or
# not left and right are exchanged. With its default, mode="symmetry", the method is right where the rest
# pose is symmetric. To have mode "all": call the function, and write offsets and end sites into
# BVH.data too. No issue of it was found. Fails if that changes.
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
from pymotion.ops import skeleton

# name, parent, offset; the last of each arm carries the end site
JOINTS = [
    ("Hips", None, (0, 0, 0)),
    ("LeftArm", 0, (1, 1, 0)),
    ("LeftForeArm", 1, (2, 0, 0)),
    ("LeftHand", 2, (2, 0, 0)),
    ("RightArm", 0, (-1, 1, 0)),
    ("RightForeArm", 4, (-2, 0, 0)),
    ("RightHand", 5, (-2, 0, 0)),
]
OTHER = [0, 4, 5, 6, 1, 2, 3]
TURNS = "Zrotation Xrotation Yrotation"


def block(joint, depth=0):
    name, parent, offset = JOINTS[joint]
    pad = "\t" * depth
    kind = "ROOT" if parent is None else "JOINT"
    channels = f"6 Xposition Yposition Zposition {TURNS}" if parent is None else f"3 {TURNS}"
    place = " ".join(map(str, offset))
    lines = [f"{pad}{kind} {name}", pad + "{", f"{pad}\tOFFSET {place}", f"{pad}\tCHANNELS {channels}"]
    below = [j for j, other in enumerate(JOINTS) if other[1] == joint]
    for j in below:
        lines += block(j, depth + 1)
    if not below:
        side = 1 if offset[0] > 0 else -1
        lines += [f"{pad}\tEnd Site", pad + "\t{", f"{pad}\t\tOFFSET {side} 0 0", pad + "\t}"]
    return [*lines, pad + "}"]


def positions(root, degrees, offsets):
    """Forward kinematics by matrices, channels Z, X, Y about moving axes."""
    a = np.radians(degrees)
    c, s = np.cos(a), np.sin(a)
    turns, places = [], []
    for j, (_, parent, _) in enumerate(JOINTS):
        (cz, cx, cy), (sz, sx, sy) = c[j], s[j]
        z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        local = z @ x @ y
        if parent is None:
            turns.append(local)
            places.append(root)
        else:
            places.append(places[parent] + turns[parent] @ offsets[j])
            turns.append(turns[parent] @ local)
    return np.array(places)


def all_positions(bvh):
    data = bvh.data
    return np.array(
        [
            positions(place[0], turns, data["offsets"])
            for place, turns in zip(data["positions"], data["rotations"], strict=True)
        ]
    )


rng = np.random.default_rng(0)
frames = 5
rows = np.hstack([rng.normal(size=(frames, 3)), rng.uniform(-60, 60, (frames, 3 * len(JOINTS)))])
with open("take.bvh", "w") as file:
    file.write("\n".join(["HIERARCHY", *block(0), "MOTION", f"Frames: {frames}", "Frame Time: 0.04"]))
    for row in rows:
        file.write("\n" + " ".join(f"{v:.9f}" for v in row))


def load():
    bvh = BVH()
    bvh.load("take.bvh")
    return bvh


print("upc-pymotion", version("upc-pymotion"))
image = all_positions(load()) * [-1, 1, 1]


def away(places):
    return [float(np.abs(places - due).max()) for due in (image, image[:, OTHER])]


bvh = load()
rotations, local, parents, offsets, sites, _ = bvh.get_data()
turned, root, mirrored, _ = skeleton.mirror(rotations, local[:, 0].copy(), parents, offsets, sites, mode="all")
bvh.data["offsets"] = mirrored
bvh.set_data(turned, np.concatenate([root[:, None], local[:, 1:]], 1))
function = away(all_positions(bvh))
print("largest distance from the mirror image, each joint from its own and from the other side's")
print("function, mode all, with its offsets:", function)
seen = {}
for mode in ("symmetry", "all"):
    bvh = load()
    before = bvh.data["offsets"].copy(), bvh.data["end_sites"].copy()
    bvh.mirror(mode=mode)
    seen[mode] = away(all_positions(bvh))
    kept = np.array_equal(before[0], bvh.data["offsets"]) and np.array_equal(before[1], bvh.data["end_sites"])
    print(f"BVH.mirror, mode {mode}: {seen[mode]}, offsets and end sites as they were: {kept}")
    assert kept
assert function[0] < 1e-5
assert seen["symmetry"][1] < 1e-5
assert min(seen["all"]) > 5.0
PYTHON
