"""Smoothing a live stream: one frame in, one frame out, ``lag`` frames late.

    returned at frame t:  x_{t-lag} of the LGS (order 2) of frames 0 .. t

The recursion of ``linalg.difference_chain`` and its symbols, run as frames arrive. Keep what frames
0 .. t know of (x_t, v_t), and every frame of the window as a linear function of the two,

    x_j = phi_j + u_j x_t + w_j v_t  + what later frames cannot change,       j = t - lag .. t

Eliminating v_t, with x_t = x+ - v+ and v_t = slack v+ + hold x_t + o,

    hold = a m / (D + a m^2)     slack = p / (D + a m^2)     o = k / (D + a m^2) - hold y

gives ``phi' = phi + w o``, ``u' = u + hold w``, ``w' = slack w - u'`` for the whole window at once:
no pass backwards, and no prior guess of the first frames is needed.

    lam, sigma  as for ``lgs``; only their product matters here        lag  frames of delay
    y           frame ``(*channels,)``, any unit; rotations: ``(*joints, 4)`` unit quaternions

Cost O(lag) a frame and in memory, whatever the length of the stream. The gains ``u, w, hold`` are
shared by all channels that share lam, sigma and weight. What frames after t would still change in
x_{t-lag} falls as exp(-lag / sqrt(2 rho)), rho = lam sigma in unit, half of it in half scale.

Rotations are smoothed as in Eq. 11 of Eom et al. (2019): each frame takes the sign nearest to the
last one seen, the four components are smoothed, and the result is renormalised.

Source: the information filter and fixed-lag smoother of an integrated random walk (Anderson and
Moore, *Optimal Filtering*, 1979, ch. 7).
"""

from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxmotion import quaternion
from jaxmotion._checks import known, one_of, require
from jaxmotion._numerics import safe_norm
from jaxmotion._portable import Portable
from jaxmotion._summary import brief
from jaxmotion._types import ArrayLike
from jaxmotion.linalg.difference_chain import (
    Information,
    eliminate,
    over,
    shifted,
    with_reading,
)


class StreamState(Portable):
    """What a stream remembers; ``(*k)`` is the shape of lam, sigma and the weights together.

    **Fields:**

    - ``information``: about (x_t, v_t), each f[*k].
    - ``vector``: where it is centred, y, and its slope in v_t, k, each f[*channels].
    - ``offset``: f[lag + 1, *channels], phi, oldest frame first.
    - ``gains``: u and w, each f[lag + 1, *k].
    - ``level``: f[*channels], first value seen; all else is relative to it.
    - ``seen``: bool[*k], whether any frame was seen.
    - ``curvature``: f[*k], penalty of v_{t+1} - v_t from the next frame on.
    - ``reference``: f[*channels], last frame seen, signs aligned.
    - ``frame``: i32[], frames taken in.
    """

    information: Information
    vector: tuple[Array, Array]
    offset: Float[Array, "window *channels"]
    gains: tuple[Array, Array]
    level: Float[Array, "*channels"]
    seen: Bool[Array, "..."]
    curvature: Float[Array, "..."]
    reference: Float[Array, "*channels"]
    frame: Int[Array, ""]

    def _words(self) -> Iterator[str]:
        yield f"frame={brief(self.frame)}"
        yield f"each {brief(self.reference)}"
        yield f"lag {self.offset.shape[0] - 1}"


class StreamingSmoother(Portable):
    """The LGS of a stream, ``lag`` frames late: pure ``init``, ``step`` and ``flush``.

    Differentiable in lam, sigma and the frames. O(lag) a frame.

    **Fields:** ``lam``, ``sigma``: prior precision and noise std, > 0; scalars or arrays that
    broadcast to the channels of a frame (for rotations, to its joints); ``lag``: frames of delay,
    static, 0 filters; ``scale``: "half" or "unit", as :func:`~jaxmotion.smoothing.lgs`, static;
    ``rotations``: whether frames are unit quaternions f[*joints, 4], static.
    **Raises:** ``ValueError`` for another ``scale``, a negative ``lag``, and parameters known not
    to be positive; at run time for traced ones.

    **Example:**

        >>> import jax, jax.numpy as jnp, jaxmotion as jm
        >>> y = jnp.arange(20.0)
        >>> smoother = jm.smoothing.StreamingSmoother(1.0, 1.0, lag=5)
        >>> state, late = jax.lax.scan(smoother.step, smoother.init(y[0]), y)
        >>> smooth = jnp.concatenate([late[5:], smoother.flush(state)])
        >>> smooth.shape, bool(jnp.abs(smooth - y).max() < 1e-4)
        ((20,), True)
    """

    lam: Float[Array, "..."]
    sigma: Float[Array, "..."]
    lag: int = eqx.field(static=True)
    scale: str = eqx.field(static=True)
    rotations: bool = eqx.field(static=True)

    def __init__(
        self,
        lam: ArrayLike,
        sigma: ArrayLike,
        *,
        lag: int = 30,
        scale: str = "half",
        rotations: bool = False,
    ):
        if lag < 0:
            raise ValueError(f"lag={lag}: want 0 frames or more")
        one_of("scale", scale, ("half", "unit"))
        self.lam, self.sigma = _checked("lam", lam), _checked("sigma", sigma)
        self.lag, self.scale, self.rotations = lag, scale, rotations

    # By identity: scan keeps functions by their hash, and arrays have none.
    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)

    def init(self, frame: ArrayLike, weight: ArrayLike = 1.0) -> StreamState:
        """State before the first frame.

        Only shapes and dtype, examples of what ``step`` will get, are used.

        **Arguments:** ``frame``: f[*channels]; ``weight``: a scalar, or per channel or joint, which
        then need their own gains.
        **Returns:** :class:`StreamState`.
        **Raises:** ``ValueError`` for shapes and dtypes that do not fit.
        """
        frame = self._as_frame(frame)
        k = self._shape(frame.shape, np.shape(weight))
        rate = 1.0 if self.scale == "unit" else 0.25
        lam, sigma = (
            self._spread(value.astype(frame.dtype), frame.ndim) for value in (self.lam, self.sigma)
        )
        curvature = jnp.broadcast_to(rate * (lam * sigma) ** 2, k)
        none, blank = jnp.zeros(k, frame.dtype), jnp.zeros_like(frame)
        window = (self.lag + 1, *k)
        return StreamState(
            Information(none, none, none + 1),
            (blank, blank),
            jnp.zeros((self.lag + 1, *frame.shape), frame.dtype),
            (jnp.ones(window, frame.dtype), jnp.zeros(window, frame.dtype)),
            blank,
            jnp.zeros(k, bool),
            curvature,
            blank,
            jnp.zeros((), jnp.int32),
        )

    def step(
        self, state: StreamState, frame: ArrayLike, weight: ArrayLike = 1.0
    ) -> tuple[StreamState, Float[Array, "*channels"]]:
        """Take in frame t, return frame ``t - lag``; until there is one, frame 0 as known so far.

        **Arguments:** ``state``: of ``init`` or the step before; ``frame``: f[*channels];
        ``weight``: ≥ 0, divides the noise variance; 0, or any NaN or infinity among the channels
        that share it, means a missing frame; a scalar, or as in ``init``.
        **Returns:** the next state, and f[*channels].
        **Raises:** ``ValueError`` for shapes and dtypes that do not fit, and a weight that is
        negative or not finite; at run time for a traced one.
        """
        given = known(weight)
        odd = ~((given >= 0) & (given < np.inf)).all()
        message = "StreamingSmoother.step: weight must be finite and >= 0"
        # Everything that the stream returns is relative to its level.
        level = require(state.level, odd, message, got=weight)
        return _step(self, state, level, frame, weight)

    @jax.jit
    def flush(self, state: StreamState) -> Float[Array, "lag *channels"]:
        """The last ``lag`` frames, not returned yet, given all frames.

        Where fewer were taken in, those before the first repeat it.

        **Arguments:** ``state``: of the last step.
        **Returns:** f[lag, *channels].
        """
        x, v = _filtered(state)
        u, w = state.gains
        return self._finish(state.level + state.offset + u * x + w * v)[1:]

    def _finish(self, x: Array) -> Array:
        if not self.rotations:
            return x
        return quaternion.normalize(jnp.where(safe_norm(x, keepdims=True) < 1e-6, 0, x))

    def _as_frame(self, frame: ArrayLike) -> Array:
        frame = jnp.asarray(frame)
        if frame.dtype not in (jnp.float32, jnp.float64):
            raise ValueError(f"frame has dtype {frame.dtype}: want float32 or float64")
        if self.rotations and frame.shape[-1:] != (4,):
            raise ValueError(f"frame has shape {frame.shape}: want quaternions (*joints, 4)")
        return frame

    def _spread(self, value: Array, ndim: int) -> Array:
        """With one axis for each channel axis; quaternions' components share their joint's."""
        if self.rotations and value.ndim:
            value = value[..., None]
        return value.reshape((1,) * (ndim - value.ndim) + value.shape)

    def _shape(self, channels: tuple[int, ...], weight: tuple[int, ...]) -> tuple[int, ...]:
        shapes = {"lam": self.lam.shape, "sigma": self.sigma.shape, "weight": weight}
        k = (1,) * len(channels)
        for name, shape in shapes.items():
            own = (*shape, 1) if self.rotations and shape else shape
            padded = (1,) * (len(channels) - len(own)) + own
            if len(padded) != len(k) or any(
                s not in (1, c) for s, c in zip(padded, channels, strict=True)
            ):
                raise ValueError(
                    f"{name} has shape {shape}: want a scalar or an array that broadcasts to the "
                    f"{'joints' if self.rotations else 'channels'} of a frame, "
                    f"{channels[:-1] if self.rotations else channels}"
                )
            k = tuple(np.broadcast_shapes(k, padded))
        return k

    def _weight(self, weight: ArrayLike, frame: Array, k: tuple[int, ...]) -> Array:
        """``(*k)``; 0 where the frame is not finite."""
        if self._shape(frame.shape, np.shape(weight)) != k and np.ndim(weight):
            raise ValueError(
                f"weight has shape {np.shape(weight)}: give init one of that shape, so that each "
                "has its own gains"
            )
        w = jnp.asarray(weight, frame.dtype)
        shared = tuple(axis for axis, size in enumerate(k) if size == 1)
        whole = jnp.all(jnp.isfinite(frame), axis=shared, keepdims=True)
        w = self._spread(w, frame.ndim)
        return jnp.where(whole & (w > 0), w, 0)  # no derivative where nothing was seen


@jax.jit
def _step(
    smoother: StreamingSmoother,
    state: StreamState,
    level: Array,
    frame: ArrayLike,
    weight: ArrayLike,
) -> tuple[StreamState, Float[Array, "*channels"]]:
    state = eqx.tree_at(lambda s: s.level, state, level)
    frame = smoother._as_frame(frame)
    if frame.shape != state.level.shape or frame.dtype != state.level.dtype:
        raise ValueError(
            f"frame is {frame.dtype} {frame.shape}: the stream has {state.level.dtype} "
            f"{state.level.shape}"
        )
    weight = smoother._weight(weight, frame, state.curvature.shape)
    frame = jnp.where(weight > 0, frame, state.reference)
    if smoother.rotations:
        flip = jnp.sum(frame * state.reference, -1, keepdims=True) < 0
        frame = jnp.where(flip, -frame, frame)
    state = _observe(_advance(state), frame, weight)
    x, v = _filtered(state)
    u, w = state.gains
    return state, smoother._finish(state.level + state.offset[0] + u[0] * x + w[0] * v)


def _advance(state: StreamState) -> StreamState:
    """Eliminate v_t and write everything as functions of (x_{t+1}, v_{t+1})."""
    # v_0 is no difference of frames: nothing ties v_1 to it.
    curvature = jnp.where(state.frame == 1, 0, state.curvature)
    a, m, d = state.information
    (y, k), (u, w) = state.vector, state.gains
    spread = d + curvature
    inverse = over(jnp.ones_like(spread), spread + a * m * m)
    hold = a * m * inverse
    offset = inverse * k - hold * y
    u_next = u + hold * w
    return eqx.tree_at(
        lambda s: (s.information, s.vector, s.offset, s.gains),
        state,
        (
            shifted(eliminate(state.information, curvature)),
            (y + over(m, spread) * k, over(curvature, spread) * k),
            state.offset + w * offset,
            (u_next, curvature * inverse * w - u_next),
        ),
    )


def _observe(state: StreamState, frame: Array, weight: Array) -> StreamState:
    """Add the frame's information, and the frame itself to the window's end."""
    level = jnp.where(~state.seen & (weight > 0), frame, state.level)
    a, m, _ = state.information
    (y, k), (u, w) = state.vector, state.gains
    none = jnp.zeros_like(weight)
    take = over(weight, a + weight)
    apart = frame - level - y
    return StreamState(
        with_reading(state.information, weight, none, none),
        (y + take * apart, k + take * a * m * apart),
        jnp.concatenate([state.offset[1:], jnp.zeros_like(frame)[None]]),
        (
            jnp.concatenate([u[1:], jnp.ones_like(u[:1])]),
            jnp.concatenate([w[1:], jnp.zeros_like(w[:1])]),
        ),
        level,
        state.seen | (weight > 0),
        state.curvature,
        frame,
        state.frame + 1,
    )


def _filtered(state: StreamState) -> tuple[Array, Array]:
    """(x_t, v_t) given frames 0 .. t; with fewer than two seen, at rest at the first."""
    _, m, d = state.information
    y, k = state.vector
    v = over(k, d)
    return y + m * v, v


def _checked(name: str, value: ArrayLike) -> Array:
    array = value if isinstance(value, jax.Array) else jnp.asarray(value, jnp.result_type(float))
    number = known(value)
    wrong = ~((number > 0) & (number < np.inf)).all()
    return require(array, wrong, f"{name} must be positive and finite", got=value)
