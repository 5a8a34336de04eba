"""Whole files or none: write beside the target, then rename over it.

A reader never sees half a file, and a failure leaves whatever was there before. The rename is
atomic on one file system; nothing is flushed to the disk by force, so a power cut may lose the
new file. A file that is replaced keeps its permissions; a symbolic link keeps pointing, its target
is replaced.

A process that is killed leaves its temporary file, ``.NAME.xxxxxxxx.jaxmotion-tmp``. The system
drops a process's locks however it ends, so a temporary file that nobody holds a lock on is
abandoned, and :func:`remove_abandoned` may take it away while other processes write to the same
folder. (On Windows, where a file that is open cannot be removed, that is the lock; where a file
system keeps no locks nothing is removed.)
"""

import errno
import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from os import PathLike
from pathlib import Path
from typing import IO

from jaxmotion._plain import in_words, irregular, printable

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

_TEMPORARY = re.compile(r"\..*\.[0-9a-f]{8}\.jaxmotion-tmp", re.DOTALL)
_NAME_KEPT = 40  # characters, of up to four bytes; names may have 255 bytes
_FLAGS = os.O_RDWR | getattr(os, "O_BINARY", 0) | getattr(os, "O_NOFOLLOW", 0)

_living: set[str] = set()
_replacing: ContextVar[bool] = ContextVar("replacing", default=False)


@contextmanager
def atomic_write(path: str | PathLike, *, overwrite: bool = True) -> Iterator[IO[bytes]]:
    """Open ``path`` for binary writing; it appears, whole, when the block ends without error.

    **Arguments:** ``path``: the file to write; its folder must exist; ``overwrite``: whether a
    file of that name may be replaced.
    **Raises:** ``FileExistsError`` if it exists and may not be replaced; ``IsADirectoryError``,
    ``FileNotFoundError`` and other ``OSError``, which name ``path`` and not the temporary file: no
    permission, a full disk, a pipe or device of that name. On any exception from the block the
    temporary file is removed and ``path`` is as before.
    """
    target = _checked(path, overwrite)
    name = ""
    file = None
    lock = -1
    try:
        name, handle = _created(target)
        file = os.fdopen(handle, "wb")
        yield file
        file.flush()
        lock = os.dup(handle) if fcntl is not None else -1
        file.close()  # now: a disk far away may tell only here that it is full
        os.chmod(name, _mode(target))
        if overwrite or _replacing.get():
            os.replace(name, target)
        else:
            _rename_to_new(name, target)
    except BaseException as error:
        if file is not None:
            with suppress(OSError):  # what is still buffered may not fit either
                file.close()
        _remove(name)
        if isinstance(error, OSError) and error.errno and error.filename in (None, name, target):
            words = f"cannot be written: {in_words(error)}"
            raise OSError(error.errno, words, os.fspath(path)) from error
        raise
    finally:
        _living.discard(name)
        if lock >= 0:
            os.close(lock)


@contextmanager
def replacing() -> Iterator[None]:
    """Have files that exist replaced, whatever a writer is told: in work that may be done again
    after it was lost, of which somebody has looked before that nothing is in its way."""
    before = _replacing.set(True)
    try:
        yield
    finally:
        _replacing.reset(before)


def in_the_way(path: Path, overwrite: bool) -> bool:
    """Whether a file exists that may not be replaced."""
    return not (overwrite or _replacing.get()) and path.exists()


def remove_abandoned(folder: str | PathLike) -> int:
    """Remove the temporary files in ``folder`` (not below it) whose process has ended before they
    were whole; those of processes that live stay. **Returns:** how many."""
    try:
        with os.scandir(folder) as entries:
            found = [entry.path for entry in entries if _TEMPORARY.fullmatch(entry.name)]
    except OSError:
        return 0
    return sum(map(_removed_if_abandoned, found))


def abandon() -> None:
    """Remove this process's own temporary files: its last act before it leaves unfinished."""
    for name in tuple(_living):
        _remove(name)


def _checked(path: str | PathLike, overwrite: bool) -> Path:
    """The file meant, links followed, if it may be written."""
    target = Path(os.path.realpath(path))
    if os.path.islink(target):
        words = "cannot be written: a loop of symbolic links"
        raise OSError(errno.ELOOP, words, os.fspath(path))
    kind = irregular(target)
    if kind == "a folder":
        raise IsADirectoryError(f"{printable(path)} is a folder; give the name of a file")
    if kind:
        raise OSError(errno.EINVAL, f"cannot be written: {kind}, not a file", os.fspath(path))
    if in_the_way(target, overwrite):
        raise FileExistsError(f"{printable(path)} exists; pass overwrite=True to replace it")
    if not target.parent.is_dir():
        where, folder = printable(path), printable(target.parent)
        raise FileNotFoundError(f"{where} cannot be written: there is no folder {folder}")
    return target


def _created(target: Path) -> tuple[str, int]:
    """Name and descriptor of a new, locked file beside ``target``."""
    while True:
        name = f".{target.name[:_NAME_KEPT]}.{secrets.token_hex(4)}.jaxmotion-tmp"
        name = os.path.join(target.parent, name)
        _living.add(name)  # first: whoever interrupts must find it
        try:
            handle = os.open(name, _FLAGS | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            _living.discard(name)
            continue
        except OSError as error:
            _living.discard(name)
            raise OSError(error.errno, error.strerror) from error
        if _locked(handle) and os.path.lexists(name):
            return name, handle
        os.close(handle)  # taken for abandoned before it was locked
        _remove(name)


def _locked(handle: int) -> bool:
    """Whether no other process holds the lock; it is held from now on where locks are kept."""
    if fcntl is not None:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            pass
    return True


def _removed_if_abandoned(name: str) -> bool:
    try:
        if fcntl is None:
            os.unlink(name)
            return True
        handle = os.open(name, _FLAGS | os.O_NONBLOCK)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.unlink(name)
        finally:
            os.close(handle)
    except OSError:
        return False
    return True


def _remove(name: str) -> None:
    if name:
        with suppress(OSError):
            os.unlink(name)
        _living.discard(name)


def _rename_to_new(name: str, target: Path) -> None:
    """Rename unless ``target`` has appeared meanwhile, where the file system can tell."""
    try:
        os.link(name, target)
    except FileExistsError:
        where = printable(target)
        raise FileExistsError(f"{where} exists; pass overwrite=True to replace it") from None
    except OSError:
        os.replace(name, target)
    else:
        os.unlink(name)


def _mode(target: Path) -> int:
    """Permissions of the file replaced, else those a plain ``open`` would give."""
    if target.exists():
        return stat.S_IMODE(target.stat().st_mode)
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
