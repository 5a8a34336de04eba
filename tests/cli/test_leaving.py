"""Signals at any time, parents that are gone, workers that die: quiet ends that leave nothing."""

import functools
import os
import signal
import subprocess
import sys
import time
import zlib
from pathlib import Path

import pytest

import jaxmotion as jm
from jaxmotion import _compilation_cache as _cache
from jaxmotion.cli import _leaving
from jaxmotion.cli._record import NAME
from tests.cli import processes
from tests.cli.conftest import swinging

ROOT = Path(__file__).parents[2]
unix = pytest.mark.skipif(os.name == "nt", reason="signals as Unix has them")

# The command line, which gets a signal as it begins to import a module or to write its output.
_SIGNALLED = """
import os, signal, sys
when, number, *words = sys.argv[1:]
signal.signal(signal.SIGINT, signal.default_int_handler)
def now():
    os.kill(os.getpid(), int(number))
class Watch:
    def find_spec(self, name, *_):
        if name == when:
            now()
sys.meta_path.insert(0, Watch())
if when == "writing":
    from jaxmotion.io import archive
    write = archive.zipfile.ZipFile.writestr
    def half(*given, **named):
        write(*given, **named)
        now()
    archive.zipfile.ZipFile.writestr = half
sys.argv = ["jaxmotion", *words]
from jaxmotion.cli import main
main()
"""


@unix
@pytest.mark.parametrize(
    ("name", "when"),
    [
        ("SIGINT", "click"),
        ("SIGTERM", "click"),
        ("SIGINT", "jax.version"),
        ("SIGTERM", "jax.version"),
        ("SIGINT", "writing"),
        ("SIGTERM", "writing"),
        ("SIGHUP", "writing"),
    ],
)
def test_a_signal_at_any_time_ends_quietly_and_leaves_nothing(take, tmp_path, name, when):
    number = getattr(signal, name)
    out = tmp_path / "out"
    words = (when, str(int(number)), "convert", take, "-o", out, "--to", "npz")
    ran = subprocess.run(
        [sys.executable, "-c", _SIGNALLED, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert ran.stderr == "Interrupted.\n"
    assert (ran.returncode, ran.stdout) == (128 + number, "")
    assert not out.exists() or os.listdir(out) == []


def test_last_acts_are_done_newest_first_and_only_once(monkeypatch):
    told = []
    monkeypatch.setattr(_leaving, "_acts", [])
    monkeypatch.setattr(_leaving, "_leaving", _leaving.threading.Event())
    monkeypatch.setattr(_leaving.os, "_exit", told.append)
    _leaving.always(lambda: told.append("always"))

    def fail():
        told.append("fails")
        _leaving.leave(143)  # a second signal, meanwhile
        raise RuntimeError

    with _leaving.last_act(lambda: told.append("done with")):
        pass
    with _leaving.last_act(fail):
        _leaving.leave(130)
    assert told == ["fails", 143, "always", 130]


@pytest.fixture
def parent(tmp_path):
    """A process with two workers in long calls, each amid a file."""
    run = subprocess.Popen(
        [sys.executable, "-m", "tests.cli.processes", str(tmp_path)],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 120
    while len(list(tmp_path.glob(".*-tmp"))) < 2:
        assert run.poll() is None, run.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    yield run
    run.kill()
    run.communicate(timeout=60)


@unix
@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM", "SIGINT"])
def test_workers_in_a_long_call_do_not_outlive_their_parent(parent, tmp_path, name):
    number = getattr(signal, name)
    begun = time.monotonic()
    parent.send_signal(number)
    # Workers hold the other end of stderr: it ends with the last of them.
    _, errors = parent.communicate(timeout=60)
    assert time.monotonic() - begun < 2
    if number == signal.SIGKILL:
        assert (parent.returncode, errors) == (-number, "")
    else:
        assert (parent.returncode, errors) == (128 + number, "Interrupted.\n")
    assert os.listdir(tmp_path) == []


@unix
def test_a_worker_that_dies_takes_only_its_own_job(tmp_path):
    process = functools.partial(processes.die_at, "1")
    by_name = {o.job.target.name: o for o in processes.outcomes(process, tmp_path, 4)}
    assert sorted(by_name) == ["0", "1", "2", "3"]
    assert "killed (signal 9): perhaps the machine ran out of memory" in by_name["1"].message
    assert [o.status for _, o in sorted(by_name.items())] == ["written", "failed"] + 2 * ["written"]
    assert sorted(os.listdir(tmp_path)) == ["0", "2", "3"]


@unix
def test_resume_takes_away_what_a_killed_run_left(jaxmotion, take, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    hold = (
        "import sys; from jaxmotion.io.atomic import atomic_write\n"
        "with atomic_write(sys.argv[1]): print(1, flush=True); sys.stdin.read()"
    )
    started = [
        subprocess.Popen(
            [sys.executable, "-c", hold, str(out / "take.npz")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        for _ in "ab"
    ]
    for process in started:
        process.stdout.readline()
    killed, alive = started
    killed.kill()
    killed.communicate()
    jaxmotion("convert", take, "-o", out, "--to", "npz", "--resume", "--dry-run")
    assert len(list(out.glob(".*-tmp"))) == 2
    jaxmotion("convert", take, "-o", out, "--to", "npz", "--resume")
    assert len(list(out.glob(".*-tmp"))) == 1, "of a run that goes on at the same time"
    alive.communicate()
    assert sorted(os.listdir(out)) == [NAME, "take.npz"]


def frame(content, flags=0x20):
    """A Zstandard frame of one raw block (RFC 8878), with its size in one byte."""
    block = (len(content) << 3 | 1).to_bytes(3, "little") + content
    check = b"1234" if flags & 4 else b""
    return b"\x28\xb5\x2f\xfd" + bytes([flags, len(content)]) + block + check


def test_cut_off_entries_leave_the_cache(tmp_path):
    packed = zlib.compress(os.urandom(500))
    good = {"a-cache": packed, "b-cache": frame(b"x" * 40), "c-cache": frame(b"x" * 40, 0x24)}
    bad = {
        "d-cache": b"",
        "e-cache": packed[:-1],
        "f-cache": packed[:2],
        "g-cache": frame(b"x" * 40)[:-1],
        "h-cache": frame(b"x" * 40, 0x24)[:-1],
        "i-cache": frame(b"")[:5],
        "j-cache": b"\x78\x9cnonsense",
    }
    for name, data in {**good, **bad, "other": b"", "k-cache": b"of another kind"}.items():
        (tmp_path / name).write_bytes(data)
    _cache.mend(tmp_path)
    kept = sorted([*good, "other", "k-cache", _cache._LOOKED])
    assert sorted(os.listdir(tmp_path)) == kept


def test_entries_are_looked_into_once(tmp_path, monkeypatch):
    looked = []
    monkeypatch.setattr(_cache, "_is_whole", lambda data: looked.append(data) or True)
    long_ago = time.time() - 3600
    for name in ("old", "new"):
        (tmp_path / f"{name}-cache").write_bytes(name.encode())
        os.utime(tmp_path / f"{name}-cache", (long_ago, long_ago))
    _cache.mend(tmp_path)
    assert sorted(looked) == [b"new", b"old"]
    looked.clear()
    os.utime(tmp_path / "new-cache")
    (tmp_path / "empty-cache").touch()
    os.utime(tmp_path / "empty-cache", (long_ago, long_ago))
    _cache.mend(tmp_path)
    assert looked == [b"new"]
    assert not (tmp_path / "empty-cache").exists()


def test_a_cache_folder_that_is_none(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("JAXMOTION_CACHE_DIR", str(tmp_path / "file"))
    assert _cache.usable_folder() is None
    monkeypatch.setenv("JAXMOTION_CACHE_DIR", str(tmp_path / "new"))
    assert _cache.usable_folder() == tmp_path / "new"
    monkeypatch.delenv("JAXMOTION_CACHE_DIR")

    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(_cache.Path, "home", homeless)
    assert _cache.cache_folder() is None


def test_an_output_that_is_an_input_by_another_name(jaxmotion, tmp_path):
    jm.save(swinging(3), tmp_path / "01_02.amc")
    (tmp_path / "01_02.asf").rename(tmp_path / "01.asf")
    before = (tmp_path / "01.asf").read_bytes()
    words = ("convert", tmp_path / "01_02.amc", "--overwrite", "-o")
    assert "over an input" in jaxmotion(*words, tmp_path / "01.amc", code=2).stderr
    os.link(tmp_path / "01_02.amc", tmp_path / "same.amc")
    assert "over an input" in jaxmotion(*words, tmp_path / "same.amc", code=2).stderr
    assert (tmp_path / "01.asf").read_bytes() == before
    for _ in "ab":
        jaxmotion(*words, tmp_path / "other.amc")


@unix
def test_a_link_to_the_folder_around_it(tmp_path, monkeypatch):
    from jaxmotion.cli import _files

    (tmp_path / "takes").mkdir()
    (tmp_path / "takes" / "walk.bvh").touch()
    (tmp_path / "takes" / "all").symlink_to(tmp_path / "takes")
    monkeypatch.chdir(tmp_path)
    for given in ("takes/**/*.bvh", "takes"):
        assert [i.relative.as_posix() for i in _files.expand([given])] == ["walk.bvh"]
