"""Functions of small symmetric matrices, by their eigenvalues, with derivatives that stay finite.

    f(C) = U diag(f(w)) Uᵀ         C = U diag(w) Uᵀ
    df   = U (K ∘ Uᵀ dC U) Uᵀ      K_ij = (f(w_i) − f(w_j))/(w_i − w_j), f′ where they agree

(Daleckii & Krein 1965). The derivative of the eigenvectors themselves is infinite where eigenvalues
agree, as those of a hinge's covariance do; that of f(C) is not. First derivatives are exact in both
modes. O(n³).
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmotion._types import AnyArray


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def symmetric_function(
    function: Callable[[Array], Array], matrix: Float[AnyArray, "*batch n n"]
) -> Float[Array, "*batch n n"]:
    """``function`` of a symmetric matrix: of numbers, elementwise, applied to its eigenvalues.

    **Arguments:** ``function``: differentiable, of f[..., n] to f[..., n]; ``matrix``: symmetric.
    **Returns:** symmetric, the matrix's shape.

    **Example:**

        >>> import jax.numpy as jnp
        >>> from jaxmotion.linalg.symmetric import symmetric_function
        >>> root = symmetric_function(jnp.sqrt, jnp.array([[2.0, 0.0], [0.0, 9.0]]))
        >>> [round(float(x), 3) for x in jnp.diag(root)]
        [1.414, 3.0]
    """
    values, vectors = jnp.linalg.eigh(matrix)
    return _composed(function(values), vectors)


@symmetric_function.defjvp
def _jvp(function, primals, tangents):
    (matrix,), (change,) = primals, tangents
    w, vectors = jnp.linalg.eigh(matrix)
    image, slope = jax.jvp(function, (w,), (jnp.ones_like(w),))
    gap = w[..., :, None] - w[..., None, :]
    size = jnp.max(jnp.abs(w), axis=-1)[..., None, None]
    close = jnp.abs(gap) <= float(jnp.finfo(w.dtype).eps) ** 0.5 * size
    middle = 0.5 * (slope[..., :, None] + slope[..., None, :])
    rise = image[..., :, None] - image[..., None, :]
    kernel = jnp.where(close, middle, rise / jnp.where(close, 1, gap))
    turned = jnp.swapaxes(vectors, -1, -2) @ change @ vectors
    answer = vectors @ (kernel * turned) @ jnp.swapaxes(vectors, -1, -2)
    return _composed(image, vectors), answer


def _composed(values: Array, vectors: Array) -> Array:
    return (vectors * values[..., None, :]) @ jnp.swapaxes(vectors, -1, -2)
