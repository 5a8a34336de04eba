"""Footskate cleanup in five steps (Kovar, Schreiner & Gleicher 2002), for any two-bone limbs.

Each limb n has an end (ankle) at x with world rotation R, and two anchors that may be planted: the
contact points on the end itself (heel, A) and those on joints below it (ball and toes, B; the mean
of the planted ones), at a_A, a_B in the end's frame.

1. Places. An anchor's contact has its target g; while the other anchor is down, an anchor that
   comes down later is moved towards or away from it so that their distance is the foot's
   (:mod:`jaxmotion.contacts.distances`).
2. Ankles. Both down: R′ = arc(R(a_B − a_A) → g_B − g_A) R, x′ the mean of g − R′a. One down: R′
   takes over the turn of the nearest frame with both, faded; x′ = g − R′a.
3. Root. Least shift Δ that puts every planted x′ within reach of its limb: nearest point of the
   intersection of balls about x′ − hip (Dykstra's projections), smoothed over time.
4. Limbs. :func:`~jaxmotion.contacts.limb_ik` from the shifted hip to x′; R′ for the foot.
5. Frames between contacts inherit x′ − (x + Δ) and the turn R′R⁻¹ from the contacts on both sides,
   faded by α(k/min(F + 1, gap)), α(t) = 2t³ − 3t² + 1, F frames; feet below a ``floor`` are lifted.

Where nothing is inherited the limb is untouched, bit for bit. Contradictory contacts (targets that
no shift of the root can bring within reach together) get the nearest pose that the limbs allow.
Differentiable in motion and targets; masks pass no gradient. T frames, C points, O(T·(J + C)).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxmotion._checks import counted, one_number, require, traced
from jaxmotion._entry import finite_clip
from jaxmotion._file_facts import compiled
from jaxmotion._numerics import safe_norm
from jaxmotion._program import keepable
from jaxmotion._room import room_for
from jaxmotion._types import ScalarLike
from jaxmotion.contacts.contact import Contacts, Limb, check_frames, over_time
from jaxmotion.contacts.distances import move_later
from jaxmotion.contacts.limb_ik import LimbTurn, bend_axis, limb_ik
from jaxmotion.contacts.nearby import contacts_near, floor_near, motion_near, origin_of
from jaxmotion.frames.count import frame_mask
from jaxmotion.frames.runs import spread
from jaxmotion.kinematics import WorldPose, forward_kinematics
from jaxmotion.motion import Motion
from jaxmotion.quaternion import conjugate, exp, log, multiply, rotate
from jaxmotion.quaternion.arcs import shortest_arc
from jaxmotion.skeleton import Skeleton
from jaxmotion.smoothing.low_pass import low_pass

_REACH = 0.995  # of full length, or what the clip itself uses if that is more
_CYCLES, _ROUNDS = 24, 6
_CUTOFF = 3.0  # hertz, of the root's shift


class _Feet(NamedTuple):
    """Static: ``limbs`` (N, 3) joints; ``anchors`` bool(N, 2, C): which points make each anchor."""

    limbs: tuple[Limb, ...]
    anchors: tuple[tuple[tuple[bool, ...], ...], ...]


def cleanup_footskate(
    motion: Motion,
    contacts: Contacts,
    *,
    stretch: float = 0.0,
    fade: ScalarLike = 0.15,
    floor: ScalarLike | None = None,
    length: ScalarLike | None = None,
) -> Motion:
    """Put planted points at their targets by moving legs and root, and blend in between.

    Kovar, Schreiner & Gleicher 2002; the module has the steps.

    **Arguments:** ``motion``: one clip, T frames, J joints; ``contacts``: of the motion itself
    (:func:`detect`), or of the motion it was edited from; ``stretch``: share by which bones may
    change length, static, which keeps nearly straight knees from snapping (Kovar: up to 0.026; 0
    keeps all bones, and a file needs position channels for anything else); ``fade``: seconds over
    which corrections fade between contacts; ``floor``: height below which no contact point may go,
    file unit; ``length``: number of frames that count, the first ones.
    **Returns:** a motion of the same shape; the one given if there are no points.
    **Raises:** ``ValueError`` when the contacts have another number of frames, a point hangs from
    no two-bone limb, two limbs share a joint, the stretch is traced or below 0, the fade is below
    0, or the length is outside 1 to T; at run time for such a fade or length that is traced.
    """
    check_frames(motion, contacts, "cleanup_footskate")
    if traced(stretch) or not (np.shape(stretch) == () and stretch >= 0):
        raise ValueError(
            f"cleanup_footskate: stretch={stretch}; expected a share of 0 or more, not traced"
        )
    seconds = one_number("cleanup_footskate: fade", fade)
    message = "cleanup_footskate: fade must be 0 seconds or more"
    motion = require(motion, ~(seconds >= 0), message, got=fade)
    feet = _feet_of(motion.skeleton, contacts)
    if not feet.limbs:
        return motion
    kind = motion.dtype
    count, motion = counted("cleanup_footskate: length", length, motion.num_frames, motion)
    finite_clip("cleanup_footskate", motion, length=length)
    level = None if floor is None else jnp.asarray(floor, kind)
    stretched = None if stretch == 0 else jnp.asarray(stretch, kind)
    room = room_for(motion, contacts, fade, level, length=length)
    filled = room.fill(motion), room.fill(contacts, over_time)
    return room.cut(_cleanup(*filled, feet, stretched, jnp.asarray(fade, kind), level, count))


def _feet_of(skeleton: Skeleton, contacts: Contacts) -> _Feet:
    for name, limb in zip(contacts.names, contacts.limbs, strict=True):
        if limb is None:
            raise ValueError(
                f"cleanup_footskate: {name!r} hangs from no two-bone limb; leave the point out or "
                "give its limb to ContactPoints(limbs=...)"
            )
    limbs = tuple(sorted({limb for limb in contacts.limbs if limb is not None}))
    used = [j for limb in limbs for j in limb]
    if len(set(used)) < len(used):
        shared = skeleton.names[next(j for j in used if used.count(j) > 1)]
        raise ValueError(f"cleanup_footskate: {shared!r} belongs to two limbs; expected one")
    anchors = tuple(
        tuple(
            tuple(
                owner == limb and (joint == limb[2]) == (part == 0)
                for owner, joint in zip(contacts.limbs, contacts.joints, strict=True)
            )
            for part in (0, 1)
        )
        for limb in limbs
    )
    return _Feet(limbs, anchors)


@keepable
@compiled
def _cleanup(given, contacts, feet: _Feet, stretch, fade, floor, count) -> Motion:
    origin = origin_of(given)
    motion, contacts = motion_near(given, origin), contacts_near(contacts, origin)
    floor = floor_near(given, origin, floor)
    pose = forward_kinematics(motion)
    joints = np.array(feet.limbs)
    counts = frame_mask(count, motion.num_frames)
    reach_of_fade = fade / motion.frame_time
    ankle = pose.positions[:, joints[:, 2]]
    turns = pose.rotations[:, joints[:, 2]]
    body = _in_end_frames(motion, pose, contacts)
    weights = jnp.asarray(np.array(feet.anchors, np.float32), motion.dtype)
    planted = contacts.mask & counts[:, None]
    on, at, goal = _anchors(weights, planted, body, contacts.target)
    goal = move_later(on, goal, safe_norm(at[:, :, 1] - at[:, :, 0]))
    both, any_on = on.all(-1), on.any(-1)
    turn = shortest_arc(rotate(turns, at[:, :, 1] - at[:, :, 0]), goal[:, :, 1] - goal[:, :, 0])
    turn = exp(spread(jnp.where(both[..., None], log(turn), 0), both, reach_of_fade))
    turned = multiply(turn, turns)
    held = goal - rotate(turned[:, :, None], at)
    share = on.astype(motion.dtype)
    share = share / jnp.maximum(jnp.sum(share, -1, keepdims=True), 1)
    wanted = jnp.where(any_on[..., None], jnp.sum(share[..., None] * held, 2), ankle)
    most = 1.0 if stretch is None else 1 + stretch
    shift = _root_shift(motion, pose, joints, wanted, any_on, most, reach_of_fade, counts)
    base = ankle + shift[:, None]
    away = spread(jnp.where(any_on[..., None], wanted - base, 0), any_on, reach_of_fade)
    if floor is not None:
        away = _lifted(motion, contacts, feet, base + away, turned, body, any_on, away, floor)
    solved = _solve(pose, joints, shift, base + away, stretch, counts)
    moved = jnp.any(away != 0, -1) | jnp.any(turn[..., 1:] != 0, -1)
    return _assemble(given, pose, joints, shift, solved, turned, moved, stretch is not None)


def _in_end_frames(motion: Motion, pose: WorldPose, contacts: Contacts):
    """The contact points in their limbs' end frames, f[T, C, 3]."""
    ends = np.array([limb[2] for limb in contacts.limbs if limb is not None])
    index = np.asarray(contacts.joints)
    offset = rotate(pose.rotations[:, index], contacts.point.astype(motion.dtype))
    apart = pose.positions[:, index] + offset - pose.positions[:, ends]
    return rotate(conjugate(pose.rotations[:, ends]), apart)


def _anchors(weights, planted, body, target):
    """(on bool[T, N, 2], point in the end's frame f[T, N, 2, 3], target f[T, N, 2, 3])."""
    share = weights * planted[:, None, None, :].astype(weights.dtype)
    total = jnp.sum(share, -1, keepdims=True)
    share = share / jnp.where(total > 0, total, 1)
    at, goal = (jnp.einsum("tnkc,tcx->tnkx", share, x) for x in (body, target))
    return total[..., 0] > 0, at, goal


def _root_shift(motion, pose, joints, wanted, planted, most, reach_of_fade, counts):
    """Step 3: f[T, 3]. Smooth rounds keep limbs a little short of full length; what they leave, if
    it is beyond full length, a last round takes as it is."""
    hip, knee, ankle = (pose.positions[:, joints[:, k]] for k in range(3))
    full = most * (safe_norm(knee - hip) + safe_norm(ankle - knee))
    usual = jnp.clip(safe_norm(ankle - hip), _REACH * full, full)
    anywhere = planted.any(-1)[:, None]

    def add(shift, last):
        reach = jnp.where(last, full, usual)
        more = _nearest(shift, wanted - hip, reach, planted) - shift
        if motion.num_frames < 3:
            return shift + more, None
        wide = spread(more[:, None], anywhere, reach_of_fade)[:, 0]
        smooth = low_pass(wide, _CUTOFF, motion.frame_time, counts)
        return shift + jnp.where(last, more, smooth), None

    rounds = np.arange(_ROUNDS + 1) == _ROUNDS
    return jax.lax.scan(add, jnp.zeros_like(hip[:, 0]), rounds)[0]


def _nearest(x, center, reach, planted):
    """The point nearest to x in all balls of the planted limbs; a mean of the balls' nearest points
    if they have none in common (Dykstra's algorithm for the product of the balls)."""
    share = planted.astype(x.dtype)
    share = (share / jnp.maximum(jnp.sum(share, -1, keepdims=True), 1))[..., None]
    anywhere = planted.any(-1, keepdims=True)

    def cycle(state, _):
        x, past = state
        start = x[:, None] + past
        line = start - center
        length = safe_norm(line)
        far = (length > reach)[..., None]
        scale = (reach / jnp.where(length > 0, length, 1))[..., None]
        moved = jnp.where(far, center + line * scale, start)
        return (jnp.where(anywhere, jnp.sum(share * moved, 1), x), start - moved), None

    return jax.lax.scan(cycle, (x, jnp.zeros_like(center)), None, length=_CYCLES)[0][0]


def _lifted(motion, contacts, feet, ankle, turned, body, planted, away, floor):
    """Step 5: feet in the air raised by how far their lowest point is below the floor."""
    up = motion.skeleton.up_axis
    owner = np.array([feet.limbs.index(limb) for limb in contacts.limbs])
    points = ankle[:, owner] + rotate(turned[:, owner], body)
    depth = jnp.maximum(floor - points[..., up], 0)
    deepest = jnp.stack(
        [jnp.max(depth[:, owner == n], axis=1) for n in range(len(feet.limbs))], axis=1
    )
    return away.at[..., up].add(jnp.where(planted, 0, deepest))


def _solve(pose, joints, shift, target, stretch, counts) -> LimbTurn:
    """Step 4; a limb's hinge is the mean over the frames that count."""
    hip, knee, ankle = (pose.positions[:, joints[:, k]] + shift[:, None] for k in range(3))
    thigh = pose.rotations[:, joints[:, 0]]
    bend, noise = bend_axis(knee - hip, ankle - knee)
    bend, noise = (
        jnp.sum(jnp.where(counts[:, None, None], x, 0), axis=0)
        for x in (rotate(conjugate(thigh), bend), noise)
    )
    length = safe_norm(bend, keepdims=True)
    known = length > noise
    hinge = rotate(thigh, jnp.where(known, bend / jnp.where(known, length, 1), 0))
    return limb_ik(
        hip, knee, ankle, target, hinge=hinge, stretch=0.0 if stretch is None else stretch
    )


def _assemble(motion, pose, joints, shift, solved, turned, moved, stretched: bool) -> Motion:
    """Local transforms from the turned limbs; joints between a limb's three turn along."""
    world, parents = pose.rotations, np.asarray(motion.skeleton.parents)
    first, middle, end = joints.T

    def kept(joint, local):
        return jnp.where(moved[..., None], local, motion.rotations[:, joint])

    def under(turn, joint):
        return conjugate(multiply(turn, world[:, parents[joint]]))

    hip = multiply(conjugate(world[:, parents[first]]), multiply(solved.root, world[:, first]))
    knee = multiply(under(solved.root, middle), multiply(solved.middle, world[:, middle]))
    foot = multiply(under(solved.middle, end), turned)
    rotations = motion.rotations.at[:, first].set(kept(first, hip))
    rotations = rotations.at[:, middle].set(kept(middle, knee))
    rotations = rotations.at[:, end].set(kept(end, foot))
    translations = motion.translations.at[:, 0].add(shift)
    moving = set(motion.translated_joints) | {0}
    if stretched:
        scale = jnp.where(moved, solved.scale, 1)[..., None]
        for joint in (middle, end):
            stretched_bones = scale * translations[:, joint]
            translations = translations.at[:, joint].set(stretched_bones)
        moving |= {int(j) for j in (*middle, *end)}
    return motion.replace(
        translations=translations, rotations=rotations, translated_joints=tuple(sorted(moving))
    )
