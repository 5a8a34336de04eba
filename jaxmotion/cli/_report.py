"""What changed in every file, as JSON or as a page of HTML that needs nothing else.

A figure is one row of ``_FIGURES``: its key in the JSON, its heading, its value of a
:class:`~jaxmotion.cli._work.Effect`.
"""

import html
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxmotion import __version__
from jaxmotion._plain import as_json, printable
from jaxmotion.cli._work import Effect, Outcome

if TYPE_CHECKING:
    from jaxmotion.metrics import Peak

_FIGURES: tuple[tuple[str, str, Callable[[Effect], Any]], ...] = (
    ("frames", "frames", lambda e: e.change.frames),
    ("frames_changed", "frames changed", lambda e: e.change.frames_changed),
    ("max_degrees", "largest turn, degrees", lambda e: _peak(e.change.angle, math.degrees(1))),
    (
        "max_distance",
        "largest move, length units",
        lambda e: e.change.distance and _peak(e.change.distance),
    ),
    ("skate_before", "feet slid, length units a second", lambda e: e.skate and e.skate.before),
    ("skate_after", "feet slide now", lambda e: e.skate and e.skate.after),
    ("contacts_kept", "contacts kept", lambda e: e.skate and e.skate.kept),
)


def write_report(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Write the report, whole or not at all, in the format that the suffix tells."""
    from jaxmotion.io.atomic import atomic_write

    rows = [_row(outcome) for outcome in outcomes]
    if path.suffix.lower() == ".json":
        text = as_json({"jaxmotion": __version__, "files": rows}, indent=1)
    else:
        text = _page(rows)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as file:
        file.write((text + "\n").encode())


def _row(outcome: Outcome) -> dict[str, Any]:
    row: dict[str, Any] = {
        "input": str(outcome.job.source),
        "output": str(outcome.job.target),
        "status": outcome.status,
        "message": outcome.message,
        "warnings": outcome.warnings,
        "seconds": round(outcome.seconds, 3),
    }
    if outcome.effect is not None:
        row |= {key: value(outcome.effect) for key, _, value in _FIGURES}
    return row


def _peak(peak: "Peak", scale: float = 1.0) -> dict[str, Any]:
    return {"value": scale * peak.value, "frame": peak.frame, "joint": peak.joint}


def _page(rows: list[dict[str, Any]]) -> str:
    headings = ["input", "output", "status", *(heading for _, heading, _ in _FIGURES), "seconds"]
    head = "".join(f"<th>{html.escape(h)}</th>" for h in headings)
    body = "\n".join(_table_row(row) for row in rows)
    counts = {s: sum(r["status"] == s for r in rows) for s in ("written", "skipped", "failed")}
    summary = ", ".join(f"{n} {status}" for status, n in counts.items())
    return f"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>jaxmotion report</title>
<style>
body {{ font: 15px/1.4 system-ui, sans-serif; margin: 2em; }}
table {{ border-collapse: collapse; }}
th, td {{ border-bottom: 1px solid #8886; padding: .3em .8em; text-align: left; }}
td.number {{ text-align: right; font-variant-numeric: tabular-nums; }}
tr.failed td {{ color: #b00020; }}
small {{ color: #777; display: block; }}
</style>
<h1>jaxmotion report</h1>
<p>{summary}; jaxmotion {__version__}</p>
<table><thead><tr>{head}</tr></thead><tbody>
{body}
</tbody></table>
</html>"""


def _table_row(row: dict[str, Any]) -> str:
    notes = [row["message"], *row["warnings"]]
    cells = [_cell(row["input"], notes), _cell(row["output"]), _cell(row["status"])]
    cells += [_cell(row.get(key)) for key, _, _ in _FIGURES]
    return f'<tr class="{row["status"]}">{"".join(cells)}{_cell(row["seconds"])}</tr>'


def _cell(value: Any, notes: Sequence[str] = ()) -> str:
    small = "".join(f"<small>{_escaped(note)}</small>" for note in notes if note)
    if isinstance(value, dict):
        place = _escaped(f"frame {value['frame']}, {value['joint']}")
        return f'<td class="number">{value["value"]:.4g}<small>{place}</small></td>'
    if isinstance(value, bool):
        value = "yes" if value else "no"
    if isinstance(value, (int, float)):
        text = f"{value:.4g}" if isinstance(value, float) else value
        return f'<td class="number">{text}{small}</td>'
    return f"<td>{_escaped(value) if value is not None else ''}{small}</td>"


def _escaped(text: object) -> str:
    return html.escape(printable(text))
