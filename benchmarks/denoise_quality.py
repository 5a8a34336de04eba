"""What ``jm.denoise`` does to real captures, in one table.

    python benchmarks/denoise_quality.py [--quick] [--verbose] [--prior]
                                         [--json FILE] [--against FILE]

Captures: ``JAXMOTION_TEST_DATA``, else ``../shared/data`` beside the project: every second file of
``bandai/*.bvh`` sorted by name, all of ``cmu/*.amc`` and ``xia/*.bvh``; float64, cut at 2048
frames; ``--quick`` takes every sixth of those. ``jm.denoise`` has its defaults throughout; with
``--prior`` also what ``smoothing.motion_prior`` learned from all files of the source of other
styles (``bandai``, ``xia``) or performers (``cmu``), none of the clip's own.

What is done to a clip, each from its own seed (``SEED``, the clip's name and the kind of noise):

    clean          nothing
    white S        q ⊗ exp(v), every component of v Gaussian of deviation S rad, each frame anew
    AR(1) 0.02     the same with vₜ = ½·vₜ₋₁ + √¾·eₜ, 0.02 rad
    jitter 0.02    v of eight sines of random phase and of frequencies from 2 to 4 Hz, 0.02 rad
    dropped 10 %   a tenth of the frames, never the first, repeat the last frame kept
    quantised 1°   Euler angles ZXY rounded to whole degrees

An *error* is the mean distance of all joints in all frames from where the clean clip has them, by
forward kinematics in NumPy that shares nothing with the library; *before* and *after* are those of
what ``denoise`` is given and gives. A *mean* of ratios is the geometric one over clips, *worst* the
largest of a clip; a clip is *made worse* if after exceeds before by more than a thousandth. The
*best Butterworth* has order 2, runs forward and backward over quaternions of aligned signs, and has
the one cut-off of ``CUTOFFS`` that fits the clip best, known from the truth; it leaves translations
as they are, which have no noise. A *change* is the angle by which a local rotation of a clean clip
was turned. A move is *sudden* where a joint's angular second difference, |wₜ₊₁ − wₜ| of the
rotation vectors w from frame to frame, exceeds 10° and 20 times its median over the clean clip; its
error is the mean angle of that joint's local rotation from the clean one, over all frames within 3
of a sudden one of all clips, at white noise of 0.02 rad.

Seconds are those of a fresh process, beside those of the NumPy kinematics above on the same clip,
which tell how fast the machine is just then. ``--against`` adds "×r" to every figure: this run's
over that of the JSON of a former run on the same clips or more.
"""

import argparse
import functools
import json
import os
import time
import zlib
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import jax
import numpy as np
from scipy.signal import butter, filtfilt
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.smoothing import MotionPrior, motion_prior

SEED = 7
MOST_FRAMES = 2048
SOURCES = {"bandai": ("bandai/*.bvh", 2), "cmu": ("cmu/*.amc", 1), "xia": ("xia/*.bvh", 1)}
DANCE = "bandai/dance-short_normal_001.bvh"  # what is timed
CUTOFFS = np.geomspace(0.01, 0.96, 32)  # shares of half the frame rate
BENT = 3.0  # degrees from which a clean clip counts as changed
WORSE = 1.001  # after over before from which a clip counts as made worse
SUDDEN, OUTSTANDING, NEAR = 10.0, 20.0, 3  # degrees, times the median, frames
TOES, OTHERS = "toes", "other joints"


# Rotations f[T, J, 4], wxyz, by SciPy.


def rotations(q: np.ndarray) -> Rotation:
    return Rotation.from_quat(np.roll(q, -1, axis=-1).reshape(-1, 4))


def quaternions(turns: Rotation, shape: tuple[int, ...]) -> np.ndarray:
    return np.roll(turns.as_quat(), 1, axis=-1).reshape(shape)


def angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Degrees between rotations: |a − b| = 2·sin(θ/4) and |a + b| = 2·cos(θ/4), or −b for b."""
    ends = np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)
    return np.degrees(4 * np.arctan2(np.minimum(*ends), np.maximum(*ends)))


def positions(parents: tuple[int, ...], translations: np.ndarray, q: np.ndarray) -> np.ndarray:
    """World positions f[J, T, 3] of a clip's local transforms, parents before their children."""
    local = np.moveaxis(rotations(q).as_matrix().reshape(*q.shape[:2], 3, 3), 1, 0)
    offsets = np.moveaxis(translations, 1, 0)[..., None]
    turned, placed = [local[0]], [offsets[0]]
    for turn, offset, parent in zip(local[1:], offsets[1:], parents[1:], strict=True):
        turned.append(turned[parent] @ turn)
        placed.append(placed[parent] + turned[parent] @ offset)
    return np.stack(placed)[..., 0]


# Noise: what makes a clip's translations and rotations worse.


def turned_by(make: Callable) -> Callable:
    """Rotation vectors of ``make(rng, shape, rate)``, of deviation 1, applied to every joint."""

    def corrupt(amount: float) -> Callable:
        def corrupted(rng, p, q, rate):
            v = amount * make(rng, (*q.shape[:2], 3), rate)
            return p, quaternions(rotations(q) * Rotation.from_rotvec(v.reshape(-1, 3)), q.shape)

        return corrupted

    return corrupt


@turned_by
def white(rng, shape, rate):
    return rng.standard_normal(shape)


@turned_by
def coloured(rng, shape, rate):
    v = rng.standard_normal(shape)
    for t in range(1, len(v)):
        v[t] = 0.5 * v[t - 1] + np.sqrt(0.75) * v[t]
    return v


@turned_by
def jitter(rng, shape, rate):
    hertz = rng.uniform(2, 4, (8, 1, *shape[1:]))
    phase = rng.uniform(0, 2 * np.pi, hertz.shape)
    seconds = np.arange(shape[0])[:, None, None] / rate
    return np.sum(np.sin(2 * np.pi * hertz * seconds + phase), axis=0) / 2  # √(2/8)


def dropped(rng, p, q, rate):
    frames = np.arange(len(q))
    frames[1 + rng.choice(len(q) - 1, round(len(q) / 10), replace=False)] = 0
    kept = np.maximum.accumulate(frames)
    return p[kept], q[kept]


def quantised(rng, p, q, rate):
    whole = np.round(rotations(q).as_euler("ZXY", degrees=True))
    return p, quaternions(Rotation.from_euler("ZXY", whole, degrees=True), q.shape)


WHITE = {f"white {amount:g}": white(amount) for amount in (0.005, 0.02, 0.06)}
OTHER = {
    "AR(1) 0.02": coloured(0.02),
    "jitter 0.02": jitter(0.02),
    "dropped 10 %": dropped,
    "quantised 1°": quantised,
}
FLICKED = "white 0.02"  # the noise under which sudden moves are looked at


# Measures of one clip.


def best_butterworth(q: np.ndarray, error: Callable[[np.ndarray], float]) -> tuple[float, float]:
    """The least error of all cut-offs, and the cut-off as a share of half the frame rate."""
    flips = np.where(np.sum(q[1:] * q[:-1], axis=-1) < 0, -1.0, 1.0)
    aligned = np.concatenate([q[:1], q[1:] * np.cumprod(flips, axis=0)[..., None]])

    def filtered(cutoff):
        smooth = filtfilt(*butter(2, cutoff), aligned, axis=0)
        return smooth / np.linalg.norm(smooth, axis=-1, keepdims=True)

    return min((error(filtered(cutoff)), float(cutoff)) for cutoff in CUTOFFS)


def near_sudden(q: np.ndarray) -> np.ndarray:
    """The frames within 3 of a sudden move of a clean clip, by joint, b[T, J]."""
    steps = rotations(q[:-1]).inv() * rotations(q[1:])
    w = np.degrees(steps.as_rotvec()).reshape(len(q) - 1, -1, 3)
    change = np.linalg.norm(np.diff(w, axis=0), axis=-1)
    found = np.zeros(q.shape[:2], bool)
    found[1:-1] = change > np.maximum(SUDDEN, OUTSTANDING * np.median(change, axis=0))
    padded = np.pad(found, ((NEAR, NEAR), (0, 0)))
    return np.any([padded[k : k + len(q)] for k in range(2 * NEAR + 1)], axis=0)


def manner(path: Path) -> str:
    """The style of a clip, or in ``cmu`` the performer."""
    words = path.stem.split("_")
    return words[1] if path.parent.name == "bandai" else words[0]


@functools.cache
def prior_without(folder: Path, pattern: str, left_out: str) -> MotionPrior:
    """What a source's clips of any other manner teach."""
    others = [path for path in sorted(folder.glob(pattern)) if manner(path) != left_out]
    return motion_prior(read(path) for path in others)


def read(path: Path) -> jm.Motion:
    return jm.load(path, dtype=np.float64)[:MOST_FRAMES]


def measure(name: str, clip: jm.Motion, prior: MotionPrior | str = "student") -> dict:
    """All that is measured on one clip, for JSON."""
    parents, joints = clip.skeleton.parents, clip.skeleton.names
    p, q = np.asarray(clip.translations), np.asarray(clip.rotations)
    rate = 1 / float(clip.frame_time)
    truth = positions(parents, p, q)

    def error(p, q) -> float:
        return float(np.mean(np.linalg.norm(positions(parents, p, q) - truth, axis=-1)))

    def denoised(p, q):
        found = jm.denoise(clip.with_transforms(p, q), prior=prior)
        return np.asarray(found.translations), np.asarray(found.rotations)

    change = angles(denoised(p, q)[1], q)
    frame, joint = np.unravel_index(np.argmax(change), change.shape)
    row = {"frames": len(q), "noise": {}, "sudden": {}}
    row["clean"] = {"change": float(change.max()), "joint": joints[joint], "frame": int(frame)}
    for kind, corrupted in (WHITE | OTHER).items():
        rng = np.random.default_rng([SEED, zlib.crc32(f"{name} {kind}".encode())])
        given = corrupted(rng, p, q, rate)
        got = denoised(*given)
        row["noise"][kind] = figures = {"before": error(*given), "after": error(*got)}
        if kind in WHITE:
            best, cutoff = best_butterworth(given[1], lambda q: error(p, q))
            figures |= {"best": best, "cutoff": cutoff * rate / 2}
        if kind == FLICKED:
            near = near_sudden(q)
            toes = np.array(["toe" in joint.lower() for joint in joints])
            for which, chosen in ((TOES, near & toes), (OTHERS, near & ~toes)):
                row["sudden"][which] = {
                    "frames": int(np.sum(chosen)),
                    "before": float(np.sum(angles(given[1], q)[chosen])),
                    "after": float(np.sum(angles(got[1], q)[chosen])),
                }
    return row


def speed(path: Path) -> dict[str, float]:
    """Seconds of a warm call, and CPU seconds that the first takes more; for a fresh process."""
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_enable_compilation_cache", False)
    clip = jax.block_until_ready(jm.load(path, dtype=np.float64))
    arrays = clip.skeleton.parents, np.asarray(clip.translations), np.asarray(clip.rotations)

    def timed(call) -> tuple[float, float]:
        wall, cpu = time.perf_counter(), time.process_time()
        jax.block_until_ready(call())
        return time.perf_counter() - wall, time.process_time() - cpu

    first = timed(lambda: jm.denoise(clip))
    warm = np.min([timed(lambda: jm.denoise(clip)) for _ in range(9)], axis=0)
    ruler = np.min([timed(lambda: positions(*arrays)) for _ in range(9)], axis=0)
    size = f"{clip.num_frames} × {clip.num_joints}"
    return {
        f"{size}: warm, s, least of 9": float(warm[0]),
        f"{size}: warm, CPU s, least of 9": float(warm[1]),
        f"{size}: compiling, CPU s": float(first[1] - warm[1]),
        f"{size}: NumPy's kinematics, s, least of 9": float(ruler[0]),
    }


# The table: a row a figure, a column a source.

ALL = "all"


def columns(clips: dict[str, dict], value: Callable[[list[dict]], float]) -> dict[str, float]:
    """``value`` of the clips of every source, and of all."""
    found = {}
    for source in (*SOURCES, ALL):
        chosen = [row for key, row in clips.items() if source in (ALL, key.split("/")[0])]
        if chosen:
            found[source] = value(chosen)
    return found


def ratio_rows(clips: dict[str, dict], kind: str, over: str) -> Iterable[tuple[str, dict]]:
    """Mean and worst of a kind's error after denoising, over another error of the same clip."""

    def ratio(row):
        return row["noise"][kind]["after"] / row["noise"][kind][over]

    named = {"before": "before", "best": "best Butterworth"}[over]
    mean = columns(clips, lambda rows: float(np.exp(np.mean([np.log(ratio(r)) for r in rows]))))
    worst = columns(clips, lambda rows: max(map(ratio, rows)))
    yield f"{kind}: after / {named}, mean", mean
    where = max(clips, key=lambda key: ratio(clips[key]))
    yield f"{kind}: after / {named}, worst", worst | {"where": where}


def table(clips: dict[str, dict]) -> dict[str, dict]:
    """Every figure by source, of what was measured by clip."""

    def change(row):
        return row["clean"]["change"]

    def worse(row, kind):
        return row["noise"][kind]["after"] > WORSE * row["noise"][kind]["before"]

    bent = columns(clips, lambda rows: 100 * float(np.mean([change(r) > BENT for r in rows])))
    largest = columns(clips, lambda rows: max(map(change, rows)))
    where = max(clips, key=lambda key: change(clips[key]))
    found = {
        "clips": columns(clips, len),
        f"clean: clips changed by more than {BENT:g}°, %": bent,
        "clean: largest change, °": largest
        | {"where": f"{where} {clips[where]['clean']['joint']}"},
    }
    for kind in WHITE:
        found |= ratio_rows(clips, kind, "best")
        found |= ratio_rows(clips, kind, "before")
    for which in (TOES, OTHERS):

        def total(rows, what, which=which):
            return sum(r["sudden"][which][what] for r in rows)

        found[f"sudden, {which}: frames"] = columns(clips, lambda rows: total(rows, "frames"))
        for what in ("before", "after"):
            found[f"sudden, {which}: error {what}, °"] = columns(
                clips, lambda rows, what=what: total(rows, what) / max(total(rows, "frames"), 1)
            )
    for kind in OTHER:
        found |= ratio_rows(clips, kind, "before")
        found[f"{kind}: clips made worse, %"] = columns(
            clips, lambda rows, kind=kind: 100 * float(np.mean([worse(r, kind) for r in rows]))
        )
    return found


def show(figures: dict[str, dict], former: dict[str, dict]) -> None:
    """Print the table, beside the ratios to a former one."""

    def cell(row: str, column: str) -> str:
        if column not in figures[row]:
            return ""
        now, then = figures[row][column], former.get(row, {}).get(column)
        if isinstance(now, int):
            return str(now)
        if then is None:
            return f"{now:.3f}"
        ratio = now / then if then else 1.0 if now == 0 else np.inf
        return f"{now:.3f} ×{ratio:.2f}"

    lines = [("", *SOURCES, ALL, "where")]
    for row in figures:
        lines.append((row, *(cell(row, c) for c in lines[0][1:-1]), figures[row].get("where", "")))
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        first, *cells, last = (
            text.ljust(w) if i in (0, len(line) - 1) else text.rjust(w)
            for i, (text, w) in enumerate(zip(line, widths, strict=True))
        )
        print("  ".join([first, *cells, last]).rstrip())


def show_worst(clips: dict[str, dict], count: int = 10) -> None:
    """The clean clips that were changed most."""
    print(f"\nclean clips changed most, the first {count}")
    for key in sorted(clips, key=lambda key: -clips[key]["clean"]["change"])[:count]:
        clean = clips[key]["clean"]
        print(f"{clean['change']:7.2f}°  {key}  {clean['joint']}  frame {clean['frame']}")


def captures(folder: Path, quick: bool) -> dict[str, Path]:
    """The files to run on, by source and name."""
    return {
        f"{source}/{path.stem}": path
        for source, (pattern, every) in SOURCES.items()
        for path in sorted(folder.glob(pattern))[:: every * (6 if quick else 1)]
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="every sixth clip")
    parser.add_argument("--verbose", action="store_true", help="the clean clips changed most")
    parser.add_argument("--prior", action="store_true", help="learned from clips of other manners")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures, by clip too")
    parser.add_argument(
        "--against", type=Path, metavar="FILE", help="JSON of a run to compare with"
    )
    options = parser.parse_args()
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("JAXMOTION_TEST_DATA", beside))
    paths = captures(folder, options.quick)
    if not paths:
        parser.error(f"no captures in {folder}: set JAXMOTION_TEST_DATA to a folder of them")
    former = {}
    if options.against:
        then = json.loads(options.against.read_text())
        if missing := sorted(paths.keys() - then["clips"].keys()):
            parser.error(f"{options.against} is of other clips, without {missing[0]}")
        former = then["figures"] | table({key: then["clips"][key] for key in paths})

    jax.config.update("jax_enable_x64", True)
    clips = {}
    for key, path in paths.items():
        pattern = SOURCES[key.split("/")[0]][0]
        prior = prior_without(folder, pattern, manner(path)) if options.prior else "student"
        clips[key] = measure(key, read(path), prior)
    figures = table(clips)
    if (folder / DANCE).is_file():
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as fresh:
            seconds = fresh.submit(speed, folder / DANCE).result()
        figures |= {name: {ALL: value} for name, value in seconds.items()}
    if options.json:
        options.json.write_text(json.dumps({"figures": figures, "clips": clips}, indent=1))
    show(figures, former)
    if options.verbose:
        show_worst(clips)


if __name__ == "__main__":
    main()
