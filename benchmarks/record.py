"""Runs all races into one record, compares two records, and makes README's table of one.

    python benchmarks/record.py run [FILE...] [--out RECORD]    by default all of bench_*.py, and
                                                                benchmarks/results/DATE.json
    python benchmarks/record.py compare OLD NEW                 what got slower beyond noise
    python benchmarks/record.py table RECORD                    README's table, written in place

Files run one after the other, each in a process of its own; one that fails is told and the rest go
on. A record holds versions, the machine and how busy it was; of every race the median, the spread
(the range of the middle half, over the median) and the number of rounds, the medians of the peers;
and shares that a benchmark notes: ``extra_info["what"] = {"value": 0.1, "peers": {}}``. A run
may be made in parts: rows of the same race replace those that RECORD has.

Two records are compared race by race. Where both have a peer, by the ratio to it: both were timed
in turn, so that a busier or slower machine cancels out. Slower is what takes longer by more than a
tenth and more than three times the larger spread.
"""

import argparse
import datetime
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

HERE = Path(__file__).resolve().parent
README = HERE.parent / "README.md"
BEGIN, END = "| what | jaxmotion | peer | times as fast | FILE |", "\n\n"
PACKAGES = (
    *("jaxmotion", "jax", "jaxlib", "numpy", "scipy", "equinox", "optimistix", "numba"),
    *("jaxlie", "upc-pymotion", "pybvh", "dtaidistance", "tslearn", "librosa", "torch"),
)
# README's rows: what it says, the race, the peers and what it calls them.
ROWS = (
    (
        "forward kinematics, 2526 frames of 65 joints",
        "forward kinematics 2526x65 float32",
        {"pymotion": "pymotion", "jaxlie unrolled": "jaxlie unrolled"},
    ),
    (
        "its value and gradient",
        "FK value and gradient 2526x65 float32",
        {"jaxlie unrolled": "jaxlie unrolled"},
    ),
    (
        "compiling that",
        "compile FK value and gradient 65 joints",
        {"jaxlie unrolled": "jaxlie unrolled"},
    ),
    (
        "left and right exchanged, 2526 frames of 64 joints",
        "mirror 2526x64 float32",
        {"pymotion": "pymotion"},
    ),
    (
        "smoothing 2526 frames of 260 channels, float64",
        "lgs mean 2526x260 float64",
        {"solveh_banded": "SciPy `solveh_banded`"},
    ),
    (
        "dynamic time warping with its path, 1000 on 1000 frames, float64",
        "dtw with path 1000x1000x96 float64",
        {"tslearn numba": "tslearn", "librosa numba": "librosa"},
    ),
    (
        "hands and feet kept in place, 200 frames of 31 joints, float64",
        "satisfy 200x96 hands and feet (d=96) f64",
        {"scipy L-BFGS-B": "SciPy L-BFGS-B, 500 iterations"},
    ),
    (
        "style transfer, 427 on 400 frames, 31 joints",
        "style transfer 427 on 400 frames, 31 joints float32",
        {"NumPy, numba": "the paper in NumPy, its warp in numba"},
    ),
    (
        "32 variations of 240 frames, 22 joints",
        "augment, 32 variations of 240 frames, 22 joints",
        {"one by one": "the same calls one by one"},
    ),
    (
        "nearest words of 600 s at 24 fps in 600 s, 41 million pairs",
        "nearest words, 14400 frames, 21 joints, every 5th",
        {"numba, all pairs": "a loop over all pairs in numba, two threads"},
    ),
    (
        "opening 103 cached BVH files as a corpus",
        "open 103 cached clips",
        {"reading them": "reading them"},
    ),
    (
        "waiting for batches in a small training, share of its time",
        "waiting for batches",
        {"without a thread": "without a thread"},
    ),
    (
        "reading a BVH, CMU 01_01",
        "read BVH 01_01.bvh",
        {"pymotion": "pymotion", "pybvh": "pybvh"},
    ),
    (
        "writing it",
        "write BVH 01_01.bvh",
        {"pymotion": "pymotion", "pybvh": "pybvh"},
    ),
)
SLOWER, NOISE = 0.1, 3.0


def main() -> int:
    """One of the three."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    run = verbs.add_parser("run")
    run.add_argument("files", nargs="*", type=Path)
    run.add_argument("--out", type=Path)
    compare = verbs.add_parser("compare")
    compare.add_argument("records", nargs=2, type=Path, metavar=("OLD", "NEW"))
    table = verbs.add_parser("table")
    table.add_argument("record", type=Path)
    given = parser.parse_args()
    if given.verb == "run":
        return recorded(given.files or sorted(HERE.glob("bench_*.py")), given.out)
    if given.verb == "compare":
        old, new = (json.loads(path.read_text()) for path in given.records)
        lines, slower = compared(old, new)
        print(*lines, sep="\n")
        return int(slower)
    write_table(json.loads(given.record.read_text()))
    return 0


def recorded(files: list[Path], out: Path | None) -> int:
    """Run the files; the number of those that failed."""
    now = datetime.datetime.now(datetime.UTC)
    out = out or HERE / "results" / f"{now:%Y-%m-%d}.json"
    record = json.loads(out.read_text()) if out.exists() else {"races": {}, "figures": {}}
    record |= {"date": now.isoformat(timespec="seconds"), **surroundings()}
    failed = 0
    out.parent.mkdir(exist_ok=True)
    for path in files:
        races, figures, code = of_file(path)
        record["races"] |= races
        record["figures"] |= figures
        failed += code not in (0, 5)  # 5: it holds no test
        print(f"{path.name}: {len(races)} races" + (f", exit code {code}" if code else ""))
        # After every file: who stops a long run keeps what is there.
        ordered = {key: dict(sorted(record[key].items())) for key in ("races", "figures")}
        out.write_text(json.dumps(record | ordered, indent=1, ensure_ascii=False) + "\n")
    print(f"written to {out}")
    return failed


def of_file(path: Path) -> tuple[dict, dict, int]:
    """Races and figures of one file, and pytest's exit code."""
    with tempfile.TemporaryDirectory() as folder:
        told = Path(folder) / "told.json"
        words = ["-m", "pytest", "-q", "-c", HERE / "pytest.ini", "--benchmark-only", path]
        ran = subprocess.run([sys.executable, *map(str, words), f"--benchmark-json={told}"])
        rows = json.loads(told.read_text())["benchmarks"] if told.exists() else []
    races, figures = {}, {}
    for row in rows:
        stats, more = row["stats"], dict(row["extra_info"])
        peers = {
            name.removesuffix(" median"): more.pop(name)
            for name in list(more)
            if name.endswith(" median")
        }
        name = row["group"] or row["name"]
        races[name] = {
            "file": path.name,
            "seconds": stats["median"],
            "spread": stats["iqr"] / stats["median"],
            "rounds": stats["rounds"],
            "peers": peers,
        }
        figures |= {key: {"file": path.name, **figure} for key, figure in more.items()}
    return races, figures, ran.returncode


def surroundings() -> dict:
    """Versions and machine."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = None
    cpu = next(
        (
            line.partition(":")[2].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if line.startswith("model name")
        )
        if Path("/proc/cpuinfo").exists()
        else iter(()),
        platform.processor(),
    )
    load = round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None
    machine = {"processor": cpu, "cores": os.cpu_count(), "system": platform.platform()}
    return {
        "python": platform.python_version(),
        "versions": versions,
        "machine": machine,
        "load at its start": load,
    }


def compared(old: dict, new: dict) -> tuple[list[str], int]:
    """A line a race that got slower, or is gone, and how many got slower."""
    lines, slower = [], 0
    for name, before in old["races"].items():
        after = new["races"].get(name)
        if after is None:
            lines.append(f"{name}: not in the new record")
            continue
        ratio, by = after["seconds"] / before["seconds"], "by itself"
        shared = [peer for peer in before["peers"] if peer in after["peers"]]
        if shared:
            pace = statistics.median(after["peers"][p] / before["peers"][p] for p in shared)
            ratio, by = ratio / pace, f"beside {', '.join(shared)}"
        spread = max(before["spread"], after["spread"])
        if ratio - 1 > max(SLOWER, NOISE * spread):
            slower += 1
            took = f"{shown(before['seconds'])}, now {shown(after['seconds'])}"
            lines.append(f"{name}: {ratio:.2f} times as long {by} ({took}; spread {spread:.0%})")
    count = len(old["races"].keys() & new["races"].keys())
    lines.append(f"{slower} of {count} races slower beyond noise")
    return lines, slower


def shown(seconds: float) -> str:
    """4.0 ms, 0.26 s, 12 s."""
    if seconds < 0.0995e-3:
        return f"{1e6 * seconds:.2g} µs"
    if seconds < 0.0995:
        return f"{1e3 * seconds:.2g} ms"
    return f"{seconds:.2g} s" if seconds < 99.5 else f"{seconds:.0f} s"


def write_table(record: dict) -> None:
    """README's table."""
    text = README.read_text()
    begin = text.index(BEGIN)
    end = text.index(END, begin)
    README.write_text(text[:begin] + table_of(record) + text[end:])


def table_of(record: dict) -> str:
    """The rows, in Markdown; a race that the record lacks is an error."""
    lines = [BEGIN, "|---|---|---|---|---|"]
    for what, name, peers in ROWS:
        if name in record["figures"]:
            row = record["figures"][name]
            told = ", ".join(f"{c} {row['peers'][p]:.1%}" for p, c in peers.items())
            lines.append(f"| {what} | {row['value']:.1%} | {told} | | `{row['file']}` |")
            continue
        row = record["races"][name]
        theirs = {called: row["peers"][peer] for peer, called in peers.items()}
        told = ", ".join(f"{called} {shown(seconds)}" for called, seconds in theirs.items())
        ratios = ", ".join(f"{seconds / row['seconds']:.2g}" for seconds in theirs.values())
        lines.append(f"| {what} | {shown(row['seconds'])} | {told} | {ratios} | `{row['file']}` |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
