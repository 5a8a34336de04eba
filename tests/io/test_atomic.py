"""Whole files or none when processes are killed, disks are full and names lead elsewhere."""

import errno
import os
import socket
import stat
import subprocess
import sys

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion._plain import in_words, irregular
from jaxmotion.io import MotionFileError, atomic
from jaxmotion.io.atomic import atomic_write, remove_abandoned
from tests.helpers import random_motion

_HOLD = """
import sys
from jaxmotion.io.atomic import atomic_write
with atomic_write(sys.argv[1]) as file:
    file.write(b"half")
    file.flush()
    print("writing", flush=True)
    sys.stdin.read()
"""
unix = pytest.mark.skipif(os.name == "nt", reason="pipes, devices and links as Unix has them")


def write(path, data=b"x", meanwhile=lambda: None):
    """Write a file, with something that happens before the first byte."""
    with atomic_write(path) as file:
        meanwhile()
        file.write(data)


@pytest.fixture
def writer():
    """Start a process that writes half a file and waits; it is killed in the end."""
    started = []

    def start(path):
        process = subprocess.Popen(
            [sys.executable, "-c", _HOLD, str(path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        assert process.stdout.readline() == "writing\n"
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


def test_what_a_killed_process_left_is_taken_away_and_nothing_else(writer, tmp_path):
    others = ["a.bvh", ".a.bvh.12345678.tmp", ".a.bvh.swp", "b.jaxmotion-tmp"]
    for name in others:
        (tmp_path / name).write_text("mine")
    killed, alive = writer(tmp_path / "a.bvh"), writer(tmp_path / "b.bvh")
    assert len(list(tmp_path.glob(".*.jaxmotion-tmp"))) == 2
    assert remove_abandoned(tmp_path) == 0
    killed.kill()
    killed.wait()
    assert remove_abandoned(tmp_path) == 1
    [left] = tmp_path.glob(".*.jaxmotion-tmp")
    assert left.name.startswith(".b.bvh.")
    alive.communicate("")  # end of its input: it goes on
    assert alive.returncode == 0
    assert (tmp_path / "b.bvh").read_text() == "half"
    assert sorted(os.listdir(tmp_path)) == sorted([*others, "b.bvh"])
    assert remove_abandoned(tmp_path / "none") == 0


def test_own_files_live_until_they_are_abandoned(tmp_path):
    def meanwhile():
        assert len(os.listdir(tmp_path)) == 1
        assert remove_abandoned(tmp_path) == 0
        atomic.abandon()
        assert os.listdir(tmp_path) == []

    with pytest.raises(FileNotFoundError, match="cannot be written"):
        write(tmp_path / "a", meanwhile=meanwhile)
    assert not atomic._living


def test_a_file_taken_for_abandoned_before_it_was_locked(tmp_path, monkeypatch):
    lock = atomic._locked
    calls = []

    def late(handle):
        if not calls:
            [name] = tmp_path.iterdir()
            name.unlink()
        calls.append(handle)
        return lock(handle)

    monkeypatch.setattr(atomic, "_locked", late)
    write(tmp_path / "a", b"whole")
    assert len(calls) == 2
    assert (tmp_path / "a").read_bytes() == b"whole"
    assert os.listdir(tmp_path) == ["a"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
@pytest.mark.parametrize("size", [5, 100_000])
def test_a_full_disk_names_the_target(tmp_path, monkeypatch, size):
    path = tmp_path / "a.bvh"
    path.write_text("before")
    full = os.open("/dev/full", os.O_WRONLY)
    fdopen = os.fdopen
    monkeypatch.setattr(atomic.os, "fdopen", lambda handle, mode: fdopen(full, mode))
    with pytest.raises(OSError, match="cannot be written: the disk is full") as caught:
        write(path, b"x" * size)
    assert caught.value.errno == errno.ENOSPC
    assert caught.value.filename == str(path)
    assert os.listdir(tmp_path) == ["a.bvh"]
    assert path.read_text() == "before"


def test_of_two_files_the_one_that_could_not_be_written_is_named(tmp_path):
    def fail():
        raise OSError(errno.EDQUOT, os.strerror(errno.EDQUOT))

    with pytest.raises(OSError, match="quota") as caught, atomic_write(tmp_path / "a.asf"):
        write(tmp_path / "a.amc", meanwhile=fail)
    assert caught.value.filename == str(tmp_path / "a.amc")
    assert os.listdir(tmp_path) == []


def test_errors_of_other_files_pass(tmp_path):
    with pytest.raises(FileNotFoundError) as caught:
        write(tmp_path / "a", meanwhile=(tmp_path / "other").read_bytes)
    assert caught.value.filename == str(tmp_path / "other")


def test_a_folder_that_goes_away_meanwhile(tmp_path):
    (tmp_path / "out").mkdir()

    def meanwhile():
        [name] = (tmp_path / "out").iterdir()
        name.unlink()
        (tmp_path / "out").rmdir()

    with pytest.raises(FileNotFoundError, match="cannot be written: no such") as caught:
        write(tmp_path / "out" / "a", meanwhile=meanwhile)
    assert caught.value.filename == str(tmp_path / "out" / "a")


@pytest.mark.skipif(os.name == "nt" or os.getuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(PermissionError, match="permission denied"):
            write(tmp_path / "a")
    finally:
        tmp_path.chmod(0o700)


def make_device(path):
    """A null device, or a link to the machine's own for those who could not replace that one."""
    if os.getuid() != 0:
        path.symlink_to("/dev/null")
        return
    try:
        os.mknod(path, stat.S_IFCHR | 0o600, os.stat("/dev/null").st_rdev)
    except OSError:
        pytest.skip("root, and not allowed to make devices")


@unix
def test_pipes_devices_sockets_and_loops_are_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    make_device(tmp_path / "device")
    (tmp_path / "loop").symlink_to(tmp_path / "pool")
    (tmp_path / "pool").symlink_to(tmp_path / "loop")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(os.path.relpath(tmp_path / "socket"))  # the whole path may be too long
    before = sorted(os.listdir(tmp_path))
    for name, word in [
        ("pipe", "a named pipe, not a file"),
        ("device", "a device, not a file"),
        ("socket", "a socket, not a file"),
        ("loop", "a loop of symbolic links"),
    ]:
        with pytest.raises(OSError, match=f"cannot be written: {word}") as caught:
            write(tmp_path / name)
        assert caught.value.filename == str(tmp_path / name)
    assert sorted(os.listdir(tmp_path)) == before
    assert irregular("/dev/null") == "a device"


@unix
@pytest.mark.parametrize("suffix", [".bvh", ".amc", ".npz"])
def test_reading_a_pipe_or_device_is_refused_at_once(tmp_path, suffix):
    os.mkfifo(tmp_path / f"pipe{suffix}")
    (tmp_path / f"null{suffix}").symlink_to("/dev/null")
    (tmp_path / "pipe.asf").touch()
    (tmp_path / "null.asf").touch()
    if suffix == ".amc":
        jm.save(random_motion(np.random.default_rng(0), 2, 3), tmp_path / "pipe.amc.amc")
        (tmp_path / "pipe.amc.asf").replace(tmp_path / "pipe.asf")
        (tmp_path / "null.asf").write_bytes((tmp_path / "pipe.asf").read_bytes())
    for name, word in (("pipe", "a named pipe"), ("null", "a device")):
        with pytest.raises(MotionFileError, match=f"found {word}; expected an ordinary file"):
            jm.load(tmp_path / f"{name}{suffix}")
    (tmp_path / f"loop{suffix}").symlink_to(tmp_path / f"loop{suffix}")
    (tmp_path / "loop.asf").write_bytes((tmp_path / "pipe.asf").read_bytes())
    with pytest.raises(OSError) as caught:
        jm.load(tmp_path / f"loop{suffix}")
    assert in_words(caught.value) == "a loop of symbolic links"


def test_the_longest_name_that_a_file_may_have(tmp_path):
    path = tmp_path / ("\U0001f6b6" * 62 + ".bvh")
    assert len(os.fsencode(path.name)) == 252
    write(path)
    assert os.listdir(tmp_path) == [path.name]
