"""Clips to look at a clip beside: those of other files that do most nearly the same.

A process keeps what it learns of the files for all that it works on: small copies to compare, the
clips read last and what is known of them, which are most alike, and what is usual in each.
"""

import warnings
from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from jaxmotion._plain import printable, some
from jaxmotion.cli._files import real
from jaxmotion.cli._options import Reading
from jaxmotion.cli._work import read

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion.cleaning import Levels
    from jaxmotion.cleaning.levels import Evidence

_MANY, _NEIGHBOURS = 8, 8
_CLIPS, _COPIES = 32, 2048  # that are kept


@dataclass(frozen=True)
class Beside:
    """A clip's context: its files, most alike first, and what is usual in each; what is known of
    the clip beside them; of the other files how many have ``other`` joints, and are
    ``unreadable``."""

    paths: tuple[Path, ...]
    levels: "tuple[Levels, ...]"
    evidence: "Evidence"
    other: int
    unreadable: int

    def __str__(self) -> str:
        """What is to be said of files that are left out; "" for none."""
        words = {"of other joints": self.other, "that cannot be read": self.unreadable}
        counts = [f"{some(n, 'clip')} {what}" for what, n in words.items() if n]
        return f"left out of the context: {', '.join(counts)}" if counts else ""


class Shelf:
    """Files that serve as each other's context."""

    def __init__(self, paths: tuple[str, ...], reading: Reading):
        self._paths = {real(Path(path)): Path(path) for path in paths}
        self._levels: dict[Path, Levels] = {}
        self._evidence: OrderedDict[Path, Evidence] = OrderedDict()
        self._alike: dict[Path, tuple[Path, ...]] = {}
        self._clip = lru_cache(_CLIPS)(lambda place: _read(self._paths[place], reading))
        self._copy = lru_cache(_COPIES)(self._copied)

    @cached_property
    def _names(self) -> dict[Path, tuple[str, ...] | None]:
        """The joints of every file, None where it cannot be read."""
        names: dict[Path, tuple[str, ...] | None] = {}
        for place in self._paths:
            copy = self._copy(place)
            names[place] = None if copy is None else copy.skeleton.names
        return names

    def beside(self, path: Path, motion: "Motion") -> Beside:
        """The context of a file's clip, without the file itself."""
        place = real(path)
        others = [names for other, names in self._names.items() if other != place]
        unreadable = others.count(None)
        other = len(others) - unreadable - others.count(motion.skeleton.names)
        alike = self._most_alike(place, motion)
        return Beside(
            tuple(self._paths[near] for near in alike),
            tuple(self._usual(near) for near in alike),
            self._examined(place, motion),
            other,
            unreadable,
        )

    def _most_alike(self, place: Path, motion: "Motion") -> tuple[Path, ...]:
        from jaxmotion.cleaning import most_alike
        from jaxmotion.cleaning.digression import WORD
        from jaxmotion.cleaning.similarity import light

        if place not in self._alike:
            joints = motion.skeleton.names
            matching = [x for x, names in self._names.items() if x != place and names == joints]
            copies = {x: copy for x in matching if (copy := self._copy(x)) is not None}
            # A clip too short for a word shows nothing.
            copies = {x: copy for x, copy in copies.items() if copy.num_frames >= WORD}
            found = most_alike(light(motion), list(copies.values()), _MANY) if copies else ()
            others = list(copies)
            self._alike[place] = tuple(others[number] for number in found)
        return self._alike[place]

    def _usual(self, place: Path) -> "Levels":
        from jaxmotion.cleaning.levels import levels_of

        if place not in self._levels:
            self._levels[place] = levels_of(self._examined(place, self._clip(place)))
        return self._levels[place]

    def _examined(self, place: Path, motion: "Motion") -> "Evidence":
        """What is known of a file's clip beside its context; of an input too, once."""
        from jaxmotion.cleaning.levels import examined

        if place not in self._evidence:
            around = [self._clip(near) for near in self._most_alike(place, motion)]
            self._evidence[place] = examined("repair", motion, around, _NEIGHBOURS)
            if len(self._evidence) > _CLIPS:
                self._evidence.popitem(last=False)
        return self._evidence[place]

    def _copied(self, place: Path) -> "Motion | None":
        from jaxmotion.cleaning.similarity import light

        try:
            return light(self._clip(place))
        except Exception:  # it is told of where it is an input
            return None


@lru_cache(1)
def shelf(paths: tuple[str, ...], reading: Reading) -> Shelf:
    """The process's shelf of these files."""
    return Shelf(paths, reading)


def _read(path: Path, reading: Reading) -> "Motion":
    """A clip, whose oddities are told of where it is an input."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return read(path, reading)


def named(paths: tuple[Path, ...]) -> list[str]:
    """As they are shown."""
    return [printable(path) for path in paths]
