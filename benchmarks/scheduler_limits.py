"""What dask's scheduler takes for many tasks of no work, sent as ``corpus.map`` sends them.

    python benchmarks/scheduler_limits.py [--tasks 10000] [--workers 2] [--milliseconds 0]

Three ways: single items, groups of eight, and all at once by ``client.map``, for comparison.
Seconds, and the memory of this process, in which client and scheduler run, before and after; the
keys that the scheduler still knows of at the end; the largest number of tasks on their way.
"""

import argparse
import gc
import json
import time
from functools import partial

import psutil

from jaxmotion._cluster import tasks
from jaxmotion.corpus import local_client


def nothing(seconds: float, item: int) -> int:
    """Work that is none."""
    if seconds:
        time.sleep(seconds)
    return item


def main() -> None:
    """The three ways, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--tasks", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--milliseconds", type=float, default=0.0)
    given = parser.parse_args()
    work = partial(nothing, given.milliseconds / 1000)
    ways = (
        ("a stream of single items", lambda client: streamed(client, work, given.tasks, 1)),
        ("a stream of groups of 8", lambda client: streamed(client, work, given.tasks, 8)),
        ("client.map, all at once", lambda client: at_once(client, work, given.tasks)),
    )
    for name, way in ways:
        with local_client(given.workers) as client:
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


def resident() -> float:
    """Megabytes of this process."""
    return psutil.Process().memory_info().rss / 2**20


if __name__ == "__main__":
    main()
