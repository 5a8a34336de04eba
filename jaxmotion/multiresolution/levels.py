"""One level down and one level up (Lee & Shin 2001, §3.3–3.4, Eq. 6, 13–18): R and E.

    R   smooth by δ − λL² with λ = 1, keep the even frames
        q′ = q_i·exp((ω_{i−2} − 3ω_{i−1} + 3ω_i − ω_{i+1})/24)
    E   even frames are copied; an odd one between i and i + 1 lies on the cubic through the four
        nearest frames:  slerp_τ(q_i, q_{i+1})·exp(−l₀ω_{i−1} + (l₂ + l₃ − τ)ω_i + l₃ω_{i+1})

ω are the steps log(q_i⁻¹q_{i+1}), l Lagrange's coefficients at the odd frame's time on frames
i − 1 … i + 2 and τ its place between i and i + 1; evenly spaced that is
slerp_½·exp((ω_{i−1} − ω_{i+1})/16). Translations likewise with their differences, for which R keeps
and E draws cubics exactly.

Ends. R mirrors the steps (Eq. 6). E needs one frame beyond each end, and takes it from the cubic
through the four frames there (three: quadratic, two: straight), which makes the paper's one-sided
mask (5, 15, −5, 1)/16 a case of the one above. c frames become c//2 + 1: an odd c ends on an even
frame, an even c is first continued by one frame by Eq. 6.

Uneven spacing. h are the times from frame to frame. R's mask is δ − h̄⁴w, w the divided difference
over five frames and h̄ their mean spacing; E's τ and l follow h.

Arrays f[T, J] by component (:mod:`~jaxmotion.multiresolution.kernels`). c ≤ T frames count and may
be traced, so that one compiled level serves clips, and levels, of many lengths; the frames after
them hold anything finite. O(T·J).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxmotion.multiresolution.kernels import (
    Parts,
    added,
    conjugate,
    midpoints,
    neighbours,
    scaled,
    steps,
    turned,
)
from jaxmotion.multiresolution.masks import divided_difference
from jaxmotion.quaternion.algebra import product


class Level(NamedTuple):
    """Poses of one level: translations and rotations by component, f[T, J] each; their steps
    ``moves`` and ``turns``, f[T − 1, J], zero from the last that counts; ``spacing`` h f[T − 1], or
    None if even; ``count`` c."""

    translations: Parts
    rotations: Parts
    moves: Parts
    turns: Parts
    spacing: Array | None
    count: Array


def level_of(translations: Parts, rotations: Parts, spacing: Array | None, count: Array) -> Level:
    """Poses with their steps."""
    real = jnp.arange(translations[0].shape[0] - 1)[:, None] < count - 1
    moves = tuple(jnp.where(real, x[1:] - x[:-1], 0) for x in translations)
    turns = tuple(jnp.where(real, x, 0) for x in steps(rotations))
    return Level(translations, rotations, moves, turns, spacing, count)


def even_frames(fine: Level) -> tuple[Parts, Parts, Array | None]:
    """Every second pose and the spacing between them, f[T//2 + 1, J], continued past an even c."""
    past = mirror_index(fine.count - 1, fine.count - 1)[None]
    last = fine.count[None] - 1
    odd = fine.count % 2 == 1

    def ended(parts: Parts, end: Parts) -> Parts:
        return tuple(
            _with_row(_room(x[::2], x.shape[0] // 2 + 1), fine.count // 2, row)
            for x, row in zip(parts, end, strict=True)
        )

    p = tuple(x[last] for x in fine.translations)
    q = tuple(x[last] for x in fine.rotations)
    beyond_p = added(p, tuple(x[past] for x in fine.moves))
    a, b = (tuple(x[past + i] for x in fine.rotations) for i in (0, 1))
    beyond_q = product(q, product(conjugate(a), b))
    choose = jax.tree.map(lambda a, b: jnp.where(odd, a, b), (p, q), (beyond_p, beyond_q))
    spacing = None if fine.spacing is None else coarser_spacing(fine.spacing, fine.count)
    return ended(fine.translations, choose[0]), ended(fine.rotations, choose[1]), spacing


def coarser_spacing(spacing: Array, count: Array) -> Array:
    """Spacing of every second frame: f[T − 1] to f[T//2]."""
    h = continued(spacing, count)
    return h[::2] + h[1::2]


def continued(spacing: Array, count: Array) -> Array:
    """Spacing of all frames between the first and the last of :func:`even_frames`: f[T − 1] to
    f[2(T//2)]."""
    return _mirrored(spacing, count)[2 : 2 + 2 * ((spacing.shape[0] + 1) // 2)]


def reduced(fine: Level, *, smooth: bool = True) -> Level:
    """R, or without ``smooth`` only its even frames: T to T//2 + 1 frames."""
    p, q, spacing = even_frames(fine)
    if smooth:
        rows = p[0].shape[0]
        weights = _reduction_weights(fine.spacing, fine.count, rows, p[0].dtype)

        def change(turns: Parts) -> Parts:
            return tuple(
                sum(
                    (w * x[m : m + 2 * rows - 1 : 2] for m, w in enumerate(weights)),
                    start=jnp.zeros((), x.dtype),
                )
                for x in (_mirrored(s, fine.count) for s in turns)
            )

        p, q = added(p, change(fine.moves)), turned(q, change(fine.turns))
    return level_of(p, q, spacing, fine.count // 2 + 1)


def odd_frames(coarse: Level, fine_spacing: Array | None) -> tuple[Parts, Parts]:
    """E's new poses, one between each two: f[K − 1, J] of a level of K frames; ``fine_spacing``
    f[2(K − 1)] of the frames that come out, :func:`continued`, if uneven."""
    p = tuple(x[:-1] for x in coarse.translations)
    if fine_spacing is None:
        tau, middle = 0.5, midpoints(coarse.rotations)
        weights = (1 / 16, 0.0, -1 / 16)
        ends = _even_ends(coarse.count, p[0].dtype)
    else:
        tau, weights, ends = _uneven_weights(coarse, fine_spacing)
        middle = turned(neighbours(coarse.rotations)[0], scaled(tau, coarse.turns))

    def correction(turns: Parts) -> Parts:
        extended = (_extended(x, coarse.count - 1, ends) for x in turns)
        return tuple(
            sum((w * x[m : m + len(x) - 2] for m, w in enumerate(weights)), jnp.zeros((), x.dtype))
            for x in extended
        )

    moved = added(scaled(tau, coarse.moves), correction(coarse.moves))
    return added(p, moved), turned(middle, correction(coarse.turns))


def interleaved(even: Parts, odd: Parts) -> Parts:
    """even₀ odd₀ even₁ …: K and K − 1 frames to 2K − 1."""

    def merge(e, o):
        pairs = jnp.stack([e[:-1], o], axis=1).reshape(-1, *e.shape[1:])
        return jnp.concatenate([pairs, e[-1:]])

    return tuple(merge(e, o) for e, o in zip(even, odd, strict=True))


def mirror_index(index: Array, count: Array) -> Array:
    """Where Eq. 6 takes step ``index`` of ``count``: mirrored at the first and the last, again and
    again."""
    period = jnp.maximum(2 * (count - 1), 1)
    index = jnp.abs(index) % period
    return jnp.clip(jnp.minimum(index, period - index), 0, jnp.maximum(count - 1, 0))


def _mirrored(steps: Array, count: Array) -> Array:
    """Steps −2 … of a clip of ``count`` frames, first continued by one if they are even, then
    mirrored: two rows in front and three behind the buffer's."""
    real = count - 1
    whole = real + 1 - count % 2

    def rows(first, number):
        index = first + jnp.arange(number)
        return steps[mirror_index(mirror_index(index, whole), real)]

    room = jnp.ones((3, *steps.shape[1:]), steps.dtype)  # ones: spacings stay positive
    longer = jnp.concatenate([rows(-2, 2), steps, room])
    return jax.lax.dynamic_update_slice_in_dim(longer, rows(real, 3), real + 2, 0)


def _room(x: Array, rows: int) -> Array:
    """The first ``rows`` rows, the last repeated if there are fewer."""
    missing = rows - x.shape[0]
    return jnp.concatenate([x, x[-1:]]) if missing == 1 else x[:rows]


def _with_row(x: Array, row: Array, value: Array) -> Array:
    return jax.lax.dynamic_update_slice_in_dim(x, value, row, 0)


def _reduction_weights(spacing: Array | None, count: Array, rows: int, dtype) -> list:
    """b₋₂ … b₁ of the mask: numbers, or f[rows, 1] for uneven spacing."""
    if spacing is None:
        return [1 / 24, -3 / 24, 3 / 24, -1 / 24]
    h = _mirrored(spacing, count)
    before2, before, after, after2 = (h[m : m + 2 * rows - 1 : 2] for m in range(4))
    knots = [-before2 - before, -before, jnp.zeros_like(after), after, after + after2]
    mean = (knots[4] - knots[0]) / 4
    a = -divided_difference(jnp.stack(knots, axis=1) / mean[:, None])
    left, right = a[:, 0], a[:, 4]
    return [b[:, None] for b in (-left, -left - a[:, 1], a[:, 3] + right, right)]


def _extended(steps: Array, real: Array, ends: tuple[Array, Array]) -> Array:
    """Steps −1 … real, the outer two by ``ends``: weights f[3] of the three steps next to each."""
    inward = jnp.arange(3)
    last = jnp.maximum(real - 1, 0)
    nearest = steps[jnp.minimum(inward, last)], steps[jnp.maximum(last - inward, 0)]
    front, back = (
        jnp.sum(w[:, None] * x, 0, keepdims=True) for w, x in zip(ends, nearest, strict=True)
    )
    longer = jnp.concatenate([front, steps, jnp.zeros_like(steps[:1])])
    return jax.lax.dynamic_update_slice_in_dim(longer, back, real + 1, 0)


def _even_ends(count: Array, dtype) -> tuple[Array, Array]:
    """Weights of the steps beyond the ends: cubic, quadratic or straight by the number of steps."""
    table = jnp.asarray([[1, 0, 0], [1, 0, 0], [2, -1, 0], [3, -3, 1]], dtype)
    weights = table[jnp.clip(count - 1, 0, 3)]
    return weights, weights


def _uneven_weights(coarse: Level, fine_spacing: Array):
    """τ f[K − 1, 1], the three weights of a correction likewise, and those of the ends."""
    assert coarse.spacing is not None
    h, real = coarse.spacing, coarse.count - 1
    inward = jnp.arange(3)
    last = jnp.maximum(real - 1, 0)
    front = _uneven_end(h[jnp.minimum(inward, last)], real)
    back = _uneven_end(h[jnp.maximum(last - inward, 0)], real)
    one = jnp.ones((1,), h.dtype)
    longer = jnp.concatenate([h[:1], h, one])
    longer = _with_row(longer, real + 1, h[last][None])
    before, own, after = longer[:-2], longer[1:-1], longer[2:]
    into = fine_spacing[::2]
    knots = jnp.stack([-before, jnp.zeros_like(own), own, own + after])
    tau = into / own
    l = _lagrange(knots, into)
    weights = -l[0], l[2] + l[3] - tau, l[3]
    return tau[:, None], tuple(w[:, None] for w in weights), (front, back)


def _uneven_end(h: Array, real: Array) -> Array:
    """Weights of the three steps inward for the one step beyond an end, as long as the last one."""
    knots = jnp.stack([jnp.zeros_like(h[0]), h[0], h[0] + h[1], h[0] + h[1] + h[2]])
    rows = [jnp.asarray([1, 0, 0], h.dtype)]
    for used in (3, 4):
        l = _lagrange(knots[:used], -h[0])
        tails = [-sum(l[m + 1 :]) for m in range(used - 1)]
        rows.append(jnp.stack(tails + [jnp.zeros_like(h[0])] * (4 - used)))
    return jnp.stack(rows)[jnp.clip(real - 1, 0, 2)]


def _lagrange(knots: Array, at: Array) -> list[Array]:
    """Lagrange's coefficients on knots [n, ...] at a time [...]."""
    n = knots.shape[0]
    coefficients = []
    for j in range(n):
        others = [m for m in range(n) if m != j]
        factors = [(at - knots[m]) / (knots[j] - knots[m]) for m in others]
        coefficients.append(jnp.stack(factors).prod(0))
    return coefficients
