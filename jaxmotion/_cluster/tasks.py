"""Many items through a dask cluster, as a stream: memory stays flat for any number of them.

Work is pickled once. Small items go several to a task, fewer towards the end; of the tasks no more
are on their way than keep every worker busy. One worker may take the first item alone, so that what
is compiled for it is there for the others, which import meanwhile.

A task that loses its worker is done again, on another; the work must bear that. Which of the items
in a group was to blame for a worker's death nobody knows, nor which of two groups: each item of a
group that died too often is tried again, one at a time when all else is done. Only what then kills
its workers again is given up.
"""

import hashlib
import pickle
import time
from collections import deque
from collections.abc import Callable, Generator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from jaxmotion._cluster import worker
from jaxmotion._cluster.connections import needed

if TYPE_CHECKING:
    from distributed import Client, Future

GROUP = 8  # items a task, at most,
_BYTES = 4 * 2**20  # and so many bytes of them
_INLINE = 2**15  # bytes of work that are sent along with every task
_LOOK = 5.0  # seconds between looks at how many workers there are

_GONE = "the dask scheduler is gone"

Item = TypeVar("Item")


class Lost(NamedTuple):
    """In place of a value: why there is none."""

    reason: str


def stream(
    client: "Client",
    work: Callable[..., Any],
    items: Sequence[Item],
    *,
    name: str,
    size: Callable[[Item], int],
    refused: Callable[[Item], str] = lambda item: "",
    group: int = GROUP,
    along: Callable[[Item], Any] | None = None,
    alone: bool = True,
) -> Generator[tuple[Item, Any]]:
    """Pairs of an item and what the work made of it, or :class:`Lost`, as they come.

    **Arguments:** ``work``: catches its own errors, returns something small, bears to be done
    twice, and may have a ``prepare()``; ``name``: of the tasks, on dask's dashboard; ``size``:
    bytes of an item; ``refused``: why an item is not to be done, asked when its turn comes;
    ``group``: items a task at most; ``along``: what the work is given beside an item, asked when
    that is sent, and no part of what names the task; ``alone``: whether one worker begins.
    **Raises:** ``ConnectionError`` when the scheduler is gone.
    """
    flow = _Flow(client, work, name, along, warm=not alone)
    waiting, suspects = deque(items), deque[Item]()
    try:
        while waiting or suspects or flow.under_way:
            while waiting and flow.has_room():
                chosen, not_done = _chosen(waiting, flow.share(len(waiting), group), size, refused)
                yield from not_done
                flow.send(chosen)
            if suspects and not waiting and not flow.under_way:
                flow.send([suspects.popleft()], again=True)
            if not flow.under_way:
                continue
            for sent, values, again in flow.landed():
                if values is None and not again:
                    suspects.extend(sent)
                    continue
                gone = Lost("its worker died over it, every time: perhaps of too little memory")
                yield from zip(sent, values or [gone] * len(sent), strict=True)
    finally:
        flow.stop()


def _chosen(
    waiting: "deque[Item]",
    most: int,
    size: Callable[[Item], int],
    refused: Callable[[Item], str],
) -> tuple[list[Item], list[tuple[Item, Lost]]]:
    """The next few items for a task, and those before that are refused."""
    chosen, not_done, total = [], [], 0
    while waiting and len(chosen) < most:
        if reason := refused(waiting[0]):
            not_done.append((waiting.popleft(), Lost(reason)))
            continue
        total += size(waiting[0])
        if chosen and total > _BYTES:
            break
        chosen.append(waiting.popleft())
    return chosen, not_done


class _Flow:
    """Tasks on their way."""

    def __init__(
        self, client: "Client", work: Callable, name: str, along: Callable | None, warm: bool
    ):
        import cloudpickle

        distributed = needed("a cluster")
        self._client = client
        self._killed = distributed.scheduler.KilledWorker
        self._as_completed = distributed.as_completed(
            loop=client.loop, with_results=True, raise_errors=False
        )
        blob = cloudpickle.dumps(work)
        self._name = f"{name}-{hashlib.sha256(blob).hexdigest()[:32]}"
        # No scattered data: those are gone for good with the workers that hold them.
        self._work = blob if len(blob) <= _INLINE else self._sent(blob)
        self._held: dict[Future, tuple[list, bool]] = {}
        self._along = along
        self._warm = warm
        self._early: list[Future] = []
        self._looked = -_LOOK
        self._threads = 1

    @property
    def under_way(self) -> bool:
        return bool(self._held)

    def has_room(self) -> bool:
        """Whether another task may be sent."""
        if not self._warm:
            return not self._held
        return len(self._held) < 2 * self._crew() + 2

    def share(self, left: int, most: int) -> int:
        """How many items the next task may hold, of those that are left."""
        return max(1, min(most, left // (4 * self._crew()))) if self._warm else 1

    def send(self, items: list, *, again: bool = False) -> None:
        """A task of these items; ``again``: of those that may have killed workers."""
        if not items:
            return
        # Named by work and items: who does the same at the same time shares the task.
        mark = hashlib.sha256(pickle.dumps(items)).hexdigest()[:32] + again * "-again"
        more = None if self._along is None else [self._along(item) for item in items]
        future = self._client.submit(
            worker.run, self._work, items, more, key=(self._name, mark), pure=False
        )
        self._held[future] = items, again
        self._as_completed.add(future)
        if not self._warm and not self._early:
            self._early = [
                self._client.submit(
                    worker.prepare,
                    self._work,
                    key=(f"prepare-{self._name}", address),
                    pure=False,
                    workers=[address],
                    priority=-1,
                )
                for address in _threads(self._client)
            ]

    def landed(self) -> list[tuple[list, list | None, bool]]:
        """Of the tasks that have ended: items, their values, and whether they were sent again; no
        values of those that are to be tried once more."""
        found = []
        for future, result in self._as_completed.next_batch():
            items, again = self._held.pop(future)
            found.append((items, self._values(future, result, len(items)), again))
        self._warm, self._early = True, []
        return found

    def _values(self, future: "Future", result: Any, count: int) -> list | None:
        if future.status == "finished":
            return result
        if future.status != "error":
            if self._client.status not in ("running", "connecting"):
                raise ConnectionError(_GONE)
            return None
        error = result[1]
        if isinstance(error, self._killed):
            return None
        text = " ".join(str(error).split())
        return [Lost(f"on its worker: {type(error).__name__}: {text}")] * count

    def stop(self) -> None:
        """Leave nothing on its way."""
        futures, self._held, self._early = list(self._held), {}, []
        if futures and self._client.status == "running":
            self._client.cancel(futures, force=True)

    def _crew(self) -> int:
        """Threads of all workers, at least one."""
        now = time.monotonic()
        if now - self._looked >= _LOOK:
            self._looked = now
            self._threads = max(1, sum(_threads(self._client).values()))
        return self._threads

    def _sent(self, blob: bytes) -> "Future":
        from dask import config

        with config.set({"distributed.admin.large-graph-warning-threshold": "1GB"}):
            return self._client.submit(worker.same, blob, key=f"work-{self._name}", pure=False)


def _threads(client: "Client") -> dict[str, int]:
    """The threads of every worker, by its address."""
    try:
        return client.nthreads()  # type: ignore[return-value]
    except (AttributeError, OSError) as error:  # it has no scheduler any more
        raise ConnectionError(_GONE) from error
