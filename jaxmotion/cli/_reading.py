"""Many files in, none out: what ``info`` and ``check`` go through."""

import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from jaxmotion._plain import printable
from jaxmotion.cli import _session
from jaxmotion.cli._app import described
from jaxmotion.cli._files import Input, Job
from jaxmotion.cli._options import NOWHERE, Reading, Running
from jaxmotion.cli._report import Report
from jaxmotion.cli._terminal import say
from jaxmotion.cli._work import Clip, Effect, Learned, Outcome, read, told

if TYPE_CHECKING:
    from jaxmotion import Motion


@dataclass
class Item:
    """A file that was read, or not: ``motion`` is None and ``error`` says why."""

    path: Path
    motion: "Motion | None"
    warnings: list[str]
    error: str = ""
    seconds: float = 0.0

    def outcome(self, learned: Learned, message: str = "") -> Outcome:
        """What a report says of it."""
        job, status = Job(self.path, NOWHERE), "read" if self.motion is not None else "failed"
        read = () if self.motion is None else (Clip.of(self.motion),)
        effect = Effect(read, message=message, learned=learned)
        return Outcome(job, status, self.error, self.warnings, self.seconds, effect)


def report_of(inputs: Sequence[Input], path: Path | None, overwrite: bool) -> Report:
    """The report of files that are read only."""
    return Report(path, [Job(item.path, NOWHERE) for item in inputs], overwrite=overwrite)


def each(
    inputs: Sequence[Input],
    reading: Reading,
    running: Running,
    *,
    complain: bool = True,
    uses_up: bool = False,
) -> Iterator[Item]:
    """Read file after file; those that fail are told of on stderr if ``complain``; ``uses_up``: as
    :func:`~jaxmotion.cli._work.read`."""
    little = _session.is_little(source.path for source in inputs)
    _session.start(cache=running.cache, little=little)
    for source in inputs:
        item, begun = Item(source.path, None, []), time.perf_counter()
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
        item.seconds = time.perf_counter() - begun
        yield item
