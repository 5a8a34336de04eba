"""The stiffness of heavy tails and its derivatives, against dense linear algebra.

The oracle's posterior is a dense inverse, its search the plain fixed point, and what the answer is
the top of has its evidence from dense determinants.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.smoothing import lgs, student_stiffness, tune
from jaxmotion.smoothing.components import to_components
from tests.helpers import no_shape_checks

FRAMES, JOINTS, CHANNELS = 40, 2, 2
LAM, SIGMA, DOF = np.array([25.0, 40.0]), np.array([0.05, 0.06]), np.array([2.0, 6.0])

stiffness_of = jax.jit(student_stiffness, static_argnames=("num_frames", "scale"))


def signal(seed=0, frames=FRAMES):
    """One joint at rest but for a flick of two frames, one on a curve; noise on both."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames)
    flick = np.where((t >= 20) & (t < 22), 1.5, 0.0)
    clean = np.stack([flick, np.sin(t / 5.0)], 1)[:, :, None] * np.array([1.0, -0.5])
    return clean + 0.05 * rng.standard_normal(clean.shape)


def dense(y, w, lam, sigma, weights, unit):
    """Precision of the frames, and their second differences."""
    bends = np.diff(np.eye(len(y)), n=2, axis=0)
    prior = bends.T @ (unit * lam**2 * np.exp(w)[:, None] * bends)
    return prior + np.diag(weights) / sigma**2, bends


def expected(y, w, lam, sigma, weights, unit):
    """z of every second difference of one joint f[T, C]."""
    precision, bends = dense(y, w, lam, sigma, weights, unit)
    covariance = np.linalg.inv(precision)
    mean = covariance @ (weights[:, None] * y) / sigma**2
    loose = y.shape[1] * np.diag(bends @ covariance @ bends.T)
    return unit * lam**2 * (np.sum((bends @ mean) ** 2, 1) + loose)


def by_hand(y, lam, sigma, dof, weights, unit, w=None):
    """log u of one joint, by the plain fixed point; all second differences known."""
    if w is None:
        rough = np.diff(y, n=2, axis=0)
        square = np.sum(rough**2, 1)
        w = np.log((2 + y.shape[1]) / (2 + y.shape[1] * square / np.median(square)))
    for _ in range(3000):
        w = np.log((dof + y.shape[1]) / (dof + expected(y, w, lam, sigma, weights, unit)))
    return w


@pytest.mark.parametrize("scale", ["half", "unit"])
def test_is_where_the_plain_fixed_point_ends(scale):
    y, unit = signal(), {"half": 0.25, "unit": 1.0}[scale]
    weights = np.random.default_rng(1).uniform(0.5, 2, (FRAMES, JOINTS))
    got = stiffness_of(y, LAM, SIGMA, DOF, weights=weights, scale=scale)
    assert got.shape == (FRAMES, JOINTS)
    np.testing.assert_array_equal(np.asarray(got)[[0, -1]], 1.0)
    for j in range(JOINTS):
        w = by_hand(y[:, j], LAM[j], SIGMA[j], DOF[j], weights[:, j], unit)
        np.testing.assert_allclose(2 * np.log(got[1:-1, j]), w, atol=1e-6)
    assert np.asarray(got).max() <= np.sqrt(1 + CHANNELS / DOF.min())


def test_is_the_top_of_what_the_module_says():
    y = signal()[:, 0]
    lam, sigma, dof = LAM[0], SIGMA[0], DOF[0]
    w = 2 * np.log(np.asarray(stiffness_of(y[:, None], lam, sigma, dof))[1:-1, 0])

    def height(w):
        precision, _ = dense(y, w, lam, sigma, np.ones(FRAMES), 0.25)
        covariance = np.linalg.inv(precision)
        rest = y / sigma**2
        energy = np.sum(y * rest) - np.sum(rest * (covariance @ rest))
        determinant = np.linalg.slogdet(precision)[1]
        evidence = -0.5 * (energy + CHANNELS * (determinant - np.sum(w)))
        return evidence + dof / 2 * np.sum(w - np.exp(w))

    rng = np.random.default_rng(2)
    for _ in range(20):
        way = rng.standard_normal(len(w))
        up, down = height(w + 1e-4 * way), height(w - 1e-4 * way)
        assert abs(up - down) < 1e-7 * len(w)
        assert height(w + 0.05 * way) < height(w)


def measure(lam, sigma, dof, y, weights, **options):
    """A number that all frames of the smoother's mean go into."""
    firm = student_stiffness(y, lam, sigma, dof, weights=weights, **options)
    post = lgs(
        y, lam[:, None], sigma[:, None], stiffness=firm[:, :, None], weights=weights[:, :, None]
    )
    return jnp.sum(jnp.sin(jnp.arange(post.mean.size)).reshape(post.mean.shape) * post.mean)


def test_derivatives_are_exact():
    weights = np.random.default_rng(3).uniform(0.5, 2, (FRAMES, JOINTS))
    given = tuple(jnp.asarray(x) for x in (LAM, SIGMA, DOF, signal(), weights))
    value = jax.jit(measure)
    slopes = jax.jit(jax.grad(measure, argnums=range(5)))(*given)
    rng = np.random.default_rng(4)
    for k, (x, slope) in enumerate(zip(given, slopes, strict=True)):
        way = x * rng.standard_normal(x.shape)
        ends = [value(*given[:k], x + step * way, *given[k + 1 :]) for step in (1e-5, -1e-5)]
        along = jnp.sum(slope * way)
        np.testing.assert_allclose(along, (ends[0] - ends[1]) / 2e-5, rtol=2e-5, atol=1e-7)
    ways = tuple(x * rng.standard_normal(x.shape) for x in given)
    forward = jax.jit(lambda given, ways: jax.jvp(measure, given, ways)[1])(given, ways)
    both = sum(jnp.sum(slope * way) for slope, way in zip(slopes, ways, strict=True))
    np.testing.assert_allclose(forward, both, rtol=1e-6)


def test_derivatives_are_not_those_of_a_stiffness_held_still():
    """What this is for: through the tails a move is worth more than through a constant."""
    y = jnp.asarray(signal())
    given = jnp.asarray(LAM), jnp.asarray(SIGMA), jnp.asarray(DOF), y
    firm = stiffness_of(y, LAM, SIGMA, DOF)

    def held(y):
        return jnp.sum(lgs(y, LAM[:, None], SIGMA[:, None], stiffness=firm[:, :, None]).mean[21, 0])

    def free(y):
        firm = student_stiffness(y, *given[:3])
        return jnp.sum(lgs(y, LAM[:, None], SIGMA[:, None], stiffness=firm[:, :, None]).mean[21, 0])

    still, moving = jax.grad(held)(y), jax.jit(jax.grad(free))(y)
    assert jnp.max(jnp.abs(still - moving)) > 0.01


def test_derivatives_across_a_gap():
    """Frames that no data tell of have no say and no derivative."""
    weights = np.where((np.arange(FRAMES) > 8) & (np.arange(FRAMES) < 14), 0.0, 1.0)
    weights = jnp.asarray(np.stack([weights, np.ones(FRAMES)], 1))
    given = jnp.asarray(SIGMA), jnp.asarray(DOF), jnp.asarray(signal()), weights
    value, slope = jax.jit(measure), jax.jit(jax.grad(measure))(jnp.asarray(LAM), *given)
    for j in range(JOINTS):
        step = 1e-2 * np.eye(JOINTS)[j]
        ends = value(LAM + step, *given), value(LAM - step, *given)
        np.testing.assert_allclose(slope[j], (ends[0] - ends[1]) / 2e-2, rtol=1e-4)


def test_sudden_moves_stay():
    y = signal()
    firm = stiffness_of(y, LAM, SIGMA, DOF)
    assert np.asarray(firm)[19:23, 0].max() < 0.2
    heavy = lgs(y, LAM[:, None], SIGMA[:, None], stiffness=firm[:, :, None]).mean
    plain = lgs(y, LAM[:, None], SIGMA[:, None]).mean
    assert abs(heavy[20, 0, 0] - 1.5) < 0.15
    assert abs(plain[20, 0, 0] - 1.5) > 0.3
    # Many degrees of freedom are the Gaussian.
    np.testing.assert_allclose(stiffness_of(y, LAM, SIGMA, 1e7), 1, atol=1e-3)


def test_gaps_padding_and_keys():
    y = signal()
    found = stiffness_of(y, LAM, SIGMA, DOF)
    padded = np.concatenate([y, np.full((9, JOINTS, CHANNELS), np.nan)])
    counts = (np.arange(FRAMES + 9) < FRAMES).astype(float)
    other = stiffness_of(padded, LAM, SIGMA, DOF, weights=counts)
    np.testing.assert_allclose(other[: FRAMES - 1], found[:-1], rtol=1e-6)
    np.testing.assert_array_equal(np.asarray(other)[FRAMES - 1 :], 1)
    hole = np.where((np.arange(FRAMES) > 8) & (np.arange(FRAMES) < 14), 0.0, 1.0)
    gappy = stiffness_of(y, LAM, SIGMA, DOF, weights=hole)
    np.testing.assert_array_equal(np.asarray(gappy)[9:14], 1)
    index, frames = 2 * np.arange(FRAMES), 2 * FRAMES - 1
    keys = stiffness_of(y, LAM, SIGMA, DOF, index=index, num_frames=frames)
    mixed = np.random.default_rng(5).permutation(FRAMES)
    again = stiffness_of(y[mixed], LAM, SIGMA, DOF, index=index[mixed], num_frames=frames)
    assert keys.shape == (frames, JOINTS)
    np.testing.assert_allclose(again, keys, rtol=1e-6)
    for j, w in enumerate(2 * np.log(np.asarray(keys)[2:-2:2].T)):
        padded = np.zeros((frames, CHANNELS))
        padded[::2] = y[:, j]
        weights = (np.arange(frames) % 2 == 0).astype(float)
        z = expected(padded, 2 * np.log(np.asarray(keys)[1:-1, j]), LAM[j], SIGMA[j], weights, 0.25)
        np.testing.assert_allclose(w, np.log((DOF[j] + 2) / (DOF[j] + z[1::2])), atol=1e-6)


def test_batches_and_float32():
    batch = np.stack([signal(seed) for seed in range(3)])
    many = jax.jit(jax.vmap(lambda y: student_stiffness(y, LAM, SIGMA, DOF)))(batch)
    for got, y in zip(many, batch, strict=True):
        np.testing.assert_allclose(got, stiffness_of(y, LAM, SIGMA, DOF), rtol=1e-6)
    low = stiffness_of(
        batch[0].astype(np.float32), *(x.astype(np.float32) for x in (LAM, SIGMA, DOF))
    )
    assert low.dtype == np.float32
    np.testing.assert_allclose(low, many[0], rtol=2e-3)


def test_one_channel_and_short_signals():
    y = signal()[:, 0, 0]
    got = student_stiffness(y, 25.0, 0.05, 2.0)
    assert got.shape == (FRAMES,)
    w = by_hand(y[:, None], 25.0, 0.05, 2.0, np.ones(FRAMES), 0.25)
    np.testing.assert_allclose(2 * np.log(got[1:-1]), w, atol=1e-6)
    np.testing.assert_array_equal(student_stiffness(y[:2], 25.0, 0.05, 2.0), 1)
    still = student_stiffness(np.zeros(9), 25.0, 0.05, 2.0)
    assert np.isfinite(still).all()


def test_starts_where_it_is_told_to():
    """A step that is as well sudden as smeared: two answers, each from its own side."""
    step = 0.3 * (np.arange(FRAMES) >= 20)[:, None, None] * np.ones((1, 1, 3))
    firm, soft = np.ones(FRAMES), np.where(abs(np.arange(FRAMES) - 19.5) < 2, 1e-3, 1.0)
    ends = []
    for start in (firm, soft):
        found = stiffness_of(step, 100.0, 0.05, 2.0, start=start)
        w = 2 * np.log(start[1:-1])
        w = by_hand(step[:, 0], 100.0, 0.05, 2.0, np.ones(FRAMES), 0.25, w=w)
        np.testing.assert_allclose(2 * np.log(found[1:-1, 0]), w, atol=1e-6)
        ends.append(found)
    assert np.abs(np.log(ends[0] / ends[1])).max() > 1


def test_what_tune_finds_is_near():
    y = signal()
    learned = tune(y, prior="student")
    found = stiffness_of(y, learned.lam, learned.sigma, learned.dof, start=learned.stiffness)
    # ``tune`` learns all at once and stops after a number of looks: near, not there.
    np.testing.assert_allclose(found, learned.stiffness, rtol=0.2)
    for j in range(JOINTS):
        start = 2 * np.log(np.asarray(learned.stiffness)[1:-1, j])
        given = (float(x[j]) for x in (learned.lam, learned.sigma, learned.dof))
        w = by_hand(y[:, j], *given, np.ones(FRAMES), 0.25, w=start)
        np.testing.assert_allclose(2 * np.log(found[1:-1, j]), w, atol=1e-6)


def test_a_motion_is_its_rotations():
    motion = jm.samples.load("walk", num_frames=24).motion
    motion = jm.samples.add_noise(motion, jax.random.key(0), rotation=0.03).motion
    learned = tune(motion, prior="student").rotations
    assert learned.dof is not None
    found = stiffness_of(motion, learned.lam, learned.sigma, learned.dof)
    assert found.shape == (24, 22)
    y = to_components(motion.rotations, None)
    share = np.sqrt(4 / 3)
    again = stiffness_of(y, learned.lam * share, learned.sigma / share, learned.dof)
    np.testing.assert_allclose(found, again, rtol=1e-9)
    smooth = jm.smoothing.smooth_motion(motion, learned.lam, learned.sigma, stiffness=found)
    assert np.isfinite(smooth.rotations).all()


def test_what_is_wrong_is_said():
    y = signal()
    for name, value in (("lam", -1.0), ("sigma", 0.0), ("dof", np.nan), ("dof", [1.0, -1.0])):
        given = {"lam": LAM, "sigma": SIGMA, "dof": DOF, name: value}
        with pytest.raises(ValueError, match=f"{name} must be positive"):
            student_stiffness(y, **given)
    with pytest.raises(ValueError, match="dof has shape"):
        student_stiffness(y, LAM, SIGMA, np.ones(3))
    with pytest.raises(ValueError, match="stiffness has shape"):
        student_stiffness(y, LAM, SIGMA, DOF, start=np.ones(3))
    with no_shape_checks(), pytest.raises(ValueError, match="scale"):
        student_stiffness(y, LAM, SIGMA, DOF, scale="full")
    for name in ("lam", "sigma", "dof"):
        given = {"lam": LAM, "sigma": SIGMA, "dof": DOF}

        def call(value, name=name, given=given):
            return student_stiffness(y, **given | {name: value})

        with pytest.raises(Exception, match=f"{name} must be positive"):
            jax.block_until_ready(jax.jit(call)(-1.0))


def test_a_search_that_does_not_end_is_said(monkeypatch):
    monkeypatch.setattr("jaxmotion.smoothing.student._CYCLES", 1)
    with pytest.raises(Exception, match="the search did not end"):
        jax.block_until_ready(student_stiffness(signal(frames=37), LAM, SIGMA, DOF))
