"""Make a motion keep its contacts, joint limits and floor by a change that is small and smooth.

    minimise over delta:  1/2 sum_t [ a |y_c - goal_c|^2/L^2 + b depth^2/L^2 + e excess^2
                                      + W_j |delta_t|^2 + s W_j |delta''_t|^2 ]

delta: displacement of the root and of all joints above a contact point (rotation vectors in the
joints' own frames); y_c: contact points; goal: :mod:`jaxmotion.spacetime.goals`; delta'': second
difference over frame_time^2. "gauss_newton" finds the minimum (:mod:`.gauss_newton`).

Shapes: motion T frames, C contact points. Source: Gleicher, *Retargetting motion to new characters*
(1998) for the form; Eom, Choi and Noh (2019), Eq. 18, for its place after an edit.

Sharp bits: constraints are soft, and weights say how soft. With the default ones reachable targets
are met to some 1e-4 of a limb's length; targets out of reach, or that contradict each other, get
the compromise of least squares, which ``report.position_error`` shows. Contacts are held while
``mask`` is set; ``ramp`` lies outside of it.
"""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Bool, Float, Int

from jaxmotion._numerics import raise_faults, safe_norm
from jaxmotion._types import AnyArray, ScalarLike
from jaxmotion.contacts import Contacts, limb_lengths
from jaxmotion.motion import Motion
from jaxmotion.spacetime.gauss_newton import cost, gauss_newton
from jaxmotion.spacetime.goals import ramped_goals
from jaxmotion.spacetime.joint_limits import JointLimits
from jaxmotion.spacetime.prior import Prior
from jaxmotion.spacetime.problem import Problem, active_joints, restrict

_MAX_STEPS = 64


class Weights(eqx.Module):
    """What counts how much; numbers or traced scalars.

    ``position``, ``floor``: of a miss by one limb's length; ``limits``: of one radian beyond;
    ``size``: of turning one joint by one radian in one frame; ``bend``: of accelerating that turn
    by one rad/s^2, its unit s^4: (bend/size)^(1/4) is the time in which a change fades in and out;
    ``root``: how much more moving the root (by one limb's length) or turning it counts.
    """

    position: ScalarLike = 1.0
    floor: ScalarLike = 1.0
    limits: ScalarLike = 1.0
    size: ScalarLike = 1e-4
    bend: ScalarLike = 1e-4 * 0.1**4
    root: ScalarLike = 4.0


class Report(eqx.Module):
    """How well it went.

    **Fields:**

    - ``position_error``: f[T, C], distance to the target in contact, 0 elsewhere; file unit.
    - ``penetration``: f[T, C], depth below the floor, file unit; 0 without a floor.
    - ``limit_excess``: f[T, J], radians beyond the limits; 0 without.
    - ``cost_before``, ``cost``: E of the clip as given, and of the answer.
    - ``num_steps``: iterations; ``result``: an ``optimistix.RESULTS``.
    """

    position_error: Float[AnyArray, "time point"]
    penetration: Float[AnyArray, "time point"]
    limit_excess: Float[AnyArray, "time joint"]
    cost_before: Float[Array, ""]
    cost: Float[Array, ""]
    num_steps: Int[Array, ""]
    result: optimistix.RESULTS

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether the iteration reached its tolerance."""
        return self.result == optimistix.RESULTS.successful


def satisfy(
    motion: Motion,
    contacts: Contacts,
    *,
    joint_limits: JointLimits | None = None,
    floor: ScalarLike | None = None,
    weights: Weights | None = None,
    ramp: ScalarLike = 0.1,
    method: Literal["gauss_newton"] = "gauss_newton",
    tolerance: float = 1e-5,
    max_steps: int = _MAX_STEPS,
) -> tuple[Motion, Report]:
    """The motion, moved so that it keeps its contacts.

    **Arguments:** ``motion``: T frames; ``contacts``: T frames, C points, C = 0 allowed;
    ``joint_limits``: of all joints; ``floor``: a height no contact point shall be below;
    ``weights``: :class:`Weights`; ``ramp``: seconds over which a contact's pull comes and goes,
    before and after it; ``tolerance``: radians, the iteration stops after a step shorter than that.
    **Returns:** the motion (joints above no contact point bit for bit as they were) and a
    :class:`Report`. Differentiable in motion, targets, limits, floor and weights, in both modes.
    **Raises:** ``ValueError`` for shapes and options that do not fit; at run time for targets in
    contact, or a motion, that are not finite.
    """
    if method not in _METHODS:
        raise ValueError(f"satisfy: method={method!r}; expected one of {', '.join(_METHODS)}")
    if motion.rotations.ndim != 3:
        raise ValueError(
            f"satisfy: rotations have shape {motion.rotations.shape}; expected (T, J, 4); "
            "map over batches with jax.vmap"
        )
    if contacts.num_frames != motion.num_frames:
        raise ValueError(
            f"satisfy: contacts have {contacts.num_frames} frames, the motion {motion.num_frames}"
        )
    if bad := [j for j in contacts.joints if j >= motion.num_joints]:
        raise ValueError(
            f"satisfy: contacts name joint {bad[0]}; the motion has {motion.num_joints} joints"
        )
    if joint_limits is not None and joint_limits.lower.shape[0] != motion.num_joints:
        raise ValueError(
            f"satisfy: joint_limits has {joint_limits.lower.shape[0]} joints, the motion "
            f"{motion.num_joints}"
        )
    dtype = motion.dtype
    weights = Weights() if weights is None else weights
    weights = Weights(**{name: jnp.asarray(x, dtype) for name, x in vars(weights).items()})
    return _satisfy(
        motion.astype(dtype),
        contacts,
        None if joint_limits is None else joint_limits.astype(dtype),
        None if floor is None else jnp.asarray(floor, dtype),
        weights,
        jnp.asarray(ramp, dtype),
        method,
        float(tolerance),
        int(max_steps),
    )


_METHODS = ("gauss_newton",)


@eqx.filter_jit
def _satisfy(motion, contacts, limits, floor, weights, ramp, method, tolerance, max_steps):
    target = jnp.asarray(contacts.target, motion.dtype)
    bad = ~jnp.all(jnp.isfinite(target) | ~contacts.mask[..., None])
    odd = ~jnp.all(jnp.isfinite(motion.rotations)) | ~jnp.all(jnp.isfinite(motion.translations))
    faults = [
        (bad, "satisfy: contacts hold targets that are not finite where mask is set"),
        (odd, "satisfy: the motion holds values that are not finite"),
    ]
    target = raise_faults(jnp.where(contacts.mask[..., None], target, 0), faults)
    active = active_joints(motion.skeleton.parents, contacts.joints)
    problem = _pose(motion, contacts, target, active, limits, floor, weights, ramp)
    z, steps, result = gauss_newton(problem, tolerance, max_steps)
    moved = problem.motion(z)
    rows = np.asarray(active, int)
    answer = motion.with_transforms(
        motion.translations.at[:, 0].set(moved.translations[:, 0]),
        motion.rotations.at[:, rows].set(moved.rotations),
    )
    report = _report(answer, contacts, target, limits, floor, problem, z, steps, result)
    return answer, report


def _pose(motion, contacts, target, active, limits, floor, weights, ramp) -> Problem:
    start = restrict(motion, active)
    point = jnp.asarray(contacts.point, motion.dtype)
    joints = tuple(active.index(j) for j in contacts.joints)
    sizes = limb_lengths(motion, contacts.points)
    length = jnp.mean(sizes) if contacts.num_points else jnp.ones((), motion.dtype)
    length = jnp.where(length > 0, length, 1)
    positions = contacts.points.positions(motion)
    goal, weight = ramped_goals(positions, target, contacts.mask, motion.frame_time, ramp)
    # sqrt has no slope at weight 0, where there is nothing to differentiate.
    some = weight > 0
    pull = jnp.where(some, jnp.sqrt(weights.position * jnp.where(some, weight, 1)), 0)
    root = jnp.broadcast_to(jnp.sqrt(weights.root), (6,))
    stiffness = jnp.concatenate([root, jnp.ones((3 * len(active) - 3,), motion.dtype)])
    return Problem(
        start=start,
        joints=joints,
        point=point,
        goal=goal,
        pull=pull,
        length=length,
        stiffness=stiffness,
        prior=Prior(weights.size, weights.bend / motion.frame_time**4),
        floor=floor,
        floor_pull=jnp.sqrt(weights.floor),
        limits=None if limits is None else limits.of(active),
        limit_pull=jnp.sqrt(weights.limits),
    )


def _report(answer, contacts, target, limits, floor, problem, z, steps, result) -> Report:
    y = contacts.points.positions(answer)
    error = jnp.where(contacts.mask, safe_norm(y - target), 0)
    depth = jnp.zeros_like(error)
    if floor is not None:
        depth = jnp.maximum(floor - y[..., problem.up], 0)
    excess = jnp.zeros(answer.rotations.shape[:2], answer.dtype)
    if limits is not None:
        excess = safe_norm(limits.excess(answer.rotations))
    return Report(
        error, depth, excess, cost(problem.still, problem), cost(z, problem), steps, result
    )
