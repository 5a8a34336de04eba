"""Solve (A ⊗ I + J^T J) x = b in O(T d^2 r): few rows a frame on a smooth prior.

    A         precision of the random walk of :mod:`jaxmotion.spacetime.prior`, per channel
    J_t       r x d, the rows of frame t; J = blockdiag(J_t)
    x = u - A^-1 J^T S^-1 J u,      u = A^-1 b,      S = I + J A^-1 J^T          (Woodbury)

S is the covariance of what the rows see, so a Kalman filter factors it: with P the covariance of a
frame's positions and steps given the frames before, its first block row P_x,

    R R^T = I + J_t P_xx J_t^T    V = P_x^T J_t^T R^-T    P <- P - V V^T, then one step of the walk

and e -> R^-1 (e - J_t mean) whitens: S^-1 = B^T B, B the filter run on means alone. The block
Cholesky factor of the same matrix takes O(T d^3) (Kalman, 1960; Rauch, Tung and Striebel, 1965).

Shapes: rows ``(T, r, d)``, b ``(T, d)``. Memory O(T d r). Sharp bits: digits are lost as the
condition of S, and u may be that much larger than x; refine where float32 matters. Rows that say
the same, as those of heel and ball of one rigid foot do, leave S the 1 of I alone in some
direction, and the rounding of J_t P_xx J_t^T, some eps |J_t|^2 max P_xx, may be more than that: a
frame without a root R gets that much more than I, which is little beside what all other directions
have.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxmotion.spacetime.prior import Walk

_ROUNDING = 4.0


class LowRankFactor(eqx.Module):
    """The filter: ``gains`` V of positions and of steps, ``roots`` R^-1 a frame."""

    walk: Walk
    rows: Float[Array, "time row d"]
    gains: tuple[Float[Array, "time d row"], Float[Array, "time d row"]]
    roots: Float[Array, "time row row"]

    def solve(self, b: Float[Array, "time d"]) -> Float[Array, "time d"]:
        """(A ⊗ I + J^T J)^-1 b."""
        u = self.walk.solve(b)
        return u - self.pulled(self.forces(jnp.einsum("trd,td->tr", self.rows, u)))

    def forces(self, seen: Float[Array, "time row"]) -> Float[Array, "time row"]:
        """S^-1 e."""
        (force,) = jax.linear_transpose(self._whiten, seen)(self._whiten(seen))
        return force

    def pulled(self, force: Float[Array, "time row"]) -> Float[Array, "time d"]:
        """A^-1 J^T f."""
        return self.walk.solve(jnp.einsum("trd,tr->td", self.rows, force))

    def _whiten(self, seen: Float[Array, "time row"]) -> Float[Array, "time row"]:
        def frame(mean, inputs):
            (x, v), (e, rows, gain_x, gain_v, root, spring, drag) = mean, inputs
            white = root @ (e - rows @ x)
            x, v = x + gain_x @ white, v + gain_v @ white
            v = (1 - drag) * v - spring * x
            return (x + v, v), white

        nothing = jnp.zeros_like(self.rows[0, 0])
        walk = self.walk
        inputs = (seen, self.rows, *self.gains, self.roots, walk.spring, walk.drag)
        return lax.scan(frame, (nothing, nothing), inputs)[1]


def low_rank_factor(walk: Walk, rows: Float[Array, "time row d"]) -> LowRankFactor:
    """Factor A ⊗ I + J^T J."""
    r, d = rows.shape[1:]
    eye, each = jnp.eye(d, dtype=rows.dtype), jnp.eye(r, dtype=rows.dtype)
    rounding = _ROUNDING * float(jnp.finfo(rows.dtype).eps)

    def frame(covariance, inputs):
        (xx, xv, vv), (rows, spring, drag, noise) = covariance, inputs
        seen = xx @ rows.T
        own = each + rows @ seen
        root = _inverse_root(own)
        more = rounding * jnp.max(jnp.sum(rows**2, axis=1)) * jnp.max(jnp.diagonal(xx))
        rooted = jnp.all(jnp.isfinite(root))
        root = lax.cond(rooted, lambda: root, lambda: _inverse_root(own + more * each))
        gain_x, gain_v = seen @ root.T, (xv.T @ rows.T) @ root.T
        xx, xv, vv = xx - gain_x @ gain_x.T, xv - gain_x @ gain_v.T, vv - gain_v @ gain_v.T
        # One step of the walk: v <- keep v - spring x + noise, x <- x + v. Written for x by itself,
        # so that what rounding leaves of an antisymmetric part dies out with the walk.
        keep, stay, cross = 1 - drag, 1 - spring, xv + xv.T
        along = keep * (stay * xv - spring * xv.T) - spring * stay * xx + keep**2 * vv + noise * eye
        x_now = stay**2 * xx + stay * keep * cross + keep**2 * vv + noise * eye
        v_now = spring**2 * xx - spring * keep * cross + keep**2 * vv + noise * eye
        return (x_now, along, v_now), (gain_x, gain_v, root)

    start = walk.variance[0] * eye, jnp.zeros_like(eye), jnp.zeros_like(eye)
    noise = jnp.concatenate([walk.variance[1:], jnp.zeros_like(walk.variance[:1])])
    inputs = rows, walk.spring, walk.drag, noise
    _, (gain_x, gain_v, roots) = lax.scan(frame, start, inputs)
    return LowRankFactor(walk, rows, (gain_x, gain_v), roots)


def _inverse_root(s: Float[Array, "row row"]) -> Float[Array, "row row"]:
    """R^-1 of s = R R^T, NaN where there is none."""
    eye = jnp.eye(s.shape[0], dtype=s.dtype)
    return lax.linalg.triangular_solve(jnp.linalg.cholesky(s), eye, left_side=True, lower=True)
