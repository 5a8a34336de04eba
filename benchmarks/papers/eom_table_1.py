"""Table 1 of Eom et al. 2019: seconds for the smoother, whole clips and windows, row by row.

    python benchmarks/papers/eom_table_1.py [--json FILE]

The paper printed seconds of one thread of an i7-5930K for clips of its own: "whole", all frames in
one problem, and "windowed", 120 frames at a time. Here real captures have the printed numbers of
frames, by cutting captures that are longer (none is repeated), and at least the printed degrees of
freedom, by leaving out the joints that turn least: 18 joints and a root's position are the 57 of
the biped; 50 joints and a root are 153, for the 151 of the dog, whose place a dancer takes. Rows of
few keys have them evenly spread over the result's frames, rows of time warps where the displacement
hands them out (frame i lands on i + round(added · share of the turning up to i)).

Timed, in float64, the median of warm calls; the first call, which compiles, apart:

    Eq. 11   the smoother of the whole clip, all joints and the root: ``smooth_motion`` under
             ``jit``, and called as it is; λσ = 10, for keys and warps 0.01
    Eq. 9    the exact smoother on rotations, ``smoothing.geodesic``, of as many frames as given
    layers   ``decompose``, the search of the base's λ and σ included, then ``synthesize``; not of
             the time warps, for which no windowed time is printed

Verdict, fixed beforehand. Of the smoother: "better" if Eq. 11 under ``jit`` takes less than every
printed time above 0.01 s, else "refuted"; how many rows are 1000 times as fast as whole is told.
Of layers: "better" if they take less than every printed windowed time above 0.01 s (a time warp has
only a whole one), else "refuted". Times of other machines of other years are an order of
magnitude, no race. No seed: nothing is drawn.
"""

import statistics
import time

import jax
import numpy as np
import remade

import jaxmotion as jm

PAPER = "Eom et al. 2019"
BUSY = 0.01  # seconds, printed, from which a row counts
AT_LEAST = 1000.0
FPS = 24.0
FULL, SPARSE = 10.0, 0.01  # λσ
BIPED, DOG = 18, 50  # joints
# Row, frames given and made, joints, printed seconds whole and windowed, capture, its first frame.
ROWS = (
    ("body building", 2526, 2526, BIPED, 77839.9, 5.1, "cmu/01_01.amc", 0),
    ("sword", 330, 330, BIPED, 9.5, 2.0, "cmu/02_07.amc", 60),
    ("dog", 200, 200, DOG, 1.3, 0.9, "cmu_dance/005_06.bvh", 120),
    ("kick", 230, 230, BIPED, 3.2, 0.6, "bandai/kick_normal_001.bvh", 30),
    ("parkour", 200, 200, BIPED, 1.0, 0.3, "cmu/01_01.amc", 1000),
    ("dance", 560, 560, BIPED, 77.9, 2.7, "bandai/dance-short_normal_001.bvh", 0),
    ("throwing", 360, 360, BIPED, 17.7, 1.7, "cmu/02_05.amc", 0),
    ("airplane", 8, 40, BIPED, 0.001, 0.001, "cmu/02_06.amc", 0),
    ("ballet", 34, 680, BIPED, 6.0, 6.0, "bandai/dance-short_normal_001.bvh", 600),
    ("kick, warped", 230, 286, BIPED, 3.9, None, "bandai/kick_normal_001.bvh", 30),
    ("diving catch, warped", 211, 261, BIPED, 3.0, None, "cmu/01_01.amc", 1300),
    ("jump, warped", 79, 139, BIPED, 0.09, None, "cmu/02_04.amc", 200),
)


def make(seed: int) -> list[dict]:
    """Both halves of the table."""
    solved, layered = [], []
    for row in ROWS:
        one, other = of_row(*row)
        solved.append(one)
        layered += [other] if other else []
        print(*remade.aligned([one]), sep="\n", flush=True)
    return [of_solves(solved), of_layers(layered)]


def of_row(name, given, made, joints, whole, windowed, file, start):
    """What a row took."""
    motion = with_joints(remade.capture(file), joints)
    index = None
    if name in ("airplane", "ballet"):
        index = np.round(np.linspace(0, made - 1, given)).astype(int)
        motion = motion[start : start + made]
        keys = motion.translations[index], motion.rotations[index]
        motion = motion.with_transforms(*keys)
    else:
        motion = motion[start : start + given]
        if made > given:
            index = warped(np.asarray(motion.rotations), made)
    assert len(motion) == given
    product = FULL if index is None else SPARSE

    def smooth(motion):
        return jm.smoothing.smooth_motion(motion, product, 1.0, index=index, num_frames=made)

    compiled = jax.jit(lambda motion: arrays_of(smooth(motion)))
    solve = timed(lambda: compiled(motion))
    eager = timed(lambda: arrays_of(smooth(motion)))
    exact = {"warm": None}
    if index is None:
        exact = timed(lambda: jm.smoothing.geodesic(motion.rotations, product, 1.0).mean)
    size = {
        "clip": name,
        "frames": f"{given}" if made == given else f"{given} → {made}",
        "DoF": 3 + 3 * joints,
        "printed: whole, s": whole,
        "windowed, s": windowed,
    }
    seconds = solve["warm"]
    of_solve = {
        "Eq. 11, ms": 1e3 * seconds,
        "whole / ours": whole / seconds,
        "windowed / ours": windowed and windowed / seconds,
        "without jit, ms": 1e3 * eager["warm"],
        "Eq. 9, ms": exact["warm"] and 1e3 * exact["warm"],
        "first call, s": solve["first"],
    }
    if windowed is None:
        return size | of_solve, None
    result = motion if index is None else smooth(motion)
    apart = timed(lambda: jm.decompose(result))
    layers = jm.decompose(result)
    together = timed(lambda: arrays_of(jm.synthesize(layers, 2.0)))
    both = apart["warm"] + together["warm"]
    of_layers = {
        "decompose, ms": 1e3 * apart["warm"],
        "synthesize, ms": 1e3 * together["warm"],
        "whole / both": whole / both,
        "windowed / both": windowed / both,
        "first call, s": apart["first"],
    }
    return size | of_solve, size | of_layers


def of_solves(rows: list[dict]) -> dict:
    """The half of the smoother."""
    counted = [row for row in rows if row["printed: whole, s"] > BUSY]
    ratios = [row["whole / ours"] for row in counted]
    windowed = [row["windowed / ours"] for row in counted if row["windowed / ours"]]
    enough = sum(ratio >= AT_LEAST for ratio in ratios)
    short = ", ".join(
        f"{row['clip']} {row['whole / ours']:.0f}"
        for row in counted
        if row["whole / ours"] < AT_LEAST
    )
    return remade.told(
        PAPER,
        "Table 1, smoother",
        "Solving all frames at once takes 0.001 s to 77840 s, so that long clips need windows.",
        f"A whole clip takes {min(r['Eq. 11, ms'] for r in rows):.2g} to "
        f"{max(r['Eq. 11, ms'] for r in rows):.2g} ms: of the {len(counted)} rows above {BUSY} s, "
        f"{enough} are at least {AT_LEAST:.0f} times as fast as printed whole"
        + (f" (but {short})" if short else "")
        + f", all at least {min(windowed):.0f} times as fast as printed in windows.",
        "better" if min(ratios) > 1 and min(windowed) > 1 else "refuted",
        rows,
        "captures of bandai, cmu and cmu_dance cut to the printed lengths",
    )


def of_layers(rows: list[dict]) -> dict:
    """The half of the layers."""
    counted = [row["windowed / both"] for row in rows if row["windowed, s"] > BUSY]
    whole = [row["whole / both"] for row in rows if row["printed: whole, s"] > BUSY]
    return remade.told(
        PAPER,
        "Table 1, layers",
        "Layers of whole clips are out of reach but for windows.",
        f"With the search of the base they take "
        f"{max(r['decompose, ms'] + r['synthesize, ms'] for r in rows):.0f} ms at most, and at "
        f"least {min(counted):.0f} times as fast as printed in windows, {min(whole):.0f} times as "
        "whole, in rows above 0.01 s.",
        "better" if min(counted) > 1 and min(whole) > 1 else "refuted",
        rows,
        "the same",
    )


def with_joints(motion: jm.Motion, count: int) -> jm.Motion:
    """The root's position and the joints that turn furthest, the root among them; of a joint that
    is left out, what hangs on it hangs on its parent."""
    skeleton, q = motion.skeleton, motion.rotations
    turned = np.asarray(jm.quaternion.distance(q[:1], q)).max(axis=0)
    moving = np.array(skeleton.parents) == -1
    moving[list(motion.translated_joints[-1:])] = True  # where a static root carries the hips
    order = np.argsort(-np.where(moving, np.inf, turned), kind="stable")
    kept = sorted(order[:count].tolist())
    parents = []
    for joint in kept:
        parent = skeleton.parents[joint]
        while parent >= 0 and parent not in kept:
            parent = skeleton.parents[parent]
        parents.append(kept.index(parent) if parent >= 0 else -1)
    part = jm.Skeleton(
        [skeleton.names[j] for j in kept], parents, np.asarray(skeleton.offsets)[kept]
    )
    return jm.Motion.from_root(
        part, motion.root_positions, motion.rotations[:, np.array(kept)], motion.frame_time
    )


def warped(q: np.ndarray, frames: int) -> np.ndarray:
    """Where each frame lands, more of them being handed out where joints turn more."""
    speed = np.asarray(jm.quaternion.distance(q[:-1], q[1:])).sum(axis=1)
    share = np.concatenate([[0.0], np.cumsum(speed) / speed.sum()])
    return np.arange(len(q)) + np.round((frames - len(q)) * share).astype(int)


def arrays_of(motion: jm.Motion):
    return motion.translations, motion.rotations


def timed(call, least: int = 5, most: int = 41, enough: float = 0.4) -> dict:
    """Seconds of the first call and the median of those after it."""

    def once():
        begun = time.perf_counter()
        jax.block_until_ready(call())
        return time.perf_counter() - begun

    first, warm = once(), []
    while len(warm) < least or (len(warm) < most and sum(warm) < enough):
        warm.append(once())
    return {"first": first, "warm": statistics.median(warm)}


if __name__ == "__main__":
    remade.main(make, doc=__doc__)
