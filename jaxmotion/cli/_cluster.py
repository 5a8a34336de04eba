"""Jobs on a dask cluster, that of an address or one of this machine.

A job is done again when its worker is lost, so on a worker it replaces what is in its way: that
nothing is, was seen when it was sent. Workers do their work in this process's folder, for names of
files are relative to it; of another machine they must see it, at the same place.
"""

import os
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import cache as once
from importlib import metadata
from pathlib import Path

import click

from jaxmotion import __version__
from jaxmotion._cluster import connections
from jaxmotion._cluster.tasks import GROUP, Lost, stream
from jaxmotion._plain import printable
from jaxmotion.cli import _leaving, _session
from jaxmotion.cli._files import Job
from jaxmotion.cli._options import Batch
from jaxmotion.cli._terminal import say
from jaxmotion.cli._work import Effect, Outcome, guarded

_PATIENCE = 5.0  # seconds without a worker before it is mentioned


def on_cluster(
    process: Callable[[Job], Effect],
    jobs: Sequence[Job],
    batch: Batch,
    *,
    cache: bool,
    clear: Callable[[], None],
    little: bool,
    writes: Callable[[Path], Sequence[Path]],
) -> Generator[Outcome]:
    """Outcomes of ``process`` on every job, as they come.

    **Arguments:** ``process``: a function that can be pickled; ``clear``: called at the end, to
    take away what lost workers left; ``little``: whether the jobs take less time than compiling for
    them, which only workers of this machine are told, for only those begin with this work;
    ``writes``: the files that come of a target.
    """
    here = batch.cluster == "local"
    count = min(batch.jobs, len(jobs))
    name = click.get_current_context().info_name
    share = count if here else 1
    settings = _Settings(cache, little and here, share, os.getcwd(), _releases())

    def refused(job: Job) -> str:
        there = [] if batch.overwrite else [path for path in writes(job.target) if path.exists()]
        return f"{printable(there[0])} exists; add --overwrite to replace it" if there else ""

    with ExitStack() as stack:
        stack.callback(clear)
        pairs = stream(
            _client(stack, batch.cluster or "local", count, clear),
            _There(process, settings),
            jobs,
            name=f"jaxmotion-{name}",
            size=lambda job: _session.size_of(job.source),
            refused=refused,
            group=1 if batch.fail_fast else GROUP,
        )
        for job, value in stack.enter_context(closing(pairs)):
            if isinstance(value, Lost):
                value = Outcome(job, "failed", value.reason)
            value.job = job
            yield value


def _client(stack: ExitStack, where: str, count: int, clear: Callable[[], None]):
    """A client with workers, while the stack lasts."""
    try:
        if where == "local":
            with _leaving.interrupts_held():
                workers = stack.enter_context(connections.started(count))

            def kill() -> None:
                connections.kill(workers)
                clear()

            stack.enter_context(_leaving.last_act(kill))
            return stack.enter_context(connections.client_of(workers))
        client = stack.enter_context(connections.connected(where))
    except ConnectionError as error:
        raise click.ClickException(str(error)) from error
    if not client.nthreads():
        try:
            client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError:
            say(f"waiting for {where}, which has no workers yet ...", err=True)
    return client


@dataclass(frozen=True)
class _Settings:
    """What a worker needs to know: of the session, ``cache``, ``little`` and ``share``; the
    ``folder`` that names are relative to; the releases that make the outputs what they are."""

    cache: bool
    little: bool
    share: int
    folder: str
    releases: tuple[str, str]


@dataclass(frozen=True)
class _There:
    """A process on a worker."""

    process: Callable[[Job], Effect]
    settings: _Settings

    def prepare(self) -> None:
        """Import JAX and set it up."""
        _started(self.settings)

    def __call__(self, job: Job) -> Outcome:
        return guarded(self._done, job)

    def _done(self, job: Job) -> Effect:
        from jaxmotion.io.atomic import replacing

        wanted, releases = self.settings.releases, _releases()
        if releases != wanted:
            theirs, ours = (f"jaxmotion {r[0]} with jax {r[1]}" for r in (releases, wanted))
            raise ValueError(f"the worker has {theirs}, this machine {ours}")
        self.prepare()
        before = os.getcwd()
        try:
            os.chdir(self.settings.folder)
        except OSError:
            folder = printable(self.settings.folder)
            raise ValueError(f"the worker does not see the folder {folder}") from None
        try:
            with replacing():
                return self.process(job)
        finally:
            os.chdir(before)


def _releases() -> tuple[str, str]:
    return __version__, metadata.version("jax")


@once
def _started(settings: _Settings) -> None:
    _session.start(cache=settings.cache, little=settings.little, notice=False, share=settings.share)
