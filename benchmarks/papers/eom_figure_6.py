"""Figure 6 of Eom et al. 2019: quaternions smoothed, and rotation vectors, near where these wrap.

    python benchmarks/papers/eom_figure_6.py [--seed 0] [--json FILE] [--picture FILE]

The paper shows a joint's rotation near the singularity of the exponential map: what is smoothed as
quaternions tracks the truth, what is smoothed as rotation vectors breaks. Here every place where
the rotation vector of the hips jumps is looked for in eight real captures that turn, at 24 fps; of
each capture the first jump with half a second on both sides, 25 frames in all. White noise of 0.02
rad an axis, λ = σ = 1. Then the same frames again, all turned alike so that the middle one does not
turn at all, as another choice of coordinates would have it.

Verdict, fixed beforehand: "reproduced" if in every capture the largest error of rotation vectors is
at least 10 times that of quaternions, and that of quaternions at most twice that of the noisy
frames; "refuted" if not.
"""

import jax
import numpy as np
import remade

import jaxmotion as jm
from jaxmotion import quaternion

PAPER = "Eom et al. 2019"
FPS, BESIDE = 24.0, 12
NOISE = 0.02  # radians an axis
BREAKS, TRACKS = 10.0, 2.0
CLIPS = (
    "bandai/kick_normal_001.bvh",
    "bandai/dance-short_normal_001.bvh",
    "cmu/01_01.amc",
    *(f"cmu_dance/005_0{k}.bvh" for k in (2, 4, 6, 7, 8)),
)
SHOWN = CLIPS[0]


def make(seed: int) -> list[dict]:
    """A row a capture."""
    rows = [of_clip(name, seed) for name in CLIPS]
    broken = [row["rotation vectors, °"] / row["quaternions, °"] for row in rows]
    tracked = [row["quaternions, °"] / row["noisy, °"] for row in rows]
    same = max(abs(r["quaternions, °"] - r["quaternions turned, °"]) for r in rows)
    least, most = (f([r["rotation vectors, °"] for r in rows]) for f in (min, max))
    item = remade.told(
        PAPER,
        "Figure 6",
        "Smoothed quaternions track the truth where smoothed rotation vectors break.",
        f"Near a wrap rotation vectors are off by {least:.0f} to {most:.0f}°, quaternions by "
        f"{max(r['quaternions, °'] for r in rows):.1f}° at most; turned away from the wrap, "
        f"quaternions are off by the same to {same:.0e}°.",
        "reproduced" if min(broken) >= BREAKS and max(tracked) <= TRACKS else "refuted",
        rows,
        "25 frames at 24 fps about the first wrap of the hips of each capture",
    )
    return [item]


def of_clip(name: str, seed: int) -> dict:
    """The largest errors."""
    truth, noisy, at = wrapping(name, seed)
    turn = quaternion.conjugate(truth[BESIDE])

    def worst(q, wanted):
        return float(np.degrees(quaternion.distance(q, wanted)).max())

    def smooth(q, method):
        return jm.smoothing.smooth_quaternions(q[:, None], 1.0, 1.0, method=method)[:, 0]

    away, right = (quaternion.multiply(turn, q) for q in (noisy, truth))
    return {
        "capture": remade.short(name),
        "frame": at,
        "noisy, °": worst(noisy, truth),
        "rotation vectors, °": worst(smooth(noisy, "rotvec"), truth),
        "quaternions, °": worst(smooth(noisy, "chordal"), truth),
        "rotation vectors turned, °": worst(smooth(away, "rotvec"), right),
        "quaternions turned, °": worst(smooth(away, "chordal"), right),
    }


def wrapping(name: str, seed: int):
    """The hips of the frames about a jump of their rotation vector: true, noisy; which frame."""
    motion = remade.capture(name, FPS)
    hips = 1 if name.startswith("bandai") else 0
    q = motion.rotations[:, hips]
    jumps = np.linalg.norm(np.diff(np.asarray(quaternion.log(q)), axis=0), axis=1) > np.pi
    inside = [k for k in np.flatnonzero(jumps) + 1 if BESIDE <= k < len(q) - BESIDE]
    if not inside:
        raise SystemExit(f"{name}: no wrap with {BESIDE} frames on both sides")
    truth = q[inside[0] - BESIDE : inside[0] + BESIDE + 1]
    noise = NOISE * jax.random.normal(jax.random.key(seed), (len(truth), 3), truth.dtype)
    return truth, quaternion.multiply(truth, quaternion.exp(noise)), int(inside[0])


def draw(seed: int):
    """The kick."""
    truth, noisy, at = wrapping(SHOWN, seed)
    clip = remade.capture(SHOWN, FPS)[at - BESIDE : at + BESIDE + 1]
    right, given = (
        clip.with_transforms(rotations=clip.rotations.at[:, 1].set(q)) for q in (truth, noisy)
    )
    return jm.viz.plot_wrap(given, 1, truth=right)


if __name__ == "__main__":
    remade.main(make, draw, __doc__)
