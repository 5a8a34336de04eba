"""``--cluster``: what ``--jobs`` does, by workers of dask's that may die, for a client that may.

Two workers serve the tests of this module, which call commands in this process; what is about whole
runs has processes of its own.
"""

import os
import pickle
import re
import signal
import subprocess
import sys
import time
from functools import partial

import click
import jax
import psutil
import pytest

import jaxmotion as jm
from jaxmotion.cli import _batch, _cluster, _leaving, _options
from jaxmotion.cli._record import NAME
from jaxmotion.cli.denoise import command as denoise
from tests.cli import processes
from tests.cli.conftest import record_in, swinging

MANY = 40

distributed = pytest.importorskip(
    "distributed", reason="dask is not there: pip install 'jaxmotion[distributed]'"
)


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """A folder of compiled programs that all processes share."""
    return str(tmp_path_factory.mktemp("programs"))


@pytest.fixture(scope="module")
def crew(programs):
    """The address of two workers, over whose deaths the scheduler gives up the third time."""
    from dask import config

    from jaxmotion._cluster.connections import started

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAXMOTION_CACHE_DIR", programs)
        with config.set({"distributed.scheduler.allowed-failures": 2}), started(2) as cluster:
            yield cluster.scheduler_address


@pytest.fixture
def takes(tmp_path):
    """A folder of five clips, two further down, and one that is broken."""
    folder = tmp_path / "takes"
    (folder / "deep").mkdir(parents=True)
    for k in range(5):
        jm.save(swinging(20 + k, seed=k), folder / ("deep" if k > 2 else "") / f"{k}.bvh")
    (folder / "broken.bvh").write_text("HIERARCHY\nROOT Hips\n{\nOFFSET 0 0\n")
    return folder


def tree(folder):
    """Outputs below a folder, by name, and whatever else is there but the records."""
    files = (p for p in folder.rglob("*") if p.is_file() and p.name != NAME)
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in files}


def batch(where, out, **options):
    """What the options say of a run that replaces nothing."""
    reading = _options.Reading(None, None)
    given = {"overwrite": False, "resume": False, "dry_run": False, "jobs": 2, "fail_fast": False}
    given |= {"report": None, "reading": reading, "out_up": None, **options}
    return _options.Batch(files=(), out=out, cluster=where, **given)


def outcomes(where, process, jobs, out, **options):
    """Of a process that is no command's."""
    with click.Context(denoise, info_name="denoise").scope():
        found = _cluster.on_cluster(
            process,
            jobs,
            batch(where, out, **options),
            cache=False,
            clear=lambda: None,
            little=False,
            writes=lambda target: [target],
        )
        return {outcome.job.target.name: outcome for outcome in found}


def test_a_cluster_does_what_one_process_does(jaxmotion, crew, takes, tmp_path):
    words = ("convert", takes, "--to", "npz", "--report")
    one = jaxmotion(*words, tmp_path / "1.json", "-o", tmp_path / "one", code=1)
    more = jaxmotion(
        *words, tmp_path / "2.json", "-o", tmp_path / "more", "--cluster", crew, code=1
    )
    assert tree(tmp_path / "one") == tree(tmp_path / "more")
    assert len(tree(tmp_path / "more")) == 5
    assert "5 written, 1 failed." in more.stderr
    failed = [
        [
            re.sub(r" \([^()]* left\)$", "", line.partition("] ")[2])
            for line in told.splitlines()
            if "FAI" in line
        ]
        for told in (one.stderr, more.stderr)
    ]
    assert failed[0] == failed[1]
    one, more = (record_in(tmp_path / f"{k}.json") for k in (1, 2))
    for key in ("command", "options", "counts", "end"):
        assert one[key] == more[key], key
    for a, b in zip(one["files"], more["files"], strict=True):
        same = ("input", "status", "message", "sha256", "frames", "changes")
        assert [a[key] for key in same] == [b[key] for key in same]
    told = jaxmotion(
        *("convert", takes, "--to", "npz", "-o", tmp_path / "more", "--resume", "--cluster", crew),
        code=1,
    )
    assert "5 skipped, 1 failed." in told.stderr


def test_names_are_relative_to_where_the_command_is(jaxmotion, crew, takes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    told = jaxmotion("convert", "takes/0.bvh", "-o", "out.npz", "--cluster", crew).stderr
    assert told.startswith("out.npz: ")
    assert len(jm.load(tmp_path / "out.npz")) == 20


def test_commands_that_only_look(crew, tmp_path, capsys):
    process, jobs = partial(processes.die_at, "none"), processes.jobs(tmp_path, 4)
    running = _options.Running(cache=False, debug=False)
    with click.Context(denoise, info_name="denoise").scope(), pytest.raises(click.exceptions.Exit):
        _batch.look(
            process, jobs, batch(crew, tmp_path), running, tell=lambda o: [o.job.source.name]
        )
    assert sorted(capsys.readouterr().out.split()) == ["0.in", "1.in", "2.in", "3.in"]


def test_the_first_failure_may_end_it(jaxmotion, crew, takes, tmp_path):
    (takes / "broken.bvh").rename(takes / "00.bvh")
    words = ("convert", takes, "-o", tmp_path / "out", "--to", "npz", "--fail-fast")
    told = jaxmotion(*words, "--cluster", crew, code=1).stderr
    assert "Stopped at the first failure" in told


def test_what_comes_back_is_small_and_holds_no_array_of_jax(takes, tmp_path):
    class Looking(pickle.Pickler):
        def persistent_id(self, value):
            assert not isinstance(value, jax.Array)

    from jaxmotion.cli._work import Edited, Editing, Selection, edit_file, guarded

    selection = Selection(1.0, (), (None, None), 0)
    reading = _options.Reading(None, None)
    for report in (None, tmp_path / "r.json"):
        editing = Editing(lambda motion, _: Edited(motion), selection, reading, report=report)
        job = _batch.Job(takes / "0.bvh", tmp_path / f"{report}".strip("/") / "x.bvh")
        outcome = guarded(partial(edit_file, editing), job)
        assert outcome.status == "written", outcome
        with open(tmp_path / "pickle", "w+b") as file:
            Looking(file, protocol=5).dump(outcome)
            assert file.tell() < 20_000


def test_a_worker_that_dies_is_replaced_and_its_files_are_done_again(crew, tmp_path):
    """Also those that were whole before it died, without asking to replace them."""
    out, marks = tmp_path / "out", tmp_path / "marks"
    out.mkdir()
    marks.mkdir()
    found = outcomes(crew, partial(processes.written_and_died, marks), processes.jobs(out, 4), out)
    assert [(o.status, o.message) for o in found.values()] == 4 * [("written", "")]
    assert {o.effect.message for o in found.values()} == {"fine"}
    assert tree(out) == {name: name.encode() for name in "0123"}
    assert len(tree(marks)) == 4


def test_a_file_over_which_workers_die_fails_alone(crew, tmp_path):
    found = outcomes(crew, partial(processes.die_at, "1"), processes.jobs(tmp_path, 4), tmp_path)
    assert {name: o.status for name, o in found.items()} == {
        **dict.fromkeys("023", "written"),
        "1": "failed",
    }
    assert "its worker died over it, every time" in found["1"].message


def test_what_came_into_the_way_meanwhile_is_not_replaced(crew, tmp_path):
    (tmp_path / "2").write_text("precious")
    process = partial(processes.die_at, "none")
    found = outcomes(crew, process, processes.jobs(tmp_path, 4), tmp_path)
    assert found["2"].status == "failed"
    assert "2 exists; add --overwrite" in found["2"].message
    assert (tmp_path / "2").read_text() == "precious"
    found = outcomes(crew, process, processes.jobs(tmp_path, 4), tmp_path, overwrite=True)
    assert {o.status for o in found.values()} == {"written"}
    assert (tmp_path / "2").read_text() == "half"


def test_workers_of_another_release_or_another_machine(crew, tmp_path, monkeypatch):
    process, jobs = partial(processes.die_at, "none"), processes.jobs(tmp_path, 1)
    with monkeypatch.context() as patch:
        patch.setattr(_cluster, "_releases", lambda: ("9.9", "0.1"))
        message = outcomes(crew, process, jobs, tmp_path)["0"].message
    assert "the worker has jaxmotion 0.1.0 with jax" in message
    assert "this machine jaxmotion 9.9 with jax 0.1" in message
    with monkeypatch.context() as patch:
        patch.setattr(os, "getcwd", lambda: "/not/there")
        message = outcomes(crew, process, jobs, tmp_path)["0"].message
    assert "the worker does not see the folder /not/there" in message


def test_a_worker_gets_its_work_before_jax_is_there():
    """Else JAX is set up before it is told how, and outputs differ in their last digits."""
    work = _cluster._There(
        partial(_batch.edit_file, None), _cluster._Settings(True, True, 2, ".", ("", ""))
    )
    code = "import pickle, sys; pickle.load(sys.stdin.buffer); assert 'jax' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], input=pickle.dumps(work), check=True, timeout=60)


def test_usage(jaxmotion, takes, tmp_path, monkeypatch):
    words = ("convert", takes, "-o", tmp_path / "out", "--to", "npz", "--cluster")
    for wrong in ("here", "http://host:1", "tcp://"):
        told = jaxmotion(*words, wrong, code=2).stderr
        assert "neither local nor an address such as tcp://host:8786" in told
    told = jaxmotion(*words, "tcp://host:1", "--jobs", "3", code=2).stderr
    assert "--jobs are processes of this machine" in told
    monkeypatch.setattr("jaxmotion._cluster.connections._ANSWER", 0.3)
    told = jaxmotion(*words, "tcp://127.0.0.1:9", code=1).stderr
    assert "no dask scheduler answers at tcp://127.0.0.1:9" in told
    assert "Traceback" not in told
    assert not (tmp_path / "out").exists()
    told = jaxmotion("convert", "s3://bucket/takes", "-o", "out", code=2).stderr
    assert "is a URL; in Python, jaxmotion.corpus.map" in told
    told = jaxmotion("contacts", takes, "--cluster", "local", code=2).stderr
    assert "--cluster goes with --restore" in told
    monkeypatch.setitem(sys.modules, "distributed", None)
    told = jaxmotion(*words, "local", code=1).stderr
    assert told.splitlines()[-1].endswith(
        "--cluster needs dask[distributed]: pip install 'jaxmotion[distributed]'"
    )


def test_workers_of_this_machine_are_one_a_core_or_as_many_as_asked(monkeypatch, jaxmotion, takes):
    asked = []
    monkeypatch.setattr(_batch, "run", lambda process, jobs, batch, *_, **__: asked.append(batch))
    monkeypatch.setattr("jaxmotion._cluster.connections.cores", lambda: 7)
    words = ("convert", takes, "-o", "out", "--to", "npz")
    jaxmotion(*words)
    jaxmotion(*words, "--cluster", "local")
    jaxmotion(*words, "--cluster", "local", "--jobs", "3")
    preset = takes / "house.toml"
    preset.write_text("jobs = 5")
    jaxmotion(*words, "--cluster", "local", "--preset", preset)
    jaxmotion(*words, "--cluster", "tcp://host:1", "--preset", preset)
    assert [(b.cluster, b.jobs) for b in asked] == [
        (None, 1),
        ("local", 7),
        ("local", 3),
        ("local", 5),
        ("tcp://host:1", 5),
    ]


_WITHOUT = """
import sys
import jaxmotion as jm
for name in jm.__all__:
    getattr(jm, name)
jm.corpus.map(lambda motion: motion, sys.argv[1], sys.argv[2])
from jaxmotion.cli._app import app
import pkgutil, importlib
from jaxmotion import cli
for module in pkgutil.iter_modules(cli.__path__):
    if module.name != "_cluster":
        importlib.import_module(f"jaxmotion.cli.{module.name}")
for jobs in "12":
    words = ["convert", sys.argv[1], "-o", sys.argv[2] + jobs, "--to", "npz", "--jobs", jobs]
    app(words, standalone_mode=False)
found = {m.partition(".")[0] for m in sys.modules}
assert not found & {"dask", "distributed", "fsspec"}, found
"""


def test_without_it_nothing_of_dask_is_imported(takes, tmp_path):
    (takes / "broken.bvh").unlink()
    (tmp_path / "run.py").write_text(
        "if __name__ == '__main__':\n" + "\n".join(f"    {x}" for x in _WITHOUT.splitlines())
    )
    ran = subprocess.run(
        [sys.executable, tmp_path / "run.py", takes, tmp_path / "out"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert "SystemExit" not in ran.stderr
    assert ran.returncode == 0, ran.stderr


@pytest.fixture(scope="module")
def many(tmp_path_factory, programs):
    """A folder of clips, and what one process makes of them."""
    folder = tmp_path_factory.mktemp("many")
    (folder / "in").mkdir()
    for k in range(MANY):
        jm.save(swinging(24 + k % 3, seed=k), folder / "in" / f"{k}.bvh")
    run = started(programs, folder / "in", folder / "out", "--jobs", "1")
    _, errors = run.communicate(timeout=120)
    assert run.returncode == 0, errors
    return folder / "in", tree(folder / "out")


def started(programs, takes, out, *words):
    """``denoise`` in a process of its own."""
    line = [sys.executable, "-m", "jaxmotion", "denoise", takes, "-o", out, *words]
    return subprocess.Popen(
        [str(word) for word in line],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "JAXMOTION_CACHE_DIR": programs},
    )


def wait_for(out, count):
    """Until so many outputs are there."""
    deadline = time.monotonic() + 60
    while len(list(out.glob("*.bvh"))) < count:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def workers_of(process):
    """Processes that a client started, but for Python's own."""
    found = psutil.Process(process.pid).children(recursive=True)
    return [p for p in found if "resource_tracker" not in " ".join(p.cmdline())]


def gone(found):
    """Whether all processes end, or have ended."""
    _, alive = psutil.wait_procs(found, timeout=5)
    return all(p.status() == psutil.STATUS_ZOMBIE for p in alive)


def test_a_worker_killed_amid_a_run_changes_nothing(many, programs, tmp_path):
    takes, want = many
    out = tmp_path / "out"
    run = started(programs, takes, out, "--cluster", "local", "--jobs", "2")
    wait_for(out, 5)
    workers = workers_of(run)
    assert len(workers) == 2
    workers[0].kill()
    _, errors = run.communicate(timeout=120)
    assert run.returncode == 0, errors
    assert f"{MANY} written." in errors
    assert "distributed" not in errors
    assert tree(out) == want, "the same bytes, and no temporary file"
    assert gone(workers)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_client_that_is_killed_is_resumed(many, programs, tmp_path, number):
    takes, want = many
    out = tmp_path / "out"
    run = started(programs, takes, out, "--cluster", "local", "--jobs", "2")
    wait_for(out, 5)
    workers = workers_of(run)
    run.send_signal(number)
    _, errors = run.communicate(timeout=60)  # workers hold the other end of stderr
    assert gone(workers)
    if number == signal.SIGINT:
        assert run.returncode == 130
        assert errors.splitlines()[-2] == "Interrupted."
        assert "the same command with --resume goes on from there" in errors
        assert {name for name in tree(out) if "tmp" in name} == set()
    assert len(tree(out)) < MANY
    run = started(programs, takes, out, "--cluster", "local", "--jobs", "2", "--resume")
    _, errors = run.communicate(timeout=120)
    assert run.returncode == 0, errors
    assert "skipped" in errors.splitlines()[-1]
    assert tree(out) == want


def test_a_worker_that_was_never_there_may_be_gone():
    """As where one dies as it begins: dask tells of its end only."""
    from distributed.scheduler import WorkerStatusPlugin

    from jaxmotion._cluster.connections import started

    with started(1) as workers:
        found = workers.scheduler.plugins.values()
        [plugin] = [plugin for plugin in found if isinstance(plugin, WorkerStatusPlugin)]
        workers.loop.add_callback(plugin.remove_worker, workers.scheduler, "tcp://127.0.0.1:9")
        time.sleep(0.5)
    assert workers.status.name == "closed"


def test_leaving_ends_the_workers(monkeypatch, tmp_path):
    from jaxmotion._cluster import connections

    told = []
    monkeypatch.setattr(_leaving, "_acts", [])
    monkeypatch.setattr(_leaving, "_leaving", _leaving.threading.Event())
    monkeypatch.setattr(_leaving.os, "_exit", told.append)
    with connections.started(1) as workers:
        [nanny] = workers.workers.values()
        process = psutil.Process(nanny.pid)
        with _leaving.last_act(lambda: connections.kill(workers)):
            _leaving.leave(130)
        assert told == [130]
        assert not process.is_running()
        time.sleep(0.5)
        assert not nanny.is_alive(), "and is not replaced"
