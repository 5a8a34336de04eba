"""What workers are given to do in the tests of how they end, and a parent for them."""

import functools
import os
import signal
import sys
from pathlib import Path

from jaxmotion.cli import _leaving, _workers
from jaxmotion.cli._files import Job
from jaxmotion.cli._work import Effect
from jaxmotion.io.atomic import atomic_write


def compute_for_ever(job: Job) -> Effect:
    """Half a file, then a JAX call that does not come back."""
    import jax

    forever = jax.jit(lambda x: jax.lax.while_loop(lambda x: x > -1, lambda x: x * 0.5, x))
    with atomic_write(job.target) as file:
        file.write(b"half")
        file.flush()
        forever(1.0).block_until_ready()
    return Effect(())


def die_at(name: str, job: Job) -> Effect:
    """Half a file and sudden death for the job of that name; others are written."""
    with atomic_write(job.target) as file:
        file.write(b"half")
        file.flush()
        if job.target.name == name:
            os.kill(os.getpid(), signal.SIGKILL)
    return Effect((), message="fine")


def written_and_died(folder: Path, job: Job) -> Effect:
    """The output, whole, of a process that dies before it can say so, the first time."""
    with atomic_write(job.target, overwrite=False) as file:
        file.write(job.target.name.encode())
    mark = folder / f"met-{job.target.name}"
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return Effect((), message="fine")


def jobs(folder: Path, count: int) -> list[Job]:
    """Jobs of those outputs; there are no inputs."""
    return [Job(folder / f"{i}.in", folder / f"{i}") for i in range(count)]


def outcomes(process, folder: Path, count: int) -> list:
    """All of them, by two workers."""
    from jaxmotion.io.atomic import remove_abandoned

    clear = functools.partial(remove_abandoned, folder)
    together = _workers.side_by_side(
        process, jobs(folder, count), processes=2, cache=False, clear=clear
    )
    return list(together)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    _leaving.on_signals()
    from tests.cli import processes

    outcomes(processes.compute_for_ever, Path(sys.argv[1]), 2)
