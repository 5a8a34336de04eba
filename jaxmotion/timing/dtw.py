"""Dynamic time warping: the cheapest monotone pairing of the frames of two clips.

    cost = min over paths   Σ_t weight_t · D[i_t, j_t],      (i_0, j_0) = (0, 0)

D: distance of frame i of x from frame j of y ``(n, m)``; a path moves by the steps of a *step
pattern* (:mod:`jaxmotion.timing.step_patterns`) and ends at (n − 1, m − 1), or with an open end at
(n − 1, j) for the best j. Cost O(n m) time; a byte per cell when the path is used, O(n) otherwise
(what is not used is dropped under ``jax.jit``).

Sources: Sakoe & Chiba 1978; Aristidou et al. 2018, appendix (``step_pattern="slope3"``: boundary,
monotone, continuous, at most 3 steps in one direction, open end, shortest match), solved exactly
with seven states per cell instead of greedily. An open end is the one of least *average* cost,
since the least sum prefers short matches.

Derivatives: the path is a discrete choice and passes none; the cost passes the derivative of the
cells it selected, ∂cost/∂D[i, j] = how often (i, j) is counted (over the normaliser). Second
derivatives in D are zero. Of tied paths the first in the pattern's order is taken.

Sharp bits: every shape of clips is compiled for once, and padded clips
(:mod:`jaxmotion.frames.padding`) let one compilation serve many lengths; a metric of one's own is
known again only if it is the same function object.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxmotion._checks import one_of, static
from jaxmotion._portable import Portable
from jaxmotion._types import ArrayLike, Metric, ScalarLike
from jaxmotion.frames.count import frame_mask
from jaxmotion.motion import Motion
from jaxmotion.timing.accumulate import accumulator, choice_radix
from jaxmotion.timing.frame_distance import compared, counted_pair, last_frames, local_cost
from jaxmotion.timing.step_patterns import StepPattern, step_pattern_named


class WarpPath(Portable):
    """The pairing found: cell ``path[t] = (frame of x, frame of y)`` for ``t < length``.

    **Fields:** ``cost``: f[], ∞ where no path satisfies the constraints; ``path``: i32[n + m − 1,
    2], whose entries from ``length`` on repeat the last cell; ``length``: i32[], 0 where there is
    no path.
    """

    cost: Float[Array, ""]
    path: Int[Array, "most_cells 2"]
    length: Int[Array, ""]

    @property
    def mask(self) -> Bool[Array, "... most_cells"]:
        """Which entries of ``path`` belong to it."""
        return frame_mask(self.length, self.path.shape[-2])


@static("window", "open_end", "min_matched")
def dtw(
    x: ArrayLike | Motion | None = None,
    y: ArrayLike | Motion | None = None,
    *,
    cost: ArrayLike | None = None,
    metric: Metric | None = None,
    step_pattern: str = "symmetric",
    window: int | None = None,
    open_end: bool | str = False,
    min_matched: int = 1,
    normalize: str | None = None,
    x_length: ScalarLike | None = None,
    y_length: ScalarLike | None = None,
) -> WarpPath:
    """Warp x onto y. One pair of clips; ``jax.vmap`` makes many, laid out for speed.

    O(n m). The path passes no derivative; the cost passes that of the cells it selected. Source:
    Sakoe & Chiba 1978; Aristidou et al. 2018, appendix.

    **Arguments:**

    - ``x``: features f[n, f], or local rotations f[n, J, 4] with ``metric="pose"``, or a motion.
    - ``y``: features f[m, f] or rotations f[m, J, 4], or a motion of the same joints.
    - ``cost``: f[n, m], a cost matrix instead of x and y.
    - ``metric``: distance of two frames; see :func:`frame_distance`. By default "pose" of motions,
      whose rotations are compared, and "euclidean" of arrays.
    - ``step_pattern``: "symmetric", "symmetric2", "asymmetric", "slope1", "slope2" or "slope3"
      (:mod:`jaxmotion.timing.step_patterns`).
    - ``window``: radius in frames of a Sakoe-Chiba band; with clips of different length the band is
      widened by their difference on the side of the longer one.
    - ``open_end``: True ends x at its last frame and y wherever it fits best; "either" lets
      whichever clip is exhausted first end the path.
    - ``min_matched``: with an open end, fewest frames to match of the clip left open; at
      most those of y, with "either" those of the longer clip (the shorter is then not left open).
    - ``normalize``: what the result's cost reports and what the open end minimises: "sum" along the
      path (default), "mean" over its cells (default with an open end) or "frames", the sum over the
      number of matched frames of both clips.
    - ``x_length``, ``y_length``: frames of x and y that count when they are padded
      (:func:`pad_to_bucket`); may be traced.

    **Returns:** :class:`WarpPath` with room for n + m − 1 cells.
    **Raises:** ``ValueError`` for bad shapes or lengths, unknown names, a ``window`` or
    ``min_matched`` out of range, or clips the pattern cannot join; at run time for traced lengths
    that are not those of frames there are.
    """
    pattern = step_pattern_named(step_pattern)
    x, y, metric = compared("dtw", x, y, metric, "euclidean")
    (x, y, cost), n, m = counted_pair("dtw", x, y, cost, x_length, y_length)  # type: ignore
    return _dtw(x, y, cost, n, m, metric, pattern, window, open_end, min_matched, normalize)


@eqx.filter_jit
def _dtw(
    x: Array | None,
    y: Array | None,
    cost: Array | None,
    x_length: Array | None,
    y_length: Array | None,
    metric: Metric,
    pattern: StepPattern,
    window: int | None,
    open_end: bool | str,
    min_matched: int,
    normalize: str | None,
) -> WarpPath:
    d = local_cost(x, y, cost, metric)
    n, m = d.shape
    _check_options(
        open_end, min_matched, normalize, window, max(n, m) if open_end == "either" else m
    )
    normalize = normalize or ("mean" if open_end else "sum")
    ragged = x_length is not None or y_length is not None
    if not (ragged or open_end or pattern.reaches(n, m)):
        raise ValueError(f"step_pattern={pattern.name!r} has no path over a cost of shape {(n, m)}")
    last_x, last_y = last_frames(d, x_length, y_length)

    fixed = lax.stop_gradient(d)
    if window is not None:
        fixed = jnp.where(_band(n, m, last_x, last_y, window), fixed, jnp.inf)
    accumulate = accumulator(
        pattern, ragged=ragged, columns=open_end == "either", count=normalize == "mean"
    )
    ends = accumulate(fixed[None], last_x[None], last_y[None])
    ends = jax.tree.map(lambda e: e[0], ends)
    total, size, end = _choose_end(ends, last_x, last_y, open_end, min_matched, normalize)
    path, weights, length = _backtrack(pattern, ends.choices, end, n + m - 1)
    found = jnp.isfinite(total)
    length = jnp.where(found, length, 0)
    weights = jnp.where(found, weights, 0).astype(d.dtype)
    return WarpPath(_selected_cost(d, total, path, weights) / size, path, length)


def _check_options(open_end, min_matched, normalize, window, longest):
    one_of("open_end", open_end, (False, True, "either"))
    one_of("normalize", normalize, (None, "sum", "mean", "frames"))
    if window is not None and window < 0:
        raise ValueError(f"window={window}; want a radius in frames, 0 or more")
    if not 1 <= min_matched <= longest:
        raise ValueError(f"dtw: min_matched={min_matched}; want 1 ... {longest}")
    if min_matched > 1 and not open_end:
        raise ValueError(f"dtw: min_matched={min_matched} is of an open end; give open_end= too")


def _band(n, m, last_x, last_y, radius) -> Array:
    """Cells within ``radius`` of the diagonals that join the corners."""
    ahead = jnp.arange(m, dtype=jnp.int32)[None, :] - jnp.arange(n, dtype=jnp.int32)[:, None]
    longer = last_y - last_x
    return (ahead >= jnp.minimum(longer, 0) - radius) & (ahead <= jnp.maximum(longer, 0) + radius)


def _choose_end(ends, last_x, last_y, open_end, min_matched, normalize):
    """Sum of the chosen path, what to divide it by, and its last cell (i, j)."""
    sides = [(ends.row_cost, ends.row_cells, last_x, last_y)]
    if open_end == "either":
        sides.append((ends.column_cost, ends.column_cells, last_y, last_x))
    totals, sizes, fits = [], [], []
    for total, cells, used_up, open_last in sides:
        frame = jnp.arange(total.shape[0], dtype=last_x.dtype)
        fit = (frame + 1 >= min_matched) & (frame <= open_last)
        fits.append(fit if open_end else frame == open_last)
        totals.append(total)
        counted = {"sum": jnp.ones_like(frame), "frames": used_up + frame + 2, "mean": cells}
        sizes.append(counted[normalize].astype(total.dtype))
    total, size, fit = map(jnp.concatenate, (totals, sizes, fits))
    chosen = lax.argmin(jnp.where(fit, total / size, jnp.inf), 0, index_dtype=last_x.dtype)
    total = jnp.where(fit[chosen], total[chosen], jnp.inf)
    frames_y = ends.row_cost.shape[0]
    on_row = chosen < frames_y
    i, j = jnp.where(on_row, last_x, chosen - frames_y), jnp.where(on_row, chosen, last_y)
    return total, size[chosen], (i, j)


def _backtrack(pattern: StepPattern, choices, end, most_cells):
    """Follow the packed choices ``(strips, k, h)`` from the end to before (0, 0)."""
    _, diagonals, h = choices.shape
    most = max(len(pool) for pool in pattern.pools)
    filled = [s for pool in pattern.pools for s in (*pool, *[pool[0]] * (most - len(pool)))]
    moves = [pattern.moves[s] for s in filled]
    di, dj, pools = (jnp.asarray(column, jnp.int32) for column in zip(*moves, strict=True))
    radix = jnp.asarray(choice_radix(pattern), jnp.int32)
    sizes = jnp.asarray([len(pool) for pool in pattern.pools], jnp.int32)
    packed = choices.reshape(-1)

    def step(cell, _):
        i, j, pool = cell
        on_path = (i >= 0) & (j >= 0)
        strip, row = i // h, i % h
        place = (strip * diagonals + row + j) * h + row
        code = packed[jnp.where(on_path, place, 0)].astype(jnp.int32)
        way = pool * most + code // radix[pool] % sizes[pool]
        moved = (i - di[way], j - dj[way], pools[way])
        return tuple(jnp.where(on_path, a, b) for a, b in zip(moved, cell, strict=True)), (i, j)

    i, j = lax.scan(step, (*end, jnp.zeros_like(end[0])), length=most_cells)[1]
    length = jnp.sum((i >= 0) & (j >= 0), dtype=jnp.int32)
    order = jnp.arange(most_cells, dtype=jnp.int32)
    path = jnp.stack([i, j], axis=-1)[jnp.maximum(length - 1 - order, 0)]
    steps = jnp.diff(path, axis=0, prepend=jnp.full((1, 2), -1, jnp.int32))
    weights = jnp.sum(steps, axis=-1) if pattern.weighted else jnp.ones_like(order)
    return path, jnp.where(order < length, weights, 0), length


@jax.custom_jvp
def _selected_cost(d, total, path, weights):
    """``total``, which is Σ_t weights_t · d[path_t], with that sum's derivative in d."""
    return total


@_selected_cost.defjvp
def _selected_cost_jvp(primals, tangents):
    d, total, path, weights = primals
    selected = tangents[0][path[:, 0], path[:, 1]]
    return _selected_cost(d, total, path, weights), jnp.sum(weights * selected)
