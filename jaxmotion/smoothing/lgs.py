"""Linear Gaussian system smoother (Eom, Choi and Noh, 2019, section 3).

    y = A x + noise of std sigma,       prior on x with precision Q

    order 2 (Eq. 6)   Q = lam^2 L^T L, rows of L (-1/2, 1, -1/2) "half" (Eq. 3), (1, -2, 1) "unit"
    order 1 (Eq. 7)   Q = lam D^T C D, rows of D (-1, 1), C = diag(1, 2, .., 2, 1) as printed

    P = Q + A^T W A / sigma^2,   mean = P^-1 A^T W y / sigma^2,   covariance = P^-1

    x    smoothed frames (Nf, *channels)     y    data (Nd, *channels), any unit, kept throughout
    A    whole or fractional target frames   W    weights of the data, diagonal
    lam  prior precision, > 0                sigma  std of the noise, in the unit of y, > 0

The mean depends on the product lam sigma (order 2) or lam sigma^2 (order 1) only; "half" at lam is
"unit" at lam / 2. Half amplitude, order 2, unit: f = (fps / pi) asin(1 / (2 sqrt(lam sigma))).
Order 2 keeps straight lines and continues them beyond the data, order 1 keeps constants.

``log_evidence`` is log p(y | lam, sigma) with the null space of Q integrated out under flat density
1 in the level of frame 0 and, for order 2, the slope per frame. With N data of positive weight, m
the dimension of that null space and ``r_j`` the prior precision of every (second) difference,

    -2 log p = (N - m) log 2 pi + sum log(sigma^2 / w_i) - sum log r_j + log det P + J
    J = sum w_i (y_i - (A x)_i)^2 / sigma^2 + x^T Q x   at the mean

It does not change when frames without data are added at either end (order 1: beyond one on each
side, as the printed C counts the end differences once), and it is the density of the data's
contrasts free of level and slope (restricted likelihood) times ``det(X^T X)^(-1/2)``, X the columns
(1, t_i) of the observed data.

Cost O(Nd + Nf): shared lam, sigma and weights are factored once for all channels. Solved for the
positions and velocities (``linalg.difference_chain``): float32 holds five digits from lam sigma
= 1e-6 to 1e4 and across gaps of 200 frames, where a banded Cholesky breaks down in either dtype. As
lam sigma goes to 0 the mean goes to the smoothest curve through the data (order 2: the discrete
cubic spline), as it grows to their straight line (order 1: their level).

Sharp bits: with Nf = 1, or Nf = 2 at order 2, there is no prior row: plain weighted least squares.
Float32 extrapolation loses digits as the square of (frames beyond the data / span of the data).
"""

import math
from collections.abc import Iterator
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion._checks import Fault, known, no_module, one_of, raise_faults, require, static, traced
from jaxmotion._portable import Portable
from jaxmotion._program import keepable
from jaxmotion._summary import per_frame
from jaxmotion._types import ArrayLike, Key
from jaxmotion.linalg import (
    DifferenceChain,
    Knowledge,
    chain_bend_variance,
    chain_factor,
    chain_log_det,
    chain_sample,
)
from jaxmotion.linalg.chain_ways import Way, knowledge_by, loses, smooth_by, way_of
from jaxmotion.smoothing.design import Observations, check_finite, observe


class Posterior(Portable):
    """What the smoother knows about every frame.

    Every quantity but the mean is worked out when asked for, so that a mean alone never pays for
    it. All are differentiable.

    **Fields:** ``mean``: f[Nf, *channels].
    """

    mean: Float[Array, "frames *channels"]
    _sigma: Float[Array, "..."]
    _chain: DifferenceChain  # sigma^2 P
    _prior: tuple[Array, Array]  # sigma^2 times the penalties of v_{j+1} - v_j and of v_j
    _data: Float[Array, "data *channels"]
    _observations: Observations
    _order: int = eqx.field(static=True)
    _shared: bool = eqx.field(static=True)
    _way: Way = eqx.field(static=True)

    def _words(self) -> Iterator[str]:
        yield per_frame(self.mean)
        yield f"order {self._order}"

    @property
    @jax.jit
    def variance(self) -> Array:
        """Variance of each frame: f[Nf] when lam, sigma and weights are shared by all channels,
        else f[Nf, *k], which broadcasts against the mean. O(Nf).
        """
        return self._per_frame(self._knowledge().covariance().position)

    @property
    @jax.jit
    def lag_one_covariance(self) -> Array:
        """Covariance of frames j and j + 1, f[Nf - 1] or f[Nf - 1, *k]. O(Nf)."""
        x, cross, _ = self._knowledge().covariance()
        return self._per_frame(x[1:] - cross[1:])

    @property
    @jax.jit
    def bend_variance(self) -> Array:
        """Variance of each second difference x_{j-1} - 2 x_j + x_{j+1}, f[Nf - 2] or f[Nf - 2, *k],
        without the loss of digits that the variances of frames would bring. O(Nf)."""
        return self._per_frame(chain_bend_variance(chain_factor(self._chain)))

    @property
    def readings(self) -> Array:
        """Weight of the data at each frame, 0 where there are none, f[Nf, *k]."""
        return self._chain.weight

    @property
    def fitted(self) -> Array:
        """``A mean``: what the mean says each datum should have been, f[Nd, *channels]."""
        return self._observations.at_data(self.mean)

    @property
    @jax.jit
    def leverage(self) -> Array:
        """``w_i`` times the posterior variance of ``(A x)_i`` over ``sigma^2``: the diagonal of the
        hat matrix, f[Nd, *k]; its sum is the effective number of parameters. O(Nf + Nd).
        """
        return self._observations.leverage(self._knowledge())

    @property
    @jax.jit
    def energy(self) -> Array:
        """J of the module, the least weighted misfit plus roughness, f[*channels]."""
        return _scaled_energy(self) / self._sigma**2

    @property
    def log_evidence(self) -> Array:
        """Log density of the data given lam and sigma, one number per channel, f[*channels]."""
        return _log_evidence(self)

    def sample(self, key: Key, shape: tuple[int, ...] = ()) -> Array:
        """Independent draws of the frames.

        O(Nf) each.

        **Arguments:** ``key``: a key of :mod:`jax.random`; ``shape``: how many, () for one.
        **Returns:** f[*shape, Nf, *channels].
        """
        factor = chain_factor(self._chain)
        keys = jax.random.split(key, math.prod(shape))
        noise = jax.vmap(lambda key: chain_sample(factor, key, self.mean.shape[1:]))(keys)
        return (self.mean + self._sigma * noise).reshape(*shape, *self.mean.shape)

    def _knowledge(self) -> Knowledge:
        return knowledge_by(self._way, self._chain)

    def _per_frame(self, covariance: Array) -> Array:
        covariance = covariance * self._sigma**2
        return covariance.reshape(covariance.shape[0]) if self._shared else covariance


@static("num_frames", "order", "parallel")
def lgs(
    y: ArrayLike,
    lam: ArrayLike,
    sigma: ArrayLike,
    *,
    index: ArrayLike | None = None,
    num_frames: int | None = None,
    order: int = 2,
    weights: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    scale: str = "half",
    parallel: bool | None = None,
) -> Posterior:
    """Smooth, denoise or resample a signal.

    O(Nd + Nf). Differentiable in y, lam, sigma, weights, stiffness and a fractional index, in both
    modes. Source: Eom et al. 2019, Eq. 6, 7.

    **Arguments:**

    - ``y``: f[Nd, *channels], float32 or float64, any unit.
    - ``lam``, ``sigma``: prior precision and noise std (in y's unit), > 0; scalars or arrays
      broadcasting to ``channels``, traced or not.
    - ``index``: [Nd], target frame of every datum, whole or fractional, in any order, repeats and
      gaps allowed; None for one datum per frame.
    - ``num_frames``: Nf; may be left out without an index or when the index is not traced (then up
      to its largest entry).
    - ``order``: 2 smooths velocities (Eq. 6), 1 positions (Eq. 7).
    - ``weights``: f[Nd] or f[Nd, *k], ≥ 0, dividing the noise variance; 0 is missing, whatever y
      holds there, and has no derivative.
    - ``stiffness``: f[Nf] or f[Nf, *k], > 0: lam of each frame is lam times this, so that the prior
      may be firm here and yield there. Order 2: of the second difference centred on the frame (the
      ends have none); order 1: of the step into the frame (frame 0 has none).
    - ``scale``: "half" or "unit" rows of L (order 2 only).
    - ``parallel``: find mean, variance, lag-one covariance and leverage in O(log Nf) steps one
      after another, with more work: for a GPU or TPU (``linalg.parallel_chain``); same answers, or
      an error where gaps are too long and lam * sigma too small for the dtype. Evidence and samples
      are sequential either way.

    **Returns:** :class:`Posterior`, in y's dtype.
    **Raises:** ``ValueError`` for wrong shapes and options and for values known to be wrong; at run
    time for traced ones (:func:`jaxmotion.checks`): lam, sigma, stiffness not positive, weights
    negative, index outside the frames, data at fewer than two distinct frames (one for order 1),
    NaN in y at positive weight. At run time, known or not: a lam * sigma that the dtype cannot
    hold.
    """
    no_module("lgs: y", y, "jaxmotion.smoothing.smooth_motion takes motions")
    given, y = y, _checked_data(y)
    channels = y.shape[1:]
    one_of("order", order, (1, 2))
    one_of("scale", scale, ("half", "unit"))
    shared = np.ndim(lam) == 0 and np.ndim(sigma) == 0
    shared = shared and all(x is None or np.ndim(x) == 1 for x in (weights, stiffness))
    lam = checked_parameter("lam", lam, channels, y.dtype)
    sigma = checked_parameter("sigma", sigma, channels, y.dtype)
    seen, faults = observe(index, num_frames, weights, y.shape, y.dtype, null_space=order)
    check_finite("y", given, weights)
    if stiffness is not None:
        stiffness = checked_stiffness(stiffness, seen.num_frames, channels, y.dtype)
    way = way_of(parallel, seen.num_frames, math.prod(channels))
    return _lgs(y, lam, sigma, stiffness, seen, faults, order, scale, shared, way)


@keepable
@eqx.filter_jit
def _lgs(
    y: Array,
    lam: Array,
    sigma: Array,
    stiffness: Array | None,
    seen: Observations,
    faults: list[Fault],
    order: int,
    scale: str,
    shared: bool,
    way: Way,
) -> Posterior:
    for name, value in (("lam", lam), ("sigma", sigma), ("stiffness", stiffness)):
        if value is not None:
            bad = ~jnp.all((value > 0) & jnp.isfinite(value))
            faults = [*faults, (bad, f"{name} must be positive")]
    if seen.weights is not None:
        y = jnp.where(seen.weights > 0, y, 0)
    # Everything is multiplied by sigma^2: plain data are then their own right-hand side.
    lam_of_frames = lam if stiffness is None else lam * stiffness
    curvature, speed = _penalties(lam_of_frames, sigma, seen.num_frames, order, scale)
    data = seen.readings(y)
    chain = DifferenceChain(curvature, data.weight, data.back, data.speed + speed)
    mean = smooth_by(way, chain, data.value, data.push)
    if way == "parallel":
        lossy = (
            "parallel=True loses digits over gaps this long at a lam * sigma this small for its "
            "dtype: leave it out"
        )
        faults = [*faults, (loses(chain), lossy)]
    # Any NaN or infinity of the data reaches every frame of its channel.
    unusable = (
        ~jnp.all(jnp.isfinite(mean[0])),
        "y holds NaN or infinite values (give missing data weight 0), "
        "or lam * sigma is too large or too small for its dtype",
    )
    # Every quantity of the posterior is made of one of these.
    mean, sigma = raise_faults((mean, sigma), [*faults, unusable])
    return Posterior(mean, sigma, chain, (curvature, speed), y, seen, order, shared, way)


def _penalties(
    lam: Array, sigma: Array, frames: int, order: int, scale: str
) -> tuple[Array, Array]:
    """``sigma^2 Q`` as penalties on each change of velocity and on each velocity, ``(Nf, *k)``."""
    rows = np.zeros((frames, *[1] * sigma.ndim))
    none = jnp.zeros(rows.shape, lam.dtype)
    if order == 2:
        rows[1:-1] = 1.0 if scale == "unit" else 0.25
        return jnp.asarray(rows, lam.dtype) * (lam * sigma) ** 2, none
    rows[1:] = 2.0
    rows[1:2] = rows[-1:] = 1.0
    rows[0] = 0.0
    return none, jnp.asarray(rows, lam.dtype) * (lam * sigma**2)


@eqx.filter_jit
def _log_evidence(posterior: Posterior) -> Array:
    y, seen, variance = posterior._data, posterior._observations, posterior._sigma**2
    curvature, speed = posterior._prior
    penalty = curvature[1:-1] if posterior._order == 2 else speed[1:]
    count, log_weight = jnp.asarray(y.shape[0], y.dtype), jnp.zeros((), y.dtype)
    if seen.weights is not None:
        present = seen.weights > 0
        count = jnp.sum(present, axis=0).astype(y.dtype)
        log_weight = jnp.sum(jnp.log(jnp.where(present, seen.weights, 1)), axis=0)
    null_space = min(posterior._order, posterior.mean.shape[0])
    return -0.5 * (
        (count - null_space) * jnp.log(2 * np.pi * variance)
        - log_weight
        - jnp.sum(jnp.log(penalty), axis=0)
        + chain_log_det(posterior._chain)
        + _scaled_energy(posterior) / variance
    )


def _scaled_energy(posterior: Posterior) -> Array:
    curvature, speed = posterior._prior
    penalty = curvature[1:-1] if posterior._order == 2 else speed[1:]
    terms = (posterior._data, posterior._observations, penalty)
    return _least_energy(terms, posterior.mean, posterior._order)


@partial(jax.custom_jvp, nondiff_argnums=(2,))
def _least_energy(terms: tuple[Array, Observations, Array], x: Array, order: int) -> Array:
    """``sigma^2 J`` at its minimiser x: its derivative in x is zero, no solve to differentiate."""
    return _energy(terms, x, order)


@_least_energy.defjvp
def _least_energy_jvp(order, primals, tangents):
    (terms, x), (change, _) = primals, tangents
    return jax.jvp(lambda terms: _energy(terms, x, order), (terms,), (change,))


def _energy(terms: tuple[Array, Observations, Array], x: Array, order: int) -> Array:
    y, seen, penalty = terms
    misfit = (y - seen.at_data(x)) ** 2
    misfit = misfit if seen.weights is None else seen.weights * misfit
    roughness = jnp.diff(x, n=order, axis=0) ** 2
    return jnp.sum(misfit, axis=0) + jnp.sum(penalty * roughness, axis=0)


def _checked_data(y: ArrayLike) -> Array:
    y = jnp.asarray(y)
    if y.dtype not in (jnp.float32, jnp.float64):
        raise ValueError(f"y has dtype {y.dtype}: want float32 or float64")
    if y.ndim == 0:
        raise ValueError("y is a scalar: want (frames, *channels)")
    return y


def checked_stiffness(
    value: ArrayLike, frames: int, channels: tuple[int, ...], dtype: jnp.dtype
) -> Array:
    """``value`` as an array with an axis for the frames and one for each channel axis."""
    check_positive("stiffness", value)
    value = jnp.asarray(value, dtype)
    shape = value.shape
    if value.ndim == 1:
        value = value.reshape(-1, *[1] * len(channels))
    fits = value.ndim == 1 + len(channels) and all(
        s in (1, c) for s, c in zip(value.shape[1:], channels, strict=True)
    )
    if not fits or value.shape[0] != frames:
        raise ValueError(
            f"stiffness has shape {shape}: want ({frames},), or also axes that broadcast to the "
            f"channels, {channels}"
        )
    return value


def checked_parameter(
    name: str, value: ArrayLike, channels: tuple[int, ...], dtype: jnp.dtype
) -> Array:
    """``value`` as an array with one axis for each channel axis."""
    check_positive(name, value)
    value = jnp.asarray(value, dtype)
    padded = (1,) * (len(channels) - value.ndim) + value.shape
    if len(padded) != len(channels) or any(
        s not in (1, c) for s, c in zip(padded, channels, strict=True)
    ):
        raise ValueError(
            f"{name} has shape {value.shape}: want a scalar or an array that broadcasts to the "
            f"channels of y, {channels}"
        )
    return value.reshape(padded)


def check_positive(name: str, value: ArrayLike) -> None:
    """``ValueError`` for a parameter known not to be; of all that is traced, lgs has one check."""
    if not traced(value):
        number = known(value)
        wrong = not np.all((number > 0) & np.isfinite(number))
        require(value, wrong, f"{name} must be positive and finite", got=value)
