"""Motion layers: recomposition, the base search, the control split."""

import logging

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import quaternion
from jaxmotion.displacement import plus
from jaxmotion.layers.decompose import RUNGS
from tests.helpers import (
    assert_jit_and_vmap_agree,
    assert_same_rotation,
    assert_trees_close,
    check_gradients,
    no_shape_checks,
    quaternions_by,
    random_motion,
)
from tests.smoothing.test_rotations import dense_smooth, unit


def swinging(frames=80, joints=3, swing=1.0, noise=0.02, dtype=np.float64, seed=0):
    """Joints swinging about fixed axes with noise, the root gliding forward."""
    rng = np.random.default_rng(seed)
    skeleton = jm.Skeleton(
        [f"j{j}" for j in range(joints)],
        [-1, *range(joints - 1)],
        np.asarray(rng.standard_normal((joints, 3)), dtype),
    )
    t = np.arange(frames) / 24
    axes = unit(rng.standard_normal((joints, 3)))
    phase = 2 * np.pi * (t[:, None] * np.linspace(0.8, 1.6, joints) + rng.uniform(0, 1, joints))
    vectors = swing * np.sin(phase)[..., None] * axes + noise * rng.standard_normal(
        (frames, joints, 3)
    )
    rotations = jnp.asarray(quaternions_by(vectors, dtype))
    root = np.stack([t, 0.05 * np.sin(9 * t), 1.3 * t], -1)
    return jm.Motion.from_root(skeleton, root.astype(dtype), rotations, 1 / 24)


def longest(displacement):
    return np.max(np.linalg.norm(displacement, axis=-1), axis=0)


def numpy_ladder(motion, gamma):
    """Per joint, the rung below the first whose displacement passes γ, by dense solves."""
    q = np.asarray(quaternion.align_signs(motion.rotations))
    best = np.zeros(q.shape[1], int)
    stopped = np.zeros(q.shape[1], bool)
    lengths = []
    for k in range(RUNGS):
        base = unit(dense_smooth(q, 0.1 * 2.0**k))
        length = longest(np.asarray(quaternion.log(quaternion.between(base, q))))
        lengths.append(length.max())
        stopped |= length > gamma
        best = np.where(stopped, best, k)
    over = np.flatnonzero(np.array(lengths) > gamma)
    return best, (over[0] - 1 if over.size else RUNGS - 1)


@pytest.mark.parametrize("scope", ["global", "per_joint"])
def test_layers_recompose_exactly(scope, dtype):
    motion = swinging(swing=2.0, dtype=dtype)
    layers = jm.decompose(motion, scope=scope)
    again = plus(plus(layers.base, layers.control), layers.residual)
    tolerance = 1e-12 if dtype == np.float64 else 2e-6
    assert again.rotations.dtype == again.translations.dtype == dtype
    assert_same_rotation(again.rotations, motion.rotations, atol=tolerance)
    np.testing.assert_allclose(again.translations, motion.translations, atol=tolerance)


@pytest.mark.parametrize(("swing", "gamma"), [(2.2, np.pi / 2), (1.2, 1.0), (0.3, np.pi / 2)])
def test_the_base_is_on_the_rung_that_a_dense_search_finds(swing, gamma):
    motion = swinging(swing=swing)
    joint_rungs, rung = numpy_ladder(motion, gamma)
    layers = jm.decompose(motion, gamma=gamma)
    np.testing.assert_allclose(layers.lam * layers.sigma, 0.1 * 2.0**rung, rtol=1e-12)
    assert bool(layers.saturated) == (rung == RUNGS - 1)
    assert longest(jm.displacement.minus(motion, layers.base).rotations).max() <= gamma
    each = jm.decompose(motion, gamma=gamma, scope="per_joint")
    np.testing.assert_allclose(each.lam * each.sigma, 0.1 * 2.0**joint_rungs, rtol=1e-12)
    np.testing.assert_array_equal(each.saturated, joint_rungs == RUNGS - 1)


def test_a_calm_motion_saturates_with_its_swing_as_the_displacement():
    # A 0.3 rad oscillation never reaches γ: the base is nearly straight and says so.
    motion = swinging(frames=240, joints=1, swing=0.3, noise=0.0)
    layers = jm.decompose(motion)
    assert bool(layers.saturated)
    assert float(layers.lam * layers.sigma) == pytest.approx(0.1 * 2.0 ** (RUNGS - 1))
    assert 0.25 < longest(jm.displacement.minus(motion, layers.base).rotations).max() < 0.4


def test_control_is_the_smoothed_displacement_and_residual_the_rest():
    motion = swinging(swing=1.5)
    layers = jm.decompose(motion, lam_c=2.0, sigma_c=1.5)
    whole = jm.displacement.minus(motion, layers.base)
    np.testing.assert_allclose(
        layers.control.rotations, dense_smooth(whole.rotations, 3.0), atol=1e-11
    )
    np.testing.assert_allclose(
        layers.control.translations, dense_smooth(whole.translations, 3.0), atol=1e-11
    )
    turn = quaternion.multiply(
        quaternion.exp(layers.control.rotations), quaternion.exp(layers.residual.rotations)
    )
    assert_same_rotation(turn, quaternion.exp(whole.rotations))


def test_parameters_per_joint_and_traced():
    motion = swinging()
    lam = np.array([0.5, 1.0, 4.0])
    layers = jm.decompose(motion, lam_c=lam, sigma_c=jnp.array(2.0))
    whole = jm.displacement.minus(motion, layers.base)
    for j in range(3):
        want = dense_smooth(whole.rotations[:, j], 2.0 * lam[j])
        np.testing.assert_allclose(layers.control.rotations[:, j], want, atol=1e-11)


def test_new_parameters_and_clips_of_one_length_reuse_the_compiled_code(caplog):
    motion, other = swinging(), swinging(seed=1)
    jm.decompose(motion, lam_c=1.0)
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        jm.decompose(other, lam_c=3.0, gamma=1.2)
    assert "Compiling" not in caplog.text


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_shortest_clips(frames):
    motion = swinging()[:frames]
    layers = jm.decompose(motion)
    again = jm.synthesize(layers, 1.0, 1.0)
    assert_same_rotation(again.rotations, motion.rotations)
    assert np.all(np.isfinite(layers.control.rotations))


def test_flipped_signs_and_zero_motion_change_nothing():
    motion = swinging()
    signs = np.random.default_rng(3).choice([-1.0, 1.0], (80, 3, 1))
    flipped = motion.with_transforms(rotations=motion.rotations * signs)
    a, b = jm.decompose(motion), jm.decompose(flipped)
    assert_same_rotation(a.base.rotations, b.base.rotations)
    np.testing.assert_allclose(a.control.rotations, b.control.rotations, atol=1e-12)
    still = jm.decompose(motion.with_transforms(rotations=motion.rotations[:1].repeat(80, 0)))
    assert longest(still.control.rotations).max() < 1e-12


def test_derivatives_in_both_modes_and_under_vmap():
    motion = swinging(frames=12)

    def f(vectors, positions, lam):
        clip = jm.Motion.from_root(motion.skeleton, positions, quaternion.exp(vectors), 1 / 24)
        layers = jm.decompose(clip, lam_c=lam)
        return layers.base.rotations, layers.control, layers.residual

    vectors = quaternion.log(motion.rotations)
    check_gradients(f, vectors, motion.root_positions, np.array(0.7), rtol=1e-5, atol=1e-6)
    assert_jit_and_vmap_agree(
        lambda v: (
            jm.decompose(
                jm.Motion.from_root(
                    motion.skeleton, motion.root_positions, quaternion.exp(v), 1 / 24
                )
            ).control.rotations
        ),
        vectors,
        rtol=1e-9,
        atol=1e-10,
    )


def test_inputs_are_untouched_and_mistakes_named():
    motion = random_motion(np.random.default_rng(0), 6, 3)
    copy = jax.tree.map(jnp.array, motion)
    jm.decompose(motion)
    assert_trees_close(copy, motion, 0, 0)
    with no_shape_checks(), pytest.raises(ValueError, match="scope"):
        jm.decompose(motion, scope="body")
    with pytest.raises(ValueError, match="gamma"):
        jm.decompose(motion, gamma=4.0)


def test_samples_of_no_weight_do_not_matter():
    motion = swinging(40)
    weights = np.ones((40, 3))
    weights[5:8, 1] = weights[20, 2] = 0
    rng = np.random.default_rng(9)
    wild = unit(rng.standard_normal(motion.rotations.shape))
    spoilt = motion.with_transforms(
        rotations=jnp.where(weights[..., None] > 0, motion.rotations, wild)
    )
    a = jm.decompose(motion, weights=weights, tune="evidence")
    b = jm.decompose(spoilt, weights=weights, tune="evidence")
    np.testing.assert_allclose(a.lam, b.lam)
    for x, y in zip(a.tuning.rotations.lam, b.tuning.rotations.lam, strict=True):
        np.testing.assert_allclose(x, y, 1e-6)
    clean, mended = (plus(layers.base, layers.control) for layers in (a, b))
    assert_same_rotation(clean.rotations, mended.rotations, 1e-7)
    shared = jm.decompose(motion, weights=weights[:, 0])
    apart = jm.decompose(motion, weights=np.repeat(weights[:, :1], 3, 1))
    assert_same_rotation(shared.base.rotations, apart.base.rotations, 1e-9)
    with pytest.raises(ValueError, match=r"expected \(40,\) or \(40, 3\)"):
        jm.decompose(motion, weights=weights[:30])


@pytest.mark.parametrize("swing", [0.0, 0.3])
def test_a_calm_motion_has_an_exact_base_in_single_precision(swing):
    """As stiff a one as the dtype has digits for, not the top of the ladder."""
    motion = swinging(40, 2, swing=swing, noise=0.0, dtype=np.float32)
    layers = jm.decompose(motion, method="geodesic")
    assert bool(layers.saturated)
    assert float(layers.lam * layers.sigma) == pytest.approx(0.1 * 2.0**13)
    double = jnp.asarray(motion.rotations, np.float64)
    want = jm.smoothing.geodesic(
        quaternion.normalize(double), layers.lam.astype(float), layers.sigma.astype(float)
    ).mean
    assert_same_rotation(layers.base.rotations, want, 1e-5)


def test_the_geodesic_base_is_the_exact_smoother_s_and_recomposes():
    motion = swinging(40)
    layers = jm.decompose(motion, method="geodesic")
    chordal = jm.decompose(motion)
    np.testing.assert_array_equal(layers.lam, chordal.lam)
    want = jm.smoothing.geodesic(motion.rotations, layers.lam, layers.sigma).mean
    assert_same_rotation(layers.base.rotations, want, 1e-9)
    np.testing.assert_allclose(layers.base.translations, chordal.base.translations, atol=1e-12)
    again = plus(plus(layers.base, layers.control), layers.residual)
    assert_same_rotation(again.rotations, motion.rotations, 1e-10)
    with no_shape_checks(), pytest.raises(ValueError, match="method='exact'"):
        jm.decompose(motion, method="exact")
