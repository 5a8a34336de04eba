"""The position-velocity chain solved in O(log T) parallel steps, for accelerators.

The quadratic form and its symbols are those of ``linalg.difference_chain``; so are the results.

    factor      every stretch of frames, seen from the frame after it, is an element (A, C, J):
                given the state s after it, the state at its start is N(A s, C), and its frames
                inform s by J. A stretch 1 (late) and the stretch 2 before it join to

                    A = A2 M A1    C = A2 M C1 A2' + C2    J = A1' J2 M A1 + J1
                    M = (I + C1 J2)^-1

                J of all frames before j is the information the elimination has there.
    smooth      with the gains known, both passes are affine maps of two numbers,
                (y, k) -> G (y, k) + g, which join to G2 G1 and G2 g1 + g2

One stretch is one frame: s = (x, v) leads back to x_j = x - v and
v_j = N((p v + n g x_j) / D, 1/D), D = p + n g^2 + r. Where nothing informs v_j (frame 0) it is set
to 0.

Step s of a scan joins every frame's stretch with the one 2^s frames before it (Hillis and Steele,
1986): one body, compiled once, run log2 T times. Cost O(T log T) work in O(log T) steps one after
another instead of 3 T, memory O(T): for a GPU or TPU; on a CPU the sequential solve is faster.
Forward and reverse mode differentiate the factor as a loop of log2 T steps.

Source: Särkkä and García-Fernández, *Temporal parallelization of Bayesian smoothers*, 2021, with
information running in place of a diffuse prior, so that none is needed: unseen stretches have
J = 0 exactly.

Sharp bits: joined stretches are plain matrices, not factors. Across a gap of G frames without
readings they lose ``eps n G / (3 p)`` of the velocity's digits: :func:`lost_digits` tells.
"""

from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jaxmotion.linalg.chain_covariance import Knowledge, State, knowledge, mirrored
from jaxmotion.linalg.difference_chain import (
    ChainFactor,
    DifferenceChain,
    Information,
    over,
    shares,
    smoothest,
    with_gains,
)

Matrix: TypeAlias = tuple[tuple[Array, Array], tuple[Array, Array]]


@jax.jit
def parallel_chain_factor(chain: DifferenceChain) -> ChainFactor:
    """Equal to :func:`chain_factor`, in O(log T) steps.

    Differentiable, as a scan.

    **Arguments:** ``chain``: the coefficients.
    **Returns:** :class:`ChainFactor`.
    """
    one = jnp.ones_like(chain.weight[:1])
    return with_gains(chain, _known(chain, State(0 * one, 0 * one, one)))


def _known(chain: DifferenceChain, start: State) -> Information:
    """What is known once each frame is read, from plain information ``[[a, b], [b, d]]``."""
    shape = jnp.broadcast_shapes(*(leaf.shape for leaf in jax.tree.leaves(chain)))
    p, n, g, r = (jnp.broadcast_to(e, shape) for e in jax.tree.leaves(chain))
    start = State(*(jnp.broadcast_to(e, (1, *shape[1:])) for e in start))
    n1, n2 = n * g, n * g * g + r
    tied = p + n2 > 0
    spread = jnp.where(tied, 1 / jnp.where(tied, p + n2, 1), 0)
    rho, lean = p * spread, n1 * spread
    one, zero = jnp.ones_like(p), jnp.zeros_like(p)
    # Information about (x, v): n x_j^2 - 2 n1 x_j v_j + n2 v_j^2 + p (v - v_j)^2, v_j minimised.
    a, b, d = n - n1 * lean, -n1 * rho, n2 * rho
    element = (
        ((one, -one), (lean, rho - lean)),
        State(zero, zero, spread),
        State(a, b - a, d - 2 * b + a),
    )
    nothing = State(zero[:1], zero[:1], zero[:1])
    _, _, info = _scan(
        lambda early, late: _join(late, early), element, (_identity(p[:1]), nothing, nothing)
    )
    a, b, d = (jnp.concatenate([first, rest[:-1]]) for first, rest in zip(start, info, strict=True))
    a, b, d = a + n, b - n1, d + n2
    lever = -over(b, a)
    return Information(a, lever, jnp.maximum(d + b * lever, 0))


@jax.jit
def parallel_chain_knowledge(chain: DifferenceChain) -> Knowledge:
    """Equal to :func:`chain_knowledge` of the factor, in O(log T) steps.

    Differentiable, as scans.

    **Arguments:** ``chain``: the coefficients.
    **Returns:** :class:`Knowledge`, each entry f[T, *k].
    """
    none = jnp.zeros_like(chain.weight[:1])
    other = _known(jax.tree.map(lambda e: e[::-1], mirrored(chain)), State(none, none, none))
    return knowledge(parallel_chain_factor(chain), jax.tree.map(lambda e: e[::-1][1:], other))


@jax.jit
def parallel_chain_smooth(
    chain: DifferenceChain,
    readings: Float[Array, "frames ..."],
    push: Float[Array, "frames ..."] | None = None,
) -> Array:
    """Equal to :func:`chain_smooth`, in O(log T) steps, with the same implicit derivatives.

    **Arguments:** ``chain``, ``readings``, ``push``: as :func:`chain_smooth`.
    **Returns:** f[T, *channels].
    """
    return smoothest(parallel_chain_factor, _substituted, chain, readings, push)


def lost_digits(chain: DifferenceChain) -> Array:
    """Share of what is known of velocities that is lost to rounding, ``(*k)``: ``eps n G / (3 p)``
    for the longest gap of G >= 2 frames, the least p and the largest n."""
    frames = np.arange(chain.weight.shape[0]).reshape(-1, *[1] * (chain.weight.ndim - 1))
    seen = lax.cummax(jnp.where(chain.weight > 0, frames, -1), axis=0)
    behind = jnp.concatenate([jnp.full_like(seen[:1], -1), seen[:-1]])
    gap = jnp.max(jnp.where((seen == frames) & (behind >= 0), frames - behind, 0), axis=0)
    eps = jnp.finfo(chain.weight.dtype).eps
    curved = jnp.min(chain.curvature[1:-1], axis=0, initial=jnp.inf)
    loss = eps * jnp.max(chain.weight, axis=0) * gap.astype(chain.weight.dtype) / (3 * curved)
    return jnp.where((gap > 1) & (curved > 0), loss, 0)


def _substituted(factor: ChainFactor, z, f, c, level) -> Array:
    """Forwards and back, ``(T, *channels)``."""
    by = factor.gains
    level = jnp.zeros((), z.dtype) if level is None else level
    z = z - level
    pushed = 0 if f is None else f
    toward, change, ahead = (0, 0, 0) if c is None else (share * c for share in shares(factor))
    matrix = (1 - by.take - by.lean * by.pull, by.lean), (-by.rho * by.pull, by.rho)
    k = by.pull * z + pushed
    vector = by.take * z + by.lean * k - toward, by.rho * k + change
    _, (y, k) = _affine(matrix, vector)
    end = y[-1]
    y, k = (jnp.concatenate([jnp.zeros_like(e[:1]), e[:-1]]) for e in (y, k))
    apart = z - y
    y, k = y + by.take * apart, k + by.pull * apart + pushed
    offset = by.inverse * (k - ahead) - by.hold * y
    one = jnp.ones_like(by.hold)
    # (x_j, v_j) from (x_{j+1}, v_{j+1}): x_j = x+ - v+, v_j = slack v+ + hold x_j + offset.
    back = (one, -one), (by.hold, by.slack - by.hold)
    # The last frame's map applied to where the chain ends.
    first = jnp.concatenate([jnp.zeros_like(z[:-1]), end[None]])
    then = jnp.concatenate([offset[:-1], (by.hold[-1] * end + offset[-1])[None]])
    return _affine(back, (first, then), reverse=True)[1][0] + level


def _affine(matrix: Matrix, vector: tuple[Array, Array], reverse: bool = False):
    """All partial compositions of the maps ``matrix s + vector``."""

    def join(first, second):
        (m1, u1), (m2, u2) = first, second
        x, v = _apply(m2, u1)
        return _product(m2, m1), (x + u2[0], v + u2[1])

    nothing = jnp.zeros_like(vector[0][:1])
    identity = _identity(matrix[0][0][:1]), (nothing, nothing)
    return _scan(join, (matrix, vector), identity, reverse)


def _identity(like: Array) -> Matrix:
    one, zero = jnp.ones_like(like), jnp.zeros_like(like)
    return (one, zero), (zero, one)


def _scan(join, elements, identity, reverse: bool = False):
    """Every prefix ``e_0 .. e_j`` joined by ``join(first, second)``, or with ``reverse`` every
    suffix, the last first; ``identity`` has one frame."""
    frames = jax.tree.leaves(elements)[0].shape[0]
    if reverse:
        elements = jax.tree.map(lambda x: x[::-1], elements)

    def step(elements, distance):
        def before(x, neutral):
            there = np.arange(frames).reshape(-1, *[1] * (x.ndim - 1)) >= distance
            return jnp.where(there, jnp.roll(x, distance, axis=0), neutral)

        return join(jax.tree.map(before, elements, identity), elements), None

    distances = 2 ** np.arange((frames - 1).bit_length())
    elements, _ = lax.scan(step, elements, jnp.asarray(distances))
    return jax.tree.map(lambda x: x[::-1], elements) if reverse else elements


def _join(late, early):
    """One stretch of two, the late one nearer to the state seen from."""
    (a1, c1, j1), (a2, c2, j2) = late, early
    (c, e, f), (p, q, r) = c1, j2
    # I + C1 J2 and its inverse M.
    (m00, m01), (m10, m11) = (1 + c * p + e * q, c * q + e * r), (e * p + f * q, 1 + e * q + f * r)
    scale = 1 / (m00 * m11 - m01 * m10)
    m = ((m11 * scale, -m01 * scale), (-m10 * scale, m00 * scale))
    a2m = _product(a2, m)
    mc = _symmetric(_product(m, ((c, e), (e, f))))
    jm = _symmetric(_product(((p, q), (q, r)), m))
    return (
        _product(a2m, a1),
        _sum(_congruence(a2, mc), c2),
        _sum(_congruence(_transpose(a1), jm), j1),
    )


def _product(a: Matrix, b: Matrix) -> Matrix:
    ((a00, a01), (a10, a11)), ((b00, b01), (b10, b11)) = a, b
    return (
        (a00 * b00 + a01 * b10, a00 * b01 + a01 * b11),
        (a10 * b00 + a11 * b10, a10 * b01 + a11 * b11),
    )


def _apply(a: Matrix, s: tuple[Array, Array]) -> tuple[Array, Array]:
    (a00, a01), (a10, a11) = a
    return a00 * s[0] + a01 * s[1], a10 * s[0] + a11 * s[1]


def _transpose(a: Matrix) -> Matrix:
    (a00, a01), (a10, a11) = a
    return (a00, a10), (a01, a11)


def _symmetric(a: Matrix) -> State:
    (a00, a01), (a10, a11) = a
    return State(a00, 0.5 * (a01 + a10), a11)


def _sum(a: State, b: State) -> State:
    return State(*(x + y for x, y in zip(a, b, strict=True)))


def _congruence(a: Matrix, s: State) -> State:
    """``a s a'``."""
    (a00, a01), (a10, a11) = a
    x, xv, v = s
    return State(
        a00 * a00 * x + 2 * a00 * a01 * xv + a01 * a01 * v,
        a00 * a10 * x + (a00 * a11 + a01 * a10) * xv + a01 * a11 * v,
        a10 * a10 * x + 2 * a10 * a11 * xv + a11 * a11 * v,
    )
