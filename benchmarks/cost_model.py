"""What every verb costs a frame and joint, and what that makes of a large folder.

    python benchmarks/cost_model.py FILES... [--clips 10] [--verbs denoise,convert]
    python benchmarks/cost_model.py --table benchmarks/results/cost-DATE.json

Of the FILES, clips of spread sizes are taken. Every verb runs in a process of its own that has one
core, as a worker does: once on every clip to compile, then again, three times for the median.
Seconds are those of the processor, which a busy machine changes little: a + b·(frames × joints),
fitted by least squares of relative errors. So is the memory that a clip takes above what the
process holds between clips, once what was freed is given back. Bytes are those written. Linux only.

Prints a row a verb: ms a clip, µs a frame and joint; memory of a clip, of a frame and joint; bytes
written a frame and joint; seconds to compile for a size; memory of the process at the end. Writes
benchmarks/results/cost-DATE.json, beside verbs measured before on that day: "seconds" and "memory"
are a and b; with versions, machine and load. --table prints those of docs/scale.md.
"""

import argparse
import ctypes
import datetime
import io
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import redirect_stderr, redirect_stdout, suppress
from importlib.metadata import version
from pathlib import Path

import numpy as np

RESULTS = Path(__file__).parent / "results"
PACKAGES = ("jax", "jaxlib", "equinox", "numpy", "jaxmotion")
ROUNDS = 3
# What a verb is told of a clip {0}, another {1} and an output {o}.
VERBS = {
    "info": "info {0}",
    "check": "check {0}",
    "convert": "convert {0} -o {o}.npz",
    "denoise": "denoise {0} -o {o}.bvh",
    "denoise --robust": "denoise {0} -o {o}.bvh --robust",
    "style": "style {0} -o {o}.bvh --alpha 1.5",
    "layers": "layers {0} -o {o}",
    "multires": "multires {0} -o {o}.bvh --gains 1,1,0.5",
    "retime": "retime {0} -o {o}.bvh --to-fps 24",
    "contacts": "contacts {0}",
    "contacts --restore": "contacts {0} -o {o}.bvh --restore legs",
    "augment": "augment {0} -o {o} --count 4",
    "transfer": "transfer {0} --reference {1} -o {o}.bvh",
    "repair": "repair {0} -o {o}.bvh",
    "align": "align {0} {1} -o {o}.bvh",
    "blend": "blend {0} {0} {0} -o {o}.bvh",
    "stitch": "stitch {0} {1} -o {o}.bvh",
    "prior": "prior {0} -o {o}.npz",
    "compare": "compare {0} {1} -o {o}.html --no-open",
    "view": "view {0} -o {o}.html --no-open",
}


def main() -> None:
    """Every verb, then the table and the record."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--table", type=Path)
    parser.add_argument("--clips", type=int, default=10)
    parser.add_argument("--verbs", default=",".join(VERBS))
    parser.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.table:
        print(*tables(json.loads(given.table.read_text())["verbs"]), sep="\n")
        return
    if given.alone:
        print(json.dumps(measured(VERBS[given.verbs], given.files)))
        return
    clips = spread(given.files, given.clips)
    table = {}
    for verb in given.verbs.split(","):
        table[verb] = row = in_a_process(verb, clips)
        print(line(verb, row), flush=True)
    path = RESULTS / f"cost-{datetime.date.today()}.json"
    known = json.loads(path.read_text())["verbs"] if path.exists() else {}
    record = {
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}",
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
        "verbs": known | table,
    }
    RESULTS.mkdir(exist_ok=True)
    path.write_text(json.dumps(record, indent=1) + "\n")
    print(f"written to {path}")


def spread(files: list[Path], count: int) -> list[Path]:
    """So many of the files, of sizes far apart and of others of the same joints."""
    import jaxmotion as jm

    sizes = {}
    for path in files:
        motion = jm.load(path)
        if motion.num_frames >= 64:
            sizes[path] = motion.num_frames * motion.skeleton.num_joints
    ordered = sorted(sizes, key=lambda path: sizes[path])
    wanted = np.unique(np.linspace(0, len(ordered) - 1, count).round().astype(int))
    return [ordered[k] for k in wanted]


def in_a_process(verb: str, clips: list[Path]) -> dict:
    """The measures of a verb, by a process with one core."""
    one_core = {"NPROC": "1", "OPENBLAS_NUM_THREADS": "1"}
    ran = subprocess.run(
        [sys.executable, __file__, "--alone", "--verbs", verb, *map(str, clips)],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        env=os.environ | one_core,
    )
    rows = json.loads(ran.stdout.splitlines()[-1])
    clean = [row for row in rows["clips"] if row["code"] in (0, 3)]
    failed = [row["told"] for row in rows["clips"] if row["code"] not in (0, 3)]
    if not clean:
        raise SystemExit(f"{verb}: {failed[0]}")
    sizes = np.array([row["frames"] * row["joints"] for row in clean], float)
    fits = {name: fitted(sizes, [row[name] for row in clean]) for name in ("seconds", "bytes")}
    written = [row["written"] / size for row, size in zip(clean, sizes, strict=True)]
    return {
        "seconds": fits["seconds"],
        "memory": fits["bytes"],
        "written": float(np.median(written)),
        "start": rows["start"],
        "first": sum(row["first"] - row["seconds"] for row in clean) / len(clean),
        "held": rows["held"],
        "failed": failed,
        "clips": clean,
    }


def measured(words: str, clips: list[Path]) -> dict:
    """In this process: of every clip its size, seconds, memory and bytes written."""
    begun = time.process_time()
    from jaxmotion.cli import _session

    _session.is_little = lambda paths: False  # as in a large folder
    _session.start(notice=False)
    import jaxmotion as jm

    start = time.process_time() - begun
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        others = {}
        for k, path in enumerate(clips):
            motion = jm.load(path)
            joints = motion.skeleton.num_joints
            other = others.setdefault(joints, path)
            size = {"frames": motion.num_frames, "joints": joints}
            calls = []
            for turn in range(1 + ROUNDS):
                out = Path(scratch) / f"{k}-{turn}" / "x"
                out.parent.mkdir()
                calls.append(called(words.format(path, other, o=out)))
            written = sum(p.stat().st_size for p in out.parent.rglob("*") if p.is_file())
            row = {
                **size,
                "first": calls[0]["seconds"],
                "seconds": statistics.median(call["seconds"] for call in calls[1:]),
                "bytes": max(call["bytes"] for call in calls[1:]),
                "written": written,
                "code": calls[-1]["code"],
                "told": calls[-1]["told"],
            }
            rows.append(row)
    return {"start": start, "clips": rows, "held": resident("VmRSS")}


def called(words: str) -> dict:
    """A command in this process."""
    from jaxmotion.cli._app import app

    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    before, begun, code = resident("VmRSS"), time.process_time(), 0
    told = io.StringIO()
    with redirect_stdout(told), redirect_stderr(told):
        try:
            app(words.split(), standalone_mode=False)
        except SystemExit as end:
            code = end.code
        except Exception as error:
            code = getattr(error, "exit_code", 1)
            told.write(str(error))
    seconds = time.process_time() - begun
    peak = max(0, resident("VmHWM") - before)
    return {"seconds": seconds, "bytes": peak, "code": code, "told": told.getvalue()[-300:]}


def resident(name: str) -> int:
    """Bytes of memory, as Linux tells them."""
    with suppress(StopIteration):
        rows = Path("/proc/self/status").read_text().splitlines()
        return 1024 * int(next(row for row in rows if row.startswith(name)).split()[1])
    return 0


def fitted(sizes: np.ndarray, values: list[float]) -> list[float]:
    """a and b of a + b·size, neither negative, by least squares of relative errors."""
    from scipy.optimize import nnls

    values = np.maximum(np.array(values, float), 1e-9)
    rows = np.stack([np.ones_like(sizes), sizes], 1) / values[:, None]
    return [float(x) for x in nnls(rows, np.ones_like(sizes))[0]]


def line(verb: str, row: dict, *, brief: bool = False) -> str:
    """A row of the table."""
    (once, each), (base, grown) = row["seconds"], row["memory"]
    cells = (
        verb,
        f"{1e3 * once:.0f} ms",
        f"{1e6 * each:.2f} µs",
        *([] if brief else [f"{base / 2**20:.0f} MB"]),
        f"{grown:.0f} B",
        f"{row['written']:.0f} B",
        f"{row['first']:.1f} s",
        f"{row['held'] / 2**20:.0f} MB",
    )
    return f"| {' | '.join(cells)} |" + "".join(f" failed: {told}" for told in row["failed"])


# A body of 22 joints at 30 frames a second: what is reckoned for it.
JOINTS, FPS = 22, 30
HOURS, TAKE = 100, 60  # of takes of a minute
CLIPS, FRAMES = 50_000, 160


def tables(verbs: dict) -> list[str]:
    """Costs by verb, and what much of it takes."""
    lines = [
        "| verb | a clip | a frame and joint | memory of it | written of it | a size, compiled "
        "| held |",
        "|---|---|---|---|---|---|---|",
        *(line(verb, row, brief=True) for verb, row in verbs.items()),
        "",
        "| verb | 100 hours, 1 core | 16 cores | 100 workers | 50 000 clips, 1 core | 16 cores "
        "| 100 workers |",
        "|---|---|---|---|---|---|---|",
    ]
    for verb, row in verbs.items():
        once, each = row["seconds"]
        takes = HOURS * 3600 / TAKE
        whole = takes * (once + each * JOINTS * FPS * TAKE)
        folder = CLIPS * (once + each * JOINTS * FRAMES)
        cells = [told(x / n) for x in (whole, folder) for n in (1, 16, 100)]
        lines.append(f"| {verb} | {' | '.join(cells)} |")
    return lines


def told(seconds: float) -> str:
    """42 s, 3 min, 2.5 h."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


if __name__ == "__main__":
    main()
