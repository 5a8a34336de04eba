"""What a check of a clip has found, one :class:`Problem` each, together :class:`Findings`."""

from collections.abc import Iterator
from dataclasses import dataclass

from jaxmotion._plain import printable
from jaxmotion._summary import called, line

NOTES = ("flip", "gimbal")


@dataclass(frozen=True)
class Problem:
    """One finding about a clip.

    **Fields:** ``kind``: one of the table in :mod:`jaxmotion.metrics.checks`; ``message``: a
    sentence for people; ``frame``, ``last_frame``: the first and the last it is about, from 0, None
    for the whole clip; ``joint``: by name, None for all.
    """

    kind: str
    message: str
    frame: int | None = None
    last_frame: int | None = None
    joint: str | None = None

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield self.kind
        if self.frame is not None:
            alone = self.last_frame in (None, self.frame)
            yield f"frame {self.frame}" if alone else f"frames {self.frame} to {self.last_frame}"
        if self.joint is not None:
            yield called([self.joint])
        yield printable(self.message)

    @property
    def serious(self) -> bool:
        """Whether it is more than a note."""
        return self.kind not in NOTES


class Findings(tuple[Problem, ...]):
    """A tuple of :class:`Problem`, empty, and so false, when all is well; printed, a line a kind.

    **Example:**

        >>> import jaxmotion as jm
        >>> motion = jm.samples.load("walk").motion
        >>> found = jm.check(motion.replace(frame_time=25.0))
        >>> found.kinds, found[0].joint
        (('rate',), None)
        >>> print(found)
        rate: the frame time is 25 seconds; is it a rate, ... (--fps, or load(fps=), sets it)
    """

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of finding there are, each once."""
        return tuple(dict.fromkeys(problem.kind for problem in self))

    def __str__(self) -> str:
        if not self:
            return "nothing found"
        return "\n".join(map(self._line, self.kinds))

    __repr__ = __str__

    def _line(self, kind: str) -> str:
        first, *others = (problem for problem in self if problem.kind == kind)
        frame = None if first.frame is None else f"frame {first.frame}"
        place = ", ".join(part for part in (first.joint, frame) if part)
        more = ""
        if others:
            joints = len({problem.joint for problem in self if problem.kind == kind})
            at = f", in {joints} joints in all" if joints > 1 else ""
            more = f"; {len(others)} more{at}"
        return f"{kind}: {place and f'{place}: '}{first.message}{more}"
