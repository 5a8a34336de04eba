"""Many files through one process: who goes where, one after the other or side by side, what failed.

Files that fail do not stop the others unless asked. Nothing half-written stays: not of this run if
it is interrupted, not of one before that was killed.
"""

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jaxmotion._plain import irregular, printable
from jaxmotion.cli import _files, _leaving, _session
from jaxmotion.cli._feet import find_feet, keep_contacts
from jaxmotion.cli._files import Job
from jaxmotion.cli._options import Batch, Running, Selection, asked_for
from jaxmotion.cli._progress import Progress, line_about
from jaxmotion.cli._record import Record
from jaxmotion.cli._report import Report, nothing
from jaxmotion.cli._terminal import say
from jaxmotion.cli._work import Edited, Editing, Effect, Outcome, edit_file, guarded
from jaxmotion.io.formats import files_of, lacking_for

_FIRST_FAILURE = "stopped at the first failure"

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion.contacts import Contacts


def edit_files(
    edit: "Callable[[Motion, int], Edited]",
    batch: Batch,
    running: Running,
    selection: Selection,
    *,
    keep: bool | None = None,
    find: "Callable[[Motion, int], Contacts]" = find_feet,
    restore: "Callable[[Motion, Motion, Contacts, int], Motion]" = keep_contacts,
) -> None:
    """Send every input through ``edit`` and leave with an exit code.

    **Arguments:** ``edit``: (motion, number of frames that count) to a motion of the same shape,
    in an :class:`Edited`; a function that can be pickled; ``keep``, ``find`` and ``restore``: as
    :class:`Editing`.
    """
    jobs = _files.plan(_files.expand(batch.files, avoid=batch.out), batch.out)
    editing = Editing(
        edit,
        selection,
        batch.reading,
        batch.out_up,
        batch.overwrite,
        report=batch.report,
        keep=keep,
        find=find,
        restore=restore,
    )
    run(partial(edit_file, editing), jobs, batch, running)


def run(
    process: Callable[[Job], Effect],
    jobs: Sequence[Job],
    batch: Batch,
    running: Running,
    *,
    writes: Callable[[Path], Sequence[Path]] | None = None,
    heavy: bool = False,
) -> None:
    """Run ``process`` on every job, tell of it, and leave with an exit code.

    **Arguments:** ``process``: a function that can be pickled, which raises on failure;
    ``writes``: the files that come of a target, by default the target (and an .amc's .asf);
    ``heavy``: whether a file takes longer than compiling for it.
    """
    writes = writes or files_of
    if batch.cluster is None:
        suffixes = {job.target.suffix.lower(): job.target for job in jobs}
        if lacks := next(filter(None, map(lacking_for, suffixes.values())), ""):
            raise click.ClickException(lacks)  # once, not of every file
    replaced = batch.overwrite or batch.resume
    report = Report(batch.report, jobs, writes=writes, overwrite=replaced, resume=batch.resume)
    options = asked_for(click.get_current_context())
    record = Record(options, spared=None if batch.resume else batch.out)
    early, ready = _sorted_out(jobs, batch, writes, record)
    if batch.dry_run:
        for outcome in early:
            say(f"{_arrow(outcome.job)}: {outcome.message}")
        for job in ready:
            say(_arrow(job))
        say(f"{len(ready)} files would be written.", err=True)
        raise click.exceptions.Exit(0)
    outputs = [path for job in jobs for path in writes(job.target)]
    clear = _files.clearing([*outputs, *([batch.report] if batch.report else [])])
    clear()
    record.forget(job.target for job in ready)
    statuses: list[str] = []
    with report, _leaving.last_word(lambda: _how_to_go_on(len(jobs), statuses)):
        little = not heavy and _session.is_little(job.source for job in jobs)
        results = _results(process, ready, batch, running, clear, little, writes)
        for outcome in _outcomes(results, early, len(ready), batch, running):
            if outcome.status == "written":
                record.note(outcome.job.target)
            statuses.append(outcome.status)
            report.add(outcome)
        left = len(jobs) - len(statuses)
        report.end = f"failed: {_FIRST_FAILURE}" if left else report.end
    counts = {s: statuses.count(s) for s in ("written", "skipped", "failed")}
    if len(jobs) > 1:
        say(", ".join(f"{n} {s}" for s, n in counts.items() if n) + ".", err=True)
        if left:
            say(f"{_FIRST_FAILURE.capitalize()}; {left} not tried.", err=True)
    raise click.exceptions.Exit(1 if counts["failed"] else 0)


def look(
    process: Callable[[Job], Effect],
    jobs: Sequence[Job],
    batch: Batch,
    running: Running,
    *,
    tell: Callable[[Outcome], Sequence[str]],
    heavy: bool = False,
) -> None:
    """Run ``process``, which writes nothing, on every job, print what there is to ``tell`` of each,
    and leave with an exit code; ``heavy``: as :func:`run`."""
    if batch.dry_run:
        say(f"nothing would be written; {len(jobs)} files would be looked at.", err=True)
        raise click.exceptions.Exit(0)
    failed = 0
    replaced = batch.overwrite or batch.resume
    with Report(batch.report, jobs, overwrite=replaced, resume=batch.resume) as report:
        little = not heavy and _session.is_little(job.source for job in jobs)
        for outcome in _results(process, jobs, batch, running, lambda: None, little, nothing):
            if outcome.status == "failed":
                failed += 1
                say(line_about(outcome), err=True)
            else:
                outcome.status = "read"
                say(*tell(outcome))
            if outcome.traceback and running.debug:
                say(*outcome.traceback.splitlines(), err=True)
            say(*(f"  warning: {text}" for text in outcome.warnings), err=True)
            report.add(outcome)
            if failed and batch.fail_fast:
                report.end = f"failed: {_FIRST_FAILURE}"
                break
    raise click.exceptions.Exit(1 if failed else 0)


def _how_to_go_on(jobs: int, statuses: list[str]) -> str:
    """What to say of a run of several files that is interrupted."""
    done = sum(status in ("written", "skipped") for status in statuses)
    hint = f"{done} of {jobs} files are done; the same command with --resume goes on from there."
    return hint if jobs > 1 else ""


def _sorted_out(
    jobs: Sequence[Job], batch: Batch, writes: Callable[[Path], Sequence[Path]], record: Record
) -> tuple[list[Outcome], list[Job]]:
    """Outcomes that are known before the work begins, and the jobs to do."""
    early, ready = [], []
    for job in jobs:
        outputs, otherwise = writes(job.target), ""
        there = [path for path in outputs if path.exists()]
        if odd := [path for path in there if irregular(path)]:
            message = f"{printable(odd[0])} cannot be written: {irregular(odd[0])}, not a file"
            early.append(Outcome(job, "failed", message))
            continue
        if batch.resume and len(there) == len(outputs) and _are_newer(there, job.source):
            otherwise = record.otherwise(job.target)
            if not otherwise:
                known = "" if record.knows(job.target) else "; its options are not on record"
                early.append(Outcome(job, "skipped", f"newer than its input{known}"))
                continue
        if there and not batch.overwrite:
            made = f"was made {otherwise}" if otherwise else "exists"
            message = f"{printable(there[0])} {made}; add --overwrite to replace it"
            early.append(Outcome(job, "failed", message))
        else:
            ready.append(job)
    return early, ready


def _are_newer(outputs: Sequence[Path], source: Path) -> bool:
    try:
        made = min(path.stat().st_mtime_ns for path in outputs)
        return made >= source.stat().st_mtime_ns
    except OSError:  # gone meanwhile: reading or writing it will tell
        return False


def _outcomes(
    results: Generator[Outcome], early: list[Outcome], ready: int, batch: Batch, running: Running
) -> Generator[Outcome]:
    """All of them as they come, told of on the way, up to the first failure if asked."""
    with Progress(len(early) + ready) as progress, closing(results) as later:
        for outcome in chain(early, later):
            progress.tell(outcome)
            if outcome.traceback and running.debug:
                say(*outcome.traceback.splitlines(), err=True)
            yield outcome
            if outcome.status == "failed" and batch.fail_fast:
                break


def _results(
    process: Callable,
    jobs: Sequence[Job],
    batch: Batch,
    running: Running,
    clear: Callable[[], None],
    little: bool,
    writes: Callable[[Path], Sequence[Path]],
) -> Generator[Outcome]:
    """Outcomes one by one, or as they come from processes side by side or from a cluster."""
    if batch.cluster is not None and jobs:
        from jaxmotion.cli._cluster import on_cluster

        return on_cluster(
            process, jobs, batch, cache=running.cache, clear=clear, little=little, writes=writes
        )
    if batch.jobs == 1 or len(jobs) <= 1:
        return _one_by_one(process, jobs, running, little)
    from jaxmotion.cli._workers import side_by_side

    return side_by_side(
        process,
        jobs,
        processes=batch.jobs,
        cache=running.cache,
        clear=clear,
        notice=True,
        little=little,
    )


def _one_by_one(
    process: Callable, jobs: Sequence[Job], running: Running, little: bool
) -> Generator[Outcome]:
    if jobs:
        _session.start(cache=running.cache, little=little)
    for job in jobs:
        yield guarded(process, job)


def _arrow(job: Job) -> str:
    return f"{job.source} -> {job.target}"
