"""Going through files: refusals, failures, resuming, several processes, interruption, reports."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cli import _batch, _work
from jaxmotion.io.atomic import atomic_write
from tests.cli.conftest import swinging


@pytest.fixture
def takes(tmp_path):
    """A folder with two good files, one of them of an odd name, and one that is broken."""
    folder = tmp_path / "my takes"
    (folder / "día 1").mkdir(parents=True)
    jm.save(swinging(6), folder / "a.bvh")
    jm.save(swinging(9, seed=1), folder / "día 1" / "b ü.bvh")
    (folder / "broken.bvh").write_text("HIERARCHY\nROOT Hips\n{\nOFFSET 0 0\n")
    return folder


def names(folder):
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def test_failures_do_not_stop_the_others(jaxmotion, takes, tmp_path):
    out = tmp_path / "out"
    result = jaxmotion("convert", takes, "-o", out, "--to", "npz", code=1)
    assert names(out) == ["a.npz", "día 1/b ü.npz"]
    assert "2 written, 1 failed." in result.stderr
    assert "broken.bvh:4" in result.stderr
    assert "[3/3]" in result.stderr
    assert "Traceback" not in result.output
    np.testing.assert_array_equal(
        jm.load(out / "día 1/b ü.npz").rotations, jm.load(takes / "día 1/b ü.bvh").rotations
    )


def test_fail_fast(jaxmotion, takes, tmp_path):
    (takes / "a.bvh").rename(takes / "z.bvh")
    result = jaxmotion(
        "convert", takes, "-o", tmp_path / "out", "--to", "npz", "--fail-fast", code=1
    )
    assert "Stopped at the first failure; 2 not tried." in result.stderr
    assert not (tmp_path / "out").exists()


def test_outputs_are_not_overwritten_unasked(jaxmotion, take, tmp_path):
    out = tmp_path / "out.npz"
    out.write_text("precious")
    result = jaxmotion("convert", take, "-o", out, code=1)
    assert "exists; add --overwrite" in result.stderr
    assert out.read_text() == "precious"
    jaxmotion("convert", take, "-o", out, "--overwrite")
    assert len(jm.load(out)) == 40


def test_the_skeleton_beside_an_amc_is_not_overwritten_either(jaxmotion, take, tmp_path):
    (tmp_path / "out.asf").write_text("precious")
    result = jaxmotion("convert", take, "-o", tmp_path / "out.amc", code=1)
    assert "out.asf exists" in result.stderr
    assert not (tmp_path / "out.amc").exists()


def test_writing_over_the_input_is_refused_even_when_overwriting(jaxmotion, take):
    before = take.read_bytes()
    result = jaxmotion("convert", take, "-o", take, "--overwrite", code=2)
    assert "over an input" in result.stderr
    assert take.read_bytes() == before


def test_dry_run_says_and_does_nothing(jaxmotion, takes, tmp_path):
    result = jaxmotion("convert", takes, "-o", tmp_path / "out", "--to", "npz", "--dry-run")
    assert len(result.stdout.splitlines()) == 3
    assert f"{takes / 'a.bvh'} -> {tmp_path / 'out' / 'a.npz'}" in result.stdout
    assert not (tmp_path / "out").exists()


def test_resume_skips_what_is_newer(jaxmotion, takes, tmp_path):
    (takes / "broken.bvh").unlink()
    words = ("convert", takes, "-o", tmp_path / "out", "--to", "npz")
    jaxmotion(*words)
    first = (tmp_path / "out/a.npz").stat().st_mtime_ns
    assert "2 skipped" in jaxmotion(*words, "--resume").stderr
    assert (tmp_path / "out/a.npz").stat().st_mtime_ns == first
    later = time.time() + 60
    os.utime(takes / "a.bvh", (later, later))
    result = jaxmotion(*words, "--resume", code=1)
    assert "1 skipped, 1 failed" in result.stderr
    assert "1 written, 1 skipped" in jaxmotion(*words, "--resume", "--overwrite").stderr


def test_an_output_that_cannot_be_written(jaxmotion, take, tmp_path):
    (tmp_path / "file").write_text("")
    result = jaxmotion("convert", take, "-o", tmp_path / "file" / "out.npz", code=1)
    assert "FAILED" in result.stderr
    assert "Traceback" not in result.output


def test_a_write_that_breaks_leaves_nothing(jaxmotion, take, tmp_path, monkeypatch):
    def half(motion, path, **options):
        with atomic_write(path) as file:
            file.write(b"half")
            raise KeyboardInterrupt

    monkeypatch.setattr(jm, "save", half)
    (tmp_path / "out").mkdir()
    jaxmotion("convert", take, "-o", tmp_path / "out" / "x.npz", code=130)
    assert list((tmp_path / "out").iterdir()) == []


def test_results_that_are_not_finite_are_not_written(take, tmp_path):
    def spoil(motion, length):
        return motion.with_transforms(rotations=motion.rotations * np.nan)

    selection = _work.Selection(1.0, (), (None, None), 0)
    job = _batch.Job(take, tmp_path / "x.bvh")
    reading = _work.Reading(None, None)
    editing = _work.Editing(spoil, selection, reading, None, False, False, False)
    outcome = _work.guarded(lambda job: _work.edit_file(editing, job), job)
    assert outcome.status == "failed"
    assert "not finite, first at frame 0, joint 'Hips'" in outcome.message
    assert not job.target.exists()


def test_reports(jaxmotion, takes, tmp_path):
    report = tmp_path / "r.json"
    words = ("convert", takes, "--to", "npz", "--report")
    jaxmotion(*words, report, "-o", tmp_path / "one", code=1)
    rows = {row["input"]: row for row in json.loads(report.read_text("utf-8"))["files"]}
    assert rows[str(takes / "a.bvh")]["status"] == "written"
    assert "expected" in rows[str(takes / "broken.bvh")]["message"]
    assert "exists" in jaxmotion(*words, report, "-o", tmp_path / "two", code=2).stderr
    page = tmp_path / "deep" / "r.html"
    jaxmotion(*words, page, "-o", tmp_path / "three", code=1)
    text = page.read_text("utf-8")
    assert "b ü.npz" in text
    assert "http" not in text
    assert "2 written, 0 skipped, 1 failed" in text


def test_reports_escape_names(tmp_path):
    from jaxmotion.cli._report import write_report

    job = _batch.Job(tmp_path / "<b>.bvh", tmp_path / "x")
    write_report(tmp_path / "r.html", [_work.Outcome(job, "failed", "<script>")])
    text = (tmp_path / "r.html").read_text("utf-8")
    assert "<script>" not in text
    assert "&lt;b&gt;.bvh" in text


def test_frame_rate_is_overruled(jaxmotion, take, tmp_path):
    jaxmotion("convert", take, "-o", tmp_path / "a.npz", "--fps", "60")
    assert float(jm.load(tmp_path / "a.npz").frame_time) == pytest.approx(1 / 60)
    jaxmotion("convert", tmp_path / "a.npz", "-o", tmp_path / "b.npz", "--fps", "24")
    assert float(jm.load(tmp_path / "b.npz").frame_time) == pytest.approx(1 / 24)


def script(*words, **kwargs):
    return subprocess.Popen(
        [sys.executable, "-m", "jaxmotion", *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **kwargs,
    )


def test_several_processes(takes, tmp_path):
    run = script("convert", takes, "-o", tmp_path / "out", "--to", "npz", "--jobs", "2")
    _, errors = run.communicate(timeout=120)
    assert run.returncode == 1, errors
    assert "2 written, 1 failed." in errors
    assert "broken.bvh:4" in errors
    assert names(tmp_path / "out") == ["a.npz", "día 1/b ü.npz"]


@pytest.fixture
def interruptible():
    """Programs that a shell starts in the background ignore interrupts, and so would ours."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_ctrl_c_leaves_no_partial_file(tmp_path, jobs, interruptible):
    folder = tmp_path / "takes"
    folder.mkdir()
    jm.save(swinging(30), folder / "0.bvh")
    for i in range(1, 400):
        shutil.copy(folder / "0.bvh", folder / f"{i}.bvh")
    out = tmp_path / "out"
    run = script("convert", folder, "-o", out, "--to", "bvh", "--jobs", jobs)
    deadline = time.time() + 60
    while not (out.exists() and any(out.glob("*.bvh"))) and time.time() < deadline:
        time.sleep(0.02)
    run.send_signal(signal.SIGINT)
    _, errors = run.communicate(timeout=60)
    assert run.returncode == 130, errors
    assert "Interrupted." in errors
    assert "Traceback" not in errors
    done = list(out.iterdir())
    assert 0 < len(done) < 400
    for path in done:
        assert path.suffix == ".bvh"
        assert len(jm.load(path)) == 30
