"""Going through files: refusals, failures, resuming, several processes, interruption."""

import os
import shutil
import signal
import subprocess
import sys
import time

import click
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cli import _batch, _record, _work
from jaxmotion.cli._record import NAME
from jaxmotion.io.atomic import atomic_write
from tests.cli.conftest import record_in, swinging


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
    """The files below a folder; the records of those that are outputs name them all."""
    files = sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file())
    outputs = [path for path in files if path.name != NAME]
    recorded = [
        path.with_name(name)
        for path in files
        if path.name == NAME
        for name in _record._entries((folder / path).parent)
    ]
    assert sorted(recorded) == outputs
    return [path.as_posix() for path in outputs]


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


def test_resume_makes_again_what_was_made_with_other_options(jaxmotion, takes, tmp_path):
    (takes / "broken.bvh").unlink()
    out = tmp_path / "out"
    words = ("convert", takes, "-o", out, "--to", "npz", "--resume")
    jaxmotion(*words, "--jobs", "1", "--fail-fast")
    assert "2 skipped" in jaxmotion(*words).stderr
    result = jaxmotion(*words, "--fps", "60", code=1)
    assert "2 failed" in result.stderr
    assert "a.npz was made without --fps; add --overwrite to replace it" in result.stderr
    assert float(jm.load(out / "a.npz").fps) == pytest.approx(30)
    assert "2 written" in jaxmotion(*words, "--fps", "60", "--overwrite").stderr
    assert float(jm.load(out / "a.npz").fps) == pytest.approx(60)
    assert "2 skipped" in jaxmotion(*words, "--fps", "60").stderr
    assert "was made with --fps 60.0;" in jaxmotion(*words, "--fps", "50", code=1).stderr
    words = ("retime", takes, "-o", out / "a.npz", "--to-fps", "20", "--resume", "--dry-run")
    assert "a.npz was made by convert;" in jaxmotion(*words[:1], takes / "a.bvh", *words[2:]).stdout


def test_resume_says_where_no_options_are_on_record(jaxmotion, takes, tmp_path):
    (takes / "broken.bvh").unlink()
    out = tmp_path / "out"
    words = ("convert", takes, "-o", out, "--to", "npz")
    jaxmotion(*words)
    record = out / NAME
    record.write_bytes(record.read_bytes() + b'\n{"output": "a.npz", "opt')  # as a kill leaves it
    assert "2 skipped" in jaxmotion(*words, "--resume").stderr
    jaxmotion(*words, "--overwrite")
    assert _record._entries(out)["a.npz"]["to"] == ".npz"
    record.unlink()
    result = jaxmotion(*words, "--resume", "--fps", "60", code=1)
    assert "a.npz: skipped, newer than its input; its options are not on record" in result.stderr
    assert "b ü.npz was made without --fps" in result.stderr


def test_a_kill_between_an_output_and_its_record_tells_nothing_wrong(
    jaxmotion, take, tmp_path, monkeypatch
):
    out = tmp_path / "out"
    words = ("convert", take.parent, "-o", out, "--to", "npz")
    jaxmotion(*words)

    def killed(record, target):
        raise KeyboardInterrupt

    monkeypatch.setattr(_record.Record, "note", killed)
    jaxmotion(*words, "--fps", "60", "--overwrite", code=130)
    monkeypatch.undo()
    for fps in ("60", "30"):
        result = jaxmotion(*words, "--fps", fps, "--resume", code=1)
        assert "with options that are not on record; add --overwrite" in result.stderr


def test_one_named_output_leaves_nothing_beside_it_unasked(jaxmotion, take, tmp_path):
    out = tmp_path / "one" / "out.npz"
    words = ("convert", take, "-o", out)
    jaxmotion(*words)
    assert [p.name for p in out.parent.iterdir()] == ["out.npz"]
    assert "its options are not on record" in jaxmotion(*words, "--resume").stderr
    out.unlink()
    jaxmotion(*words, "--resume", "--fps", "60")
    assert "skipped, newer than its input\n" in jaxmotion(*words, "--resume", "--fps", "60").stderr
    # What is on record stays right.
    jaxmotion(*words, "--overwrite")
    assert "was made without --fps" in jaxmotion(*words, "--resume", "--fps", "60", code=1).stderr


def test_a_record_that_cannot_be_written_is_told_once(jaxmotion, takes, tmp_path):
    (tmp_path / "out" / NAME).mkdir(parents=True)
    jm.save(swinging(6), takes / "c.bvh")
    (takes / "broken.bvh").unlink()
    result = jaxmotion("convert", takes, "-o", tmp_path / "out", "--to", "npz")
    assert "3 written" in result.stderr
    assert result.stderr.count(f"{NAME}: a folder, not a file") == 1


def test_every_option_counts_but_those_that_say_how_to_go_about_it(jaxmotion, monkeypatch, take):
    from jaxmotion.cli import _options

    asked = []
    monkeypatch.setattr(_batch, "run", lambda *_, **__: asked.append(_asked()))

    def _asked():
        return _options.asked_for(click.get_current_context())

    words = ("style", take, "-o", "x.npz", "--alpha", "2", "--gain", "*Arm=3", "--range", "1:9")
    jaxmotion(*words, "--jobs", "3", "--debug", "--no-cache", "--dry-run", "--fail-fast")
    jaxmotion(*words)
    assert asked[0] == asked[1]
    want = {"command": "style", "alpha": 2.0, "gain": (("*Arm", 3.0),), "range": (1, 9)}
    assert want.items() <= asked[0].items()
    assert {"fps", "up", "out-up", "strength", "joints", "fade", "residual"} <= asked[0].keys()


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
        return _work.Edited(motion.with_transforms(rotations=motion.rotations * np.nan))

    selection = _work.Selection(1.0, (), (None, None), 0)
    job = _batch.Job(take, tmp_path / "x.bvh")
    reading = _work.Reading(None, None)
    editing = _work.Editing(spoil, selection, reading)
    outcome = _work.guarded(lambda job: _work.edit_file(editing, job), job)
    assert outcome.status == "failed"
    assert "not finite, first at frame 0, joint 'Hips'" in outcome.message
    assert not job.target.exists()


def test_a_warning_of_many_files_is_told_once_and_counted(jaxmotion, takes, tmp_path):
    (takes / "broken.bvh").unlink()
    result = jaxmotion("convert", takes, "-o", tmp_path / "out", "--to", "bvh", "--out-up", "z")
    text = "z points up, which the file cannot say: read it with up= (--up)"
    assert result.stderr.count(f"  warning: {text}") == 1
    names = ", ".join(str(path) for path in sorted(takes.rglob("*.bvh")))
    assert f"that warning, of 2 files ({names}): {text}\n" in result.stderr


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
    words = ("convert", folder, "-o", out, "--to", "bvh", "--report", tmp_path / "r.json")
    run = script(*words, "--jobs", jobs)
    deadline = time.time() + 60
    while not (out.exists() and any(out.glob("*.bvh"))) and time.time() < deadline:
        time.sleep(0.02)
    run.send_signal(signal.SIGINT)
    _, errors = run.communicate(timeout=60)
    assert run.returncode == 130, errors
    told = "400 files are done; the same command with --resume goes on from there."
    assert errors.splitlines()[-2] == "Interrupted."
    assert told in errors.splitlines()[-1]
    assert "Traceback" not in errors
    done = [path for path in out.iterdir() if path.name != NAME]
    assert 0 < len(done) < 400
    recorded = _record._entries(out).keys()
    assert recorded <= {path.name for path in done}
    assert len(recorded) >= len(done) - 2 * int(jobs)
    record = record_in(tmp_path / "r.json")
    assert record["end"] == "interrupted"
    written = [row["output"] for row in record["files"] if row["status"] == "written"]
    assert {str(out / name) for name in recorded} >= set(written)
    assert len(recorded) - len(written) <= 1
    assert (
        record["counts"]["not tried"] == 400 - len(written) == len(record["files"]) - len(written)
    )
    assert os.listdir(tmp_path).count("r.json") == len(list(tmp_path.glob("*r.json*")))
    for path in done:
        assert path.suffix == ".bvh"
        assert len(jm.load(path)) == 30
