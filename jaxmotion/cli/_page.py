"""A report as a page of HTML that needs nothing else: a table of figures, a row a file, then what
was learned of each, with pictures. The record itself is in it, for programs.

Rows go in the order of a column whose heading is clicked, downwards, then upwards. A table that is
wider than the page scrolls in its own box, where its first column stays.

Figures are those of ``_legend.py``, and so are the words on them. Columns without any figure are
left out, and what results where it is what was there before.
"""

import html
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from jaxmotion._plain import as_json, printable
from jaxmotion.cli._legend import FIGURES, LEARNED, OF_FILES

_NO_WORDS: Mapping[str, str] = MappingProxyType({})

# Where a page holds the record.
RECORD = r'<script type="application/json" id="record">\n(.*?)\n</script>'

# Where it holds the pictures of a file, by its input as text.
_PICTURES = r'<div class="pictures" data-input="(.*?)">\n(.*?)\n</div>'

_STYLE = """
:root { color-scheme: light dark; }
body { font: 15px/1.45 system-ui, sans-serif; margin: 1.5em auto; padding: 0 1.25em; }
body { max-width: 110em; }
h1 { font-size: 1.5em; margin: 0 0 .4em; overflow-wrap: anywhere; }
h4 { margin: 1.4em 0 .2em; }
p { margin: .3em 0; }
.table { overflow-x: auto; margin: 1em 0; }
table { border-collapse: separate; border-spacing: 0; }
th, td { border-bottom: 1px solid #8884; padding: .35em .7em; }
th, td { text-align: left; vertical-align: top; }
th { font-weight: 600; font-size: 13px; line-height: 1.3; vertical-align: bottom; }
th { min-width: 5em; max-width: 10em; }
td:first-child { min-width: 12em; max-width: 26em; overflow-wrap: anywhere; }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
th:first-child, td:first-child { position: sticky; left: 0; background-color: Canvas; }
tbody tr:hover { background: #8881; }
tbody tr:hover td:first-child { background-image: linear-gradient(#8881, #8881); }
tr.failed td { color: #c62a3a; }
tr.skipped td, tr.not-tried td { color: #888; }
small { color: #888; display: block; }
th button { font: inherit; text-align: inherit; background: none; border: 0; padding: 0; }
th button { color: inherit; cursor: inherit; }
thead th { cursor: pointer; }
thead th[aria-sort=descending] button::after { content: " \\25be"; }
thead th[aria-sort=ascending] button::after { content: " \\25b4"; }
details { margin: .6em 0; }
summary { cursor: pointer; }
img { max-width: 100%; }
.pictures { margin: 1em 0; }
h4.legend { margin: 1.4em 0 .4em; font-size: 13px; }
dl.legend { columns: 24em; column-gap: 2em; margin: 0 0 1.4em; font-size: 13px; }
dl.legend div { break-inside: avoid; margin: 0 0 .35em; }
dt { display: inline; font-weight: 600; }
dd { display: inline; margin: 0; color: color-mix(in srgb, CanvasText 65%, Canvas); }
dt::after { content: ": "; }
@media (max-width: 40em) {
  body { margin: 1em auto; padding: 0 .75em; }
  th, td { padding: .35em .5em; }
  td:first-child { min-width: 8em; max-width: 9em; border-right: 1px solid #8884; }
  th:first-child { border-right: 1px solid #8884; }
}
"""

PLAYER = 640  # pixels of height

# Cells hold what they are sorted by; what is not known comes last, in both directions.
_SCRIPT = """
for (const table of document.querySelectorAll("table")) {
  const heads = [...table.querySelectorAll("thead th")];
  heads.forEach((head, column) => head.addEventListener("click", () => {
    const down = head.getAttribute("aria-sort") !== "descending";
    heads.forEach(other => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const of = row => row.cells[column].dataset.value ?? row.cells[column].textContent;
    const compare = (a, b) => {
      const [x, y] = [of(a), of(b)];
      if (!x || !y) return x ? -1 : y ? 1 : 0;
      const order = isNaN(x) || isNaN(y) ? x.localeCompare(y, undefined, {numeric: true}) : x - y;
      return down ? -order : order;
    };
    const body = table.tBodies[0];
    for (const row of [...body.rows].sort(compare)) body.append(row);
  }));
}
"""


def page(record: dict[str, Any], pictures: Mapping[str, str] = MappingProxyType({})) -> str:
    """The page of a report; ``pictures``: HTML by input."""
    entries = record["files"]
    shown = [figure for figure in FIGURES if _tells(entries, figure[0])]
    words = OF_FILES | {heading: meaning for _, heading, meaning in shown}
    rows = "\n".join(_row(entry, [where for where, *_ in shown]) for entry in entries)
    shows = {entry["input"]: _pictures(entry, pictures) for entry in entries}
    # Of one file what is to be looked at comes first.
    top = shows.pop(entries[0]["input"]) if len(entries) == 1 else ""
    learned = "\n".join(_learned(entry, shows.get(entry["input"], "")) for entry in entries)
    counts = ", ".join(f"{n} {status}" for status, n in record["counts"].items() if n)
    asked = " ".join([record["command"], *map(_spelt, record["options"].items())])
    preset = f", preset {as_text(record['preset'])}" if record["preset"] else ""
    hidden = as_json(record).replace("<", r"\u003c")
    versions = f"jaxmotion {record['jaxmotion']}, JAX {record['jax']}"
    parts = [
        f"<p>{counts}; {as_text(record['end'])}</p>",
        f"<p><code>{as_text(' '.join(asked.split()))}</code>{preset}</p>",
        f"<p>{_when(record['begun'])} to {_when(record['ended'])}; {versions}</p>",
        top,
        _table(list(words), rows, words),
        _legend("What the columns say", words),
        learned,
        *_legends(entries),
        f'<script type="application/json" id="record">\n{hidden}\n</script>',
    ]
    return document(f"jaxmotion {record['command']}", parts)


def _when(time: str) -> str:
    return as_text(time.replace("T", " ").replace("+00:00", " UTC"))


def document(title: str, parts: Sequence[str]) -> str:
    """A page that needs nothing else, of ``parts`` in HTML."""
    head = as_text(title)
    body = "\n".join(parts)
    return f"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>{head}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>{_STYLE}</style>
<h1>{head}</h1>
{body}
<script>{_SCRIPT}</script>
</html>"""


def table_of(
    title: str,
    rows: Sequence[dict[str, Any]],
    headings: Sequence[str] | None = None,
    *,
    folded: bool = False,
) -> str:
    """Rows of the same keys under a heading; ``headings`` of columns, by default the keys."""
    if not rows:
        return ""
    body = "\n".join(f"<tr>{''.join(map(_cell, row.values()))}</tr>" for row in rows)
    words = _NO_WORDS if headings else LEARNED.get(title, _NO_WORDS)
    table, head = _table(headings or list(rows[0]), body, words), as_text(title)
    if folded:
        return f"<details><summary>{head}</summary>{table}</details>"
    return f"<h4>{head}</h4>{table}"


def _legends(entries: Sequence[dict[str, Any]]) -> list[str]:
    """Legends of the tables of what was learned, once each."""
    made = []
    for name, words in LEARNED.items():
        rows = [e["learned"][name] for e in entries if _is_table(e["learned"].get(name))]
        keys = dict.fromkeys(key for table in rows for key in table[0])
        known = {key: words[key] for key in keys if key in words}
        made += [_legend(f"What the columns of {name} say", known)] if known else []
    return made


def _legend(title: str, words: Mapping[str, str]) -> str:
    pairs = (f"<dt>{as_text(n)}</dt><dd>{as_text(text)}</dd>" for n, text in words.items())
    rows = "\n".join(f"<div>{pair}</div>" for pair in pairs)
    return f'<h4 class="legend">{as_text(title)}</h4>\n<dl class="legend">\n{rows}\n</dl>'


def listed(lines: Sequence[str]) -> str:
    """A list."""
    return f"<ul>{''.join(f'<li>{as_text(line)}</li>' for line in lines)}</ul>" if lines else ""


def pictures_in(text: str) -> dict[str, str]:
    """The pictures in a page, by input :func:`as_text`."""
    return dict(re.findall(_PICTURES, text, re.DOTALL))


def _table(headings: Sequence[str], rows: str, words: Mapping[str, str] = _NO_WORDS) -> str:
    """``words``: what columns say, by heading."""
    titles = [f' title="{as_text(words[name])}"' if name in words else "" for name in headings]
    buttons = [f'<button type="button">{as_text(heading)}</button>' for heading in headings]
    head = "".join(f"<th{t}>{button}</th>" for t, button in zip(titles, buttons, strict=True))
    table = f"<table><thead><tr>{head}</tr></thead><tbody>\n{rows}\n</tbody></table>"
    return f'<div class="table">{table}</div>'


def _row(entry: dict[str, Any], shown: Sequence[tuple[str, ...]]) -> str:
    others = [f"with {other['input']}" for other in entry["with"]]
    cells = [_cell(entry["input"], [*others, entry["message"], *entry["warnings"]])]
    if entry["player"]:
        link = f'<a href="{html.escape(entry["player"])}">play</a>'
        cells[0] = cells[0].removesuffix("</td>") + f" {link}</td>"
    cells += [_cell(entry["output"]), _cell(entry["status"])]
    cells += [_cell(_at(entry, where)) for where in shown]
    return f'<tr class="{entry["status"].replace(" ", "-")}">{"".join(cells)}</tr>'


def _pictures(entry: dict[str, Any], pictures: Mapping[str, str]) -> str:
    """What is to be looked at of a file."""
    name = entry["input"]
    if not pictures.get(name):
        return ""
    return f'<div class="pictures" data-input="{as_text(name)}">\n{pictures[name]}\n</div>'


def _learned(entry: dict[str, Any], shown: str) -> str:
    """What was learned of a file, folded: what is ``shown`` of it, values in one table, the tables
    by name."""
    learned = entry["learned"]
    if not (learned or shown):
        return ""
    tables = {name: rows for name, rows in learned.items() if _is_table(rows)}
    values = {name: value for name, value in learned.items() if name not in tables}
    parts = [shown] if shown else []
    if values:
        rows = "\n".join(f"<tr>{_cell(n)}{_cell(v)}</tr>" for n, v in values.items())
        parts.append(_table((), rows))
    parts += [table_of(name, lines) for name, lines in tables.items()]
    title = f"what was learned of {as_text(entry['input'])}"
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
        return f"{_number_cell(value['max'])}{most}<small>{usual}</small></td>"
    if isinstance(value, bool):
        value = "yes" if value else "no"
    if isinstance(value, (int, float)):
        return f"{_number_cell(value)}{_number(value)}{small}</td>"
    return f"<td>{as_text(_words(value))}{small}</td>"


def _number_cell(value: int | float) -> str:
    """What a cell begins with; it is sorted by the whole of its number."""
    known = str(value).replace("inf", "Infinity").replace("nan", "")
    return f'<td class="number" data-value="{known}">'


def _number(value: int | float) -> str:
    return f"{value:.4g}" if isinstance(value, float) else f"{value}"


def _words(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, dict):
        return ", ".join(f"{name}: {_words(item)}" for name, item in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_words, value)) or "none"
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
