"""Figure 9 of Lee & Shin 2001: two motions stitched, and the joint between them smooth.

    python benchmarks/papers/lee_shin_figure_9.py [--json FILE] [--picture FILE]

The paper joins two motions by putting base and details of one behind those of the other, and the
joint does not show (Eq. 21, whose indices run past the end as printed and are corrected). Here six
pairs of real captures are joined by ``multiresolution.stitch`` as it comes, the second moved to
where the first ends, and put end to end for comparison: the last 128 frames of the one, the first
128 of the other.

Of each pair, the largest change of a joint's angular velocity from a frame to the next within half
a second of the seam (degrees a frame), end to end and stitched, beside the largest that the two
captures have themselves, anywhere; where the stitched one exceeds that, also what is left when up
to 15 frames on both sides may be dropped (``search``), which is told and not judged.

Verdict, fixed beforehand: "reproduced" if in all six the stitched one does not exceed what the
clips have themselves and the result has the frames of both less one, "refuted" if not. Nothing is
drawn at random.
"""

import numpy as np
import remade

import jaxmotion as jm
from jaxmotion import quaternion
from jaxmotion.multiresolution.stitching import stitched

PAPER = "Lee & Shin 2001"
AROUND = 0.5  # seconds
FRAMES, SEARCH = 128, 15
PAIRS = (
    ("bandai/walk_normal_001.bvh", "bandai/walk-left_normal_001.bvh"),
    ("bandai/walk_tired_001.bvh", "bandai/walk_proud_001.bvh"),
    ("bandai/walk_old_001.bvh", "bandai/punch_normal_001.bvh"),
    ("bandai/kick_normal_001.bvh", "bandai/walk_normal_001.bvh"),
    ("cmu/02_01.amc", "cmu/02_03.amc"),
    ("cmu/02_05.amc", "cmu/02_07.amc"),
)
SHOWN = PAIRS[2]


def make(seed: int) -> list[dict]:
    """A row a pair."""
    rows = [of_pair(*pair) for pair in PAIRS]
    good = [row["stitched, °"] <= row["the clips' own, °"] for row in rows]
    jumped = [row["end to end, °"] > row["the clips' own, °"] for row in rows]
    shares = [row["stitched, °"] / row["end to end, °"] for row in rows]
    rest = [row for row in rows if row["with a search, °"]]
    mended = sum(row["with a search, °"] <= row["the clips' own, °"] for row in rest)
    searched = f" A search for the cut mends {mended} of the other {len(rest)}." if rest else ""
    item = remade.told(
        PAPER,
        "Figure 9",
        "Stitched motions have no seam that shows.",
        f"In {sum(good)} of {len(rows)} pairs no joint's velocity changes faster about the seam "
        f"than it does in the clips themselves; end to end it does in {sum(jumped)}. "
        f"Stitching leaves {min(shares):.2f} to {max(shares):.2f} of the jump.{searched}",
        "reproduced" if all(good) else "refuted",
        rows,
        "captures of bandai and cmu, 128 frames before and after the seam",
    )
    return [item]


def of_pair(first: str, second: str) -> dict:
    """The largest changes of velocity."""
    whole = [remade.capture(name) for name in (first, second)]
    own = max(change(clip.rotations) for clip in whole)
    clips = whole[0][-FRAMES:], whole[1][:FRAMES]
    found = stitched(clips)
    assert len(found.motion) == 2 * FRAMES - 1
    row = {
        "clips": f"{remade.short(first)}, {remade.short(second)}",
        "the clips' own, °": own,
        "end to end, °": near_seam(found.end_to_end, found.seams[0]),
        "stitched, °": near_seam(found.motion, found.seams[0]),
        "with a search, °": None,
    }
    if row["stitched, °"] > own:
        better = stitched(clips, search=SEARCH)
        row["with a search, °"] = near_seam(better.motion, better.seams[0])
    return row


def near_seam(motion: jm.Motion, seam: int) -> float:
    around = round(AROUND * float(motion.fps))
    return change(motion.rotations[max(seam - around, 0) : seam + around + 1])


def change(q) -> float:
    """The largest second difference, of all joints and frames."""
    steps = np.asarray(quaternion.log(quaternion.between(q[:-1], q[1:])))
    return float(np.degrees(np.linalg.norm(np.diff(steps, axis=0), axis=-1).max()))


def draw(seed: int):
    """A walk, and a punch."""
    return jm.viz.plot_seam([remade.capture(name) for name in SHOWN])


if __name__ == "__main__":
    remade.main(make, draw, __doc__)
