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

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxmotion._checks import instance_of, known, require, static
from jaxmotion._entry import finite_clip
from jaxmotion._file_facts import compiled
from jaxmotion._numerics import safe_norm
from jaxmotion._program import keepable
from jaxmotion._room import room_for
from jaxmotion._types import ArrayLike, Key, ScalarLike
from jaxmotion.augmentation.draws import Draws, bent_time, drawn
from jaxmotion.augmentation.variations import Variations
from jaxmotion.contacts import (
    ContactPoints,
    Contacts,
    cleanup_footskate,
    detect,
    limb_lengths,
    replant,
)
from jaxmotion.contacts.contact import check_kept, over_time
from jaxmotion.frames.count import frame_mask
from jaxmotion.kinematics import forward_kinematics
from jaxmotion.layers import MotionLayers, decompose, synthesize
from jaxmotion.motion import Motion
from jaxmotion.spacetime import JointLimits, learn_limits
from jaxmotion.style import MotionStyle, motion_style
from jaxmotion.style.carry import carried
from jaxmotion.style.root import encode
from jaxmotion.style.statistics import mixed, of_one
from jaxmotion.timing.resample import even_reading, read_motion

_AT_A_TIME = 8
_SLIDE, _DEPTH = 0.04, 0.02  # of the leg


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
    room = room_for(motion, key, known_styles, bounds, warp, learned, contacts)
    contacts = None if contacts is None else room.fill(contacts, over_time)
    filled = room.fill(motion)
    layers = decompose(filled, length=room.length)
    made = _augmented(
        filled, room.count, key, int(n), layers, known_styles, bounds, warp, learned, contacts
    )
    return room.cut(made, _frame_by_frame, axis=1)


def _frame_by_frame(made: Variations) -> tuple:
    planted = () if made.contacts is None else over_time(made.contacts)
    return made.motions.translations, made.motions.rotations, made.frames, *planted


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
    room = room_for(clip, stands)
    return of_one(room.fill(clip), room.count, "recursive", stands)[0]


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


@keepable
@compiled
def _augmented(
    motion: Motion,
    count: Int[Array, ""],
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
    counts = frame_mask(count, motion.num_frames)
    floor = _lowest(motion, counts)
    own_slide = _slide(motion, contacts, counts)
    draws = drawn(key, n, len(styles) or 1, bounds)

    def one(draw: Draws):
        frames = bent_time(draw, warp, motion, count)
        varied = _varied(motion, count, layers, styles, draw, frames)
        planted = None
        if contacts is not None:
            planted = _at_frames(contacts, frames, counts)
            planted = replant(varied, planted)
            varied = cleanup_footskate(varied, planted, length=count)
        slide = _slide(varied, planted, counts)
        excess = _excess(varied, limits, counts)
        depth = jnp.maximum(floor - _lowest(varied, counts), 0)
        return varied.translations, varied.rotations, planted, frames, excess, slide, depth

    made = _in_turn(one, draws, n)
    translations, rotations, planted, frames, excess, slide, depth = made
    return Variations(
        motion.with_transforms(translations, rotations),
        planted, draws.alpha, draws.shares, frames, excess, slide, depth,
        own_slide + _SLIDE * leg, _DEPTH * leg,
    )  # fmt: skip


def _at_frames(
    contacts: Contacts, frames: Float[Array, " time"], counts: Bool[Array, " time"]
) -> Contacts:
    """The contacts in the bent time, none where frames do not count."""
    bent = contacts.at_frames(frames)
    return eqx.tree_at(lambda x: x.mask, bent, bent.mask & counts[:, None])


def _in_turn(function, draws: Draws, n: int):
    """The function of every draw, a few at a time; the last few are filled up with the first."""
    size = min(n, _AT_A_TIME)
    index = np.arange(-(-n // size) * size).reshape(-1, size) % n
    found = lax.map(jax.vmap(function), jax.tree.map(lambda x: x[index], draws))
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:n], found)


def _varied(
    motion: Motion,
    count: Int[Array, ""],
    layers: MotionLayers,
    styles: list[MotionStyle],
    draw: Draws,
    frames: Float[Array, " time"],
) -> Motion:
    """The clip with its numbers drawn, feet as they fall."""
    varied = synthesize(layers, draw.alpha, 1.0)
    if styles:
        joints = motion.num_joints
        below = tuple((np.arange(joints) > motion.body_joint).tolist())
        goal = mixed(styles, draw.shares)
        body = encode(varied, goal.root_upright, count)
        varied = carried(
            varied, count, body, styles[0], goal, joints=below, root=True, deviation="covariance",
            side="right", cap=None,
        )  # fmt: skip
    if motion.num_frames < 2:
        return varied
    reading = even_reading(frames, motion.num_frames, motion.dtype)
    return read_motion(varied, reading, motion.frame_time, signs="nearest", count=count)


def _lowest(motion: Motion, counts: Bool[Array, " time"]) -> Float[Array, ""]:
    heights = forward_kinematics(motion).positions[..., motion.skeleton.up_axis]
    return jnp.min(jnp.where(counts[:, None], heights, jnp.inf))


def _slide(
    motion: Motion, contacts: Contacts | None, counts: Bool[Array, " time"]
) -> Float[Array, ""]:
    """Mean speed of points while they are planted, 0 where none is."""
    if contacts is None:
        return jnp.zeros((), motion.dtype)
    moved = safe_norm(jnp.diff(contacts.points.positions(motion), axis=0))
    planted = contacts.mask[1:] & contacts.mask[:-1] & counts[1:, None]
    count = jnp.sum(planted).astype(motion.dtype)
    total = jnp.sum(jnp.where(planted, moved, 0))
    return total / (jnp.maximum(count, 1) * motion.frame_time)


def _excess(
    motion: Motion, limits: JointLimits | None, counts: Bool[Array, " time"]
) -> Float[Array, " joint"]:
    if limits is None:
        return jnp.zeros(motion.num_joints, motion.dtype)
    excess = jnp.where(counts[:, None, None], limits.excess(motion.rotations), 0)
    most = jnp.max(jnp.abs(excess), axis=(0, 2))
    return jnp.where(np.arange(motion.num_joints) > motion.body_joint, most, 0)
