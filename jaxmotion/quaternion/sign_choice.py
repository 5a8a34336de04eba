"""Which way round between sparse keys: the signs of least energy, by dynamic programming.

    minimise   Σ_i ‖d_i‖² / (h_{i−1} + h_i)          over signs s_i ∈ {−1, 1}, s_0 = 1
    d_i = (s_{i+1} q_{i+1} − s_i q_i)/h_i − (s_i q_i − s_{i−1} q_{i−1})/h_{i−1}

q: unit quaternions (n, ..., 4), one sequence for each of the axes between; h_i: time from key i to
key i + 1; d: divided second differences. The sum stands for ∫‖x″‖² of the smooth curve x through
the signed keys, with the slight coupling of neighbouring d left out. q and −q are one rotation, but
a curve through q, q′ and one through q, −q′ turn opposite ways, by θ and by 360° − θ.

:func:`align_signs` always takes the short way, and so turns a 200° key-to-key turn into −160°
between keys that both arrive and leave the other way. The least energy keeps turning: 180° to 220°
between neighbours of 60° a key, less when the neighbours turn less; 250° it too takes for −110°.

Only whether a key's sign differs from the last one's matters, r_i = s_i s_{i−1}, and d_i depends on
r_i and r_{i+1}: a Viterbi recursion over two states, O(n), where trying every combination costs
2^(n−1). Ties, such as fewer than three keys, fall to :func:`align_signs`. No gradient passes
through the choice. Source: Eom et al. 2019, Fig. 8, whose rule is not given.
"""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from jaxmotion._checks import counted, no_module
from jaxmotion._types import ArrayLike, Quaternion, ScalarLike
from jaxmotion.quaternion.algebra import align_signs


def least_energy_signs(
    q: Quaternion, times: ArrayLike | None = None, *, length: ScalarLike | None = None
) -> Quaternion:
    """Choose between q and −q along axis 0 so that the curve through all keys bends least.

    O(n). No gradient passes through the choice. Source: Eom et al. 2019, Fig. 8.

    **Arguments:** ``q``: f[n, ..., 4], unit; ``times``: f[n], strictly increasing, in any unit;
    None for evenly spaced keys; ``length``: how many keys count, traced or not, when the rest is
    padding.
    **Returns:** the same rotations, f[n, ..., 4]; the first keeps its sign.
    **Raises:** ``ValueError`` when shapes do not fit, or for a length that is not from 1 to n; at
    run time for a traced one.
    """
    no_module("least_energy_signs: q", q)
    q = jnp.asarray(q)
    n = q.shape[0]
    times = jnp.arange(n, dtype=q.dtype) if times is None else jnp.asarray(times, q.dtype)
    if times.shape != (n,):
        raise ValueError(
            f"least_energy_signs: times has shape {times.shape}; want ({n},), one a quaternion"
        )
    count, q = counted("least_energy_signs: length", length, n, q)
    return signed(q, times, count)


@jax.jit
def signed(
    q: Quaternion, times: Float[Array, " key"], count: Int[Array, ""]
) -> Float[Array, "key ... 4"]:
    """:func:`least_energy_signs` of as many keys as there are, for callers who know it."""
    near = align_signs(q)
    if q.shape[0] < 3:
        return near
    h = jnp.diff(times).reshape(q.shape[0] - 1, *[1] * (q.ndim - 2))
    turned = _turned(*lax.stop_gradient((near, h)), count)
    signs = jnp.cumprod(jnp.where(turned, -1, 1).astype(q.dtype), axis=0)
    return jnp.concatenate([near[:1], signs[..., None] * near[1:]])


def _turned(near, h, length):
    """Where the sign changes from a key to the next, given signs that are nearest: (n − 1, ...)."""
    step = jnp.sum(near[1:] * near[:-1], axis=-1) / h
    before, after = step[:-1], step[1:]
    across = jnp.sum(near[2:] * near[:-2], axis=-1) / (h[:-1] * h[1:])
    slope = 1 / h[:-1] + 1 / h[1:]
    middle = jnp.arange(1, near.shape[0] - 1, dtype=length.dtype).reshape(-1, *[1] * (h.ndim - 1))
    share = jnp.where(middle < length - 1, 1 / (h[:-1] + h[1:]), 0)

    def energy(r, r_next):
        """½‖d‖²/(h + h′) but for a constant; 0 where it reaches into the padding."""
        return (r * r_next * across - slope * (r * before + r_next * after)) * share

    def onward(best, energies):
        (kept, changed), (kept_last, changed_last) = energies
        to_kept = best[0] + kept, best[1] + changed
        to_changed = best[0] + kept_last, best[1] + changed_last
        came_changed = to_kept[1] < to_kept[0], to_changed[1] < to_changed[0]
        return (jnp.minimum(*to_kept), jnp.minimum(*to_changed)), came_changed

    def back(changed, came_changed):
        changed_before = jnp.where(changed, came_changed[1], came_changed[0])
        return changed_before, changed_before

    energies = tuple(tuple(energy(r, r_next) for r in (1, -1)) for r_next in (1, -1))
    none = jnp.zeros_like(step[0])
    best, came_changed = lax.scan(onward, (none, none), energies)
    last = best[1] < best[0]
    _, earlier = lax.scan(back, last, came_changed, reverse=True)
    return jnp.concatenate([earlier, last[None]])
