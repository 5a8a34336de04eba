"""Style transfer: a motion in another's manner (Wu et al. 2006).

Source and reference are set beside each other in time (:mod:`.correspondence`), their statistics
taken (:mod:`.statistics`), and every joint of the source and its root get the reference's
(:mod:`.carry`); then planted feet are put where they stand (``contacts.cleanup_footskate``). The
result has the source's frames, place and contacts. O(T·J) but for the warp.

What statistics carry is posture, how far joints and root go, how fast the body goes and turns, and,
if asked, how fast all of it is done. What they do not is timing within a cycle, and which joints
move together: those are the source's.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxmotion import quaternion
from jaxmotion._checks import instance_of, one_number, one_of, require, static
from jaxmotion._entry import finite_clip
from jaxmotion._file_facts import compiled
from jaxmotion._plain import quoted
from jaxmotion._portable import Portable
from jaxmotion._posture import upright
from jaxmotion._room import room_for
from jaxmotion._summary import some
from jaxmotion._types import ScalarLike
from jaxmotion.contacts import Contacts, cleanup_footskate, detect, replant
from jaxmotion.contacts.contact import check_kept
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton
from jaxmotion.style.carry import carried, how_much_longer, ratio
from jaxmotion.style.correspondence import Warp, corresponding, strides, without_room
from jaxmotion.style.root import Start, encode
from jaxmotion.style.statistics import MEANS, STILL, Mean, MotionStyle, mixed, of_one, statistics
from jaxmotion.timing import MotionWarp

Deviation: TypeAlias = Literal["scalar", "covariance"]
Side: TypeAlias = Literal["right", "left"]
Match: TypeAlias = Literal["skeleton", "names"]
_Body: TypeAlias = tuple[Float[Array, "time 6"], Start]


class StyleReport(Portable):
    """What a transfer did to the source's joints.

    **Fields:** ``joints``: J names, static; ``turned``: f[J], radians between the means of source
    and result; ``ratio``: f[J], what deviations were multiplied by (of "covariance" the ratio of
    the deviations); ``still``: bool[J], joints that the source holds still, so that no deviation
    was there to be multiplied; ``longer``: f[], what the frame time was multiplied by; ``left``:
    the joints that were left as they were, static.
    """

    joints: tuple[str, ...] = eqx.field(static=True)
    turned: Float[Array, " joint"]
    ratio: Float[Array, " joint"]
    still: Bool[Array, " joint"]
    longer: Float[Array, ""]
    left: tuple[str, ...] = eqx.field(static=True)

    def _words(self):
        yield some(len(self.joints), "joint")
        yield f"{len(self.left)} left"


class StyleTransfer(Portable):
    """A motion in another manner.

    **Fields:** ``motion``: the result; ``warp``: how the source was set beside the reference, a
    :class:`~jaxmotion.timing.MotionWarp`, or None; ``source_style``, ``reference_style``: the
    statistics, of the source's joints; ``report``: a :class:`StyleReport`.
    """

    motion: Motion
    warp: MotionWarp | None
    source_style: MotionStyle
    reference_style: MotionStyle
    report: StyleReport

    def _words(self):
        yield some(self.motion.num_frames, "frame")
        yield from self.report._words()


@static("joints", "mean", "deviation", "side", "warp", "root", "tempo", "keep_contacts", "match")
def transfer_style(
    source: Motion,
    reference: Motion,
    *,
    joints: str | Sequence[str] | None = None,
    strength: ScalarLike = 1.0,
    mean: Mean = "recursive",
    deviation: Deviation = "scalar",
    side: Side = "right",
    warp: Warp | None = "shared",
    root: bool = True,
    tempo: bool = False,
    keep_contacts: Contacts | bool = True,
    max_ratio: ScalarLike | None = None,
    match: Match = "skeleton",
) -> StyleTransfer:
    """What the source does in the manner of the reference.

    O(T·J) but for the warp, which is O(T_s T_r) up to 2048 frames and takes every k-th of more.
    Differentiable by both motions; the warp passes no derivative. Source: Wu et al. 2006.

    **Arguments:**

    - ``source``, ``reference``: clips of one skeleton (bone lengths may differ), of any lengths.
    - ``joints``: names or shell patterns of those that change, any case; None for all.
    - ``strength``: 0 leaves the source, 1 is the reference's manner, more exaggerates it, below 0
      leads away from it (:func:`~jaxmotion.style.interpolate`).
    - ``mean``: as :func:`jaxmotion.quaternion.mean`.
    - ``deviation``: "scalar" scales a joint's deviation (the paper's σ), "covariance" each of its
      directions.
    - ``side``: whether deviations keep their axes as the parent sees them, "right", or as the joint
      itself does, "left".
    - ``warp``: "shared" for one warp of all joints, "per_channel" for one each, None for none: then
      every frame counts alike.
    - ``root``: whether the root's path and posture change too, if ``joints`` has it.
    - ``tempo``: whether time is stretched so that joints turn as fast, for how far they go, as the
      reference's: the same frames, of another frame time (:func:`jaxmotion.resample` brings them
      back to a rate). Noise counts as speed: denoise both first.
    - ``keep_contacts``: True finds what touches in the source and lets it stand in the result; or
      contacts of the source (under ``jit`` only these); or False.
    - ``max_ratio``: the most that a deviation may be multiplied by, > 0.
    - ``match``: "names" changes the joints that the reference has by name, and leaves the others;
      "skeleton" wants the same joints.

    **Returns:** :class:`StyleTransfer`; its motion has the source's frames and, without ``tempo``,
    its frame time.
    **Raises:** ``ValueError`` for unknown options, skeletons that differ, patterns that match
    nothing, clips that are not finite (at run time where they are traced), and a cap that is not
    above 0.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk, run = (jm.samples.load(name).motion[:48] for name in ("walk", "run"))
        >>> result = jm.style.transfer_style(walk, run, keep_contacts=False)
        >>> style = jm.style.motion_style(result.motion)
        >>> bool(style.root_mean[0] > 0)
        True
    """
    one_of("transfer_style: warp", warp, ("shared", "per_channel", None))
    source = finite_clip("transfer_style", source, "source", at_run_time=True)
    reference = finite_clip("transfer_style", reference, "reference", at_run_time=True)
    check_kept(source, keep_contacts, "transfer_style")
    theirs = matched("transfer_style", source.skeleton, reference.skeleton, match)
    plan = _planned("transfer_style", source, theirs, joints, deviation, side, root, tempo)
    one_of("transfer_style: mean", mean, MEANS)
    source, amount, cap = _amounts("transfer_style", source, strength, max_ratio)
    given = source, reference, amount, cap
    rooms = room_for(source, given), room_for(reference, given)
    clips = rooms[0].fill(source), rooms[1].fill(reference).astype(source.dtype)
    counts = rooms[0].count, rooms[1].count
    steps = strides(rooms[0].frames, rooms[1].frames)
    found, own, other, body = _compared(*clips, counts, steps, theirs, mean, warp)
    motion, goal, report = _restyled(
        clips[0], counts[0], body, own, other, amount, cap, theirs, plan
    )
    found = None if found is None else without_room(found, rooms, steps, warp)
    motion = _planted(source, rooms[0].cut(motion), keep_contacts, plan)
    return StyleTransfer(motion, found, own, goal, report)


@static("joints", "mean", "deviation", "side", "root", "tempo", "keep_contacts", "match")
def apply_style(
    motion: Motion,
    style: MotionStyle,
    *,
    joints: str | Sequence[str] | None = None,
    strength: ScalarLike = 1.0,
    mean: Mean = "recursive",
    deviation: Deviation = "scalar",
    side: Side = "right",
    root: bool = True,
    tempo: bool = False,
    keep_contacts: Contacts | bool = True,
    max_ratio: ScalarLike | None = None,
    match: Match = "skeleton",
) -> Motion:
    """A motion in a manner that was kept: of no clip, or of many.

    As :func:`transfer_style` without a warp: every frame of the motion counts alike, so where it
    does more of one thing than the style's clips did (waits longer, turns more often), that counts
    as manner too. O(T·J).

    **Arguments:** ``motion``: one clip; ``style``: of :func:`~jaxmotion.style.motion_style`,
    :func:`~jaxmotion.style.interpolate` or a file; ``joints``, ``strength``, ``mean``,
    ``deviation``, ``side``, ``root``, ``tempo``, ``keep_contacts``, ``max_ratio``, ``match``: as
    :func:`transfer_style`.
    **Returns:** a motion of the same frames and, without ``tempo``, frame time.
    **Raises:** as :func:`transfer_style`; ``ValueError`` for another axis up.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk, run = (jm.samples.load(name).motion[:48] for name in ("walk", "run"))
        >>> style = jm.style.motion_style(run)
        >>> calm = jm.style.apply_style(walk, style, strength=-0.5, keep_contacts=False)
        >>> calm.num_frames
        48
    """
    motion = finite_clip("apply_style", motion, at_run_time=True)
    wanted = "a MotionStyle (jaxmotion.style.motion_style makes one)"
    instance_of("apply_style: style", style, MotionStyle, wanted)
    check_kept(motion, keep_contacts, "apply_style")
    theirs = matched("apply_style", motion.skeleton, style, match)
    plan = _planned("apply_style", motion, theirs, joints, deviation, side, root, tempo)
    one_of("apply_style: mean", mean, MEANS)
    motion, amount, cap = _amounts("apply_style", motion, strength, max_ratio)
    kind = motion.dtype
    style = jax.tree.map(lambda x: jnp.asarray(x, kind), style)
    room = room_for(motion, style, amount, cap)
    clip = room.fill(motion)
    own, body = of_one(clip, room.count, mean, style.root_upright)
    edited, _, _ = _restyled(clip, room.count, body, own, style, amount, cap, theirs, plan)
    return _planted(motion, room.cut(edited), keep_contacts, plan)


class _Plan(NamedTuple):
    """Static: which joints change by Eq. 7, whether the body's path and posture do, and how."""

    joints: tuple[bool, ...]
    root: bool
    tempo: bool
    deviation: Deviation
    side: Side


def matched(
    caller: str, skeleton: Skeleton, other: Skeleton | MotionStyle, match: Match
) -> tuple[int, ...]:
    """For each joint the number of the other's joint of that name, -1 for none."""
    one_of(f"{caller}: match", match, ("skeleton", "names"))
    if skeleton.up != other.up:
        raise ValueError(
            f"{caller}: {skeleton.up} up, and the reference {other.up} up; jaxmotion.reorient "
            "turns one of them"
        )
    names = other.names if isinstance(other, Skeleton) else other.joints
    places = {name: place for place, name in enumerate(names)}
    theirs = tuple(places.get(name, -1) for name in skeleton.names)
    if match == "names":
        if max(theirs) < 0:
            raise ValueError(f"{caller}: no joint of the reference has the name of one of these")
        return theirs
    lone = sorted({*skeleton.names} ^ {*names})
    same = isinstance(other, MotionStyle) or all(
        k >= 0 and _parent(skeleton, j) == _parent(other, k) for j, k in enumerate(theirs)
    )
    if lone or not same:
        which = f"only one has {', '.join(map(quoted, lone[:6]))}" if lone else "parents differ"
        raise ValueError(
            f"{caller}: the reference has another skeleton: {which}; match='names' changes the "
            "joints whose names agree"
        )
    return theirs


def _parent(skeleton: Skeleton, joint: int) -> str | None:
    above = skeleton.parents[joint]
    return None if above < 0 else skeleton.names[above]


def _planned(
    caller: str,
    motion: Motion,
    theirs: tuple[int, ...],
    joints: str | Sequence[str] | None,
    deviation: Deviation,
    side: Side,
    root: bool,
    tempo: bool,
) -> _Plan:
    one_of(f"{caller}: deviation", deviation, ("scalar", "covariance"))
    one_of(f"{caller}: side", side, ("right", "left"))
    chosen = selected(motion.skeleton, joints) & (np.array(theirs) >= 0)
    body = motion.body_joint
    below = tuple(bool(on) and j > body for j, on in enumerate(chosen))
    return _Plan(below, root and bool(chosen[body]), tempo, deviation, side)


def selected(skeleton: Skeleton, joints: str | Sequence[str] | None) -> Bool[np.ndarray, " joint"]:
    """Which joints the names or patterns mean."""
    patterns = ("*",) if joints is None else (joints,) if isinstance(joints, str) else joints
    chosen = np.zeros(skeleton.num_joints, bool)
    chosen[list(skeleton.matching(*patterns))] = True
    return chosen


def _amounts(
    caller: str, motion: Motion, strength: ScalarLike, max_ratio: ScalarLike | None
) -> tuple[Motion, Array, Array | None]:
    amount = one_number(f"{caller}: strength", strength)
    message = f"{caller}: strength must be finite"
    motion = require(motion, ~(abs(amount) < np.inf), message, got=strength)
    amount = jnp.asarray(amount, motion.dtype)
    if max_ratio is None:
        return motion, amount, None
    cap = one_number(f"{caller}: max_ratio", max_ratio)
    motion = require(motion, ~(cap > 0), f"{caller}: max_ratio must be above 0", got=max_ratio)
    return motion, amount, jnp.asarray(cap, motion.dtype)


@compiled
def _compared(
    source: Motion,
    reference: Motion,
    counts: tuple[Int[Array, ""], Int[Array, ""]],
    steps: tuple[int, int],
    theirs: tuple[int, ...],
    mean: Mean,
    warp: Warp | None,
) -> tuple[MotionWarp | None, MotionStyle, MotionStyle, _Body]:
    """How they go in time, the manner of each, of its own joints, and the source's body."""
    clips = source, reference
    stands = upright(reference, counts[1])
    bodies = [encode(clip, stands, n) for clip, n in zip(clips, counts, strict=True)]

    def styles(weights):
        each = zip(clips, bodies, weights, counts, strict=True)
        return [statistics([c], [body[0]], [w], [n], mean, stands) for c, body, w, n in each]

    played = styles([jnp.ones(clip.num_frames, clip.dtype) for clip in clips])
    if warp is None:
        return None, played[0], played[1], bodies[0]
    found, *weights = corresponding(source, reference, counts, steps, theirs, warp)
    # A warp bends time: the tempo is that of the clips as they are played.
    own, other = (
        eqx.tree_at(lambda style: style.tempo, style, plain.tempo)
        for style, plain in zip(styles(weights), played, strict=True)
    )
    return found, own, other, bodies[0]


@compiled
def _restyled(
    motion: Motion,
    count: Int[Array, ""],
    body: _Body,
    own: MotionStyle,
    other: MotionStyle,
    amount: Float[Array, ""],
    cap: Float[Array, ""] | None,
    theirs: tuple[int, ...],
    plan: _Plan,
) -> tuple[Motion, MotionStyle, StyleReport]:
    """The motion, the other manner as one of its own joints, and what was done."""
    index, known = np.maximum(theirs, 0), np.array(theirs) >= 0
    goal = MotionStyle(
        own.joints,
        jnp.where(known[:, None], other.mean[index], own.mean),
        jnp.where(known[:, None, None], other.covariance[index], own.covariance),
        other.root_mean,
        other.root_deviation,
        other.root_upright,
        other.tempo,
        up=own.up,
    )
    towards = mixed([own, goal], jnp.stack([1 - amount, amount]))
    chosen = np.array(plan.joints)
    longer = jnp.ones_like(towards.tempo)
    if plan.tempo:
        longer = how_much_longer(own.tempo, towards.tempo)
        motion = motion.replace(frame_time=motion.frame_time * longer)
    edited = carried(
        motion, count, body, own, towards, joints=plan.joints, root=plan.root,
        deviation=plan.deviation, side=plan.side, cap=cap,
    )  # fmt: skip
    turned = jnp.where(chosen, quaternion.distance(own.mean, towards.mean), 0)
    scaled = jnp.where(chosen, ratio(own.deviation, towards.deviation, cap), 1)
    still = jnp.asarray(chosen) & (own.deviation < STILL)
    changed = [on or (plan.root and j == motion.body_joint) for j, on in enumerate(plan.joints)]
    left = tuple(name for name, on in zip(own.joints, changed, strict=True) if not on)
    return edited, goal, StyleReport(own.joints, turned, scaled, still, longer, left)


def _planted(source: Motion, edited: Motion, keep_contacts: Contacts | bool, plan: _Plan) -> Motion:
    """The edit with the source's contacts, where it moves what touches."""
    if keep_contacts is False:
        return edited
    contacts = detect(source) if keep_contacts is True else keep_contacts
    parents, moved = source.skeleton.parents, plan.root
    for joint in contacts.joints:
        while joint >= 0:
            moved |= plan.joints[joint]
            joint = parents[joint]
    return cleanup_footskate(edited, replant(edited, contacts)) if moved else edited
