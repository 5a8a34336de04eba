"""Distance between poses given as local rotations, forgiving of a few bad joints.

    θ(p, q) = ‖log_half(p⁻¹ q)‖, the smaller of the arcs on S³ to q and to −q
    D[i, j] = Σ_k w_k θ(x[i, k], y[j, k])², without its ``trim`` largest terms

Shapes: x ``(n, J, 4)``, y ``(m, J, 4)`` unit quaternions, D ``(n, m)`` in squared (half-angle)
radians. Cost O(n m J). Source: Aristidou et al. 2018, eq. 1 and §5 (drop the 3 largest of 24 joints
for a whole body, 1 for a limb group); the joint term is that of Lee et al. 2002.

θ² is smooth in the squared chord, so no log is taken: with z = min(‖p − q‖², ‖p + q‖²)/4 ≤ ½,
θ² = 4 asin²(√z) = z g(z), g a Chebyshev fit of degree 20 (8 in float32) to machine precision. It is
exact at equal poses, and its gradient is zero there. Joint after joint, the largest terms so far
are kept and what they displace is added up: nothing is subtracted, so no digits are lost. Only one
row of terms is held at a time, in the derivative too.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float
from numpy.polynomial import Chebyshev, Polynomial

from jaxmotion._checks import instance_of, no_module, static
from jaxmotion._entry import finite_clip
from jaxmotion._types import ArrayLike
from jaxmotion.motion import Motion

_JOINTS = 24  # in one loop over the frames


@static("trim")
def pose_distance(
    x: ArrayLike | Motion, y: ArrayLike | Motion, *, trim: int = 0, weights: ArrayLike | None = None
) -> Float[Array, "frames_x frames_y"]:
    """Trimmed sum of squared joint rotations between all frames of two clips.

    O(n m J). Differentiable in both modes. Source: Aristidou et al. 2018, eq. 1 and §5.

    **Arguments:** ``x``: local rotations f[n, J, 4], unit quaternions, whose signs do not matter;
    ``y``: local rotations f[m, J, 4]; or both of them motions, single clips of the same joints,
    whose rotations are compared, the root's too; ``trim``: how many of the largest joint terms to
    leave out, per pair of frames; ``weights``: f[J], one factor per joint, applied before trimming;
    1 when omitted.
    **Returns:** f[n, m], squared half-angle radians.
    **Raises:** ``ValueError`` for shapes and motions that do not fit, or ``trim`` outside
    0 … J − 1.
    """
    x, y = rotations_of("pose_distance", x, y)
    x, y = jnp.asarray(x), jnp.asarray(y)
    if x.ndim != 3 or y.ndim != 3 or x.shape[1:] != y.shape[1:] or x.shape[2] != 4:
        raise ValueError(
            f"x has shape {x.shape} and y {y.shape}; want (n, J, 4) and (m, J, 4) with the same J"
        )
    joints = x.shape[1]
    if not 0 <= trim < joints:
        raise ValueError(f"trim={trim}; want 0 <= trim < {joints}, the number of joints")
    w = jnp.ones(joints, x.dtype) if weights is None else jnp.asarray(weights, x.dtype)
    if w.shape != (joints,):
        raise ValueError(f"weights has shape {w.shape}; want ({joints},)")
    return _all_pairs(x, y, w, trim)


def rotations_of(
    caller: str, x: ArrayLike | Motion, y: ArrayLike | Motion
) -> tuple[ArrayLike, ArrayLike]:
    """The rotations of two motions of the same joints; two arrays as they are."""
    if not isinstance(x, Motion) and not isinstance(y, Motion):
        for name, value in (("x", x), ("y", y)):
            no_module(f"{caller}: {name}", value)
        return x, y
    for name, value in (("x", x), ("y", y)):
        instance_of(f"{caller}: {name}", value, Motion, "two motions or two arrays")
        finite_clip(caller, value, name)  # type: ignore[arg-type]
    if x.skeleton.names != y.skeleton.names or x.dtype != y.dtype:  # type: ignore[union-attr]
        raise ValueError(
            f"{caller}: the motions have different joints or dtypes; expected the same joints, or "
            "pass the rotations of those to compare"
        )
    return x.rotations, y.rotations  # type: ignore[union-attr]


@partial(jax.jit, static_argnames="trim")
def _all_pairs(x: Array, y: Array, w: Array, trim: int) -> Array:
    targets = jnp.transpose(y, (1, 2, 0))

    @jax.checkpoint
    def one_frame(pose):
        """Distances from one pose (J, 4) to all target frames."""

        def one_joint(sums, joint):
            p, q, weight = joint
            (rest, *largest), term = sums, weight * _squared_arc(p, q)
            for k, most in enumerate(largest):
                largest[k], term = jnp.maximum(most, term), jnp.minimum(most, term)
            return (rest + term, *largest), None

        none = (jnp.zeros(targets.shape[-1], y.dtype),) * (1 + trim)
        return lax.scan(one_joint, none, (pose, targets, w), unroll=_JOINTS)[0][0]

    return lax.map(one_frame, x)


def _squared_arc(p: Array, q: Array) -> Array:
    """θ² between a unit quaternion and others, whose components are on axis 0."""
    near = _added([(a - b) ** 2 for a, b in zip(p, q, strict=True)])
    far = _added([(a + b) ** 2 for a, b in zip(p, q, strict=True)])
    return _arc_of_chord(jnp.minimum(jnp.minimum(near, far) / 4, jnp.asarray(0.5, near.dtype)))


def _added(w_to_z: list[Array]) -> Array:
    w, x, y, z = w_to_z
    return w + x + y + z


@jax.custom_jvp
def _arc_of_chord(z: Array) -> Array:
    """4 asin²(√z) for 0 ≤ z ≤ ½."""
    return z * _horner(_ARC_FIT[z.dtype.name], z)


@_arc_of_chord.defjvp
def _arc_of_chord_jvp(primals, tangents):
    (z,), (z_dot,) = primals, tangents
    return _arc_of_chord(z), _horner(_SLOPE_FIT[z.dtype.name], z) * z_dot


def _horner(coefficients: np.ndarray, z: Array) -> Array:
    """Polynomial in t = 4z − 1, lowest coefficient first."""
    t = 4 * z - 1
    value = jnp.full_like(z, coefficients[-1])
    for c in coefficients[-2::-1]:
        value = value * t + jnp.asarray(c, z.dtype)
    return value


def _fit(function, degree: int) -> np.ndarray:
    """Coefficients in t = 4z − 1 of a function of s = √z on 0 ≤ z ≤ ½."""

    def of_t(t):
        return function(np.sqrt(np.maximum((t + 1) / 4, 1e-300)))

    return Chebyshev.interpolate(of_t, degree).convert(kind=Polynomial).coef


def _fit_per_dtype(function) -> dict[str, np.ndarray]:
    return {"float32": _fit(function, 8), "float64": _fit(function, 20)}


_ARC_FIT = _fit_per_dtype(lambda s: 4 * np.arcsin(s) ** 2 / s**2)
_SLOPE_FIT = _fit_per_dtype(lambda s: 4 * np.arcsin(s) / (s * np.sqrt(1 - s**2)))
