"""The record of a run, ``--report``: a JSON object, or a page of HTML that holds it.

It is written when the run ends, also when it fails or is interrupted, whole or not at all. Angles
are in degrees, lengths in the file's own unit, times in UTC; what is not known is null.

| key | what |
|---|---|
| ``jaxmotion``, ``jax`` | versions |
| ``command``, ``options``, ``preset`` | what was asked for, by option; the file of other defaults |
| ``begun``, ``ended`` | when |
| ``end`` | "finished", "interrupted" or "failed: " and why |
| ``counts`` | files by status |
| ``files`` | one a file, in the order they were given: |

| key of a file | what |
|---|---|
| ``input``, ``output`` | names; of clips that are joined, ``input`` is the one edited |
| ``status`` | "written", "read" (nothing is to be written), "skipped", "failed" or "not tried": |
| | nothing had come of it when the run ended |
| ``message``, ``warnings``, ``seconds`` | what was said of it; how long it took |
| ``sha256``, ``unit``, ``frames``, ``rate`` | of the input: hash, metres a unit, frames, a second |
| ``with`` | the same of others that were read: clips that are joined, an .amc's skeleton |
| ``made`` | hashes of the files that were written, by name |
| ``result`` | unit, frames and rate of the clip that was written |
| ``changes`` | as :func:`jaxmotion.metrics.difference` tells: ``frames``, ``frames_changed``, |
| | and ``degrees`` (turns of joints), ``shift`` (of joints in their parents), ``distance`` |
| | (of joints and end sites in the world), ``root`` (its moves), each with ``mean``, ``p95``, |
| | ``max`` and the ``frame``, ``joint`` and whether ``end_site`` of the largest |
| ``feet`` | how they slide, a second: ``slide_before``, ``slide_timed`` (the input's frames in |
| | another timing), ``slide_edited``, ``slide_after``; ``contacts_restored``; ``root_move``, |
| | the furthest that this moved the root |
| ``jerk`` | mean over frames and joints, the file's unit a second³, ``before`` and ``after`` |
| ``player`` | the page on which the clips play, from the report: in a folder beside a page |
| ``learned`` | what the command learned of the clip, by name: values and tables |

A file that ``--resume`` skips keeps its entry in the report that is there, if its outputs are still
those of it, and its pictures and player, which only a page has. So do, after the others and as
skipped, files of that report that are not among the inputs now, if it was of the same command and
options. Of one file a page holds the player itself.
"""

import contextlib
import datetime
import functools
import hashlib
import math
import os
import re
import time
from collections.abc import Callable, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import click

from jaxmotion import __version__
from jaxmotion._plain import as_json, irregular
from jaxmotion.cli import _leaving
from jaxmotion.cli._app import described
from jaxmotion.cli._compared import Compared, is_page
from jaxmotion.cli._earlier import Earlier, sha256
from jaxmotion.cli._files import Job
from jaxmotion.cli._options import NOWHERE, asked_for
from jaxmotion.cli._page import PLAYER, page
from jaxmotion.cli._pictures import shown
from jaxmotion.cli._terminal import say
from jaxmotion.cli._work import Clip, Effect, Outcome
from jaxmotion.io.formats import read_with

if TYPE_CHECKING:
    from jaxmotion.cli._feet import Skate
    from jaxmotion.metrics import Difference, Peak

_STEM = 40  # letters of a file's name that its player's keeps
STATUSES = ("written", "read", "skipped", "failed", "not tried")


def nothing(target: Path) -> Sequence[Path]:
    """The files that come of a target where none do."""
    return ()


class Report:
    """A context that is told of outcomes one by one, and writes the report when it is left, however
    that is; without a ``path`` it does nothing. ``end`` says how the run ended.

    **Arguments:** ``jobs``: all there are; ``writes``: the files that come of a target; ``others``:
    other clips that go into the first job; ``overwrite``: whether a report may be replaced;
    ``resume``: whether entries of the one that is there are kept, of outcomes that are skipped and
    of files that are not among the jobs.
    **Raises:** ``click.UsageError`` for a report that exists or is no file.
    """

    def __init__(
        self,
        path: Path | None,
        jobs: Sequence[Job],
        *,
        writes: Callable[[Path], Sequence[Path]] = nothing,
        others: Sequence[Path] = (),
        overwrite: bool = False,
        resume: bool = False,
    ):
        self.end = "finished"
        self._path = path
        self._guard = contextlib.ExitStack()
        if path is None:
            return
        if kind := irregular(path):
            raise click.UsageError(f"{path} cannot be written: {kind}, not a file")
        several = is_page(path) and len(jobs) > 1
        self._folder = path.with_name(f"{path.stem}-players") if several else None
        for there in (path, self._folder):
            if there is not None and there.exists() and not overwrite:
                raise click.UsageError(f"{there} exists; add --overwrite")
        self._jobs, self._writes, self._others = jobs, writes, others
        self._earlier = Earlier(path if resume else None)
        self._pictures: dict[str, str] = {}
        self._entries: dict[Path, dict[str, Any]] = {}
        context = click.get_current_context()
        options = asked_for(context)
        self._head = {
            "jaxmotion": __version__,
            "jax": metadata.version("jax"),
            "command": options.pop("command"),
            "options": options,
            "preset": context.meta.get("jaxmotion.preset"),
            "begun": _now(),
        }
        self._others_then = self._earlier.others(jobs, self._head)
        self._pictures |= {
            entry["input"]: self._earlier.pictures[entry["input"]] for entry in self._others_then
        }
        self._states = {name: _state(name) for job in jobs for name in self._read_for(job)}

    def __enter__(self) -> "Report":
        if self._path is not None:
            # Imported now: a signal may come at a time when nothing more can be.
            from jaxmotion.io import atomic  # noqa: F401

            act = functools.partial(self._write, "interrupted")
            self._guard.enter_context(_leaving.last_act(act))
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if self._path is None:
            return
        with self._guard:
            if error is None:
                self._write(self.end)
                return
            interrupted = isinstance(error, (KeyboardInterrupt, click.Abort))
            try:
                self._write("interrupted" if interrupted else f"failed: {_why(error)}")
            except OSError as trouble:  # what went wrong first is told by whoever catches it
                say(f"warning: {described(trouble)}", err=True)

    def add(self, outcome: Outcome) -> None:
        """Note what became of a job."""
        if self._path is None:
            return
        job = outcome.job
        entry = self._entry(outcome)
        if outcome.status == "skipped" and (earlier := self._earlier.of(entry)):
            entry = earlier
            self._pictures[entry["input"]] = self._earlier.pictures[entry["input"]]
        if outcome.effect is not None:
            effect = outcome.effect
            parts = [shown(effect.drawings)] if effect.drawings else []
            if effect.compared is not None and effect.compared.page:
                if len(self._jobs) == 1:
                    from jaxmotion.viz.player.page import framed

                    parts.insert(0, framed(effect.compared.page, PLAYER))
                else:
                    entry["player"] = self._written(effect.compared.page, job)
            self._pictures[entry["input"]] = "\n".join(parts)
        self._entries[job.source] = entry

    def _written(self, text: str, job: Job) -> str:
        """A player's page, in the folder beside the report, and how the report calls it."""
        from jaxmotion.io.atomic import atomic_write

        assert self._folder is not None
        self._folder.mkdir(parents=True, exist_ok=True)
        # Of several files of one name in other folders each has its own, the same in every run.
        mark = hashlib.sha256(str(job.source).encode("utf-8", "surrogateescape")).hexdigest()[:8]
        stem = re.sub(r"[^\w-]+", "-", job.source.stem, flags=re.ASCII)[:_STEM].strip("-")
        name = f"{stem or 'clip'}-{mark}.html"
        with atomic_write(self._folder / name) as file:
            file.write(text.encode())
        return quote(os.fsencode(f"{self._folder.name}/{name}"))

    @contextlib.contextmanager
    def attempt(self, job: Job) -> Iterator[Outcome]:
        """An outcome to fill in, added when the block ends: "failed" if by an error."""
        outcome = Outcome(job, "written")
        begun = time.perf_counter()
        try:
            yield outcome
        except Exception as error:
            outcome.status, outcome.message = "failed", _why(error)
            raise
        finally:
            outcome.seconds = time.perf_counter() - begun
            self.add(outcome)

    def _read_for(self, job: Job) -> list[Path]:
        """A job's source, and the files that are read with it."""
        return [file for clip in (job.source, *self._others) for file in (clip, *read_with(clip))]

    def _entry(self, outcome: Outcome) -> dict[str, Any]:
        job, effect = outcome.job, outcome.effect or Effect(())
        names = self._read_for(job)
        clips = dict(zip((job.source, *self._others), effect.read, strict=False))
        changed = [name for name in names if _state(name) != self._states[name]]
        warnings = [f"{name} changed while it was worked on: no hash of it" for name in changed]
        first, *others = (
            {
                "input": str(name),
                "sha256": None if name in changed else sha256(name),
                **_clip(clips.get(name)),
            }
            for name in names
        )
        is_made = outcome.status in ("written", "skipped")
        return {
            **_blank(job),
            **first,
            "status": outcome.status,
            "message": outcome.message or effect.message,
            "warnings": [*outcome.warnings, *warnings],
            "seconds": round(outcome.seconds, 3),
            "with": others,
            "made": {str(p): sha256(p) for p in self._writes(job.target)} if is_made else {},
            "result": effect.made and _clip(effect.made),
            "changes": effect.change and _changes(effect.change),
            "feet": effect.skate and _feet(effect.skate),
            "jerk": effect.compared and _jerk(effect.compared),
            "learned": effect.learned,
        }

    def _write(self, end: str) -> None:
        from jaxmotion.io.atomic import atomic_write

        assert self._path is not None
        entries = [self._entries.get(job.source) or _blank(job) for job in self._jobs]
        entries += self._others_then
        counts = {status: sum(e["status"] == status for e in entries) for status in STATUSES}
        record = {**self._head, "ended": _now(), "end": end, "counts": counts, "files": entries}
        is_json = self._path.suffix.lower() == ".json"
        text = as_json(record, indent=1) if is_json else page(record, self._pictures)
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(self._path) as file:
            file.write((text + "\n").encode())


def _blank(job: Job) -> dict[str, Any]:
    """The entry of a file of which nothing is known."""
    target = None if job.target == NOWHERE else str(job.target)
    return {
        "input": str(job.source),
        "output": target,
        "status": "not tried",
        "message": "",
        "warnings": [],
        "seconds": None,
        "sha256": None,
        **_clip(None),
        "with": [],
        "made": {},
        "result": None,
        "changes": None,
        "feet": None,
        "jerk": None,
        "player": None,
        "learned": {},
    }


def _clip(clip: Clip | None) -> dict[str, Any]:
    return {name: getattr(clip, name, None) for name in ("unit", "frames", "rate")}


def _changes(change: "Difference") -> dict[str, Any]:
    return {
        "frames": change.frames,
        "frames_changed": change.frames_changed,
        "degrees": _peak(change.angle, math.degrees(1)),
        "shift": _peak(change.shift),
        "distance": change.distance and _peak(change.distance),
        "root": _peak(change.root),
    }


def _peak(peak: "Peak", scale: float = 1.0) -> dict[str, Any]:
    figures = {"mean": peak.mean, "p95": peak.p95, "max": peak.value}
    place = {"frame": peak.frame, "joint": peak.joint, "end_site": peak.end_site}
    return {name: scale * value for name, value in figures.items()} | place


def _feet(skate: "Skate") -> dict[str, Any]:
    return {
        "slide_before": skate.before,
        "slide_timed": skate.timed,
        "slide_edited": skate.edited,
        "slide_after": skate.after,
        "contacts_restored": skate.contacts,
        "root_move": skate.root,
    }


def _jerk(beside: Compared) -> dict[str, Any]:
    return dict(zip(("before", "after"), beside.jerk, strict=True))


def _state(path: Path) -> tuple[int, int] | None:
    """What differs if a file is written to."""
    try:
        facts = path.stat()
    except OSError:
        return None
    return facts.st_size, facts.st_mtime_ns


def _why(error: BaseException) -> str:
    return error.message if isinstance(error, click.ClickException) else described(error)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
