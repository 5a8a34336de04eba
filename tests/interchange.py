"""Clips that formats for other programs trip over, for the tests of glTF and USD."""

import jax.numpy as jnp
import numpy as np

import jaxmotion as jm
from tests.helpers import random_motion, random_skeleton, world_by_matrices

ODD_NAMES = ("mixamorig:Hips", "a b", "a.b", "a-b", "a_b", "1st", "骨", 'x/y[0] "q"\\')


def walk(**changes) -> jm.Motion:
    return jm.samples.load("walk", num_frames=24).motion.replace(**changes)


def six_channels(dtype=np.float64) -> jm.Motion:
    """Every joint turns and moves at random, a tall figure's length or so."""
    return random_motion(np.random.default_rng(0), 6, 9, dtype)


def zero_offsets() -> jm.Motion:
    skeleton = random_skeleton(np.random.default_rng(1), 8)
    offsets = np.array(skeleton.offsets)
    offsets[[1, 3, 4]] = 0
    skeleton = jm.Skeleton(skeleton.names, skeleton.parents, offsets)
    return random_motion(np.random.default_rng(2), 5, skeleton, translated=False)


def named(*names: str) -> jm.Motion:
    rng = np.random.default_rng(3)
    chain = random_skeleton(rng, len(names), "chain")
    skeleton = jm.Skeleton(
        names,
        chain.parents,
        chain.offsets,
        end_joints=[len(names) - 1],
        end_offsets=np.ones((1, 3)),
    )
    return random_motion(rng, 3, skeleton, translated=False)


def off_their_offsets() -> jm.Motion:
    """Two joints stand off their offsets in all frames: one is said to move, one is not."""
    motion = random_motion(np.random.default_rng(4), 4, 5, translated=False)
    translations = np.array(motion.translations)
    translations[:, 2] += 0.5
    translations[:, 3] += 0.5
    return motion.replace(translations=translations, translated_joints=(0, 2))


def far_from_the_origin() -> jm.Motion:
    motion = six_channels()
    away = motion.translations.at[:, 0].add(jnp.asarray([50.0, 0.0, -80.0]))
    return motion.replace(translations=away)


CLIPS = {
    "walk": walk,
    "walk, float32": lambda: walk().astype(np.float32),
    "six channels": six_channels,
    "six channels, float32": lambda: six_channels(np.float32),
    "zero offsets": zero_offsets,
    "odd names": lambda: named(*ODD_NAMES),
    "z up": lambda: jm.reorient(walk(), "z"),
    "x up": lambda: jm.reorient(walk(), "x"),
    "one frame": lambda: walk()[:1],
    "one joint": lambda: random_motion(np.random.default_rng(5), 4, 1),
    "29.97 a second": lambda: walk(frame_time=1001 / 30000),
    "0.0333333 seconds": lambda: walk(frame_time=0.0333333),
    "off their offsets": off_their_offsets,
    "far away": far_from_the_origin,
}
REAL = ("bandai/kick_normal_001.bvh", "cmu/01_01.amc", "cmu/01_01.bvh")


def places(motion: jm.Motion) -> tuple[np.ndarray, float]:
    """Where joints and end sites are, f64[T, N, 3], and the figure's height."""
    joints, _, ends = world_by_matrices(motion)
    points = np.concatenate([joints, ends], axis=1)
    return points, float(np.median(np.ptp(points, axis=1).max(axis=-1))) or 1.0


def assert_close(got, motion: jm.Motion, scale: float = 1.0, tolerance: float = 1e-5) -> None:
    """Places are where they should be, to 1e-5 of the height, or of how far away it all is."""
    want, height = places(motion)
    size = max(height, 0.1 * np.abs(want).max())
    assert got.shape == want.shape
    worst = np.abs(got / scale - want).max() / size
    assert worst <= tolerance, f"off by {worst:.2g} of the height"
