"""Are errors found, and are they repaired? Self-similarity cleaning beside its baselines.

    python benchmarks/cleaning_quality.py BANDAI [--seeds N] [--styles chosen|held|all]

BANDAI holds Bandai Namco's clips, ``walk_tired_001.bvh``. Those of walk, run, walk-left and
walk-right are cleaned, at their 30 frames a second, each beside the 8 others of its half that are
most like it (``jm.cleaning.most_alike``). The halves are by style:

    chosen   active, angry, childish, chimpira, feminine, happy
    held     masculinity, normal, old, proud, sad, tired

Definitions and scales were chosen on "chosen" and looked at on "held" while they were: both are in
sample, but nothing is set by the clip. Errors of each clip, on all joints but the body, N seeds:

    hard     one each of offset, limit, hold and spike (``inject_errors(runs=1)``)
    ramp     4 offsets of 0.5 to 1.5 rad that come and go over 5 frames
    small    the same of 0.2 to 0.5 rad
    fill     4 gaps of 12 to 30 frames filled the short way
    noisy    4 holds of 12 to 30 frames with 0.003 rad of noise

A word of 15 frames is found when any joint in it is. Recall is by the largest change in the word,
radians; precision is at a prevalence of 12 % of the words, false alarms being of all words without
error, in clean and in damaged clips; 5 and 95 % of 400 bootstraps over clips. Repairs are scored by
the mean angle in the joint-frames in error, the largest, and Eq. 2 of Aristidou et al. 2018.
"""

import argparse
import sys
from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxmotion as jm
from jaxmotion.cleaning.missing import bridged
from jaxmotion.cleaning.words import word_starts

CHOSEN = ["active", "angry", "childish", "chimpira", "feminine", "happy"]
HELD = ["masculinity", "normal", "old", "proud", "sad", "tired"]
ACTIONS = "walk", "run", "walk-left", "walk-right"
LEAST = 60  # frames
SIZES = ((0.1, 0.3), (0.3, 0.5), (0.5, 9.0))
TITLES = "mean", "max", "Eq.2 mean", "Eq.2 max", "else"
SOFT = "ramp", "small", "fill", "noisy"


def load(folder, styles):
    clips = {}
    for action in ACTIONS:
        for path in sorted(folder.glob(f"{action}_*.bvh")):
            if path.stem.split("_")[1] in styles:
                clips[path.stem] = jm.load(path, dtype=np.float32)
    return clips


def damaged(motion, kind, key):
    joints = range(2, motion.num_joints)
    if kind == "clean":
        none = jnp.zeros(motion.rotations.shape[:2])
        return jm.samples.Corrupted(motion, none > 0, none)
    if kind == "hard":
        return jm.samples.inject_errors(motion, key, runs=1, joints=joints)
    if kind == "ramp":
        return jm.samples.offset_joints(motion, key, runs=4, joints=joints, ramp=5, length=(12, 30))
    if kind == "small":
        return jm.samples.offset_joints(
            motion, key, runs=4, joints=joints, ramp=5, length=(12, 30), magnitude=(0.2, 0.5)
        )
    if kind == "fill":
        return jm.samples.fill_gaps(motion, key, runs=4, joints=joints)
    return jm.samples.freeze_joints(
        motion, key, runs=4, joints=joints, length=(12, 30), noise=0.003
    )


def trials(clips, seeds, stride):
    """Damaged clips, of every so many-th: what each is, and its context."""
    others = {name: [x for x in clips if x != name] for name in clips}

    @cache
    def alike(name):
        found = jm.cleaning.most_alike(clips[name], [clips[x] for x in others[name]])
        return [others[name][i] for i in found]

    @cache
    def levels(name):
        return jm.cleaning.clean_levels(clips[name], [clips[x] for x in alike(name)])

    long = [name for name, clip in clips.items() if clip.num_frames >= LEAST]
    for name in long[::stride]:
        clip = clips[name]
        context = [clips[x] for x in alike(name)]
        usual = [levels(x) for x in alike(name)]
        jax.clear_caches()  # every length compiles its own errors and baselines
        print(name, file=sys.stderr)
        for kind in ("clean", "hard", *SOFT):
            for seed in range(1 if kind == "clean" else seeds):
                key = jax.random.fold_in(jax.random.key(seed), sum(name.encode()))
                case = damaged(clip, kind, key)
                yield name, kind, clip, case, context, usual


def methods(case, context, usual):
    found = jm.cleaning.detect_errors(case.motion, context, levels=usual)
    weights = jm.smoothing.outlier_weights(case.motion)
    yield "ours, all detectors", found.mask
    yield from ((f"  {name}", mask) for name, mask in found.by.items() if name != "missing")
    for rule in ("limits", "rates", "both"):
        yield f"baseline {rule}", jm.cleaning.baseline_errors(case.motion, context, rule)
    yield "outlier_weights ≤ 0.1", weights <= 0.1
    map_ = jm.cleaning.digression_map(case.motion, context, k=5, normalise="row_mean")
    yield "the paper's MDM > 0.5", map_.mdm > 0.5
    for metric in ("pose", "points"):
        map_ = jm.cleaning.digression_map(case.motion, context, metric=metric)
        yield f"map, {metric} > 0.5 rad", map_.mdm > 0.5


def words(mask, case, size):
    """Of every word: found, in error, and its largest change."""
    mask, truth = np.asarray(mask), np.asarray(case.mask)
    frames = word_starts(len(mask), 15, 5)[:, None] + np.arange(15)
    change = np.where(truth, size, 0).max(axis=1)
    return [x[frames].max(axis=1) for x in (mask.any(axis=1), truth.any(axis=1), change)]


def summed(rows):
    """Recall by kind and size, and false alarms, of rows (clip, kind, found, wrong, change)."""
    kind, found, wrong, change = (np.concatenate([row[i] for row in rows]) for i in range(1, 5))

    def recall(kinds, low, high):
        chosen = wrong & np.isin(kind, kinds) & (change >= low) & (change < high)
        return found[chosen].mean() if chosen.any() else np.nan

    alarms = found[~wrong].mean()
    hard = recall(["hard"], 0.1, 9)
    precision = 0.12 * hard / (0.12 * hard + 0.88 * alarms) if hard else np.nan
    soft = [recall(SOFT, 0.3, 0.5), recall(SOFT, 0.5, 9)]
    by_kind = [recall([k], low, high) for k in ("hard", *SOFT) for low, high in SIZES]
    return [hard, recall(["hard"], 0.3, 9), *soft, precision, alarms, *by_kind]


def bootstrapped(rows, rng):
    names = sorted({row[0] for row in rows})
    of_clip = {name: [row for row in rows if row[0] == name] for name in names}
    every = []
    for _ in range(400):
        drawn = rng.choice(names, len(names))
        every.append(summed([row for name in drawn for row in of_clip[name]])[:5])
    return np.nanquantile(every, [0.05, 0.95], axis=0)


def repairs(clip, case, context, usual=None):
    """By method: changes in error, the largest, and Eq. 2; where errors are found, if what is
    ``usual`` is given."""
    truth = np.asarray(case.mask)

    def filled(mask):
        made = bridged(np.asarray(case.motion.rotations), ~np.asarray(mask))
        return case.motion.with_transforms(rotations=made)

    made = {
        "nothing": (case.motion, truth),
        "slerp, true mask": (filled(truth), truth),
        "denoise": (jm.denoise(case.motion), truth),
        "denoise robust": (jm.denoise(case.motion, robust=True), truth),
    }
    if usual is not None:
        auto = jm.cleaning.repair(case.motion, context, levels=usual)
        made["slerp, found mask"] = filled(auto.mask), auto.mask
        made["found mask"] = auto.motion, auto.mask
    for method in ("median", "medoid", "nearest_end"):
        fixed = jm.cleaning.repair(case.motion, context, mask=truth, method=method)
        made[f"{method}, true mask"] = fixed.motion, truth
    for name, (motion, mask) in made.items():
        yield name, off(clip, case, motion, mask)


def off(clip, case, motion, mask):
    """How far a motion is from the clip: ``TITLES``."""
    truth = np.asarray(case.mask)
    angle = jm.metrics.turn(clip.rotations, motion.rotations)
    inside = truth | np.asarray(mask)
    error = jm.metrics.pose_error(clip, motion)
    outside = jm.metrics.turn(case.motion.rotations, motion.rotations)[~inside].max()
    return [angle[truth].mean(), angle[inside].max(), error.mean(), error.max(), outside]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--styles", choices=("chosen", "held", "all"), default="all")
    parser.add_argument("--stride", type=int, default=1, help="every so many-th clip only")
    args = parser.parse_args()
    halves = {"chosen": CHOSEN, "held": HELD}
    halves = halves if args.styles == "all" else {args.styles: halves[args.styles]}
    rows, fixed = {}, {}
    for styles in halves.values():
        drawn = trials(load(args.folder, styles), args.seeds, args.stride)
        for name, kind, clip, case, context, usual in drawn:
            size = np.asarray(case.change)
            for method, mask in methods(case, context, usual):
                found = words(mask, case, size)
                row = (name, np.full(len(found[0]), kind), *found)
                rows.setdefault(method, []).append(row)
            if kind == "hard":
                for method, values in repairs(clip, case, context, usual):
                    fixed.setdefault(method, []).append(values)
    titles = ["hard≥.1", "hard≥.3", "soft.3-.5", "soft≥.5", "precision", "alarms"]
    print(f"{'':24s}" + "".join(f"{x:>11s}" for x in titles))
    rng = np.random.default_rng(0)
    for method, found in rows.items():
        print(f"{method:24s}" + "".join(f"{x:11.3f}" for x in summed(found)[:6]))
        if method.startswith("ours") or method.strip() == "digression":
            for share, line in zip(("5 %", "95 %"), bootstrapped(found, rng), strict=True):
                print(f"{share:>24s}" + "".join(f"{x:11.3f}" for x in line))
            print("    by kind, .1-.3 .3-.5 ≥.5:", np.round(summed(found)[6:], 2))
    print(f"\n{'':24s}" + "".join(f"{x:>11s}" for x in TITLES))
    for method, values in fixed.items():
        print(f"{method:24s}" + "".join(f"{x:11.4f}" for x in np.mean(values, axis=0)))


if __name__ == "__main__":
    main()
