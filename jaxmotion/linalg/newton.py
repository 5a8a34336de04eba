"""Gauss-Newton around any step: never uphill, at rest when the steps are short.

    y <- y - t p(y)        p: a descent's step; t = 1, halved while the cost rises

:class:`DescendingNewton` gives optimistix all but p. Finished after a step shorter than
``atol + rtol * norm(y)``, see :class:`Decrease`; the result is then successful, whatever becomes of
the step from there: once at rest it does not matter whether another could be made. Before, a step
that cannot be made ends the iteration with that step's result.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import optimistix
from jaxtyping import Array, Bool, Float, PyTree


class DescendingNewton(optimistix.AbstractGaussNewton):
    """``descent``: gives p; ``rtol``, ``atol``, ``norm``: when it is at rest."""

    rtol: float
    atol: float
    norm: Callable[[PyTree], Array]
    descent: optimistix.AbstractDescent
    search: "Decrease"
    verbose: Callable[..., None]

    def __init__(
        self,
        descent: optimistix.AbstractDescent,
        rtol: float,
        atol: float,
        norm: Callable[[PyTree], Array] = optimistix.max_norm,
    ):
        self.rtol, self.atol, self.norm = rtol, atol, norm
        self.descent, self.search = descent, Decrease(rtol, atol, norm)
        self.verbose = silent

    def terminate(self, fn, y, args, options, state, tags):
        del fn, y, args, options, tags
        finished, fine = state.search_state.finished, optimistix.RESULTS.successful
        return finished, optimistix.RESULTS.where(finished, fine, state.result)  # pyright: ignore


def silent(**kwargs: Any) -> None:
    """Print nothing of a step."""
    del kwargs


class _DecreaseState(eqx.Module):
    step_size: Float[Array, ""]
    moved: Float[Array, ""]
    finished: Bool[Array, ""]


class Decrease(optimistix.AbstractSearch):
    """Full steps; halved while they raise the cost by more than its rounding error.

    Finished after a step shorter than ``atol + rtol * norm(y)``, or shorter than 16 times that when
    steps stop shrinking and the cost cannot tell the iterates apart: no more digits are to be had.
    """

    rtol: float
    atol: float
    norm: Callable[[PyTree], Array]

    def init(self, y: Array, f_info_struct: optimistix.FunctionInfo) -> _DecreaseState:
        del f_info_struct
        one, far = jnp.ones((), y.dtype), jnp.full((), jnp.inf, y.dtype)
        return _DecreaseState(one, far, jnp.asarray(False))

    def step(
        self,
        first_step: Bool[Array, ""],
        y: Array,
        y_eval: Array,
        f_info: optimistix.FunctionInfo,
        f_eval_info: optimistix.FunctionInfo,
        state: _DecreaseState,
    ) -> tuple[Array, Bool[Array, ""], optimistix.RESULTS, _DecreaseState]:
        cost, cost_eval = f_info.as_min(), f_eval_info.as_min()
        moved = self.norm(y_eval - y)
        rounding = 8 * float(jnp.finfo(cost.dtype).eps) * cost
        accept = first_step | (cost_eval <= cost + rounding)
        enough = self.atol + self.rtol * self.norm(y_eval)
        alike = jnp.abs(cost_eval - cost) <= rounding
        stalled = alike & (moved > 0.5 * state.moved) & (moved <= 16 * enough)
        finished = ~first_step & ((moved <= enough) | stalled)
        step_size = jnp.where(accept, jnp.ones_like(state.step_size), 0.5 * state.step_size)
        moved = jnp.where(first_step, state.moved, moved)
        state = _DecreaseState(step_size, moved, finished)
        return step_size, accept, optimistix.RESULTS.successful, state
