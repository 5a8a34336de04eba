"""The upper half of a BVH file: joints, offsets, channels, end sites.

    HIERARCHY
    ROOT name                      names run to the brace or the end of the line: blanks and colons
    {                              are theirs
        OFFSET x y z
        CHANNELS n name … name     may be absent: no channels
        JOINT name { … }
        End Site { OFFSET x y z }
    }

Keywords in any case; any white space between words, all of it on one line or every word on its own.
Nesting may be as deep as it likes (a list is the stack). A name that occurs twice gets a number
("Bone", "Bone_2") with a :class:`~jaxmotion.io.MotionFileWarning`. O(characters).
"""

import math
import re
import warnings
from collections.abc import Iterator
from os import PathLike
from typing import NamedTuple

import numpy as np

from jaxmotion._plain import quoted
from jaxmotion.io.channels import JointChannels, parse_channels
from jaxmotion.io.errors import MotionFileError, MotionFileWarning

_UNSIGNED = r"(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_NUMBER = re.compile(rf"[+-]?{_UNSIGNED}", re.ASCII)
_JOINED = re.compile(rf"[+-]?{_UNSIGNED}(?:[+-]{_UNSIGNED})+", re.ASCII)
_PIECE = re.compile(r"[{}]|[^{}]+")
_BLANK = " \t\r\v\f"
_BLANKS = re.compile(f"[{_BLANK}]+")
_NAMING = "joint|root|end"
_KEYWORD = re.compile(rf"[{{}}]|(?:{_NAMING}|offset|channels|hierarchy)(?![^{_BLANK}])", re.I)
# A keyword with the name after it; any other words up to a keyword.
_PART = re.compile(
    rf"(?:{_NAMING})(?![^{_BLANK}]).*|[^{_BLANK}].*?(?=[{_BLANK}]+(?:{_KEYWORD.pattern})|$)", re.I
)


class Hierarchy(NamedTuple):
    """Joints in the file's order, a parent always before its children; offsets in float64, and as
    they are spelt."""

    names: list[str]
    parents: list[int]
    offsets: np.ndarray
    offset_texts: list[str]
    channels: list[tuple[str, ...]]
    layout: list[JointChannels]
    end_joints: list[int]
    end_offsets: np.ndarray
    end_labels: list[str]

    @property
    def columns(self) -> int:
        """Numbers a frame."""
        return sum(map(len, self.channels))

    def column_name(self, column: int) -> str:
        """Joint and channel that a column of the frames belongs to."""
        for name, channels in zip(self.names, self.channels, strict=True):
            if column < len(channels):
                return f"{name} {channels[column]}"
            column -= len(channels)
        return "no channel"


def parse_number(text: str) -> float | None:
    """A finite decimal number, or ``None`` if the text is not one."""
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if math.isfinite(value) else None


def number_hint(text: str) -> str:
    """What to try where ``text`` stands for a number and is none."""
    if "," in text or ";" in text:
        alone = parse_number(text.rstrip(",;")) is not None
        return "put blanks between the numbers" if alone else "write decimal points, not commas"
    if _JOINED.fullmatch(text):
        return "put a blank between the numbers that are joined"
    return ""


def keyword_and_value(text: str) -> tuple[str, str]:
    """The first word, in small letters, and what follows the blanks after it."""
    word, *rest = _BLANKS.split(text, maxsplit=1)
    return word.lower(), rest[0] if rest else ""


def reads_back(text: str) -> bool:
    """Whether a name or label, written on a line, is read as it was."""
    if text == "" or text != text.strip(_BLANK) or set(text) & set("{}\n"):
        return False
    return not any("\ud800" <= c <= "\udfff" for c in text)  # halves of characters


def parse_hierarchy(path: str | PathLike, text: str) -> Hierarchy:
    """Read everything above MOTION.

    **Raises:** :class:`~jaxmotion.io.MotionFileError` with the line for anything that does not
    follow the module's grammar.
    """
    parser = _Parser(path)
    for parser.line, statement in _statements(text):
        parser.statement(statement)
    parser.line = text.count("\n") + 1
    return parser.finished()


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Braces, and keywords with what belongs to them, each with the line it begins on."""
    held, begun = "", 0
    for number, line in enumerate(text.split("\n"), 1):
        for piece in _PIECE.findall(line):
            for part in _PART.findall(piece.strip(_BLANK)):
                if held and _KEYWORD.match(part):
                    yield begun, held
                    held = ""
                held, begun = (f"{held} {part}", begun) if held else (part, number)
                if not _wants_more(held):
                    yield begun, held
                    held = ""
    if held:
        yield begun, held


def _wants_more(statement: str) -> bool:
    """Whether what a statement lacks may stand on the next line."""
    keyword, value = keyword_and_value(statement)
    words = value.split()
    if keyword == "offset":
        return len(words) < 3
    if keyword == "channels":
        count = int(words[0]) if words and re.fullmatch("[0-6]", words[0]) else 0
        return not words or len(words) <= count
    return not words and keyword in ("joint", "root", "end")


class _Scope:
    """What stands between a pair of braces: joint ``joint``, or an end site of it."""

    def __init__(self, joint: int, is_end: bool, line: int):
        self.joint = joint
        self.is_end = is_end
        self.line = line
        self.offset: list[float] | None = None
        self.offset_text = ""
        self.channels: tuple[str, ...] | None = None


class _Parser:
    def __init__(self, path):
        self.path = path
        self.line = 1
        self.begun = False
        self.pending: _Scope | None = None
        self.open: list[_Scope] = []
        self.names: list[str] = []
        self.taken: dict[str, int] = {}
        self.renamed: list[str] = []
        self.parents: list[int] = []
        self.joints: list[_Scope] = []
        self.ends: list[_Scope] = []
        self.end_labels: list[str] = []

    def statement(self, text: str) -> None:
        keyword, value = keyword_and_value(text)
        if not self.begun:
            if text.lower() != "hierarchy":
                raise self.error(quoted(text), "HIERARCHY on the first line", "is this a BVH file?")
            self.begun = True
        elif text == "{":
            self.enter()
        elif self.pending is not None:
            raise self.error(quoted(text), f"{{ to open line {self.pending.line}")
        elif text == "}":
            self.leave()
        elif keyword in ("root", "joint"):
            self.joint(keyword, value)
        elif keyword == "end":
            self.end_site(text)
        elif keyword == "offset":
            self.offset(value)
        elif keyword == "channels":
            self.channels(value)
        else:
            raise self.error(
                quoted(text), "OFFSET, CHANNELS, JOINT, End Site, a brace, or MOTION at the end"
            )

    def enter(self) -> None:
        if self.pending is None:
            raise self.error("'{'", "ROOT, JOINT or End Site before it")
        self.open.append(self.pending)
        self.pending = None

    def leave(self) -> None:
        if not self.open:
            raise self.error("'}'", "no more of them than of '{'")
        scope = self.open.pop()
        if scope.offset is None:
            raise self.error("'}'", f"an OFFSET for what line {scope.line} opens")

    def joint(self, keyword: str, name: str) -> None:
        if not name:
            raise self.error(f"{keyword.upper()} with no name", "a name after it")
        if keyword == "root" and self.joints:
            raise self.error(
                f"a second root, {quoted(name)}", "one ROOT a file", "split the file in two"
            )
        if (keyword == "root") == bool(self.open) or (self.open and self.open[-1].is_end):
            raise self.error(f"{keyword.upper()} {quoted(name)}", "one ROOT, and JOINTs inside it")
        parent = self.open[-1].joint if self.open else -1
        self.pending = _Scope(len(self.joints), False, self.line)
        self.joints.append(self.pending)
        self.parents.append(parent)
        self.names.append(self.unique(name))

    def unique(self, name: str) -> str:
        if name not in self.taken:
            self.taken[name] = 1
            return name
        self.renamed.append(name)
        while True:
            self.taken[name] += 1
            numbered = f"{name}_{self.taken[name]}"
            if numbered not in self.taken:
                self.taken[numbered] = 1
                return numbered

    def end_site(self, label: str) -> None:
        if not self.open or self.open[-1].is_end:
            raise self.error(quoted(label), "an end site inside a joint")
        self.pending = _Scope(self.open[-1].joint, True, self.line)
        self.ends.append(self.pending)
        self.end_labels.append(label)

    def offset(self, value: str) -> None:
        numbers = [parse_number(part) for part in value.split()]
        if not self.open or self.open[-1].offset is not None:
            raise self.error(f"OFFSET {quoted(value)}", "one OFFSET inside each joint")
        known = [number for number in numbers if number is not None]
        if len(numbers) != 3 or len(known) != 3:
            hint = number_hint(value.split()[0]) if value else ""
            raise self.error(f"OFFSET {quoted(value)}", "three finite numbers", hint)
        self.open[-1].offset = known
        self.open[-1].offset_text = value

    def channels(self, value: str) -> None:
        if not self.open or self.open[-1].is_end or self.open[-1].channels is not None:
            raise self.error(f"CHANNELS {quoted(value)}", "one CHANNELS inside each joint")
        count, *names = value.split() or [""]
        if count != str(len(names)):
            raise self.error(
                f"CHANNELS {quoted(value)}, {len(names)} names", "a count and as many names"
            )
        try:
            parse_channels(names)
        except ValueError as trouble:
            raise self.error(
                str(trouble),
                "up to three of Xposition, Yposition, Zposition and three rotations such as "
                "Zrotation, Xrotation, Yrotation, no axis twice in a row",
            ) from None
        self.open[-1].channels = tuple(names)

    def finished(self) -> Hierarchy:
        if not self.begun:
            raise self.error("nothing before MOTION", "HIERARCHY", "is this a BVH file?")
        if self.pending or self.open:
            scope = self.pending or self.open[-1]
            raise self.error(
                "MOTION or the end of the file",
                f"braces that close what line {scope.line} opens ({len(self.open)} are open)",
                "the file may be cut off; export it again",
            )
        if not self.joints:
            raise self.error("no joint", "a ROOT")
        if self.renamed:
            shown = ", ".join(sorted(set(self.renamed))[:5])
            warnings.warn(
                f"{self.path}: {len(self.renamed)} joints repeat a name and were numbered: {shown}",
                MotionFileWarning,
                stacklevel=2,
            )
        channels = [joint.channels or () for joint in self.joints]
        return Hierarchy(
            self.names,
            self.parents,
            np.array([joint.offset for joint in self.joints], np.float64),
            [joint.offset_text for joint in self.joints],
            channels,
            [parse_channels(names) for names in channels],
            [end.joint for end in self.ends],
            np.array([end.offset for end in self.ends], np.float64).reshape(-1, 3),
            self.end_labels,
        )

    def error(self, found: str, expected: str, hint: str = "") -> MotionFileError:
        return MotionFileError(self.path, found, expected=expected, hint=hint, line=self.line)
