"""What a report shows of clips beside each other: how much they jerk, and all of them in a player.

Pages of players are made where the clips are known, in any process, and are written by the report.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxmotion import Motion


@dataclass(frozen=True)
class Compared:
    """Clips of which the first is the input, the last the result. ``jerk``: of both, the mean over
    frames and joints, file unit a second³, None of clips too short for any; ``page``: HTML, "" for
    a report that is no page."""

    jerk: tuple[float | None, float | None]
    page: str


def compared(clips: "Mapping[str, Motion]", report: Path | None, **marks: Any) -> Compared | None:
    """Clips by name, for a report, if there is one; ``marks``: as :func:`jaxmotion.viz.player`."""
    if report is None:
        return None
    every = list(clips.values())
    page = ""
    if is_page(report):
        from jaxmotion.viz import player

        page = player(clips, **marks).html
    return Compared((_jerk(every[0]), _jerk(every[-1])), page)


def is_page(report: Path | None) -> bool:
    """Whether it shows pictures."""
    return report is not None and report.suffix.lower() == ".html"


def _jerk(motion: "Motion") -> float | None:
    from jaxmotion.metrics import jerk

    found = jerk(motion)
    return float(found.mean()) if found.size else None
