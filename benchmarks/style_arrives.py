"""Does the style arrive? A classifier that took no part in a transfer says whose the result is.

    python benchmarks/style_arrives.py BANDAI XIA

BANDAI holds Bandai Namco's clips, ``walk_tired_001.bvh``: what is done, its style, a number; XIA
holds one walk in each style, ``angry_13_000.bvh``. Both in folders of their own.

Bandai: clips are cut at 128 frames, those that are shorter left out: one length is one compilation.
The source is a clip in the style "normal", the reference one of the same action in another;
of ``walk`` with numbers 1 and 2, of ``walk-left`` with number 1. The classifier knows one-second
windows, half overlapping, of clips that are neither: of all other clips of walk, walk-left and
walk-right (for pairs of walk number 1: number 2 of walk, and so on). Features of a window, all in
the frame of the body's yaw and place: mean and deviation of every joint's position and of its
velocity; the body's velocity and yaw rate. They are divided by their deviation over the windows it
knows; a window is of the style whose mean window is nearest. Positions and velocities come from
forward kinematics: they are not what is carried over, joint by joint.

Xia: the source is the first half of "neutral", references are first halves of the others; the
classifier knows half-second windows of the second halves. A step or two each: a glimpse, no more.

Printed: for each way of transfer the share of windows that are named after the reference, after the
source, after another; and the same for the untouched references and sources: what is to be had.

    euler       Eq. 5 of Wu et al.: means and deviations of Euler angles, unwrapped, in the file's
                order; the body's channels as ours
    scalar, covariance, left, tempo   ours, as named in ``jaxmotion.style.transfer_style``
    per level   deviations in five bands of the rotation vectors about the mean, each scaled by its
                own ratio (Gaussians of 1, 2, 4, 8 frames)

Seeds: none is needed.
"""

import argparse
import itertools
import re
from pathlib import Path

import jax
import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion._posture import upright
from jaxmotion.style.root import encode

FRAMES = 128
WIDTHS = (1.0, 2.0, 4.0, 8.0)


def turns(q):
    return Rotation.from_quat(np.roll(np.reshape(np.asarray(q, float), (-1, 4)), -1, axis=-1))


def features(motion, seconds=1.0):
    """Of every window, half overlapping, f[W, F]."""
    pose = jm.forward_kinematics(motion)
    stands = upright(motion)
    channels, _ = encode(motion, stands)
    body = motion.body_joint
    forward = np.asarray(jm.facing_direction(motion), float)
    angle = np.arctan2(forward[:, 0], forward[:, 2])
    place = np.asarray(pose.positions, float)
    level = place[:, body].copy()
    level[:, 1] = 0
    local = place[:, body:] - level[:, None]
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, z = local[..., 0], local[..., 2]
    local = np.stack([c * x - s * z, local[..., 1], s * x + c * z], -1)
    speed = np.gradient(local, float(motion.frame_time), axis=0)
    rates = np.asarray(channels, float)[:, :3]
    rows = []
    window = min(round(seconds * float(motion.fps)), motion.num_frames)
    for start in range(0, motion.num_frames - window + 1, window // 2):
        part = slice(start, start + window)
        flat = [x[part].reshape(window, -1) for x in (local, speed)]
        rows.append(
            np.concatenate(
                [f(x, axis=0) for x in flat for f in (np.mean, np.std)] + [rates[part].mean(0)]
            )
        )
    return np.array(rows)


class Nearest:
    """The style whose mean window is nearest, of windows by style."""

    def __init__(self, windows):
        self.styles = sorted(windows)
        every = np.concatenate([windows[style] for style in self.styles])
        self.scale = every.std(axis=0) + 1e-9
        self.means = np.stack([windows[style].mean(axis=0) for style in self.styles])

    def __call__(self, rows):
        away = (rows[:, None] - self.means) / self.scale
        return [self.styles[k] for k in np.argmin(np.sum(away**2, -1), axis=1)]


def own_path(source, reference, rotations):
    """Other rotations below the body, which goes as ours does."""
    ours = jm.style.transfer_style(source, reference, keep_contacts=False).motion
    q, body = np.array(ours.rotations), source.body_joint
    q[:, body + 1 :] = rotations[:, body + 1 :]
    return ours.with_transforms(rotations=q)


def angles_of(motion, joint, order=None):
    """Unwrapped Euler angles f[T, 3] in the file's order, or this one, and the order."""
    if order is None:
        channels = motion.skeleton.channels[joint]
        order = "".join(name[0] for name in channels if "rot" in name.lower())
        order = order.upper() if len(order) == 3 else "ZXY"
    return np.unwrap(turns(motion.rotations[:, joint]).as_euler(order), axis=0), order


def euler(source, reference, order=None):
    q = np.array(source.rotations)
    for joint in range(q.shape[1]):
        own, taken = angles_of(source, joint, order)
        other, _ = angles_of(reference, joint, order)
        ratio = other.std(axis=0) / np.maximum(own.std(axis=0), 1e-3)
        turned = ratio * (own - own.mean(axis=0)) + other.mean(axis=0)
        q[:, joint] = np.roll(Rotation.from_euler(taken, turned).as_quat(), 1, axis=-1)
    return own_path(source, reference, q)


def bands(v):
    """Five that sum up to v f[T, 3]."""
    smooth = [v, *(gaussian_filter1d(v, width, axis=0, mode="nearest") for width in WIDTHS)]
    return [a - b for a, b in itertools.pairwise(smooth)] + [smooth[-1]]


def per_level(source, reference):
    styles = [jm.style.motion_style(clip) for clip in (source, reference)]
    q = np.array(source.rotations)
    for joint in range(q.shape[1]):
        means = [turns(style.mean[joint]) for style in styles]
        away = [
            (mean.inv() * turns(clip.rotations[:, joint])).as_rotvec()
            for mean, clip in zip(means, (source, reference), strict=True)
        ]
        total = 0
        for own, other in zip(*map(bands, away), strict=True):
            size = [np.sqrt(np.mean(np.sum((x - x.mean(0)) ** 2, -1))) for x in (own, other)]
            total = total + size[1] / max(size[0], 1e-4) * own
        kept = (means[1].inv() * means[0]).apply(total)
        q[:, joint] = np.roll((means[1] * Rotation.from_rotvec(kept)).as_quat(), 1, axis=-1)
    return own_path(source, reference, q)


def ours(**options):
    def way(source, reference):
        return jm.style.transfer_style(source, reference, keep_contacts=False, **options).motion

    return way


WAYS = {
    "source, untouched": lambda source, reference: source,
    "reference, untouched": lambda source, reference: reference,
    "euler": euler,
    "scalar": ours(),
    "scalar, no warp": ours(warp=None),
    "scalar, left": ours(side="left"),
    "covariance": ours(deviation="covariance"),
    "scalar, tempo": ours(tempo=True),
    "covariance, tempo": ours(deviation="covariance", tempo=True),
    "per level": per_level,
}


def fastest(motion):
    """Degrees a second, of the joint that turns fastest."""
    q = np.asarray(motion.rotations, float)
    cosine = np.abs(np.sum(q[1:] * q[:-1], axis=-1))
    return np.degrees(2 * np.arccos(np.clip(cosine, 0, 1))).max() * float(motion.fps)


def bandai(folder):
    """(style, source, reference, classifier, seconds of a window) of every pair."""
    clips = {}
    for path in sorted(folder.glob("walk*.bvh")):
        action, style, number = re.fullmatch(r"(.+)_(.+)_(\d+)", path.stem).groups()
        clip = jm.load(path, dtype=np.float64)
        if clip.num_frames >= FRAMES:
            clips[action, style, int(number)] = clip[:FRAMES]
    rows = {key: features(clip) for key, clip in clips.items()}
    styles = sorted({style for _, style, _ in clips} - {"normal"})
    for action, number in (("walk", 1), ("walk", 2), ("walk-left", 1)):
        windows = {}
        for (other, style, n), found in rows.items():
            if (other, n) != (action, number):
                windows.setdefault(style, []).append(found)
        nearest = Nearest({style: np.concatenate(found) for style, found in windows.items()})
        for style in styles:
            if {(action, "normal", number), (action, style, number)} <= set(clips):
                source, reference = (clips[action, name, number] for name in ("normal", style))
                yield style, source, reference, nearest, 1.0


def xia(folder):
    """As :func:`bandai`."""
    halves = {}
    for path in sorted(folder.glob("*.bvh")):
        clip = jm.load(path, dtype=np.float64)
        middle = clip.num_frames // 2
        halves[path.stem.split("_")[0]] = clip[:middle], clip[middle:]
    seconds = 0.5
    nearest = Nearest({style: features(late, seconds) for style, (_, late) in halves.items()})
    for style, (early, _) in halves.items():
        if style != "neutral":
            yield style, halves["neutral"][0], early, nearest, seconds


def told(name, pairs, normal):
    """Run every way over the pairs and print what came of it."""
    counts = {way: np.zeros(3) for way in WAYS}
    speeds = {way: [] for way in WAYS}
    named, styles = {}, []
    for style, source, reference, nearest, seconds in pairs:
        styles.append(style)
        most = max(fastest(source), fastest(reference))
        for way, change in WAYS.items():
            result = change(source, reference)
            names = nearest(features(result, seconds))
            hits = [np.mean([x == which for x in names]) for which in (style, normal)]
            counts[way] += [*hits, 1 - sum(hits)]
            speeds[way].append(fastest(result) / most)
            for found in names:
                named[way, style, found] = named.get((way, style, found), 0) + 1
    total = len(styles)
    print(f"\n{name}, {total} pairs: windows named after the reference, the source, another;")
    print("fastest joint over the inputs', median and most")
    for way, count in counts.items():
        share = " ".join(f"{100 * x / total:5.0f} %" for x in count)
        print(f"{way:22} {share}   {np.median(speeds[way]):5.2f} {max(speeds[way]):5.2f}")
    names = [*sorted(set(styles)), normal]
    for way in ("reference, untouched", "euler", "scalar", "covariance, tempo", "per level"):
        print(f"\n{way}: rows are references, columns what windows were named, %")
        print(" " * 13 + " ".join(f"{name[:5]:>5}" for name in names))
        for style in names[:-1]:
            row = np.array([named.get((way, style, name), 0) for name in names], float)
            row *= 100 / row.sum()
            print(f"{style:12} " + " ".join(f"{x:5.0f}" for x in row))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bandai", type=Path)
    parser.add_argument("xia", type=Path)
    folders = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    told("Bandai Namco", bandai(folders.bandai), "normal")
    told("Xia", xia(folders.xia), "neutral")


if __name__ == "__main__":
    main()
