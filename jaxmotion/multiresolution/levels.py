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

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmotion._types import AnyArray
from jaxmotion.frames.ends import mirrored_step
from jaxmotion.multiresolution.kernels import (
    FrameParts,
    Rotations,
    StepParts,
    among,
    halfway,
    rotations_of,
    step,
    steps,
    turned,
    turned_by,
)
from jaxmotion.multiresolution.masks import divided_difference
from jaxmotion.multiresolution.rows import Ends, Weights, every_second, window_sums
from jaxmotion.quaternion.parts import Parts, added, neighbours, scaled, subtracted

Count: TypeAlias = Int[Array, ""]
Spacing: TypeAlias = Float[Array, " step"]


class Level(NamedTuple):
    """Poses of one level with their steps.

    ``translations`` and ``rotations`` by component, f[T, J] each; ``moves`` and ``turns``: their
    steps, f[T − 1, J], zero from the last that counts; ``spacing``: h f[T − 1], None if even;
    ``count``: c.
    """

    translations: FrameParts
    rotations: Rotations
    moves: StepParts
    turns: StepParts
    spacing: Spacing | None
    count: Count

    def turning(self) -> tuple[Callable[[Any, Count], StepParts], Any]:
        """How to make ``turns``, and of what: they are there."""
        return (lambda turns, count: turns), self.turns


class FinestLevel(NamedTuple):
    """A :class:`Level` that has the quaternions that its rotations are of in place of ``turns``: a
    gradient keeps no steps, but computes them again."""

    translations: FrameParts
    rotations: Rotations
    moves: StepParts
    quaternions: Float[Array, "frame joint 4"]
    spacing: Spacing | None
    count: Count

    def turning(self) -> tuple[Callable[[Any, Count], StepParts], Any]:
        """How to make ``turns``, and of what: quaternions, each time."""
        return (lambda q, count: steps(rotations_of(q), count)[1]), self.quaternions


def level_of(
    translations: FrameParts, rotations: Rotations, spacing: Spacing | None, count: Count
) -> Level:
    """Poses with their steps."""
    rotations, turns = steps(rotations, count)
    moves = _moves(translations, count)
    return Level(translations, rotations, moves, turns, spacing, count)


def finest_level(
    translations: FrameParts,
    quaternions: Float[AnyArray, "frame joint 4"],
    spacing: Spacing | None,
    count: Count,
) -> FinestLevel:
    """Poses that a pyramid begins with."""
    q, moves = jnp.asarray(quaternions), _moves(translations, count)
    return FinestLevel(translations, rotations_of(q), moves, q, spacing, count)


def _moves(translations: FrameParts, count: Count) -> StepParts:
    before, after = neighbours(translations)
    return among(count, subtracted(after, before))


def even_frames(fine: Level | FinestLevel) -> tuple[FrameParts, Rotations, Spacing | None]:
    """Every second pose and the spacing between them, f[T//2 + 1, J], continued past an even c."""
    count, frames = fine.count, fine.rotations.num_frames
    rows = min(frames, 3)
    start = jnp.maximum(count - rows, 0)
    past = mirrored_step(count - 1, count - 1) - start

    def ended(even: Any, end: Any) -> Any:
        return jax.tree.map(
            lambda x, row: _with_row(_room(x, frames // 2 + 1), count // 2, row), even, end
        )

    def at(near: Any, index: Int[Array, ""]) -> Any:
        return jax.tree.map(lambda x: x[jnp.minimum(index, rows - 1)][None], near)

    even_p, near_p = every_second(fine.translations, start, rows)
    pairs = [every_second(x, start, rows) for x in fine.rotations]
    even_r, near_r = (Rotations(*x) for x in zip(*pairs, strict=True))
    last = count - 1 - start
    p, r = at(near_p, last), at(near_r, last)
    move = subtracted(at(near_p, past + 1), at(near_p, past))
    turn = step(at(near_r, past), at(near_r, past + 1))
    odd, beyond = count % 2 == 1, (added(p, move), turned(r, turn))
    end_p, end_r = jax.tree.map(lambda a, b: jnp.where(odd, a, b), (p, r), beyond)
    spacing = None if fine.spacing is None else coarser_spacing(fine.spacing, count)
    return ended(even_p, end_p), ended(even_r, end_r), spacing


def coarser_spacing(spacing: Spacing, count: Count) -> Float[Array, " coarser"]:
    """Spacing of every second frame: f[T − 1] to f[T//2]."""
    h = continued(spacing, count)
    return h[::2] + h[1::2]


def continued(spacing: Spacing, count: Count) -> Float[Array, " continued"]:
    """Spacing of all frames between the first and the last of :func:`even_frames`: f[T − 1] to
    f[2(T//2)]."""
    return _mirrored(spacing, count)[2 : 2 + 2 * ((spacing.shape[0] + 1) // 2)]


def reduced(fine: Level | FinestLevel, *, smooth: bool = True) -> Level:
    """R, or without ``smooth`` only its even frames: T to T//2 + 1 frames."""
    p, rotations, spacing = even_frames(fine)
    if smooth:
        weights = _reduction_weights(fine.spacing, fine.count, len(p[0]))
        ends = _mirrored_ends(len(fine.moves[0]), fine.count, p[0].dtype)
        p = added(p, window_sums(fine.moves, weights, ends, 2))
        rotations = turned_by(rotations, *_window_sums_of(*fine.turning(), weights, ends, 2))
    return level_of(p, rotations, spacing, fine.count // 2 + 1)


def expanded(
    coarse: Level, fine_spacing: Float[Array, " fine"] | None
) -> tuple[tuple[FrameParts, Rotations], tuple[StepParts, Rotations]]:
    """E's even poses, those of a level of K frames, and its new ones between each two, f[K − 1, J];
    ``fine_spacing`` f[2(K − 1)] of the frames that come out, :func:`continued`, if uneven."""
    p, count = tuple(x[:-1] for x in coarse.translations), coarse.count
    if fine_spacing is None:
        tau, weights, outer = 0.5, (1 / 16, 0.0, -1 / 16), _even_ends(count, p[0].dtype)
    else:
        tau, weights, outer = _uneven_weights(coarse, fine_spacing)
    ends = _drawn_ends(len(p[0]), count, outer)
    p = added(p, scaled(tau, coarse.moves))
    p = added(p, window_sums(coarse.moves, weights, ends))
    change = _window_sums_of(*coarse.turning(), weights, ends)
    if fine_spacing is None:
        even, odd = halfway(coarse.rotations, coarse.turns, *change)
        return (coarse.translations, even), (p, odd)
    before = jax.tree.map(lambda x: x[:-1], coarse.rotations)
    middle = turned(before, scaled(tau, coarse.turns))
    return (coarse.translations, coarse.rotations), (p, turned_by(middle, *change))


def _window_sums_of(
    turns: Callable[[Any, Count], StepParts], source: Any, weights: Weights, ends: Ends, stride=1
) -> tuple[Callable[..., Parts], tuple, tuple]:
    """:func:`window_sums` of turns(source) as :func:`turned_by` takes it: a function, what its
    derivative goes through, and what else it is given. Weights that are numbers have no
    derivative."""

    def sums(source: Any, weights: Weights, ends: Ends) -> Parts:
        return window_sums(turns(source, ends.stop + 1), weights, ends, stride)

    if isinstance(weights[0], float):
        return lambda source, ends: sums(source, weights, ends), (source,), (ends,)

    def uneven(source: Any, weights: Weights, near: tuple, *where: Count) -> Parts:
        return sums(source, weights, Ends(*near, *where))

    return uneven, (source, weights, ends[:2]), ends[2:]


def _mirrored(spacing: Spacing, count: Count) -> Float[Array, " longer"]:
    """Spacings −2 … of a clip of ``count`` frames, first continued by one if they are even, then
    mirrored: two in front and three behind the buffer's."""
    before, behind = _mirrored_steps(count)
    room = jnp.ones(3, spacing.dtype)
    longer = jnp.concatenate([spacing[before], spacing, room])
    return jax.lax.dynamic_update_slice(longer, spacing[behind], (count + 1,))


def _mirrored_steps(count: Count) -> tuple[Int[Array, "2"], Int[Array, "3"]]:
    """Which of a clip's steps stand for the two before the first and the three after the last."""
    real = count - 1
    whole = real + 1 - count % 2
    before, behind = (
        mirrored_step(first + jnp.arange(n), whole) for first, n in ((-2, 2), (real, 3))
    )
    return mirrored_step(before, real), mirrored_step(behind, real)


def _mirrored_ends(steps: int, count: Count, dtype) -> Ends:
    """The same as weights of the steps near each end."""
    before, behind = _mirrored_steps(count)
    near = jnp.arange(min(steps, 5))
    start = jnp.maximum(count - 1 - len(near), 0)
    front, back = ((index[:, None] == near).astype(dtype) for index in (before, behind - start))
    return Ends(front, back, start, count - 1)


def _room(x: Float[Array, "frame joint"], rows: int) -> Float[Array, "row joint"]:
    """The first ``rows`` rows, the last repeated if there are fewer."""
    missing = rows - x.shape[0]
    return jnp.concatenate([x, x[-1:]]) if missing == 1 else x[:rows]


def _with_row(
    x: Float[Array, "row *rest"], row: Int[Array, ""], value: Float[Array, "1 *rest"]
) -> Float[Array, "row *rest"]:
    return jax.lax.dynamic_update_slice_in_dim(x, value, row, 0)


def _reduction_weights(spacing: Spacing | None, count: Count, rows: int) -> Weights:
    """b₋₂ … b₁ of the mask: numbers, or f[rows, 1] for uneven spacing."""
    if spacing is None:
        return 1 / 24, -3 / 24, 3 / 24, -1 / 24
    h = _mirrored(spacing, count)
    before2, before, after, after2 = (h[m : m + 2 * rows - 1 : 2] for m in range(4))
    knots = [-before2 - before, -before, jnp.zeros_like(after), after, after + after2]
    mean = (knots[4] - knots[0]) / 4
    a = -divided_difference(jnp.stack(knots, axis=1) / mean[:, None])
    left, right = a[:, 0], a[:, 4]
    return tuple(b[:, None] for b in (-left, -left - a[:, 1], a[:, 3] + right, right))


def _drawn_ends(
    steps: int, count: Count, outer: tuple[Float[Array, "3"], Float[Array, "3"]]
) -> Ends:
    """One step beyond each end; ``outer``: weights f[3] of the three steps next to each."""
    real = count - 1
    near, inward = jnp.arange(min(steps, 3)), jnp.arange(3)
    start = jnp.maximum(real - len(near), 0)
    last = jnp.maximum(real - 1, 0)
    nearest = jnp.minimum(inward, last), jnp.maximum(last - inward, 0) - start
    front, back = (
        (w @ (index[:, None] == near).astype(w.dtype))[None]
        for w, index in zip(outer, nearest, strict=True)
    )
    return Ends(front, back, start, real)


def _even_ends(count: Count, dtype) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Weights of the steps beyond the ends: cubic, quadratic or straight by the number of steps."""
    table = jnp.asarray([[1, 0, 0], [1, 0, 0], [2, -1, 0], [3, -3, 1]], dtype)
    weights = table[jnp.clip(count - 1, 0, 3)]
    return weights, weights


def _uneven_weights(
    coarse: Level, fine_spacing: Float[Array, " fine"]
) -> tuple[Float[Array, "step 1"], Weights, tuple[Float[Array, "3"], Float[Array, "3"]]]:
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


def _uneven_end(h: Float[Array, "3"], real: Count) -> Float[Array, "3"]:
    """Weights of the three steps inward for the one step beyond an end, as long as the last one."""
    knots = jnp.stack([jnp.zeros_like(h[0]), h[0], h[0] + h[1], h[0] + h[1] + h[2]])
    rows = [jnp.asarray([1, 0, 0], h.dtype)]
    for used in (3, 4):
        l = _lagrange(knots[:used], -h[0])
        tails = [-sum(l[m + 1 :]) for m in range(used - 1)]
        rows.append(jnp.stack(tails + [jnp.zeros_like(h[0])] * (4 - used)))
    return jnp.stack(rows)[jnp.clip(real - 1, 0, 2)]


def _lagrange(
    knots: Float[Array, "knot *rest"], at: Float[Array, "*rest"]
) -> list[Float[Array, "*rest"]]:
    """Lagrange's coefficients on knots [n, ...] at a time [...]."""
    n = knots.shape[0]
    coefficients = []
    for j in range(n):
        others = [m for m in range(n) if m != j]
        factors = [(at - knots[m]) / (knots[j] - knots[m]) for m in others]
        coefficients.append(jnp.stack(factors).prod(0))
    return coefficients
