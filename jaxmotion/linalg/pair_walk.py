"""Two numbers a frame that change little from one frame to the next: least squares in O(T).

    minimise over x:   sum_i x_i . (G_i x_i) - 2 p_i . x_i  +  sum_i |x_{i+1} - x_i|^2

    x_i, p_i  pairs, ``(T, 2, C)``, C independent channels      G_i  2 by 2, symmetric, >= 0

Block elimination: with M_i the information on frame i from the frames up to it, the next has
``M_i (I + M_i)^-1`` from them, which is written out so that no difference is subtracted from its
own sum: the smoothest walks keep their digits. Some G must be positive definite.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float


class Symmetric(NamedTuple):
    """2 × 2 matrices, component by component."""

    aa: Array
    ab: Array
    bb: Array

    def __matmul__(self, x):
        a, b = x[..., 0, :], x[..., 1, :]
        return jnp.stack([self.aa * a + self.ab * b, self.ab * a + self.bb * b], axis=-2)

    @property
    def determinant(self):
        return jnp.maximum(self.aa * self.bb - self.ab**2, 0)

    def times(self, factor):
        return Symmetric(factor * self.aa, factor * self.ab, factor * self.bb)


def solve_walk(
    gram: Symmetric, pull: Float[Array, "time 2 channel"], counts: Bool[Array, " time"]
) -> Array:
    """The minimiser x for ``gram`` G, each entry ``(T, C)``, and ``pull`` p, of the frames that
    count, the first ones; 0 for the rest, where G must be 0.

    Differentiable in both, implicitly.
    """
    last_frame = jnp.sum(counts) - 1
    counts = counts[:, None, None]
    joined = counts[1:]

    def matvec(x):
        steps = jnp.where(joined, jnp.diff(x, axis=0), 0)
        return (gram @ x).at[1:].add(steps).at[:-1].add(-steps)

    fixed = lax.stop_gradient(gram)

    def solve(_, pull):
        def forward(before, frame):
            known, mean = before
            own, pull = frame
            total = Symmetric(*map(jnp.add, own, known))
            pull = pull + mean
            det = total.determinant
            share = 1 / (1 + total.aa + total.bb + det)
            keep = Symmetric(1 + total.bb, -total.ab, 1 + total.aa).times(share)
            onward = Symmetric(total.aa + det, total.ab, total.bb + det).times(share)
            mean = keep @ pull
            return (onward, mean), (keep, mean, total, pull)

        nothing = jax.tree.map(lambda x: jnp.zeros_like(x[0]), (fixed, pull))
        _, (keep, mean, total, pulls) = lax.scan(forward, nothing, (fixed, pull))
        last, pull = jax.tree.map(lambda x: x[last_frame], (total, pulls))
        spread = jnp.sqrt(jnp.stack([last.aa, last.bb]))
        tie = last.ab / (spread[0] * spread[1])
        one = jnp.ones_like(tie)
        end = Symmetric(one, -tie, one).times(1 / (1 - tie**2)) @ (pull / spread) / spread

        def backward(after, frame):
            keep, mean, joined = frame
            x = jnp.where(joined, mean + keep @ after, after)
            return x, x

        keep, mean = jax.tree.map(lambda x: x[:-1], (keep, mean))
        x = lax.scan(backward, end, (keep, mean, joined), reverse=True)[1]
        return jnp.where(counts, jnp.concatenate([x, end[None]]), 0)

    return lax.custom_linear_solve(matvec, pull, solve, symmetric=True)
