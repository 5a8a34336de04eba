"""The folder of compiled programs.

JAX writes an entry in place and never again: one that was cut off, by a kill or a full disk, would
be read, refused and compiled anew by every run. So before JAX sees the folder, entries that are
empty, and entries cut off among those written since the last look, are taken away.
"""

import os
import sys
import time
import zlib
from contextlib import suppress
from pathlib import Path

from jaxmotion._plain import printable

_LOOKED = "jaxmotion-looked"  # its time of change: entries that are older were whole
_SLACK = 2 * 10**9  # nanoseconds by which file systems round times
_ZSTD = b"\x28\xb5\x2f\xfd"


def enable_compilation_cache(folder: str | os.PathLike | None = None) -> Path:
    """Keep compiled programs on disk, so that the next process does not compile them again.

    Sets JAX's configuration for the whole process. The library's functions are kept when called
    eagerly. Under a ``jax.jit`` of your own, what may stop at a wrong value while it runs calls the
    host, and JAX keeps no such program: inside of ``with jaxmotion.checks("nan")`` it does.

    **Arguments:** ``folder``: made if it is not there; by default that of the command line:
    ``JAXMOTION_CACHE_DIR``, or ``jaxmotion`` in the user's folder of caches.
    **Returns:** the folder.
    **Raises:** ``OSError`` for a folder that cannot be made or written to, or none by default.

    **Example:**

        >>> import tempfile, jax, jaxmotion as jm
        >>> before = jax.config.jax_compilation_cache_dir
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     kept = jm.enable_compilation_cache(folder)
        ...     jax.config.update("jax_compilation_cache_dir", before)
        >>> kept.name == kept.stem
        True
    """
    chosen = cache_folder() if folder is None else Path(folder).expanduser()
    if chosen is None:
        raise OSError("enable_compilation_cache: no folder is given and there is none by default")
    chosen.mkdir(parents=True, exist_ok=True)
    if not os.access(chosen, os.W_OK):
        raise OSError(f"enable_compilation_cache: {printable(chosen)} cannot be written to")
    mend(chosen)
    keep_programs(chosen)
    return chosen


def keep_programs(folder: Path) -> None:
    """Tell JAX to keep all programs, however small, in ``folder``."""
    import jax

    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)


def folder_of_programs() -> str | None:
    """Where this process keeps them, if it does."""
    import jax

    return jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]


def share_programs(folder: str | None) -> None:
    """Keep them where the process does that work is from, unless this one has a place."""
    if folder and not folder_of_programs() and Path(folder).is_dir():
        keep_programs(Path(folder))


def cache_folder() -> Path | None:
    """Where compiled programs are kept: ``JAXMOTION_CACHE_DIR`` (empty: nowhere), else the user's
    cache folder by the platform's rules; nowhere for a user without a home."""
    named = os.environ.get("JAXMOTION_CACHE_DIR")
    try:
        if named is not None:
            return Path(named).expanduser() if named else None
        home = Path.home()
    except RuntimeError:
        return None
    if sys.platform == "darwin":
        base = home / "Library" / "Caches"
    elif os.name == "nt":
        base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    return base / "jaxmotion"


def usable_folder() -> Path | None:
    """:func:`cache_folder`, made and mended, if it can be written to."""
    folder = cache_folder()
    if folder is None:
        return None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            return None
        mend(folder)
    except OSError:
        return None
    return folder


def mend(folder: Path) -> None:
    """Remove entries that are not whole."""
    looked = folder / _LOOKED
    before = looked.stat().st_mtime_ns if looked.exists() else 0
    begun = time.time_ns()
    with os.scandir(folder) as entries:
        for entry in entries:
            if not entry.name.endswith("-cache"):
                continue
            with suppress(OSError):  # another process was faster
                facts = entry.stat()
                fresh = facts.st_mtime_ns >= before - _SLACK
                if facts.st_size == 0 or (fresh and not _is_whole(Path(entry.path).read_bytes())):
                    os.unlink(entry.path)
    looked.touch()
    os.utime(looked, ns=(begun, begun))


def _is_whole(data: bytes) -> bool:
    """Whether compressed data are all there; what is neither zlib's nor Zstandard's passes."""
    if data.startswith(_ZSTD):
        return _ends_with_its_frame(data)
    if data[:1] != b"\x78":
        return bool(data)
    stream = zlib.decompressobj()
    try:
        stream.decompress(data)
    except zlib.error:
        return False
    return stream.eof


def _ends_with_its_frame(data: bytes) -> bool:
    """Whether a Zstandard frame's last block is there (RFC 8878, 3.1.1): blocks are headed by three
    bytes, their size times 8, plus 2 for a repeated byte, plus 1 for the last."""
    if len(data) < 6:
        return False
    flags = data[4]
    single, checksum = flags >> 5 & 1, flags >> 2 & 1
    size_bytes = (single, 2, 4, 8)[flags >> 6]
    at = 5 + (1 - single) + (0, 1, 2, 4)[flags & 3] + size_bytes
    last = False
    while not last and at + 3 <= len(data):
        head = int.from_bytes(data[at : at + 3], "little")
        last = bool(head & 1)
        at += 3 + (1 if head >> 1 & 3 == 1 else head >> 3)
    return last and at + 4 * checksum <= len(data)
