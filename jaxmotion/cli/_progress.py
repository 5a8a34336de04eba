"""Progress on stderr: a bar with the time left on a terminal, else a plain line a file."""

import os
import re
import sys
import time
from contextlib import ExitStack

from jaxmotion._plain import printable
from jaxmotion.cli import _leaving
from jaxmotion.cli._terminal import say
from jaxmotion.cli._work import Effect, Outcome

_NAMED, _LONG = 3, 64
_MEASURED = re.compile(r"\d+\.\d+|\d+(?= m\b)")  # in which warnings of many files may differ
_SHOW_CURSOR = b"\x1b[?25h\n"


class Progress:
    """A context that is told of outcomes one by one."""

    def __init__(self, total: int):
        self._total = total
        self._done = 0
        self._begun = time.perf_counter()
        self._warned: dict[str, tuple[str, list[str]]] = {}
        self._bar = None
        self._cleanup = ExitStack()
        if total > 1 and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            console = Console(stderr=True, highlight=False, markup=False, emoji=False)
            pace_of = TextColumn("{task.fields[pace]}")
            columns = (BarColumn(), MofNCompleteColumn(), pace_of, TimeRemainingColumn())
            self._bar = Bar(*columns, console=console)
            self._task = self._bar.add_task("", total=total, pace="")

    def __enter__(self) -> "Progress":
        if self._bar is not None:
            # The bar hides the cursor; its own way of showing it may wait for a lock.
            self._cleanup.enter_context(_leaving.last_act(lambda: os.write(2, _SHOW_CURSOR)))
            self._cleanup.enter_context(self._bar)
        return self

    def __exit__(self, *_) -> None:
        self._cleanup.close()
        for text, files in self._warned.values():
            if len(files) > 1:
                names = f" ({', '.join(files)})" if len(files) <= _NAMED else ""
                say(f"that warning, of {len(files)} files{names}: {shortened(text)}", err=True)

    def tell(self, outcome: Outcome) -> None:
        """Show one outcome."""
        self._done += 1
        lines = [line_about(outcome)]
        if outcome.effect and outcome.effect.note:
            lines.append(f"  {outcome.effect.note}")
        for text in outcome.warnings:  # each in full once, and at the end how often it came
            kind = _MEASURED.sub("", text)
            if kind not in self._warned:
                lines.append(f"  warning: {text}")
            self._warned.setdefault(kind, (text, []))[1].append(printable(outcome.job.source))
        if self._bar is not None:
            for line in lines:
                self._bar.console.print(printable(line), soft_wrap=True)
            told = pace((time.perf_counter() - self._begun) / self._done)
            self._bar.update(self._task, completed=self._done, pace=told)
            return
        if self._total > 1:
            left = self._total - self._done
            each = (time.perf_counter() - self._begun) / self._done
            lines[0] = f"[{self._done}/{self._total}] {lines[0]}"
            lines[0] += f" ({pace(each)}, about {duration(each * left)} left)" if left else ""
        say(*lines, err=True)


def line_about(outcome: Outcome) -> str:
    """An outcome in a line."""
    source, target = printable(outcome.job.source), printable(outcome.job.target)
    if outcome.status == "failed":
        return f"FAILED {source}: {outcome.message.removeprefix(f'{source}: ')}"
    if outcome.status == "skipped":
        return f"{target}: skipped, {outcome.message}"
    return f"{target}: {_effect(outcome.effect) if outcome.effect else 'written'}"


def _effect(effect: Effect) -> str:
    text, change = effect.message or "written", effect.change
    if change is not None and not effect.message:
        text = f"{change.frames_changed} of {change.frames} frames changed"
        if change.frames_changed:
            text += f", by up to {_degrees(change.angle.value)} at {change.angle.joint}"
    return f"{text}; {effect.skate}" if effect.skate is not None else text


def shortened(text: str) -> str:
    """The first words of a text."""
    return text if len(text) <= _LONG else f"{text[:_LONG].rpartition(' ')[0]} ..."


def pace(seconds: float) -> str:
    """Files a second, or a minute, that take so long each."""
    rate = 1 / max(seconds, 1e-3)
    return f"{rate:.3g} files/s" if rate >= 1 else f"{60 * rate:.3g} files/min"


def duration(seconds: float) -> str:
    """42 s, 3 min, 2 h 05 min."""
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60:02d} min"


def _degrees(radians: float) -> str:
    import math

    return f"{math.degrees(radians):.3g}°"
