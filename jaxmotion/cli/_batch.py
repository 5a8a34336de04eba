"""Many files through one process: who goes where, one after the other or side by side, what failed.

Files that fail do not stop the others unless asked. With several processes each sets up JAX for
itself (``spawn``), and stops cleanly when the run is interrupted: nothing half-written stays.
"""

import multiprocessing
import signal
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jaxmotion.cli import _files, _session, leave
from jaxmotion.cli._files import Job
from jaxmotion.cli._options import Batch, Running, Selection
from jaxmotion.cli._progress import Progress
from jaxmotion.cli._work import Editing, Outcome, edit_file, guarded

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion.metrics import Difference


def edit_files(
    edit: "Callable[[Motion, int], Motion]",
    batch: Batch,
    running: Running,
    selection: Selection,
    *,
    to: str | None = None,
    uses_up: bool = False,
) -> None:
    """Send every input through ``edit`` and leave with an exit code.

    **Arguments:** ``edit``: (motion, number of frames that count) to a motion of the same shape;
    a function that can be pickled; ``to``: suffix of the outputs, by default the inputs' own;
    ``uses_up``: whether it goes by the up axis.
    """
    inputs = _files.expand(batch.files, avoid=batch.out)
    jobs = _files.plan(inputs, batch.out, to=to)
    editing = Editing(
        edit,
        selection,
        batch.reading,
        batch.out_up,
        batch.overwrite,
        measured=batch.report is not None,
        uses_up=uses_up,
    )
    run(partial(edit_file, editing), jobs, batch, running)


def run(
    process: "Callable[[Job], Difference | str | None]",
    jobs: Sequence[Job],
    batch: Batch,
    running: Running,
    *,
    writes: Callable[[Path], Sequence[Path]] | None = None,
) -> None:
    """Run ``process`` on every job, tell of it, and leave with an exit code.

    **Arguments:** ``process``: a function that can be pickled, which raises on failure;
    ``writes``: the files that come of a target, by default the target (and an .amc's .asf).
    """
    report = batch.report
    if report is not None and report.exists() and not (batch.overwrite or batch.resume):
        raise click.UsageError(f"{click.format_filename(report)} exists; add --overwrite")
    early, ready = _sorted_out(jobs, batch, writes or _files_of)
    if batch.dry_run:
        for outcome in early:
            click.echo(f"{_arrow(outcome.job)}: {outcome.message}")
        for job in ready:
            click.echo(_arrow(job))
        click.echo(f"{len(ready)} files would be written.", err=True)
        raise click.exceptions.Exit(0)
    outcomes = _run_all(process, early, ready, batch, running)
    if report is not None:
        from jaxmotion.cli._report import write_report

        write_report(report, outcomes)
    counts = {s: sum(o.status == s for o in outcomes) for s in ("written", "skipped", "failed")}
    if len(jobs) > 1:
        click.echo(", ".join(f"{n} {s}" for s, n in counts.items() if n) + ".", err=True)
        if left := len(jobs) - len(outcomes):
            click.echo(f"Stopped at the first failure; {left} not tried.", err=True)
    raise click.exceptions.Exit(1 if counts["failed"] else 0)


def _sorted_out(
    jobs: Sequence[Job], batch: Batch, writes: Callable[[Path], Sequence[Path]]
) -> tuple[list[Outcome], list[Job]]:
    """Outcomes that are known before the work begins, and the jobs to do."""
    early, ready = [], []
    for job in jobs:
        there = [path for path in writes(job.target) if path.exists()]
        if batch.resume and len(there) == len(writes(job.target)):
            made = min(path.stat().st_mtime_ns for path in there)
            if made >= job.source.stat().st_mtime_ns:
                early.append(Outcome(job, "skipped", "newer than its input"))
                continue
        if there and not batch.overwrite:
            name = click.format_filename(there[0])
            early.append(Outcome(job, "failed", f"{name} exists; add --overwrite to replace it"))
            continue
        ready.append(job)
    return early, ready


def _run_all(
    process: Callable, early: list[Outcome], ready: list[Job], batch: Batch, running: Running
) -> list[Outcome]:
    outcomes: list[Outcome] = []
    alone = batch.jobs == 1 or len(ready) <= 1
    results = _one_by_one if alone else partial(_side_by_side, processes=batch.jobs)
    with (
        Progress(len(early) + len(ready)) as progress,
        closing(results(process, ready, running)) as later,
    ):
        for outcome in chain(early, later):
            progress.tell(outcome)
            if outcome.traceback and running.debug:
                click.echo(outcome.traceback, err=True)
            outcomes.append(outcome)
            if outcome.status == "failed" and batch.fail_fast:
                break
    return outcomes


def _one_by_one(process: Callable, jobs: list[Job], running: Running) -> Generator[Outcome]:
    if jobs:
        little = _session.is_little(job.source for job in jobs)
        _session.start(cache=running.cache, little=little)
    for job in jobs:
        yield guarded(process, job)


def _side_by_side(
    process: Callable, jobs: list[Job], running: Running, *, processes: int
) -> Generator[Outcome]:
    processes = min(processes, len(jobs))
    little = _session.is_little(job.source for job in jobs)
    pool = ProcessPoolExecutor(
        processes,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_start_worker,
        initargs=(running.cache, little, processes),
    )
    waiting = {pool.submit(guarded, process, job): job for job in jobs}
    try:
        for future in as_completed(waiting):
            try:
                yield future.result()
            except Exception as error:  # the process died: out of memory, say
                yield Outcome(waiting[future], "failed", f"its process died ({error})")
    except BaseException:
        for worker in multiprocessing.active_children():
            worker.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _start_worker(cache: bool, little: bool, processes: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, leave)
    _session.start(cache=cache, little=little, notice=False, share=processes)


def _files_of(target: Path) -> list[Path]:
    return [target, target.with_suffix(".asf")] if target.suffix.lower() == ".amc" else [target]


def _arrow(job: Job) -> str:
    return f"{click.format_filename(job.source)} -> {click.format_filename(job.target)}"
