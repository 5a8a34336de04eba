"""Make a motion keep its contacts, joint limits and floor by a change that is small and smooth.

    minimise over delta:  1/2 sum_t [ a |y_c - goal_c|^2/L^2 + b depth^2/L^2 + e excess^2
                                      + W_j |delta_t|^2 + s W_j |delta''_t|^2 ]

delta: displacement of the root and of all joints above a contact point (rotation vectors in the
joints' own frames); y_c: contact points; goal: :mod:`jaxmotion.spacetime.goals`; delta'': second
difference over frame_time^2. Three ways:

    "gauss_newton"   the minimum of the above                        (:mod:`.gauss_newton`)
    "bounds"         the minimum with excess = 0, joint limits never crossed      (:mod:`.bounds`)
    "hierarchical"   B-splines with ever finer knots through poses that meet the constraints frame
                     by frame: no weight between smoothness and contacts    (:mod:`.hierarchical`)

Joints above no contact point move only where ``joint_limits`` want it, each by itself. Joints above
one that never turn in the clip (a static root, bones without channels) do not start to, by more
than rounding, unless the whole clip is still.

Shapes: motion T frames, C contact points. Source: Gleicher, *Retargetting motion to new characters*
(1998) for the form; Eom, Choi and Noh (2019), Eq. 18, for its place after an edit.

Nothing jumps where a contact begins or ends: the change delta has a bounded second difference, so
it leaves and joins the motion as a spline does, over (bend/size)^(1/4) seconds. A ramp is only
needed where bend is small, and has a price: the heel's ramp pulls while the ball is held, and both
cannot have their way.

Sharp bits: constraints are soft, and weights say how soft. With the default ones reachable targets
are met to some 1e-4 of a limb's length (heel and ball of one foot are reachable together where
their targets are as far apart as they are: :func:`jaxmotion.contacts.fit_distances`); targets out
of reach, or that contradict each other, get the compromise of least squares, which
``report.position_error`` shows. Contacts are held while ``mask`` is set; ``ramp`` lies outside.
"""

from collections.abc import Sequence
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmotion._checks import counted, one_of, poisoned, raise_faults, static
from jaxmotion._entry import finite_clip
from jaxmotion._file_facts import compiled
from jaxmotion._portable import Portable
from jaxmotion._program import keepable
from jaxmotion._room import Room
from jaxmotion._types import ScalarLike
from jaxmotion.contacts import ContactPoints, Contacts
from jaxmotion.contacts.contact import check_frames
from jaxmotion.contacts.detect import mean_limb_lengths
from jaxmotion.contacts.nearby import contacts_near, floor_near, motion_near, moved_as, origin_of
from jaxmotion.frames.count import frame_mask
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton
from jaxmotion.spacetime.bounds import bounded, boxed
from jaxmotion.spacetime.gauss_newton import cost, gauss_newton
from jaxmotion.spacetime.hierarchical import hierarchical
from jaxmotion.spacetime.joint_limits import JointLimits
from jaxmotion.spacetime.prior import Prior
from jaxmotion.spacetime.problem import Problem, active_joints, restrict
from jaxmotion.spacetime.report import Report, Solution, cut, report_of, roomy
from jaxmotion.spacetime.terms.contacts import contact_term
from jaxmotion.spacetime.terms.floor import FloorTerm
from jaxmotion.spacetime.terms.limits import LimitTerm
from jaxmotion.spacetime.terms.term import Term

_FIRM = 1e4
_STEPS = {"gauss_newton": 64, "hierarchical": 0, "bounds": 2000}


class Weights(Portable):
    """What counts how much; numbers or traced scalars, not negative, ``size`` and
    ``bend`` positive.

    **Fields:**

    - ``position``, ``floor``: of a miss by one limb's length (the mean of the points' limbs);
      ``limits``: of one radian beyond; no unit.
    - ``size``: of turning one joint by one radian in one frame; no unit.
    - ``bend``: of accelerating that turn by one rad/s^2; s^4. (bend/size)^(1/4) is the time in
      which a change fades in and out, seconds.
    - ``root``: how much more moving the root (by one limb's length) or turning it counts; no unit.
    """

    position: ScalarLike = 1.0
    floor: ScalarLike = 1.0
    limits: ScalarLike = 1.0
    size: ScalarLike = 1e-6
    bend: ScalarLike = 1e-6 * 0.12**4
    root: ScalarLike = 4.0


@static("max_steps", "throw")
def satisfy(
    motion: Motion,
    contacts: Contacts,
    *,
    joint_limits: JointLimits | None = None,
    floor: ScalarLike | None = None,
    weights: Weights | None = None,
    ramp: ScalarLike = 0.0,
    method: Literal["gauss_newton", "hierarchical", "bounds"] = "gauss_newton",
    tolerance: float = 1e-5,
    max_steps: int | None = None,
    length: ScalarLike | None = None,
    throw: bool = False,
) -> tuple[Motion, Report]:
    """The motion, moved so that it keeps its contacts.

    **Arguments:** ``motion``: one clip, T frames, J joints; ``contacts``: T frames, C points, C = 0
    allowed, targets in the motion's unit; ``joint_limits``: of all J joints, radians; ``floor``: a
    height, file unit, no contact point shall be below; ``weights``: :class:`Weights`; ``ramp``:
    seconds over which a contact's pull comes and goes, before and after it (the module says why
    none by default); ``method``: the module's three ways; ``tolerance``: radians, the iteration
    stops after a step shorter than that; ``max_steps``: 64 by default, and 2000 of L-BFGS-B for
    "bounds"; ``length``: number of frames that count, the first ones, for padded clips (what comes
    out beyond means nothing; not for "hierarchical", whose knots span the clip); ``throw``: whether
    not coming to rest in them is an error (else look at ``converged`` of the report).
    **Returns:** the motion (joints that nothing is asked of bit for bit as they were) and a
    :class:`Report`. Differentiable in motion, targets, limits, floor and weights, in both modes,
    but for "bounds", whose differentiation is an error.
    **Raises:** ``ValueError`` for shapes and options that do not fit, or a length outside 1 to T;
    at run time for a traced length, for targets in contact, or a motion, that are not finite, and
    as ``throw`` says.

    Source: Gleicher 1998; Lee and Shin 1999 for "hierarchical"; Byrd et al. 1995 for "bounds".
    """
    one_of("satisfy: method", method, _STEPS)
    check_frames(motion, contacts, "satisfy")
    if bad := [j for j in contacts.joints if j >= motion.num_joints]:
        raise ValueError(
            f"satisfy: contacts name joint {bad[0]}; the motion has {motion.num_joints} joints"
        )
    if joint_limits is not None and joint_limits.lower.shape[0] != motion.num_joints:
        raise ValueError(
            f"satisfy: joint_limits has {joint_limits.lower.shape[0]} joints, the motion "
            f"{motion.num_joints}"
        )
    count, room = None, Room(motion.num_frames)
    if length is not None:
        if method == "hierarchical":
            raise ValueError('satisfy: method="hierarchical" takes no length; cut the clip instead')
        count, motion = counted("satisfy: length", length, motion.num_frames, motion)
    finite_clip("satisfy", motion, length=count)
    if length is None and method == "gauss_newton":
        room, motion, contacts = roomy(motion, contacts, joint_limits, floor, weights, ramp)
        count = None if room.length is None else jnp.asarray(room.length, jnp.int32)
    dtype = motion.dtype
    weights = Weights() if weights is None else weights
    weights = Weights(**{name: jnp.asarray(x, dtype) for name, x in vars(weights).items()})
    answer, report = _satisfy(
        motion.astype(dtype),
        contacts,
        None if joint_limits is None else joint_limits.astype(dtype),
        None if floor is None else jnp.asarray(floor, dtype),
        weights,
        jnp.asarray(ramp, dtype),
        count,
        method,
        float(tolerance),
        _STEPS[method] if max_steps is None else int(max_steps),
    )
    answer, report = cut(room, answer, report)
    if not throw:
        return answer, report
    message = "satisfy: not at rest when its steps were used up; give more, or a larger tolerance"
    return raise_faults((answer, report), [(~report.converged, message)])


@keepable
@compiled
def _satisfy(given, contacts, limits, floor, weights, ramp, count, method, tolerance, max_steps):
    if count is not None:
        given, contacts = _held(given, count), _only(contacts, count)
    origin = origin_of(given)
    motion, floor = motion_near(given, origin), floor_near(given, origin, floor)
    target = contacts_near(contacts, origin).target
    bad = ~jnp.all(jnp.isfinite(target) | ~contacts.mask[..., None])
    odd = ~jnp.all(jnp.isfinite(motion.rotations)) | ~jnp.all(jnp.isfinite(motion.translations))
    faults = [
        (bad, "satisfy: contacts hold targets that are not finite where mask is set"),
        (odd, "satisfy: the motion holds values that are not finite"),
    ]
    target = raise_faults(jnp.where(contacts.mask[..., None], target, 0), faults)
    terms: list[Term] = []
    if contacts.num_points:
        terms.append(contact_term(motion, contacts, target, weights.position, ramp))
        if floor is not None:
            terms.append(FloorTerm(floor, jnp.sqrt(weights.floor)))
    if limits is not None:
        terms.append(LimitTerm(limits, jnp.sqrt(weights.limits)))
    prior = Prior(weights.size, weights.bend / motion.frame_time**4, count)
    how = method, tolerance, max_steps
    answer, solution = meet(motion, contacts.points, terms, prior, weights.root, *how)
    report = report_of(answer, contacts.points, terms, count, solution)
    # Steps that are not finite are not taken: of a fault nothing is seen in the answer.
    return poisoned((moved_as(given, motion, answer), report), faults)


def _held(motion: Motion, count: Int[Array, ""]) -> Motion:
    """The motion that stands still from the last frame that counts on, whatever it held."""
    frame = jnp.minimum(np.arange(motion.num_frames, dtype=count.dtype), count - 1)
    translations, rotations = jnp.asarray(motion.translations), jnp.asarray(motion.rotations)
    return motion.with_transforms(translations[frame], rotations[frame])


def _only(contacts: Contacts, count: Int[Array, ""]) -> Contacts:
    """The contacts of the frames that count."""
    counts = frame_mask(count, contacts.num_frames)
    return eqx.tree_at(lambda c: c.mask, contacts, contacts.mask & counts[:, None])


def meet(
    motion: Motion,
    points: ContactPoints,
    terms: Sequence[Term],
    prior: Prior,
    root: Float[Array, ""],
    *how,
) -> tuple[Motion, Solution]:
    """The clip moved so that it meets the terms. ``root``: as of :class:`Weights`; ``how``: method,
    tolerance, most steps."""
    active = active_joints(motion.skeleton.parents, points.joints)
    moved, solution = _solve(problem_of(motion, points, terms, prior, root), *how)
    rotations = motion.rotations.at[:, np.asarray(active)].set(moved.rotations)
    loose = tuple(j for j in range(motion.num_joints) if j not in active)
    alone = [term for term in terms if term.asks_each_joint]
    if alone and loose:
        turned, each = _solve_alone(motion, loose, alone, prior, *how)
        rotations = rotations.at[:, np.asarray(loose)].set(turned)
        solution = Solution(
            solution.before + jnp.sum(each.before),
            solution.after + jnp.sum(each.after),
            jnp.maximum(solution.steps, jnp.max(each.steps)),
            solution.converged & jnp.all(each.converged),
        )
    translations = motion.translations.at[:, 0].set(moved.translations[:, 0])
    return motion.with_transforms(translations, rotations), solution


def _solve(problem: Problem, method, tolerance, max_steps) -> tuple[Motion, Solution]:
    """The clip of the problem's joints, by one of the methods."""
    if not problem.terms:
        none = jnp.zeros((), problem.unmoved.dtype)
        return problem.start, Solution(none, none, jnp.zeros((), jnp.int32), jnp.asarray(True))
    if method == "hierarchical":
        z, steps, converged = hierarchical(problem)
    else:
        most = min(max_steps, _STEPS["gauss_newton"]) if method == "bounds" else max_steps
        z, steps, converged = gauss_newton(problem, tolerance, most)
    if method == "bounds":
        box, free = boxed(problem)
        if box is not None:
            z, steps, converged = bounded(free, box, z, tolerance, max_steps)
    before, after = jax.vmap(cost, (0, None))(jnp.stack([problem.unmoved, z]), problem)
    steps = steps.astype(jnp.int32)
    return problem.motion(z), Solution(before, after, steps, converged)


def problem_of(
    motion: Motion,
    points: ContactPoints,
    terms: Sequence[Term],
    prior: Prior,
    root: Float[Array, ""],
) -> Problem:
    """What the terms ask of the joints above the points."""
    active = active_joints(motion.skeleton.parents, points.joints)
    start = restrict(motion, active)
    length = jnp.ones((), motion.dtype)
    if points.num_points:
        count = jnp.asarray(motion.num_frames, int) if prior.count is None else prior.count
        counts = frame_mask(count, motion.num_frames)
        length = jnp.mean(mean_limb_lengths(motion, points, counts))
    rooted = jnp.broadcast_to(jnp.sqrt(root), (6,))
    stiffness = jnp.concatenate([rooted, jnp.ones((3 * len(active) - 3,), motion.dtype)])
    return Problem(
        start=start,
        joints=tuple(active.index(j) for j in points.joints),
        point=jnp.asarray(points.point, motion.dtype),
        length=jnp.where(length > 0, length, 1),
        stiffness=stiffness.at[3:].multiply(jnp.repeat(_firmness(start), 3)),
        prior=prior,
        terms=tuple(term.within(active) for term in terms),
    )


def _firmness(motion: Motion) -> Float[Array, " joint"]:
    """1 for joints that turn at some time in the clip, a large number for others."""
    q = motion.rotations
    turned = jnp.max(jnp.abs(q - q[:1]), axis=(0, 2)) > float(jnp.finfo(q.dtype).eps) ** 0.5
    firm = jnp.asarray(_FIRM, q.dtype)
    return jnp.where(turned | ~jnp.any(turned), jnp.ones_like(firm), firm)


def _solve_alone(motion, joints, terms, prior, *how) -> tuple[Array, Solution]:
    """Rotations of joints above no point, each by itself as the terms ask."""

    def one(q, joint):
        own = tuple(term.within(joint[None]) for term in terms)
        moved, solution = _solve(_pose_alone(motion, q[:, None], own, prior), *how)
        return moved.rotations[:, 0], solution

    rows = np.asarray(joints)
    return jax.vmap(one, (1, 0), (1, 0))(motion.rotations[:, rows], jnp.asarray(rows))


def _pose_alone(motion, q, terms, prior) -> Problem:
    """One joint that no point asks anything of."""
    dtype, frames = motion.dtype, motion.num_frames
    skeleton = Skeleton(["joint"], [-1], jnp.zeros((1, 3), dtype), up=motion.skeleton.up)
    return Problem(
        start=Motion(skeleton, jnp.zeros((frames, 1, 3), dtype), q, motion.frame_time),
        joints=(),
        point=jnp.zeros((0, 3), dtype),
        length=jnp.ones((), dtype),
        stiffness=jnp.ones((6,), dtype),
        prior=prior,
        terms=terms,
    )
