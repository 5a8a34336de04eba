"""Figure 5 of Lee & Shin 2001: a motion at its levels of detail, from the base to the motion itself.

    python benchmarks/papers/lee_shin_figure_5.py [--json FILE] [--picture FILE]

The paper shows a motion with its details added level by level: coarse levels keep the large moves,
details the rest, and all of them together are the motion. Here three real captures of 257 frames
are taken apart into six levels over a base of five frames. Of every level, the mean angle to the
capture (largest over joints and frames in "all of them"), the mean distance of joints in per mille
of the height, and the roughness, the root mean square of angular second differences of joints,
as a share of the capture's.

Verdict, fixed beforehand: "reproduced" if in each capture every level is nearer to it than the one
before and rougher, and all levels together are off by less than 1e-12 rad; "refuted" if not.
Nothing is drawn at random.
"""

import numpy as np
import remade

import jaxmotion as jm
from jaxmotion import quaternion

PAPER = "Lee & Shin 2001"
FRAMES, LEVELS = 257, 6
EXACT = 1e-12  # radians
# Captures and their first frames.
CLIPS = {
    "bandai/walk_normal_001.bvh": 0,
    "bandai/dance-short_normal_001.bvh": 300,
    "cmu/02_01.amc": 40,
}
SHOWN = "bandai/dance-short_normal_001.bvh"


def make(seed: int) -> list[dict]:
    """A row a level, of the mean over captures."""
    found = [of_clip(name) for name in CLIPS]
    good = all(clip["rms"] for clip in found)
    for clip in found:
        nearer, rougher = np.diff(clip["angle"]) < 0, np.diff(clip["rough"]) > 0
        good = good and nearer.all() and rougher.all() and clip["worst"] < EXACT
    rows = [
        {
            "levels of detail": "0, the base" if k == 0 else f"{k}, all of them"[: 3 * (k < LEVELS) or None].rstrip(", "),
            "angle, °": float(np.mean([clip["angle"][k] for clip in found])),
            "distance, ‰": float(np.mean([clip["distance"][k] for clip in found])),
            "roughness": float(np.mean([clip["rough"][k] for clip in found])),
        }
        for k in range(LEVELS + 1)
    ]
    return [rows]


if __name__ == "__main__":
    remade.main(make, doc=__doc__)
