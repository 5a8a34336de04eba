"""glTF and USD files written.

There is no peer that writes a motion in either. "numbers only" is writing the same arrays, float32,
to an .npz: how much of it is the numbers.
"""

import jax
import numpy as np
import pytest

import jaxmotion as jm

pytest.importorskip("pygltflib")
pytest.importorskip("pxr")


def dancer(frames: int, joints: int) -> jm.Motion:
    """A random chain whose root moves, in metres."""
    rng = np.random.default_rng(0)
    parents = [-1, *(int(rng.integers(max(0, j - 4), j)) for j in range(1, joints))]
    skeleton = jm.Skeleton(
        [f"joint{j}" for j in range(joints)], parents, rng.normal(size=(joints, 3))
    )
    q = rng.normal(size=(frames, joints, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    return jm.Motion.from_root(skeleton, rng.normal(size=(frames, 3)), q, 1 / 60)


@pytest.mark.parametrize("suffix", ["glb", "usda", "usdc"])
@pytest.mark.parametrize("translated", [False, True], ids=["rotations", "six channels"])
def test_write(race, suffix, translated, tmp_path):
    motion = jax.block_until_ready(dancer(2526, 65))
    if translated:
        moved = np.asarray(motion.translations) + np.random.default_rng(1).normal(
            size=(2526, 65, 3)
        )
        motion = motion.replace(translations=moved, translated_joints=tuple(range(65)))
    path = tmp_path / f"dance.{suffix}"
    jm.save(motion, path, metres=1.0)
    turns, places = (np.asarray(x, np.float32) for x in (motion.rotations, motion.translations))
    arrays = (turns, places) if translated else (turns, places[:, 0])
    race(
        f"write {suffix} 2526x65{', six channels' if translated else ''}",
        lambda: jm.save(motion, path, metres=1.0),
        {"numbers only": lambda: np.savez(tmp_path / "dance.npz", *arrays)},
        amount=(path.stat().st_size / 1e6, "MB"),
    )
