"""Acclaim skeleton files (.asf), in: text → :class:`~jaxmotion.Skeleton`.

Every bone is a joint that sits where its parent's bone ends:

    offset_j = length_p · direction_p        children of the root: 0; the root: its ``position``

so a bone without children ends in an end site. Directions are taken as written (unit or not), in
the skeleton's base pose, in which every joint's frame is parallel to the world.

``Skeleton.asf`` keeps each bone's axis (degrees), direction, length and limits (degrees; radians
are converted), for the root its ``orientation``; ``Skeleton.channels`` the ``dof`` names (for the
root ``order``) as spelt; ``Skeleton.length_unit`` the unit's ``length`` factor, never applied.
Masses, documentation and the name are not kept. Commas and parentheses count as blanks, ``#``
starts a comment, keywords are read in any case, unknown ones are skipped. Bones whose names end in
``__link`` or ``__end`` are what :mod:`jaxmotion.io.asf_write` adds where joints do not sit at the
end of their parent's bone; they are folded back.

Source: Acclaim, "Skeleton File Definition V1.10" (1995).
"""

import math
import re
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import NoReturn

import numpy as np

from jaxmotion._asf_bone import AsfBone
from jaxmotion._plain import quoted
from jaxmotion.io.errors import MotionFileError, read_file
from jaxmotion.io.text import decoded, plain_bytes
from jaxmotion.skeleton import Skeleton

LINK = "__link"
END = "__end"
DOFS = ("tx", "ty", "tz", "rx", "ry", "rz")
ROOT_ORDER = ("TX", "TY", "TZ", "RX", "RY", "RZ")

Line = tuple[int, list[str]]


@dataclass
class _Bone:
    name: str
    line: int
    axis: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis_order: str = "XYZ"
    direction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    length: float = 0.0
    dofs: tuple[str, ...] = ()
    limits: tuple[tuple[float, float], ...] = ()
    parent: str = ""
    children: list[str] = field(default_factory=list)
    offset: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @property
    def tip(self) -> np.ndarray:
        return self.length * np.array(self.direction)


def rotation_order(dofs: tuple[str, ...]) -> str:
    """Extrinsic Euler order of the rotations among ``dofs``: R turns about them as listed.

    Absent axes are completed so that, with one or two dofs, the middle angle is absent: then the
    angles present are unique.
    """
    letters = "".join(name[1].lower() for name in dofs if name[0] in "rR")
    others = "".join(axis for axis in "xyz" if axis not in letters)
    if len(letters) == 2:
        return letters[0] + others + letters[1]
    return letters + others if len(letters) < 3 else letters


def read_asf(
    path: str | PathLike, encoding: str | None = None, angle: str | None = None
) -> tuple[Skeleton, str]:
    """Skeleton of an ASF file (f64, NumPy arrays) and the file's unit of angles, "deg", "rad" or ""
    if it does not say; then degrees are taken.

    **Arguments:** ``encoding``: of the names, by default told from their bytes; ``angle``: "deg" or
    "rad", to overrule the file's unit.
    **Raises:** :class:`MotionFileError`; ``OSError`` if the file cannot be opened.
    """
    with np.errstate(all="ignore"):
        return _Reader(Path(path), encoding, angle).skeleton()


class _Reader:
    def __init__(self, path: Path, encoding: str | None, angle: str | None):
        self.path = path
        self.angle = angle
        data = plain_bytes(path, read_file(path))
        text, self.encoding = decoded(path, data, encoding)
        self.sections = self._sections(text)

    def fail(self, found: str, expected: str, line: int | None = None, hint: str = "") -> NoReturn:
        raise MotionFileError(self.path, found, expected=expected, line=line, hint=hint)

    def _sections(self, text: str) -> dict[str, list[Line]]:
        sections: dict[str, list[Line]] = {}
        rows: list[Line] = []
        for number, row in enumerate(re.split(r"\r\n|\n|\r", text), 1):
            tokens = re.findall(r"\S+", re.sub(r"#.*|[,()]", " ", row), re.ASCII)
            if tokens and tokens[0][0] == ":":
                rows = sections.setdefault(tokens[0].lower(), [])
                tokens = tokens[1:]
            if tokens:
                rows.append((number, tokens))
        if ":root" not in sections and ":bonedata" not in sections:
            self.fail(
                f"{quoted(text[:40])} and no section ':root' or ':bonedata'",
                "an Acclaim skeleton",
                hint="check that this is the .asf file",
            )
        return sections

    def skeleton(self) -> tuple[Skeleton, str]:
        unit, length_unit = self._units()
        self.to_degrees = 180.0 / math.pi if (self.angle or unit) == "rad" else 1.0
        bones = {"root": self._root()}
        for bone in self._bonedata():
            if bone.name in bones:
                self.fail(f"a second bone {quoted(bone.name)}", "unique names", bone.line)
            bones[bone.name] = bone
        self._hierarchy(bones)
        ends = self._fold(bones)
        order = self._topological(bones)
        index = {name: j for j, name in enumerate(order)}
        chosen = [bones[name] for name in order]
        offsets = np.array([bone.offset for bone in chosen])
        sites = [(index[name], tip) for name in order for tip in ends[name]]
        end_offsets = np.array([tip for _, tip in sites]).reshape(-1, 3)
        if not (np.isfinite(offsets).all() and np.isfinite(end_offsets).all()):
            self.fail("bones too long to add up", "finite offsets")
        skeleton = Skeleton(
            order,
            [index.get(bone.parent, -1) for bone in chosen],
            offsets,
            end_joints=[j for j, _ in sites],
            end_offsets=end_offsets,
            channels=[bone.dofs for bone in chosen],
            asf=[
                AsfBone(bone.axis, bone.axis_order, bone.direction, bone.length, bone.limits)
                for bone in chosen
            ],
            length_unit=length_unit,
            encoding=self.encoding,
        )
        return skeleton, unit

    def _units(self) -> tuple[str, float]:
        unit, length = "", 1.0
        for line, (key, *values) in self.sections.get(":units", []):
            if key.lower() == "angle":
                unit = values[0].lower()[:3] if values else ""
                if unit not in ("deg", "rad"):
                    self.fail(f"angle {quoted(' '.join(values))}", "'deg' or 'rad'", line)
            elif key.lower() == "length":
                (length,) = self._numbers(values, 1, line)
        return unit, length

    def _root(self) -> _Bone:
        root = _Bone("root", 0, dofs=ROOT_ORDER)
        for line, (key, *values) in self.sections.get(":root", []):
            match key.lower():
                case "order":
                    root.dofs = self._dofs(values, line)
                case "axis":
                    root.axis_order = self._axis_order(values, line)
                case "position":
                    root.offset = np.array(self._numbers(values, 3, line))
                case "orientation":
                    root.axis = self._angles(values, line)
        return root

    def _bonedata(self) -> list[_Bone]:
        bones, block, start = [], None, 0
        for line, tokens in self.sections.get(":bonedata", []):
            word = tokens[0].lower()
            if word == "begin":
                if block is not None:
                    self.fail("'begin'", f"the 'end' of the bone begun on line {start}", line)
                block, start = [], line
            elif block is None:
                self.fail(quoted(" ".join(tokens)), "'begin'", line)
            elif word == "end":
                bones.append(self._bone(block, start))
                block = None
            else:
                block.append((line, tokens))
        if block is not None:
            self.fail(
                "the end of the section", "the bone's 'end'", start, hint="the file is cut short"
            )
        return bones

    def _bone(self, block: list[Line], start: int) -> _Bone:
        bone = _Bone("", start)
        limits: list[str] = []
        limits_line, in_limits = start, False
        for line, (key, *values) in block:
            match key.lower():
                case "name":
                    if len(values) != 1:
                        self.fail(f"the name {quoted(' '.join(values))}", "one word", line)
                    if bone.name:
                        self.fail("a second 'name'", f"the 'end' of {quoted(bone.name)}", line)
                    bone.name = values[0]
                case "direction":
                    x, y, z = self._numbers(values, 3, line)
                    bone.direction = (x, y, z)
                case "length":
                    (bone.length,) = self._numbers(values, 1, line)
                case "axis":
                    bone.axis = self._angles(values[:3], line)
                    bone.axis_order = self._axis_order(values[3:] or ["XYZ"], line)
                case "dof":
                    bone.dofs = self._dofs(values, line)
                case "limits":
                    limits, limits_line = list(values), line
                case _ if in_limits and _is_number(key):
                    limits += [key, *values]
                    continue
            in_limits = key.lower() == "limits"
        if not bone.name or bone.name.lower() == "root":
            self.fail(f"a bone called {quoted(bone.name)}", "a 'name' of its own", start)
        if limits and len(limits) != 2 * len(bone.dofs):
            self.fail(
                f"{len(limits)} limits", f"a pair for each of the dofs {bone.dofs}", limits_line
            )
        values = self._numbers(limits, len(limits), limits_line, bounded=False)
        scales = [self.to_degrees if name[0] in "rR" else 1.0 for name in bone.dofs]
        pairs = zip(values[::2], values[1::2], scales, strict=False)
        bone.limits = tuple((low * scale, high * scale) for low, high, scale in pairs)
        return bone

    def _hierarchy(self, bones: dict[str, _Bone]) -> None:
        folded = {name.lower(): name for name in bones}
        for line, tokens in self.sections.get(":hierarchy", []):
            if len(tokens) == 1 and tokens[0].lower() in ("begin", "end"):
                continue
            names = [t if t in bones else folded.get(t.lower(), "") for t in tokens]
            if "" in names:
                unknown = quoted(tokens[names.index("")])
                self.fail(f"a bone {unknown}", "a name from ':bonedata' or 'root'", line)
            for name in names[1:]:
                if name == "root" or bones[name].parent:
                    self.fail(f"a second parent for {quoted(name)}", "one parent a bone", line)
                bones[name].parent = names[0]
                bones[names[0]].children.append(name)
        reached = ["root"]
        for name in reached:
            reached += bones[name].children
        lost = sorted(set(bones) - set(reached), key=lambda name: bones[name].line)
        if lost:
            self.fail(
                f"bone {quoted(lost[0])} hanging from nothing",
                "a parent in ':hierarchy'",
                bones[lost[0]].line,
            )

    def _fold(self, bones: dict[str, _Bone]) -> dict[str, list[np.ndarray]]:
        """Place the joints and take out what asf_write added; end sites by joint."""
        ends: dict[str, list[np.ndarray]] = {name: [] for name in bones}
        for name, bone in list(bones.items()):
            if name != "root" and not bone.children and bone.length:
                ends[name].append(bone.tip)
            for child in bone.children:
                bones[child].offset = bone.tip
        for name, bone in list(bones.items()):
            if bone.dofs or name == "root":
                continue
            above = bones[bone.parent]
            if name.endswith(LINK) and bone.children == [name.removesuffix(LINK)]:
                below = bones[bone.children[0]]
                below.parent, below.offset = bone.parent, bone.offset + bone.tip
                above.children[above.children.index(name)] = below.name
                del bones[name]
            elif re.fullmatch(rf".+{END}\d*", name) and not bone.children:
                ends[bone.parent].append(bone.offset + bone.tip)
                above.children.remove(name)
                del bones[name]
        return ends

    def _topological(self, bones: dict[str, _Bone]) -> list[str]:
        """Names in the order of the file if parents come first there, else depth first."""
        place = {name: j for j, name in enumerate(bones)}
        if all(place.get(bone.parent, -1) < place[bone.name] for bone in bones.values()):
            return list(bones)
        order, waiting = [], ["root"]
        while waiting:
            order.append(waiting.pop())
            waiting += reversed(bones[order[-1]].children)
        return order

    def _dofs(self, values: list[str], line: int) -> tuple[str, ...]:
        names = [value.lower() for value in values]
        if "l" in names:
            self.fail(
                "the dof 'l', a bone that changes its length",
                f"dofs among {', '.join(DOFS)}",
                line,
                hint="bake the lengths into translations (tx ty tz) first",
            )
        rotating = [name for name in names if name[0] == "r"]
        moves = [name for name in names if name[0] == "t"]
        proper_euler = len(rotating) == 3 and rotating[0] == rotating[2] != rotating[1]
        distinct = len(set(rotating)) == len(rotating) or proper_euler
        if set(names) - set(DOFS) or not distinct or len(set(moves)) != len(moves):
            self.fail(quoted(" ".join(values)), f"dofs among {', '.join(DOFS)}, each once", line)
        return tuple(values)

    def _axis_order(self, values: list[str], line: int) -> str:
        if len(values) != 1 or sorted(values[0].upper()) != ["X", "Y", "Z"]:
            self.fail(quoted(" ".join(values)), "an order of axes such as 'XYZ'", line)
        return values[0].upper()

    def _angles(self, values: list[str], line: int) -> tuple[float, float, float]:
        x, y, z = self._numbers(values, 3, line)
        return (x * self.to_degrees, y * self.to_degrees, z * self.to_degrees)

    def _numbers(self, values: list[str], count: int, line: int, bounded: bool = True):
        if len(values) < count or not all(_is_number(value) for value in values[:count]):
            self.fail(quoted(" ".join(values)), f"{count} numbers", line)
        numbers = tuple(float(value) for value in values[:count])
        if any(math.isnan(x) or (bounded and math.isinf(x)) for x in numbers):
            self.fail(quoted(" ".join(values)), "finite numbers", line)
        return numbers


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text
