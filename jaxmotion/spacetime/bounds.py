"""Joint limits as bounds that are never crossed: L-BFGS-B on the limits' own coordinates.

    minimise E over x,   lower <= x <= upper        E: rows and prior of a Problem, without the box
    x = (root displacement, v_j),   q_j = c_j exp(v_j),   delta_j = log(q0_j^-1 q_j)

v_j: a joint's turn about its limits' centre c_j, so that limits are a box; joints without limits
turn about q0_j. Byrd, Lu, Nocedal and Zhu (1995), by jaxopt, which only this file imports. It
starts from another answer, clipped into the box; hundreds of cheap iterations, O(T d) each. No
derivatives.
"""

import warnings
from typing import Any

import equinox as eqx
import equinox.internal as eqxi
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxmotion.spacetime.gauss_newton import cost
from jaxmotion.spacetime.joint_limits import JointLimits
from jaxmotion.spacetime.problem import Problem


def boxed(problem: Problem) -> tuple[JointLimits | None, Problem]:
    """The box of the first term that is one, and the problem without that term."""
    for k, term in enumerate(problem.terms):
        if term.box is not None:
            others = problem.terms[:k] + problem.terms[k + 1 :]
            return term.box, eqx.tree_at(lambda p: p.terms, problem, others)
    return None, problem


def bounded(
    problem: Problem,
    limits: JointLimits,
    z: Float[Array, "time d"],
    tolerance: float,
    max_steps: int,
) -> tuple[Float[Array, "time d"], Int[Array, ""], Bool[Array, ""]]:
    """(z, iterations, whether it converged), from the start ``z``, within the limits.

    ``tolerance``: largest component of the projected gradient.
    """
    call = 'satisfy(method="bounds")'
    problem, limits, z = eqxi.nondifferentiable((problem, limits, z), name=call)
    start = problem.start.rotations
    limited = jnp.any(jnp.isfinite(limits.lower) | jnp.isfinite(limits.upper), axis=-1)
    centre = jnp.where(limited[:, None], limits.centre, start)

    about = eqx.tree_at(lambda p: p.start, problem, problem.start.with_transforms(rotations=centre))

    def displacement(x: Array) -> Array:
        return problem.displacement(about.motion(problem.stiffness * x))

    infinite = jnp.full((3,), jnp.inf, z.dtype)
    lower = jnp.concatenate([-infinite, limits.lower.reshape(-1)])
    upper = jnp.concatenate([infinite, limits.upper.reshape(-1)])
    sides = (
        problem.counted(jnp.broadcast_to(lower, z.shape), -jnp.inf),
        problem.counted(jnp.broadcast_to(upper, z.shape), jnp.inf),
    )
    first = about.displacement(problem.motion(z)) / problem.stiffness
    first = jnp.clip(first, *sides)
    solver = _jaxopt().LBFGSB(
        fun=lambda x: cost(displacement(x), problem), maxiter=max_steps, tol=tolerance
    )
    x, state = solver.run(first, bounds=sides)
    return displacement(x), state.iter_num, state.error <= tolerance


def _jaxopt() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # "no longer maintained", on import
        import jaxopt
    return jaxopt
