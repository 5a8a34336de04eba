"""The stiffness of heavy tails as a function that has derivatives.

Where λ, σ and ν are given, what :mod:`.heavy_tails` goes to is the root of

    u_t (ν + z_t(u)) = ν + C        z_t = E ‖x″_t‖²/τ² of the smoother of stiffness √u, τ = 1/λ

("half": τ = 2/λ), and with w = log u it is the top of log p(y | u) + ν/2 Σ (w_t − u_t): log u of a
Gamma(ν/2, ν/2) prior, the frames integrated out. So the slope of the root's equation by w is
symmetric, and positive definite at a strict top: conjugate gradients find the root's derivative,
and nothing is unrolled.

There may be several tops. The search begins at the bends of the data themselves, or where it is
told to; w ← log((ν + C)/(ν + z)) never goes down, and is drawn out along its own last two steps,
which saves three looks of four. O(N) a look, some thirty to a hundred of them.

Varadhan & Roland 2008 (SQUAREM, S3).
"""

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxmotion._checks import no_module, one_of, raise_faults, static
from jaxmotion._entry import MISSING, finite_clip
from jaxmotion._numerics import safe_norm
from jaxmotion._program import keepable
from jaxmotion._types import ArrayLike
from jaxmotion.motion import Motion
from jaxmotion.smoothing.components import to_components
from jaxmotion.smoothing.design import check_known, frame_count
from jaxmotion.smoothing.heavy_tails import DOF, expected_bends, known_bends, usual_bends
from jaxmotion.smoothing.lgs import Posterior, checked_parameter, checked_stiffness, lgs
from jaxmotion.smoothing.tuning import NOISY_SHARE

_CYCLES, _PATIENCE = 300, 80
_ROUNDING = 8192  # of eps
_FARTHEST = 2.0  # how far a step of log u is drawn out
_CONJUGATE = 300
_ROUGH = 0.01  # λσ that leaves the data as they are


class _Problem(NamedTuple):
    """``y`` f[Nd, G, C]; λ, σ, ν f[G]; weights as ``y`` and frames of the data, or None."""

    y: Array
    lam: Array
    sigma: Array
    dof: Array
    weights: Array | None
    index: Array | None

    def smoothed(self, stiffness: Array | None, frames: int | None, scale: str) -> Posterior:
        lam, sigma = self.lam[:, None], self.sigma[:, None]
        if stiffness is None:
            lam, sigma = jnp.asarray(_ROUGH, lam.dtype), jnp.ones((), lam.dtype)
        else:
            stiffness = stiffness[:, :, None]
        kept = {"index": self.index, "num_frames": frames, "weights": self.weights}
        return lgs(self.y, lam, sigma, stiffness=stiffness, scale=scale, **kept)


@static("num_frames")
def student_stiffness(
    y: ArrayLike | Motion,
    lam: ArrayLike,
    sigma: ArrayLike,
    dof: ArrayLike,
    *,
    index: ArrayLike | None = None,
    num_frames: int | None = None,
    weights: ArrayLike | None = None,
    scale: Literal["half", "unit"] = "half",
    start: ArrayLike | None = None,
) -> Float[Array, "frames *joint"]:
    """How firm the prior is at each frame where second differences are Student's t.

    Give the result to :func:`~jaxmotion.smoothing.lgs` (or ``smooth_quaternions``,
    ``smooth_motion``) as ``stiffness``, with the same λ and σ: sudden moves stay. Derivatives by λ,
    σ, ν, data and weights are exact in both modes, by the implicit function theorem, so that those
    of the smoother that it is given to are too. O(Nd + Nf) a look.

    **Arguments:**

    - ``y``: f[Nd, J, *channels], whose J joints have a scale each, shared by their channels; f[Nd]
      is one joint; or a motion, whose rotations it then is.
    - ``lam``, ``sigma``, ``dof``: λ, σ (in y's unit; of a motion in half angles about each axis)
      and degrees of freedom ν, > 0, scalars or f[J], as ``tune(y, prior="student")`` learns them.
    - ``index``, ``num_frames``, ``scale``: as :func:`~jaxmotion.smoothing.lgs`; ``weights``: f[Nd]
      or f[Nd, J], 0 for missing.
    - ``start``: f[Nf] or f[Nf, J], > 0, where to begin, as where a move is as well noise as
      sudden there are two answers (``tune``'s ``stiffness`` leads to ``tune``'s). None: at the
      data's own second differences.

    **Returns:** f[Nf, J], or f[Nf], at most √(1 + C/ν) for C channels; 1 at both ends and where no
    data tell.
    **Raises:** ``ValueError`` for what is known to be wrong; at run time for traced values that
    are, and where the search does not end, as for ν near 0; as :func:`~jaxmotion.smoothing.lgs`.

    **Example:**

        >>> import jax, jax.numpy as jnp, jaxmotion as jm
        >>> step = jnp.where(jnp.arange(60) < 30, 0.0, 1.0)
        >>> def smooth(dof):
        ...     stiffness = jm.smoothing.student_stiffness(step, 50.0, 0.1, dof)
        ...     return jm.smoothing.lgs(step, 50.0, 0.1, stiffness=stiffness).mean
        >>> blur = lambda dof: jnp.abs(smooth(dof) - step).max()
        >>> [round(float(blur(dof)), 2) for dof in (1.0, 100.0)]
        [0.03, 0.38]
        >>> bool(jax.grad(blur)(3.0) > 0)
        True
    """
    one_of("scale", scale, ("half", "unit"))
    if isinstance(y, Motion):
        y = finite_clip(
            "student_stiffness", y, "y", weights=weights, at_run_time=True, hint=MISSING
        )
        weights = None if weights is None else jnp.asarray(weights, y.dtype)
        y = to_components(y.rotations, weights, index)
        lam, sigma = jnp.asarray(lam) * NOISY_SHARE, jnp.asarray(sigma) / NOISY_SHARE
    no_module("student_stiffness: y", y)
    y = jnp.asarray(y)
    check_known("student_stiffness: y", y, weights, index, num_frames)
    joints = y.shape[1:2]
    grouped = y.reshape(y.shape[0], math.prod(joints), -1)
    lam, sigma, dof = (
        jnp.broadcast_to(checked_parameter(name, value, joints, y.dtype), joints).reshape(-1)
        for name, value in (("lam", lam), ("sigma", sigma), ("dof", dof))
    )
    frames = frame_count(index, num_frames, y.shape[0])
    if weights is not None:
        weights = jnp.asarray(weights, y.dtype)
        weights = weights.reshape(weights.shape + (1,) * (3 - weights.ndim))
    if start is not None:
        start = checked_stiffness(start, frames, joints, y.dtype)
        start = jnp.broadcast_to(start.reshape(frames, -1), (frames, grouped.shape[1]))
    if frames < 3:
        return jnp.ones((frames, *joints), y.dtype)
    problem = _Problem(
        grouped, lam, sigma, dof, weights, None if index is None else jnp.asarray(index)
    )
    return _stiffness(problem, start, frames, scale).reshape(frames, *joints)


@keepable
@eqx.filter_jit
def _stiffness(problem: _Problem, start: Array | None, frames: int, scale: str) -> Array:
    channels = problem.y.shape[-1]
    frozen = lax.stop_gradient(problem)
    rough = frozen.smoothed(None, frames, scale)
    known = known_bends(rough) & (frozen.dof > 0)
    unit = 0.25 if scale == "half" else 1.0

    def spread(w: Array) -> Array:
        """Stiffness of all frames from log u of the bends, of which unknown ones have no say."""
        return jnp.exp(0.5 * jnp.pad(jnp.where(known, w, 0), ((1, 1), (0, 0))))

    def expected(w: Array, problem: _Problem) -> Array:
        """ν + z."""
        post = problem.smoothed(spread(w), frames, scale)
        return problem.dof + unit * problem.lam**2 * expected_bends(post)

    def ahead(w: Array) -> Array:
        return jnp.where(known, jnp.log((frozen.dof + channels) / expected(w, frozen)), 0)

    def unbalanced(w: Array) -> Array:
        balance = jnp.exp(w) * expected(w, problem) / (problem.dof + channels) - 1
        return jnp.where(known, balance, w)

    if start is None:
        first = jnp.log((DOF + channels) / (DOF + usual_bends(rough, known)))
    else:
        first = 2 * jnp.log(lax.stop_gradient(start)[1:-1])
    found, change = _climbed(ahead, jnp.where(known, first, 0))
    message = (
        "student_stiffness: the search did not end: its dof, lam * sigma or data are too large or "
        "too small for the dtype"
    )
    positive = jnp.all((frozen.dof > 0) & jnp.isfinite(frozen.dof))
    ended = change <= float(jnp.finfo(found.dtype).eps) ** 0.4
    faults = [(~positive, "dof must be positive"), (~ended, message)]
    found = raise_faults(found, faults)

    def tangent_solve(slope, b):
        precise = float(jnp.finfo(b.dtype).eps) ** 0.75

        def solve(product, b):
            return jax.scipy.sparse.linalg.cg(product, b, tol=precise, maxiter=_CONJUGATE)[0]

        return lax.custom_linear_solve(slope, b, solve, symmetric=True)

    # The answer again, as a root: nothing moves, but derivatives pass.
    return spread(lax.custom_root(unbalanced, found, lambda _, w: w, tangent_solve))


def _climbed(
    ahead: Callable[[Array], Array], w: Float[Array, "bends group"]
) -> tuple[Float[Array, "bends group"], Float[Array, ""]]:
    """Where ``ahead`` leads to, and the least that a step went: it ends where steps are rounding,
    or have not become shorter for a while."""
    rounding = _ROUNDING * float(jnp.finfo(w.dtype).eps)

    def moving(state):
        k, shorter, _, least = state
        return (k < _CYCLES) & (k - shorter < _PATIENCE) & ~(least <= rounding)

    def cycle(state):
        k, shorter, w, least = state
        one = ahead(w)
        two = ahead(one)
        step, turn = one - w, (two - one) - (one - w)
        size, bend = safe_norm(step, axis=0), safe_norm(turn, axis=0)
        along = jnp.maximum(size / jnp.where(bend > 0, bend, size + 1), 1)
        drawn = w + 2 * along * step + along**2 * turn
        drawn = jnp.clip(drawn, two - _FARTHEST, two + _FARTHEST)
        three = ahead(drawn)
        better = safe_norm(three - drawn, axis=0) < size
        change = jnp.max(jnp.abs(two - one))
        shorter = jnp.where(change < least, k, shorter)
        return k + 1, shorter, jnp.where(better, three, two), jnp.minimum(change, least)

    start = 0, jnp.zeros((), int), w, jnp.asarray(jnp.inf, w.dtype)
    _, _, w, least = lax.while_loop(moving, cycle, start)
    return w, least
