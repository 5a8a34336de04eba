"""Benchmarks against peers: one table with ratios at the end.

    pip install -e '.[bench]'
    python -m pytest benchmarks --benchmark-only

A benchmark is a test in ``benchmarks/bench_*.py`` that hands the ``race`` fixture one operation:

    def test_multiply(race):
        race(
            "multiply 2526x65 f32",                        # operation, size, dtype: the row's name
            lambda: ours(a, b),                            # jaxmotion, already jitted
            {"jaxlie": lambda: theirs(a, b)},              # name of the peer -> the same work
            goals={"jaxlie": 3.0},                         # optional: at least 3x the peer's speed
        )

- One test is one operation at one size. Ours and every peer run in turn in the same test (peer,
  peer, ours, peer, peer, ours, ...), so a busy machine slows all alike; medians are compared. Each
  timed call follows an untimed one of the same work: caches hold its data, not the last peer's.
- Callables take nothing and return what they made; the fixture waits for JAX arrays. Make inputs
  outside them. Check in the test that the results agree (``race`` returns ours and the peers').
- ``warm=False`` times every call, the first included: for compile times and cold processes, where
  each call must do all the work (jit a fresh function) and ``rounds=3`` or so is enough.
- ``amount=(3.2, "MB")`` adds a rate to our column. ``goals`` are shown, not enforced: a timing is
  no assertion.
- Missing peers skip: ``jaxlie = pytest.importorskip("jaxlie")``.

float64 is on; dtype promotion is JAX's default, as peers need. ``--benchmark-json=FILE`` keeps all
figures, the peers' medians in ``extra_info``.
"""

import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import pytest

import jaxmotion as jm

jax.config.update("jax_enable_x64", True)


class Row(NamedTuple):
    """One line of the table: ours against one peer (or against none), seconds."""

    operation: str
    ours: float
    peer: str
    theirs: float | None
    goal: float | None
    rate: str


_ROWS = pytest.StashKey[list[Row]]()


def pytest_configure(config):
    config.stash[_ROWS] = []


@pytest.fixture
def own_size():
    """Makes of a call one with clips as long as they are: eager calls pad them to 128, 512 or 2048
    frames."""

    def made(call):
        def run():
            with jm.buckets(False):
                return call()

        return run

    return made


@pytest.fixture
def race(benchmark, request):
    """Time ours and its peers in turn; see the module. Returns (our result, {peer: result})."""

    def run(
        operation: str,
        ours: Callable[[], Any],
        peers: Mapping[str, Callable[[], Any]] | None = None,
        *,
        goals: Mapping[str, float] | None = None,
        warm: bool = True,
        rounds: int | None = None,
        seconds: float = 3.0,
        amount: tuple[float, str] | None = None,
    ):
        peers, goals = dict(peers or {}), dict(goals or {})
        results = {}
        taken = {peer: [] for peer in peers}
        if warm:
            for work in (ours, *peers.values()):
                jax.block_until_ready(work())
        if rounds is None:
            once = sum(_time(work)[0] for work in (ours, *peers.values()))
            rounds = int(min(100, max(7, seconds / once)))

        def time_peers():
            for peer, work in peers.items():
                if warm:
                    _time(work)
                duration, results[peer] = _time(work)
                taken[peer].append(duration)
            if warm:
                _time(ours)

        benchmark.group = operation
        result = benchmark.pedantic(
            lambda: jax.block_until_ready(ours()), setup=time_peers, rounds=rounds
        )
        if benchmark.stats is None:  # --benchmark-disable
            return result, results
        median = benchmark.stats.stats.median
        medians = {peer: statistics.median(durations) for peer, durations in taken.items()}
        benchmark.extra_info.update({f"{peer} median": m for peer, m in medians.items()})
        rate = f"{amount[0] / median:.4g} {amount[1]}/s" if amount else ""
        request.config.stash[_ROWS].extend(
            Row(operation, median, peer, medians[peer], goals.get(peer), rate) for peer in peers
        )
        if not peers:
            request.config.stash[_ROWS].append(Row(operation, median, "", None, None, rate))
        return result, results

    return run


def _time(work: Callable[[], Any]) -> tuple[float, Any]:
    start = time.perf_counter()
    result = jax.block_until_ready(work())
    return time.perf_counter() - start, result


@pytest.hookimpl(trylast=True)
def pytest_terminal_summary(terminalreporter, config):
    rows = config.stash[_ROWS]
    if not rows:
        return
    header = ("operation", "ours ms", "peer", "peer ms", "peer/ours", "goal", "rate")
    table = [header, *(_cells(row) for row in rows)]
    widths = [max(len(line[i]) for line in table) for i in range(len(header))]
    terminalreporter.section("jaxmotion and its peers (medians, run in turn)")
    for cells in table:
        line = [
            c.rjust(w) if i in (1, 3, 4) else c.ljust(w)
            for i, (c, w) in enumerate(zip(cells, widths, strict=True))
        ]
        terminalreporter.write_line("  ".join(line).rstrip())


def _cells(row: Row) -> tuple[str, ...]:
    ours = f"{1e3 * row.ours:.3f}"
    if row.theirs is None:
        return (row.operation, ours, "", "", "", "", row.rate)
    ratio = row.theirs / row.ours
    goal = ""
    if row.goal is not None:
        goal = f"{row.goal:g} {'met' if ratio >= row.goal else 'missed'}"
    return (
        row.operation,
        ours,
        row.peer,
        f"{1e3 * row.theirs:.3f}",
        f"{ratio:.2f}",
        goal,
        row.rate,
    )
