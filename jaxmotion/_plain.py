"""Plain words for what comes from outside: names, errors of the system, kinds of file.

Names of files and joints are anybody's text. Shown as they are, they could move the cursor, set
the window's title or reverse a line, so whatever is shown goes through :func:`printable` and what
is written as JSON through :func:`as_json`.
"""

import errno
import json
import os
import re
import stat
import unicodedata
from typing import Any

_WORDS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EROFS: "the disk is read-only",
    errno.EACCES: "permission denied",
    errno.EPERM: "permission denied",
    errno.ELOOP: "a loop of symbolic links",
    errno.ENAMETOOLONG: "the name is too long",
    errno.ENOENT: "no such file or folder",
    errno.EISDIR: "a folder, not a file",
    errno.ENOTDIR: "part of the path is a file, not a folder",
    errno.EIO: "the disk reports an error",
}
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def printable(text: object) -> str:
    """``text`` on one line, whatever does not print (control and formatting characters, line ends,
    bytes of a file name that are no text) written as an escape such as ``\\x1b``."""
    text = str(text)
    return text if text.isprintable() else "".join(map(_shown, text))


def _shown(character: str) -> str:
    if _prints(character):
        return character
    if "\udc80" <= character <= "\udcff":  # a byte that is no text, as Python keeps it in names
        return f"\\x{ord(character) - 0xDC00:02x}"
    return character.encode("unicode_escape").decode("ascii")


def _prints(character: str) -> bool:
    return character.isprintable() or unicodedata.category(character) == "Zs"


def quoted(text: str | bytes, limit: int = 40) -> str:
    """A piece of a file or a name, fit for a message: quoted, printable and short."""
    if isinstance(text, bytes):
        text = text[: 4 * limit].decode("utf-8", "backslashreplace")
    return repr(text if len(text) <= limit else text[:limit] + "...")


def as_json(value: Any, *, indent: int | None = None, ascii_only: bool = False) -> str:
    """``value`` as JSON, whatever does not print escaped: it reads back as it was."""
    text = json.dumps(value, indent=indent, ensure_ascii=ascii_only)
    return re.sub(r"[^ -~\n]", _escaped, text)


def _escaped(match: re.Match[str]) -> str:
    character = match.group()
    return character if _prints(character) else json.dumps(character)[1:-1]


def some(count: int, noun: str) -> str:
    """ "1 frame", "240 frames"."""
    return f"{count} {noun}{'s' * (count != 1)}"


def in_words(error: OSError) -> str:
    """What the system refused, without the number and the path."""
    number, text = error.errno or 0, error.strerror or str(error)
    # Words of our own are plain already.
    return _WORDS.get(number, text) if text == os.strerror(number) else text


def irregular(path: str | os.PathLike) -> str:
    """What ``path`` leads to if that is something other than an ordinary file: "a folder", "a named
    pipe"; empty for a file or for nothing."""
    try:
        kind = stat.S_IFMT(os.stat(path).st_mode)
    except OSError:
        return ""
    return "" if kind == stat.S_IFREG else _KINDS.get(kind, "something other than a file")
