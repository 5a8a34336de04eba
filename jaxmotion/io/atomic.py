"""Whole files or none: write beside the target, then rename over it.

A reader never sees half a file, and a failure leaves whatever was there before. The rename is
atomic on one file system; nothing is flushed to the disk by force, so a power cut may lose the
new file. A file that is replaced keeps its permissions; a symbolic link keeps pointing, its target
is replaced.
"""

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import IO


@contextmanager
def atomic_write(path: str | PathLike, *, overwrite: bool = True) -> Iterator[IO[bytes]]:
    """Open ``path`` for binary writing; it appears, whole, when the block ends without error.

    **Arguments:** ``path``: the file to write; its folder must exist; ``overwrite``: whether a
    file of that name may be replaced.
    **Raises:** ``FileExistsError`` if it exists and may not be replaced; ``IsADirectoryError``,
    ``FileNotFoundError`` and other ``OSError`` as opening a file does. On any exception from the
    block the temporary file is removed and ``path`` is as before.
    """
    target = Path(path).resolve()
    if target.is_dir():
        raise IsADirectoryError(f"{path} is a folder; give the name of a file")
    if target.exists() and not overwrite:
        raise FileExistsError(f"{path} exists; pass overwrite=True to replace it")
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{path} cannot be written: there is no folder {target.parent}")
    handle, name = tempfile.mkstemp(
        prefix=f".{target.name[:64]}.", suffix=".tmp", dir=target.parent
    )
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
        os.chmod(name, _mode(target))
        if overwrite:
            os.replace(name, target)
        else:
            _rename_to_new(name, target)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _rename_to_new(name: str, target: Path) -> None:
    """Rename unless ``target`` has appeared meanwhile, where the file system can tell."""
    try:
        os.link(name, target)
    except FileExistsError:
        raise FileExistsError(f"{target} exists; pass overwrite=True to replace it") from None
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
