"""What the scripts of this folder share: real captures, what an item says, and its record.

A script remakes a table or figure of a paper and ends with ``remade.main(make, draw, __doc__)``:

    python benchmarks/papers/SCRIPT.py [--seed 0] [--json FILE] [--picture FILE]

``make(seed)`` returns items, each of :func:`told`, which prints it; ``draw(seed)``, where there is
one, a figure with ``savefig``. With ``--json`` the items go into that record, in the place of those
of the same name. All is computed in float64. Captures: ``JAXMOTION_TEST_DATA``, else
``../shared/data`` beside the project.
"""

import argparse
import datetime
import importlib.util
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import jax
import numpy as np
from run import shown

import jaxmotion as jm

HERE = Path(__file__).resolve().parent
VERDICTS = ("reproduced", "better", "refuted", "not comparable")


def captures(pattern: str = ".") -> list[Path]:
    """The files of that pattern, such as "bandai/walk*.bvh", sorted."""
    beside = HERE.parents[2] / "shared" / "data"
    folder = Path(os.environ.get("JAXMOTION_TEST_DATA", beside))
    found = sorted(folder.glob(pattern))
    if not found:
        raise SystemExit(f"no {pattern} in {folder}: set JAXMOTION_TEST_DATA to a folder of them")
    return found


def capture(name: str, fps: float | None = None) -> jm.Motion:
    """One of them in float64, at another frame rate if it is given."""
    motion = jm.load(captures(name)[0], dtype=np.float64)
    if fps is None or round(float(motion.fps), 3) == fps:
        return motion
    return jm.resample(motion, fps=fps)


def short(name: str) -> str:
    """What a capture is called in a table."""
    return Path(name).stem.removesuffix("_001").replace("_normal", "")


def told(
    paper: str,
    item: str,
    claim: str,
    measured: str,
    verdict: str,
    numbers: Sequence[dict],
    clips: str = "",
) -> dict:
    """An item, printed: what the paper claims, what was measured, a sentence each; the verdict,
    one of ``VERDICTS``; ``numbers``: rows of a table by column, words or numbers; ``clips``: which
    captures, and what was done to them to have the printed sizes."""
    if verdict not in VERDICTS:
        raise ValueError(f"told: verdict={verdict!r}; expected one of {', '.join(VERDICTS)}")
    print(f"\n{paper}, {item}\n", *aligned(numbers), sep="\n")
    print(f"\nclaim:    {claim}\nmeasured: {measured}\nverdict:  {verdict}")
    if clips:
        print(f"clips:    {clips}")
    rows = [{column: plain(value) for column, value in row.items()} for row in numbers]
    words = {"claim": claim, "measured": measured, "verdict": verdict, "clips": clips}
    return {"paper": paper, "item": item, **words, "numbers": rows}


def plain(value):
    """A number or a word as JSON has them."""
    return value.item() if isinstance(value, np.generic | np.ndarray | jax.Array) else value


def aligned(numbers: Sequence[dict]) -> list[str]:
    """A table for a terminal."""
    cells = [list(numbers[0]), *([shown(plain(x)) for x in row.values()] for row in numbers)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in cells]


def beside(name: str):
    """The module of another script of ``benchmarks/``."""
    spec = importlib.util.spec_from_file_location(name, HERE.parent / f"{name}.py")
    if spec is None or spec.loader is None:
        raise ImportError(name)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main(make: Callable[[int], list[dict]], draw: Callable | None = None, doc: str = "") -> None:
    """The command line of a script."""
    parser = argparse.ArgumentParser(description=doc.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="the record that the items go into")
    parser.add_argument("--picture", type=Path, help="the file that the figure goes into")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    if given.picture:
        if draw is None:
            parser.error("this item has no picture")
        draw(given.seed).savefig(given.picture)
        return
    around, begun = beside("record").surroundings(), time.perf_counter()
    items = make(given.seed)
    if given.json:
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        path = Path(sys.argv[0])
        mine = {"script": path.name, "seed": given.seed, "date": now}
        mine |= {"load": around.pop("load at its start"), "seconds": time.perf_counter() - begun}
        record = json.loads(given.json.read_text()) if given.json.exists() else {"items": {}}
        record |= {"date": now, **around}
        record["items"] |= {f"{x['paper']}, {x['item']}": x | mine for x in items}
        given.json.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n")
