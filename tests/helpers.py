"""What many tests share: derivative checks, seeded random inputs, comparisons of rotations.

Everything takes a seeded ``numpy.random.Generator`` and uses float64 unless told otherwise. Oracles
are numpy or SciPy and share no code with the library.

    check_gradients(f, *args)        forward and reverse mode against central differences
    assert_finite_derivatives(...)   both modes, full Jacobian, at singular places
    assert_jit_and_vmap_agree(...)   jit == eager, and vmap == a loop over the leading axis
    random_quaternions / random_vectors / random_skeleton / random_motion
    quaternions_by(vectors)          exp, for clips made by hand: compiles nothing
    assert_same_rotation(a, b)       q and −q agree; tolerance in radians
    world_by_matrices(motion)        forward kinematics by 4x4 matrices, joint by joint
    compilations()                   the names of programs compiled inside
    no_shape_checks()                the library as users run it, for the errors they see
    single_precision()               JAX as it comes, without float64
    by_precision(cases, single)      parameters: all cases in float64, some in float32
"""

from collections.abc import Iterator
from contextlib import contextmanager

import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from jax import monitoring
from scipy.spatial.transform import Rotation

from jaxmotion import Motion, Skeleton, quaternion


def check_gradients(f, *args, rtol=1e-6, atol=1e-6, eps=1e-5, seed=0):
    """Derivatives of ``f`` in both modes against a central difference along a random direction.

    **Arguments:** ``f``: takes and returns pytrees of floating-point arrays; ``args``: where to
    check; every leaf is varied. Use float64. ``eps``: step, relative to inputs of order 1.

    One program has all of it, the value once: cheaper than ``jax.test_util.check_grads``, which
    also hands numpy arrays to ``f``.
    """
    rng = np.random.default_rng(seed)
    args = _arrays(args)

    def direction(tree):
        return jax.tree.map(lambda x: jnp.asarray(rng.standard_normal(x.shape), x.dtype), tree)

    @jax.jit
    def everything(args, tangent):
        value, slope = jax.linearize(f, *args)
        cotangent = direction(value)
        return value, slope(*tangent), cotangent, jax.linear_transpose(slope, *args)(cotangent)

    def at(h):
        moved = jax.tree.map(lambda x, t: x + jnp.asarray(h, x.dtype) * t, args, tangent)
        return everything(moved, tangent)

    tangent = direction(args)
    (beyond, *_), (before, *_), (_, forward, cotangent, reverse) = at(eps), at(-eps), at(0.0)
    numeric = jax.tree.map(lambda a, b: np.asarray(a - b, np.float64) / (2 * eps), beyond, before)
    for got, want in zip(jax.tree.leaves(forward), jax.tree.leaves(numeric), strict=True):
        np.testing.assert_allclose(got, want, rtol, atol, err_msg="forward mode")
    np.testing.assert_allclose(
        _inner(reverse, tangent), _inner(cotangent, numeric), rtol, atol, err_msg="reverse mode"
    )


def _arrays(tree):
    """JAX's arrays; of NumPy's without a program, which ``jnp.asarray`` compiles."""
    return jax.tree.map(
        lambda x: jax.device_put(x) if type(x) is np.ndarray else jnp.asarray(x), tree
    )


def _inner(a, b):
    return sum(
        float(np.vdot(x, y)) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    )


def assert_finite_derivatives(f, *args):
    """Values and Jacobians of ``f``, forward and reverse mode, have no NaN or infinity.

    **Returns:** the Jacobian (reverse mode) with respect to all arguments, a tuple.
    """
    args = _arrays(args)
    numbers = tuple(range(len(args)))

    @jax.jit
    def everything(*args):
        value, slope = jax.linearize(f, *args)
        return value, jax.jacfwd(slope, numbers)(*args), jax.jacrev(slope, numbers)(*args)

    value, forward, reverse = everything(*args)
    for name, tree in (("value", value), ("forward mode", forward), ("reverse mode", reverse)):
        for leaf in jax.tree.leaves(tree):
            assert np.all(np.isfinite(leaf)), f"{name} is not finite: {leaf}"
    for a, b in zip(jax.tree.leaves(forward), jax.tree.leaves(reverse), strict=True):
        np.testing.assert_allclose(a, b, 1e-5, 1e-5, err_msg="the two modes disagree")
    return reverse


def assert_jit_and_vmap_agree(f, *args, rtol=1e-12, atol=1e-12):
    """``f`` compiled, ``f`` not compiled, and ``f`` mapped over a new leading axis all agree.

    The mapped run stacks the arguments with themselves reversed along their first axis, so that
    the two slices differ.
    """
    args = _arrays(args)
    other = jax.tree.map(lambda x: x[::-1] if x.ndim else x, args)
    eager = [f(*args), f(*other)]
    stacked = jax.tree.map(lambda a, b: jnp.stack([a, b]), args, other)
    mapped = jax.jit(jax.vmap(f))(*stacked)
    compiled = jax.jit(f)
    for i, (want, given) in enumerate(zip(eager, (args, other), strict=True)):
        assert_trees_close(compiled(*given), want, rtol, atol)
        assert_trees_close(jax.tree.map(lambda x, i=i: x[i], mapped), want, rtol, atol)


def assert_trees_close(a, b, rtol=1e-12, atol=1e-12):
    """Two pytrees have one structure, and leaves of one dtype that agree."""
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert jnp.asarray(x).dtype == jnp.asarray(y).dtype
        np.testing.assert_allclose(x, y, rtol, atol)


def random_vectors(rng, shape=(), dtype=np.float64, scale=1.0):
    """Normal vectors, ``shape + (3,)``."""
    return jnp.asarray(scale * rng.standard_normal((*shape, 3)), dtype)


def random_quaternions(rng, shape=(), dtype=np.float64, angle=None):
    """Unit quaternions, ``shape + (4,)``: uniform, or within ``angle`` radians of the identity."""
    if angle is None:
        q = rng.standard_normal((*shape, 4))
        return jnp.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True), dtype)
    axis = rng.standard_normal((*shape, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    half = 0.5 * angle * rng.uniform(0, 1, (*shape, 1))
    return jnp.asarray(np.concatenate([np.cos(half), np.sin(half) * axis], -1), dtype)


def quaternions_by(vectors, dtype=np.float64) -> np.ndarray:
    """Unit quaternions (..., 4) that turn by rotation vectors (..., 3), by SciPy: called eagerly,
    ``quaternion.exp`` compiles some 25 programs for every new shape."""
    vectors = np.asarray(vectors, np.float64)
    q = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_quat(scalar_first=True)
    return q.reshape(*vectors.shape[:-1], 4).astype(dtype)


def random_skeleton(rng, joints=7, kind="tree", dtype=np.float64, end_sites=True) -> Skeleton:
    """A ``"tree"``, ``"chain"`` or ``"star"`` with offsets of about 1; end sites on leaves."""
    choose = {
        "tree": lambda j: int(rng.integers(0, j)),
        "chain": lambda j: j - 1,
        "star": lambda j: 0,
    }[kind]
    parents = [-1] + [choose(j) for j in range(1, joints)]
    ends = [j for j in range(joints) if j not in parents] if end_sites else []
    return Skeleton(
        [f"joint{j}" for j in range(joints)],
        parents,
        np.asarray(rng.standard_normal((joints, 3)), dtype),
        end_joints=ends,
        end_offsets=np.asarray(rng.standard_normal((len(ends), 3)), dtype),
    )


def random_motion(
    rng, frames=5, skeleton: Skeleton | int = 7, dtype=np.float64, batch=(), translated=True
) -> Motion:
    """Independent random frames at 30 fps. ``skeleton``: one, or a number of joints for a random
    tree; ``translated=False`` keeps every joint but the root at its offset."""
    if not isinstance(skeleton, Skeleton):
        skeleton = random_skeleton(rng, skeleton, dtype=dtype)
    shape = (*batch, frames, skeleton.num_joints)
    q = random_quaternions(rng, shape, dtype)
    seconds = np.broadcast_to(np.asarray(1 / 30, dtype), batch)
    if translated:
        return Motion(skeleton, random_vectors(rng, shape, dtype), q, seconds)
    return Motion.from_root(skeleton, random_vectors(rng, shape[:-1], dtype), q, seconds)


def scipy_rotation(q) -> Rotation:
    """SciPy's object for quaternions (w, x, y, z); leading axes flattened."""
    return Rotation.from_quat(np.asarray(q, np.float64).reshape(-1, 4), scalar_first=True)


def angle_between(a, b) -> np.ndarray:
    """Angle in radians of the rotation from a to b, each (..., 4); accurate near zero."""
    a, b = np.broadcast_arrays(np.asarray(a, np.float64), np.asarray(b, np.float64))
    turn = scipy_rotation(a).inv() * scipy_rotation(b)
    return turn.magnitude().reshape(a.shape[:-1])


def assert_same_rotation(a, b, atol=1e-12):
    """Unit quaternions a and b turn alike to ``atol`` radians (signs may differ)."""
    assert np.shape(a) == np.shape(b), f"shapes {np.shape(a)} and {np.shape(b)}"
    np.testing.assert_allclose(np.linalg.norm(np.asarray(a, np.float64), axis=-1), 1, atol=atol)
    worst = np.max(angle_between(a, b), initial=0.0)
    assert worst <= atol, f"rotations differ by up to {worst:.3g} rad, allowed {atol:.3g}"


def world_by_matrices(motion: Motion):
    """Positions (..., T, J, 3), rotation matrices (..., T, J, 3, 3) and end sites (..., T, E, 3):
    products of 4x4 matrices, one joint at a time, in float64 numpy."""
    q = np.asarray(motion.rotations, np.float64)
    local = np.zeros((*q.shape[:-1], 4, 4))
    local[..., :3, :3] = scipy_rotation(q).as_matrix().reshape(*q.shape[:-1], 3, 3)
    local[..., :3, 3] = motion.translations
    local[..., 3, 3] = 1
    world = local.copy()
    for j, p in enumerate(motion.skeleton.parents):
        if p >= 0:
            world[..., j, :, :] = world[..., p, :, :] @ local[..., j, :, :]
    ends = list(motion.skeleton.end_joints)
    offsets = np.asarray(motion.skeleton.end_offsets, np.float64)
    homogeneous = np.concatenate([offsets, np.ones((len(ends), 1))], -1)[..., None]
    tips = (world[..., ends, :, :] @ homogeneous)[..., :3, 0]
    return world[..., :3, 3], world[..., :3, :3], tips


@contextmanager
def single_precision():
    """JAX as it comes, without float64."""
    jax.config.update("jax_enable_x64", False)
    try:
        yield
    finally:
        jax.config.update("jax_enable_x64", True)


@contextmanager
def no_shape_checks():
    """Switch off the run-time annotation checks that tests run under, to meet the ValueError that
    a user would."""
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        jaxtyping.config.update("jaxtyping_disable", False)


@contextmanager
def compilations() -> Iterator[list[str]]:
    """The names of the programs that are compiled inside, as they are."""
    names = []

    def listen(event, seconds, **about):
        if event.endswith("backend_compile_duration"):
            names.append(about.get("fun_name", event))

    monitoring.register_event_duration_secs_listener(listen)
    try:
        yield names
    finally:
        monitoring.unregister_event_duration_listener(listen)


def by_precision(cases, single, rare=()):
    """Parameters (case, dtype): every case in float64, and in float32 those of ``single``; the
    others in float32 too where a sweep is asked for, as are the ``rare`` at all. For cases that
    take long to compile."""
    return [
        pytest.param(
            case,
            np.dtype(dtype),
            id=f"{case}-{dtype}",
            marks=pytest.mark.sweep
            if case in rare or (dtype == "float32" and case not in single)
            else (),
        )
        for case in cases
        for dtype in ("float32", "float64")
    ]


def hung(motion, tilt=0.3):
    """The same below a joint that stands still, is tilted and lies elsewhere; and its skeleton."""
    old = motion.skeleton
    half = np.array([np.cos(tilt / 2), np.sin(tilt / 2), 0, 0])
    place = np.array([1.0, 2.0, 3.0])
    skeleton = Skeleton(
        names=("Reference", *old.names),
        parents=(-1, *(parent + 1 for parent in old.parents)),
        offsets=np.concatenate([np.zeros((1, 3)), old.offsets]),
        up=old.up,
    )
    still = np.ones((motion.num_frames, 1, 1))
    q, p = np.array(motion.rotations), np.array(motion.translations)
    inverse = jnp.asarray(half * [1, -1, -1, -1])
    q[:, 0] = quaternion.multiply(jnp.broadcast_to(inverse, q[:, 0].shape), q[:, 0])
    p[:, 0] = quaternion.rotate(inverse, jnp.asarray(p[:, 0] - place))
    return Motion(
        skeleton,
        np.concatenate([still * place, p], axis=1),
        np.concatenate([still * half, q], axis=1),
        motion.frame_time,
        translated_joints=(1,),
    )
