"""Acclaim motion files (.amc): the table of degrees of freedom, in and out.

    :SAMPLES-PER-SECOND 120       (optional)
    :FULLY-SPECIFIED
    :DEGREES                      (or :RADIANS)
    1
    root 9.37 17.87 -17.32 -2.02 -7.60 -3.23
    lowerback 2.30 -0.40 1.17
    …

Every frame repeats the lines of the first in its order, so a bone's lines are a stride of the
file's, and columns are parsed whole: no loop over tokens in Python, O(file). Blank lines and
comments may stand anywhere. Frame numbers may start anywhere and must rise by a constant step. A
last frame that is cut off (a file that ends early) is dropped with a
:class:`~jaxmotion.io.MotionFileWarning`, unless it is the only one.
"""

import itertools
import math
import warnings
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import IO, NoReturn

import numpy as np

from jaxmotion._plain import quoted
from jaxmotion.io.errors import MotionFileError, MotionFileWarning, read_file
from jaxmotion.io.text import decoded, plain_bytes

_FRAMES_AT_ONCE = 4096


@dataclass
class AmcTable:
    """``columns``: f64[T, n] by bone name, as written; ``unit``: "deg", "rad" or "" if the file
    does not say; ``fps``: None if the file does not say."""

    columns: dict[str, np.ndarray]
    num_frames: int
    unit: str
    fps: float | None


def read_amc(path: str | PathLike, widths: dict[str, int], encoding: str = "utf-8") -> AmcTable:
    """Read the table of an AMC file.

    **Arguments:** ``widths``: how many numbers each bone has, by name; ``encoding``: of the .asf.
    A name that is not there as spelt is looked for in any case, and in the encoding that its own
    bytes tell.
    **Raises:** :class:`MotionFileError`; ``OSError`` if the file cannot be opened.
    """
    return _Reader(Path(path), widths, encoding).table()


def write_amc(
    file: IO[bytes], columns: dict[str, np.ndarray], fps: str, digits: str, encoding: str
) -> None:
    """Write columns f64[T, n] by bone name, angles in degrees, as an AMC file.

    **Arguments:** ``fps``: as text; ``digits``: the %-format of a number; ``encoding``: of names.
    """
    lines = ["%d"]
    for name, values in columns.items():
        lines.append(" ".join([name.replace("%", "%%")] + [digits] * values.shape[1]))
    template = "\n".join(lines) + "\n"
    numbers = np.concatenate(list(columns.values()), axis=1)
    header = f"# Acclaim motion written by jaxmotion\n:SAMPLES-PER-SECOND {fps}\n"
    file.write(f"{header}:FULLY-SPECIFIED\n:DEGREES\n".encode())
    for start in range(0, len(numbers), _FRAMES_AT_ONCE):
        rows = numbers[start : start + _FRAMES_AT_ONCE].tolist()
        text = "".join([template % (start + i, *row) for i, row in enumerate(rows, 1)])
        file.write(text.encode(encoding))


class _Reader:
    def __init__(self, path: Path, widths: dict[str, int], encoding: str):
        self.path = path
        self.widths = widths
        self.encoding = encoding
        data = plain_bytes(path, read_file(path))
        if b"\r" in data:
            data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        self.lines = data.split(b"\n")
        self.last_comment = data.count(b"\n", 0, data.rfind(b"#") + 1)

    def fail(self, found: str, expected: str, line=None, frame=None, hint: str = "") -> NoReturn:
        raise MotionFileError(
            self.path, found, expected=expected, line=line, frame=frame, hint=hint
        )

    def table(self) -> AmcTable:
        self.start, unit, fps = self._header()
        content = self.lines[self.start :]
        if self.last_comment > self.start:
            content = [line.split(b"#", 1)[0] for line in content]
        content = [line for line in content if line and not line.isspace()]
        later = (k for k in range(1, len(content)) if content[k].strip().isdigit())
        self.period = next(later, len(content))
        self.pattern = self._pattern(content[1 : self.period])
        frames = self._complete_frames(content)
        self._check_frame_numbers(content[: frames * self.period : self.period])
        columns = {
            name: self._column(content[k : frames * self.period : self.period], token, width)
            for k, (name, token, width) in enumerate(self.pattern, 1)
        }
        return AmcTable(columns, frames, unit, fps)

    def _header(self) -> tuple[int, str, float | None]:
        unit, fps = "", None
        for number, line in enumerate(self.lines):
            words = line.split(b"#", 1)[0].decode("latin-1").lower().split()
            if not words:
                continue
            if len(words) == 1 and line.split(b"#", 1)[0].strip().isdigit():
                return number, unit, fps
            if words[0] in (":degrees", ":radians"):
                unit = words[0][1:4]
            elif words[0] == ":samples-per-second":
                fps = _number(words[1]) if len(words) == 2 else math.nan
                if not 0 < fps < math.inf:
                    self.fail(quoted(line), "a number of frames a second", number + 1)
            elif words[0][0] != ":":
                self.fail(
                    quoted(line),
                    "a keyword such as ':DEGREES', or the first frame's number",
                    number + 1,
                    hint="check that this is an .amc file",
                )
        self.fail("no frames", "a frame number on a line of its own, then its bones")

    def _pattern(self, first_frame: list[bytes]) -> list[tuple[str, bytes, int]]:
        """Name, name as spelt and number of values of each line of a frame."""
        by_lower = {name.lower(): name for name in self.widths} | {n: n for n in self.widths}
        _, own = decoded(self.path, b"\n".join(line.split()[0] for line in first_frame))
        pattern: dict[str, tuple[str, bytes, int]] = {}
        for place, line in enumerate(first_frame, 1):
            token = line.split()[0]
            spelt = token.decode(own)
            for text in (token.decode(self.encoding, "replace"), spelt):
                name = by_lower.get(text) or by_lower.get(text.lower(), "")
                if name:
                    break
            if not name or name in pattern:
                self.fail(
                    f"{'a second' if name else 'an unknown'} bone {quoted(spelt)}",
                    "each bone of the .asf once",
                    self._line_of(place),
                    0,
                    "pass the .asf that the motion was made for: asf=...",
                )
            pattern[name] = (name, token, self.widths[name])
        return list(pattern.values())

    def _line_of(self, place: int) -> int:
        """Line number of a line of content, blank lines and comments not counted."""
        lines = enumerate(self.lines[self.start :], self.start + 1)
        inked = (number for number, line in lines if line.split(b"#", 1)[0].strip())
        return next(itertools.islice(inked, place, None))

    def _complete_frames(self, content: list[bytes]) -> int:
        """Frames but for a last one cut off by the end of the file."""
        frames, rest = divmod(len(content), self.period)
        if rest:
            *tail, last = [line.split()[0] for line in content[frames * self.period :]]
            expected = [token for _, token, _ in self.pattern[: rest - 1]]
            if tail[1:] != expected[:-1] or (tail and not expected[-1].startswith(last)):
                self._blame()
        elif frames > 1 and self.pattern and len(content[-1].split()) <= self.pattern[-1][2]:
            frames, rest = frames - 1, self.period
        if rest:
            warnings.warn(
                f"{self.path}: the last frame is cut off and was dropped",
                MotionFileWarning,
                stacklevel=5,
            )
        return frames

    def _check_frame_numbers(self, rows: list[bytes]) -> None:
        texts = [row.strip() for row in rows]
        if not all(text.isdigit() and len(text) < 16 for text in texts):
            self._blame()
        numbers = np.array([int(text) for text in texts])
        steps = np.diff(numbers)
        wrong = (steps != steps[:1]) | (steps <= 0)
        if wrong.any():
            at = int(np.argmax(wrong)) + 1
            self.fail(
                f"frame {numbers[at]} after frame {numbers[at - 1]}",
                "frame numbers that rise by a constant step",
                self._line_of(at * self.period),
                at,
                "frames are missing or out of order: renumber them if they are meant so",
            )

    def _column(self, rows: list[bytes], token: bytes, width: int) -> np.ndarray:
        """Numbers f64[T, width] of one bone's lines."""
        tokens = b" ".join(rows).split()
        if len(tokens) != len(rows) * (width + 1) or tokens[:: width + 1].count(token) != len(rows):
            self._blame()
        del tokens[:: width + 1]
        try:
            numbers = np.array(list(map(float, tokens)), np.float64)
        except ValueError:
            self._blame()
        if b"_" in b"".join(tokens) or not np.isfinite(numbers).all():
            self._blame()
        return numbers.reshape(len(rows), width)

    def _blame(self) -> NoReturn:
        """Raise for the first line that does not repeat the first frame's pattern."""
        count = 0
        for number, line in enumerate(self.lines[self.start :], self.start + 1):
            tokens = line.split(b"#", 1)[0].split()
            if not tokens:
                continue
            frame, place = divmod(count, self.period)
            count += 1
            if place == 0:
                expected = "a frame number"
                good = len(tokens) == 1 and tokens[0].isdigit() and len(tokens[0]) < 16
            else:
                name, token, width = self.pattern[place - 1]
                expected = f"{quoted(name)} and {width} finite numbers"
                good = tokens[0] == token and len(tokens) == width + 1
                good = good and all(math.isfinite(_number(text)) for text in tokens[1:])
            if not good:
                hint = "every frame must list the first frame's bones in its order"
                self.fail(quoted(line.strip()), expected, number, frame, hint)
        self.fail("frames that do not repeat the first", "the same bones in every frame")


def _number(text: str | bytes) -> float:
    """The number a token spells, NaN if it spells none."""
    try:
        return math.nan if "_" in str(text) else float(text)
    except ValueError:
        return math.nan
