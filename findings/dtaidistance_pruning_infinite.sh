#!/usr/bin/env bash
# dtaidistance 2.5.1: distance_fast, with its default pruning, is infinite for some pairs of series.
#
# distance_fast prunes by default (use_pruning=True): what costs more than an upper bound, the distance
# along the diagonal and then the last sample (ub_euclidean), is left out. Where the bound is the
# distance itself, to the last bit, that path is left out too and the answer is infinity.
# distance(use_pruning=True) does likewise; use_pruning=False is right.
#
# [3] from [0, 1]: sqrt(9 + 4) = 3.6056. Seen: infinity. Of 3000 pairs of random walks of 3 to 29
# samples six are infinite, all where the bound is the distance. Fails if that changes.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet dtaidistance==2.5.1 numpy==2.3.5
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from dtaidistance import dtw

print("dtaidistance", version("dtaidistance"))
a, b = np.array([3.0]), np.array([0.0, 1.0])
for words, value in (
    ("distance", dtw.distance(a, b)),
    ("distance(use_pruning=True)", dtw.distance(a, b, use_pruning=True)),
    ("distance_fast", dtw.distance_fast(a, b)),
    ("distance_fast(use_pruning=False)", dtw.distance_fast(a, b, use_pruning=False)),
):
    print(f"{words}: {value:.4f}")
assert np.isinf(dtw.distance_fast(a, b))
assert np.isclose(dtw.distance_fast(a, b, use_pruning=False), 13**0.5)

rng = np.random.default_rng(0)
infinite = []
for _ in range(3000):
    n, m = rng.integers(3, 30, 2)
    a, b = rng.normal(size=n).cumsum(), rng.normal(size=m).cumsum()
    whole, pruned = dtw.distance_fast(a, b, use_pruning=False), dtw.distance_fast(a, b)
    if np.isinf(pruned):
        infinite.append((int(n), int(m)))
        assert dtw.ub_euclidean(a, b) == whole
    else:
        assert np.isclose(whole, pruned)
    assert np.isfinite(whole)
print(f"{len(infinite)} of 3000 pairs infinite, of lengths {infinite}")
assert infinite
PYTHON
