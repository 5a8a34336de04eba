"""Displacement maps in both senses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import Motion
from jaxmotion import quaternion as qt
from jaxmotion.displacement import Displacement, minus, plus
from tests.helpers import (
    assert_finite_derivatives,
    assert_same_rotation,
    assert_trees_close,
    check_gradients,
    no_shape_checks,
    random_motion,
    random_quaternions,
    random_skeleton,
    random_vectors,
)

SENSES = ["world", "body"]


def _pair(frames=4, dtype=np.float64, seed=0):
    rng = np.random.default_rng(seed)
    skeleton = random_skeleton(rng, 5, dtype=dtype)
    return random_motion(rng, frames, skeleton, dtype), random_motion(rng, frames, skeleton, dtype)


@pytest.mark.parametrize("sense", SENSES)
@pytest.mark.parametrize("frames", [1, 2, 3])
def test_plus_undoes_minus_and_minus_undoes_plus(sense, frames, dtype):
    motion, reference = _pair(frames, dtype)
    tolerance = 1e-5 if dtype == np.float32 else 1e-12
    apart = minus(motion, reference, sense)
    assert apart.rotations.dtype == apart.translations.dtype == dtype
    again = plus(reference, apart)
    assert again.dtype == dtype
    assert_same_rotation(again.rotations, motion.rotations, tolerance)
    np.testing.assert_allclose(again.translations, motion.translations, 0, tolerance)
    rng = np.random.default_rng(1)
    shape = (frames, 5)
    small = Displacement(
        random_vectors(rng, shape, dtype), qt.log(random_quaternions(rng, shape, dtype, 1.5)), sense
    )
    back = minus(plus(reference, small), reference, sense)
    assert back.sense == sense
    np.testing.assert_allclose(back.translations, small.translations, 0, tolerance)
    np.testing.assert_allclose(back.rotations, small.rotations, 0, tolerance)


def test_world_sense_is_eoms():
    """p + u and q exp(v), v turning by its length (Eom et al. 2019, Eq. 12 and 13)."""
    quarter = np.sqrt(0.5)
    q = np.tile([quarter, 0, 0, quarter], (1, 5, 1))  # a quarter turn about z
    motion = _pair(1)[0].with_transforms(np.ones((1, 5, 3)), q)
    u, v = np.zeros((1, 5, 3)), np.zeros((1, 5, 3))
    u[..., 0], v[..., 2] = 2.0, np.pi / 2
    moved = plus(motion, Displacement(u, v))
    np.testing.assert_allclose(moved.translations[0, 0], [3, 1, 1], atol=1e-15)
    np.testing.assert_allclose(np.abs(moved.rotations[0, 0]), [0, 0, 0, 1], atol=1e-15)


def test_body_sense_is_lee_and_shins():
    """p + q u q⁻¹ and q exp(v), v turning by twice its length (Lee & Shin 2001, Eq. 2 and 3)."""
    quarter = np.sqrt(0.5)
    q = np.tile([quarter, 0, 0, quarter], (1, 5, 1))
    motion = _pair(1)[0].with_transforms(np.ones((1, 5, 3)), q)
    u, v = np.zeros((1, 5, 3)), np.zeros((1, 5, 3))
    u[..., 0], v[..., 2] = 2.0, np.pi / 4
    moved = plus(motion, Displacement(u, v, "body"))
    np.testing.assert_allclose(moved.translations[0, 0], [1, 3, 1], atol=1e-15)
    np.testing.assert_allclose(np.abs(moved.rotations[0, 0]), [0, 0, 0, 1], atol=1e-15)
    apart = minus(moved, motion, "body")
    np.testing.assert_allclose(apart.translations, u, atol=1e-15)
    np.testing.assert_allclose(apart.rotations, v, atol=1e-15)
    np.testing.assert_allclose(minus(moved, motion).rotations, 2 * v, atol=1e-15)


def test_a_rigid_motion_of_both_clips_leaves_the_body_sense_alone():
    motion, reference = _pair()
    rng = np.random.default_rng(2)
    g, shift = random_quaternions(rng), random_vectors(rng)

    def carried(m: Motion) -> Motion:
        t = m.translations.at[:, 0].set(qt.rotate(g, m.root_positions) + shift)
        return m.with_transforms(t, m.rotations.at[:, 0].set(qt.multiply(g, m.rotations[:, 0])))

    before, after = (
        minus(motion, reference, "body"),
        minus(carried(motion), carried(reference), "body"),
    )
    assert_trees_close(after, before, 1e-12, 1e-12)
    in_world = minus(carried(motion), carried(reference)).translations[:, 0]
    np.testing.assert_allclose(
        in_world, qt.rotate(g, minus(motion, reference).translations[:, 0]), atol=1e-12
    )


@pytest.mark.parametrize("sense", SENSES)
def test_no_displacement_between_q_and_minus_q(sense):
    motion, _ = _pair()
    apart = minus(motion.with_transforms(rotations=-motion.rotations), motion, sense)
    np.testing.assert_allclose(apart.rotations, 0, atol=1e-14)
    np.testing.assert_array_equal(apart.translations, np.zeros((4, 5, 3)))


def test_scale_by_a_number_per_joint_and_per_frame_and_joint():
    motion, reference = _pair()
    apart = minus(motion, reference, "body")
    rng = np.random.default_rng(3)
    for gain in (2.0, 0.5, rng.uniform(size=5), rng.uniform(size=(4, 5))):
        scaled = apart.scale(gain)
        factor = np.broadcast_to(np.asarray(gain), (4, 5))[..., None]
        np.testing.assert_allclose(scaled.translations, factor * apart.translations, 1e-15)
        np.testing.assert_allclose(scaled.rotations, factor * apart.rotations, 1e-15)
        assert scaled.sense == "body"
    none = plus(reference, apart.scale(0))
    assert_trees_close(none, reference, 1e-15, 1e-15)


@pytest.mark.parametrize("sense", SENSES)
def test_derivatives_jit_and_vmap(sense):
    motion, reference = _pair(2)

    def there_and_half_way_back(motion, reference):
        apart = minus(motion, reference, sense)
        return apart, plus(reference, apart.scale(0.5))

    check_gradients(there_and_half_way_back, motion, reference)
    together = jax.tree.map(lambda a, b: jnp.stack([a, b]), motion, reference)
    swapped = jax.tree.map(lambda a, b: jnp.stack([a, b]), reference, motion)
    mapped = jax.jit(jax.vmap(there_and_half_way_back))(together, swapped)
    eager = there_and_half_way_back(motion, reference)
    assert_trees_close(jax.tree.map(lambda x: x[0], mapped), eager, 1e-13, 1e-13)
    batched = there_and_half_way_back(together, swapped)
    assert_trees_close(batched, mapped, 1e-13, 1e-13)


@pytest.mark.parametrize("sense", SENSES)
def test_equal_clips_have_finite_derivatives(sense):
    motion, _ = _pair(1)
    half_turn = motion.with_transforms(
        rotations=qt.multiply(motion.rotations, np.array([0.0, 0.6, 0, 0.8]))
    )
    for other in (motion, half_turn):

        def apart(q, other=other):
            between = minus(other.with_transforms(rotations=q), motion, sense)
            return between.translations, between.rotations

        assert_finite_derivatives(apart, other.rotations)


def test_refusals():
    motion, reference = _pair()
    with pytest.raises(ValueError, match=r"minus: motion has shape \(4, 5, 4\), reference \(2, "):
        minus(motion, reference[:2])
    with pytest.raises(ValueError, match=r"plus: displacement has shape \(4, 5, 3\), the motion"):
        plus(motion[:1], minus(motion, reference))


def test_gains_of_another_shape_are_refused():
    rng = np.random.default_rng(0)
    d = minus(random_motion(rng, 4, 3), random_motion(rng, 4, 3))
    for shape in ((), (3,), (4, 1), (4, 3)):
        assert d.scale(np.full(shape, 2.0)).rotations.shape == (4, 3, 3)
    for shape in ((4, 1, 1), (4,), (8, 3), (1, 3), (1, 4, 3)):
        with no_shape_checks(), pytest.raises(ValueError, match=r"Displacement\.scale: gain has"):
            d.scale(np.ones(shape))
