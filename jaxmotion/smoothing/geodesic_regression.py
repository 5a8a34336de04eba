"""Exact geodesic smoothing of rotations (Eom, Choi and Noh, 2019, Eq. 9).

    minimise over x:   1/2 sum_i rho(w_i |e_i|^2 / sigma^2)  +  prior(x)

    data      e_i = sum_f A_if log(x_f^-1 y_i)          A as in the LGS: (1 - g, g) between frames
    order 1   prior = lam/2 sum_t h_{t+1} c_t |v_t|^2,  c = (1, 2, .., 2, 1)   Eq. 9 as printed
    order 2   prior = lam^2/2 sum_t h_t^2 |s (v_t - v_{t-1})|^2                s as in the LGS
    where     v_t = log(x_t^-1 x_{t+1}),  v_t - v_{t-1} = log(x_t^-1 x_{t+1}) + log(x_t^-1 x_{t-1})

    x  smoothed rotations (Nf, J)      y  data (Nd, J)      w  weights, 0 for missing
    h  stiffness of the frames (Nf, J), ones unless given
    rho(u) = u "l2";  u up to k^2, then 2 k sqrt(u) - k^2, k = 1.345 "huber";
             k^2 log(1 + u/k^2), k = 2.385 "cauchy"

The acceleration form is Boumal's discrete geodesic regression (*Interpolation and regression of
rotation matrices*, 2013). Solved by Gauss-Newton in x_t = s_t exp(d_t) around the chordal answer s;
a step is one block-banded solve with 3 x 3 blocks. Robust losses are iteratively reweighted inside
the same loop: with weights rho'(u) held still, the Gauss-Newton model majorises the loss. The data
are never linearised away: the answer turns with the data, geodesic(a q b) = a geodesic(q) b.

Shapes: q ``(Nd, J, 4)`` or ``(Nd, 4)``; angles in radians; sigma in radians. Cost O((Nd + Nf) J) a
step in time and memory; 3 to 12 steps. Derivatives in q, lam, sigma, weights, stiffness and a
fractional index are those of the stationary point: one solve with the exact Hessian, at the answer.

Sharp bits: the cost has one minimum only while data stay well within half a turn of the smoothed
motion; beyond it, this is the minimum near the chordal answer. Steps shrink slowly where data lie
2 rad and more from the answer, and under robust losses when most data count as outliers. A step is
solved from normal equations, so digits go as (lam h sigma)^2: float32 serves up to 1000, of the
stiffest frame.
"""

import functools
from collections.abc import Iterator
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxmotion import quaternion
from jaxmotion._checks import Fault, fault, known, no_module, one_of, raise_faults, static
from jaxmotion._portable import Portable
from jaxmotion._program import keepable
from jaxmotion._summary import brief, per_frame
from jaxmotion._types import AnyArray, ArrayLike, Quaternion, ScalarLike
from jaxmotion.linalg.block_banded import (
    BlockBandedFactor,
    block_banded_factor,
    block_banded_selected_inverse,
    block_banded_substitute,
)
from jaxmotion.linalg.least_squares import GaussNewton, probe_blocks
from jaxmotion.quaternion.tangent import (
    component_first,
    inverse_jacobian,
    on_blocks,
    relative,
)
from jaxmotion.smoothing.chordal import chordal
from jaxmotion.smoothing.data_ends import Ends, ends_of
from jaxmotion.smoothing.design import Design, Observations, observe
from jaxmotion.smoothing.lgs import checked_stiffness
from jaxmotion.smoothing.losses import BEND, slack, slope

_MAX_STEPS = 256
_UNIT = 1e-3  # how far from 1 a norm may be


class _Problem(Portable):
    """The cost times sigma^2 of every joint, in turns d of the frames around ``start``.

    ``rows``: what the prior multiplies each change with, v_t or v_t - v_{t-1}; ``beyond``: 1 for
    frames before the first datum and after the last, which stay where they are; None for none.
    """

    start: Float[Array, "frames joints 4"]
    data: Float[Array, "data joints 4"]
    weights: Float[Array, "data #joints"] | None
    rows: Float[Array, "changes 1 #joints"]
    sigma: Float[Array, "#joints"]
    seen: Observations
    order: int = eqx.field(static=True)
    loss: Literal["l2", "huber", "cauchy"] = eqx.field(static=True)
    beyond: Float[Array, "frames 1 #joints"] | None = None

    @property
    def unmoved(self) -> Float[Array, "frames 3 joints"]:
        """No turn."""
        return jnp.zeros_like(component_first(self.start[..., 1:]))

    def rotations(self, turn: Float[Array, "frames 3 joints"]) -> Quaternion:
        """x = s exp(d)."""
        return quaternion.multiply(self.start, quaternion.exp(jnp.moveaxis(turn, 1, -1)))

    def velocity(self, turn: Float[Array, "frames 3 joints"]) -> Array:
        """v_t, from frame t to frame t + 1."""
        steps = quaternion.between(self.start[:-1], self.start[1:])
        return relative(turn[:-1], turn[1:], steps)

    def logs(self, turn: Float[Array, "frames 3 joints"]) -> list[tuple[Array, Array | None]]:
        """log(x_f^-1 y_i) for the one or two frames f of every datum, and its share A_if."""
        frame, back = self.seen.frame, self.seen.back
        if frame is None:
            return [(relative(turn, None, quaternion.between(self.start, self.data)), None)]

        def to_data(frame):
            away = quaternion.between(self.start[frame], self.data)
            return relative(turn[frame], None, away)

        if back is None:
            return [(to_data(frame), None)]
        share = back[:, None, None]
        return [(to_data(frame), 1 - share), (to_data(frame - 1), share)]

    def bend(self, velocity: Array) -> Array:
        """The prior's rows: what is kept small, in units of sigma."""
        return self.rows * jnp.diff(velocity, n=self.order - 1, axis=0)

    def robust(self, misfit: Array) -> tuple[Array, Array]:
        """w rho'(u), the weight of each squared misfit, and sigma^2 (rho(u) - u rho'(u)) >= 0."""
        weights = jnp.ones((1, 1), misfit.dtype) if self.weights is None else self.weights
        u = weights * jnp.sum(misfit**2, axis=1) / self.sigma**2
        weight = weights if self.loss == "l2" else weights * slope(u, self.loss)
        return weight[:, None], self.sigma**2 * slack(u, self.loss)


def _total(shared: list[tuple[Array, Array | None]]) -> Array:
    """e_i from its logs and their shares."""
    parts = (log if share is None else share * log for log, share in shared)
    return functools.reduce(jnp.add, parts)


def _residuals(turn: Array, problem: _Problem) -> tuple[Array, ...]:
    """Half their squares sum to the cost; their Jacobian is that of the reweighted squares."""
    misfit = _total(problem.logs(turn))
    weights, slack = lax.stop_gradient(problem.robust(misfit))
    root = jnp.where(weights > 0, jnp.sqrt(jnp.where(weights > 0, weights, 1.0)), 0.0)
    residuals = (root * misfit, problem.bend(problem.velocity(turn)))
    if problem.beyond is not None:
        residuals += (problem.beyond * turn,)
    return residuals if problem.loss == "l2" else (*residuals, jnp.sqrt(jnp.maximum(slack, 0.0)))


def _torque(turn: Array, problem: _Problem) -> Array:
    """Gradient of the cost when every frame x_t turns to x_t exp(u_t); zero at the answer."""
    shared = problem.logs(turn)
    misfit = _total(shared)
    pull = problem.robust(misfit)[0] * misfit
    torque = jnp.zeros_like(turn) if problem.beyond is None else problem.beyond * turn
    for number, (log, share) in enumerate(shared):
        at_frame = -on_blocks(inverse_jacobian, log, pull if share is None else share * pull)
        if problem.seen.frame is None:
            torque = torque + at_frame
        else:
            torque = torque.at[problem.seen.frame - number].add(at_frame)
    velocity = problem.velocity(turn)
    bend, rows = jax.vjp(problem.bend, velocity)
    (push,) = rows(bend)
    torque = torque.at[1:].add(on_blocks(inverse_jacobian, velocity, push, transpose=True))
    return torque.at[:-1].add(-on_blocks(inverse_jacobian, velocity, push))


class GeodesicPosterior(Portable):
    """The answer of :func:`geodesic`: the mode, and a Gaussian about it when asked for.

    Everything but the fields is worked out on request, in O(Nf J).

    **Fields:** ``mean``: f[Nf, J, 4], unit; ``num_steps``: i32[], Gauss-Newton steps taken;
    ``result``: an ``optimistix.RESULTS``.
    """

    mean: Quaternion
    num_steps: Int[Array, ""]
    result: optimistix.RESULTS
    _problem: _Problem

    def _words(self) -> Iterator[str]:
        yield per_frame(self.mean)
        yield f"num_steps={brief(self.num_steps)}"

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether the steps became as short as the dtype allows."""
        return self.result == optimistix.RESULTS.successful

    @property
    def cost(self) -> Float[Array, "*joints"]:
        """The minimised cost of every joint."""
        return _cost(self._problem).reshape(self.mean.shape[1:-1])

    @property
    def gradient_norm(self) -> Float[Array, ""]:
        """Largest derivative of sigma^2 times the cost in any turn of any frame; 0 at a minimum."""
        return _gradient_norm(self._problem)

    @property
    def statistics(self) -> dict[str, Array | optimistix.RESULTS]:
        """``num_steps``, ``cost``, ``gradient_norm`` and ``result``."""
        return {
            "num_steps": self.num_steps,
            "cost": self.cost,
            "gradient_norm": self.gradient_norm,
            "result": self.result,
        }

    @property
    def covariance(self) -> Float[Array, "frames *joints 3 3"]:
        """Covariance of u_t in x_t = mean_t exp(u_t), rad^2: the diagonal blocks of the inverse
        Gauss-Newton matrix, robust weights included."""
        covariance = _covariance(self._problem)
        return covariance.reshape(*self.mean.shape[:-1], 3, 3)


@eqx.filter_jit
def _cost(problem: _Problem) -> Array:
    parts = (
        jnp.sum(r**2, axis=tuple(range(r.ndim - 1))) for r in _residuals(problem.unmoved, problem)
    )
    cost = 0.5 * functools.reduce(jnp.add, parts) / problem.sigma**2
    return jnp.broadcast_to(cost, problem.start.shape[1:2])


@eqx.filter_jit
def _gradient_norm(problem: _Problem) -> Array:
    return jnp.max(jnp.abs(_torque(problem.unmoved, problem)))


@eqx.filter_jit
def _covariance(problem: _Problem) -> Array:
    unmoved = problem.unmoved
    _, forward = jax.linearize(lambda turn: _residuals(turn, problem), unmoved)
    backward = jax.linear_transpose(forward, unmoved)
    like = jax.ShapeDtypeStruct(unmoved.shape, unmoved.dtype)
    blocks = probe_blocks(lambda v: backward(forward(v))[0], like, problem.order)
    inverse = block_banded_selected_inverse(block_banded_factor(blocks, throw=False))
    return jnp.moveaxis(inverse[:, 0] * problem.sigma**2, -1, 1)


@static("order", "num_frames", "throw")
def geodesic(
    q: Quaternion,
    lam: ScalarLike,
    sigma: ScalarLike,
    *,
    order: Literal[1, 2] = 2,
    index: ArrayLike | None = None,
    num_frames: int | None = None,
    weights: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    scale: Literal["half", "unit"] = "half",
    loss: Literal["l2", "huber", "cauchy"] = "l2",
    throw: bool = True,
) -> GeodesicPosterior:
    """Smooth, denoise or resample rotations on the rotation group itself.

    O((Nd + Nf) J) a step, 3 to 12 steps. Differentiable in q, lam, sigma, weights, stiffness and a
    fractional index, implicitly. Source: Eom et al. 2019, Eq. 9; Boumal 2013.

    **Arguments:** ``q``: f[Nd, J, 4] or f[Nd, 4], unit; ``lam``, ``sigma`` (radians): > 0, scalars
    or f[J], traced or not; ``order``: 2 smooths velocities, 1 positions; ``index``, ``num_frames``,
    ``scale``: as :func:`~jaxmotion.smoothing.lgs`; ``weights``: f[Nd] or f[Nd, J], ≥ 0, dividing
    the noise variance, 0 for missing data, whatever q holds there; ``stiffness``: f[Nf] or
    f[Nf, J], > 0: lam of each frame is lam times this (order 2: of the change of velocity at the
    frame, the ends have none; order 1: of the step into the frame, frame 0 has none); ``loss``:
    "l2"; "huber" and "cauchy" bound the pull of outliers; ``throw``: whether not converging is an
    error (else look at ``converged``), and a derivative where there is none (else NaN).
    **Returns:** :class:`GeodesicPosterior`, in q's dtype.
    **Raises:** ``ValueError`` for shapes and options that do not fit and for values known to be
    wrong; at run time for traced ones: q not unit or NaN at positive weight, lam, sigma or
    stiffness not positive, data at fewer than two distinct frames (one for order 1). At run time as
    ``throw`` says.
    """
    no_module("geodesic: q", q, "jaxmotion.smoothing.smooth_motion takes motions")
    given, q = known(q), jnp.asarray(q)
    if q.ndim < 2 or q.shape[-1] != 4:
        raise ValueError(f"geodesic: q must have shape (Nd, J, 4) or (Nd, 4), got {q.shape}")
    one_of("geodesic: loss", loss, ("l2", *BEND))
    joints = q.shape[1:-1]
    seen, faults = observe(index, num_frames, weights, q.shape[:-1], q.dtype, null_space=order)
    present = _present(weights, q.shape[:-1])
    squared = (given * given).sum(-1)
    unit = (squared >= (1 - _UNIT) ** 2) & (squared <= (1 + _UNIT) ** 2)
    message = "geodesic: q holds NaN or quaternions that are not unit"
    q = raise_faults(q, faults + fault((present & ~unit).any(), message))
    q = quaternion.normalize(jnp.where(present[..., None], q, 1.0))
    trusted = None if weights is None else jnp.asarray(weights, q.dtype)
    if stiffness is not None:
        stiffness = checked_stiffness(stiffness, seen.num_frames, joints, q.dtype)
    design = Design(index, num_frames, order, scale)
    start = chordal(q, lam, sigma, design, weights=trusted, stiffness=stiffness)
    lam, sigma = (jnp.asarray(value, q.dtype) for value in (lam, sigma))
    problem = _Problem(
        start.reshape(start.shape[0], -1, 4),
        q.reshape(q.shape[0], -1, 4),
        None if seen.weights is None else seen.weights.reshape(q.shape[0], -1),
        _prior_rows(lam, sigma, stiffness, seen.num_frames, order, scale),
        sigma.reshape(-1),
        Observations(seen.frame, seen.back, None, seen.num_frames),
        order,
        loss,
    )
    return _solve(problem, throw, joints)


def _present(weights: ArrayLike | None, shape: tuple[int, ...]) -> Bool[AnyArray, "data *joints"]:
    """Where there is a datum: NumPy's, unless the weights are traced."""
    w = known(np.ones(shape[:1]) if weights is None else weights)
    return (w.reshape(w.shape + (1,) * (len(shape) - w.ndim)) > 0) & np.ones(shape, bool)


def _prior_rows(
    lam: Array, sigma: Array, stiffness: Array | None, frames: int, order: int, scale: str
) -> Float[Array, "changes 1 #joints"]:
    """sigma times the root of what the prior weighs each |v_t|^2 or |v_t - v_{t-1}|^2 with."""
    if stiffness is None:
        of_frames = np.ones((frames, 1), lam.dtype)
    else:
        of_frames = stiffness.reshape(frames, -1)
    if order == 2:
        rows = (0.5 if scale == "half" else 1.0) * lam * sigma * of_frames[1:-1]
    else:
        printed = np.full((frames - 1, 1), 2.0**0.5, lam.dtype)
        printed[:1] = printed[-1:] = 1.0
        rows = jnp.sqrt(lam * of_frames[1:]) * sigma * printed
    return rows[:, None]


def _between(problem: _Problem, ends: Ends) -> _Problem:
    """The problem of the frames that data lie between."""
    inside, order = ends.inside(problem.seen.num_frames), problem.order
    rows = jnp.where((inside[:-order] & inside[order:])[:, None], problem.rows, 0)
    beyond = (~inside[:, None]).astype(problem.start.dtype)
    return eqx.tree_at(
        lambda p: (p.rows, p.beyond), problem, (rows, beyond), is_leaf=lambda leaf: leaf is None
    )


@keepable
@eqx.filter_jit
def _solve(problem: _Problem, throw: bool, joints: tuple[int, ...]) -> GeodesicPosterior:
    whole, ends = problem, None
    if problem.weights is not None or problem.seen.frame is not None:
        counts = jnp.ones((len(problem.data), 1)) if problem.weights is None else problem.weights
        ends = ends_of(problem.seen, counts > 0)
        problem = _between(problem, ends)
    frozen = jax.tree.map(lax.stop_gradient, problem)
    unmoved = frozen.unmoved
    found = optimistix.least_squares(
        _residuals,
        GaussNewton(0.0, float(jnp.finfo(unmoved.dtype).eps) ** (2 / 3), problem.order),
        unmoved,
        frozen,
        max_steps=_MAX_STEPS,
        throw=False,
    )
    answer = lax.stop_gradient(frozen.rotations(found.value))
    if throw:
        message = (
            "geodesic: Gauss-Newton did not converge; lam * sigma is too large for the dtype, or "
            "data lie half a turn from the smoothed motion. Use float64, a smaller lam * sigma, "
            "weights or a robust loss, or throw=False to look at the last iterate"
        )
        failed = found.result != optimistix.RESULTS.successful
        answer = raise_faults(answer, [(failed, message)])
    problem = eqx.tree_at(lambda p: p.start, problem, answer)

    def solve(hessian, b):
        blocks = probe_blocks(hessian, jax.eval_shape(lambda: b), problem.order)
        factor = block_banded_factor(blocks, throw=False)
        faults = _no_minimum(factor) if throw else []
        return block_banded_substitute(factor, raise_faults(b, faults))

    def tangent_solve(hessian, b):
        return lax.custom_linear_solve(hessian, b, solve, symmetric=True)

    # The answer again, as the root of the torque: nothing moves, but derivatives pass.
    turn = lax.custom_root(
        lambda turn: _torque(turn, problem), unmoved, lambda _, start: start, tangent_solve
    )
    mean = problem.rotations(turn)
    mean = mean if ends is None else ends.continued(mean, problem.order)
    whole = eqx.tree_at(lambda p: p.start, whole, mean)
    steps = jnp.asarray(found.stats["num_steps"])
    return GeodesicPosterior(mean.reshape(-1, *joints, 4), steps, found.result, whole)


def _no_minimum(hessian: BlockBandedFactor) -> list[Fault]:
    """The fault of an answer that has no derivative; steps can end where the cost is balanced."""
    message = (
        "geodesic: no derivative: the answer is no strict minimum. Data lie half a turn apart, a "
        "robust loss weighs equal groups of them against each other, or lam * sigma is too large "
        "for the dtype"
    )
    return [(~jnp.all(jnp.isfinite(hessian.roots)), message)]
