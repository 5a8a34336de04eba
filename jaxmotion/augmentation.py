"""Variations of a clip, seeded and checked: another manner, more or less of it, another timing.

    M_i = retimed_i(styled_i(Mᵇ ⊕ α_i δᶜ ⊕ δʳ)),  planted where M's feet touch

    α_i     gain of the control layer (Eom et al. 2019, §6.2; ``layers.synthesize``)
    s_i     shares of M's own manner and of each given one, uniform over the simplex; M's statistics
            are carried to their mixture (``style.interpolate``), each direction by its own ratio
    u_i(t)  frame of M that frame t shows: its speed is (1 + w)^c(t), c three waves of 1 to 4
            seconds, |c| ≤ 1, over its mean: the clip keeps its frames and its ends

α and shares are drawn systematically: n equal steps of the range with one random offset, in a
random order for each, so that n variations cover it evenly. O(n·T·J); eight variations at a time.

Each variation is checked, and refused if

    a joint turns beyond limits learned from other clips    by anything (they have their margin)
    its feet slide faster, on the mean, than M's            by more than 0.04 of the leg a second
    its lowest joint goes deeper than M's                   by more than 0.02 of the leg

or a number in it is not finite. The leg is half of the skeleton's longest chain.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from jaxmotion._checks import instance_of, known, require, static, traced
from jaxmotion._entry import finite_clip
from jaxmotion._file_facts import compiled
from jaxmotion._numerics import safe_norm
from jaxmotion._portable import Portable
from jaxmotion._summary import some
from jaxmotion._types import ArrayLike, Key, ScalarLike
from jaxmotion.contacts import (
    ContactPoints,
    Contacts,
    cleanup_footskate,
    detect,
    limb_lengths,
    replant,
)
from jaxmotion.contacts.contact import check_kept
from jaxmotion.kinematics import forward_kinematics
from jaxmotion.layers import MotionLayers, decompose, synthesize
from jaxmotion.motion import Motion
from jaxmotion.spacetime import JointLimits, learn_limits
from jaxmotion.style import MotionStyle, motion_style
from jaxmotion.style.carry import carried
from jaxmotion.style.root import body_of
from jaxmotion.style.statistics import mixed, statistics
from jaxmotion.timing.resample import even_reading, read_motion

__all__ = ["Variations", "augment"]

_AT_A_TIME = 8
_WAVES, _PERIODS = 3, (1.0, 4.0)  # seconds
_SLIDE, _DEPTH = 0.04, 0.02  # of the leg


class Variations(Portable):
    """What :func:`augment` made of a clip, and which of it is sound. ``variations[i]`` is the i-th
    as a motion, ``len(variations)`` is n.

    **Fields:** ``motions``: a :class:`~jaxmotion.Motion` with translations f[n, T, J, 3] and
    rotations f[n, T, J, 4], of one skeleton and frame time; ``contacts``: where each one's feet are
    planted, arrays with n in front, or None; ``alpha``: f[n]; ``shares``: f[n, K + 1], of the
    clip's own manner and of K others; ``frames``: f[n, T], the frame of the clip that each frame
    shows; ``excess``: f[n, J], radians beyond the limits; ``slide``: f[n], mean speed of planted
    points, file unit a second; ``depth``: f[n], how far the lowest joint is below the clip's, file
    unit; ``most_slide``, ``most_depth``: f[], what is let pass; ``accepted``: bool[n].

    **Example:**

        >>> import jax, jaxmotion as jm
        >>> walk = jm.samples.load("walk").motion[:48]
        >>> made = jm.augment(walk, jax.random.key(0), n=3, keep_contacts=False)
        >>> len(made), made[0].num_frames, made.refused()
        (3, 48, {})
    """

    motions: Motion
    contacts: Contacts | None
    alpha: Float[Array, " variation"]
    shares: Float[Array, "variation style"]
    frames: Float[Array, "variation time"]
    excess: Float[Array, "variation joint"]
    slide: Float[Array, " variation"]
    depth: Float[Array, " variation"]
    most_slide: Float[Array, ""]
    most_depth: Float[Array, ""]
    accepted: Bool[Array, " variation"]

    def __len__(self) -> int:
        return self.alpha.shape[0]

    def __getitem__(self, number: int | np.integer) -> Motion:
        if not -len(self) <= number < len(self):
            raise IndexError(f"variation {number} of {len(self)}")
        both = self.motions.translations, self.motions.rotations
        return self.motions.with_transforms(*(x[number] for x in both))

    def __iter__(self) -> Iterator[Motion]:
        return (self[i] for i in range(len(self)))

    def sound(self) -> list[Motion]:
        """Those that were accepted, one clip each; not under ``jax.jit``."""
        return [self[i] for i in np.flatnonzero(self.accepted).tolist()]

    def refused(self) -> dict[int, str]:
        """Why the others were not, by number; not under ``jax.jit``."""
        numbers = np.flatnonzero(~np.asarray(self.accepted)).tolist()
        return {i: "; ".join(self._reasons(i)) for i in numbers}

    def _reasons(self, i: int) -> Iterator[str]:
        names, excess = self.motions.skeleton.names, np.asarray(self.excess[i])
        if not all(np.isfinite(x).all() for x in (excess, self.slide[i], self.depth[i])):
            yield "not finite"
            return
        beyond = [j for j in np.argsort(-excess, kind="stable") if excess[j] > 0]
        if beyond:
            far = ", ".join(f"{names[j]} {np.degrees(excess[j]):.3g}°" for j in beyond[:3])
            more = f" and {len(beyond) - 3} more" if len(beyond) > 3 else ""
            yield f"beyond joint limits: {far}{more}"
        if self.slide[i] > self.most_slide:
            yield f"feet slide at {self.slide[i]:.3g} a second, above {self.most_slide:.3g}"
        if self.depth[i] > self.most_depth:
            yield f"goes {self.depth[i]:.3g} below the floor, more than {self.most_depth:.3g}"

    def _words(self) -> Iterator[str]:
        yield some(len(self), "variation")
        yield some(self.motions.rotations.shape[1], "frame")
        if not traced(self.accepted):
            yield f"{int(np.sum(self.accepted))} accepted"


@static("n", "keep_contacts")
def augment(
    motion: Motion,
    key: Key,
    *,
    n: int,
    styles: Sequence[MotionStyle | Motion] | None = None,
    alpha: ArrayLike = (0.8, 1.25),
    time_warp: ScalarLike = 0.15,
    limits: JointLimits | Motion | Sequence[Motion] | None = None,
    keep_contacts: Contacts | bool = True,
) -> Variations:
    """Seeded variations of a clip, each checked.

    O(n·T·J). The same key makes the same variations. Differentiable in motion and styles. Source:
    Eom et al. 2019, §6.2; Wu et al. 2006.

    **Arguments:**

    - ``motion``: one clip, T frames, J joints.
    - ``key``: of JAX's random numbers, ``jax.random.key(0)``.
    - ``n``: how many, at least 1.
    - ``styles``: K manners to mix into its own, or clips to take them from, of the same joints.
    - ``alpha``: the least and the greatest gain of the control layer, f[2]: 1 is the clip's own,
      (1, 1) leaves it.
    - ``time_warp``: w ≥ 0: how much faster and slower it goes here and there; 0 leaves its timing.
    - ``limits``: joint limits that no variation may break, or clean clips to learn them from
      (:func:`jaxmotion.spacetime.learn_limits`); None checks none. The root's do not count.
    - ``keep_contacts``: True finds what touches and lets it stand in every variation; or contacts
      of the motion (under ``jit`` only these); or False, and slides are not checked.

    **Returns:** :class:`Variations`, those that were refused too.
    **Raises:** ``ValueError`` for what is not one finite clip, fewer than one variation, styles or
    limits of other joints, a range that falls, a negative ``time_warp``; at run time if traced.

    **Example:**

        >>> import jax, jaxmotion as jm
        >>> walk, run = (jm.samples.load(name).motion[:48] for name in ("walk", "run"))
        >>> limits = jm.spacetime.learn_limits([walk, run], margin=0.5)
        >>> made = jm.augment(walk, jax.random.key(0), n=4, styles=[run], limits=limits)
        >>> made.motions.rotations.shape, len(made.sound()) + len(made.refused())
        ((4, 48, 22, 4), 4)
    """
    motion = finite_clip("augment", motion, at_run_time=True)
    if not (isinstance(n, (int, np.integer)) and n >= 1):
        raise ValueError(f"augment: n={n}; expected a whole number of at least 1")
    check_kept(motion, keep_contacts, "augment")
    motion, bounds, warp = _ranges(motion, alpha, time_warp)
    known_styles = _styles_of(motion, styles)
    learned = _limits_of(motion, limits)
    contacts = detect(motion) if keep_contacts is True else keep_contacts or None
    if contacts is not None and not contacts.points.num_points:
        contacts = None
    layers = decompose(motion)
    return _augmented(motion, key, int(n), layers, known_styles, bounds, warp, learned, contacts)


class _Draws(NamedTuple):
    """Numbers of every variation, in front of each array."""

    alpha: Array
    shares: Array
    periods: Array
    phases: Array


def _ranges(
    motion: Motion, alpha: ArrayLike, time_warp: ScalarLike
) -> tuple[Motion, Float[Array, "2"], Float[Array, ""]]:
    bounds, warp = known(alpha), known(time_warp)
    if bounds.shape != (2,) or warp.shape != ():
        raise ValueError(
            f"augment: alpha has shape {bounds.shape}, time_warp {warp.shape}; expected two gains, "
            "the least and the greatest, and a number"
        )
    rising = (bounds[0] <= bounds[1]) & (abs(bounds) < np.inf).all()
    message = "augment: alpha must be two finite gains, the lesser first"
    motion = require(motion, ~rising, message, got=alpha)
    message = "augment: time_warp must be 0 or more"
    motion = require(motion, ~((warp >= 0) & (warp < np.inf)), message, got=time_warp)
    return motion, jnp.asarray(alpha, motion.dtype), jnp.asarray(time_warp, motion.dtype)


def _styles_of(motion: Motion, styles: Sequence[MotionStyle | Motion] | None) -> list[MotionStyle]:
    """The clip's own and those given; none where none is given."""
    others = [] if styles is None else list(styles)
    if not others:
        return []
    names, up, kind = motion.skeleton.names, motion.skeleton.up, motion.dtype
    found = [motion_style(motion)]
    stands = found[0].root_upright
    for k, other in enumerate(others):
        style = _style_of(other, stands) if isinstance(other, Motion) else other
        instance_of(f"augment: styles[{k}]", style, MotionStyle, "a MotionStyle or a Motion")
        if (style.joints, style.up) != (names, up):
            raise ValueError(f"augment: styles[{k}] has other joints, or another axis up")
        found.append(jax.tree.map(lambda x: jnp.asarray(x, kind), style))
    turned = jnp.max(jnp.stack([abs(style.root_upright - stands) for style in found]))
    message = "augment: styles of bodies that hold another side up than the motion's"
    return require(found, ~(known(turned) < 1), message)


def _style_of(clip: Motion, stands: Array) -> MotionStyle:
    """Its manner as of a body with that side up."""
    clip = finite_clip("augment", clip, "styles", at_run_time=True)
    return statistics([clip], [np.ones(clip.num_frames)], "recursive", stands)


def _limits_of(
    motion: Motion, limits: JointLimits | Motion | Sequence[Motion] | None
) -> JointLimits | None:
    if limits is None:
        return None
    if not isinstance(limits, JointLimits):
        clips = [limits] if isinstance(limits, Motion) else list(limits)
        if any(clip.skeleton.names != motion.skeleton.names for clip in clips):
            raise ValueError("augment: clips to learn limits from have other joints")
        limits = learn_limits(clips)
    if limits.lower.shape[0] != motion.num_joints:
        raise ValueError(
            f"augment: limits of {limits.lower.shape[0]} joints; expected {motion.num_joints}"
        )
    return limits.astype(motion.dtype)


@compiled
def _augmented(
    motion: Motion,
    key: Key,
    n: int,
    layers: MotionLayers,
    styles: list[MotionStyle],
    bounds: Float[Array, "2"],
    warp: Float[Array, ""],
    limits: JointLimits | None,
    contacts: Contacts | None,
) -> Variations:
    leg = limb_lengths(motion, ContactPoints(motion.skeleton, [0], limbs=[None]))[0]
    floor = _lowest(motion)
    own_slide = jnp.zeros((), motion.dtype) if contacts is None else _slide(motion, contacts)
    draws = _drawn(key, n, len(styles) or 1, bounds)

    def one(draw: _Draws):
        frames = _bent_time(draw, warp, motion)
        varied = _varied(motion, layers, styles, draw, frames)
        planted = None
        if contacts is not None:
            planted = replant(varied, contacts.at_frames(frames))
            varied = cleanup_footskate(varied, planted)
        slide = jnp.zeros((), motion.dtype) if planted is None else _slide(varied, planted)
        excess = _excess(varied, limits)
        depth = jnp.maximum(floor - _lowest(varied), 0)
        return varied.translations, varied.rotations, planted, frames, excess, slide, depth

    made = _in_turn(one, draws, n)
    translations, rotations, planted, frames, excess, slide, depth = made
    most_slide, most_depth = own_slide + _SLIDE * leg, _DEPTH * leg
    accepted = (jnp.max(excess, axis=1) <= 0) & (slide <= most_slide) & (depth <= most_depth)
    return Variations(
        motion.with_transforms(translations, rotations),
        planted, draws.alpha, draws.shares, frames, excess, slide, depth, most_slide, most_depth,
        accepted,
    )  # fmt: skip


def _in_turn(function, draws: _Draws, n: int):
    """The function of every draw, a few at a time; the last few are filled up with the first."""
    size = min(n, _AT_A_TIME)
    index = np.arange(-(-n // size) * size).reshape(-1, size) % n
    found = lax.map(jax.vmap(function), jax.tree.map(lambda x: x[index], draws))
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:n], found)


def _drawn(key: Key, n: int, manners: int, bounds: Float[Array, "2"]) -> _Draws:
    kind = bounds.dtype
    of_offset, of_order, of_periods, of_phases = jax.random.split(key, 4)
    columns = 1 + manners
    offset = jax.random.uniform(of_offset, (columns,), kind)
    steps = jnp.broadcast_to(jnp.arange(n, dtype=kind)[:, None], (n, columns))
    order = jax.random.permutation(of_order, steps, axis=0, independent=True)
    even = (order + offset) / n
    alpha = bounds[0] + (bounds[1] - bounds[0]) * even[:, 0]
    # The shares of exponential numbers are uniform over the simplex.
    tiny = jnp.finfo(kind).tiny
    weights = -jnp.log(jnp.maximum(even[:, 1:], tiny))
    shares = weights / jnp.maximum(jnp.sum(weights, axis=1, keepdims=True), tiny)
    low, high = (jnp.asarray(np.log(seconds), kind) for seconds in _PERIODS)
    periods = jnp.exp(jax.random.uniform(of_periods, (n, _WAVES), kind, low, high))
    phases = jax.random.uniform(of_phases, (n, _WAVES), kind, 0, 2 * np.pi)
    return _Draws(alpha, shares, periods, phases)


def _bent_time(draw: _Draws, warp: Float[Array, ""], motion: Motion) -> Float[Array, " time"]:
    """u of the module."""
    frames = motion.num_frames
    times = (jnp.arange(max(frames - 1, 0), dtype=motion.dtype) + 0.5) * motion.frame_time
    wave = jnp.cos(2 * np.pi * times[:, None] / draw.periods + draw.phases)
    speed = jnp.exp(jnp.log1p(warp) * jnp.mean(wave, axis=1))
    way = jnp.concatenate([jnp.zeros(1, motion.dtype), jnp.cumsum(speed)])
    return way * ((frames - 1) / jnp.where(way[-1] > 0, way[-1], 1))


def _varied(
    motion: Motion,
    layers: MotionLayers,
    styles: list[MotionStyle],
    draw: _Draws,
    frames: Float[Array, " time"],
) -> Motion:
    """The clip with its numbers drawn, feet as they fall."""
    varied = synthesize(layers, draw.alpha, 1.0)
    if styles:
        joints = motion.num_joints
        below = tuple((np.arange(joints) > body_of(motion)).tolist())
        goal = mixed(styles, draw.shares)
        varied = carried(
            varied, styles[0], goal, joints=below, root=True, deviation="covariance",
            side="right", cap=None,
        )  # fmt: skip
    if motion.num_frames < 2:
        return varied
    reading = even_reading(frames, motion.num_frames, motion.dtype)
    return read_motion(varied, reading, motion.frame_time, signs="nearest")


def _lowest(motion: Motion) -> Float[Array, ""]:
    return jnp.min(forward_kinematics(motion).positions[..., motion.skeleton.up_axis])


def _slide(motion: Motion, contacts: Contacts) -> Float[Array, ""]:
    """Mean speed of points while they are planted, 0 where none is."""
    moved = safe_norm(jnp.diff(contacts.points.positions(motion), axis=0))
    planted = contacts.mask[1:] & contacts.mask[:-1]
    count = jnp.sum(planted).astype(motion.dtype)
    total = jnp.sum(jnp.where(planted, moved, 0))
    return total / (jnp.maximum(count, 1) * motion.frame_time)


def _excess(motion: Motion, limits: JointLimits | None) -> Float[Array, " joint"]:
    if limits is None:
        return jnp.zeros(motion.num_joints, motion.dtype)
    most = jnp.max(jnp.abs(limits.excess(motion.rotations)), axis=(0, 2))
    return jnp.where(np.arange(motion.num_joints) > body_of(motion), most, 0)
