#!/usr/bin/env bash
# dtaidistance 2.5.1: with inner_dist="euclidean" its C code squares the penalty, its Python code does not.
#
# The penalty is documented as what is added where a series is stretched or compressed. With the
# squared default both codes square it, so that it has the unit of the samples. With
# inner_dist="euclidean", where D is a sum of distances, Python adds the penalty and C its square:
# distance_fast, distance_matrix_fast, dtw_ndim.distance_fast and all use_c=True. warping_paths_fast
# adds it plain, so that the distance of its path is another one than that of distance_fast.
#
# Penalties below 1 count for less than was asked and those above for more; which pairs are near one
# another changes with use_c, and a penalty in centimetres or metres means something else.
#
# [0] from [0, 0] is one step of stretching: its distance is the penalty. Seen for 0.3: 0.3 and, in C,
# 0.09; for 2: 2 and 4. Random walks differ likewise from the recursion written out. No issue of it
# was found. Fails if that changes.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet dtaidistance==2.5.1 numpy==2.3.5
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from dtaidistance import dtw, dtw_ndim


def by_definition(x, y, penalty):
    d = np.full((len(x) + 1, len(y) + 1), np.inf)
    d[0, 0] = 0.0
    for i in range(len(x)):
        for j in range(len(y)):
            d[i + 1, j + 1] = abs(x[i] - y[j]) + min(d[i, j], d[i, j + 1] + penalty, d[i + 1, j] + penalty)
    return d[-1, -1]


PLAIN = {
    "distance": dtw.distance,
    "warping_paths": lambda x, y, **o: dtw.warping_paths(x, y, **o)[0],
    "warping_paths_fast": lambda x, y, **o: dtw.warping_paths_fast(x, y, **o)[0],
    "dtw_ndim.distance": lambda x, y, **o: dtw_ndim.distance(x[:, None], y[:, None], **o),
    "distance_matrix": lambda x, y, **o: dtw.distance_matrix([x, y], **o)[0, 1],
}
SQUARED = {
    "distance(use_c=True)": lambda x, y, **o: dtw.distance(x, y, use_c=True, **o),
    "distance_fast": lambda x, y, **o: dtw.distance_fast(x, y, use_pruning=False, **o),
    "dtw_ndim.distance_fast": lambda x, y, **o: dtw_ndim.distance_fast(x[:, None], y[:, None], **o),
    "distance_matrix_fast": lambda x, y, **o: dtw.distance_matrix_fast([x, y], **o)[0, 1],
}

print("dtaidistance", version("dtaidistance"))
one, two = np.zeros(1), np.zeros(2)
for penalty in (0.3, 2.0):
    for name, f in {**PLAIN, **SQUARED}.items():
        seen = f(one, two, penalty=penalty, inner_dist="euclidean")
        default = f(one, two, penalty=penalty)
        print(f"[0] from [0, 0], penalty {penalty}, {name}: {seen:.4f}, by the squared default {default:.4f}")
        assert np.isclose(seen, penalty if name in PLAIN else penalty**2)
        assert np.isclose(default, penalty)

rng = np.random.default_rng(0)
pairs = [[rng.normal(size=n).cumsum() for n in rng.integers(5, 30, 2)] for _ in range(100)]
far = 0
for x, y in pairs:
    right, wrong = by_definition(x, y, 0.3), by_definition(x, y, 0.09)
    for f in PLAIN.values():
        assert np.isclose(f(x, y, penalty=0.3, inner_dist="euclidean"), right)
    for f in SQUARED.values():
        assert np.isclose(f(x, y, penalty=0.3, inner_dist="euclidean"), wrong)
    far += not np.isclose(right, wrong)
print(f"100 pairs of random walks, penalty 0.3: {far} have another distance in C, that of penalty 0.09")
assert far > 90
PYTHON
