"""Remakes tables and figures of the papers into one record, and docs/papers.md of the record.

    python benchmarks/papers/run.py [NAME...] [--out RECORD]    by default all scripts, into
                                                                benchmarks/results/papers-DATE.json
    python benchmarks/papers/run.py --page RECORD               docs/papers.md, written in place

A NAME is that of a script, or how it begins: "eom" for all of that paper. Scripts run one after the
other, each in a process of its own; one that fails is told and the rest go on. Items replace those
of the same name that RECORD has.

On the page what stands between ``<!-- NAME -->`` and ``<!-- end -->`` is the record's: of an item
by its name, and "machine" and "summary". Items that the record lacks stay as they are, and those
that the page lacks are told.
"""

import argparse
import datetime
import json
import re
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
PAGE = HERE.parents[1] / "docs" / "papers.md"
SHARED = ("fifteen_seconds", "remade", "run")
PLACE = re.compile(r"(<!-- ([^\n]+) -->\n).*?(<!-- end -->)", re.S)


def main() -> int:
    """Either of the two."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--page", type=Path, metavar="RECORD")
    given = parser.parse_args()
    if given.page:
        text, missing = filled(PAGE.read_text(), json.loads(given.page.read_text()))
        PAGE.write_text(text)
        print(*(f"not on the page: {name}" for name in missing), sep="\n")
        return len(missing)
    scripts = [path for path in sorted(HERE.glob("*.py")) if path.stem not in SHARED]
    chosen = [p for p in scripts if not given.names or p.stem.startswith(tuple(given.names))]
    if not chosen:
        parser.error(f"no such script; there are {', '.join(path.stem for path in scripts)}")
    day = datetime.datetime.now(datetime.UTC).date()
    return recorded(chosen, given.out or HERE.parent / "results" / f"papers-{day}.json")


def recorded(scripts: list[Path], out: Path) -> int:
    """Run the scripts; the number of those that failed."""
    failed = 0
    out.parent.mkdir(exist_ok=True)
    for path in scripts:
        ran = subprocess.run([sys.executable, str(path), "--json", str(out.resolve())])
        failed += ran.returncode != 0
        if ran.returncode:
            print(f"{path.name}: exit code {ran.returncode}", flush=True)
    print(f"written to {out}")
    return failed


def filled(text: str, record: dict) -> tuple[str, list[str]]:
    """The page with the record's figures, and the names of items that it has no place for."""
    found = {name for _, name, _ in PLACE.findall(text)}
    blocks = {name: block_of(item) for name, item in record["items"].items()}
    missing = sorted(blocks.keys() - found)
    blocks |= {"machine": machine_of(record), "summary": summary_of(text, record)}

    def of_record(match: re.Match) -> str:
        begin, name, end = match.groups()
        return f"{begin}\n{blocks[name]}\n\n{end}" if name in blocks else match.group()

    return PLACE.sub(of_record, text), missing


def block_of(item: dict) -> str:
    """What the page says of an item."""
    about = [f"{item['clips']}."] if item["clips"] else []
    about.append(f"Seed {item['seed']}, {item['seconds']:.0f} s, load {item['load']} at its start.")
    return "\n\n".join(
        (
            f"*{item['paper']}:* {item['claim']}",
            f"**{item['verdict'].capitalize()}.** {item['measured']}",
            table_of(item["numbers"]),
            f"Clips: {' '.join(about)} `benchmarks/papers/{item['script']}`",
        )
    )


def table_of(rows: list[dict]) -> str:
    """Rows in Markdown."""
    cells = [[shown(x) for x in row.values()] for row in rows]
    lines = [list(rows[0]), ["---"] * len(rows[0]), *cells]
    return "\n".join(f"| {' | '.join(x.replace('|', '∣') for x in line)} |" for line in lines)


def shown(value) -> str:
    """A cell: numbers by three digits or to the whole; nothing for None."""
    if isinstance(value, float):
        return f"{value:,.0f}".replace(",", " ") if abs(value) >= 100 else f"{value:.3g}"
    return "" if value is None else str(value)


def summary_of(text: str, record: dict) -> str:
    """A row an item, in the order of the page."""
    names = [name for _, name, _ in PLACE.findall(text) if name in record["items"]]
    rows = [
        {"item": name, "verdict": record["items"][name]["verdict"]}
        | {"claim": record["items"][name]["claim"]}
        for name in names
    ]
    return table_of(rows) if rows else ""


def machine_of(record: dict) -> str:
    """Where and by what it was measured."""
    versions = ", ".join(
        f"{name} {record['versions'][name]}"
        for name in ("jaxmotion", "jax", "numpy", "scipy")
        if record["versions"].get(name)
    )
    machine, loads = record["machine"], [x["load"] or 0 for x in record["items"].values()]
    busy = f"loads of {min(loads)} to {max(loads)} when a script began" if loads else ""
    return (
        f"Measured {record['date'][:10]}: {machine['processor']}, {machine['cores']} cores, Python "
        f"{record['python']}, {versions}; {busy}."
    )


if __name__ == "__main__":
    sys.exit(main())
