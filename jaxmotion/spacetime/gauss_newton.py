"""Gauss-Newton over a whole clip, and the derivative of its answer.

    z <- z - (A x I + J^T J)^-1 (A z + J^T rows(z)),       J = d rows / d z

J has few rows a frame, so a step is one Kalman filter (:mod:`jaxmotion.spacetime.low_rank`), and
the Jacobian is written out (:mod:`jaxmotion.spacetime.problem`); optimistix runs the iteration and
:class:`~jaxmotion.linalg.least_squares.Decrease` never lets it go uphill. Derivatives are those of
the stationary point: conjugate gradients on the exact Hessian, the step's matrix as preconditioner,
which it equals but for the curvature of the points' paths times what is left of the residuals.

Cost O(T d^2 r) a step for r rows on d unknowns a frame, 3 to 10 steps where targets can be met.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix
from jax import lax
from jaxtyping import Array, Float, Int

from jaxmotion.linalg.least_squares import Decrease
from jaxmotion.spacetime.low_rank import low_rank_factor
from jaxmotion.spacetime.prior import Walk, random_walk
from jaxmotion.spacetime.problem import Problem

_CG_STEPS = 500


def cost(z: Float[Array, "time d"], problem: Problem) -> Float[Array, ""]:
    """E."""
    rows, (size, bend) = problem.rows(z), problem.prior.rows(z)
    return 0.5 * (jnp.sum(rows**2) + jnp.sum(size**2) + jnp.sum(bend**2))


def _gradient(z: Float[Array, "time d"], problem: Problem) -> Float[Array, "time d"]:
    """dE / dz."""
    rows, jacobian = problem.linearized(z)
    _, pull = jax.vjp(problem.prior.rows, z)
    return jnp.einsum("trd,tr->td", jacobian, rows) + pull(problem.prior.rows(z))[0]


@jax.custom_jvp
def _residuals(z: Float[Array, "time d"], problem: Problem) -> tuple[Array, ...]:
    return problem.rows(z), *problem.prior.rows(z)


@_residuals.defjvp
def _residuals_jvp(primals, tangents):
    """In z only, with the Jacobian written out: the problem is held still while iterating."""
    (z, problem), (dz, _) = primals, tangents
    rows, jacobian = problem.linearized(z)
    along = jnp.einsum("trd,td->tr", jacobian, dz)
    return (rows, *problem.prior.rows(z)), (along, *problem.prior.rows(dz))


class _State(eqx.Module):
    step: Float[Array, "time d"]
    result: optimistix.RESULTS


class _Step(optimistix.AbstractDescent):
    """The Gauss-Newton step by the filter."""

    walk: Walk

    def init(self, y: Array, f_info_struct: optimistix.FunctionInfo) -> _State:
        del f_info_struct
        return _State(y, optimistix.RESULTS.successful)

    def query(self, y: Array, f_info: Any, state: _State) -> _State:
        del state

        def column(component):
            return f_info.jac.mv(jnp.broadcast_to(component, y.shape))[0]

        # No row sees two frames, so d products read the Jacobian of all of them.
        rows = jax.vmap(column, out_axes=-1)(jnp.eye(y.shape[1], dtype=y.dtype))
        gradient = f_info.jac.transpose().mv(f_info.residual)
        step = low_rank_factor(self.walk, rows).solve(gradient)
        finite = jnp.all(jnp.isfinite(step))
        fine, singular = optimistix.RESULTS.successful, optimistix.RESULTS.singular
        result = optimistix.RESULTS.where(finite, fine, singular)  # pyright: ignore
        return _State(jnp.where(finite, step, 0), result)

    def step(self, step_size: Array, state: _State) -> tuple[Array, optimistix.RESULTS]:
        return -step_size * state.step, state.result


class _GaussNewton(optimistix.AbstractGaussNewton):
    rtol: float
    atol: float
    norm: Callable[[Any], Array]
    descent: _Step
    search: Decrease
    verbose: Callable[..., None]

    def __init__(self, walk: Walk, tolerance: float):
        self.rtol, self.atol, self.norm = 0.0, tolerance, optimistix.max_norm
        self.descent = _Step(walk)
        self.search = Decrease(self.rtol, self.atol, self.norm)
        self.verbose = _silent

    def terminate(self, fn, y, args, options, state, tags):
        del fn, y, args, options, tags
        return state.search_state.finished, state.result


def _silent(**kwargs):
    del kwargs


def gauss_newton(
    problem: Problem, tolerance: float, max_steps: int
) -> tuple[Float[Array, "time d"], Int[Array, ""], optimistix.RESULTS]:
    """(z, steps, result): the displacement of least E, differentiable in the problem.

    ``tolerance``: stop after a step with no component longer than this.
    """
    if not problem.joints and problem.limits is None:  # nothing is asked
        return problem.still, jnp.zeros((), jnp.int32), optimistix.RESULTS.successful
    frozen = jax.tree.map(lax.stop_gradient, problem)
    walk = random_walk(frozen.prior, frozen.start.num_frames)
    found = optimistix.least_squares(
        _residuals,
        _GaussNewton(walk, tolerance),
        frozen.still,
        frozen,
        max_steps=max_steps,
        throw=False,
    )
    answer = lax.stop_gradient(found.value)
    z = stationary(problem, answer)
    return z, jnp.asarray(found.stats["num_steps"]), found.result


def stationary(problem: Problem, answer: Float[Array, "time d"]) -> Float[Array, "time d"]:
    """The answer again, as the root of E's gradient: nothing moves, but derivatives pass."""
    frozen = jax.tree.map(lax.stop_gradient, problem)
    precise = float(jnp.finfo(answer.dtype).eps) ** 0.75

    def tangent_solve(hessian, b):
        walk = random_walk(frozen.prior, answer.shape[0])
        factor = low_rank_factor(walk, frozen.linearized(answer)[1])

        def solve(product, b):
            x, _ = jax.scipy.sparse.linalg.cg(
                product, b, tol=precise, maxiter=_CG_STEPS, M=factor.solve
            )
            # Short of a minimum the Hessian may be indefinite: then the step's matrix stands in.
            return jnp.where(jnp.all(jnp.isfinite(x)), x, factor.solve(b))

        return lax.custom_linear_solve(hessian, b, solve, symmetric=True)

    return lax.custom_root(
        lambda z: _gradient(z, problem), answer, lambda _, start: start, tangent_solve
    )
