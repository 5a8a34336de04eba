"""What the columns of a report's tables say, in plain words: for headings, and for legends below.

A figure is a row of ``FIGURES``: where it is in a file's entry, its heading, and what it says.
"""

from collections.abc import Mapping
from types import MappingProxyType

OF_FILES = {
    "file": "What was read; below it what came of it.",
    "output": "What was written.",
    "status": "Written; read, where nothing is to be written; skipped, as it was done before; "
    "failed; or not tried, as the run ended.",
}

_UNITS = "in length units of the file"

FIGURES: tuple[tuple[tuple[str, ...], str, str], ...] = (
    (("frames",), "frames", "How many the file has."),
    (("rate",), "frames a second", "The file's rate."),
    (
        ("unit",),
        "metres a length unit",
        "What the file's unit of length is: 0.01 for centimetres. Empty where it says none.",
    ),
    (("result", "frames"), "frames now", "How many the output has."),
    (("result", "rate"), "a second now", "The output's rate, frames a second."),
    (
        ("changes", "frames_changed"),
        "frames changed",
        "In how many a joint turns by more than 0.05 degrees, or shifts as visibly.",
    ),
    (
        ("changes", "degrees"),
        "joints turned, degrees",
        "How far joints are turned in their parents: the most, where that is, the mean of all "
        "frames and joints, and what 95 % of them stay below.",
    ),
    (
        ("changes", "distance"),
        "joints moved, units",
        f"How far joints and ends of limbs are moved in the world, {_UNITS}: the same figures.",
    ),
    (
        ("changes", "root"),
        "root moved, units",
        f"How far the whole body is moved in the world, {_UNITS}: the same figures.",
    ),
    (
        ("feet", "slide_before"),
        "feet slid, units a second",
        f"How fast feet slid in the input while they touched the floor, {_UNITS} a second.",
    ),
    (
        ("feet", "slide_timed"),
        "in the new timing",
        "How fast they would slide if only the timing had changed, units a second.",
    ),
    (
        ("feet", "slide_edited"),
        "feet slide as edited",
        "How fast they slide before contacts are restored, units a second.",
    ),
    (("feet", "slide_after"), "feet slide now", "How fast in the output, units a second."),
    (
        ("feet", "contacts_restored"),
        "contacts restored",
        "How many were made to stand still, each of a heel or a ball from when it touches to when "
        "it leaves. 0: feet needed nothing.",
    ),
    (
        ("feet", "root_move"),
        "which moved the root by up to",
        f"How far restoring contacts moved the body at most, {_UNITS}.",
    ),
    (
        ("jerk", "before"),
        "jerk before, units a second³",
        f"How abruptly joints move in the input, on average, {_UNITS} a second³. Noise makes much.",
    ),
    (("jerk", "after"), "jerk now", "The same of the output: less is smoother."),
    (("seconds",), "seconds it took", "To read, work on and write the file."),
)

_RUNS = {
    "start": "The first frame, from 0.",
    "stop": "The frame after the last.",
    "seconds": "When it begins.",
    "lasts": "How long it is, seconds.",
    "joints": "The joints in it.",
    "size": "By how many degrees a joint is out of place at most.",
    "detectors": "What it was seen by: a jump goes away and comes back at once, a hold freezes, a "
    "digression is like nothing else in the takes, missing is no number.",
    "confidence": "How sure it is: 0.5 is at the limit, 1 beyond doubt.",
}
_SMOOTHED = {
    "lam": "Stiffness: how much jerk costs (λ).",
    "sigma": "Noise of a reading (σ).",
    "hertz": "What swings faster is taken off by more than half.",
}

# What columns of tables of what was learned say, by table.
LEARNED: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "runs": {
            **_RUNS,
            "change": "By how many degrees the repair turned a joint at most.",
            "jump_before": "The largest jump from a frame to the next before, degrees.",
            "jump_after": "And after the repair.",
        },
        "runs_left": _RUNS,
        "changes": {
            "degrees": "By how much the joint was turned at most.",
            "frame": "Where that is, from 0.",
            "seconds": "When that is.",
            "typical": "By how many degrees it was turned, typically.",
            "share": "What was taken off, as a part of how much the joint turns, 0 to 1.",
            "correlation": "How long it lasts: about 0 from frame to frame, as noise does, to 1.",
            "lean": "How one-sided it is, 0 to 1; noise is not.",
            "contact": "How many times as much while a foot or hand below the joint touches.",
            "stands_out": "Which of the last three are not like noise.",
            "noise": "The noise found about each axis, degrees.",
        },
        "turns": {**_SMOOTHED, "degrees": "The noise found about each axis."},
        "translations": {**_SMOOTHED, "length": "The noise found along each axis, length units."},
        "base": {**_SMOOTHED, "saturated": "Whether it is as smooth as can be."},
    }
)
