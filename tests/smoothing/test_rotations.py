"""Smoothing of rotations and motions, against dense numpy solves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import Motion, quaternion
from jaxmotion.smoothing import geodesic, lgs, smooth_motion, smooth_quaternions
from tests.helpers import (
    assert_jit_and_vmap_agree,
    assert_same_rotation,
    check_gradients,
    no_shape_checks,
    random_motion,
    random_quaternions,
    scipy_rotation,
)


def dense_smooth(y, product, weights=None, index=None, frames=None, stiffness=None):
    """Minimiser of Σ w‖Ax − y‖² + λ²σ²‖Lx‖², L of rows (−½, 1, −½) times the stiffness of the
    middle frame, by a dense solve."""
    y = np.asarray(y, np.float64)
    frames = len(y) if frames is None else frames
    index = np.arange(len(y)) if index is None else np.asarray(index)
    design = np.maximum(0, 1 - np.abs(index[:, None] - np.arange(frames)))
    prior = np.zeros((max(frames - 2, 0), frames))
    for j in range(frames - 2):
        prior[j, j : j + 3] = [-0.5, 1, -0.5]
    if stiffness is not None:
        prior *= stiffness[1:-1, None]
    w = np.ones(len(y)) if weights is None else np.asarray(weights)
    system = product**2 * prior.T @ prior + design.T @ (w[:, None] * design)
    flat = y.reshape(len(y), -1)
    return np.linalg.solve(system, design.T @ (w[:, None] * flat)).reshape(frames, *y.shape[1:])


def wandering(rng, frames, joints=3, step=0.3):
    """A random walk of rotations whose signs flip at random."""
    q = [random_quaternions(rng, (joints,))]
    for _ in range(frames - 1):
        q.append(quaternion.multiply(q[-1], random_quaternions(rng, (joints,), angle=step)))
    q = np.stack([np.asarray(x) for x in q])
    return q * rng.choice([-1.0, 1.0], (frames, joints, 1)), q


def unit(x):
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def test_chordal_is_the_dense_solve_of_aligned_components_renormalised(dtype):
    flipped, continuous = wandering(np.random.default_rng(0), 40)
    want = unit(dense_smooth(continuous, 2.0 * 1.5))
    got = smooth_quaternions(jnp.asarray(flipped, dtype), 2.0, 1.5)
    assert got.dtype == dtype
    assert_same_rotation(got, want, atol=1e-12 if dtype == np.float64 else 2e-6)


def test_per_joint_parameters_equal_joint_by_joint():
    flipped, _ = wandering(np.random.default_rng(1), 30)
    lam, sigma = np.array([0.5, 3.0, 40.0]), np.array([1.0, 2.0, 0.5])
    together = smooth_quaternions(flipped, lam, sigma)
    for j in range(3):
        alone = smooth_quaternions(flipped[:, j], lam[j], sigma[j])
        assert_same_rotation(together[:, j], alone)


def test_rotation_vectors_break_where_they_wrap_and_quaternions_do_not():
    # Turning steadily about one axis, through π: Fig. 6.
    angle = np.linspace(0.6 * np.pi, 1.4 * np.pi, 60)
    q = quaternion.exp(jnp.asarray(angle[:, None] * np.array([0.0, 0.6, 0.8])))
    chordal = smooth_quaternions(q, 3.0, 1.0)
    rotvec = smooth_quaternions(q, 3.0, 1.0, method="rotvec")
    assert float(jnp.max(quaternion.distance(chordal, q))) < 0.02
    assert float(jnp.max(quaternion.distance(rotvec, q))) > 1.0
    vectors = scipy_rotation(q).as_rotvec()
    assert_same_rotation(rotvec, quaternion.exp(dense_smooth(vectors, 3.0)))


def test_missing_frames_do_not_matter_even_where_they_hold_nan_or_flip_signs():
    rng = np.random.default_rng(2)
    _, q = wandering(rng, 25)
    weights = np.ones((25, 3))
    weights[3:9, 0] = weights[0:2, 1] = weights[20:, 2] = 0
    want = unit(np.stack([dense_smooth(q[:, j], 4.0, weights[:, j]) for j in range(3)], axis=1))
    broken = np.where(weights[..., None] > 0, q, np.nan)
    assert_same_rotation(smooth_quaternions(broken, 4.0, 1.0, weights=weights), want)
    flipped = np.where(weights[..., None] > 0, q, -q)
    assert_same_rotation(smooth_quaternions(flipped, 4.0, 1.0, weights=weights), want)


def test_shared_weights_are_the_same_as_repeated_ones():
    _, q = wandering(np.random.default_rng(3), 12)
    w = np.random.default_rng(3).uniform(0.2, 2, 12)
    a = smooth_quaternions(q, 4.0, 1.0, weights=w)
    b = smooth_quaternions(q, 4.0, 1.0, weights=np.repeat(w[:, None], 3, 1))
    assert_same_rotation(a, b)


def test_keys_in_any_order_upsample_alike():
    _, q = wandering(np.random.default_rng(4), 6, step=0.8)
    index = np.array([0.0, 4.0, 9.5, 12.0, 17.25, 20.0])
    shuffle = np.array([3, 0, 5, 1, 4, 2])
    want = unit(dense_smooth(q, 0.1, index=index, frames=21))
    got = smooth_quaternions(-q[shuffle], 0.1, 1.0, index=index[shuffle], num_frames=21)
    assert_same_rotation(got, want)


def test_signs_input_trusts_the_caller():
    angle = np.deg2rad([0.0, 60.0, 260.0])  # the last step turns by 200°, the long way
    q = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0 * angle, 0 * angle], -1)
    options = {"index": [0, 10, 20], "num_frames": 21}
    kept = smooth_quaternions(q, 0.1, 0.1, signs="input", **options)
    nearest = smooth_quaternions(q, 0.1, 0.1, **options)

    def turned(x):
        half = np.unwrap(np.arctan2(x[:, 1], x[:, 0]))
        return np.rad2deg(2 * (half[-1] - half[10]))

    assert turned(np.asarray(kept)) == pytest.approx(200, abs=1)
    assert turned(np.asarray(nearest)) == pytest.approx(-160, abs=1)


@pytest.mark.parametrize(("signs", "turn"), [("min_energy", 200), ("nearest", -160)])
def test_a_turn_of_200_degrees_between_keys(signs, turn):
    """Eom et al., Fig. 8; keys out of order and with signs at random."""
    angles = np.radians(np.cumsum([0, 60, 60, 200, 60, 60]))
    keys = quaternion.exp(angles[:, None] * np.array([0.0, 1, 0]))
    keys = keys * np.array([1.0, -1, -1, 1, -1, 1])[:, None]
    index, mixed = 7 * np.arange(6), np.array([3, 0, 5, 1, 4, 2])
    got = smooth_quaternions(keys[mixed], 0.1, 0.1, index=index[mixed], num_frames=36, signs=signs)
    passed = scipy_rotation(got).as_rotvec()[:, 1]
    passed = np.degrees(np.unwrap(passed))
    assert passed[21] - passed[14] == pytest.approx(turn, abs=0.5)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_shortest_clips(frames):
    _, q = wandering(np.random.default_rng(5), frames)
    got = smooth_quaternions(q, 2.0, 1.0)
    want = unit(dense_smooth(q, 2.0)) if frames == 3 else q
    assert_same_rotation(got, want, atol=1e-11)


def test_derivatives_in_both_modes():
    _, q = wandering(np.random.default_rng(6), 12)

    def f(q, lam, sigma):
        return smooth_quaternions(quaternion.normalize(q), lam, sigma)

    check_gradients(f, q, np.array([1.0, 2.0, 3.0]), np.array(0.7))
    assert_jit_and_vmap_agree(lambda q: smooth_quaternions(q, 2.0, 1.0), q, rtol=1e-10, atol=1e-12)


def test_zero_motion_stays_and_has_finite_derivatives():
    q = jnp.broadcast_to(quaternion.exp(jnp.array([np.pi, 0.0, 0.0])), (9, 2, 4))
    assert_same_rotation(smooth_quaternions(q, 5.0, 1.0), q)
    gradient = jax.grad(lambda q: jnp.sum(quaternion.log(smooth_quaternions(q, 5.0, 1.0)) ** 2))(q)
    assert np.all(np.isfinite(gradient))


def test_motion_smooths_rotations_and_moving_translations_only(dtype):
    rng = np.random.default_rng(7)
    motion = random_motion(rng, 20, 4, dtype, translated=False)
    smooth = smooth_motion(motion, 3.0, 1.0)
    assert smooth.translations.dtype == smooth.rotations.dtype == dtype
    tolerance = 1e-12 if dtype == np.float64 else 2e-6
    assert_same_rotation(
        smooth.rotations, smooth_quaternions(motion.rotations, 3.0, 1.0), atol=tolerance
    )
    want = dense_smooth(motion.root_positions, 3.0)
    np.testing.assert_allclose(smooth.root_positions, want, atol=10 * tolerance)
    np.testing.assert_array_equal(smooth.translations[:, 1:], motion.translations[:, 1:])


def test_motion_takes_parameters_and_weights_per_joint_and_can_be_resampled():
    motion = random_motion(np.random.default_rng(8), 10, 4)
    lam = np.array([1.0, 2.0, 3.0, 4.0])
    weights = np.random.default_rng(8).uniform(0.5, 2, (10, 4))
    smooth = smooth_motion(motion, lam, 0.5, weights=weights)
    for j in range(4):
        want = dense_smooth(motion.translations[:, j], 0.5 * lam[j], weights[:, j])
        np.testing.assert_allclose(smooth.translations[:, j], want, atol=1e-12)
    apart = smooth_motion(motion, lam, 0.5, translation_lam=2 * lam, weights=weights)
    np.testing.assert_array_equal(apart.rotations, smooth.rotations)
    want = dense_smooth(motion.translations[:, 1], lam[1], weights[:, 1])
    np.testing.assert_allclose(apart.translations[:, 1], want, atol=1e-12)
    exact = smooth_motion(motion, 3.0, 0.5, translation_sigma=1.5, method="geodesic")
    want = dense_smooth(motion.translations[:, 1], 4.5)
    np.testing.assert_allclose(exact.translations[:, 1], want, atol=1e-12)
    longer = smooth_motion(motion, 0.01, 1.0, index=np.linspace(0, 18, 10), num_frames=19)
    assert longer.num_frames == 19
    assert_same_rotation(longer.rotations[::2], motion.rotations, atol=1e-3)


def test_wrong_arguments_are_named():
    motion = random_motion(np.random.default_rng(9), 5, 4)
    with pytest.raises(ValueError, match="lam has shape"):
        smooth_motion(motion, np.ones(3), 1.0)
    with pytest.raises(ValueError, match="translation_sigma has shape"):
        smooth_motion(motion, 1.0, 1.0, translation_sigma=np.ones(3))
    with no_shape_checks(), pytest.raises(ValueError, match="method"):
        smooth_quaternions(motion.rotations, 1.0, 1.0, method="euler")
    with no_shape_checks(), pytest.raises(ValueError, match="signs"):
        smooth_quaternions(motion.rotations, 1.0, 1.0, signs="any")
    with pytest.raises(ValueError, match="give an index"):
        smooth_motion(motion, 1.0, 1.0, signs="min_energy", weights=np.ones(motion.num_frames))
    with no_shape_checks(), pytest.raises(ValueError, match=r"\(T, \.\.\., 4\)"):
        smooth_quaternions(motion.translations, 1.0, 1.0)


def test_a_motion_is_its_rotations_and_its_translations_smoothed_apart():
    rng = np.random.default_rng(11)
    motion = random_motion(rng, 12, 3)
    motion = motion.with_transforms(rotations=jnp.asarray(wandering(rng, 12)[1]))
    lam, w = np.array([2.0, 5.0, 9.0]), rng.uniform(0.5, 2, (12, 3))
    for weights in (None, w[:, 0], w):
        got = smooth_motion(motion, lam, 1.0, weights=weights)
        for j in range(3):
            of_joint = weights if weights is None or weights.ndim == 1 else weights[:, j]
            q = np.asarray(quaternion.align_signs(motion.rotations))[:, j]
            assert_same_rotation(got.rotations[:, j], unit(dense_smooth(q, lam[j], of_joint)))
            want = dense_smooth(np.asarray(motion.translations)[:, j], lam[j], of_joint)
            np.testing.assert_allclose(got.translations[:, j], want, atol=1e-10)


def test_stiffness_by_frame_reaches_rotations_and_translations():
    rng = np.random.default_rng(13)
    motion = random_motion(rng, 12, 3)
    motion = motion.with_transforms(rotations=jnp.asarray(wandering(rng, 12)[1]))
    firm = rng.uniform(0.3, 3, (12, 3))
    got = smooth_motion(motion, 4.0, 1.0, stiffness=firm)
    q = quaternion.align_signs(motion.rotations)
    for j in range(3):
        want = lgs(q[:, j], 4.0, 1.0, stiffness=firm[:, j]).mean
        assert_same_rotation(got.rotations[:, j], unit(want))
        want = lgs(motion.translations[:, j], 4.0, 1.0, stiffness=firm[:, j]).mean
        np.testing.assert_allclose(got.translations[:, j], want, atol=1e-10)
    alone = smooth_quaternions(motion.rotations, 4.0, 1.0, stiffness=firm)
    assert_same_rotation(alone, got.rotations)
    for given in ({"stiffness": firm}, {"translation_stiffness": firm}):
        with pytest.raises(ValueError, match="stiffness= takes no window="):
            smooth_motion(motion, 4.0, 1.0, window=8, **given)


def test_translations_may_have_a_stiffness_of_their_own(dtype):
    rng = np.random.default_rng(14)
    plain, q = random_motion(rng, 12, 4, dtype), wandering(rng, 12, 4)[1]
    motion = Motion(
        plain.skeleton,
        plain.translations,
        q.astype(dtype),
        plain.frame_time,
        translated_joints=(1, 3),
    )
    (of_joints, other), ones = rng.uniform(0.3, 3, (2, 12, 4)), np.ones(12)
    shared = of_joints[:, 0] / 2
    tolerance = 1e-11 if dtype == np.float64 else 5e-6
    for turning, moving in ((of_joints, other), (None, shared), (shared, other), (of_joints, ones)):
        given = {"stiffness": turning, "translation_stiffness": moving}
        got = smooth_motion(motion, 4.0, 1.0, **given)
        assert got.translations.dtype == got.rotations.dtype == dtype
        turning = ones if turning is None else turning
        for j in range(4):
            turned, moved = (x if x.ndim == 1 else x[:, j] for x in (turning, moving))
            want = unit(dense_smooth(q[:, j], 4.0, stiffness=turned))
            assert_same_rotation(got.rotations[:, j], want, atol=tolerance)
            if j in motion.translated_joints:
                want = dense_smooth(motion.translations[:, j], 4.0, stiffness=moved)
                np.testing.assert_allclose(got.translations[:, j], want, atol=tolerance)
    for name in ("stiffness", "translation_stiffness"):
        for wrong in (of_joints[:, :3], of_joints[:5]):
            with pytest.raises(ValueError, match=f"smooth_motion: {name} has shape"):
                smooth_motion(motion, 4.0, 1.0, **{name: wrong})
        with pytest.raises(ValueError, match=f"smooth_motion: {name} must be positive"):
            smooth_motion(motion, 4.0, 1.0, **{name: -ones})
    with pytest.raises(ValueError, match="stiffness has shape"):
        smooth_quaternions(motion.rotations, 4.0, 1.0, stiffness=of_joints[:, :3])


def test_the_geodesic_method_is_geodesic():
    rng = np.random.default_rng(12)
    _, q = wandering(rng, 15)
    lam, w = np.array([2.0, 5.0, 9.0]), rng.uniform(0.5, 2, (15, 3))
    by_frame = {"weights": w, "stiffness": rng.uniform(0.3, 3, (15, 3))}
    got = smooth_quaternions(q, lam, 1.0, **by_frame, method="geodesic")
    np.testing.assert_array_equal(got, geodesic(q, lam, 1.0, **by_frame).mean)
    motion = random_motion(rng, 15, 3).with_transforms(rotations=jnp.asarray(q))
    by_frame["translation_stiffness"] = rng.uniform(0.3, 3, 15)
    whole = smooth_motion(motion, lam, 1.0, **by_frame, method="geodesic")
    np.testing.assert_allclose(whole.rotations, got, atol=1e-12)
    linear = smooth_motion(motion, lam, 1.0, **by_frame)
    np.testing.assert_allclose(whole.translations, linear.translations, atol=1e-12)
    with pytest.raises(ValueError, match="takes no window"):
        smooth_quaternions(q, 2.0, 1.0, method="geodesic", window=8)
