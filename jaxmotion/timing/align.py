"""One clip in the timing of another.

    dtw      cheapest pairing of frames by the distance of poses: :mod:`jaxmotion.timing.dtw`
    warping  iterative motion warping of quaternion components less their means, which looks past
             another posture: :mod:`jaxmotion.timing.motion_warping`

    t_j = mean of the source frames i paired with reference frame j, then smoothed: least
    Σ_j (x_j − t_j)² + m² Σ_j (x_{j+1} − x_j)², between fixed ends: first to first, last to last

j: frames of the reference; x_j: the source time (frames) that is read for frame j; m: ``settle``,
in frames of the reference. A pairing holds and skips whole frames; without smoothing the copy would
stutter. Smoothed times never turn back (their steps solve (I + m² DDᵀ) w = steps of t, ends fixed,
an M-matrix), and clips that agree stay as they are. Only joints with the same names are compared,
without the root (where a clip is and which way it faces does not matter) unless it is all there is.
O(T_x T_y J).

A pairing is discrete: derivatives reach the copy through the poses that are read, not the times.
"""

from collections.abc import Iterator
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmotion import quaternion
from jaxmotion._checks import known, one_of, require, static
from jaxmotion._entry import finite_clip
from jaxmotion._numerics import safe_sqrt
from jaxmotion._portable import Portable
from jaxmotion._program import keepable
from jaxmotion._summary import brief
from jaxmotion._types import AnyArray, ScalarLike
from jaxmotion.frames.count import frame_mask
from jaxmotion.frames.padding import bucket_size, in_buckets
from jaxmotion.linalg import banded_solve
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton
from jaxmotion.timing.dtw import dtw
from jaxmotion.timing.motion_warping import motion_warping
from jaxmotion.timing.resample import even_reading, read_motion


class Alignment(Portable):
    """A clip in the timing of another.

    **Fields:** ``motion``: the source read for every frame of the reference, at its frame time;
    ``source_frame``: f[N], the source time that was read, in frames; ``path``: i32[P, 2], pairs
    (source frame, reference frame), of which the first ``length`` count; ``distance``: f[], rms
    angle in radians between the joints that were compared, over the pairs.
    """

    motion: Motion
    source_frame: Float[Array, " reference"]
    path: Int[Array, "pair 2"]
    length: Int[Array, ""]
    distance: Float[Array, ""]

    def _words(self) -> Iterator[str]:
        yield from self.motion._words()
        yield f"distance={brief(self.distance)}"


@static("window")
def align(
    source: Motion,
    reference: Motion,
    *,
    method: Literal["dtw", "warping"] = "dtw",
    step_pattern: str = "symmetric",
    window: int | None = None,
    settle: ScalarLike = 2.0,
) -> Alignment:
    """Give a clip the timing of another.

    O(T_x T_y J). The pairing is discrete: derivatives reach the copy through the poses that are
    read, not through the times.

    **Arguments:** ``source``, ``reference``: single clips of one dtype with at least one joint name
    in common; ``method``: "dtw", or "warping" for the same action in another style;
    ``step_pattern``, ``window``: of :func:`dtw`, not with "warping"; ``settle``: m ≥ 0, frames of
    the reference over which the source times are smoothed, 0 for the pairing as it is.
    **Returns:** :class:`Alignment`.
    **Raises:** ``ValueError`` for what is not one clip of finite numbers, another method or step
    pattern, either of ``step_pattern`` and ``window`` with "warping", two dtypes, no common joints,
    a negative ``settle``, or a step pattern and window that leave no path; at run time for the last
    two when traced.
    """
    finite_clip("align", source, "source")
    finite_clip("align", reference, "reference")
    one_of("align: method", method, ("dtw", "warping"))
    if method == "warping" and (step_pattern != "symmetric" or window is not None):
        raise ValueError("align: method='warping' takes no step_pattern= and no window=")
    frames = known(settle)
    negative = ~((frames >= 0) & (frames < np.inf))
    message = "align: settle must be 0 or more frames"
    smoothed = require(jnp.asarray(settle, source.dtype), negative, message, got=settle)
    x, y = _compared(source, reference)
    n, m = x.shape[0], y.shape[0]
    if method == "warping":
        warp = motion_warping(*_channels(x, y))
        path = jnp.stack([warp.source_index, warp.reference_index], axis=1)
        length = jnp.asarray(path.shape[0], jnp.int32)
    else:
        x, y = in_buckets(x, y, size=bucket_size)
        warp = dtw(
            x,
            y,
            metric="pose",
            step_pattern=step_pattern,
            window=window,
            x_length=n,
            y_length=m,
        )
        path, length = warp.path, warp.length
    message = "align: the step pattern and window leave no path between clips of these lengths"
    smoothed, length = require((smoothed, length), length == 0, message)
    n, m = jnp.asarray(n, jnp.int32), jnp.asarray(m, jnp.int32)
    at, distance = _source_times(jnp.asarray(x), jnp.asarray(y), path, length, n, m, smoothed)
    at = at[: reference.num_frames]
    reading = even_reading(at, source.num_frames, source.dtype)
    copy = read_motion(source, reading, reference.frame_time)
    return Alignment(copy, at, path, length, distance)


def compared_joints(source: Skeleton, reference: Skeleton) -> list[tuple[int, int]]:
    """The joints of the same names in both, the root only if it is the only one."""
    theirs = {name: j for j, name in enumerate(reference.names)}
    common = [(j, theirs[n]) for j, n in enumerate(source.names) if n in theirs]
    return [pair for pair in common if 0 not in pair] or common


def _compared(source: Motion, reference: Motion) -> tuple[AnyArray, AnyArray]:
    """Rotations of the joints that are compared."""
    if source.dtype != reference.dtype:
        raise ValueError(f"align: the source is {source.dtype}, the reference {reference.dtype}")
    common = compared_joints(source.skeleton, reference.skeleton)
    if not common:
        raise ValueError(
            f"align: no joint of the source ({', '.join(source.skeleton.names)}) is in the "
            f"reference ({', '.join(reference.skeleton.names)})"
        )
    own, other = np.array(common, np.int32).T
    return source.rotations[:, own], reference.rotations[:, other]


@jax.jit
def _channels(x: AnyArray, y: AnyArray) -> tuple[Array, ...]:
    """Quaternion components less their means, f[T, 4 J], without jumps, in one hemisphere."""
    x, y = quaternion.align_signs(x), quaternion.align_signs(y)
    agree = jnp.sum(jnp.mean(x, axis=0) * jnp.mean(y, axis=0), axis=-1, keepdims=True)
    x = jnp.where(agree < 0, -x, x)
    return tuple((q - jnp.mean(q, axis=0)).reshape(q.shape[0], -1) for q in (x, y))


@keepable
@eqx.filter_jit
def _source_times(
    x: Float[Array, "source joint 4"],
    y: Float[Array, "reference joint 4"],
    path: Int[Array, "pair 2"],
    length: Int[Array, ""],
    n: Int[Array, ""],
    m: Int[Array, ""],
    settle: Float[Array, ""],
) -> tuple[Float[Array, " reference"], Float[Array, ""]]:
    """Smoothed source time of every reference frame (padded), and the rms angle over the path."""
    counts = frame_mask(length, path.shape[0]).astype(x.dtype)
    source, reference = path[:, 0], path[:, 1]
    frames = y.shape[0]
    number = jax.ops.segment_sum(counts, reference, frames)
    total = jax.ops.segment_sum(counts * source.astype(x.dtype), reference, frames)
    mean = total / jnp.maximum(number, 1)
    frame, end = jnp.arange(frames, dtype=m.dtype), (n - 1).astype(x.dtype)
    inside = (frame > 0) & (frame < m - 1)
    fixed = jnp.where((frame == m - 1) & (frame > 0), end, 0)
    beside = jnp.pad(fixed, 1)[2:]  # frame 0 is fixed at 0 and pulls at nothing
    main = jnp.where(inside, 1 + 2 * settle**2, 1)
    below = jnp.where(inside & jnp.roll(inside, -1), -(settle**2), 0)
    pull = jnp.where(inside, mean + settle**2 * beside, fixed)
    at = jnp.clip(banded_solve(jnp.stack([main, below], axis=1), pull), 0, end)
    angle = quaternion.distance(x[source], y[reference])
    squared = jnp.sum(counts * jnp.mean(angle**2, axis=1)) / jnp.sum(counts)
    return at, safe_sqrt(squared)
