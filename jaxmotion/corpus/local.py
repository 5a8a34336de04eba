"""Dask workers of this machine, for corpora and files."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from jaxmotion._checks import static
from jaxmotion._cluster.connections import client_of, started

if TYPE_CHECKING:
    from distributed import Client


@static("workers")
@contextmanager
def local_client(workers: int | None = None) -> Iterator["Client"]:
    """Start dask workers on this machine, set up for JAX, and connect to them.

    Each is a process with one thread, in which JAX uses its share of the cores, and takes some
    300 MB before its first clip. Scheduler and workers listen on the loopback address, without a
    dashboard; as of any dask scheduler, whoever may connect to it, here any user of this machine,
    may run code as you. A worker that dies is replaced. None has a limit of memory. In a script,
    guard what runs at the top with ``if __name__ == "__main__":``, for workers import it.

    **Arguments:** ``workers``: how many, by default one a core.
    **Returns:** a context whose value is a ``dask.distributed.Client``; workers end with it.
    **Raises:** ``ImportError`` without the extra ``jaxmotion[distributed]``; ``ValueError`` for
    fewer than one worker; ``ConnectionError`` where workers do not start.

    **Example:**

        >>> import jaxmotion as jm
        >>> with jm.corpus.local_client(1) as client:
        ...     client.submit(sum, [1, 2]).result()
        3
    """
    if workers is not None and (not isinstance(workers, int) or workers < 1):
        raise ValueError(f"local_client: workers is {workers!r}; expected a number from 1")
    with started(workers) as cluster, client_of(cluster) as client:
        yield client
