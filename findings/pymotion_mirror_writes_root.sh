#!/usr/bin/env bash
# upc-pymotion 0.3.4: skeleton.mirror(mode="symmetry") writes the mirrored root into the array it is given.
#
# pymotion.ops.skeleton.mirror returns rotations, root translation, offsets and end sites. Its
# documentation says nothing of its arguments being changed. With mode="symmetry" the root it returns
# is the array it was given, and that one is negated along the axis; modes "all" and "positions" copy
# it. Its rotations are new in all three. Its torch code does the same (seen with torch 2.13.0, not
# run here).
#
# So the take itself is changed: its root is on one side and its rotations on the other. Mirrored
# again from the same arrays, as in a loop over epochs, it gets the root it had with mirrored
# rotations. BVH.mirror copies first and is safe; so is a copy of the root.
#
# A walk along x at 1 a second. Seen: after one call x of the caller's root is negated, after two
# calls with the same arguments it is what it was, and so is the first result. Expected: the
# arguments as they were, and twice the same. No issue of it was found. Fails if that changes.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet upc-pymotion==0.3.4 numpy==2.3.5
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from pymotion.ops import skeleton

frames = 4
parents = np.array([0, 0, 0])
offsets = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
other_side = np.array([0, 2, 1])
turn = 0.2 * np.arange(1, 4) * np.ones((frames, 1))
rotations = np.stack([np.cos(turn), np.zeros_like(turn), np.sin(turn), np.zeros_like(turn)], -1)
walk = np.stack([np.arange(1.0, 1 + frames), np.ones(frames), np.zeros(frames)], 1)


def mirror(root, mode):
    return skeleton.mirror(
        rotations, root, parents, offsets, joints_mapping=other_side, mode=mode, axis="X"
    )


print("upc-pymotion", version("upc-pymotion"))
before = rotations.copy(), offsets.copy()
for mode in ("symmetry", "all", "positions"):
    root = walk.copy()
    first = mirror(root, mode)
    once = root[:, 0].copy()
    first_then = first[1][:, 0].copy()
    second = mirror(root, mode)
    print(f"{mode}: x of the root given {walk[:, 0]}, after one call {once}, after two {root[:, 0]}")
    print(f"  result of the first call {first_then}, after the second {first[1][:, 0]}")
    print(f"  result of the second call {second[1][:, 0]}")
    assert np.array_equal(first_then, -walk[:, 0])
    assert np.array_equal(before[0], rotations) and np.array_equal(before[1], offsets)
    assert np.allclose(first[0], second[0])
    if mode == "symmetry":
        assert np.array_equal(once, -walk[:, 0])
        assert np.array_equal(root, walk)
        assert first[1] is root
        assert np.array_equal(second[1], walk)
    else:
        assert np.array_equal(root, walk)
        assert np.array_equal(second[1], first[1])
PYTHON
