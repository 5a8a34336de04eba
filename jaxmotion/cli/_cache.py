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

_LOOKED = "jaxmotion-looked"  # its time of change: entries that are older were whole
_SLACK = 2 * 10**9  # nanoseconds by which file systems round times
_ZSTD = b"\x28\xb5\x2f\xfd"


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
