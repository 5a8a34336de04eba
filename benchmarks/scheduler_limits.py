"""What dask's scheduler takes for many tasks, sent as ``corpus.map`` sends them.

    python benchmarks/scheduler_limits.py [--tasks 10000] [--workers 2] [--result-bytes 100]
    python benchmarks/scheduler_limits.py --replay benchmarks/results/cost-DATE.json --verb denoise
        [--tasks 10000] [--workers 100]

First: tasks of no work, three ways: single items, groups of eight, and all at once by
``client.map``, for comparison. Seconds, and the memory of this process, in which client and
scheduler run, before and after; the task prefixes that the scheduler still knows; the most tasks on
their way.

Second: items that sleep as long as a verb was measured to take (``cost_model.py``), for as many
workers. These are threads of this process, so scheduler, client and workers share one core: worse
than on machines of their own. Seconds beside those that workers need who never wait.
"""

import argparse
import contextlib
import gc
import json
import logging
import random
import time
from functools import partial
from pathlib import Path

import psutil

from jaxmotion._cluster import tasks, worker
from jaxmotion.corpus import local_client

FRAME_BYTES = 600  # of a .bvh of 22 joints


def nothing(size: int, item: int) -> bytes:
    """Work that is none, and a result of that size."""
    return bytes(size)


def asleep(item: tuple[float, int]) -> None:
    """Take the time of an item."""
    time.sleep(item[0])


def main() -> None:
    """One part or the other."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--tasks", type=int, default=10_000)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--result-bytes", type=int, default=100)
    parser.add_argument("--replay", type=Path)
    parser.add_argument("--verb", default="denoise")
    given = parser.parse_args()
    if given.replay:
        replayed(given.replay, given.verb, given.tasks, given.workers or 100)
    else:
        limits(given)


def limits(given: argparse.Namespace) -> None:
    """The three ways, one after the other."""
    work = partial(nothing, given.result_bytes)
    ways = (
        ("a stream of single items", lambda client: streamed(client, work, given.tasks, 1)),
        ("a stream of groups of 8", lambda client: streamed(client, work, given.tasks, 8)),
        ("client.map, all at once", lambda client: at_once(client, work, given.tasks)),
    )
    for name, way in ways:
        with local_client(given.workers or 2) as client:
            gc.collect()
            before, begun = resident(), time.perf_counter()
            widest = way(client)
            seconds = time.perf_counter() - begun
            row = {
                "how": name,
                "items": given.tasks,
                "seconds": round(seconds, 2),
                "items a second": round(given.tasks / seconds),
                "MB before, after": [round(before), round(resident())],
                "most on their way": widest,
                "task prefixes": len(client.cluster.scheduler.task_prefixes),
            }
            print(json.dumps(row), flush=True)


def streamed(client, work, count: int, group: int) -> int:
    """By the stream; the most tasks that the scheduler knew of."""
    widest = 0
    pairs = tasks.stream(
        client, work, range(count), name="nothing", size=lambda item: 1, group=group
    )
    for k, _ in enumerate(pairs):
        if k % 97 == 0:
            widest = max(widest, len(client.cluster.scheduler.tasks))
    return widest


def at_once(client, work, count: int) -> int:
    """All of them in one call."""
    futures = client.map(work, range(count))
    client.gather(futures)
    return len(client.cluster.scheduler.tasks)


def replayed(record: Path, verb: str, count: int, workers: int) -> None:
    """Items that sleep as long as a verb takes for one of the clips that it was measured on."""
    import distributed

    worker._one = contextlib.nullcontext()  # type: ignore[assignment]
    once, each = json.loads(record.read_text())["verbs"][verb]["seconds"]
    rng = random.Random(0)
    frames = [round(rng.lognormvariate(5.1, 0.6)) for _ in range(count)]  # median 160, as Bandai's
    items = [(once + each * 22 * n, FRAME_BYTES * n) for n in frames]
    cluster = distributed.LocalCluster(
        processes=False,
        n_workers=workers,
        threads_per_worker=1,
        dashboard_address="127.0.0.1:0",
        scheduler_kwargs={"dashboard": False},
        memory_limit=0,
        silence_logs=logging.CRITICAL,
    )
    with cluster, distributed.Client(cluster) as client:
        begun = time.perf_counter()
        pairs = tasks.stream(client, asleep, items, name="asleep", size=lambda item: item[1])
        done = sum(1 for _ in pairs)
        seconds = time.perf_counter() - begun
    ideal = sum(item[0] for item in items) / workers
    row = {"verb": verb, "workers": workers, "items": done, "seconds": round(seconds, 1)}
    print(json.dumps({**row, "never waiting": round(ideal, 1), "share": round(ideal / seconds, 2)}))


def resident() -> float:
    """Megabytes of this process."""
    return psutil.Process().memory_info().rss / 2**20


if __name__ == "__main__":
    main()
