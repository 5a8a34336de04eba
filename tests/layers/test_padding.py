"""Padded clips: the frames that count come out as if there were no padding."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.layers.decompose import layers_of
from tests.helpers import assert_same_rotation, random_motion, random_vectors


def _clip(rng, dtype, frames=20):
    noise = random_motion(rng, frames, 4, dtype)
    steps = jnp.cumsum(random_vectors(rng, (frames, 4), dtype, 0.2), axis=0)
    return noise.with_transforms(rotations=jm.quaternion.exp(steps))


def _padded(motion, rng, extra):
    rest = random_motion(rng, extra, motion.skeleton, motion.dtype)
    return motion.with_transforms(
        jnp.concatenate([motion.translations, rest.translations]),
        jnp.concatenate([motion.rotations, rest.rotations]),
    )


@pytest.mark.parametrize(("scope", "dtype"), [("global", "float64"), ("per_joint", "float32")])
def test_what_lies_beyond_the_length_does_not_matter(scope, dtype):
    rng = np.random.default_rng(0)
    motion = _clip(rng, jnp.dtype(dtype))
    plain = jm.decompose(motion, scope=scope)
    layers = jm.decompose(_padded(motion, rng, 12), scope=scope, length=len(motion))
    atol = 1e-4 if dtype == "float32" else 1e-11
    np.testing.assert_array_equal(layers.lam, plain.lam)
    np.testing.assert_array_equal(layers.saturated, plain.saturated)
    assert_same_rotation(layers.base.rotations[:20], plain.base.rotations, 10 * atol)
    np.testing.assert_allclose(layers.control.rotations[:20], plain.control.rotations, atol=atol)
    np.testing.assert_allclose(
        layers.control.translations[:20], plain.control.translations, atol=10 * atol
    )


def test_one_compiled_function_serves_every_length(caplog):
    rng = np.random.default_rng(1)
    clip = _clip(rng, np.float64, 26)
    jm.denoise(_padded(clip, rng, 6), length=26)
    jm.stylize(_padded(clip, rng, 6), 1.5, length=26)
    with jax.log_compiles():
        short = _padded(clip[:20], rng, 12)
        out = jm.denoise(short, length=20)
        lively = jm.stylize(short, 1.5, length=20)
    assert f"Compiling jit({layers_of.__name__})" not in caplog.text
    assert_same_rotation(out.rotations[:20], jm.denoise(clip[:20]).rotations, 1e-10)
    assert_same_rotation(lively.rotations[:20], jm.stylize(clip[:20], 1.5).rotations, 1e-10)


def test_derivatives_reach_the_frames_that_count_only():
    rng = np.random.default_rng(3)
    motion = _clip(rng, np.float64)
    padded = _padded(motion, rng, 12)

    def loss(translations):
        out = jm.denoise(padded.with_transforms(translations), length=20)
        return jnp.sum(out.translations[:20] ** 2)

    slope = jax.grad(loss)(padded.translations)
    assert jnp.all(jnp.isfinite(slope))
    assert jnp.all(slope[20:] == 0)
    assert jnp.all(jnp.any(slope[:20] != 0, axis=(1, 2)))
