"""``denoise`` of many small files by dask's workers against ``--jobs``, and amid kills.

    python benchmarks/bench_cluster.py FOLDER [--files 2000] [--workers 2]
    python benchmarks/bench_cluster.py FOLDER --files 300 --kills 10

FOLDER holds .bvh files, which are repeated under other names. Without kills both ways run on the
same files, one after the other, twice, with the folder of compiled programs warm: files a second of
the whole command and from the 100th file on, memory of the client and of the largest worker at the
100th file and at the end. With kills, workers are killed at random moments of one run, the client
of another, which is then resumed; the outputs are compared with those of an undisturbed run.
"""

import argparse
import hashlib
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from itertools import cycle, islice
from pathlib import Path

import psutil

_MARK = 100  # the file at which memory is first looked at
_MB = 2**20


def main() -> None:
    """Both parts, by the options."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--files", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kills", type=int, default=0)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="bench-cluster-") as scratch:
        os.environ.setdefault("JAXMOTION_CACHE_DIR", f"{scratch}/programs")
        takes = repeated(given.folder, given.files, Path(scratch))
        warm = Run(
            repeated(given.folder, 103, Path(scratch)), Path(scratch) / "warm", given.workers
        )
        warm.ended()
        (amid_kills if given.kills else race)(given, takes, Path(scratch))


def repeated(folder: Path, count: int, scratch: Path) -> Path:
    """A folder of so many files, those of another one over and over."""
    originals = scratch / "originals"
    if not originals.exists():
        shutil.copytree(folder, originals)
    takes = scratch / f"takes-{count}"
    takes.mkdir(exist_ok=True)
    for k, path in enumerate(islice(cycle(sorted(originals.glob("*.bvh"))), count)):
        with suppress(FileExistsError):
            os.link(path, takes / f"{k:05d}-{path.name}")
    return takes


class Run:
    """A command at work: when each of its files was told of, and its memory."""

    def __init__(self, takes: Path, out: Path, workers: int, *words: str):
        line = [sys.executable, "-m", "jaxmotion", "denoise", str(takes), "-o", str(out)]
        self.begun = time.perf_counter()
        self.process = subprocess.Popen(
            [*line, "--jobs", str(workers), *words], stderr=subprocess.PIPE, text=True
        )
        self.times: list[float] = []
        self.memory: dict[int, tuple[float, float]] = {}
        self.peak = (0.0, 0.0)
        self.last: list[str] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self.process.stderr or ():
            self.last = [*self.last[-9:], line.rstrip()]
            if line.startswith("["):
                self.times.append(time.perf_counter() - self.begun)
                if len(self.times) % _MARK == 0:
                    self.memory[len(self.times)] = self._memory()

    def workers(self) -> list[psutil.Process]:
        """Its children, but for those of Python itself."""
        with suppress(psutil.Error):
            found = psutil.Process(self.process.pid).children(recursive=True)
            return [p for p in found if "resource_tracker" not in " ".join(_words(p))]
        return []

    def _memory(self) -> tuple[float, float]:
        with suppress(psutil.Error):
            mine = psutil.Process(self.process.pid).memory_info().rss / _MB
            theirs = [p.memory_info().rss / _MB for p in self.workers()]
            return mine, max(theirs, default=0.0)
        return 0.0, 0.0

    def ended(self) -> float:
        """Wait for it; seconds it took."""
        code = self.process.wait()
        assert code == 0, self.last
        return time.perf_counter() - self.begun


def _words(process: psutil.Process) -> list[str]:
    try:
        return process.cmdline()
    except psutil.Error:
        return []


def race(given: argparse.Namespace, takes: Path, scratch: Path) -> None:
    """``--jobs`` and ``--cluster local`` in turn."""
    for turn in range(given.rounds):
        for name, words in (("--jobs", ()), ("--cluster local", ("--cluster", "local"))):
            out = scratch / "out"
            run = Run(takes, out, given.workers, *words)
            seconds = run.ended()
            row = {"how": name, "round": turn, "files": given.files, "seconds": round(seconds, 1)}
            row["files a second"] = round(given.files / seconds, 2)
            if given.files > _MARK:
                steady = (given.files - _MARK) / (run.times[-1] - run.times[_MARK - 1])
                row[f"from the {_MARK}th on"] = round(steady, 2)
            row["MB of client and largest worker"] = {
                str(k): [round(x) for x in v] for k, v in _some(run.memory).items()
            }
            print(json.dumps(row), flush=True)
            shutil.rmtree(out)


def _some(memory: dict) -> dict:
    """The first, those amid and the last."""
    keys = sorted(memory)
    return {k: memory[k] for k in sorted({*keys[:1], *keys[:: max(1, len(keys) // 4)], *keys[-1:]})}


def amid_kills(given: argparse.Namespace, takes: Path, scratch: Path) -> None:
    """Workers killed at random moments, and the client of another run."""
    rng = random.Random(given.seed)
    calm = Run(takes, scratch / "calm", given.workers, "--cluster", "local")
    seconds = calm.ended()
    want = tree(scratch / "calm")
    print(json.dumps({"undisturbed": round(seconds, 1), "outputs": len(want)}), flush=True)

    run = Run(takes, scratch / "killed", given.workers, "--cluster", "local")
    moments = sorted(rng.uniform(2, seconds) for _ in range(given.kills))
    hit = 0
    for moment in moments:
        while time.perf_counter() - run.begun < moment and run.process.poll() is None:
            time.sleep(0.02)
        if workers := run.workers():
            with suppress(psutil.Error):
                rng.choice(workers).kill()
                hit += 1
    seconds = run.ended()
    same = tree(scratch / "killed") == want
    row = {"workers killed": hit, "seconds": round(seconds, 1), "same outputs, no other file": same}
    print(json.dumps(row), flush=True)

    run = Run(takes, scratch / "resumed", given.workers, "--cluster", "local")
    time.sleep(rng.uniform(0.4, 0.8) * moments[-1])
    run.process.kill()
    run.process.wait()
    done = len(run.times)
    run = Run(takes, scratch / "resumed", given.workers, "--cluster", "local", "--resume")
    seconds = run.ended()
    same = tree(scratch / "resumed") == want
    row = {"client killed after": done, "resumed, seconds": round(seconds, 1)}
    print(json.dumps({**row, "same outputs, no other file": same}), flush=True)


def tree(folder: Path) -> dict[str, str]:
    """Hashes of all that is in a folder but its record."""
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.iterdir()
        if path.name != ".jaxmotion-made"
    }


if __name__ == "__main__":
    main()
