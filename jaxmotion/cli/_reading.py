"""Many files in, none out: what ``info`` and ``check`` go through."""

import traceback
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from jaxmotion._plain import printable
from jaxmotion.cli import _files, _session
from jaxmotion.cli._app import described
from jaxmotion.cli._options import Reading, Running
from jaxmotion.cli._terminal import say
from jaxmotion.cli._work import read, told

if TYPE_CHECKING:
    from jaxmotion import Motion


@dataclass
class Item:
    """A file that was read, or not: ``motion`` is None and ``error`` says why."""

    path: Path
    motion: "Motion | None"
    warnings: list[str]
    error: str = ""


def each(
    files: Sequence[str],
    reading: Reading,
    running: Running,
    *,
    complain: bool = True,
    uses_up: bool = False,
) -> Iterator[Item]:
    """Read file after file; those that fail are told of on stderr if ``complain``; ``uses_up``: as
    :func:`~jaxmotion.cli._work.read`."""
    inputs = _files.expand(files)
    little = _session.is_little(source.path for source in inputs)
    _session.start(cache=running.cache, little=little)
    for source in inputs:
        item = Item(source.path, None, [])
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                item.motion = read(source.path, reading, uses_up=uses_up)
            except Exception as error:
                item.error = described(error)
                if running.debug:
                    say(*traceback.format_exc().splitlines(), err=True)
                if complain:
                    name = printable(source.path)
                    say(f"FAILED {name}: {item.error.removeprefix(f'{name}: ')}", err=True)
        item.warnings = told(caught, source.path)
        yield item
