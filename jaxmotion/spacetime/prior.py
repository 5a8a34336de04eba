"""What keeps a displacement small and smooth, and its inverse in O(T).

    1/2 x^T A x = d/2 sum_t x_t^2 + c/2 sum_t (x_{t+1} - 2 x_t + x_{t-1})^2      every channel alike

As a chain in position x and step v_t = x_t - x_{t-1}, the frames to come cost at least
V_t(x, v) = h11 x^2 + 2 h12 x v + h22 v^2 (halved), and from the last frame back, V_{T-1} = d x^2,

    n = h11 + h12     m = h11 + 2 h12 + h22     D = c + m          (c = 0 between frames 0 and 1)
    h11 <- d + (c h11 + h11 h22 - h12^2) / D    h12 <- c n / D     h22 <- c m / D

so that A is the precision of a random walk, drawn forward from independent e:

    v_{t+1} = (1 - m/D) v_t - n/D x_t + e_{t+1},  var e_{t+1} = 1/D      x_{t+1} = x_t + v_{t+1}
    A^-1 = W diag(var e) W^T,                     W: e -> x

Where not all frames count, c = 0 in every bend that reaches one that does not: what lies beyond is
cut off, and A of the frames that count is that of a clip of their number.

Every number is a sum of positive ones, so float32 holds where A itself, whose entries are c/d times
apart, does not. Shapes: x ``(T, k)``; c, d scalars, positive. O(T) to factor, O(T k) to solve.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from jaxmotion.frames.count import frame_mask, step_mask


class Prior(eqx.Module):
    """Weights d (``size``) and c (``bend``), both > 0; ``count``: how many frames count, None for
    all."""

    size: Float[Array, ""]
    bend: Float[Array, ""]
    count: Int[Array, ""] | None = None

    def rows(self, x: Float[Array, "time channel"]) -> tuple[Array, Array]:
        """Half the sum of their squares is the cost."""
        bends = jnp.diff(x, n=2, axis=0)
        if self.count is not None:
            bends = jnp.where(frame_mask(self.count - 2, len(bends))[:, None], bends, 0)
        return jnp.sqrt(self.size) * x, jnp.sqrt(self.bend) * bends

    def product(self, x: Float[Array, "time channel"]) -> Float[Array, "time channel"]:
        """A x."""
        _, pull = jax.vjp(self.rows, x)
        return pull(self.rows(x))[0]


class Walk(eqx.Module):
    """A as a random walk: ``spring`` n/D and ``drag`` m/D of the step from each frame to the next,
    ``variance`` of each frame's noise."""

    spring: Float[Array, " time"]
    drag: Float[Array, " time"]
    variance: Float[Array, " time"]

    def draw(self, noise: Float[Array, "time channel"]) -> Float[Array, "time channel"]:
        """W: positions from the noise of each frame."""
        nothing = jnp.zeros_like(noise[0])

        def frame(state, inputs):
            (x, v), (spring, drag, noise) = state, inputs
            v = (1 - drag) * v - spring * x + noise
            return (x + v, v), x + v

        # The first frame is placed by its noise, without a step.
        inputs = self.spring[:-1], self.drag[:-1], noise[1:]
        _, after = lax.scan(frame, (noise[0], nothing), inputs)
        return jnp.concatenate([noise[:1], after])

    def solve(self, b: Float[Array, "time channel"]) -> Float[Array, "time channel"]:
        """A^-1 b."""
        (pulled,) = jax.linear_transpose(self.draw, b)(b)
        return self.draw(self.variance[:, None] * pulled)


def random_walk(prior: Prior, num_frames: int) -> Walk:
    """Factor A for T frames."""
    d, c = prior.size, prior.bend

    def back(value, free):
        h11, h12, h22 = value
        bend = jnp.where(free, jnp.zeros_like(c), c)
        n, m = h11 + h12, h11 + 2 * h12 + h22
        precision = bend + m
        value = (
            d + (bend * h11 + h11 * h22 - h12**2) / precision,
            bend * n / precision,
            bend * m / precision,
        )
        return value, (n / precision, m / precision, 1 / precision)

    last = (d, jnp.zeros_like(d), jnp.zeros_like(d))
    free = jnp.arange(num_frames - 1) == 0
    if prior.count is not None:
        free = free | ~step_mask(prior.count, num_frames)
    (first, _, _), (spring, drag, variance) = lax.scan(back, last, free, reverse=True)
    nothing = jnp.zeros_like(d)[None]
    return Walk(
        jnp.concatenate([spring, nothing]),
        jnp.concatenate([drag, nothing]),
        jnp.concatenate([(1 / first)[None], variance]),
    )
