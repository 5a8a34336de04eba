"""Wu et al. 2006, Table 1: how long a style takes to be carried over.

The paper's four pairs, frames of source and reference, on a Pentium 4 of 2.8 GHz; milliseconds of
the time warp, the transfer and the post-processing (footskate cleanup), the heads of the columns
being lost in the text at hand and read so: ``PRINTED``. Its clips are CMU's, none of which is
here. Others of 31 joints stand in, resampled to the printed frames, whatever speed that comes to:

    walk-hobble     Xia's "neutral" on "depressed"     run-stride   CMU 02_03, a run, on 02_01
    walk-stealthy   Xia's "neutral" on "sexy"          run-jaunty   CMU 02_03 on 02_02

Each part by itself, warm, the median of five calls: the warp with the weights that it gives
(``style.correspondence.corresponding``), in float64; the transfer without a warp and without feet
(statistics, Eq. 7, the body's path); finding contacts; and, as post, ``contacts.replant`` and
``cleanup_footskate``. Beside them the whole of ``transfer_style``, and of the first pair its first
call in a process of its own, which compiles. ``bench_style.py``'s port to NumPy and numba times
warp and transfer together on the same machine, to tell what is the machine's; without numba it is
left out.

Verdict: better if the three parts of every pair take a twentieth of the printed time at most (a
core is some ten times faster than it was); reproduced if they take no longer than printed; refuted
if they take longer. Set down first for every part by itself, by which the transfer alone, of which
10 to 21 ms are printed and most of ours is what a call costs, decided over all. No random numbers.
"""

import importlib.util
import statistics
import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np
import remade

import jaxmotion as jm
from jaxmotion.style.correspondence import corresponding, strides

sys.path.append(str(Path(__file__).resolve().parents[1]))
import bench_style

PAPER = "Wu et al. 2006"
PARTS = "warp", "transfer", "post"
# Source, reference, their frames, and printed milliseconds of the parts.
PRINTED = {
    "walk-hobble": (
        "xia/neutral_01_000.bvh",
        "xia/depressed_13_000.bvh",
        (427, 400),
        (900, 21, 80),
    ),
    "walk-stealthy": ("xia/neutral_01_000.bvh", "xia/sexy_01_000.bvh", (277, 410), (600, 17, 61)),
    "run-stride": ("cmu/02_03.amc", "cmu/02_01.amc", (135, 302), (300, 10, 22)),
    "run-jaunty": ("cmu/02_03.amc", "cmu/02_02.amc", (135, 450), (400, 13, 25)),
}
ROUNDS = 5
BETTER = 20


def pair(name):
    """Source and reference with the printed frames."""
    source, reference, frames, _ = PRINTED[name]
    clips = zip((source, reference), frames, strict=True)
    return [jm.resample(remade.capture(x), num_frames=n) for x, n in clips]


def make(seed):
    rows = [timed(name) for name in PRINTED]
    parts = {part: [row[f"printed {part}"] / row[part] for row in rows] for part in PARTS}
    sums = [[sum(row[f"{k}{part}"] for part in PARTS) for row in rows] for k in ("printed ", "")]
    ratios = [printed / ours for printed, ours in zip(*sums, strict=True)]
    least = min(ratios)
    verdict = "better" if least >= BETTER else "reproduced" if least >= 1 else "refuted"
    each = ", ".join(f"{part} {min(x):.1f} to {max(x):.0f}" for part, x in parts.items())
    return [
        remade.told(
            PAPER,
            "Table 1",
            "Clips of 135 to 450 frames are warped, transferred and cleaned in 0.3 to 1 s.",
            f"The three take {min(sums[1]):.0f} to {max(sums[1]):.0f} ms; printed, {least:.0f} to "
            f"{max(ratios):.0f} times as long: {each} times.",
            verdict,
            rows,
            "Xia's neutral walk on two others, CMU 02's run on two walks, by resampling",
        )
    ]


def timed(name):
    """A row: milliseconds."""
    source, reference = pair(name)
    edited = jm.style.transfer_style(source, reference, keep_contacts=False).motion
    contacts = jm.contacts.detect(source)

    def warp():
        counts = np.int32(source.num_frames), np.int32(reference.num_frames)
        theirs = tuple(range(source.num_joints))
        steps = strides(*map(int, counts))
        return corresponding(source, reference, counts, steps, theirs, "shared")

    def transfer():
        options = {"warp": None, "keep_contacts": False}
        return jm.style.transfer_style(source, reference, **options).motion.rotations

    def post():
        again = jm.contacts.replant(edited, contacts)
        return jm.contacts.cleanup_footskate(edited, again).rotations

    def whole():
        return jm.style.transfer_style(source, reference).motion.rotations

    found = dict(zip(PARTS, map(median, (warp, transfer, post)), strict=True))
    printed = {f"printed {p}": ms for p, ms in zip(PARTS, PRINTED[name][3], strict=True)}
    return {
        "pair": name,
        "frames": f"{source.num_frames}-{reference.num_frames}",
        **found,
        **printed,
        "contacts": median(lambda: jm.contacts.detect(source).mask),
        "whole": median(whole),
        "first call": first_call(name) if name == "walk-hobble" else None,
        "port, warp and transfer": port(source, reference),
    }


def median(call):
    """Milliseconds, warm."""
    took = []
    for _ in range(ROUNDS + 1):
        begun = time.perf_counter()
        jax.block_until_ready(call())
        took.append(1e3 * (time.perf_counter() - begun))
    return statistics.median(took[1:])


def first_call(name):
    """Milliseconds of the whole, in a process that has done nothing but read the clips."""
    told = subprocess.run(
        [sys.executable, __file__, "--first", name], check=True, capture_output=True, text=True
    )
    return float(told.stdout.split()[-1])


def first(name):
    jax.config.update("jax_enable_x64", True)
    source, reference = pair(name)
    begun = time.perf_counter()
    jax.block_until_ready(jm.style.transfer_style(source, reference).motion)
    print(1e3 * (time.perf_counter() - begun))


def port(source, reference):
    """What a reader of the paper would write in NumPy, its warp in numba: milliseconds. Its warp
    bends no clip to more than twice its length."""
    far = reference.num_frames > bench_style.REPEATS * source.num_frames
    if far or importlib.util.find_spec("numba") is None:
        return None
    import numba

    runs_of = bench_style.warping(numba)
    return median(lambda: bench_style.ported(source, reference, runs_of))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--first"]:
        first(sys.argv[2])
    else:
        remade.main(make, doc=__doc__)
