"""Pictures in a report: drawn where the clip is known, shown by the page."""

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jaxmotion._plain import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jaxmotion.cleaning import DetectedErrors, Repaired

_RUNS = 12
_DPI = 90


@dataclass(frozen=True)
class Drawing:
    """A picture as PNG, and what it shows; without one, why there is none."""

    title: str
    png: bytes = b""


def of_errors(errors: "DetectedErrors") -> tuple[Drawing, ...]:
    """The map of a clip's errors."""
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        return (Drawing("pictures need Matplotlib: pip install 'jaxmotion[viz]'"),)
    from jaxmotion.viz import plot_digression

    return (_drawn("how far joints digress, errors outlined", plot_digression(errors)),)


def of_repair(repaired: "Repaired") -> tuple[Drawing, ...]:
    """The map, and curves of the runs that were changed most, in order."""
    if repaired.errors is None:
        return ()
    first = of_errors(repaired.errors)
    if not first[0].png:
        return first
    from jaxmotion.viz import plot_repair

    runs = repaired.runs
    most = sorted(range(len(runs)), key=lambda k: -runs[k].change)[:_RUNS]
    titles = {k: f"frames {runs[k].start} to {runs[k].stop - 1}, before and after" for k in most}
    curves = [_drawn(titles[k], plot_repair(repaired, run=k)) for k in sorted(most)]
    return (*first, *curves)


def shown(drawings: Sequence[Drawing]) -> str:
    """As HTML."""
    return "\n".join(map(_figure, drawings))


def _figure(drawing: Drawing) -> str:
    title = html.escape(printable(drawing.title))
    if not drawing.png:
        return f"<p>{title}</p>"
    data = base64.b64encode(drawing.png).decode("ascii")
    return f'<p><img alt="{title}" title="{title}" src="data:image/png;base64,{data}"></p>'


def _drawn(title: str, figure: "Figure") -> Drawing:
    from io import BytesIO

    file = BytesIO()
    figure.savefig(file, format="png", dpi=_DPI)
    return Drawing(title, file.getvalue())
