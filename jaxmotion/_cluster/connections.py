"""Connections to dask: to a scheduler that is there, or to workers of this machine.

Workers of this machine are processes of their own, one thread each; among them they share the
cores, for JAX would start a thread a core in every one. They listen on this machine only, and are
gone when the process is that started them, however it went.
"""

import functools
import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from jaxmotion._lazy import extra
from jaxmotion._plain import printable

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

SCHEMES = ("tcp", "tls", "ucx", "ws", "wss")  # of the addresses of schedulers
_ANSWER = 10.0  # seconds that a scheduler may take to answer
_PATIENCE = 5.0  # seconds that killed workers may take to be gone
_GLANCE = 1.0  # seconds between looks at whether all workers of this machine are there
_RESTART = 5.0  # seconds that dask may take to begin with a new worker,
_START = 30.0  # and that this may take to be there

_UNGUARDED = (
    "jaxmotion: a worker imports the script that started it, which would start workers again: put "
    "what runs at its top below \"if __name__ == '__main__':\""
)

# Of dask's settings, those that cost a core's time and tell nobody anything here: a look at what
# runs a hundred times a second, and at the loop fifty times, in every process; a heap given back to
# the system with nearly every array that is freed. And a heap for every thread keeps more memory.
_CALM = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 2**24,
    "distributed.nanny.pre-spawn-environ.MALLOC_ARENA_MAX": 1,
}

_ended: WeakKeyDictionary = WeakKeyDictionary()  # what ends the guard of a cluster


def needed(what: str) -> Any:
    """The package ``distributed``, that ``what`` needs."""
    return extra("distributed", "distributed", what, package="dask[distributed]")


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def started(workers: int | None = None) -> Iterator["LocalCluster"]:
    """So many workers of this machine, or one a core, while the block runs.

    **Raises:** ``ConnectionError`` where they do not start.
    """
    workers = workers or cores()
    needed("a cluster of this machine")
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        # A worker that imports the script which starts workers, and would start its own.
        raise SystemExit(_UNGUARDED)
    with _calm(), _begun_or_said():
        cluster = _kind()(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",  # with None it serves at 8787, or warns
            scheduler_kwargs={"dashboard": False},
            memory_limit=0,
            silence_logs=logging.CRITICAL,
            env={"NPROC": str(max(1, cores() // workers))},
        )
    ended = _ended[cluster] = threading.Event()
    guard = threading.Thread(target=_guard, args=(cluster, ended), daemon=True)
    with cluster:
        guard.start()
        try:
            yield cluster
        finally:
            ended.set()
            guard.join()


@functools.cache
def _kind() -> "type[LocalCluster]":
    """dask's cluster, but for one thing: that a worker is gone of which it had not heard, dead as
    soon as it began, is no error to be raised as it closes (distributed 2026.8.0)."""
    from distributed import LocalCluster

    class Workers(LocalCluster):
        def _update_worker_status(self, op: str, msg: Any) -> None:
            if op != "remove" or msg in self.scheduler_info["workers"]:
                super()._update_worker_status(op, msg)

    return Workers


def _calm() -> Any:
    """dask's settings for what is begun in the block, which keeps them."""
    from dask import config

    return config.set(_CALM)


@contextmanager
def _begun_or_said() -> Iterator[None]:
    """What dask says where a process of its does not start, in a sentence."""
    try:
        yield
    except (RuntimeError, OSError) as error:
        text = " ".join(str(error).split())
        raise ConnectionError(f"the workers of this machine did not start: {text}") from None


def _guard(cluster: Any, ended: threading.Event) -> None:
    """Replace workers that are gone for long. dask does so, but not always where one dies as it
    begins: its nanny may lose track of it, or close, and nobody begins another (distributed
    2026.8.0). With the last worker all work would stand still."""
    from distributed.core import Status

    async def renew(name: Any) -> None:
        nanny = cluster.workers.get(name)
        if ended.is_set():
            return
        if nanny is not None and nanny.status == Status.running:
            nanny.process = None
            await nanny.instantiate()
            return
        wanted = cluster.worker_spec[name]
        address, options = cluster.scheduler.address, {**wanted["options"], "name": name}
        with _calm():
            cluster.workers[name] = wanted["cls"](address, **options)
        await cluster.workers[name]

    since: dict[Any, float] = {}
    while not ended.wait(_GLANCE):
        there = {worker.name for worker in list(cluster.scheduler.workers.values())}
        for name in list(cluster.worker_spec):
            if name in there:
                since.pop(name, None)
                continue
            nanny = cluster.workers.get(name)
            alive = nanny is not None and nanny.is_alive()
            gone = time.monotonic() - since.setdefault(name, time.monotonic())
            if gone > (_START if alive else _RESTART):
                since.pop(name)
                _end(nanny.pid if nanny is not None else None)
                cluster.loop.add_callback(renew, name)


def _end(pid: int | None) -> None:
    if pid:
        with suppress(OSError):
            os.kill(pid, signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)


def kill(cluster: "LocalCluster") -> None:
    """End its workers here and now; none is started anew. For a process that ends as well."""
    from distributed.core import Status

    if cluster in _ended:
        _ended[cluster].set()
    nannies = list(cluster.workers.values())
    pids = [nanny.pid for nanny in nannies]
    for nanny in nannies:
        nanny.status = Status.closing_gracefully  # it does not replace its worker
    # Else Python would tell of semaphores that the queues to the workers leave behind. Before those
    # are gone: once they are, dask's own thread is at the same, and might not come to its end.
    from multiprocessing import util

    util._run_finalizers(0)  # type: ignore[attr-defined]
    for pid in pids:
        _end(pid)
    deadline = time.monotonic() + _PATIENCE
    while time.monotonic() < deadline and any(nanny.is_alive() for nanny in nannies):
        time.sleep(0.01)


@contextmanager
def connected(where: "Client | str", workers: int | None = None) -> Iterator["Client"]:
    """A client: the one given; of the scheduler at an address; or, for "local", of workers of this
    machine.

    **Raises:** ``ConnectionError`` where no scheduler answers; ``ValueError`` for what is none of
    the three.
    """
    if not isinstance(where, str):
        if not hasattr(where, "scheduler") or not hasattr(where, "submit"):
            raise ValueError(
                f"client is a {type(where).__name__}; expected a dask.distributed.Client, the "
                'address of a scheduler such as "tcp://host:8786", or "local"'
            )
        yield where
    elif where == "local":
        with started(workers) as cluster, client_of(cluster) as client:
            yield client
    elif is_address(where):
        with client_of(where) as client:
            yield client
    else:
        raise ValueError(
            f"{printable(where)!r} is no cluster; expected the address of a scheduler such as "
            "tcp://host:8786, or local"
        )


def is_address(text: str) -> bool:
    """Whether a text looks like a scheduler's address."""
    scheme, found, rest = text.partition("://")
    return bool(found and rest) and scheme in SCHEMES


@contextmanager
def client_of(where: "LocalCluster | str") -> Iterator["Client"]:
    """A client of a cluster, or of the scheduler at an address."""
    distributed = needed("a cluster")
    try:
        client = distributed.Client(where, timeout=_ANSWER, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        if not isinstance(where, str):
            raise
        raise ConnectionError(f"no dask scheduler answers at {printable(where)}") from error
    with client:
        yield client
