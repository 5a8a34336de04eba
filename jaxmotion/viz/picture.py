"""A Matplotlib figure that a notebook shows, without pyplot and whatever else it has imported."""

from io import BytesIO
from typing import TYPE_CHECKING

from jaxmotion._lazy import extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure
else:
    Figure = extra("matplotlib.figure", "viz", "drawing", package="matplotlib").Figure


class Picture(Figure):
    """A figure of its own, which a notebook draws where it is the last value of a cell."""

    def _repr_png_(self) -> bytes:
        file = BytesIO()
        self.savefig(file, format="png")
        return file.getvalue()
