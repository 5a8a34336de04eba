"""Jobs side by side in processes of their own.

Every worker sets up JAX for itself (``spawn``), is given one job at a time through a pipe and sends
its outcome back. One that dies, out of memory say, takes only its job with it: another takes its
place. A worker leaves when its pipe is closed or its parent is gone.
"""

import functools
import multiprocessing
from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from jaxmotion.cli import _leaving, _session
from jaxmotion.cli._files import Job
from jaxmotion.cli._work import Outcome, guarded

_PATIENCE = 5.0  # seconds that a worker may take to end


def side_by_side(
    process: Callable,
    jobs: Sequence[Job],
    *,
    processes: int,
    cache: bool,
    clear: Callable,
    notice: bool = False,
    little: bool = False,
) -> Generator[Outcome]:
    """Outcomes of ``process`` on every job, as they come.

    **Arguments:** ``process``: a function that can be pickled; ``processes``: how many at a time;
    ``clear``: called after workers have died over their work, to take away what they left;
    ``notice``: whether the first says when compiling takes a while; ``little``: whether they take
    less time than compiling for them.
    """
    count = min(processes, len(jobs))
    settings = (process, cache, little, count)
    waiting = deque(jobs)
    busy: dict[Connection, tuple[BaseProcess, Job]] = {}
    idle: list[tuple[Connection, BaseProcess]] = []

    def kill() -> None:
        workers = [worker for worker, _ in busy.values()] + [worker for _, worker in idle]
        for worker in workers:
            worker.kill()
        for worker in workers:
            worker.join(_PATIENCE)
        if busy:
            clear()

    with _leaving.last_act(kill):
        try:
            while waiting or busy:
                while waiting and len(busy) < count:
                    first = notice and not (busy or idle)
                    pipe, worker = idle.pop() if idle else _started((*settings, first))
                    job = waiting.popleft()
                    busy[pipe] = worker, job
                    _send(pipe, job)
                for pipe in wait(list(busy)):
                    worker, job = busy.pop(pipe)  # type: ignore[index]
                    outcome = _received(pipe)  # type: ignore[arg-type]
                    if outcome is None:
                        worker.join(_PATIENCE)
                        clear()
                        outcome = Outcome(job, "failed", _death(worker))
                    else:
                        idle.append((pipe, worker))  # type: ignore[arg-type]
                    yield outcome
            for pipe, _ in idle:
                pipe.close()
            for _, worker in idle:
                worker.join(_PATIENCE)
        finally:
            kill()


def _started(settings: tuple) -> tuple[Connection, BaseProcess]:
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    worker = context.Process(target=_serve, args=(there, *settings), daemon=True)
    with _leaving.interrupts_held():
        worker.start()
    there.close()  # the worker's death closes the other copy, and the pipe with it
    return here, worker


def _send(pipe: Connection, job: Job) -> None:
    with suppress(OSError):  # it has died: receiving from it tells
        pipe.send(job)


def _received(pipe: Connection) -> Outcome | None:
    """What a worker sent, ``None`` if it died."""
    try:
        return pipe.recv()
    except (EOFError, OSError):
        pipe.close()
        return None


def _death(worker: BaseProcess) -> str:
    code = worker.exitcode or 0
    if code == -9:
        return "its process was killed (signal 9): perhaps the machine ran out of memory"
    return f"its process died (signal {-code})" if code < 0 else f"its process died (code {code})"


def _serve(
    pipe: Connection, process: Callable, cache: bool, little: bool, share: int, notice: bool
) -> None:
    """A worker's life."""
    _leaving.with_parent()
    prepare = functools.cache(
        functools.partial(_session.start, cache=cache, little=little, notice=notice, share=share)
    )

    def prepared(job: Job):
        prepare()
        return process(job)

    with suppress(EOFError, OSError):  # the parent closes the pipe when there is no more
        while True:
            pipe.send(guarded(prepared, pipe.recv()))
