#!/usr/bin/env bash
# aeon 1.6.0: soft_dtw_distance is the absolute value of soft-DTW, and 0 of a series from itself.
#
# Soft-DTW (Cuturi & Blondel 2017, which its documentation cites and writes out) is a soft minimum
# over all paths, and below the least of them: for series that are close it is negative. aeon gives
# |soft-DTW|, but plain DTW where the two arrays are equal. So a series is 0 from itself and far from
# what is next to it, a series further off can be nearer, and the divergence
# s(x, y) - (s(x, x) + s(y, y))/2 comes out of it wrong. The last cell of its soft_dtw_cost_matrix has
# the sign, but is likewise 0 for equal arrays.
#
# A sine of 20 samples, gamma 1: soft-DTW from x to x is -26.2, to x + 0.001 the same, to x + 0.5
# -21.8. Seen: 0, 26.2, 21.8. Fails if that changes.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet aeon==1.6.0
cd "$folder"
NUMBA_CACHE_DIR="$folder" "$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from aeon.distances import soft_dtw_cost_matrix, soft_dtw_distance


def by_definition(x, y, gamma):
    r = np.full((len(x) + 1, len(y) + 1), np.inf)
    r[0, 0] = 0.0
    for i in range(len(x)):
        for j in range(len(y)):
            before = np.array([r[i, j], r[i, j + 1], r[i + 1, j]])
            soft = -gamma * np.logaddexp.reduce(-before / gamma)
            r[i + 1, j + 1] = (x[i] - y[j]) ** 2 + soft
    return r[-1, -1]


x = np.sin(0.5 * np.arange(20))
print("aeon", version("aeon"))
seen, true, cells = {}, {}, {}
for away in (0.0, 1e-3, 0.5, 1.0, 3.0):
    y = x + away
    seen[away] = float(soft_dtw_distance(x, y, gamma=1.0))
    cells[away] = float(soft_dtw_cost_matrix(x, y, gamma=1.0)[-1, -1])
    true[away] = by_definition(x, y, 1.0)
    print(f"x from x + {away}: {seen[away]:.4f}, last cell {cells[away]:.4f}, by the definition {true[away]:.4f}")
    if away:
        assert np.isclose(cells[away], true[away])
        assert np.isclose(seen[away], abs(true[away]))
assert seen[0.0] == 0.0 and true[0.0] < -1
assert seen[0.5] < seen[1e-3] and true[0.5] > true[1e-3]
PYTHON
