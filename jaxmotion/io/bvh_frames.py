"""The lower half of a BVH file: one row of numbers a frame.

    MOTION
    Frames: T
    Frame Time: seconds
    c₁ … c_C        T rows, C the number of channels

The rows that are there count, not the header's T: where they differ, the rows are kept and a
:class:`~jaxmotion.io.MotionFileWarning` says so; a last row that is cut off, and text after the
last row, are dropped likewise. A row may be wrapped over lines, but begins on a line of its own
(else a number missing here and one too many there would pass for frames). Nothing is allocated from
a number in the file; only from how many numbers the file holds.

Two passes: the first counts the tokens of every line (byte masks), so that a missing number is
found where it is missing; the second turns a megabyte of text at a time into float64. Only
when that fails does a slow search name the token. O(bytes).
"""

import re
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from io import BytesIO
from os import PathLike
from typing import NamedTuple

import numpy as np

from jaxmotion._plain import quoted, some
from jaxmotion.io.bvh_hierarchy import Hierarchy, number_hint, parse_number
from jaxmotion.io.errors import MotionFileError, MotionFileWarning

# The value may stand on the next line: a frame time, if it is alone there (else it is a row).
_FRAMES = re.compile(rb"\s*Frames\s*:?[ \t]*(?:\s+(?=\+?\d))?([^\s:]*)", re.IGNORECASE)
_FRAME_TIME = re.compile(
    rb"\s*Frame\s*Time[ \t]*:?[ \t]*(?:\s+(?=\S+[ \t\r]*\n))?([^\s:]*)", re.IGNORECASE
)
_UNFINISHED = re.compile(rb"[+-]?\d*\.?\d*([eE][+-]?)?")
_SCAN_BYTES = 1 << 20
_PARSE_BYTES = 1 << 20


class Frames(NamedTuple):
    """What stands before the rows.

    ``declared``: the header's number of frames; ``frame_time_text``: as spelt; ``start``: where the
    rows begin; ``line``: the line that ``start`` is on, from 1.
    """

    declared: int
    frame_time_text: str
    start: int
    line: int


class Rows(NamedTuple):
    """Which bytes hold which frames.

    ``ends``: positions of the line ends that complete a row; ``totals``: complete rows up to each;
    ``one_a_line``: whether every row has a line of its own.
    """

    ends: np.ndarray
    totals: np.ndarray
    one_a_line: bool

    @property
    def count(self) -> int:
        """Complete rows."""
        return int(self.totals[-1])


def parse_header(path: str | PathLike, data: bytes, start: int) -> Frames:
    """Read "Frames:" and "Frame Time:" after the word MOTION, which ends at ``start``."""
    line = data.count(b"\n", 0, start) + 1
    first = _FRAMES.match(data, start)
    if first is None:
        raise _expected(path, data, start, line, "'Frames: N' after MOTION")
    line += data.count(b"\n", start, first.end())
    if not re.fullmatch(rb"\+?[0-9]{1,18}", first[1]):
        raise MotionFileError(
            path,
            f"Frames: {quoted(first[1])}",
            expected="a whole number of frames, in digits alone",
            line=line,
        )
    second = _FRAME_TIME.match(data, first.end())
    if second is None:
        raise _expected(path, data, first.end(), line, "'Frame Time: seconds' after 'Frames:'")
    line += data.count(b"\n", first.end(), second.end())
    text = second[1].decode("latin-1")
    after = re.compile(rb"[ \t]*(\S*)").match(data, second.end())
    if after and after[1] and _number(after[1]) is None:
        raise MotionFileError(
            path,
            f"{quoted(after[1])} after Frame Time: {quoted(text)}",
            expected="a number of seconds and nothing else on its line",
            hint="take it out, and write the time in seconds if that is another unit",
            line=line,
        )
    return Frames(int(first[1]), text, second.end(), line)


def find_rows(path: str | PathLike, data: bytes, frames: Frames, hierarchy: Hierarchy) -> Rows:
    """First pass: where the rows end; warns of repairs.

    **Raises:** :class:`~jaxmotion.io.MotionFileError` where a row has too few or too many numbers,
    or there is none.
    """
    columns = hierarchy.columns
    if columns == 0:
        raise MotionFileError(
            path, "no CHANNELS in any joint", expected="at least one channel", line=1
        )
    unfinished = _unfinished_token(data, frames.start)
    line_ends, tokens = _count_tokens(data, frames.start)
    if unfinished and tokens[-1] % columns == 0:
        tokens[-1] -= 1
    rows, left_over = _group(
        tokens, columns, partial(_wrong_count, path, data, frames, hierarchy, line_ends)
    )
    completing = np.flatnonzero(np.diff(rows, prepend=0) * (rows > 0))
    if completing.size == 0:
        raise MotionFileError(
            path,
            f"no complete frame ({left_over} of {columns} numbers)",
            expected=f"{columns} numbers, one a channel, for every frame",
            hint="export the clip again, with at least one frame",
            line=frames.line,
        )
    found = Rows(
        line_ends[completing],
        rows[completing],
        one_a_line=bool(np.isin(tokens[: completing[-1] + 1], (0, columns)).all()),
    )
    stray = _no_number(data[found.ends[-1] :], but_last=unfinished) if left_over else None
    _report_repairs(path, found.count, left_over, stray, columns, frames.declared)
    return found


def parse_rows(
    path: str | PathLike, data: bytes, frames: Frames, rows: Rows, hierarchy: Hierarchy
) -> Iterator[tuple[int, np.ndarray]]:
    """Second pass: (number of the first row, values f64[n, C]) a megabyte of text at a time.

    **Raises:** :class:`~jaxmotion.io.MotionFileError` naming the first token that is no finite
    number, its line, frame and channel.
    """
    for done, total, start, stop in _blocks(frames, rows):
        values = _numbers(data[start:stop], hierarchy.columns, rows.one_a_line)
        if values is None or len(values) != total - done or not np.isfinite(values).all():
            raise _bad_token(path, data, (start, stop), done, frames, hierarchy)
        yield done, values


def row_texts(data: bytes, frames: Frames, rows: Rows) -> Iterator[bytes]:
    """The text of whole rows, a megabyte at a time."""
    for _, _, start, stop in _blocks(frames, rows):
        yield data[start:stop]


def _blocks(frames: Frames, rows: Rows) -> Iterator[tuple[int, int, int, int]]:
    """(rows before, rows up to its end, first byte, end) of about a megabyte of rows at a time."""
    first, start, done = 0, frames.start, 0
    while done < rows.count:
        last = int(np.searchsorted(rows.ends, start + _PARSE_BYTES))
        last = min(max(last, first), len(rows.ends) - 1)
        stop, total = int(rows.ends[last]), int(rows.totals[last])
        yield done, total, start, stop
        first, start, done = last + 1, stop, total


def _numbers(text: bytes, columns: int, one_a_line: bool) -> np.ndarray | None:
    """The rows as f64[n, C]; ``None`` if something is no number."""
    if not one_a_line:
        tokens = text.split()
        lines = (tokens[i : i + columns] for i in range(0, len(tokens), columns))
        text = b"\n".join(map(b" ".join, lines))
    try:
        return np.loadtxt(BytesIO(text.replace(b"\r", b" ")), comments=None, ndmin=2)
    except ValueError:
        return None


def _expected(path, data: bytes, start: int, line: int, expected: str) -> MotionFileError:
    """What stands at ``start``, on ``line``, or on the first line after it that is not blank."""
    rest = data[start:].lstrip()
    line += data.count(b"\n", start, len(data) - len(rest))
    found = quoted(rest.split(b"\n", 1)[0].rstrip()) if rest else "the end of the file"
    return MotionFileError(path, found, expected=expected, line=line)


def _unfinished_token(data: bytes, start: int) -> bool:
    """Whether the file stops in the middle of a number ("-", "1.5e"), with no line end after."""
    tail = re.search(rb"[^\s]+\Z", data[max(start, len(data) - 64) :])
    if tail is None or _number(tail[0]) is not None:
        return False
    return _UNFINISHED.fullmatch(tail[0]) is not None


def _count_tokens(data: bytes, start: int) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the lines and the number of tokens on each."""
    view = np.frombuffer(data, np.uint8)
    ends, totals, total = [], [], 0
    for a in range(start, len(data), _SCAN_BYTES):
        b = min(a + _SCAN_BYTES, len(data))
        inked = view[a - 1 : b] > 32
        starts = np.flatnonzero(inked[1:] & ~inked[:-1])
        breaks = np.flatnonzero(view[a:b] == 10)
        ends.append(breaks + a)
        totals.append(np.searchsorted(starts, breaks) + total)
        total += len(starts)
    ends.append(np.array([len(data)]))
    totals.append(np.array([total]))
    return np.concatenate(ends), np.diff(np.concatenate(totals), prepend=0)


def _group(
    tokens: np.ndarray, columns: int, wrong: Callable[..., MotionFileError]
) -> tuple[np.ndarray, int]:
    """Rows complete at the end of each line, and the numbers left over at the end.

    ``wrong``: the error for a number of tokens in a frame and from which line to which they stand.
    """
    if not (tokens % columns).any():
        return np.cumsum(tokens // columns), 0
    rows = np.empty(len(tokens), np.int64)
    done, held, began = 0, 0, 0
    for i, here in enumerate(tokens.tolist()):
        whole = here % columns == 0 if held == 0 else held + here == columns
        if whole:
            done += (held + here) // columns
            held = 0
        elif held + here > columns:
            raise wrong(held or here, done, began if held else i, i if held == 0 else i - 1)
        else:
            began = began if held else i
            held += here
        rows[i] = -1 if held else done
    return rows, held


def _wrong_count(
    path,
    data: bytes,
    frames: Frames,
    hierarchy: Hierarchy,
    line_ends: np.ndarray,
    found: int,
    frame: int,
    first: int,
    last: int,
) -> MotionFileError:
    start = int(line_ends[first - 1]) if first else frames.start
    stray = _no_number(data[start : int(line_ends[last])])
    counted = some(found, "number")
    hint = "compare the CHANNELS lines with the rows; a number may be missing or split"
    if stray is not None:
        counted = f"{quoted(stray)} among {counted}"
        hint = number_hint(stray.decode("latin-1")) or "take out what is no number"
    return MotionFileError(
        path,
        counted,
        expected=f"{hierarchy.columns}, one for each channel of the hierarchy",
        hint=hint,
        line=frames.line + first,
        frame=frame,
    )


def _no_number(text: bytes, *, but_last: bool = False) -> bytes | None:
    """The first token that is no finite number."""
    tokens = text.split()
    tokens = tokens[:-1] if but_last else tokens
    return next((token for token in tokens if _number(token) is None), None)


def _number(token: bytes) -> float | None:
    return parse_number(token.decode("latin-1"))


def _report_repairs(
    path, count: int, left_over: int, stray: bytes | None, columns: int, declared: int
) -> None:
    repairs = []
    if stray is not None:
        repairs.append(f"{quoted(stray)} after the last frame is no number and was left out")
    elif left_over:
        repairs.append(
            f"the last row is cut off ({left_over} of {columns} numbers) and was dropped"
        )
    if count != declared:
        repairs.append(f"the header says {declared} frames, {count} are there and were kept")
    if repairs:
        warnings.warn(f"{path}: {'; '.join(repairs)}", MotionFileWarning, stacklevel=2)


def _bad_token(path, data, span, frame: int, frames: Frames, hierarchy: Hierarchy):
    """Find, by brute force, what the fast parser stumbled over."""
    start, stop = span
    line = frames.line + data.count(b"\n", frames.start, start)
    seen = 0
    for offset, text in enumerate(data[start:stop].split(b"\n")):
        for token in text.split():
            if _number(token) is None:
                column = hierarchy.column_name(seen % hierarchy.columns)
                return MotionFileError(
                    path,
                    f"{quoted(token)} for {quoted(column)}",
                    expected="a finite number",
                    hint=number_hint(token.decode("latin-1")),
                    line=line + offset,
                    frame=frame + seen // hierarchy.columns,
                )
            seen += 1
    return MotionFileError(path, "bytes that are no text", expected="numbers", line=line)
