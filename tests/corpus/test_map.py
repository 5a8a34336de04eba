"""One function over many files: in this process, on workers that die, to and from URLs."""

import os
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion._caller import Caller
from jaxmotion._cluster import connections, tasks, worker
from jaxmotion._cluster.tasks import Lost, stream
from jaxmotion.corpus import Mapped, mapping, places
from tests.cli.conftest import swinging
from tests.corpus import works
from tests.helpers import single_precision


@pytest.fixture
def takes(tmp_path):
    """A folder of clips of 12 to 15 frames, two of them further down, and a broken file."""
    folder = tmp_path / "takes"
    (folder / "día 1").mkdir(parents=True)
    for k, name in enumerate(("a.bvh", "b.npz", "día 1/c ü.bvh", "día 1/d.bvh")):
        jm.save(swinging(12 + k, seed=k), folder / name)
    (folder / "e broken.bvh").write_text("HIERARCHY\nROOT Hips\n{\n")
    (folder / ".hidden.bvh").write_text("")
    return folder


def tree(folder):
    """Everything below a folder, by name: its bytes."""
    files = (p for p in Path(folder).rglob("*") if p.is_file())
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in files}


def flow(client, work, items, **options):
    """The values of work on items, by item."""
    return dict(stream(client, work, items, name="test", size=lambda item: 1, **options))


def test_outputs_mirror_the_inputs(takes, tmp_path):
    out = tmp_path / "out"
    told = []
    done = jm.corpus.map(works.first_frames, takes, out, tell=told.append)
    assert sorted(told) == sorted(done)
    assert [Path(d.source).name for d in done] == [
        *("a.bvh", "b.npz", "c ü.bvh", "d.bvh", "e broken.bvh")
    ]
    assert [d.status for d in done] == [*4 * ["written"], "failed"]
    assert "e broken.bvh:4" in done[-1].message
    assert sorted(tree(out)) == ["a.bvh", "b.npz", "día 1/c ü.bvh", "día 1/d.bvh"]
    assert len(jm.load(out / "día 1" / "d.bvh")) == 10
    np.testing.assert_array_equal(
        jm.load(out / "b.npz").rotations, jm.load(takes / "b.npz").rotations[:10]
    )


def test_names_patterns_folders_and_suffixes(takes, tmp_path):
    (takes / "e broken.bvh").unlink()
    out = tmp_path / "out"
    jm.corpus.map(works.first_frames, [takes / "a.bvh", f"{takes}/**/*.npz"], out, to="bvh")
    assert sorted(tree(out)) == ["a.bvh", "b.bvh"]
    jm.corpus.map(works.first_frames, [takes, takes / "día 1"], tmp_path / "two", to=".npz")
    assert "takes/día 1/d.npz" in tree(tmp_path / "two")
    assert len(tree(tmp_path / "two")) == 4, "each file once"
    with pytest.raises(FileNotFoundError, match="no motion file"):
        jm.corpus.map(works.first_frames, tmp_path / "nothing", out)
    with pytest.raises(ValueError, match="over an input"):
        jm.corpus.map(works.first_frames, takes, takes)
    jm.save(swinging(12), takes / "a.npz")
    with pytest.raises(ValueError, match=r"a\.bvh and \S+a\.npz would both be written to"):
        jm.corpus.map(works.first_frames, takes, out, to="bvh")
    with pytest.raises(jm.io.MotionFileError, match=r"\.fbx"):
        jm.corpus.map(works.first_frames, takes, out, to="fbx")


def test_what_is_there_is_kept_unless_asked(takes, tmp_path):
    out = tmp_path / "out"
    (takes / "e broken.bvh").unlink()
    jm.corpus.map(works.first_frames, takes / "a.bvh", out)
    before = tree(out)
    done = jm.corpus.map(partial(works.refusing, 0), takes, out)
    assert [d.status for d in done] == ["failed", *3 * ["written"]]
    assert "a.bvh exists; pass overwrite=True" in done[0].message
    assert tree(out)["a.bvh"] == before["a.bvh"]
    done = jm.corpus.map(works.first_frames, takes, out, resume=True)
    assert {d.status for d in done} == {"skipped"}
    os.utime(takes / "a.bvh", (2e9, 2e9))
    done = jm.corpus.map(works.first_frames, takes, out, resume=True, overwrite=True)
    assert [d.status for d in done] == ["written", *3 * ["skipped"]]
    assert tree(out)["a.bvh"] == before["a.bvh"]


def test_failures_are_told_and_stop_nothing(takes, tmp_path):
    done = jm.corpus.map(partial(works.refusing, 13), takes, tmp_path / "out")
    assert done[1][2:4] == ("failed", "ValueError: 13 frames are refused")
    assert [d.status for d in done].count("written") == 3
    done = jm.corpus.map(works.not_a_motion, takes / "a.bvh", tmp_path / "more")
    assert "returned a int; expected a Motion" in done[0].message
    with pytest.raises(ValueError, match="client is a int; expected a dask"):
        jm.corpus.map(works.first_frames, takes, tmp_path / "two", client=3)
    with pytest.raises(ValueError, match="'here' is no cluster; expected"):
        jm.corpus.map(works.first_frames, takes, tmp_path / "two", client="here")


def test_workers_do_the_same(client, takes, tmp_path):
    here = jm.corpus.map(works.first_frames, takes, tmp_path / "here")
    there = jm.corpus.map(works.first_frames, takes, tmp_path / "there", client=client)
    assert tree(tmp_path / "here") == tree(tmp_path / "there")
    assert [d.status for d in here] == [d.status for d in there]
    assert [d.message for d in here] == [d.message for d in there]
    assert [d.source for d in here] == [d.source for d in there]
    assert all(isinstance(d, Mapped) for d in there)


def test_workers_keep_the_bits_of_their_client(client, takes, tmp_path):
    (takes / "e broken.bvh").unlink()
    jm.corpus.map(works.as_it_is_here, takes, tmp_path / "64", client=client)
    assert float(jm.load(tmp_path / "64" / "b.npz").frame_time) == 0.5
    with single_precision():
        jm.corpus.map(works.as_it_is_here, takes, tmp_path / "32", client=client)
    assert float(jm.load(tmp_path / "32" / "b.npz").frame_time) == 0.25


def test_names_are_relative_to_the_client(client, takes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = jm.corpus.map(works.first_frames, "takes/a.bvh", "out", client=client)
    assert done[0][:3] == ("takes/a.bvh", "out/a.bvh", "written")
    assert list(tree(tmp_path / "out")) == ["a.bvh"]


def test_a_function_is_sent_once_however_large(client, takes, tmp_path, monkeypatch):
    """And survives the workers that hold it."""
    (takes / "e broken.bvh").unlink()
    large = np.arange(500_000.0)
    sent = []
    submit = client.submit

    def counting(function, argument, *rest, **options):
        sent.append(len(argument) if isinstance(argument, bytes) else 0)
        return submit(function, argument, *rest, **options)

    monkeypatch.setattr(client, "submit", counting)
    out = tmp_path / "out"
    done = jm.corpus.map(lambda motion: works.shifted(large, motion), takes, out, client=client)
    assert [d.status for d in done] == 4 * ["written"]
    assert sorted(sent)[-1] > 4e6
    assert sum(sent) < 1.1 * max(sent)
    moved = jm.load(out / "b.npz").translations - jm.load(takes / "b.npz").translations
    np.testing.assert_allclose(moved[..., :3], np.broadcast_to([0.0, 1, 2], moved.shape))


def test_a_lost_worker_costs_time_only(client, takes, tmp_path):
    (takes / "e broken.bvh").unlink()
    jm.corpus.map(works.first_frames, takes, tmp_path / "calm")
    marks, out = tmp_path / "marks", tmp_path / "out"
    marks.mkdir()
    # Over and over: outputs are whole before their worker can tell, and may not be replaced.
    function = partial(works.written_and_died, str(marks))
    done = jm.corpus.map(function, takes, out, client=client)
    assert [(d.status, d.message) for d in done] == 4 * [("written", "")]
    assert len(list(marks.iterdir())) == 4
    assert tree(out) == tree(tmp_path / "calm"), "and no temporary file"


def test_what_kills_its_workers_fails_alone(client, takes, tmp_path):
    (takes / "e broken.bvh").unlink()
    done = jm.corpus.map(partial(works.exiting, 13), takes, tmp_path / "out", client=client)
    assert [d.status for d in done] == ["written", "failed", "failed", "written"]
    assert "its worker died over it, every time" in done[1].message
    assert done[2].message == "SystemExit: 2"
    assert sorted(tree(tmp_path / "out")) == ["a.bvh", "día 1/d.bvh"]


def test_of_a_group_only_the_guilty_fails(client):
    items = list("abcdefgh") * 8
    items = [f"{letter}{k}" for k, letter in enumerate(items)]
    found = flow(client, partial(works.die_at, "d27"), items)
    assert {item for item, value in found.items() if isinstance(value, Lost)} == {"d27"}
    assert all(value == item for item, value in found.items() if item != "d27")
    assert len(found) == 64


@pytest.mark.parametrize("closed", [False, True])
def test_a_worker_that_dask_does_not_replace_is_replaced(client, monkeypatch, closed):
    """Its nanny does not notice, or takes its leave."""
    from distributed.core import Status

    monkeypatch.setattr("jaxmotion._cluster.connections._RESTART", 1.0)
    monkeypatch.setattr("jaxmotion._cluster.connections._GLANCE", 0.1)
    client.wait_for_workers(2)
    for nanny in list(client.cluster.workers.values()):
        if closed:
            nanny.status = Status.closing_gracefully
        else:
            monkeypatch.setattr(nanny.process, "on_exit", None)
        connections._end(nanny.pid)
    assert flow(client, works.echo, range(9)) == {k: k for k in range(9)}
    client.wait_for_workers(2, timeout=20)


def test_a_stream_is_narrow_whatever_its_length(client, monkeypatch):
    """Of 2000 items a few dozen are on their way at any time, in groups, shared out at the end."""
    asked, ended, widest, groups = 0, 0, 0, []

    def refused(item):
        nonlocal asked
        asked += 1
        return "odd" if item == 77 else ""

    send = tasks._Flow.send

    def counting(self, items, **options):
        groups.append(len(items))
        return send(self, items, **options)

    monkeypatch.setattr(tasks._Flow, "send", counting)
    for item, value in stream(
        client, works.echo, range(2000), name="test", size=lambda item: 1, refused=refused
    ):
        ended += 1
        widest = max(widest, asked - ended)
        assert value == (Lost("odd") if item == 77 else item)
    assert ended == 2000
    assert widest <= 8 * (2 * 2 + 2) + 8
    assert groups[0] == 1, "one worker goes first"
    assert set(groups[2:200]) == {8}
    assert groups[-1] == 1
    assert len(groups) < 300


def test_large_files_go_alone(client, monkeypatch):
    groups = []
    send = tasks._Flow.send
    monkeypatch.setattr(
        tasks._Flow, "send", lambda self, items, **o: groups.append(items) or send(self, items, **o)
    )
    sizes = {k: 3 * 2**20 if k % 10 == 0 else 1 for k in range(100)}
    found = dict(stream(client, works.echo, range(100), name="test", size=sizes.__getitem__))
    assert len(found) == 100
    assert all(sum(map(sizes.__getitem__, group)) < 2**22 for group in groups)


def test_a_stream_that_is_left_leaves_nothing_on_its_way(client):
    pairs = stream(client, works.first_frames_later, range(50), name="test", size=lambda item: 1)
    next(pairs)
    pairs.close()
    assert flow(client, works.echo, [1]) == {1: 1}
    deadline = time.monotonic() + 20  # a worker may not be there again yet
    while client.futures and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not client.futures


def test_errors_of_the_worker_itself_are_told(client):
    class Unreadable:
        def __reduce__(self):
            return (int, ("not a number",))

    found = flow(client, partial(works.die_at, Unreadable()), [1, 2])
    assert {value.reason[:36] for value in found.values()} == {
        "on its worker: ValueError: invalid l"
    }


def test_programs_are_forgotten_when_there_are_many_new_ones(monkeypatch):
    import jax

    memory = worker._Memory()
    forgot = []
    monkeypatch.setattr(memory, "forget", lambda: forgot.append(memory._programs))
    monkeypatch.setattr(worker, "_MUCH", -(2**40))
    memory.tidy()
    for _ in range(worker._MANY):
        assert not forgot
        memory._count("/jax/core/compile/backend_compile_duration", 1.0)
        memory._count("/jax/core/compile/jaxpr_trace_duration", 1.0)
        memory.tidy()
    assert forgot == [worker._MANY]
    monkeypatch.undo()
    cleared = []
    monkeypatch.setattr(jax, "clear_caches", lambda: cleared.append(1))
    memory.forget()
    memory.tidy()
    assert (cleared, memory._programs) == ([1], 0)
    monkeypatch.setattr(worker, "_MUCH", 2**40)
    memory._programs = 10**6
    memory.tidy()
    assert memory._programs == 10**6, "while it has not grown, nothing is gained"
    jax.monitoring.unregister_event_duration_listener(memory._count)


@pytest.fixture
def bucket():
    """A folder of fsspec's in memory, with two clips and another file."""
    fsspec = pytest.importorskip("fsspec")
    system = fsspec.filesystem("memory")
    system.pipe("/bucket/takes/notes.txt", b"")
    for k, name in enumerate(("a.bvh", "deep/b.npz")):
        places.put(partial(jm.save, swinging(12 + k)), f"memory://bucket/takes/{name}")
    yield system
    system.rm("/bucket", recursive=True)


def test_urls(bucket, tmp_path):
    takes, out = "memory://bucket/takes", "memory://bucket/out"
    done = jm.corpus.map(works.first_frames, takes, out, to="bvh")
    assert [d.target for d in done] == [f"{out}/a.bvh", f"{out}/deep/b.bvh"]
    assert bucket.find("/bucket/out") == ["/bucket/out/a.bvh", "/bucket/out/deep/b.bvh"]
    local = tmp_path / "local"
    jm.corpus.map(works.first_frames, [f"{out}/*.bvh", f"{takes}/deep/b.npz"], local)
    assert sorted(tree(local)) == ["a.bvh", "b.npz"]
    assert (local / "a.bvh").read_bytes() == bucket.cat("/bucket/out/a.bvh")
    assert [d.status for d in jm.corpus.map(works.first_frames, takes, out, to="bvh")] == 2 * [
        "failed"
    ]
    again = jm.corpus.map(works.first_frames, takes, out, to="bvh", resume=True)
    assert [d.status for d in again] == 2 * ["skipped"]
    done = jm.corpus.map(works.first_frames, takes, local.as_uri(), overwrite=True)
    assert sorted(tree(local)) == ["a.bvh", "b.npz", "deep/b.npz"]
    with pytest.raises(FileNotFoundError, match="no motion file"):
        jm.corpus.map(works.first_frames, "memory://bucket/none", out)
    with pytest.raises(ValueError, match="over an input"):
        jm.corpus.map(works.first_frames, takes, takes)


def test_urls_of_a_motion_in_two_files(bucket, tmp_path):
    out = "memory://bucket/amc"
    jm.corpus.map(works.first_frames, "memory://bucket/takes/a.bvh", out, to="amc")
    assert bucket.find("/bucket/amc") == ["/bucket/amc/a.amc", "/bucket/amc/a.asf"]
    done = jm.corpus.map(works.first_frames, f"{out}/a.amc", tmp_path / "back", to="npz", fps=30)
    assert [d.status for d in done] == ["written"], done
    assert len(jm.load(tmp_path / "back" / "a.npz")) == 10


def test_what_is_told_of_a_url_names_it(bucket, tmp_path):
    """And not the copy that was read."""
    bucket.pipe("/bucket/broken.bvh", b"HIERARCHY\n")
    [done] = jm.corpus.map(works.first_frames, "memory://bucket/broken.bvh", tmp_path)
    assert done.message.startswith("memory://bucket/broken.bvh:")
    assert "jaxmotion-" not in done.message


def test_half_a_file_never_shows_at_a_url(bucket, monkeypatch):
    def half(self, local, remote, **options):
        with self.open(remote, "wb") as file:
            file.write(b"half")
            raise OSError("the line is cut")

    monkeypatch.setattr(type(bucket), "put_file", half)
    done = jm.corpus.map(works.first_frames, "memory://bucket/takes", "memory://bucket/out")
    assert [d.status for d in done] == 2 * ["failed"]
    assert "the line is cut" in done[0].message
    assert bucket.find("/bucket/out") == []


def test_urls_on_a_cluster(bucket):
    """Whose workers are threads of this process, for that is where the memory is."""
    distributed = pytest.importorskip("distributed")
    crew = distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    )
    out = "memory://bucket/out"
    with crew, distributed.Client(crew, set_as_default=False) as client:
        done = jm.corpus.map(works.first_frames, "memory://bucket/takes", out, client=client)
    assert [d.status for d in done] == 2 * ["written"]
    assert len(bucket.find("/bucket/out")) == 2


def test_a_worker_of_another_release_is_refused(takes, tmp_path, client, monkeypatch):
    there = Caller.here()._replace(release="0.0")
    monkeypatch.setattr(mapping.Caller, "here", lambda: there)
    done = jm.corpus.map(works.first_frames, takes, tmp_path / "out", client=client)
    assert {d.status for d in done} == {"failed"}
    assert all(d.message.endswith("its client 0.0") for d in done)
    assert not (tmp_path / "out").exists()


def test_a_package_that_lacks_is_named(takes, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    words = "needs dask.distributed.: pip install 'jaxmotion.distributed.'"
    with pytest.raises(ImportError, match=words):
        jm.corpus.map(works.first_frames, takes, tmp_path / "out", client="local")
    with pytest.raises(ImportError, match=words), jm.corpus.local_client(1):
        pass


def test_a_scheduler_that_is_not_there(takes, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("jaxmotion._cluster.connections._ANSWER", 0.3)
    with pytest.raises(ConnectionError, match=r"no dask scheduler answers at tcp://127"):
        jm.corpus.map(works.first_frames, takes, tmp_path / "out", client="tcp://127.0.0.1:9")


def test_a_scheduler_that_goes(tmp_path):
    """All is told that came before, and then that it is gone."""
    distributed = pytest.importorskip("distributed")
    crew = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    )
    with distributed.Client(crew, set_as_default=False) as client:
        pairs = stream(client, works.echo, range(400), name="test", size=lambda item: 1)
        next(pairs)
        crew.close()
        with pytest.raises(ConnectionError, match="scheduler is gone"):
            list(pairs)


def test_wrong_numbers_of_workers():
    for wrong in (0, -1):
        words = r"workers is .*; expected a number from 1"
        with pytest.raises(ValueError, match=words), jm.corpus.local_client(wrong):
            pass


def test_a_script_without_a_guard_is_told(tmp_path):
    """Its workers import it, and would start workers."""
    script = tmp_path / "script.py"
    script.write_text("import jaxmotion as jm\nwith jm.corpus.local_client(1):\n    print('in')\n")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert done.stdout == ""
    assert "put what runs at its top below \"if __name__ == '__main__':\"" in done.stderr
    assert "ConnectionError: the workers of this machine did not start" in done.stderr


def test_messages():
    assert mapping._described(RuntimeError()) == "RuntimeError"
    assert mapping._described(KeyError("a\nb")) == "KeyError: 'a\\nb'"
