"""``benchmarks/papers``: an item's record, the runner, and the page that is filled of it."""

import json
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxmotion as jm

ROOT = Path(__file__).parents[1]
PAPERS = ROOT / "benchmarks" / "papers"
SCRIPT = """
import remade

def make(seed):
    clip = remade.capture("bandai/walk.bvh", 30.0)
    row = {"frames": len(clip), "rate": float(clip.fps), "none": None}
    return [remade.told("P 1999", "Figure 1", "It walks.", "It does.", "reproduced", [row])]

remade.main(make)
"""

pytestmark = pytest.mark.skipif(not PAPERS.is_dir(), reason="no benchmarks beside the tests")


@pytest.fixture(scope="module")
def remade(script):
    return script("remade")


@pytest.fixture(scope="module")
def run(script):
    return script("run")


def item(**given):
    words = {"paper": "P 1999", "item": "Figure 1", "claim": "It walks.", "measured": "It does."}
    words |= {"verdict": "refuted", "clips": "a walk", "numbers": [{"a|b": 1234567.0, "c": None}]}
    return words | {"script": "s.py", "seed": 3, "seconds": 2.4, "load": 0.1} | given


def record(**items):
    machine = {"processor": "a processor", "cores": 2}
    around = {"date": "2026-01-02T03:04:05", "python": "3.11", "machine": machine}
    return around | {"versions": {"jax": "0.9"}, "items": items}


def test_a_script_is_run_into_a_record(run, tmp_path, monkeypatch):
    """Of a tiny clip, with the machine and the load; what was there before stays."""
    (tmp_path / "bandai").mkdir()
    jm.save(jm.samples.load("walk", num_frames=9).motion, tmp_path / "bandai" / "walk.bvh")
    (tmp_path / "script.py").write_text(SCRIPT)
    (tmp_path / "broken.py").write_text("raise SystemExit(3)")
    out = tmp_path / "record.json"
    out.write_text(json.dumps({"items": {"other": item(), "P 1999, Figure 1": item()}}))
    monkeypatch.setenv("JAXMOTION_TEST_DATA", str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", f"{PAPERS}:{ROOT}")
    assert run.recorded([tmp_path / "broken.py", tmp_path / "script.py"], out) == 1
    found = json.loads(out.read_text())
    assert set(found["items"]) == {"other", "P 1999, Figure 1"}
    made = found["items"]["P 1999, Figure 1"]
    assert made["numbers"] == [{"frames": 5, "rate": pytest.approx(30.0), "none": None}]
    assert made["verdict"] == "reproduced"
    assert {"script", "seed", "date", "load", "seconds"} <= set(made)
    assert found["versions"]["jax"] == jax.__version__
    assert found["machine"]["cores"]


def test_verdicts_are_of_four(remade, capsys):
    with pytest.raises(ValueError, match="verdict='fine'; expected one of reproduced, better"):
        remade.told("P", "1", "", "", "fine", [{"a": 1}])
    made = remade.told("P", "1", "It is.", "So.", "better", [{"a": np.float64(1.5), "b": "x"}])
    assert json.loads(json.dumps(made))["numbers"] == [{"a": 1.5, "b": "x"}]
    assert "verdict:  better" in capsys.readouterr().out


def test_a_page_is_filled(run):
    page = (
        "# A\n\n<!-- machine -->\n<!-- end -->\n\n<!-- summary -->\nold\n<!-- end -->\n\n"
        "<!-- P 1999, Figure 1 -->\nold\n<!-- end -->\n\n<!-- P 1999, Figure 2 -->\nkept\n"
        "<!-- end -->\n\nwords\n"
    )
    made = record(**{"P 1999, Figure 1": item(), "Q 2000, Table 1": item()})
    text, missing = run.filled(page, made)
    assert missing == ["Q 2000, Table 1"]
    assert "old" not in text
    assert "<!-- P 1999, Figure 2 -->\nkept\n<!-- end -->\n\nwords\n" in text
    assert "*P 1999:* It walks.\n\n**Refuted.** It does.\n\n| a∣b | c |" in text
    assert "| 1 234 567 |  |" in text
    assert "| P 1999, Figure 1 | refuted | It walks. |" in text
    assert "a processor, 2 cores" in text
    assert "`benchmarks/papers/s.py`" in text
    assert run.filled(text, made)[0] == text


def test_numbers_are_shown(run):
    shown = {
        0.0123456: "0.0123",
        99.94: "99.9",
        999.6: "1 000",
        77839.9: "77 840",
        1.2e-15: "1.2e-15",
    }
    assert {x: run.shown(x) for x in shown} == shown
    assert [run.shown(x) for x in (12, "x", None)] == ["12", "x", ""]


def test_the_page_is_that_of_the_newest_record(run):
    records = sorted((ROOT / "benchmarks" / "results").glob("papers-*.json"))
    assert records
    text = run.PAGE.read_text(encoding="utf-8")
    filled, missing = run.filled(text, json.loads(records[-1].read_text(encoding="utf-8")))
    assert filled == text
    assert not missing


def test_names_that_there_are_not():
    words = [sys.executable, str(PAPERS / "run.py"), "newton"]
    told = subprocess.run(words, capture_output=True, text=True)
    assert told.returncode == 2
    assert "no such script; there are" in told.stderr
    assert "eom_table_1" in told.stderr
