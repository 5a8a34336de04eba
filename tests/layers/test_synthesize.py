"""Edits of the layers: denoise, exaggerate, local style."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import butter, filtfilt

import jaxmotion as jm
from jaxmotion import quaternion
from jaxmotion.displacement import Displacement, plus
from jaxmotion.smoothing import smooth_quaternions
from tests.helpers import assert_same_rotation, check_gradients, no_shape_checks
from tests.layers.test_decompose import swinging


@pytest.fixture(scope="module")
def layers():
    return jm.decompose(swinging(swing=1.5))


def test_zero_is_the_base_one_drops_the_residual_both_ones_give_the_original(layers):
    base = jm.synthesize(layers, 0.0)
    assert_same_rotation(base.rotations, layers.base.rotations)
    denoised = jm.synthesize(layers)
    assert_same_rotation(denoised.rotations, plus(layers.base, layers.control).rotations)
    whole = jm.synthesize(layers, 1.0, 1.0)
    assert_same_rotation(whole.rotations, swinging(swing=1.5).rotations)


@pytest.mark.parametrize("gain", [-1.0, 0.3, 2.5])
def test_the_control_turns_gain_times_as_far(layers, gain):
    edited = jm.synthesize(layers, gain)
    v = np.asarray(layers.control.rotations)
    want = quaternion.multiply(layers.base.rotations, quaternion.exp(gain * v))
    assert_same_rotation(edited.rotations, want)
    u = np.asarray(layers.control.translations)
    np.testing.assert_allclose(
        edited.translations, np.asarray(layers.base.translations) + gain * u, atol=1e-12
    )


def test_gains_per_joint_per_frame_and_for_translations(layers):
    per_joint = np.array([1.0, 0.0, 2.0])
    edited = jm.synthesize(layers, per_joint)
    for j, gain in enumerate(per_joint):
        same = jm.synthesize(layers, gain)
        assert_same_rotation(edited.rotations[:, j], same.rotations[:, j])
    ramp = np.linspace(0, 2, 80)[:, None] * per_joint
    ramped = jm.synthesize(layers, ramp)
    assert_same_rotation(ramped.rotations[40], jm.synthesize(layers, ramp[40]).rotations[40])
    split = jm.synthesize(layers, 2.0, translation_alpha=0.0)
    np.testing.assert_allclose(split.translations, layers.base.translations, atol=1e-12)
    assert_same_rotation(split.rotations, jm.synthesize(layers, 2.0).rotations)


@pytest.mark.parametrize("tune", [True, False])
def test_denoise_turns_no_joint_by_more_than_it_may(tune):
    motion = jm.samples.add_noise(swinging(), jax.random.key(1), rotation=0.05).motion
    free = jm.denoise(motion, tune=tune)
    angle = np.asarray(quaternion.distance(motion.rotations, free.rotations))
    most = float(np.median(angle[:, 1]))
    held = jm.denoise(motion, tune=tune, max_change=most)
    other = np.asarray(quaternion.distance(motion.rotations, held.rotations))
    np.testing.assert_allclose(other, np.minimum(angle, most), atol=1e-9)
    toward = quaternion.between(motion.rotations, free.rotations)
    share = other / np.where(angle > 0, angle, 1)
    want = quaternion.multiply(
        motion.rotations, quaternion.exp(share[..., None] * np.asarray(quaternion.log(toward)))
    )
    assert_same_rotation(held.rotations, want)
    slope = jax.grad(lambda m: jm.denoise(motion, tune=tune, max_change=m).rotations[:, 1].sum())
    assert np.isfinite(slope(most))


def test_denoise_by_strength_and_stylize_are_compositions_of_the_two_steps(layers):
    motion = swinging(swing=1.5)
    assert_same_rotation(jm.denoise(motion, tune=False).rotations, jm.synthesize(layers).rotations)
    assert_same_rotation(jm.denoise(motion, strength=0.0).rotations, motion.rotations)
    half = jm.denoise(motion, tune=False, strength=0.5)
    assert_same_rotation(half.rotations, jm.synthesize(layers, 1.0, 0.5).rotations)
    assert_same_rotation(jm.stylize(motion, 2.0).rotations, jm.synthesize(layers, 2.0).rotations)


def test_denoising_brings_a_noisy_clip_closer_to_the_truth():
    clean, noisy = swinging(noise=0.0), swinging(noise=0.05)

    def error(motion):
        return float(jnp.mean(quaternion.distance(motion.rotations, clean.rotations)))

    assert error(jm.denoise(noisy)) < 0.75 * error(noisy)


def test_a_fast_joint_leaves_no_noise_in_a_still_one():
    """One joint turns so fast that the base cannot be smooth. Another stands still, and a mean
    over 240 frames takes out nearly all of its noise; the paper's order leaves its base's."""
    rng = np.random.default_rng(5)
    vectors = 0.05 * rng.standard_normal((240, 2, 3))
    vectors[:, 0, 2] += 2.5 * np.sin(0.6 * np.arange(240))
    skeleton = jm.Skeleton(("fast", "still"), (-1, 0), np.zeros((2, 3)))
    motion = jm.Motion.from_root(skeleton, np.zeros((240, 3)), quaternion.exp(vectors), 1 / 30)

    def error(edited):
        return float(np.mean(np.linalg.norm(quaternion.log(edited.rotations[:, 1]), axis=-1)))

    assert error(jm.denoise(motion)) < 0.12 * error(motion)
    assert error(jm.denoise(motion, tune=False)) > 0.3 * error(motion)


@pytest.mark.parametrize(
    ("method", "prior"),
    [
        ("chordal", "student"),
        ("chordal", "gaussian"),
        pytest.param("geodesic", "student", marks=pytest.mark.sweep),
    ],
)
def test_denoise_is_the_tuned_layers_without_the_residual(method, prior):
    motion = swinging(frames=30)
    layers = jm.decompose(motion, tune="evidence", prior=prior, method=method)
    for strength in (1.0, 0.25):
        options = {} if prior == "student" else {"prior": prior}
        got = jm.denoise(motion, method=method, strength=strength, **options)
        want = jm.synthesize(layers, 1.0, 1.0 - strength)
        assert_same_rotation(got.rotations, want.rotations, 1e-9)
        np.testing.assert_allclose(got.translations, want.translations, atol=1e-12)
    again = plus(plus(layers.base, layers.control), layers.residual)
    assert_same_rotation(again.rotations, motion.rotations, 1e-10)
    assert layers.tuning is not None
    learned = layers.tuning.rotations
    assert (learned.stiffness is None) == (prior == "gaussian")
    clean = smooth_quaternions(
        motion.rotations,
        learned.lam,
        learned.sigma,
        stiffness=learned.stiffness,
        method=method,
    )
    assert_same_rotation(plus(layers.base, layers.control).rotations, clean, 1e-9)


def test_still_joints_are_denoised_exactly_in_single_precision():
    """They learn a smoother that is as stiff as can be."""
    motion = swinging(30, 2, swing=0.0, noise=0.0, dtype=np.float32)
    got = jm.denoise(motion, method="geodesic")
    assert_same_rotation(got.rotations, motion.rotations, 1e-6)


@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("bandai/punch_normal_002.bvh", 0.65),
        pytest.param("cmu/02_07.amc", 1.0, marks=pytest.mark.sweep),
    ],
)
def test_real_clips_are_denoised_better_than_by_the_best_butterworth_filter(data_dir, name, most):
    """Noise of 0.06 rad an axis, and mean joint position errors: against the zero-phase filter
    whose cut-off was chosen knowing the truth. Both clips have fast joints and still ones."""
    clean = jm.load(data_dir / name, dtype=np.float64)
    rng = np.random.default_rng(8)
    noise = 0.06 * rng.standard_normal((*clean.rotations.shape[:2], 3))
    noisy = clean.with_transforms(
        rotations=quaternion.multiply(clean.rotations, quaternion.exp(noise))
    )
    truth = jm.forward_kinematics(clean).positions

    def error(motion):
        found = jm.forward_kinematics(motion).positions
        return float(jnp.mean(jnp.linalg.norm(found - truth, axis=-1)))

    def filtered(cutoff):
        b, a = butter(2, 2 * cutoff * float(clean.frame_time))
        q = filtfilt(b, a, np.asarray(quaternion.align_signs(noisy.rotations)), axis=0)
        p = filtfilt(b, a, np.asarray(clean.translations), axis=0)
        return clean.with_transforms(p, quaternion.normalize(q))

    best = min(error(filtered(cutoff)) for cutoff in np.geomspace(0.5, 14.0, 20))
    assert error(jm.denoise(noisy)) < most * best


def test_exaggeration_enlarges_and_attenuation_shrinks_the_swing():
    motion = swinging(joints=1, noise=0.0)

    def swing(alpha):
        edited = jm.stylize(motion, alpha)
        return float(jnp.max(quaternion.distance(edited.rotations, edited.rotations.mean(0))))

    assert swing(0.5) < swing(1.0) < swing(1.5)


def test_joint_weights_by_pattern():
    skeleton = jm.Skeleton(("Hips", "LeftArm", "RightArm"), (-1, 0, 0), np.zeros((3, 3)))
    weights = jm.joint_weights(skeleton, {"*arm*": 2.0, "Left*": 3.0}, default=0.5)
    np.testing.assert_array_equal(weights, [0.5, 3.0, 2.0])
    assert weights.dtype == np.float64
    with pytest.raises(ValueError, match=r"no joint matches 'Leg\*'; the joints are Hips"):
        jm.joint_weights(skeleton, {"Leg*": 1.0})


def test_derivatives_with_respect_to_gains_and_parameters(layers):
    check_gradients(
        lambda alpha, residual: jm.synthesize(layers, alpha, residual).rotations,
        np.array([0.5, 1.0, 2.0]),
        np.array(0.3),
    )
    motion = swinging(frames=12)

    def positions(lam):
        return jm.forward_kinematics(jm.denoise(motion, lam=lam)).positions

    check_gradients(positions, np.array(1.3), rtol=1e-5)


def test_wrong_shapes_are_named_and_dtype_is_kept(layers):
    with pytest.raises(ValueError, match=r"alpha has shape \(2,\)"):
        jm.synthesize(layers, np.ones(2))
    with pytest.raises(ValueError, match=r"strength has shape \(2,\)"):
        jm.denoise(swinging(frames=12), strength=np.ones(2))
    with no_shape_checks(), pytest.raises(ValueError, match="denoise: method='rotvec'"):
        jm.denoise(swinging(frames=12), method="rotvec")
    with pytest.raises(ValueError, match="displacement has shape"):
        plus(layers.base, Displacement(jnp.zeros((1, 3, 3)), jnp.zeros((1, 3, 3))))
    single = jax.tree.map(lambda x: x.astype(np.float32), swinging())
    assert jm.denoise(single, strength=0.7).rotations.dtype == np.float32


def test_errors_name_the_edit_that_was_called():
    walk = jm.samples.walk(9, fps=30.0).motion
    few = jm.contacts.detect(walk[:4])
    layers = jm.decompose(walk)
    for name, run in {
        "stylize: alpha has": lambda: jm.stylize(walk, np.ones(2)),
        "stylize: residual has": lambda: jm.stylize(walk, 1.0, residual=np.ones(2)),
        "stylize: gamma must": lambda: jm.stylize(walk, 1.0, gamma=4.0),
        "stylize: length must": lambda: jm.stylize(walk, 1.0, length=10),
        "stylize: contacts have 4": lambda: jm.stylize(walk, 1.0, keep_contacts=few),
        "synthesize: contacts have 4": lambda: jm.synthesize(layers, keep_contacts=few),
        "synthesize: residual has": lambda: jm.synthesize(layers, 1.0, np.ones(2)),
        "denoise: weights have": lambda: jm.denoise(walk, weights=np.ones(2)),
        "denoise: strength has": lambda: jm.denoise(walk, strength=np.ones(2)),
        "decompose: weights have": lambda: jm.decompose(walk, weights=np.ones(2)),
    }.items():
        with no_shape_checks(), pytest.raises(ValueError, match=f"^{name}"):
            run()
