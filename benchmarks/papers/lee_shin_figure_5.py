"""Figure 5 of Lee & Shin 2001: a motion at its levels of detail, from the base to all of it.

    python benchmarks/papers/lee_shin_figure_5.py [--json FILE] [--picture FILE]

The paper shows a motion with its details added level by level: coarse levels keep the large moves,
details the rest, and all of them together are the motion. Here three real captures of 257 frames
are taken apart into six levels over a base of five frames. Of every level, the mean angle of local
rotations to the capture, the mean distance of joints in per mille of the height, and the roughness,
the root mean square of second differences of local rotations, as a share of the capture's.

Verdict, fixed beforehand: "reproduced" if in each capture every level is nearer to it than the one
before and rougher, and all levels together are off by less than 1e-12 rad in every joint and frame;
"refuted" if not. Nothing is drawn at random.
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
    "bandai/walk_old_001.bvh": 10,
    "bandai/dance-short_normal_001.bvh": 300,
    "cmu/02_01.amc": 40,
}
SHOWN = "bandai/dance-short_normal_001.bvh"


def make(seed: int) -> list[dict]:
    """A row a level, means over captures."""
    found = [of_clip(name) for name in CLIPS]
    good = worst = 0
    for clip in found:
        nearer, rougher = np.diff(clip["angle"]) < 0, np.diff(clip["roughness"]) > 0
        good += nearer.all() and rougher.all()
        worst = max(worst, clip["worst"])
    rows = []
    for level in range(LEVELS + 1):
        name = {0: "base", LEVELS: f"{LEVELS}, all"}.get(level, str(level))
        row = {"details": name, "frames": found[0]["frames"][level]}
        for what, column in (("angle", "angle, °"), ("distance", "distance, ‰")):
            row[column] = float(np.mean([clip[what][level] for clip in found]))
        row["roughness"] = float(np.mean([clip["roughness"][level] for clip in found]))
        rows.append(row)
    item = remade.told(
        PAPER,
        "Figure 5",
        "Coarse levels keep the large moves; details added level by level give the motion.",
        f"In {good} of {len(found)} captures every level is nearer and rougher than the one before;"
        f" all together are off by {worst:.0e} rad at most.",
        "reproduced" if good == len(found) and worst < EXACT else "refuted",
        rows,
        "257 frames of a walk, of a dance and of CMU 02_01",
    )
    return [item]


def of_clip(name: str) -> dict:
    """Of every level of detail, the base first."""
    clip = clip_of(name)
    pyramid = jm.multiresolution.build_pyramid(clip, LEVELS)
    where = positions(clip)
    height = float(np.ptp(where[..., clip.skeleton.up_axis], axis=1).mean())
    found = {"angle": [], "distance": [], "roughness": []}
    for level in range(LEVELS + 1):
        motion = jm.multiresolution.level_of_detail(pyramid, level)
        angle = np.asarray(quaternion.distance(motion.rotations, clip.rotations))
        found["angle"].append(float(np.degrees(angle.mean())))
        off = np.linalg.norm(positions(motion) - where, axis=-1)
        found["distance"].append(1000 * float(off.mean()) / height)
        found["roughness"].append(roughness(motion) / roughness(clip))
    return found | {"worst": float(angle.max()), "frames": pyramid.frames}


def clip_of(name: str) -> jm.Motion:
    clip = remade.capture(name)[CLIPS[name] : CLIPS[name] + FRAMES]
    assert len(clip) == FRAMES
    return clip


def positions(motion: jm.Motion) -> np.ndarray:
    return np.asarray(jm.forward_kinematics(motion).positions)


def roughness(motion: jm.Motion) -> float:
    q = motion.rotations
    steps = np.asarray(quaternion.log(quaternion.between(q[:-1], q[1:])))
    return float(np.sqrt(np.mean(np.sum(np.diff(steps, axis=0) ** 2, axis=-1))))


def draw(seed: int):
    """A shin of the dance."""
    pyramid = jm.multiresolution.build_pyramid(clip_of(SHOWN), LEVELS)
    return jm.viz.plot_pyramid(pyramid, "LowerLeg_L")


if __name__ == "__main__":
    remade.main(make, draw, __doc__)
