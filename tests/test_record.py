"""``benchmarks/record.py``: what is slower beyond noise, and README's table."""

import importlib.util
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture(scope="module")
def record():
    spec = importlib.util.spec_from_file_location("record", BENCHMARKS / "record.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def races(**given):
    """A record of races of (seconds, spread, peers)."""
    keys = ("seconds", "spread", "peers")
    rows = {name: dict(zip(keys, row, strict=True)) | {"file": "f"} for name, row in given.items()}
    return {"races": rows, "figures": {}}


def test_slower_beyond_noise(record):
    old = races(still=(1.0, 0.02, {}), alone=(1.0, 0.02, {}), noisy=(1.0, 0.2, {}), gone=(1, 0, {}))
    new = races(still=(1.09, 0.02, {}), alone=(1.2, 0.02, {}), noisy=(1.5, 0.1, {}))
    lines, slower = record.compared(old, new)
    assert slower == 1
    assert lines[0].startswith("alone: 1.20 times as long by itself (1 s, now 1.2 s")
    assert lines[1:] == ["gone: not in the new record", "1 of 3 races slower beyond noise"]


def test_a_busier_machine_is_no_slower_race(record):
    old = races(a=(1.0, 0.02, {"peer": 2.0}), b=(1.0, 0.02, {"peer": 2.0, "other": 1.0}))
    busier = races(a=(3.0, 0.02, {"peer": 6.0}), b=(6.0, 0.02, {"peer": 6.0}))
    lines, slower = record.compared(old, busier)
    assert slower == 1
    assert lines[0].startswith("b: 2.00 times as long beside peer")


def test_the_table_is_of_the_record(record):
    found = races(
        **{name: (0.01, 0, dict.fromkeys(peers, 0.025)) for _, name, peers in record.ROWS}
    )
    name, peers = record.ROWS[0][1:]
    found["figures"][name] = {"file": "g", "value": 0.0061, "peers": dict.fromkeys(peers, 0.028)}
    lines = record.table_of(found).splitlines()
    assert lines[0] == record.BEGIN
    assert len(lines) == 2 + len(record.ROWS)
    assert all(line.count("|") == 6 for line in lines)
    assert "| 0.6% | pymotion 2.8%, " in lines[2]
    assert "| 10 ms | jaxlie unrolled 25 ms | 2.5 | `f` |" in lines[3]
    assert record.BEGIN in record.README.read_text()
    with pytest.raises(KeyError):
        record.table_of(races())


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(3.96e-3, "4 ms"), (0.26, "0.26 s"), (12.1, "12 s"), (134.0, "134 s"), (9.3e-5, "93 µs")],
)
def test_durations(record, seconds, words):
    assert record.shown(seconds) == words


def test_every_row_names_a_race_of_a_benchmark(record):
    """By the words that stand in its file as they are."""
    texts = "\n".join(path.read_text() for path in BENCHMARKS.glob("bench_*.py"))
    for _, name, peers in record.ROWS:
        assert name.split()[0].rstrip(",") in texts
        for peer in peers:
            assert peer in texts
