"""Numbers that look like another convention's, and the likely cause in words for people.

| kind | the numbers | the likely cause |
|---|---|---|
| rate | a frame time within 0.5 % of a frame rate that cameras and engines use, or of 1000 over \
one | frames a second, or milliseconds, given for seconds |
| norm | half or more of the quaternions, those of norm 0 not counted, are off unit length | \
scaled, or no quaternions |
| order | the last component is the largest of the four in more than half of all joints and \
frames, and twice as often as the first; of 4 joints and 20 rotations or more | (x, y, z, w) for \
(w, x, y, z) |
| degrees | in a twentieth of all steps of the joints that turn, ten steps or more, they turn \
faster than 20 radians a second | degrees taken for radians |

Joints of a capture seldom turn by more than a right angle from their parents, so that w leads; and
no figure turns its joints so fast so often. NumPy, on values that are known.
"""

import numpy as np
from jaxtyping import Bool, Float

_RATES = (12, 15, 20, 24, 25, 30, 48, 50, 60, 72, 75, 90, 100, 120, 144, 150, 180, 200, 240, 250)
_RATES = (*_RATES, 300, 360, 400, 480, 500, 1000, *(r * 1000 / 1001 for r in (24, 30, 60, 120)))
RATE_TOLERANCE = 0.005
_UNIT_TOLERANCE = 1e-3  # of the squared norm
_LEADS, _TIMES, _JOINTS, _ROTATIONS = 0.5, 2.0, 4, 20
_FAST, _OFTEN, _STEPS = 20.0, 0.05, 10  # radians a second
_TURNS = 1e-6  # radians; less is rounding
_ALIKE = 0.01  # share by which norms differ that were scaled alike


def nearest_rate(fps: float) -> tuple[float, float]:
    """The nearest rate that cameras and engines use, and by which share ``fps`` differs."""
    nearest = min(_RATES, key=lambda rate: abs(np.log(fps / rate)))
    return float(nearest), abs(fps / nearest - 1.0)


def doubt_frame_time(seconds: float) -> str:
    """What a frame time of more than a second looks like, "" if like one."""
    if seconds > 1 and nearest_rate(seconds)[1] <= RATE_TOLERANCE:
        cause = f"is it a rate, {seconds:.6g} frames a second?"
    elif seconds > 1 and nearest_rate(1000 / seconds)[1] <= RATE_TOLERANCE:
        cause = f"is it milliseconds, {1000 / seconds:.5g} frames a second?"
    else:
        return ""
    return f"the frame time is {seconds:.6g} seconds; {cause}"


def unit(q: Float[np.ndarray, "... 4"]) -> Bool[np.ndarray, "..."]:
    """Which quaternions have unit length, to what rounding and printing leave of it."""
    return np.abs(np.einsum("...i,...i->...", q, q) - 1.0) <= _UNIT_TOLERANCE


def doubt_rotations(q: Float[np.ndarray, "time joint 4"]) -> tuple[str, str] | None:
    """The kind of doubt and the sentence, None if these look like unit quaternions (w, x, y, z)."""
    if unit(q).all() and not _last_leads(q):  # as in all good clips: no more to look at
        return None
    norms = np.linalg.norm(q, axis=-1)
    counts = (norms > 0) & np.isfinite(norms)
    if not counts.any():
        return None
    if np.mean(unit(q[counts])) <= 0.5:
        low, middle, high = np.quantile(norms[counts], [0.25, 0.5, 0.75])
        text = f"rotations have norms of about {middle:.4g}, where unit quaternions have 1; "
        if high - low <= _ALIKE * middle:
            return "norm", f"{text}are they scaled? quaternion.normalize undoes it"
        ways = "quaternion.from_euler takes angles, exp rotation vectors"
        return "norm", f"{text}are they quaternions? {ways}"
    if q.shape[-2] < _JOINTS or counts.sum() < _ROTATIONS:
        return None
    largest = np.argmax(np.abs(q[counts]), axis=-1)
    first, last = np.mean(largest == 0), np.mean(largest == 3)
    if last > max(_LEADS, _TIMES * first):
        text = (
            f"the last component of rotations is the largest in {100 * last:.0f} % of joints and "
            f"frames, the first in {100 * first:.0f} %; are they (x, y, z, w)? "
            "quaternion.from_xyzw makes them (w, x, y, z)"
        )
        return "order", text
    return None


def _last_leads(q: Float[np.ndarray, "... 4"]) -> bool:
    """Whether the last component is larger than the first often enough to be the largest so."""
    first, last = np.abs(q[..., 0]), np.abs(q[..., 3])
    return int(np.sum(last > first)) > _LEADS * first.size


def doubt_rates(turns: Float[np.ndarray, "step joint"], seconds: float) -> str:
    """What turns in radians from frame to frame look like, "" if like a motion's."""
    moving = turns[:, turns.max(axis=0, initial=0.0) > _TURNS]
    if not moving.size or len(turns) < _STEPS:
        return ""
    rate = np.quantile(moving, 1 - _OFTEN) / seconds
    if rate <= _FAST:
        return ""
    return (
        f"one turn of a joint in {1 / _OFTEN:.0f} is faster than {np.degrees(rate):.0f}° a second; "
        "were degrees taken for radians? quaternion.from_euler(degrees=True)"
    )
