"""What the report of an earlier run knows, for a run that goes on from there, ``--resume``.

A file's entry holds as long as its outputs are those of which it has the hashes; where nothing was
written, as long as the input is.
"""

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import unquote_to_bytes

from jaxmotion._plain import as_json
from jaxmotion.cli._files import Job, real
from jaxmotion.cli._options import NOWHERE
from jaxmotion.cli._page import RECORD, as_text, pictures_in

Entry: TypeAlias = dict[str, Any]


class Earlier:
    """The report at ``path``, if there is one that can be read.

    **Fields:** ``pictures``: what there is to look at of a file, by input.
    """

    def __init__(self, path: Path | None):
        self._path = path
        self._record, self.pictures = ({}, {}) if path is None else _read(path)
        entries = self._record.get("files", ())
        self._by_output = {entry["output"]: entry for entry in entries}
        self._by_hash = {_hashes(entry): entry for entry in entries}

    def of(self, entry: Entry) -> Entry | None:
        """What was known of a file that is skipped, whatever its folders were called then."""
        old = self._by_output.get(entry["output"])
        if old is None or old["made"] != entry["made"]:
            old = self._by_hash.get(_hashes(entry))
        if old is None or not entry["made"] or len(old["with"]) != len(entry["with"]):
            return None
        self.pictures.setdefault(entry["input"], self.pictures.get(old["input"], ""))
        named = zip(old["with"], entry["with"], strict=True)
        now: Entry = {name: entry[name] for name in ("input", "output", "made")}
        now["with"] = [then | {"input": other["input"]} for then, other in named]
        return self._kept(old) | now | {"message": old["message"] or entry["message"]}

    def others(self, jobs: Sequence[Job], head: Mapping[str, Any]) -> list[Entry]:
        """Entries of files that are not among the ``jobs``, if that run was asked for the same."""
        asked = ("command", "options")
        now = json.loads(as_json({key: head[key] for key in asked}))
        if any(self._record.get(key) != now[key] for key in asked):
            return []
        here = {real(job.source if job.target == NOWHERE else job.target) for job in jobs}
        return [
            self._kept(entry)
            for entry in self._record["files"]
            if real(Path(entry["output"] or entry["input"])) not in here and _holds(entry)
        ]

    def _kept(self, entry: Entry) -> Entry:
        """An entry that this run did nothing for."""
        return entry | {"status": "skipped", "player": self._there(entry["player"])}

    def _there(self, link: str | None) -> str | None:
        """A link of the report to a page, if that is there still."""
        assert self._path is not None
        page = self._path.parent / os.fsdecode(unquote_to_bytes(link or ""))
        return link if page.is_file() else None


def sha256(path: Path) -> str | None:
    """Of a file, if it can be read."""
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None


def _read(path: Path) -> tuple[Entry, dict[str, str]]:
    """The record in a report, and pictures by input; nothing if it is not to be read."""
    with contextlib.suppress(OSError, ValueError, LookupError, TypeError):
        text = path.read_text("utf-8")
        pictures = pictures_in(text)
        if path.suffix.lower() != ".json":
            text = re.findall(RECORD, text, re.DOTALL)[0]
        record = json.loads(text)
        shown = {e["input"]: pictures.get(as_text(e["input"]), "") for e in record["files"]}
        if all(entry.keys() >= _NEEDED for entry in record["files"]):
            return record, shown
    return {}, {}


_NEEDED = {"input", "output", "made", "message", "player", "sha256", "status", "with"}


def _hashes(entry: Entry) -> tuple[Any, ...]:
    """What tells a file's entry wherever its folders are."""
    name = os.path.basename(entry["output"] or "")
    return name, entry["sha256"], tuple(sorted(map(str, entry["made"].values())))


def _holds(entry: Entry) -> bool:
    if entry["made"]:
        return all(sha256(Path(name)) == known for name, known in entry["made"].items())
    looked_at = entry["status"] in ("read", "skipped") and entry["sha256"] is not None
    return looked_at and sha256(Path(entry["input"])) == entry["sha256"]
