"""What ``denoise`` turned, joint by joint: in a line for people, and in rows for a report.

A row has the fields of :class:`jaxmotion.smoothing.Removal` and ``noise``, the noise found about
each axis in degrees, None where nothing was learned.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from jaxmotion._plain import some

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion._types import ArrayLike
    from jaxmotion.smoothing import MotionTuning

_SEEN = 0.05  # degrees; less is in no row,
_TOLD = 0.5  # and in no line
_NAMED = 3
_FRAMES = 8


def of_joints(
    motion: "Motion", clean: "Motion", length: int, tuning: "MotionTuning | None"
) -> list[dict[str, Any]]:
    """A row a joint that one sees changed, the one turned furthest first, of padded clips."""
    import equinox as eqx
    import numpy as np

    from jaxmotion.cli._feet import find_feet
    from jaxmotion.cli._learned import HALF_ANGLE
    from jaxmotion.cli._padding import unpadded
    from jaxmotion.smoothing import removed

    contacts = find_feet(motion, length)
    contacts = eqx.tree_at(lambda c: c.mask, contacts, np.asarray(contacts.mask)[:length])
    found = removed(unpadded(motion, length), unpadded(clean, length), contacts=contacts)
    noise = None if tuning is None else HALF_ANGLE * np.asarray(tuning.rotations.sigma)
    return [
        row._asdict()
        | {"noise": None if noise is None else float(noise[motion.skeleton.index(row.joint)])}
        for row in found
        if row.degrees > _SEEN
    ]


def in_brief(rows: Sequence[dict[str, Any]]) -> str:
    """Which joints were turned most, and of which what was removed is not like noise; of a clip
    with next to none, that."""
    far = [row for row in rows if row["degrees"] >= _TOLD]
    if not far:
        most = max(rows, key=lambda row: row["degrees"], default=None)
        return f"next to no noise: at most {most['degrees']:.2g}°, {most['joint']}" if most else ""
    text = f"turned most: {', '.join(map(_most, far[:_NAMED]))}"
    odd = [row for row in far if row["stands_out"]]
    if not odd:
        return text
    joints = "1 joint" if len(odd) == 1 else f"{len(odd)} joints"
    return f"{text}; not like noise, {joints}: {', '.join(map(_odd, odd[:_NAMED]))}"


def made_anew(motion: "Motion", dropped: "ArrayLike | None") -> list[dict[str, Any]]:
    """A row a frame that the capture had dropped, of bool[T]."""
    import numpy as np

    frames = [] if dropped is None else np.flatnonzero(dropped).tolist()
    return [{"frame": t, "seconds": float(t * np.asarray(motion.frame_time))} for t in frames]


def frames_in_brief(rows: Sequence[dict[str, Any]]) -> str:
    """Which frames were made anew; "" for none."""
    frames = [row["frame"] for row in rows]
    if not frames:
        return ""
    more = f" and {len(frames) - _FRAMES} more" if len(frames) > _FRAMES else ""
    first = f"{', '.join(map(str, frames[:_FRAMES]))}{more}"
    return f"made anew {some(len(frames), 'dropped frame')}: {first}"


def _most(row: dict[str, Any]) -> str:
    noise = "" if row["noise"] is None else f"noise {row['noise']:.2g}°, "
    place = f"{row['joint']} by {row['degrees']:.3g}° at frame {row['frame']}"
    share = min(100 * row["share"], 99)
    return f"{place} ({noise}{share:.2g} % of variance)"


def _odd(row: dict[str, Any]) -> str:
    words = {
        "correlation": "lasts over frames",
        "lean": "one-sided",
        "contact": f"{'more' if (row['contact'] or 0) > 1 else 'less'} in contact",
    }
    return f"{row['joint']} ({', '.join(words[name] for name in row['stands_out'])})"
