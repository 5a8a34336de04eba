"""Heavy-tailed second differences: against dense linear algebra, and what they are for.

The oracle has the posterior from a dense inverse and ν from SciPy's root finder.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import digamma

import jaxmotion as jm
from jaxmotion.smoothing import heavy_tails, lgs, tune
from jaxmotion.smoothing.heavy_tails import _told_by_all
from jaxmotion.smoothing.tuning import tune_signal
from tests.helpers import no_shape_checks

FRAMES, GROUPS, CHANNELS = 48, 3, 2

learn = jax.jit(tune, static_argnames=("prior", "per", "scale", "num_frames"))
student = functools.partial(learn, prior="student")


def signals(seed=0, noise=0.05):
    """Three groups: at rest but for a flick of two frames; noise about a curve; at rest."""
    rng = np.random.default_rng(seed)
    t = np.arange(FRAMES)
    flick = np.where((t >= 20) & (t < 22), 3.0, 0.0)
    curve = np.sin(t / 5.0)
    still = np.full(FRAMES, 0.7)
    clean = np.stack([flick, curve, still], 1)[:, :, None] * np.array([1.0, -0.5])
    return clean, clean + noise * rng.standard_normal(clean.shape) * np.array([1, 1, 0])[:, None]


def dense_posterior(y, rho, stiffness, unit):
    """Mean, and variance of the bends for a σ of 1, of one group's channels."""
    bends = np.diff(np.eye(len(y)), n=2, axis=0)
    prior = bends.T @ (unit * (rho * stiffness[1:-1, None]) ** 2 * bends)
    covariance = np.linalg.inv(np.eye(len(y)) + prior)
    mean = covariance @ y
    return bends @ mean, np.diag(bends @ covariance @ bends.T)


@pytest.mark.parametrize("order", [1, 2])
def test_variance_of_bends(order):
    rng = np.random.default_rng(1)
    y = rng.standard_normal((9, 2, 1))
    weights = rng.uniform(0.2, 2, (9, 2, 1)) * (np.arange(9) != 4)[:, None, None]
    post = lgs(y, 1.3, 0.4, order=order, weights=weights)
    bends = np.diff(np.eye(9), n=2, axis=0)
    for g in range(2):
        if order == 2:
            prior = 0.25 * 1.3**2 * bends.T @ bends
        else:
            steps = np.diff(np.eye(9), axis=0)
            prior = 1.3 * steps.T @ np.diag([1, 2, 2, 2, 2, 2, 2, 1.0]) @ steps
        covariance = np.linalg.inv(prior + np.diag(weights[:, g, 0]) / 0.4**2)
        expected = np.diag(bends @ covariance @ bends.T)
        np.testing.assert_allclose(post.bend_variance[:, g, 0], expected, rtol=1e-9)


@pytest.mark.parametrize("scale", ["half", "unit"])
def test_what_is_learned_goes_to_a_fixed_point(scale, monkeypatch):
    monkeypatch.setattr(heavy_tails, "_STEPS", 80)
    y = signals()[1][:-1]  # a shape of its own: compiled with these steps
    found = jax.tree.map(np.asarray, student(y, scale=scale))
    unit = 0.25 if scale == "half" else 1.0
    for g in range(2):
        rho, variance = found.lam[g] * found.sigma[g], found.sigma[g] ** 2
        bends, loose = dense_posterior(y[:, g], rho, found.stiffness[:, g], unit)
        z = unit * rho**2 * (np.sum(bends**2, 1) / variance + CHANNELS * loose)
        shape, rate = (found.dof[g] + CHANNELS) / 2, (found.dof[g] + z) / 2
        np.testing.assert_allclose(found.stiffness[1:-1, g], np.sqrt(shape / rate), rtol=0.01)
        mean = np.mean(digamma(shape) - np.log(rate) - shape / rate)

        def slope(dof, mean=mean):
            return np.log(dof / 2) + 1 - digamma(dof / 2) + mean

        ends = [1.0, 100.0]
        dof = ends[int(slope(100.0) > 0)] if slope(1.0) * slope(100.0) > 0 else brentq(slope, *ends)
        np.testing.assert_allclose(found.dof[g], dof, rtol=0.02)


def test_evidence_is_least_where_it_ends():
    _, y = signals()
    found = student(y)

    def score(factor):
        post = lgs(
            y,
            (factor * found.lam)[:, None],
            found.sigma[:, None],
            stiffness=found.stiffness[:, :, None],
        )
        energy, rest = post.energy.sum(1), -2 * post.log_evidence.sum(1) - post.energy.sum(1)
        free = (FRAMES - 2) * CHANNELS
        return np.asarray(free * jnp.log(energy) + rest)[:2]

    at = score(1.0)
    assert (score(1.5) > at - 1e-3).all()
    assert (score(1 / 1.5) > at - 1e-3).all()


def test_a_flick_stays_and_noise_goes():
    clean, y = signals()
    error = {}
    for prior in ("gaussian", "student"):
        found = learn(y, prior=prior)
        stiffness = None if found.stiffness is None else found.stiffness[:, :, None]
        mean = lgs(y, found.lam[:, None], found.sigma[:, None], stiffness=stiffness).mean
        off = np.abs(np.asarray(mean) - clean)
        error[prior] = off[17:25, 0].mean(), off[:, 0].mean(), off[:, 1].mean()
    assert error["student"][0] < 0.7 * error["gaussian"][0]
    assert error["student"][1] < 0.5 * error["gaussian"][1]
    assert error["student"][2] < 1.1 * error["gaussian"][2]
    assert error["student"][1] < 0.5 * np.abs(y - clean)[:, 0].mean()


def test_a_clean_flick_is_left():
    clean, _ = signals()
    found = student(clean)
    stiffness = found.stiffness[:, :, None]
    mean = lgs(clean, found.lam[:, None], found.sigma[:, None], stiffness=stiffness).mean
    assert np.abs(np.asarray(mean) - clean)[:, 0].max() < 1e-3
    smeared = learn(clean, prior="gaussian")
    mean = lgs(clean, smeared.lam[:, None], smeared.sigma[:, None]).mean
    assert np.abs(np.asarray(mean) - clean)[:, 0].max() > 0.1  # what this is for


def test_still_groups_teach_nothing():
    found = student(signals()[1])
    np.testing.assert_array_equal(found.stiffness[:, 2], 1.0)
    assert found.lam[2] == 1
    assert found.sigma[2] == 1


def test_quantised_data():
    """Second differences that are most often none at all."""
    y = np.round(signals()[0] * np.array([1.0, 0.02, 1.0])[:, None], 1)
    found = student(y)
    for x in jax.tree.leaves(found):
        assert np.isfinite(x).all()
    assert (np.asarray(found.stiffness) > 0).all()
    low = student(y.astype(np.float32))
    assert np.isfinite(low.stiffness).all()


def test_gaussian_data_have_gaussian_tails():
    rng = np.random.default_rng(5)
    y = np.cumsum(np.cumsum(rng.standard_normal((200, 1, 3)), 0), 0)
    y += 4 * rng.standard_normal(y.shape)
    heavy, plain = student(y), learn(y, prior="gaussian")
    assert heavy.dof[0] > 20
    np.testing.assert_allclose(heavy.sigma, plain.sigma, rtol=0.1)
    np.testing.assert_allclose(heavy.lam, plain.lam, rtol=0.25)


def test_units_and_padding():
    _, y = signals()
    found = student(y)
    larger = student(1000 * y)
    np.testing.assert_allclose(larger.sigma[:2], 1000 * found.sigma[:2], rtol=1e-6)
    np.testing.assert_allclose(larger.stiffness, found.stiffness, rtol=1e-6)
    padded = np.concatenate([y, np.full((16, *y.shape[1:]), 9.0)])
    counts = np.arange(FRAMES + 16) < FRAMES
    other = student(padded, weights=counts.astype(float))
    for name in ("lam", "sigma", "dof"):
        np.testing.assert_allclose(getattr(other, name), getattr(found, name), rtol=1e-6)
    np.testing.assert_allclose(other.stiffness[: FRAMES - 1], found.stiffness[:-1], rtol=1e-6)


def test_gaps_and_keys_in_any_order():
    _, y = signals()
    index, frames = np.arange(2 * FRAMES - 1)[::2], 2 * FRAMES - 1
    found = student(y, index=index, num_frames=frames)
    assert found.stiffness.shape == (2 * FRAMES - 1, GROUPS)
    mixed = np.random.default_rng(3).permutation(FRAMES)
    other = student(y[mixed], index=index[mixed], num_frames=frames)
    np.testing.assert_allclose(other.stiffness, found.stiffness, rtol=1e-6)
    assert np.isfinite(found.stiffness).all()
    assert (np.asarray(found.stiffness) > 0).all()


def test_float32_and_vmap():
    batch = np.stack([signals(seed)[1] for seed in range(2)])
    found = jax.jit(jax.vmap(lambda y: tune(y, prior="student")))(batch)
    single = student(batch[1])
    np.testing.assert_allclose(found.stiffness[1], single.stiffness, rtol=1e-6)
    low = student(batch[1].astype(np.float32))
    assert low.stiffness.dtype == np.float32
    np.testing.assert_allclose(low.sigma[:2], single.sigma[:2], rtol=0.1)
    np.testing.assert_allclose(low.stiffness[:, :2], single.stiffness[:, :2], rtol=0.3)


def test_per_clip_and_channel():
    _, y = signals()
    assert student(y, per="clip").stiffness.shape == (FRAMES,)
    assert student(y, per="channel").stiffness.shape == (FRAMES, GROUPS, CHANNELS)


def test_no_gradient_and_too_short():
    _, y = signals()
    slope = jax.grad(lambda y: jnp.sum(tune(y, prior="student").stiffness))(y)
    np.testing.assert_array_equal(slope, 0)
    short = tune(y[:2], prior="student")
    assert np.isfinite(short.lam).all()
    assert (np.asarray(short.stiffness) == 1).all()


@pytest.mark.parametrize("wrong", [{"order": 1}, {"criterion": "gcv"}])
def test_only_by_evidence_for_order_two(wrong):
    with pytest.raises(ValueError, match="prior='student' is learned by criterion='evidence'"):
        tune(signals()[1], prior="student", **wrong)
    with no_shape_checks(), pytest.raises(ValueError, match="tune: prior"):
        tune(signals()[1], prior="cauchy")


def test_motions_have_both_kinds():
    motion = jm.samples.load("walk", num_frames=24).motion
    noisy = jm.samples.add_noise(motion, jax.random.key(0), rotation=0.03, translation=0.01).motion
    found = tune(noisy, prior="student")
    assert found.rotations.stiffness.shape == found.translations.stiffness.shape == (24, 22)
    moved = np.isin(np.arange(22), noisy.translated_joints)
    assert (np.asarray(found.translations.stiffness)[:, ~moved] == 1).all()
    assert (np.asarray(found.translations.stiffness)[1:-1, moved] != 1).all()


def one_capture(noise, frames=120, groups=7):
    """Curves with noise; the first group's bends are larger than what noise makes of them."""
    rng = np.random.default_rng(1)
    t = np.arange(frames)[:, None, None]
    y = np.sin(t / rng.uniform(6, 20, (1, groups, CHANNELS)))
    y = y + np.asarray(noise)[:, None] * rng.standard_normal(y.shape)
    bends = 0.3 * rng.standard_t(2, (frames, CHANNELS))
    y[:, 0] += np.cumsum(np.cumsum(bends, axis=0), axis=0)
    return y


def test_groups_tell_each_other_of_their_noise():
    shared = functools.partial(tune_signal, prior="student", share=True)
    y = one_capture(np.full(7, 0.05))
    alone, together = tune_signal(y, prior="student"), shared(y)
    assert alone.sigma[0] < 0.005  # what this is for
    np.testing.assert_allclose(together.sigma, 0.05, rtol=0.3)
    # One whose data tell of another noise keeps it, ...
    noise = np.full(7, 0.05)
    noise[3] = 0.4
    np.testing.assert_allclose(shared(one_capture(noise)).sigma[1:], noise[1:], rtol=0.3)
    # ... and where each has its own, they tell each other next to nothing.
    noise = 0.001 * 4.0 ** np.arange(7)
    y = one_capture(noise)
    alone, together = tune_signal(y, prior="student"), shared(y)
    np.testing.assert_allclose(together.sigma[2:], alone.sigma[2:], rtol=0.05)


def test_what_groups_are_told():
    rng = np.random.default_rng(4)
    variance, free = np.exp(rng.normal(-5, 0.3, 9)), np.full(9, 500.0)
    learnable = np.where(np.arange(9) == 2, 0.0, 1.0)
    count, told = _told_by_all(*map(jnp.asarray, (variance, learnable, free)))
    logs = np.log(np.delete(variance, 2))
    low, high = np.quantile(logs, [0.25, 0.75])
    np.testing.assert_allclose(count, 2 * (1.349 / (high - low)) ** 2)
    np.testing.assert_allclose(told, np.exp(np.median(logs)))
    # No more than a group's own data; and three groups are none to ask.
    assert (_told_by_all(jnp.full(9, 0.1), jnp.ones(9), jnp.asarray(free)).count == free).all()
    few = jnp.asarray(np.where(np.arange(9) < 3, 1.0, 0.0))
    assert (_told_by_all(jnp.asarray(variance), few, jnp.asarray(free)).count == 0).all()
