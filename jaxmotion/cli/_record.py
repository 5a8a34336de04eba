"""Which options an output was made with: the record that ``--resume`` goes by.

A folder of outputs keeps it in a hidden file, a line of JSON an output, of which the last counts. A
line is added when an output is whole. Before one of other options is replaced, a line says that its
options are unknown: a run that is killed in between leaves nothing that is told wrong. Runs that
share a folder add lines side by side.
"""

import functools
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from jaxmotion._plain import as_json, in_words
from jaxmotion.cli._terminal import say

NAME = ".jaxmotion-made"


class Record:
    """The record of the folders that a run writes to.

    **Arguments:** ``options``: what the run was asked for, as
    :func:`~jaxmotion.cli._options.asked_for` has it; ``spared``: a file that is noted only if it
    is on record, for who writes one file wants no other beside it.
    """

    def __init__(self, options: dict[str, Any], *, spared: Path | None = None):
        self._options = json.loads(as_json(options))  # as it is read back
        self._spared = spared
        self._entries = functools.cache(_entries)
        self._told = False

    def knows(self, target: Path) -> bool:
        """Whether there is a line on an output."""
        return target.name in self._entries(target.parent)

    def otherwise(self, target: Path) -> str:
        """How an output on record was made, if not as this run is asked to; else nothing."""
        if not self.knows(target):
            return ""
        options = self._entries(target.parent)[target.name]
        if options is None:
            return "with options that are not on record"
        if options == self._options:
            return ""
        if options.get("command") != self._options["command"]:
            return f"by {options.get('command')}"
        keys = dict.fromkeys([*options, *self._options])
        return ", ".join(
            _spelt(key, options.get(key))
            for key in keys
            if options.get(key) != self._options.get(key)
        )

    def forget(self, targets: Iterable[Path]) -> None:
        """Say that outputs made otherwise are about to be replaced."""
        for target in targets:
            if self.otherwise(target):
                self._add(target, None)

    def note(self, target: Path) -> None:
        """Say that an output was made as this run is asked to."""
        if target != self._spared or self.knows(target):
            self._add(target, self._options)

    def _add(self, target: Path, options: dict[str, Any] | None) -> None:
        line = as_json({"output": target.name, "options": options})
        try:
            with open(target.parent / NAME, "ab") as file:
                file.write(f"\n{line}".encode())  # first: the line before may be cut off
        except OSError as error:
            if not self._told:
                say(f"warning: {target.parent / NAME}: {in_words(error)}", err=True)
            self._told = True


def _entries(folder: Path) -> dict[str, dict[str, Any] | None]:
    """The options of a folder's outputs, ``None`` where they are unknown."""
    try:
        lines = (folder / NAME).read_bytes().splitlines()
    except OSError:  # most often: there is none
        return {}
    found = {}
    for line in lines:
        try:
            entry = json.loads(line)
            found[entry["output"]] = entry["options"]
        except (ValueError, KeyError, TypeError):  # cut off by a kill or a full disk
            continue
    return found


def _spelt(key: str, value: Any) -> str:
    parts = [p for p in (value if isinstance(value, list) else [value]) if p not in (None, [])]
    if not parts or value is False:
        return f"without --{key}"
    return " ".join([f"with --{key}", *(str(part) for part in parts if part is not True)])
