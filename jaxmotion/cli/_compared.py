"""What a report shows of clips beside each other: how much they jerk, and all of them in a player.

Pages of players are made where the clips are known, in any process, and are written by the report.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from jaxmotion import Motion


_PICKED = 3


@dataclass(frozen=True)
class Compared:
    """Clips of which the first is the input, the last the result. ``jerk``: of both, the mean over
    frames and joints, file unit a second³, None of clips too short for any; ``page``: HTML, "" for
    a report that is no page."""

    jerk: tuple[float | None, float | None]
    page: str


def compared(
    clips: "Mapping[str, Motion]", report: Path | None, title: str, **marks: Any
) -> Compared | None:
    """Clips by name, for a report, if there is one; ``title``: of their page; ``marks``: as
    :func:`jaxmotion.viz.player`."""
    if report is None:
        return None
    first, *_, last = [*clips.values()] * 2
    page = ""
    if is_page(report):
        from jaxmotion.viz import player

        page = player(clips, title=title, **differing(first, last), **marks).html
    return Compared((_jerk(first), _jerk(last)), page)


def differing(first: "Motion", last: "Motion") -> dict[str, Any]:
    """For a player curves of how joints of two clips differ, and the joints that differ most; none
    of clips of other joints or frames, or that look the same."""
    import numpy as np

    from jaxmotion import metrics

    names = first.skeleton.names
    if first.rotations.shape != last.rotations.shape or names != last.skeleton.names:
        return {}
    if not metrics.difference(first, last).frames_changed:
        return {}
    places = (metrics.world_positions(x)[:, : len(names)] for x in (first, last))
    distance = np.linalg.norm(np.subtract(*places), axis=-1)
    return shown(names, metrics.turn(first.rotations, last.rotations), distance)


def shown(
    names: "Sequence[str]", angle: "np.ndarray", distance: "np.ndarray", *, seen: bool = True
) -> dict[str, Any]:
    """Curves for a player, f[T, J] in radians and length units, and the joints that turn most, if
    that is ``seen``; joints of which nothing is known are NaN."""
    import numpy as np

    degrees = np.degrees(angle)
    most = np.nan_to_num(degrees).max(axis=0)
    order = np.argsort(-most, kind="stable")[:_PICKED]
    return {
        "curves": {"turned, °": degrees, "moved, length units": distance},
        "picked": [names[j] for j in order if seen and most[j] > 0],
    }


def is_page(report: Path | None) -> bool:
    """Whether it shows pictures."""
    return report is not None and report.suffix.lower() == ".html"


def _jerk(motion: "Motion") -> float | None:
    from jaxmotion.metrics import jerk

    found = jerk(motion)
    return float(found.mean()) if found.size else None
