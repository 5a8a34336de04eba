"""The position-velocity chain solved in O(log T) parallel steps, for accelerators.

The quadratic form and its symbols are those of ``linalg.difference_chain``; so are the results.

    factor      every stretch of frames, seen from the frame after it, is an element (A, C, J):
                given the state s after it, the state at its start is N(A s, C), and its frames
                inform s by J. A stretch 1 (late) and the stretch 2 before it join to

                    A = A2 M A1    C = A2 M C1 A2' + C2    J = A1' J2 M A1 + J1
                    M = (I + C1 J2)^-1

                J of all frames before j is the information the elimination has there.
    substitute  with the gains known, both passes are affine maps of two numbers,
                (h, k) -> G (h, k) + g, which join to G2 G1 and G2 g1 + g2
    covariance  S -> L S L' + N likewise

One stretch is one frame: s = (x, v) leads back to x_j = x - v and v_j = N((p v + n1 x_j) / D, 1/D),
D = p + n2. Where nothing informs v_j (frame 0) it is set to 0.

Step s of a scan joins every frame's stretch with the one 2^s frames before it (Hillis and Steele,
1986): one body, compiled once, run log2 T times. Cost O(T log T) work in O(log T) steps one after
another instead of 3 T, memory O(T): for a GPU or TPU; on a CPU the sequential solve is faster.
Forward and reverse mode differentiate the factor and the covariance as loops of log2 T steps.

Source: Särkkä and García-Fernández, *Temporal parallelization of Bayesian smoothers*, 2021, with
information running in place of a diffuse prior, so that none is needed: unseen stretches have
J = 0 exactly.

Sharp bits: digits are those of the sequential solve, up to a factor of about four.
"""

from functools import partial
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jaxmotion.linalg.difference_chain import (
    ChainFactor,
    DifferenceChain,
    State,
    chain_matvec,
    level_of,
    row_sums,
)

Matrix: TypeAlias = tuple[tuple[Array, Array], tuple[Array, Array]]


@jax.jit
def parallel_chain_factor(chain: DifferenceChain) -> ChainFactor:
    """Equal to :func:`chain_factor`, in O(log T) steps. Differentiable, as a scan."""
    p, n0, n1, n2 = chain.curvature, chain.position, chain.cross, chain.speed
    shape = jnp.broadcast_shapes(p.shape, n0.shape, n1.shape, n2.shape)
    p, n0, n1, n2 = (jnp.broadcast_to(entry, shape) for entry in (p, n0, n1, n2))
    tied = p + n2 > 0
    spread = jnp.where(tied, 1 / jnp.where(tied, p + n2, 1), 0)
    rho, lean = p * spread, n1 * spread
    one, zero = jnp.ones_like(p), jnp.zeros_like(p)
    # Information about (x, v): n0 x_j^2 - 2 n1 x_j v_j + n2 v_j^2 + p (v - v_j)^2, v_j minimised.
    a, b, d = n0 - n1 * lean, -n1 * rho, n2 * rho
    element = (
        ((one, -one), (lean, rho - lean)),
        State(zero, zero, spread),
        State(a, b - a, d - 2 * b + a),
    )
    nothing = State(zero[:1], zero[:1], zero[:1])
    _, _, info = _scan(
        lambda early, late: _join(late, early), element, (_identity(p[:1]), nothing, nothing)
    )
    start = State(zero[:1], zero[:1], one[:1])
    a, b, d = (jnp.concatenate([first, rest[:-1]]) for first, rest in zip(start, info, strict=True))
    a, b, d = a + n0, b - n1, d + n2
    inverse_pivot = 1 / (d + p)
    beta = b * inverse_pivot
    return ChainFactor(p, beta, inverse_pivot, (a - b * beta)[-1])


@jax.jit
def parallel_chain_solve(chain: DifferenceChain, b: Float[Array, "frames ..."]) -> Array:
    """Equal to :func:`chain_solve`, in O(log T) steps, with the same implicit derivatives."""
    fixed = lax.stop_gradient(chain)
    factor, weight = parallel_chain_factor(fixed), row_sums(fixed)

    def solve(_, b):
        level = level_of(weight, b)
        return _substitute(factor, b - weight * level) + level

    return lax.custom_linear_solve(partial(chain_matvec, chain), b, solve, symmetric=True)


@jax.jit
def parallel_chain_covariance(factor: ChainFactor) -> State:
    """Equal to :func:`chain_covariance`, in O(log T) steps. Differentiable, as a scan."""
    zero = jnp.zeros_like(factor.beta)
    added = State(zero, zero, factor.inverse_pivot)
    last = State(1 / factor.precision, zero[0], zero[0])
    # The end is one more frame that forgets what follows it.
    end = tuple((x[None], x[None]) for x in (zero[0], zero[0]))
    back = jax.tree.map(lambda x, e: jnp.concatenate([x, e]), _backward(factor), end)
    added = jax.tree.map(lambda x, e: jnp.concatenate([x, e[None]]), added, last)

    def join(late, early):
        (l1, c1), (l2, c2) = late, early
        return _product(l2, l1), _sum(_congruence(l2, c1), c2)

    first = factor.beta[:1]
    nothing = State(*[jnp.zeros_like(first)] * 3)
    _, cov = _scan(join, (back, added), (_identity(first), nothing), reverse=True)
    position, cross, velocity = (entry[:-1] for entry in cov)
    return State(position, cross.at[0].set(0), velocity.at[0].set(0))


def _substitute(factor: ChainFactor, b: Array) -> Array:
    """Forwards and back, ``(T, *channels)``."""
    beta, inverse_pivot = factor.beta, factor.inverse_pivot
    one = jnp.ones_like(beta)
    slack = factor.curvature * inverse_pivot + beta
    # (h, k) after frame j's own elimination, so that the frame's datum enters as (b, -b).
    _, (h, k) = _affine(((one, -beta), (-one, slack)), (b, -b))
    k_before = jnp.concatenate([jnp.zeros_like(k[:1]), k[:-1]])
    last = (h[-1] / factor.precision, jnp.zeros_like(h[-1]))
    offset = k_before * inverse_pivot
    back = _backward(factor)
    # The last frame's map applied to where the chain ends.
    (back_xx, back_xv), (back_vx, back_vv) = back
    end = (back_xx[-1], back_xv[-1]), (back_vx[-1], back_vv[-1])
    x_end, v_end = _apply(end, last)
    x = jnp.concatenate([jnp.zeros_like(b[:-1]), x_end[None]])
    v = jnp.concatenate([offset[:-1], (v_end + offset[-1])[None]])
    _, (x, _) = _affine(back, (x, v), reverse=True)
    return x


def _backward(factor: ChainFactor) -> Matrix:
    """(x_j, v_j) from (x_{j+1}, v_{j+1}): x_j = x+ - v+, v_j = rho v+ - beta x_j."""
    beta = factor.beta
    one = jnp.ones_like(beta)
    return (one, -one), (-beta, factor.curvature * factor.inverse_pivot + beta)


def _affine(matrix: Matrix, vector: tuple[Array, Array], reverse: bool = False):
    """All partial compositions of the maps ``matrix s + vector``."""

    def join(first, second):
        (m1, u1), (m2, u2) = first, second
        x, v = _apply(m2, u1)
        return _product(m2, m1), (x + u2[0], v + u2[1])

    still = jnp.zeros_like(vector[0][:1])
    identity = _identity(matrix[0][0][:1]), (still, still)
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
