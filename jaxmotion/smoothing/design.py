"""Which frames the data speak about: the design matrix A of Eom et al. (2019), Eq. 2.

    y_i = x(t_i) + noise of variance sigma^2 / w_i,      x(t) = (1 - g) x_e + g x_{e-1},   g = e - t

    t_i  target frame of datum i, whole or fractional, in any order, repeats allowed
    e    the frame at or after t, at least 1 for fractional input: the derivative in t is the slope
         of the interval before t (at frame 0, after)
    w_i  weight, 0 for a missing datum

Shapes: data ``(Nd, *channels)``, frames ``(Nf, *channels)``, weights ``(Nd, *k)`` with each axis of
``k`` equal to that channel axis or 1. Everything is O(Nd + Nf).
"""

from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmotion._checks import Fault, fault, known, traced
from jaxmotion._portable import Portable
from jaxmotion._types import ArrayLike
from jaxmotion.linalg.chain_covariance import Knowledge
from jaxmotion.linalg.difference_chain import over


class Design(NamedTuple):
    """Which frames a smoother is to find and by which prior, as :func:`jaxmotion.smoothing.lgs`
    takes it; ``index`` None for a datum a frame."""

    index: ArrayLike | None = None
    num_frames: int | None = None
    order: Literal[1, 2] = 2
    scale: Literal["half", "unit"] = "half"


class Readings(NamedTuple):
    """What the data of each frame say, ``(Nf, *k)``, the last two ``(Nf, *channels)``: weight, how
    many frames before the frame, weight on the velocity; value, push on the velocity or None."""

    weight: Array
    back: Array
    speed: Array
    value: Array
    push: Array | None


class Observations(Portable):
    """A and W. ``frame``: e, None for one datum per frame. ``back``: g, None for whole frames.
    ``weights``: None for ones."""

    frame: Int[Array, " data"] | None
    back: Float[Array, " data"] | None
    weights: Float[Array, "data ..."] | None
    num_frames: int = eqx.field(static=True)

    @property
    def frames(self) -> tuple[Array, ...]:
        """The one or two frames that every datum speaks of."""
        frame = jnp.arange(self.num_frames) if self.frame is None else self.frame
        return (frame,) if self.back is None else (frame - 1, frame)

    def positions(self, dtype: jnp.dtype) -> Array:
        """Target frame of every datum."""
        frame = jnp.arange(self.num_frames) if self.frame is None else self.frame
        return frame.astype(dtype) - (0 if self.back is None else self.back)

    def readings(self, y: Float[Array, "data ..."]) -> Readings:
        """The data of each frame as one reading (``linalg.difference_chain``)."""
        weights = self.weights
        if weights is None:
            weights = jnp.ones((y.shape[0], *[1] * (y.ndim - 1)), y.dtype)
        if self.frame is None:
            none = jnp.zeros_like(weights)
            return Readings(weights, none, none, y, None)
        weight = self._summed(weights)
        if self.back is None:
            none = jnp.zeros_like(weight)
            return Readings(weight, none, none, over(self._summed(weights * y), weight), None)
        back = _column(self.back, y.ndim - 1)
        middle = over(self._summed(weights * back), weight)
        value = over(self._summed(weights * y), weight)
        apart = weights * (back - middle[self.frame])
        speed = self._summed(apart * (back - middle[self.frame]))
        return Readings(
            weight, middle, speed, value, -self._summed(apart * (y - value[self.frame]))
        )

    def _summed(self, values: Array) -> Array:
        """``values (Nd, ...)`` summed frame by frame."""
        return (
            jnp.zeros((self.num_frames, *values.shape[1:]), values.dtype).at[self.frame].add(values)
        )

    def at_data(self, x: Float[Array, "frames ..."]) -> Array:
        """``A x``."""
        if self.frame is None:
            return x
        if self.back is None:
            return x[self.frame]
        now = x[self.frame]
        return now - _column(self.back, x.ndim - 1) * (now - x[self.frame - 1])

    def leverage(self, knowledge: Knowledge) -> Array:
        """``w_i a_i Cov a_i^T`` of every datum, a_i its row of A, from what is known of every
        frame."""
        if self.frame is not None:
            knowledge = jax.tree.map(lambda entry: entry[self.frame], knowledge)
        back = 0.0 if self.back is None else _column(self.back, knowledge.earlier.position.ndim - 1)
        variance = knowledge.covariance(back).position
        return variance if self.weights is None else self.weights * variance


def observe(
    index: ArrayLike | None,
    num_frames: int | None,
    weights: ArrayLike | None,
    data_shape: tuple[int, ...],
    dtype: jnp.dtype,
    null_space: int,
) -> tuple[Observations, list[Fault]]:
    """Check the arguments of a smoother and build its ``Observations``.

    ``null_space``: how many distinct positions the prior needs data at. Known values that are
    wrong raise ValueError; what is wrong with traced ones comes back as
    faults, for the caller to raise together with its own (``raise_faults``).
    """
    num_frames = frame_count(index, num_frames, data_shape[0])
    need = min(null_space, num_frames)
    faults: list[Fault] = []
    t = None if index is None else _checked_index(index, num_frames, data_shape[0], faults)
    w = None if weights is None else _checked_weights(weights, data_shape, faults)
    _require_distinct(t, w, data_shape[0], need)

    frame = back = None
    if t is not None and (traced(t) or not np.array_equal(t, np.arange(num_frames))):
        frame, back = _split(t, num_frames, dtype)
    if w is not None:
        w_found = jnp.asarray(w, dtype)
        w_found = jnp.where(w_found > 0, w_found, 0)  # no derivative where nothing was seen
    found = Observations(frame, back, None if w is None else w_found, num_frames)
    if traced(t, w):
        faults.append((_not_distinct(found, dtype, need), _too_few(need)))
    return found, faults


def check_finite(name: str, y: ArrayLike, weights: ArrayLike | None) -> None:
    """``ValueError`` that calls the data ``name`` where they are known not to be finite at positive
    weight f[Nd] or f[Nd, *k]. What is traced, the smoother itself looks for when it runs."""
    if traced(y, weights):
        return
    y = np.asarray(y)
    finite = np.isfinite(y)
    if finite.all():
        return
    odd = ~finite
    if weights is not None:
        w = np.asarray(weights)
        odd &= w.reshape(w.shape + (1,) * (y.ndim - w.ndim)) > 0
    if odd.any():
        place = ", ".join(map(str, np.argwhere(odd)[0]))
        raise ValueError(
            f"{name} holds NaN or infinite values, at [{place}] first (give missing data weight 0)"
        )


def check_known(
    name: str,
    y: ArrayLike,
    weights: ArrayLike | None,
    index: ArrayLike | None = None,
    num_frames: int | None = None,
    order: Literal[1, 2] = 2,
) -> None:
    """``ValueError`` for what is known to be wrong with data f[Nd, *channels] and weights f[Nd] or
    f[Nd, *k], for those who smooth inside of a compiled function."""
    if all(x is None or traced(x) for x in (y, weights, index)):
        return
    if weights is not None and np.ndim(weights) > 1:
        weights = known(weights)
        weights = weights.reshape(weights.shape + (1,) * (np.ndim(y) - weights.ndim))
    observe(index, num_frames, weights, np.shape(y), jnp.asarray(y).dtype, null_space=order)
    check_finite(name, y, weights)


def frame_count(index: ArrayLike | None, num_frames: int | None, data: int) -> int:
    """Nf: how many frames the smoother is to find, from its arguments and the number of data."""
    if data == 0:
        raise ValueError("y has no data: want at least one frame")
    if index is None:
        if num_frames not in (None, data):
            raise ValueError(
                f"num_frames={num_frames} but y has {data} frames and no index: give the target "
                "frame of every datum, for example index=numpy.linspace(0, num_frames - 1, len(y))"
            )
        return data
    if num_frames is None:
        if traced(index):
            raise ValueError("num_frames is needed when index is traced")
        largest = np.max(np.asarray(index), initial=0)
        num_frames = int(np.ceil(largest)) + 1 if np.isfinite(largest) else 1
    if num_frames < 1:
        raise ValueError(f"num_frames={num_frames}: want at least 1")
    return num_frames


def _checked_index(
    index: ArrayLike, num_frames: int, data: int, faults: list[Fault]
) -> Array | np.ndarray:
    t = known(index)
    if t.shape != (data,):
        raise ValueError(f"index has shape {t.shape}: want ({data},), one target per frame of y")
    if not (jnp.issubdtype(t.dtype, jnp.integer) or jnp.issubdtype(t.dtype, jnp.floating)):
        raise ValueError(f"index has dtype {t.dtype}: want whole or fractional frame numbers")
    message = f"index must lie between 0 and num_frames - 1 = {num_frames - 1}"
    outside = ~((t >= 0) & (t <= num_frames - 1))
    if not traced(t):
        if outside.any():
            raise ValueError(f"{message}, got {t[outside][0]}")
        whole = np.round(t)
        return whole.astype(np.int32) if np.array_equal(whole, t) else t
    faults.append((jnp.any(outside), message))
    return t


def _checked_weights(
    weights: ArrayLike, data_shape: tuple[int, ...], faults: list[Fault]
) -> Array | np.ndarray:
    w = known(weights)
    shape = w.shape
    if len(shape) == 1:
        w = w.reshape(*shape, *[1] * (len(data_shape) - 1))
    fits = w.ndim == len(data_shape) and all(
        s in (1, n) for s, n in zip(w.shape[1:], data_shape[1:], strict=True)
    )
    if not fits or w.shape[0] != data_shape[0]:
        raise ValueError(
            f"weights have shape {shape}: want ({data_shape[0]},) or an array that broadcasts "
            f"over the channels of y, {data_shape}"
        )
    faults += fault(~((w >= 0) & (w < np.inf)).all(), "weights must be finite and >= 0")
    return w


def _split(t: Array | np.ndarray, num_frames: int, dtype: jnp.dtype) -> tuple[Array, Array | None]:
    """Frame at or after each position, and how far after; the latter None for whole frames."""
    if jnp.issubdtype(t.dtype, jnp.integer):
        return jnp.asarray(t), None
    t = jnp.asarray(t)
    frame = jnp.clip(jnp.ceil(t), min(1, num_frames - 1), num_frames - 1)
    return frame.astype(jnp.int32), (frame - t).astype(dtype)


def _require_distinct(
    t: Array | np.ndarray | None, w: Array | np.ndarray | None, data: int, need: int
) -> None:
    if traced(t, w):
        return
    t = np.arange(data) if t is None else t
    seen = np.ones((data, 1), bool) if w is None else w.reshape(data, -1) > 0
    low = np.min(np.where(seen, t[:, None], np.inf), axis=0)
    high = np.max(np.where(seen, t[:, None], -np.inf), axis=0)
    if not np.all(high > low if need == 2 else high >= low):
        raise ValueError(_too_few(need))


def _not_distinct(found: Observations, dtype: jnp.dtype, need: int) -> Array:
    t = _column(found.positions(dtype), 0 if found.weights is None else found.weights.ndim - 1)
    seen = jnp.asarray(True) if found.weights is None else found.weights > 0
    low = jnp.min(jnp.where(seen, t, jnp.inf), axis=0)
    high = jnp.max(jnp.where(seen, t, -jnp.inf), axis=0)
    return ~jnp.all(high > low if need == 2 else high >= low)


def _too_few(need: int) -> str:
    return (
        f"index, weights: the smoother needs data of positive weight at {need} or more distinct "
        "frames in every channel"
    )


def _column(values: Array, axes: int) -> Array:
    return values.reshape(*values.shape, *[1] * axes)
