"""Figure 8 of Eom et al. 2019: which way round a body turns between sparse keys.

    python benchmarks/papers/eom_figure_8.py [--json FILE] [--picture FILE]

The paper interpolates sparse keys by the LGS, which carries on turning where SLERP turns back, and
does not say which of q and −q it takes for a key. Here six real captures in which the hips spin: of
each the longest stretch in which they turn one way (by 10° back at most), six keys of it, where
they have turned by 0, 60, 120, 120 + g, 180 + g and 240 + g degrees, at the frames where they did,
for gaps g of 140 to 300°. A capture counts at a gap if it turns that far. Between the third and the
fourth key a method is right if it turns by g, to 30°. Methods: SLERP; the LGS with every key's sign
that nearest to the one before; the LGS with the signs of least energy.

Verdicts, fixed beforehand, at the gap of 200°. Of nearest signs: "reproduced" if they are right in
all captures, "refuted" if in none, else "not comparable". Of least energy: "reproduced" if it is
right in four of five captures or more, and SLERP in none; "refuted" if not. Nothing is drawn at
random.
"""

import jax.numpy as jnp
import numpy as np
import remade

import jaxmotion as jm

PAPER = "Eom et al. 2019"
CLAIM = "Between sparse keys the LGS turns on as the motion does, where SLERP turns back."
GAPS = range(140, 301, 20)
JUDGED, MOST = 200, 0.8
BACK, RIGHT = 10.0, 30.0  # degrees
CLIPS = (
    "bandai/kick_normal_001.bvh",
    "bandai/dance-short_normal_001.bvh",
    *(f"cmu_dance/005_0{k}.bvh" for k in (5, 6, 7, 8)),
)
METHODS = {
    "SLERP": {"method": "slerp"},
    "LGS, nearest": {"signs": "nearest"},
    "LGS, least energy": {"signs": "min_energy"},
}
SHOWN = CLIPS[-1]


def make(seed: int) -> list[dict]:
    """A row a gap."""
    stretches = [spin(name) for name in CLIPS]
    rows = []
    for gap in GAPS:
        found = [turns(hips, angle, gap) for hips, angle in stretches]
        found = [one for one in found if one]
        row = {"gap, °": gap, "captures": len(found)}
        for method in METHODS:
            right = sum(abs(one[method] - one["truth"]) < RIGHT for one in found)
            row[f"{method}: right"] = right
        turned = [one["LGS, least energy"] for one in found]
        row["least energy turns, °"] = ", ".join(f"{x:.0f}" for x in turned)
        rows.append(row)
    at = next(row for row in rows if row["gap, °"] == JUDGED)
    count = at["captures"]
    near, least, slerp = (at[f"{m}: right"] for m in ("LGS, nearest", "LGS, least energy", "SLERP"))
    where = f"{count} captures, cut where the hips turn one way, at the frames they turned by that"
    lasts = max(
        (r["gap, °"] for r in rows if r["LGS, least energy: right"] == r["captures"]), default=0
    )
    return [
        remade.told(
            PAPER,
            "Figure 8, nearest signs",
            CLAIM,
            f"With the nearest of q and −q the LGS turns the way that SLERP does: right in {near} "
            f"of {count} captures at a gap of {JUDGED}°, SLERP in {slerp}.",
            "refuted" if near == 0 else "reproduced" if near == count else "not comparable",
            part(rows, "SLERP: right", "LGS, nearest: right"),
            where,
        ),
        remade.told(
            PAPER,
            "Figure 8, signs of least energy",
            CLAIM,
            f"With the signs of least energy it is right in {least} of {count} at {JUDGED}°, and "
            f"in all up to {lasts}°.",
            "reproduced" if least >= MOST * count and slerp == 0 else "refuted",
            part(rows, "LGS, least energy: right", "least energy turns, °"),
            where,
        ),
    ]


def part(rows: list[dict], *columns: str) -> list[dict]:
    return [{column: row[column] for column in ("gap, °", "captures", *columns)} for row in rows]


def yaw(motion: jm.Motion) -> np.ndarray:
    """Degrees that the first joint has turned about the vertical, step after step."""
    q = np.asarray(motion.rotations)[:, 0]
    along = q[:, 1 + motion.skeleton.up_axis]
    return np.degrees(np.unwrap(2 * np.arctan2(along, q[:, 0])))


def spin(name: str) -> tuple[jm.Motion, np.ndarray]:
    """The hips alone, in the stretch where they turn furthest one way, and how far they have."""
    motion = remade.capture(name)
    hips = 1 if name.startswith("bandai") else 0
    alone = jm.Skeleton(["hips"], [-1], np.zeros((1, 3)))
    q = motion.rotations[:, [hips]]
    clip = jm.Motion.from_root(alone, jnp.zeros((len(motion), 3)), q, motion.frame_time)
    best = (0.0, 0, 1, 1.0)
    for sign in (1.0, -1.0):
        angle = sign * yaw(clip)
        for first in range(0, len(clip) - 1, 5):
            ahead = angle[first:] - angle[first]
            back = np.maximum.accumulate(ahead) - ahead > BACK
            until = np.argmax(back) if back.any() else len(ahead)
            last = first + int(np.argmax(ahead[:until]))
            best = max(best, (float(ahead[last - first]), first, last, sign))
    _, first, last, sign = best
    part = clip[first : last + 1]
    turned = sign * yaw(part)
    return part, turned - turned[0]


def turns(hips: jm.Motion, angle: np.ndarray, gap: int) -> dict | None:
    """How far each method turns in the gap, in the direction of the motion."""
    keys = np.cumsum([0, 60, 60, gap, 60, 60])
    if angle.max() < keys[-1]:
        return None
    at = np.array([np.argmax(angle >= key) for key in keys])
    sign = np.sign(yaw(hips)[-1] - yaw(hips)[0])
    poses = hips.with_transforms(hips.translations[at], hips.rotations[at])
    found = {"truth": float(angle[at[3]] - angle[at[2]])}
    for method, options in METHODS.items():
        turned = sign * yaw(jm.resample(poses, index=at - at[0], **options))
        found[method] = float(turned[at[3] - at[0]] - turned[at[2] - at[0]])
    return found


def draw(seed: int):
    """A dance, at the gap that is judged."""
    hips, angle = spin(SHOWN)
    at = np.array([np.argmax(angle >= key) for key in np.cumsum([0, 60, 60, JUDGED, 60, 60])])
    poses = hips.with_transforms(hips.translations[at], hips.rotations[at])
    truth = hips[at[0] : at[-1] + 1]
    return jm.viz.plot_key_interpolation(poses, at - at[0], 0, truth=truth)


if __name__ == "__main__":
    remade.main(make, draw, __doc__)
