"""λ and σ learned from data: known noise, dense criteria, every grouping."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import jaxmotion as jm
from jaxmotion import quaternion
from jaxmotion.smoothing import MotionTuning, lgs, tune
from tests.helpers import no_shape_checks, random_motion


def from_the_prior(ratio, frames=600, channels=4, sigma=0.3, seed=0):
    """Draws of the order-2 prior at λσ = ratio (scale "half") and noisy data of them."""
    rng = np.random.default_rng(seed)
    bends = rng.standard_normal((frames, channels)) * 2 * sigma / ratio
    x = np.cumsum(np.cumsum(bends, 0), 0)
    return x, x + sigma * rng.standard_normal(x.shape)


def dense_parts(y, ratio, weights):
    """Roughness precision and hat matrix of one channel, by dense algebra."""
    n = len(y)
    second = np.zeros((n - 2, n))
    for j in range(n - 2):
        second[j, j : j + 3] = [-0.5, 1, -0.5]
    prior = ratio**2 * second.T @ second
    return prior, np.linalg.solve(prior + np.diag(weights), np.diag(weights))


def dense_criterion(name, y, log_ratio, weights):
    """The module's F, all channels of ``y`` [n, C] sharing one ratio, without its constants."""
    ratio = np.exp(log_ratio)
    prior, hat = dense_parts(y, ratio, weights)
    present = weights > 0
    n, channels = present.sum(), y.shape[1]
    if name == "evidence":
        x = hat @ y
        energy = np.sum(weights[:, None] * (y - x) ** 2) + np.sum(x * (prior @ x))
        log_det = np.linalg.slogdet(prior + np.diag(weights))[1]
        rest = log_det - (len(y) - 2) * 2 * log_ratio
        return (n - 2) * channels * np.log(energy) + channels * rest
    if name == "gcv":
        rss = np.sum(weights[:, None] * (y - hat @ y) ** 2)
        return np.log(rss) - 2 * np.log(1 - np.trace(hat) / n)
    total = 0.0
    for k in range(5):
        kept = np.where(np.arange(len(y)) % 5 == k, 0, weights)
        _, hat = dense_parts(y, ratio, kept)
        out = np.arange(len(y)) % 5 == k
        total += np.sum((weights[:, None] * (y - hat @ y) ** 2)[out])
    return np.log(total)


@pytest.mark.parametrize("criterion", ["evidence", "gcv", "holdout"])
def test_the_choice_is_the_minimum_of_the_dense_criterion(criterion):
    _, y = from_the_prior(20.0, frames=50, channels=2)
    weights = np.random.default_rng(1).uniform(0.5, 2, 50)
    weights[7:11] = 0
    found = tune(y, criterion=criterion, per="clip", weights=weights)
    want = minimize_scalar(
        lambda s: dense_criterion(criterion, y, s, weights),
        bracket=(np.log(5.0), np.log(20.0), np.log(100.0)),
        options={"xtol": 1e-8},
    )
    assert np.log(float(found.lam * found.sigma)) == pytest.approx(want.x, abs=0.02)


@pytest.mark.parametrize("criterion", ["evidence", "gcv", "holdout"])
@pytest.mark.parametrize("ratio", [3.0, 100.0])
def test_known_noise_is_found_and_the_error_is_near_the_best(criterion, ratio):
    x, y = from_the_prior(ratio)
    found = tune(y, criterion=criterion, per="clip")

    def error(product):
        return float(jnp.sqrt(jnp.mean((lgs(y, product, 1.0).mean - x) ** 2)))

    assert float(found.sigma) == pytest.approx(0.3, rel=0.05)
    best = min(error(r) for r in np.geomspace(ratio / 6, ratio * 6, 25))
    assert error(float(found.lam * found.sigma)) <= 1.05 * best


def test_groupings_share_what_they_say():
    _, smooth = from_the_prior(100.0, frames=200, channels=3)
    _, rough = from_the_prior(2.0, frames=200, channels=3, seed=1)
    y = np.stack([smooth, rough], axis=1)
    joint = tune(y, per="joint")
    assert joint.lam.shape == (2,)
    for j in range(2):
        alone = tune(y[:, j], per="clip")
        np.testing.assert_allclose(joint.lam[j], alone.lam, rtol=1e-9)
        np.testing.assert_allclose(joint.sigma[j], alone.sigma, rtol=1e-9)
    assert float(joint.lam[0] * joint.sigma[0]) > 10 * float(joint.lam[1] * joint.sigma[1])
    channel = tune(y, per="channel")
    assert channel.lam.shape == (2, 3)
    np.testing.assert_allclose(channel.lam[1, 2], tune(y[:, 1, 2], per="clip").lam, rtol=1e-9)
    clip = tune(y, per="clip")
    assert clip.lam.shape == ()


def test_missing_data_do_not_matter(dtype):
    _, y = from_the_prior(20.0, frames=120)
    y = y.astype(dtype)
    weights = np.ones(y.shape, dtype)
    weights[30:40, 1] = weights[70:, 2] = 0
    broken = np.where(weights > 0, y, np.nan)
    a, b = tune(broken, per="channel", weights=weights), tune(y, per="channel", weights=weights)
    assert a.lam.dtype == dtype
    np.testing.assert_array_equal(a.lam, b.lam)
    short = tune(y[:70, 2:3], per="channel")
    np.testing.assert_allclose(a.sigma[2], short.sigma[0], rtol=1e-3)


def test_order_one_and_keys():
    rng = np.random.default_rng(2)
    x = np.cumsum(0.05 * rng.standard_normal((400, 3)), 0)
    y = x + 0.2 * rng.standard_normal(x.shape)
    found = tune(y, per="clip", order=1)
    assert float(found.sigma) == pytest.approx(0.2, rel=0.1)
    index = np.arange(200) * 2
    keys = tune(y[::2], per="clip", index=index, num_frames=400)
    assert np.isfinite(keys.lam)


def test_units_scale_out():
    _, y = from_the_prior(20.0, frames=100)
    one, other = tune(y, per="clip"), tune(1000 * y, per="clip")
    np.testing.assert_allclose(other.sigma, 1000 * one.sigma, rtol=1e-9)
    np.testing.assert_allclose(other.lam, one.lam / 1000, rtol=1e-9)


@pytest.mark.parametrize("y", [np.zeros((20, 3)), np.ones((2, 3)), np.zeros((1, 2)), np.eye(3)])
def test_nothing_to_learn_gives_usable_parameters(y):
    found = tune(y, per="clip")
    assert float(found.lam) > 0
    assert float(found.sigma) > 0
    assert np.all(np.isfinite(lgs(y, found.lam, found.sigma).mean))


def test_a_motion_gets_parameters_for_rotations_and_translations():
    motion = random_motion(np.random.default_rng(3), 40, 3, translated=False)
    found = tune(motion)
    assert isinstance(found, MotionTuning)
    assert found.rotations.lam.shape == found.translations.lam.shape == (3,)
    np.testing.assert_array_equal(found.translations.lam[1:], 1)
    clip = tune(motion, per="clip")
    assert isinstance(clip, MotionTuning)
    assert clip.translations.lam.shape == ()


@pytest.mark.parametrize("order", [1, 2])
def test_the_noise_of_a_motion_is_found_in_its_units(order):
    """Known noise on turning and moving joints: half its angle about each axis, and its length."""
    rng = np.random.default_rng(6)
    t = np.arange(600)[:, None, None] / 30
    path = np.sin(t * [1.0, 1.3, 0.7] + rng.uniform(0, 6, (3, 1)))
    if order == 1:
        path = path * 0 + 0.5  # smooth paths are nothing like its random walks
    skeleton = jm.Skeleton(("a", "b", "c"), (-1, 0, 1), np.zeros((3, 3)))
    turned = quaternion.multiply(
        quaternion.exp(path), quaternion.exp(0.04 * rng.standard_normal((600, 3, 3)))
    )
    moved = path[:, 0] + 0.02 * rng.standard_normal((600, 3))
    found = tune(jm.Motion.from_root(skeleton, moved, turned, 1 / 30), order=order)
    assert isinstance(found, MotionTuning)
    np.testing.assert_allclose(found.rotations.sigma, 0.02, rtol=0.05)
    np.testing.assert_allclose(found.translations.sigma[0], 0.02, rtol=0.05)
    raw = tune(quaternion.align_signs(turned), order=order)
    learned = found.rotations
    power = 1 if order == 2 else 2
    np.testing.assert_allclose(
        learned.lam * learned.sigma**power, raw.lam * raw.sigma**power, rtol=1e-10
    )


def test_no_gradient_passes_and_mistakes_are_named():
    _, y = from_the_prior(20.0, frames=30)
    slope = jax.grad(lambda y: jnp.sum(tune(y, per="clip").lam))(jnp.asarray(y))
    np.testing.assert_array_equal(slope, 0)
    with no_shape_checks(), pytest.raises(ValueError, match="criterion='aic'"):
        tune(y, criterion="aic")
    with no_shape_checks(), pytest.raises(ValueError, match="per='frame'"):
        tune(y, per="frame")
    with pytest.raises(ValueError, match="needs a signal"):
        tune(random_motion(np.random.default_rng(4), 9, 2), per="channel")


def test_a_loss_of_one_s_own_teaches_lam_by_joint_and_by_frame():
    """Two joints, noisy; one turns over in a moment. The error against the truth, by gradients
    through the smoother, asks for less λ there, and gets lower than any λ for all frames."""
    rng = np.random.default_rng(0)
    t = np.arange(60)
    truth = np.stack([np.sin(t / 10), np.tanh((t - 30) / 1.5)], axis=1)
    y = truth + 0.1 * rng.standard_normal(truth.shape)

    def error(log_lam, log_stiffness):
        mean = lgs(y, jnp.exp(log_lam), 1.0, stiffness=jnp.exp(log_stiffness)).mean
        return jnp.mean((mean - truth) ** 2)

    @jax.jit
    def descend(log_lam, log_stiffness, rate):
        def step(_, at):
            slopes = jax.grad(error, (0, 1))(*at)
            return jax.tree.map(lambda x, g: x - rate * g, at, slopes)

        return jax.lax.fori_loop(0, 300, step, (log_lam, log_stiffness))

    start = jnp.full(2, 2.0), jnp.zeros((60, 2))
    lam, firm = descend(*start, 200.0)
    alike = min(float(error(jnp.array([a, b]), start[1])) for a in range(6) for b in range(6))
    assert error(lam, firm) < 0.7 * alike
    assert jnp.min(firm[27:34, 1]) < jnp.min(firm[:20, 1]) - 0.5


@pytest.mark.parametrize("criterion", ["evidence", "holdout"])
def test_what_keeps_still_but_for_rounding_teaches_nothing(criterion, dtype):
    """No λ of 10¹⁹ from the last bits of a constant; what is beside it is learned from."""
    rng = np.random.default_rng(4)
    _, noisy = from_the_prior(20.0, frames=40, channels=3)
    constant = np.broadcast_to([1.3631, -1.7946, 93.523], (40, 3))
    bits = np.nextafter(constant.astype(dtype), np.where(rng.uniform(size=(40, 3)) < 0.5, 0, 100))
    y = np.stack([constant, noisy, bits, 0 * constant], axis=1).astype(dtype)
    found = tune(jnp.asarray(y), criterion=criterion)
    assert np.all(np.isfinite(found.score))
    for x in (found.lam, found.sigma):
        np.testing.assert_array_equal(x[np.array([0, 2, 3])], 1)
    assert 5 < found.lam[1] * found.sigma[1] < 80  # 20, from 40 frames
    assert 0.1 < found.sigma[1] < 1


def test_a_joint_that_is_said_to_move_and_does_not():
    motion = random_motion(np.random.default_rng(0), 12, 3, translated=False)
    parts = motion.translations, motion.rotations, motion.frame_time
    found = tune(jm.Motion(motion.skeleton, *parts))
    assert isinstance(found, MotionTuning)
    np.testing.assert_array_equal(found.translations.lam[1:], 1)
    np.testing.assert_array_equal(found.translations.sigma[1:], 1)
    assert found.translations.sigma[0] != 1
