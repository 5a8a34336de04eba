"""Contacts of 560 frames by 65 joints: finding them, and cleaning up the skate of both feet.

No peer finds or restores contacts; SciPy's minimiser of one leg at a time stands in for what users
write (the same ankle targets, joint angles of hip and knee, a frame at a time).
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.contacts import cleanup_footskate, cleanup_root, detect, find_feet, limb_ik, replant

FRAMES, JOINTS = 560, 65


def _walk(dtype):
    """The sample's walk, drifting, with fingers up to 65 joints."""
    motion = jm.samples.walk(FRAMES).motion
    motion = jm.samples.slide_root(motion, jax.random.key(0), amount=0.2).motion
    skeleton = motion.skeleton
    more = JOINTS - skeleton.num_joints
    hands = [skeleton.index("LeftHand"), skeleton.index("RightHand")]
    whole = jm.Skeleton(
        [*skeleton.names, *(f"Finger{i}" for i in range(more))],
        [*skeleton.parents, *(hands[i % 2] for i in range(more))],
        np.concatenate([skeleton.offsets, np.full((more, 3), 0.02)]),
    )
    still = np.tile([1.0, 0, 0, 0], (FRAMES, more, 1))
    rotations = jnp.concatenate([motion.rotations, still], axis=1)
    return jm.Motion.from_root(whole, motion.root_positions, rotations, 1 / 60).astype(dtype)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("method", ["segments", "thresholds"])
def test_detect(race, method, dtype):
    motion = _walk(dtype)
    points = find_feet(motion)
    found, _ = race(
        f"detect {method} {FRAMES}x{JOINTS} {dtype}",
        lambda: detect(motion, method=method, points=points),
    )
    assert np.asarray(found.mask).any(1).mean() > 0.9


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("cleanup", [cleanup_footskate, cleanup_root])
def test_cleanup(race, cleanup, dtype):
    """The goal for the five steps is 50 ms."""
    motion = _walk(dtype)
    contacts = replant(motion, detect(motion))
    clean, _ = race(
        f"{cleanup.__name__} {FRAMES}x{JOINTS} {dtype}", lambda: cleanup(motion, contacts)
    )
    before, after = (jm.metrics.foot_skate(m, contacts) for m in (motion, clean))
    # The root alone cannot hold two feet that slide apart.
    assert after < (0.2 if cleanup is cleanup_footskate else 1.0) * before


def test_limb_ik(race):
    """560 legs; SciPy takes its own time over 20 of them."""
    rng = np.random.default_rng(0)
    root, hip_knee, knee_ankle = rng.standard_normal((3, FRAMES, 3))
    target = root + 0.5 * (hip_knee + knee_ankle) + 0.1 * rng.standard_normal((FRAMES, 3))
    given = [jnp.asarray(a) for a in (root, root + hip_knee, root + hip_knee + knee_ankle, target)]
    ours = jax.jit(limb_ik)
    few = 20

    def end(turns, i):
        hip, knee = Rotation.from_rotvec(turns.reshape(2, 3))
        return root[i] + hip.apply(hip_knee[i] + knee.apply(knee_ankle[i]))

    def theirs():
        for i in range(few):
            least_squares(lambda x, i=i: end(x, i) - target[i], np.full(6, 0.01))
        return target

    result, _ = race(
        f"limb_ik {FRAMES} legs (SciPy: {few})", lambda: ours(*given), {"SciPy": theirs}
    )
    reachable = np.linalg.norm(result.end - target, axis=-1) < 1e-9
    assert reachable.mean() > 0.5
