"""What goes wrong with a file.

One exception that says where, what was wanted and what to try; one warning for what was repaired.
"""

import errno
import os
from os import PathLike, fspath
from pathlib import Path

from jaxmotion._plain import irregular, printable

_LONGEST = 400  # characters of a message's ``found``


class MotionFileError(ValueError):
    """A motion file that cannot be read (or written) as asked.

    **Fields:**

    - ``path``: the file.
    - ``line``: line number, from 1, or ``None`` where there is none.
    - ``frame``: frame number, from 0, or ``None`` outside the frames.
    - ``found``: what the file holds there.
    - ``expected``: what should have been there.
    - ``hint``: what to try.

    ``str(error)`` is one line that prints, whatever is in the file or its name:
    ``walk.bvh:120 (frame 12): found …; expected …. Try: …``.
    """

    def __init__(
        self,
        path: str | PathLike,
        found: str,
        *,
        expected: str = "",
        hint: str = "",
        line: int | None = None,
        frame: int | None = None,
    ):
        self.path = fspath(path)
        self.line = line
        self.frame = frame
        self.found = found
        self.expected = expected
        self.hint = hint
        super().__init__(self._text())

    def _text(self) -> str:
        where = str(self.path)
        where += f":{self.line}" if self.line is not None else ""
        where += f" (frame {self.frame})" if self.frame is not None else ""
        found = self.found if len(self.found) <= _LONGEST else self.found[:_LONGEST] + "..."
        text = f"{where}: found {found}"
        text += f"; expected {self.expected}" if self.expected else ""
        text += f". Try: {self.hint}" if self.hint else ""
        return printable(text)

    def __reduce__(self):
        return _rebuild, (
            self.path,
            self.found,
            self.expected,
            self.hint,
            self.line,
            self.frame,
        )


class MotionFileWarning(UserWarning):
    """A file was repaired while reading, or its layout had to change so that nothing was lost."""

    def __init__(self, text: str):
        super().__init__(printable(text))


def read_file(path: str | PathLike) -> bytes:
    """The bytes of an ordinary file.

    **Raises:** :class:`MotionFileError` for a pipe, a socket or a device, which may never end;
    ``OSError`` if it cannot be opened.
    """
    require_file(path)
    return Path(path).read_bytes()


def require_file(path: str | PathLike) -> None:
    """Raise :class:`MotionFileError` for what is there but no ordinary file, without opening it;
    ``OSError`` for a folder or nothing at all."""
    os.stat(path)
    kind = irregular(path)
    if kind == "a folder":
        raise IsADirectoryError(errno.EISDIR, "a folder, not a file", fspath(path))
    if kind:
        raise MotionFileError(path, kind, expected="an ordinary file", hint="save it as one first")


def _rebuild(path, found, expected, hint, line, frame):
    return MotionFileError(path, found, expected=expected, hint=hint, line=line, frame=frame)
