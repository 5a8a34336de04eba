"""Quaternion algebra on a capture's worth of rotations, 2526 frames by 65 joints.

Peers: jaxlie vmapped over both axes and jitted, and pymotion in numpy.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import quaternion as qt

FRAMES, JOINTS = 2526, 65

jaxlie = pytest.importorskip("jaxlie")
pymotion_quat = pytest.importorskip("pymotion.rotations.quat")

_SO3 = jaxlie.SO3


def _over_all(f):
    return jax.jit(jax.vmap(jax.vmap(f)))


CASES = {
    "multiply": (
        qt.multiply,
        lambda a, b: (_SO3(a) @ _SO3(b)).wxyz,
        pymotion_quat.mul,
        "qq",
    ),
    "rotate": (
        qt.rotate,
        lambda q, v: _SO3(q) @ v,
        pymotion_quat.mul_vec,
        "qv",
    ),
    "exp": (
        qt.exp,
        lambda v: _SO3.exp(v).wxyz,
        pymotion_quat.from_scaled_angle_axis,
        "v",
    ),
    "log": (
        qt.log,
        lambda q: _SO3(q).log(),
        pymotion_quat.to_scaled_angle_axis,
        "q",
    ),
    "slerp": (
        lambda a, b: qt.slerp(a, b, 0.3),
        lambda a, b: (_SO3(a) @ _SO3.exp(0.3 * (_SO3(a).inverse() @ _SO3(b)).log())).wxyz,
        lambda a, b: pymotion_quat.slerp(a, b, 0.3),
        "qq",
    ),
}


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("operation", CASES)
def test_quaternion(race, operation, dtype):
    ours, jaxlie_one, pymotion_all, kinds = CASES[operation]
    rng = np.random.default_rng(0)
    inputs = []
    for kind in kinds:
        x = rng.standard_normal((FRAMES, JOINTS, 4 if kind == "q" else 3))
        if kind == "q":
            x /= np.linalg.norm(x, axis=-1, keepdims=True)
            x *= np.where(x[..., :1] < 0, -1, 1)
        inputs.append(x.astype(dtype))
    arrays = [jnp.asarray(x) for x in inputs]
    ours_jitted, jaxlie_jitted = jax.jit(ours), _over_all(jaxlie_one)
    result, results = race(
        f"{operation} {FRAMES}x{JOINTS} {dtype}",
        lambda: ours_jitted(*arrays),
        {
            "jaxlie": lambda: jaxlie_jitted(*arrays),
            "pymotion": lambda: pymotion_all(*inputs),
        },
    )
    close = 2e-3 if dtype == "float32" else 1e-6
    for theirs in results.values():
        if operation == "slerp":  # q and −q
            theirs = np.where(np.sum(theirs * np.asarray(result), -1, keepdims=True) < 0, -1, 1) * (
                theirs
            )
        np.testing.assert_allclose(result, theirs, close, close)
