#!/usr/bin/env bash
# jax 0.10.2: jax.scipy.spatial.transform.Slerp, past its last key, starts again from the key before it.
#
# SciPy's Slerp raises ValueError outside its key times. JAX's cannot raise, and its documentation
# says nothing of such times. Before the first key it goes on at the speed of the first interval.
# Past the last key it takes the last key's time with the rotation of the last but one: the pose
# jumps back by a whole interval and moves on from there, at the speed of the last interval. One unit
# of rounding is enough. Times made by two formulas, as k/fps and linspace, differ by that: in float64
# the last frame of 167 of 1788 clips lies past its last key (in float32 of none of these).
#
# So a clip that is resampled at its own times has a wrong last frame, or not, by its rate and length.
# Keys about z of 0, 30, 60, 90 and 120 degrees at 0 to 4: at 4 it is 120, just past it 90 (expected:
# 120, whether it holds, goes on or refuses), at 4.5 it is 105 (held: 120; gone on: 135). Clip the
# times to the last key. No issue of it was found. Fails if that changes.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet jax==0.10.2 jaxlib==0.10.2 scipy==1.17.1 numpy==2.3.5
JAX_PLATFORMS=cpu "$folder/venv/bin/python" - <<'PYTHON'
import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
import scipy
from jax.scipy.spatial.transform import Rotation, Slerp
from scipy.spatial.transform import Rotation as SciPyRotation
from scipy.spatial.transform import Slerp as SciPySlerp

degrees = np.array([0.0, 30.0, 60.0, 90.0, 120.0])


def turns(kind):
    return kind.from_rotvec(np.radians(degrees)[:, None] * np.array([0.0, 0.0, 1.0]))


def angles(times):
    """Degrees about z at the times, keys at 0 to 4."""
    slerp = Slerp.init(np.arange(5.0), turns(Rotation))
    return np.degrees(np.asarray(slerp(np.asarray(times)).as_rotvec())[:, 2])


print("jax", jax.__version__, "scipy", scipy.__version__)
inside = np.linspace(0, 4, 41)
peer = SciPySlerp(np.arange(5.0), turns(SciPyRotation))
assert np.allclose(angles(inside), np.degrees(peer(inside).as_rotvec()[:, 2]))
times = [-0.5, 0.0, 3.5, 4.0, np.nextafter(4.0, 5.0), 4.5, 5.0, 6.0]
seen = angles(times)
for time, angle in zip(times, seen, strict=True):
    print(f"at {time!r}: {angle:.4f} degrees")
assert np.allclose(seen, [-15, 0, 105, 120, 90, 105, 120, 150]), seen
refused = 0
for time in (-0.5, np.nextafter(4.0, 5.0)):
    try:
        peer([time])
    except ValueError:
        refused += 1
assert refused == 2

clips = [(fps, n) for fps in (24, 25, 30, 60, 100, 120) for n in range(2, 300)]
for dtype in (np.float64, np.float32):
    past = sum(
        dtype(np.linspace(0, (n - 1) / fps, n)[-1]) > dtype((np.arange(n) * (1 / fps))[-1])
        for fps, n in clips
    )
    print(f"{dtype.__name__}: the last of linspace is past the last of k * (1/fps) in {past} of {len(clips)} clips")
    assert past == (167 if dtype is np.float64 else 0)

fps, n = next((f, n) for f, n in clips if (n - 1) / f > (n - 1) * (1 / f))
keys = np.arange(n) * (1 / fps)
about_z = Rotation.from_rotvec(np.radians(10.0 * np.arange(n))[:, None] * np.array([0.0, 0.0, 1.0]))
again = Slerp.init(keys, about_z)(np.linspace(0, (n - 1) / fps, n))
off = np.degrees(np.asarray((about_z.inv() * again).magnitude()))
print(f"{n} frames of 10 degrees each at {fps} a second, at their own times: off by {off.round(4)} degrees")
assert np.allclose(off[:-1], 0, atol=1e-6) and np.isclose(off[-1], 10)
PYTHON
