"""Multiresolution analysis and synthesis, and what a gradient through both costs.

The peer is the same cascade on the raw numbers: R and E as linear masks on every quaternion and
translation component in NumPy, then normalised. It is what one would write without orientation
filters; it is neither invariant nor exact about large turns, but costs what the data costs to move.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import quaternion
from jaxmotion.multiresolution import build_pyramid, scale_details

JOINTS, LEVELS = 65, 6


def clip(frames, dtype="float64"):
    rng = np.random.default_rng(0)
    size, phase = rng.uniform(0.2, 0.5, (2, JOINTS, 3)), rng.uniform(0, 6, (2, JOINTS, 3))
    t = np.arange(frames)[:, None, None] / 30
    turns = sum(
        a * np.sin(2 * np.pi * f * t + p) for a, f, p in zip(size, (0.5, 1.5), phase, strict=True)
    )
    rotations = quaternion.align_signs(quaternion.exp(jnp.asarray(turns, dtype)))
    skeleton = jm.Skeleton(
        [f"joint{j}" for j in range(JOINTS)], [-1, *range(JOINTS - 1)], np.ones((JOINTS, 3), dtype)
    )
    root = jnp.asarray(np.concatenate([t[:, 0], 0 * t[:, 0], t[:, 0]], axis=1), dtype)
    return jm.Motion.from_root(skeleton, root, rotations, 1 / 30)


def raw_channels(motion):
    """The peer: quaternions and root positions as f[T, 4J + 3]."""
    q = np.asarray(motion.rotations).reshape(motion.num_frames, -1)
    return np.concatenate([q, np.asarray(motion.root_positions)], axis=1)


def analyse_channels(x):
    details = []
    for _ in range(LEVELS):
        if len(x) % 2 == 0:
            x = np.concatenate([x, 2 * x[-1:] - x[-2:-1]])
        padded = np.concatenate([2 * x[:1] - x[2:0:-1], x, 2 * x[-1:] - x[-2:-4:-1]])
        mask = np.array([-1, 4, 18, 4, -1]) / 24
        coarse = sum(a * padded[m : m + len(x) : 2] for m, a in enumerate(mask))
        details.append(x - between(coarse)[: len(x)])
        x = coarse
    return x, details


def between(x):
    padded = np.concatenate([2 * x[:1] - x[1:2], x, 2 * x[-1:] - x[-2:-1]])
    odd = (9 * (padded[1:-2] + padded[2:-1]) - padded[:-3] - padded[3:]) / 16
    out = np.empty((2 * len(x) - 1, x.shape[1]), x.dtype)
    out[::2], out[1::2] = x, odd
    return out


def synthesise_channels(base, details, frames):
    for detail in details[::-1]:
        base = between(base)[: len(detail)] + detail
    q = base[:frames, : 4 * JOINTS].reshape(frames, JOINTS, 4)
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("frames", [1263, 2526])
def test_analysis(race, frames, dtype):
    motion = clip(frames, dtype)
    x = raw_channels(motion)
    race(
        f"build_pyramid {frames}x{JOINTS} {dtype}",
        lambda: build_pyramid(motion, LEVELS),
        {"NumPy on raw channels": lambda: analyse_channels(x)},
    )


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("frames", [1263, 2526])
def test_synthesis(race, frames, dtype):
    motion = clip(frames, dtype)
    pyramid, base, details = build_pyramid(motion, LEVELS), *analyse_channels(raw_channels(motion))
    ours, theirs = race(
        f"reconstruct {frames}x{JOINTS} {dtype}",
        pyramid.reconstruct,
        {"NumPy on raw channels": lambda: synthesise_channels(base, details, frames)},
    )
    for q in (ours.rotations, theirs["NumPy on raw channels"]):
        cosine = np.abs(np.sum(np.asarray(q, np.float64) * motion.rotations, axis=-1))
        np.testing.assert_allclose(cosine, 1, atol=1e-12 if dtype == "float64" else 1e-5)


@pytest.mark.parametrize("frames", [1263, 2526])
def test_gradient(race, frames):
    """Gains and a loss, forward against value and gradient: the second column over the first is
    what a gradient costs, at most 3 being wanted."""
    motion = clip(frames)
    weights = jnp.asarray(np.random.default_rng(1).standard_normal(motion.rotations.shape))

    def loss(rotations, gain):
        pyramid = build_pyramid(motion.with_transforms(motion.translations, rotations), LEVELS)
        return jnp.sum(weights * scale_details(pyramid, gain).rotations)

    forward, both = jax.jit(loss), jax.jit(jax.value_and_grad(loss, argnums=(0, 1)))
    gain = jnp.asarray(1.1)
    ours, theirs = race(
        f"analysis, gains, synthesis, loss {frames}x{JOINTS} float64",
        lambda: forward(motion.rotations, gain),
        {"ours, value and gradient": lambda: both(motion.rotations, gain)},
    )
    np.testing.assert_allclose(ours, theirs["ours, value and gradient"][0], rtol=1e-9)
