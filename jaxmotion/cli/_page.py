"""A report as a page of HTML that needs nothing else: a table of figures, a row a file, then what
was learned of each, with pictures. The record itself is in it, for programs.

A figure is a row of ``_FIGURES``: where it is in a file's entry, and its heading. Columns without
any figure are left out, and what results where it is what was there before.
"""

import html
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from jaxmotion._plain import as_json, printable

# Where a page holds the record.
RECORD = r'<script type="application/json" id="record">\n(.*?)\n</script>'

# Where it holds the pictures of a file, by its input as text.
_PICTURES = r'<div class="pictures" data-input="(.*?)">\n(.*?)\n</div>'

_FIGURES: tuple[tuple[tuple[str, ...], str], ...] = (
    (("frames",), "frames"),
    (("rate",), "frames a second"),
    (("unit",), "metres a length unit"),
    (("result", "frames"), "frames now"),
    (("result", "rate"), "a second now"),
    (("changes", "frames_changed"), "frames changed"),
    (("changes", "degrees"), "joints turned, degrees"),
    (("changes", "distance"), "joints and ends moved, length units"),
    (("changes", "root"), "root moved, length units"),
    (("feet", "slide_before"), "feet slid, length units a second"),
    (("feet", "slide_timed"), "in the new timing"),
    (("feet", "slide_edited"), "feet slide as edited"),
    (("feet", "slide_after"), "feet slide now"),
    (("feet", "contacts_restored"), "contacts restored"),
    (("feet", "root_move"), "which moved the root by up to"),
    (("seconds",), "seconds it took"),
)

_STYLE = """
body { font: 15px/1.4 system-ui, sans-serif; margin: 2em; }
table { border-collapse: collapse; margin: 1em 0; }
th, td { border-bottom: 1px solid #8886; padding: .3em .8em; }
th, td { text-align: left; vertical-align: top; overflow-wrap: anywhere; }
th { font-weight: 600; }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
tr.failed td { color: #b00020; }
tr.skipped td, tr.not-tried td { color: #777; }
small { color: #777; display: block; }
summary { cursor: pointer; }
img { max-width: 100%; }
"""


def page(record: dict[str, Any], pictures: Mapping[str, str] = MappingProxyType({})) -> str:
    """The page of a report; ``pictures``: HTML by input."""
    entries = record["files"]
    shown = [(where, heading) for where, heading in _FIGURES if _tells(entries, where)]
    headings = ["file", "output", "status", *(heading for _, heading in shown)]
    rows = "\n".join(_row(entry, [where for where, _ in shown]) for entry in entries)
    learned = "\n".join(_learned(e, pictures.get(e["input"], "")) for e in entries if e["learned"])
    counts = ", ".join(f"{n} {status}" for status, n in record["counts"].items() if n)
    asked = " ".join([record["command"], *map(_spelt, record["options"].items())])
    preset = f", preset {as_text(record['preset'])}" if record["preset"] else ""
    hidden = as_json(record).replace("<", r"\u003c")
    return f"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>jaxmotion report</title>
<style>{_STYLE}</style>
<h1>jaxmotion {as_text(record["command"])}</h1>
<p>{counts}; {as_text(record["end"])}</p>
<p><code>{as_text(" ".join(asked.split()))}</code>{preset}</p>
<p>{record["begun"]} to {record["ended"]}; jaxmotion {record["jaxmotion"]}, JAX {record["jax"]}</p>
{_table(headings, rows)}
{learned}
<script type="application/json" id="record">
{hidden}
</script>
</html>"""


def pictures_in(text: str) -> dict[str, str]:
    """The pictures in a page, by input :func:`as_text`."""
    return dict(re.findall(_PICTURES, text, re.DOTALL))


def _table(headings: Sequence[str], rows: str) -> str:
    head = "".join(f"<th>{as_text(heading)}</th>" for heading in headings)
    return f"<table><thead><tr>{head}</tr></thead><tbody>\n{rows}\n</tbody></table>"


def _row(entry: dict[str, Any], shown: Sequence[tuple[str, ...]]) -> str:
    others = [f"with {other['input']}" for other in entry["with"]]
    cells = [_cell(entry["input"], [*others, entry["message"], *entry["warnings"]])]
    cells += [_cell(entry["output"]), _cell(entry["status"])]
    cells += [_cell(_at(entry, where)) for where in shown]
    return f'<tr class="{entry["status"].replace(" ", "-")}">{"".join(cells)}</tr>'


def _learned(entry: dict[str, Any], pictures: str) -> str:
    """What was learned of a file, folded: values in one table, the tables by name, pictures."""
    learned = entry["learned"]
    tables = {name: rows for name, rows in learned.items() if _is_table(rows)}
    values = {name: value for name, value in learned.items() if name not in tables}
    parts = []
    if values:
        rows = "\n".join(f"<tr>{_cell(n)}{_cell(v)}</tr>" for n, v in values.items())
        parts.append(_table((), rows))
    for name, lines in tables.items():
        rows = "\n".join(f"<tr>{''.join(map(_cell, line.values()))}</tr>" for line in lines)
        parts.append(f"<h4>{as_text(name)}</h4>{_table(list(lines[0]), rows)}")
    name = as_text(entry["input"])
    if pictures:
        parts.append(f'<div class="pictures" data-input="{name}">\n{pictures}\n</div>')
    title = f"what was learned of {name}"
    return f"<details><summary>{title}</summary>\n{''.join(parts)}</details>"


def _is_table(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], dict)


def _tells(entries: Sequence[dict[str, Any]], where: tuple[str, ...]) -> bool:
    """Whether a column is worth its place."""
    found = [(entry, _at(entry, where)) for entry in entries]
    if where[0] == "result":
        return any(value not in (None, _at(entry, where[1:])) for entry, value in found)
    return any(value is not None for _, value in found)


def _at(entry: dict[str, Any], where: tuple[str, ...]) -> Any:
    value: Any = entry
    for key in where:
        value = value and value[key]
    return value


def _cell(value: Any, notes: Sequence[str] = ()) -> str:
    small = "".join(f"<small>{as_text(note)}</small>" for note in notes if note)
    if isinstance(value, dict) and "p95" in value:
        place = f"frame {value['frame']}, {value['joint']}{', end site' * value['end_site']}"
        usual = f"mean {_number(value['mean'])}, 95 % {_number(value['p95'])}"
        most = f"{_number(value['max'])}<small>{as_text(place)}</small>"
        return f'<td class="number">{most}<small>{usual}</small></td>'
    if isinstance(value, bool):
        value = "yes" if value else "no"
    if isinstance(value, (int, float)):
        return f'<td class="number">{_number(value)}{small}</td>'
    return f"<td>{as_text(_words(value))}{small}</td>"


def _number(value: int | float) -> str:
    return f"{value:.4g}" if isinstance(value, float) else f"{value}"


def _words(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, dict):
        return ", ".join(f"{name}: {_words(item)}" for name, item in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_words, value))
    return _number(value) if isinstance(value, float) else str(value)


def _spelt(option: tuple[str, Any]) -> str:
    """As it may be typed; nothing for what was not asked for."""
    name, value = option
    parts = value if isinstance(value, (list, tuple)) else [value]
    if all(part is None or part is False for part in parts):
        return ""
    return f"--{name}" if value is True else f"--{name} {_words(value)}"


def as_text(text: object) -> str:
    """As it is shown in a page."""
    return html.escape(printable(text))
