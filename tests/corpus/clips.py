"""Small clips of one skeleton, for the tests of this room."""

import numpy as np

import jaxmotion as jm
from tests.helpers import random_skeleton

SECONDS = 1 / 30


def skeleton(dtype=np.float64, joints=5) -> jm.Skeleton:
    return random_skeleton(np.random.default_rng(7), joints, dtype=dtype)


def clip(frames, seed=0, dtype=np.float64, bones=None, seconds=SECONDS) -> jm.Motion:
    """A smooth random clip whose root is translated."""
    rng = np.random.default_rng(seed)
    bones = skeleton(dtype) if bones is None else bones
    time = np.arange(frames)[:, None, None] * 0.1
    shape = (1, bones.num_joints, 4)
    q = rng.standard_normal(shape) + 0.3 * np.sin(time * rng.uniform(1, 3, shape))
    q[..., 0] += 3
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    t = np.broadcast_to(np.asarray(bones.offsets), (frames, bones.num_joints, 3)).copy()
    t[:, 0] = rng.standard_normal((frames, 3))
    return jm.Motion(bones, t.astype(dtype), q.astype(dtype), seconds, translated_joints=(0,))


def several(lengths=(40, 17, 64, 5, 33), dtype=np.float64) -> dict[str, jm.Motion]:
    return {f"take {k}": clip(n, k, dtype) for k, n in enumerate(lengths)}


def assert_same_clip(got: jm.Motion, want: jm.Motion):
    assert got.dtype == want.dtype
    assert got.skeleton.names == want.skeleton.names
    assert got.translated_joints == want.translated_joints
    np.testing.assert_array_equal(got.rotations, want.rotations)
    np.testing.assert_array_equal(got.translations, want.translations)
    np.testing.assert_array_equal(got.skeleton.offsets, want.skeleton.offsets)
    np.testing.assert_array_equal(got.skeleton.end_offsets, want.skeleton.end_offsets)
    assert float(got.frame_time) == float(want.frame_time)
