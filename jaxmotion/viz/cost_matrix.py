"""The cost of pairing frames of two clips, and the path that was found through it."""

from typing import TYPE_CHECKING

import numpy as np

from jaxmotion._checks import instance_of, no_module
from jaxmotion._plain import printable
from jaxmotion._types import ArrayLike
from jaxmotion.timing import Alignment, MotionWarp, WarpPath
from jaxmotion.viz.colours import ORANGE, SIZES
from jaxmotion.viz.given import known_only

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LONGER, _LARGEST = 5.0, 7.0  # inches of a side


def plot_cost_matrix(
    cost: ArrayLike,
    path: WarpPath | Alignment | MotionWarp | None = None,
    *,
    source: str = "source",
    reference: str = "reference",
    label: str = "distance of the frames",
) -> "Figure":
    """Draw a cost matrix, dark where frames differ, and the path of a warp through it.

    **Arguments:** ``cost``: f[n, m], such as :func:`jaxmotion.timing.frame_distance` gives of a
    source and a reference; what is not finite is left white; ``path``: of
    :func:`jaxmotion.timing.dtw`, ``align`` or ``motion_warping`` (one warp for all channels) of the
    same clips, or None; ``source``, ``reference``: what to call the clips; ``label``: what the cost
    is, with its unit.
    **Returns:** a Matplotlib figure of its own (``figure.savefig("cost.png")``), outside pyplot;
    notebooks show it.
    **Raises:** ``ValueError`` for a cost that is no known matrix, a path that leaves it, a warp of
    each channel; ``ImportError`` without Matplotlib.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk, other = (jm.samples.load("walk").motion[k : k + 16] for k in (0, 4))
        >>> cost = jm.timing.frame_distance(walk, other)
        >>> figure = jm.viz.plot_cost_matrix(cost, jm.timing.dtw(cost=cost), label="radians²")
        >>> figure.axes[0].get_xlabel()
        'frame of reference'
    """
    from jaxmotion.viz.picture import Picture

    no_module("plot_cost_matrix: cost", cost)
    known_only("plot_cost_matrix", cost=cost, path=path)
    matrix = np.asarray(cost, np.float64)
    if matrix.ndim != 2 or 0 in matrix.shape:
        raise ValueError(f"plot_cost_matrix: cost has shape {matrix.shape}; expected (n, m)")
    pairs = _pairs(path, matrix.shape)
    n, m = matrix.shape
    scale = _LONGER / max(n, m)
    size = max(scale * m, _LONGER / 2) + 1.9, max(scale * n, _LONGER / 2) + 0.7
    figure = Picture(figsize=(min(size[0], _LARGEST), size[1]), layout="constrained")
    axes = figure.add_subplot()
    shown = np.where(np.isfinite(matrix), matrix, np.nan)
    image = axes.imshow(shown, cmap=SIZES, origin="lower", aspect="auto", interpolation="nearest")
    if len(pairs):
        axes.plot(pairs[:, 1], pairs[:, 0], "-", color="white", lw=4)
        axes.plot(pairs[:, 1], pairs[:, 0], ".-", color=ORANGE, lw=2, ms=4)
    axes.set_xlim(-0.5, m - 0.5)
    axes.set_ylim(-0.5, n - 0.5)
    axes.set_xlabel(f"frame of {printable(reference)}", parse_math=False)
    axes.set_ylabel(f"frame of {printable(source)}", parse_math=False)
    bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=30)
    bar.set_label(printable(label), parse_math=False)
    return figure


def _pairs(path: WarpPath | Alignment | MotionWarp | None, shape: tuple[int, ...]) -> np.ndarray:
    """i[P, 2] frames (of the source, of the reference) of the path."""
    if path is None:
        return np.zeros((0, 2), int)
    kinds = "a WarpPath, Alignment or MotionWarp (jaxmotion.timing makes them)"
    if not isinstance(path, (WarpPath, Alignment, MotionWarp)):
        instance_of("plot_cost_matrix: path", path, WarpPath, kinds)
    if isinstance(path, MotionWarp):
        if np.ndim(path.runs) != 1:
            raise ValueError(
                "plot_cost_matrix: path has a warp for each channel; expected one that is shared"
            )
        found = np.stack([np.asarray(path.source_index), np.asarray(path.reference_index)], 1)
    elif np.ndim(path.length):
        raise ValueError("plot_cost_matrix: path is a batch of paths; expected one")
    else:
        found = np.asarray(path.path)[: int(path.length)]
    if len(found) and np.any(found.max(axis=0) >= np.array(shape)):
        raise ValueError(
            f"plot_cost_matrix: path reaches the frames {tuple(found.max(axis=0).tolist())}; the "
            f"cost is of {shape[0]} and {shape[1]} frames"
        )
    return found
