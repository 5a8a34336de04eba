"""Figure 8 of Lee & Shin 2001: of a walk, a limp and a turn, a limping turn.

    python benchmarks/papers/lee_shin_figure_8.py [--json FILE] [--picture FILE]

The paper puts what a turning walk has beyond a straight one onto a limping walk, level by level
(Eq. 20, with the details of all levels: n = 0 is left out as printed). The captures at hand hold no
walk on a curve. In the place of the turn they have walks to the side, facing ahead, left and right,
in that of the limp straight walks in four manners that are unlike the plain one, and, what the
paper had not, side walks in those manners, which judge the outcome. The straight ones get the
timing of the plain side walk (``timing.align``), 135 frames; all begin in one place, for what one
has beyond another is a difference of places too. Six levels.

A path is where the hips end, seen from where they begin, on the ground; a posture is the mean
rotation of every joint but root and hips over a clip, and two of them differ by the mean angle over
joints.

Verdict, fixed beforehand (of turns, by their heading, until the walks called left and right turned
out to face ahead): "reproduced" if in all eight blends the path added to that of the manner is that
of the plain ones, side walk less straight, to a tenth of its length, and in seven of eight the
posture of the blend is nearer to that of the captured side walk in that manner than the plain side
walk's is; "refuted" if not. Nothing is drawn at random.
"""

import jax.numpy as jnp
import numpy as np
import remade

import jaxmotion as jm
from jaxmotion import quaternion

PAPER = "Lee & Shin 2001"
MANNERS = ("old", "tired", "chimpira", "masculinity")
SIDES = ("left", "right")
LEVELS = 6
TO, OF_ALL = 0.1, 7 / 8
UPPER = 2  # the first joint that is neither root nor hips


def make(seed: int) -> list[dict]:
    """A row a blend."""
    rows = [of_blend(side, manner) for side in SIDES for manner in MANNERS]
    missed = [row["path missed, share"] for row in rows]
    kept = [share <= TO for share in missed]
    lengths = [row["its length, share"] for row in rows]
    turned = [row["its direction off by, °"] for row in rows]
    styled = [row["blend to captured, °"] < row["plain to captured, °"] for row in rows]
    apart, plain = (
        float(np.mean([row[f"{what} to captured, °"] for row in rows]))
        for what in ("blend", "plain")
    )
    good = all(kept) and np.mean(styled) >= OF_ALL
    item = remade.told(
        PAPER,
        "Figure 8",
        "A limp with what a turn has beyond a walk is a limping turn.",
        f"Walking aside instead of turning: {sum(styled)} of {len(rows)} blends have a posture "
        "nearer to the captured side walk in that manner than the plain one has, "
        f"{apart:.1f}° against {plain:.1f}° in the mean. Of the paths added {sum(kept)} are "
        f"right to a tenth; they have {min(lengths):.2f} to {max(lengths):.2f} of the length and "
        f"are turned by up to {max(turned):.0f}°, for they are added in the hips' own axes, which "
        "swing and lean.",
        "reproduced" if good else "refuted",
        rows,
        "walks of bandai, straight, left and right, plain and in four manners, the straight ones "
        "in the timing of the plain side walk",
    )
    return [item]


def clips_of(side: str, manner: str) -> tuple[jm.Motion, jm.Motion, jm.Motion]:
    """Reference, side walk and manner, in step."""
    aside = remade.capture(f"bandai/walk-{side}_normal_001.bvh")
    straight = [remade.capture(f"bandai/walk_{style}_001.bvh") for style in ("normal", manner)]
    walk, styled = (jm.timing.align(clip, aside).motion for clip in straight)
    return from_origin(walk), from_origin(aside), from_origin(styled)


def from_origin(motion: jm.Motion) -> jm.Motion:
    """The hips, which hang on a root that stays where it is, begin above the origin."""
    hips = UPPER - 1
    start = motion.translations[0, hips].at[motion.skeleton.up_axis].set(0)
    return motion.with_transforms(motion.translations.at[:, hips].add(-start))


def of_blend(side: str, manner: str) -> dict:
    """Where a blend goes, and how it stands."""
    walk, aside, styled = clips_of(side, manner)
    blend = jm.multiresolution.blend(walk, aside, styled, LEVELS)
    captured = posture(remade.capture(f"bandai/walk-{side}_{manner}_001.bvh"))

    def to_captured(clip):
        return float(np.degrees(quaternion.distance(posture(clip), captured).mean()))

    wanted, added = path(aside) - path(walk), path(blend) - path(styled)
    cross = wanted[0] * added[1] - wanted[1] * added[0]
    return {
        "blend": f"{manner}, to the {side}",
        "path of the plain, heights": float(np.linalg.norm(wanted)) / height(aside),
        "path missed, share": float(np.linalg.norm(added - wanted) / np.linalg.norm(wanted)),
        "its length, share": float(np.linalg.norm(added) / np.linalg.norm(wanted)),
        "its direction off by, °": float(np.degrees(np.arctan2(abs(cross), wanted @ added))),
        "blend to captured, °": to_captured(blend),
        "plain to captured, °": to_captured(aside),
    }


def path(motion: jm.Motion) -> np.ndarray:
    """From the first place of the hips to the last, on the ground."""
    hips = np.asarray(jm.forward_kinematics(motion).positions)[:, UPPER - 1]
    return np.delete(hips[-1] - hips[0], motion.skeleton.up_axis)


def height(motion: jm.Motion) -> float:
    where = np.asarray(jm.forward_kinematics(motion).positions)
    return float(np.ptp(where[..., motion.skeleton.up_axis], axis=1).mean())


def posture(motion: jm.Motion):
    return quaternion.mean(jnp.asarray(motion.rotations)[:, UPPER:])


def draw(seed: int):
    """From above: the old walk, the plain side walk, and the blend."""
    walk, aside, styled = clips_of("left", "old")
    blend = jm.multiresolution.blend(walk, aside, styled, LEVELS)
    clips = {"straight, old": styled, "aside, plain": aside, "aside, old": blend}
    return jm.viz.plot_trajectories(clips)


if __name__ == "__main__":
    remade.main(make, draw, __doc__)
