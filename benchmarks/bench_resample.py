"""Resampling and time warps against SciPy's splines and Slerp.

SciPy is handed sign-aligned quaternions and gives poses only; ours chooses signs, keeps the motion
whole and is timed through its public function, bookkeeping and all. Table 1 of Eom et al. 2019 (one
thread of an i7-5930K) reports 1 ms for 8 keys to 40 frames, 6 s for 34 to 680, 3.9 s for the time
warp of 230 frames to 286.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import quaternion

JOINTS = 24
PEERS = {"lgs": "SciPy CubicSpline", "slerp": "SciPy Slerp"}


def clip(frames, fps=24.0, dtype="float64"):
    rng = np.random.default_rng(0)
    size, phase = rng.uniform(0.2, 0.5, (2, JOINTS, 3)), rng.uniform(0, 6, (2, JOINTS, 3))
    t = np.arange(frames)[:, None, None] / fps
    turns = sum(
        a * np.sin(2 * np.pi * f * t + p) for a, f, p in zip(size, (0.5, 1.5), phase, strict=True)
    )
    rotations = quaternion.align_signs(quaternion.exp(jnp.asarray(turns, dtype)))
    parents = [-1, *range(JOINTS - 1)]
    skeleton = jm.Skeleton(
        [f"joint{j}" for j in range(JOINTS)], parents, np.ones((JOINTS, 3), dtype)
    )
    root = jnp.asarray(np.concatenate([t[:, 0], 0 * t[:, 0], t[:, 0]], axis=1), dtype)
    return jm.Motion.from_root(skeleton, root, rotations, 1 / fps)


def scipy_peers(motion, knots, at):
    interpolate = pytest.importorskip("scipy.interpolate")
    transform = pytest.importorskip("scipy.spatial.transform")
    at = np.minimum(at, knots[-1])  # ours may end a twentieth of a frame later
    q, p = np.asarray(motion.rotations), np.asarray(motion.root_positions)

    def cubic():
        x = interpolate.CubicSpline(knots, q, bc_type="natural")(at)
        root = interpolate.CubicSpline(knots, p, bc_type="natural")(at)
        return x / np.linalg.norm(x, axis=-1, keepdims=True), root

    def slerp():
        turns = [
            transform.Slerp(knots, transform.Rotation.from_quat(q[:, j], scalar_first=True))(at)
            for j in range(JOINTS)
        ]
        root = interpolate.make_interp_spline(knots, p, k=1)(at)
        return np.stack([turn.as_quat(scalar_first=True) for turn in turns], axis=1), root

    return {PEERS["lgs"]: cubic, PEERS["slerp"]: slerp}


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("method", ["lgs", "slerp"])
@pytest.mark.parametrize(("before", "after"), [(120, 24), (24, 60), (30, 24000 / 1001)])
def test_rates(race, before, after, method, dtype):
    """2526 frames, the longest clip of Table 1, to another rate."""
    motion = clip(2526, before, dtype)
    at = np.arange(jm.resample(motion, fps=after).num_frames) / after
    peers = scipy_peers(motion, np.arange(2526) / before, at)
    ours, theirs = race(
        f"resample {method} 2526x{JOINTS} {before} to {after:.5g} fps {dtype}",
        lambda: jm.resample(motion, fps=after, method=method).rotations,
        {name: peers[name] for name in (PEERS[method],)},
    )
    agree(ours, theirs[PEERS[method]][0], dtype)


@pytest.mark.parametrize(("keys", "frames"), [(8, 40), (34, 680)])
def test_sparse_keys(race, keys, frames):
    """The airplane and the ballet of Table 1."""
    index = np.round(np.linspace(0, frames - 1, keys)).astype(int)
    motion = clip(keys, 8.0)
    cubic = scipy_peers(motion, index, np.arange(frames))[PEERS["lgs"]]
    ours, theirs = race(
        f"resample {keys} keys to {frames}x{JOINTS} float64",
        lambda: jm.resample(motion, index=index, signs="nearest").rotations,
        {PEERS["lgs"]: cubic},
    )
    agree(ours, theirs[PEERS["lgs"]][0], "float64")


@pytest.mark.parametrize(("before", "after"), [(230, 286), (211, 261), (79, 139)])
def test_time_warp(race, before, after):
    """The automatic time warps of Table 1: 3.9 s, 3.0 s and 0.09 s there."""
    motion = clip(before)
    amount = (after - 1) / (before - 1) - 1
    race(
        f"time_warp {before} to {after}x{JOINTS} float64",
        lambda: jm.time_warp(motion, amount=amount).rotations,
    )


def test_signs_of_least_energy(race):
    """2526 frames; the peer is the nearest signs."""
    q = jnp.asarray(clip(2526).rotations)
    nearest = jax.jit(quaternion.align_signs)
    ours, theirs = race(
        f"least_energy_signs 2526x{JOINTS} float64",
        lambda: quaternion.least_energy_signs(q),
        {"ours, align_signs": lambda: nearest(q)},
    )
    np.testing.assert_array_equal(ours, theirs["ours, align_signs"])


def agree(ours, theirs, dtype):
    cosine = np.abs(np.sum(np.asarray(ours, np.float64) * theirs, axis=-1))[:-1]
    np.testing.assert_allclose(cosine, 1, atol=1e-9 if dtype == "float64" else 1e-4)
