"""Gauss-Newton over a whole clip, second order near the answer, and the answer's derivative.

    M s = A z + J^T rows(z),    M = A x I + J^T J,    J = d rows / d z      then z <- z - s
    y = rows(z) - J s                  what the rows will be, to first order, after the step
    H s = A z + J^T rows(z),    H = M + sum_i y_i d^2 rows_i / d z^2        steps below 0.4

J has few rows a frame, so M is solved by one Kalman filter (:mod:`jaxmotion.spacetime.low_rank`).
Points that must be somewhere move on curves, while what is left of the problem, the small weights
of A, decides where on them: alone M overshoots there, by the points' curvature against A, and takes
tens of steps of ever the same share. H has that curvature, as Newton's method on constraints with
multipliers y has. (Curvature times rows(z), the exact Hessian, is dominated by what the next step
removes anyway, and is indefinite until all but nothing is left of it.) Conjugate gradients with M
as preconditioner take a few products with H; where they meet a direction of negative curvature the
step of M stands.

optimistix runs the iteration, and :mod:`jaxmotion.linalg.newton` never lets it go uphill.
Derivatives are those of the stationary point, by conjugate gradients on the exact Hessian.

Cost O(T d^2 r) a step for r rows on d unknowns a frame; 6 to 45 steps where targets can be met.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxmotion.linalg.newton import DescendingNewton
from jaxmotion.spacetime.low_rank import LowRankFactor, low_rank_factor
from jaxmotion.spacetime.prior import Walk, random_walk
from jaxmotion.spacetime.problem import Problem

_CG_STEPS = 500
_NEAR = 0.4  # of a step's longest component, radians or body lengths
_PRODUCTS = 8


def cost(z: Float[Array, "time d"], problem: Problem) -> Float[Array, ""]:
    """E."""
    rows, (size, bend) = problem.rows(z), problem.prior.rows(z)
    return 0.5 * (jnp.sum(rows**2) + jnp.sum(size**2) + jnp.sum(bend**2))


def _gradient(z: Float[Array, "time d"], problem: Problem) -> Float[Array, "time d"]:
    """dE / dz."""
    rows, jacobian = problem.linearized(z)
    return jnp.einsum("trd,tr->td", jacobian, rows) + problem.prior.product(z)


def _residuals(z: Float[Array, "time d"], problem: Problem) -> tuple[Array, ...]:
    """For optimistix's cost alone: the step has J written out, so no other is made."""
    return lax.stop_gradient((problem.rows(z), *problem.prior.rows(z)))


class _State(eqx.Module):
    step: Float[Array, "time d"]
    result: optimistix.RESULTS


class _Step(optimistix.AbstractDescent):
    """The step of M, or of H."""

    problem: Problem
    walk: Walk

    def init(self, y: Array, f_info_struct: optimistix.FunctionInfo) -> _State:
        del f_info_struct
        return _State(y, optimistix.RESULTS.successful)

    def query(self, y: Array, f_info: Any, state: _State) -> _State:
        del f_info, state
        rows, jacobian = self.problem.linearized(y)
        factor = low_rank_factor(self.walk, jacobian)
        gradient = self.problem.prior.product(y) + jnp.einsum("trd,tr->td", jacobian, rows)
        # z - s = -A^-1 J^T y: no large numbers that cancel.
        multipliers = factor.forces(rows - jnp.einsum("trd,td->tr", jacobian, y))
        first = y + factor.pulled(multipliers)
        step = lax.cond(
            jnp.max(jnp.abs(first)) < _NEAR,
            lambda: _second_order(self.problem, y, multipliers, factor, gradient, first),
            lambda: first,
        )
        finite = jnp.all(jnp.isfinite(step))
        fine, singular = optimistix.RESULTS.successful, optimistix.RESULTS.singular
        result = optimistix.RESULTS.where(finite, fine, singular)  # pyright: ignore
        return _State(jnp.where(finite, step, 0), result)

    def step(self, step_size: Array, state: _State) -> tuple[Array, optimistix.RESULTS]:
        return -step_size * state.step, state.result


def _second_order(
    problem: Problem,
    z: Array,
    multipliers: Array,
    factor: LowRankFactor,
    gradient: Array,
    first: Array,
) -> Float[Array, "time d"]:
    """H^-1 gradient from M^-1 gradient, to a tenth of their difference; or the latter."""

    def pulled(z):
        return jax.vjp(problem.rows, z)[1](multipliers)[0]

    _, curvature = jax.linearize(pulled, z)

    def product(v):
        along = jnp.einsum("trd,td->tr", factor.rows, v)
        return (
            problem.prior.product(v) + jnp.einsum("trd,tr->td", factor.rows, along) + curvature(v)
        )

    def iterate(state):
        x, residual, direction, size, bent, k = state
        image = product(direction)
        slope = jnp.vdot(direction, image)
        share = jnp.where(slope > 0, size / jnp.where(slope > 0, slope, 1), 0)
        x, residual = x + share * direction, residual - share * image
        whitened = factor.solve(residual)
        left = jnp.vdot(residual, whitened)
        direction = whitened + left / jnp.where(size > 0, size, 1) * direction
        return x, residual, direction, left, bent | (slope <= 0), k + 1

    def unfinished(state):
        _, _, _, size, bent, k = state
        return (size > 0.01 * begin) & ~bent & (k < _PRODUCTS)

    residual = -curvature(first)
    direction = factor.solve(residual)
    begin = jnp.vdot(residual, direction)
    state = first, residual, direction, begin, jnp.asarray(False), jnp.zeros((), jnp.int32)
    x, *_, bent, _ = lax.while_loop(unfinished, iterate, state)
    uphill = ~(jnp.vdot(x, gradient) > 0)  # or not finite
    return jnp.where(bent | uphill, first, x)


def gauss_newton(
    problem: Problem, tolerance: float, max_steps: int
) -> tuple[Float[Array, "time d"], Int[Array, ""], Bool[Array, ""]]:
    """(z, steps, converged): the displacement of least E, differentiable in the problem.

    ``tolerance``: stop after a step with no component longer than this.
    """
    frozen = jax.tree.map(lax.stop_gradient, problem)
    step = _Step(frozen, random_walk(frozen.prior, frozen.start.num_frames))
    found = optimistix.least_squares(
        _residuals,
        DescendingNewton(step, 0.0, tolerance),
        frozen.unmoved,
        frozen,
        max_steps=max_steps,
        throw=False,
    )
    answer = lax.stop_gradient(found.value)
    z = stationary(problem, answer)
    converged = found.result == optimistix.RESULTS.successful
    return z, jnp.asarray(found.stats["num_steps"]), converged


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
