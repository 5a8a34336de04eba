"""Iterative motion warping: bend a source clip in time and in space onto a reference.

    E(W, a, b) = Σ_c ‖W (s_c a_c + b_c) − r_c‖² + w_a² ‖σ_c D a_c‖² + w_b² ‖D (b_c + o_c a_c)‖²

s ``(N_s, C)`` is the source and r ``(m N_r, C)`` the reference, each of its frames repeated m
times; c runs over the C channels (degrees of freedom); a, b ``(N_s, C)`` are scale and offset, D
takes first differences, w_a and w_b are the smoothness, o_c and σ_c the mean of s_c and its rms
deviation from it. The warp W repeats source frame i w_i times in place, 1 ≤ w_i ≤ m², Σ w_i =
m N_r: local slopes lie between 1/m and m, and the source may be the longer clip.

Coordinate descent from a = 1, b = 0, each half exact, so E never rises:

- W by dynamic programming. A run of c refined frames that ends at j costs T_c[j] = T_{c−1}[j−1] +
  d_ij, T_1[j] = C_{i−1}[j−1] + d_ij, and C_i[j] = min_c T_c[j], with d_ij = Σ_c (s_ic a_ic + b_ic −
  r_jc)². O(N_s N_r m³).
- a, b by the normal equations, block-tridiagonal with a 2 × 2 block per source frame. O(N_s C).

It stops when W repeats itself or a and b move the signal by less than ``tolerance``. E is in the
channels' units squared; angles in radians. Sources: Hsu, Pulli & Popović 2005; Wu et al. §4, eq.
1-3 (whose extra ‖Db‖² in eq. 1 contradicts its eq. 3 and is left out). They have w_a² ‖D a‖² and
w_b² ‖D b‖², which is the same for channels of mean 0 and rms 1, and for others depends on their
unit and origin. Here it does not: with k s + h and k r + h for s and r, W and a are the same, b
becomes k b + h (1 − a), and E becomes k² E (k for one channel alone may change W, which weighs the
channels against each other). It is all worked out on z = (s − o)/u and (r − o)/u, where nothing
large cancels: a z + β, b = u β + o (1 − a).

Sharp bits: a constant source channel cannot tell scale from offset; its scale is 1. W is a discrete
choice and passes no derivative; ``scale`` and ``offset`` are differentiable given W, implicitly.
Energies carry no derivative.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxmotion._checks import fault, known, no_module, raise_faults, static
from jaxmotion._portable import Portable
from jaxmotion._room import Room, room_for
from jaxmotion._summary import brief, some
from jaxmotion._types import AnyArray, ScalarLike
from jaxmotion.frames.count import frame_mask
from jaxmotion.linalg.pair_walk import Symmetric, solve_walk
from jaxmotion.timing.frame_distance import frame_distance
from jaxmotion.timing.runs import (
    best_runs,
    by_channel,
    run_geodesic_means,
    run_means,
    run_sums,
    source_index,
)

# What is asked of a warp where nothing else is said.
SMOOTHNESS, ROUNDS, ENOUGH = 1.0, 100, 1e-4


class MotionWarp(Portable):
    """What :func:`motion_warping` found; without a shared warp every field ends in a channel axis.

    **Fields:**

    - ``runs``: i32[N_s], how many refined reference frames each source frame covers, w.
    - ``scale``: f[N_s, C], a.
    - ``offset``: f[N_s, C], b.
    - ``energy``: f[2 max_iterations], E after each half step; its last value repeats to the end.
    - ``converged``: bool[], whether it stopped by itself.
    - ``iterations``: i32[], how many were run.
    - ``repeats``: m; refined frame t stands for reference frame t // m; static.
    - ``num_refined``: m N_r, frames of the refined timeline; static.
    """

    runs: Int[Array, "source ..."]
    scale: Float[Array, "source channels"]
    offset: Float[Array, "source channels"]
    energy: Float[Array, "half_steps ..."]
    converged: Bool[Array, "..."]
    iterations: Int[Array, "..."]
    repeats: int = eqx.field(static=True)
    num_refined: int = eqx.field(static=True)

    def _words(self) -> Iterator[str]:
        yield f"{some(self.runs.shape[0], 'source frame')} on {self.num_refined} refined"
        yield f"scale={brief(self.scale)}"
        yield f"iterations={brief(self.iterations)}"
        yield f"converged={brief(self.converged)}"

    @property
    def source_index(self) -> Int[Array, "refined ..."]:
        """Which source frame stands at each refined frame, W as an index: ``(m N_r,)``."""
        return by_channel(source_index, self.runs, num_refined=self.num_refined)

    @property
    def reference_index(self) -> Int[Array, " refined"]:
        """Which reference frame each refined frame stands for ``(m N_r,)``."""
        return jnp.arange(self.num_refined, dtype=self.runs.dtype) // self.repeats

    @property
    def is_new_pair(self) -> Bool[Array, "refined ..."]:
        """Where a pair (source frame, reference frame) occurs first: count each pair once."""
        source = self.source_index
        reference = self.reference_index.reshape((-1,) + (1,) * (source.ndim - 1))
        moved = (jnp.diff(source, axis=0) != 0) | (jnp.diff(reference, axis=0) != 0)
        return jnp.concatenate([jnp.ones_like(moved[:1]), moved])


@static("shared", "slope", "max_iterations", "throw")
def motion_warping(
    source: Float[AnyArray, "source channels"],
    reference: Float[AnyArray, "reference _"],
    *,
    shared: bool = True,
    slope: int | None = None,
    scale_smoothness: float = SMOOTHNESS,
    offset_smoothness: float = SMOOTHNESS,
    max_iterations: int = ROUNDS,
    tolerance: ScalarLike = ENOUGH,
    throw: bool = False,
) -> MotionWarp:
    """Align a source clip with a reference while scaling and shifting its channels over time.

    O(N_s N_r m³ + N_s C) a round. The warp is a discrete choice; ``scale`` and ``offset`` are
    differentiable given the warp. Source: Hsu, Pulli & Popović 2005; Wu et al. §4, eq. 1-3.

    **Arguments:**

    - ``source``: f[N_s, C], channels of the clip to warp, angles unwrapped.
    - ``reference``: f[N_r, C], the clip to follow.
    - ``shared``: one warp for all channels, or one per channel.
    - ``slope``: m, the steepest local slope either way; by default the smallest that fits both
      clips, at least 2.
    - ``scale_smoothness``: w_a > 0, weight of the first difference of the scale.
    - ``offset_smoothness``: w_b > 0, the same for the offset. What the normal equations have no
      digits for, below 16 m √ε of the dtype, is refused.
    - ``max_iterations``: most rounds of warp and fit, at least 1.
    - ``tolerance``: largest change of the scaled and shifted channels that counts as none, ≥ 0, as
      a share of their spread.
    - ``throw``: whether still changing by more after ``max_iterations`` is an error (else look at
      ``converged``).

    **Returns:** :class:`MotionWarp`.
    **Raises:** ``ValueError`` for shapes that do not fit, a slope too small for these lengths, a
    smoothness outside of what the dtype can solve, no iterations, a negative ``tolerance``, or
    clips that are not finite; at run time for the last two when traced, and as ``throw`` says.
    """
    for name, value in (("source", source), ("reference", reference)):
        no_module(f"motion_warping: {name}", value, "jaxmotion.timing.align takes motions")
    source, reference = known(source), known(reference)
    finite = [(abs(x) < np.inf).all() for x in (source, reference)]
    num_source, num_reference = source.shape[0], reference.shape[0]
    fits = source.ndim == 2 and source.shape[1:] == reference.shape[1:]
    if not fits or 0 in source.shape or not num_reference:
        raise ValueError(
            f"source has shape {source.shape} and reference {reference.shape};"
            " want (N_s, C) and (N_r, C), no axis empty"
        )
    m = _slope_that_fits(slope, num_source, num_reference)
    smoothness = (scale_smoothness, offset_smoothness)
    dtype = jax.dtypes.canonicalize_dtype(source.dtype)
    kind = jnp.finfo(dtype)
    least, most = 16 * m * math.sqrt(kind.eps), float(kind.eps) / math.sqrt(kind.tiny)
    if not least <= min(smoothness) <= max(smoothness) <= most:
        raise ValueError(
            f"scale_smoothness={scale_smoothness}, offset_smoothness={offset_smoothness}; want both"
            f" from {least:.1g} to {most:.1g}, which {dtype} can solve with slope {m}"
        )
    if not (isinstance(max_iterations, (int, np.integer)) and max_iterations >= 1):
        raise ValueError(
            f"motion_warping: max_iterations={max_iterations}; want a whole number of at least 1"
        )
    faults = fault(~(finite[0] & finite[1]), "motion_warping: source and reference must be finite")
    share = known(tolerance)
    message = "motion_warping: tolerance must be a share of 0 or more"
    faults += fault(~((share >= 0) & (share < np.inf)), message, got=tolerance)
    source, reference = raise_faults((source, reference), faults)
    weights, enough = jnp.asarray(smoothness, dtype), jnp.asarray(tolerance, dtype)
    rooms = room_for(source, reference, enough), room_for(reference, source, enough)
    clips = jnp.asarray(rooms[0].fill(source)), jnp.asarray(rooms[1].fill(reference))
    counts = rooms[0].count, rooms[1].count
    warp = warped(*clips, counts, shared, m, weights, max_iterations, enough)
    warp = cut_warp(warp, *rooms)
    if not throw:
        return warp
    message = f"motion_warping: still changing after {max_iterations} iterations"
    return raise_faults(warp, [(~jnp.all(warp.converged), message)])


@eqx.filter_jit
def warped(
    source: Float[Array, "source channels"],
    reference: Float[Array, "reference channels"],
    counts: tuple[Int[Array, ""], Int[Array, ""]],
    shared: bool,
    m: int,
    smoothness: Float[Array, "2"],
    max_iterations: int,
    tolerance: Float[Array, ""],
) -> MotionWarp:
    """:func:`motion_warping` of what is checked, and of the frames that count: :func:`cut_warp`."""
    own, other = (
        frame_mask(n, len(x))[:, None] for n, x in zip(counts, (source, reference), strict=True)
    )
    unit = _power_of_two_below(source - source[0], reference - source[0])
    z, target, origin = _about_the_mean(source / unit, reference / unit, own, other)
    fixed = lax.stop_gradient((z, target))

    def descend(z, target):
        return _descend(z, target, own, other, m, smoothness, max_iterations, tolerance)

    if shared:
        runs, energy, converged, iterations = descend(*fixed)
    else:
        one_channel = jax.vmap(lambda z, target: descend(z[:, None], target[:, None]), 1, -1)
        runs, energy, converged, iterations = one_channel(*fixed)
    scale, offset = _fit(z, target, own, runs, m, smoothness)
    offset = unit * (offset + origin * (1 - scale))
    energy = unit * (unit * energy)
    return MotionWarp(runs, scale, offset, energy, converged, iterations, m, m * reference.shape[0])


def cut_warp(warp: MotionWarp, source: Room, reference: Room, axis: int = 0) -> MotionWarp:
    """The warp of the frames that count, of one of clips in these rooms; ``axis``: of its source
    frames, after others that were mapped over."""
    warp = source.cut(warp, lambda w: (w.runs, w.scale, w.offset), axis)

    def of_frames(warp: MotionWarp) -> MotionWarp:
        return replace(warp, num_refined=warp.repeats * reference.frames)

    for _ in range(axis):
        of_frames = jax.vmap(of_frames)
    return of_frames(warp)


def _power_of_two_below(*signals: Array) -> Array:
    """What to divide by, exactly, so that no square leaves the range of floating point."""
    size = jnp.max(jnp.stack([jnp.max(jnp.abs(x)) for x in signals]))
    size = lax.stop_gradient(jnp.where(size > 0, size, 1))
    return jnp.ldexp(jnp.ones_like(size), jnp.frexp(size)[1] - 1)


def _about_the_mean(
    s: Array, r: Array, s_counts: Array, r_counts: Array
) -> tuple[Array, Array, Array]:
    """s and r less the mean of s ``(C,)``, 0 where nothing counts; a channel that moves by no more
    than its rounding has none of it left. The first frame goes first, as sums of what is left do
    not round so much."""
    swing = s - s[0]
    middle = _mean(swing, s_counts)
    rounding = 4 * jnp.finfo(s.dtype).eps * jnp.max(jnp.abs(s), axis=0)
    moves = jnp.max(jnp.abs(swing), axis=0) > rounding
    z = jnp.where(moves & s_counts, swing - middle, 0)
    return z, jnp.where(r_counts, (r - s[0]) - middle, 0), s[0] + middle


def _mean(x: Array, counts: Array) -> Array:
    """Over the frames that count."""
    return jnp.sum(jnp.where(counts, x, 0), axis=0) / jnp.sum(counts).astype(x.dtype)


@static("rotations")
def unwarp(
    warped: Float[AnyArray, "refined ..."], warp: MotionWarp, *, rotations: bool = False
) -> Float[Array, "source ..."]:
    """Bring a signal on the refined timeline back to the source's: average each run of repeats.

    ``unwarp(x[warp.source_index], warp)`` is x, for a shared warp. Differentiable in ``warped``.

    **Arguments:** ``warped``: (m N_r, ...); with a warp per channel the last axis is the channel;
    ``warp``: of :func:`motion_warping`; ``rotations``: treat the last axis as unit quaternions and
    average along geodesics, one more frame at a time (weights 1, 1/2, 1/3, … as in Wu et al. §4);
    needs a shared warp.
    **Returns:** (N_s, ...).
    **Raises:** ``ValueError`` for a length that is not the warp's, or rotations that are no
    quaternions or come with a warp per channel.
    """
    no_module("unwarp: warped", warped)
    warped = jnp.asarray(warped)
    if warped.shape[0] != warp.num_refined:
        raise ValueError(
            f"warped has {warped.shape[0]} frames; want {warp.num_refined}, the refined timeline's"
        )
    shared = warp.runs.ndim == 1
    if not rotations:
        return by_channel(run_means, warp.runs, warped)
    if not shared or warped.shape[-1] != 4:
        raise ValueError(
            f"rotations=True with warped of shape {warped.shape} and runs of shape"
            f" {warp.runs.shape}; want quaternions (..., 4) and a shared warp"
        )
    return run_geodesic_means(warp.runs, warped)


def _slope_that_fits(slope, num_source, num_reference) -> int:
    steepest = max(num_source / num_reference, num_reference / num_source)
    m = max(2, math.ceil(steepest)) if slope is None else slope
    if not isinstance(m, (int, np.integer)) or m < 1 or steepest > m:
        raise ValueError(
            f"slope={slope}; want at least {math.ceil(steepest)}, whole, to warp {num_source}"
            f" frames onto {num_reference}"
        )
    return int(m)


def _descend(s, r, s_counts, r_counts, m, smoothness, max_iterations, tolerance):
    """Alternate the two exact half steps: runs ``(N_s,)``, energies, converged, iterations."""
    refined, in_refined = jnp.repeat(r, m, axis=0), jnp.repeat(r_counts, m, axis=0)
    power = _mean(s**2, s_counts)
    swing = jnp.sqrt(power)
    enough = tolerance * jnp.sqrt(power + _mean(r**2, r_counts))

    def energy_of(a, b, runs):
        index = source_index(runs, num_refined=refined.shape[0])
        data = jnp.sum(jnp.where(in_refined, (s * a + b)[index] - refined, 0) ** 2)
        rough = [
            w**2 * jnp.sum(jnp.where(s_counts[1:], jnp.diff(x, axis=0), 0) ** 2)
            for w, x in zip(smoothness, (swing * a, b), strict=True)
        ]
        return data + rough[0] + rough[1]

    def one_round(state):
        count, a, b, old_runs, energies, _ = state
        distance = frame_distance(s * a + b, r, "sqeuclidean")
        runs = best_runs(distance, m, s_counts[:, 0], jnp.sum(r_counts))
        new_a, new_b = _fit(s, r, s_counts, runs, m, smoothness)
        pair = jnp.stack([energy_of(a, b, runs), energy_of(new_a, new_b, runs)])
        energies = lax.dynamic_update_slice(energies, pair, (2 * count,))
        moved = jnp.maximum(swing * jnp.abs(new_a - a), jnp.abs(new_b - b))
        done = jnp.all((moved <= enough) | ~s_counts) | jnp.all(runs == old_runs)
        return count + 1, new_a, new_b, runs, energies, done

    start = (
        jnp.zeros((), jnp.int32),
        jnp.ones_like(s),
        jnp.zeros_like(s),
        jnp.zeros(s.shape[0], jnp.int32),
        jnp.zeros(2 * max_iterations, s.dtype),
        jnp.zeros((), bool),
    )
    count, _, _, runs, energies, done = lax.while_loop(
        lambda state: ~state[-1] & (state[0] < max_iterations), one_round, start
    )
    last = jnp.minimum(jnp.arange(2 * max_iterations, dtype=count.dtype), 2 * count - 1)
    return runs, energies[last], done, count


def _fit(s, r, counts, runs, m, smoothness):
    """Scale and offset ``(N_s, C)`` of least energy for given runs; differentiable. ``s`` and ``r``
    are 0 where nothing counts.

    The unknowns are x = (w_a σ a, w_b b), whose differences all count the same.
    """
    w_a, w_b = smoothness
    variance = _mean(s**2, counts)
    constant = variance == 0  # keeps scale 1: it leaves the data term and is held there by its own
    swing = jnp.sqrt(jnp.where(constant, 1, variance))
    z = s / (w_a * swing)
    w = runs.astype(s.dtype).reshape(s.shape[0], -1)
    sums = by_channel(run_sums, runs, jnp.repeat(r, m, axis=0))
    hold = jnp.where(counts & constant, 1 / w_a, 0)
    gram = Symmetric(*jnp.broadcast_arrays(w * z**2 + hold**2, w * z / w_b, w / w_b**2))
    x = solve_walk(gram, jnp.stack([z * sums + hold, sums / w_b], axis=1), counts[:, 0])
    return jnp.where(constant, 1, x[:, 0] / (w_a * swing)), x[:, 1] / w_b
