"""Nonlinear least squares along time with an O(T d^3) step: optimistix on block-banded systems.

    minimise 1/2 |r(y)|^2,   y (T, d, *lanes),   J = dr/dy

    step    (J^T J) p = J^T r, block-banded when a residual sees at most w + 1 frames in a row
    probe   P e_{k,c}, k = 0 .. 2w;  e_{k,c}: component c of every frame t = k (mod 2w + 1) is one

Frames 2w + 1 apart share no row of the band, so ``(2w + 1) d`` products with the operator read all
of its blocks: period 3 for first differences (w = 1), 5 for second differences (w = 2). Lanes are
independent problems: no residual may mix two of them, and they share the probes.

    GaussNewton(rtol, atol, w)            reuses a factor while steps shrink fast; never goes uphill
    LevenbergMarquardt(rtol, atol, w)     for starts far from the answer
    optimistix.ImplicitAdjoint(BlockBandedCholesky(w))     derivatives: one solve with the Hessian

``lineax.Normal(BlockBandedCholesky(w))`` gives ``optimistix.GaussNewton`` and
``optimistix.LevenbergMarquardt`` the same step. The two solvers here exist because

- ``optimistix.GaussNewton`` takes any step, also one uphill, and builds its system anew each time;
  both stop on the change of every single residual, which in float32 and for stiff priors never
  falls below a tolerance fixed beforehand (ours: :mod:`jaxmotion.linalg.newton`);
- ``optimistix.LevenbergMarquardt`` keeps its step size in JAX's default dtype, and so raises on
  float32 unknowns while 64-bit is on.

``tags`` given to ``optimistix.least_squares`` reach both Hessian and Jacobian, and a Jacobian
tagged symmetric is then its own transpose: give none.

Cost of a factor: (2w + 1) d products with J and J^T, then O(T w^2 d^3) a lane; a step that reuses
one: a product with J^T and O(T w d^2). Memory O(T w d^2) a lane.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax
import optimistix
from jax import lax
from jaxtyping import Array, Bool, Float, PyTree

from jaxmotion.linalg.block_banded import (
    BlockBandedFactor,
    block_banded_factor,
    block_banded_substitute,
)
from jaxmotion.linalg.newton import DescendingNewton, silent


def probe_blocks(
    product: Callable[[Array], Array], like: jax.ShapeDtypeStruct, bandwidth: int
) -> Float[Array, "time band d d *lanes"]:
    """Blocks ``P[t + k, t]`` of a symmetric block-banded P from products with it.

    product: ``x (T, d, *lanes) -> P x``. like: shape and dtype of x. bandwidth: w.
    Returns the storage of :mod:`~jaxmotion.linalg.block_banded`; O(2w + 1) d products.
    """
    time, d, *lanes = like.shape
    period = 2 * bandwidth + 1
    phase = jnp.arange(time) % period

    def columns(k):
        def column(component):
            comb = jnp.where((phase == k)[:, None], component, 0)
            return product(jnp.broadcast_to(comb.reshape(time, d, *[1] * len(lanes)), like.shape))

        return jax.vmap(column)(jnp.eye(d, dtype=like.dtype))

    probed = lax.map(columns, jnp.arange(period))  # (period, column, T, row, *lanes)
    frame = jnp.arange(time)
    inside = [probed[phase, :, jnp.minimum(frame + k, time - 1)] for k in range(bandwidth + 1)]
    return jnp.swapaxes(jnp.stack(inside, axis=1), 2, 3)


_REUSE = 0.25  # a factor is kept while steps shrink at least this fast


class BlockBandedCholesky(lineax.AbstractLinearSolver[BlockBandedFactor]):
    """Solve with a symmetric positive definite, block-banded operator on ``(T, d, *lanes)``.

    The operator is only ever multiplied with. The result is ``lineax.RESULTS.singular`` when it is
    not positive definite. For a tall J use ``lineax.Normal(BlockBandedCholesky(w))``.

    **Arguments:** ``bandwidth``: w, the most frames two coupled unknowns are apart; entries further
    off are not seen.
    """

    bandwidth: int = 1

    def init(
        self, operator: lineax.AbstractLinearOperator, options: dict[str, Any]
    ) -> BlockBandedFactor:
        del options
        like = operator.in_structure()
        shapes = jax.tree.map(lambda x: x.shape, (like, operator.out_structure()))
        if not isinstance(like, jax.ShapeDtypeStruct) or len(like.shape) < 2:
            raise ValueError(
                f"BlockBandedCholesky: the unknowns are {shapes[0]}; want one array (T, d, *lanes)"
            )
        if shapes[0] != shapes[1]:
            raise ValueError(
                f"BlockBandedCholesky: the operator maps {shapes[0]} to {shapes[1]}; want a square "
                "one (lineax.Normal(BlockBandedCholesky(...)) solves least squares)"
            )
        product = lineax.linearise(operator).mv
        return block_banded_factor(probe_blocks(product, like, self.bandwidth), throw=False)

    def compute(
        self, state: BlockBandedFactor, vector: PyTree[Array], options: dict[str, Any]
    ) -> tuple[PyTree[Array], lineax.RESULTS, dict[str, Any]]:
        del options
        definite = jnp.all(jnp.isfinite(state.roots))
        result = lineax.RESULTS.where(definite, lineax.RESULTS.successful, lineax.RESULTS.singular)
        return block_banded_substitute(state, vector), result, {}

    def transpose(self, state: BlockBandedFactor, options: dict[str, Any]):
        return state, options

    def conj(self, state: BlockBandedFactor, options: dict[str, Any]):
        return state, options

    def assume_full_rank(self) -> bool:
        return True


class _ReuseState(eqx.Module):
    factor: BlockBandedFactor
    step: Float[Array, "time d *lanes"]
    length: Float[Array, ""]
    stale: Bool[Array, ""]
    result: optimistix.RESULTS


class ReusedNewton(optimistix.AbstractDescent):
    """The Gauss-Newton step, with J^T J factored anew only after steps that shrank too little.

    Close to an answer J^T J hardly changes, and its own error (the curvature of r) outweighs that.
    """

    solver: BlockBandedCholesky
    norm: Callable[[PyTree], Array]

    def init(self, y: Array, f_info_struct: optimistix.FunctionInfo) -> _ReuseState:
        del f_info_struct
        time, d, *lanes = y.shape
        multipliers = jnp.zeros((time, self.solver.bandwidth, d, d, *lanes), y.dtype)
        factor = BlockBandedFactor(multipliers, jnp.zeros((time, d, d, *lanes), y.dtype))
        far = jnp.full((), jnp.inf, y.dtype)
        return _ReuseState(factor, y, far, jnp.asarray(True), optimistix.RESULTS.successful)

    def query(self, y: Array, f_info: Any, state: _ReuseState) -> _ReuseState:
        forward, backward = f_info.jac, f_info.jac.transpose()

        def fresh():
            like = jax.eval_shape(lambda: y)
            gram = lineax.FunctionLinearOperator(lambda v: backward.mv(forward.mv(v)), like)
            return self.solver.init(gram, {})

        factor = lax.cond(state.stale, fresh, lambda: state.factor)
        step, result, _ = self.solver.compute(factor, backward.mv(f_info.residual), {})
        length = self.norm(step)
        stale = length > _REUSE * state.length
        return _ReuseState(factor, step, length, stale, optimistix.RESULTS.promote(result))

    def step(self, step_size: Array, state: _ReuseState) -> tuple[Array, optimistix.RESULTS]:
        return -step_size * state.step, state.result


class GaussNewton(DescendingNewton):
    """Gauss-Newton on ``y (T, d, *lanes)`` that never goes uphill and stops by its steps' length.

    **Arguments:** ``rtol``, ``atol``: stop after a step whose ``norm``, by default its largest
    component, is below ``atol + rtol * norm(y)``; ``bandwidth``: w, how many frames apart two
    unknowns of one residual may be.
    """

    def __init__(
        self,
        rtol: float,
        atol: float,
        bandwidth: int = 1,
        norm: Callable[[PyTree], Array] = optimistix.max_norm,
    ):
        super().__init__(ReusedNewton(BlockBandedCholesky(bandwidth), norm), rtol, atol, norm)


class _TrustRegion(optimistix.ClassicalTrustRegion):
    """The classical trust region with its radius in the dtype of the unknowns."""

    def init(self, y: Array, f_info_struct: Any):
        return jax.tree.map(lambda x: x.astype(y.dtype), super().init(y, f_info_struct))


class LevenbergMarquardt(optimistix.AbstractGaussNewton):
    """``optimistix.LevenbergMarquardt`` for any floating dtype, on the normal equations.

    It stops as optimistix does, when neither y nor any residual changes by more than the
    tolerances.

    **Arguments:** ``rtol``, ``atol``, ``bandwidth``, ``norm``: as those of :class:`GaussNewton`.
    """

    rtol: float
    atol: float
    norm: Callable[[PyTree], Array]
    descent: optimistix.DampedNewtonDescent
    search: _TrustRegion
    verbose: Callable[..., None]

    def __init__(
        self,
        rtol: float,
        atol: float,
        bandwidth: int = 1,
        norm: Callable[[PyTree], Array] = optimistix.max_norm,
    ):
        self.rtol, self.atol, self.norm = rtol, atol, norm
        solver = lineax.Normal(BlockBandedCholesky(bandwidth))
        self.descent = optimistix.DampedNewtonDescent(linear_solver=solver)
        self.search = _TrustRegion()
        self.verbose = silent
