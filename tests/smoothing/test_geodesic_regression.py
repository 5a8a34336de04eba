"""Geodesic smoothing against dense SciPy minimisation, invariances, derivatives and bad input."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from jaxmotion import io, quaternion
from jaxmotion.smoothing import geodesic, lgs, smooth_quaternions

LAM, SIGMA = 2.0, 0.3


def clip(frames, joints=1, seed=0, step=0.4, noise=0.2):
    """Noisy random walks on rotations, (frames, joints, 4)."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(step * rng.standard_normal((frames, joints, 3)), axis=0)
    turn = noise * rng.standard_normal((frames, joints, 3))
    rotations = Rotation.from_rotvec(walk.reshape(-1, 3)) * Rotation.from_rotvec(
        turn.reshape(-1, 3)
    )
    return np.roll(rotations.as_quat(), 1, axis=-1).reshape(frames, joints, 4)


def to_scipy(q):
    return Rotation.from_quat(np.roll(np.asarray(q, np.float64).reshape(-1, 4), -1, axis=-1))


def largest_angle(a, b):
    return np.max((to_scipy(a).inv() * to_scipy(b)).magnitude())


def loss_root(norm, loss):
    """sqrt(rho(norm^2))."""
    if loss == "huber":
        return np.where(norm <= 1.345, norm, np.sqrt(np.maximum(2 * 1.345 * norm - 1.345**2, 0)))
    if loss == "cauchy":
        return np.sqrt(2.385**2 * np.log1p((norm / 2.385) ** 2))
    return norm


FIRM = np.random.default_rng(8).uniform(0.3, 3, (12, 2))


def dense_minimum(
    y, start, order, loss="l2", index=None, weights=None, stiffness=None, lam=LAM, sigma=SIGMA
):
    """Eq. 9 by SciPy, one joint: rotations and cost."""
    frames = len(start)
    index = np.arange(len(y)) if index is None else np.asarray(index)
    weights = np.ones(len(y)) if weights is None else np.asarray(weights)
    firm = np.ones(frames) if stiffness is None else np.asarray(stiffness)
    low = np.floor(index).astype(int)
    high, share = np.minimum(low + 1, frames - 1), (index - low)[:, None]
    data, base = to_scipy(y), to_scipy(start)

    def rotations(d):
        return base * Rotation.from_rotvec(d.reshape(frames, 3))

    def residuals(d):
        x = rotations(d)
        misfit = (1 - share) * (x[low].inv() * data).as_rotvec()
        misfit += share * (x[high].inv() * data).as_rotvec()
        norm = np.maximum(np.linalg.norm(misfit, axis=1), 1e-12)
        scaled = loss_root(norm * np.sqrt(weights) / sigma, loss) / norm
        velocity = (x[:-1].inv() * x[1:]).as_rotvec()
        if order == 2:
            prior = 0.5 * lam * firm[1:-1, None] * np.diff(velocity, axis=0)
        else:
            c = np.full(frames - 1, 2.0)
            c[0] = c[-1] = 1
            prior = np.sqrt(lam * c * firm[1:])[:, None] * velocity
        return np.concatenate([(scaled[:, None] * misfit).ravel(), prior.ravel()])

    found = least_squares(
        residuals, np.zeros(3 * frames), jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    # It stops where the cost no longer tells iterates apart, at half the digits: some full steps.
    v, nudges = found.x, 1e-5 * np.eye(3 * frames)
    for _ in range(30):
        rows = [(residuals(v + h) - residuals(v - h)) / 2e-5 for h in nudges]
        v = v - np.linalg.lstsq(np.stack(rows, axis=1), residuals(v))[0]
    return np.roll(rotations(v).as_quat(), 1, axis=-1), found.cost


@pytest.mark.parametrize(
    ("order", "loss", "options"),
    [
        (1, "huber", {}),
        (2, "cauchy", {"weights": np.array([1.0, 0.0, 2.0, 1.0, 1.0, 1.0, 0.5, 1.0])}),
        (1, "l2", {"index": np.array([0, 3, 4, 9]), "num_frames": 11}),
        pytest.param(
            *(2, "l2", {"index": np.array([0.0, 2.5, 4.25, 8.7]), "num_frames": 10}),
            marks=pytest.mark.sweep,  # the last has an index too
        ),
        (1, "l2", {"stiffness": FIRM[:8, 0]}),
        (
            2,
            "l2",
            {"index": np.array([0.0, 2.5, 4.3, 9.7]), "num_frames": 12, "stiffness": FIRM[:, 0]},
        ),
    ],
)
def test_agrees_with_dense_scipy_minimiser(order, loss, options):
    y = clip(len(options.get("index", range(8))))
    lam = 20.0 if loss == "huber" else LAM  # so that some data do count as outliers

    @eqx.filter_jit
    def solve(y):
        start = smooth_quaternions(y, lam, SIGMA, order=order, **options)
        return geodesic(y, lam, SIGMA, order=order, loss=loss, **options), start

    found, start = solve(jnp.asarray(y))
    oracle = {k: v for k, v in options.items() if k != "num_frames"}
    expected, cost = dense_minimum(y[:, 0], start[:, 0], order, loss, lam=lam, **oracle)
    assert largest_angle(found.mean, expected) < 1e-8
    np.testing.assert_allclose(found.cost, [cost], rtol=1e-12)
    assert found.converged
    assert found.gradient_norm < 1e-10
    assert largest_angle(start, expected) > 1e-3  # the chordal answer is another one


@pytest.fixture(scope="module")
def smooth():
    """One compiled smoother of (7, 2, 4) clips, parameters a joint: mean and covariance."""

    @eqx.filter_jit
    def function(q, lam, sigma):
        found = geodesic(q, lam, sigma)
        return found.mean, found.covariance

    return function


LAMS, SIGMAS = jnp.array([2.0, 30.0]), jnp.array([0.3, 0.1])


def test_turning_the_data_on_either_side_turns_the_answer(smooth):
    q = jnp.asarray(clip(7, 2))
    a, b = (jnp.asarray(clip(1, 1, seed=s)[0, 0]) for s in (5, 6))
    mean, covariance = smooth(q, LAMS, SIGMAS)
    turned = quaternion.multiply(quaternion.multiply(a, q), b)
    moved, moved_covariance = smooth(turned, LAMS, SIGMAS)
    expected = quaternion.multiply(quaternion.multiply(a, mean), b)
    assert jnp.max(quaternion.distance(moved, expected)) < 1e-9
    r = quaternion.to_matrix(b)
    np.testing.assert_allclose(moved_covariance, r.T @ covariance @ r, atol=1e-11)


def test_signs_and_time_reversal_do_not_matter(smooth):
    q = jnp.asarray(clip(7, 2))
    mean, covariance = smooth(q, LAMS, SIGMAS)
    flipped, _ = smooth(q.at[::2].multiply(-1), LAMS, SIGMAS)
    assert jnp.max(quaternion.distance(flipped, mean)) < 1e-10
    reversed_mean, reversed_covariance = smooth(q[::-1], LAMS, SIGMAS)
    assert jnp.max(quaternion.distance(reversed_mean[::-1], mean)) < 1e-10
    np.testing.assert_allclose(reversed_covariance[::-1], covariance, atol=1e-12)


def test_small_turns_are_the_linear_smoother(smooth):
    v = 1e-4 * np.random.default_rng(1).standard_normal((7, 2, 3))
    mean, covariance = smooth(quaternion.exp(jnp.asarray(v)), LAMS, SIGMAS)
    flat = lgs(jnp.asarray(v), LAMS[:, None], SIGMAS[:, None])
    np.testing.assert_allclose(quaternion.log(mean), flat.mean, atol=1e-11)
    expected = flat.variance[..., None] * jnp.eye(3)
    np.testing.assert_allclose(covariance, expected, rtol=1e-6, atol=1e-8)


def test_steady_spin_and_repeated_pose_come_back(smooth):
    axis = np.array([[0.3, -0.5, 0.2], [0.0, 0.0, 0.0]])
    spin = quaternion.exp(jnp.asarray(np.arange(7)[:, None, None] * axis))
    start = jnp.asarray(clip(1, 2)[0])
    q = quaternion.multiply(start, spin)
    mean, _ = smooth(q, LAMS, SIGMAS)
    assert jnp.max(quaternion.distance(mean, q)) < 1e-10


def test_stiffness_of_ones_of_one_number_and_of_every_frame_and_joint(smooth):
    """A batch of stiffnesses; float32; and one that is wrong."""
    q, firm = jnp.asarray(clip(7, 2)), jnp.asarray(FIRM[:7])
    batch = jax.jit(jax.vmap(lambda s: geodesic(q, LAMS, SIGMAS, stiffness=s).mean))
    ones = jnp.ones((7, 2))
    of_ones, of_threes, of_firm = batch(jnp.stack([ones, 3 * ones, firm]))
    assert jnp.max(quaternion.distance(of_ones, smooth(q, LAMS, SIGMAS)[0])) < 1e-10
    assert jnp.max(quaternion.distance(of_threes, smooth(q, 3 * LAMS, SIGMAS)[0])) < 1e-10
    for j in range(2):
        options = {"lam": LAMS[j], "sigma": SIGMAS[j], "stiffness": firm[:, j]}
        expected, _ = dense_minimum(q[:, j], of_firm[:, j], 2, **options)
        assert largest_angle(of_firm[:, j], expected) < 1e-8
    single = geodesic(q.astype(jnp.float32), 2.0, 0.3, stiffness=FIRM[:7, 0]).mean
    assert single.dtype == jnp.float32
    assert largest_angle(single[:, 0], of_firm[:, 0]) < 5e-6
    with pytest.raises(Exception, match="stiffness must be positive"):
        batch(jnp.stack([ones, firm.at[3, 1].set(-1), firm])).block_until_ready()


@pytest.mark.slow
def test_jit_vmap_and_joints_agree_and_inputs_stay(smooth):
    q = clip(7, 2)
    before = q.copy()
    mean, covariance = smooth(jnp.asarray(q), LAMS, SIGMAS)
    one = eqx.filter_jit(
        jax.vmap(lambda q, lam, sigma: geodesic(q, lam, sigma).mean, in_axes=(1, 0, 0))
    )
    alone = one(jnp.asarray(q), LAMS, SIGMAS)
    assert jnp.max(quaternion.distance(jnp.moveaxis(alone, 0, 1), mean)) < 1e-10
    eager = geodesic(q, np.asarray(LAMS), np.asarray(SIGMAS))
    assert jnp.max(quaternion.distance(eager.mean, mean)) < 1e-10
    np.testing.assert_allclose(eager.covariance, covariance, atol=1e-12)
    assert set(eager.statistics) == {"num_steps", "cost", "gradient_norm", "result"}
    np.testing.assert_array_equal(q, before)


def test_covariance_is_the_inverse_of_the_dense_gauss_newton_matrix(smooth):
    y = jnp.asarray(clip(7, 2))
    mean, covariance = smooth(y, LAMS, SIGMAS)
    x, y = mean[:, 1], y[:, 1]

    def residuals(turn):
        at = quaternion.multiply(x, quaternion.exp(turn.reshape(7, 3)))
        misfit = quaternion.log(quaternion.between(at, y)) / SIGMAS[1]
        velocity = quaternion.log(quaternion.between(at[:-1], at[1:]))
        prior = 0.5 * LAMS[1] * jnp.diff(velocity, axis=0)
        return jnp.concatenate([misfit.ravel(), prior.ravel()])

    j = np.asarray(jax.jit(jax.jacfwd(residuals))(jnp.zeros(21)))
    dense = np.linalg.inv(j.T @ j).reshape(7, 3, 7, 3)
    expected = np.stack([dense[t, :, t] for t in range(7)])
    np.testing.assert_allclose(covariance[:, 1], expected, atol=1e-12)


def test_float32_throughout_and_an_answer_or_a_flag_beyond_it(smooth):
    q = jnp.asarray(clip(7, 2))

    @eqx.filter_jit
    def single(q, lam, sigma):
        found = geodesic(q, lam, sigma, throw=False)
        return found.mean, found.covariance, found.converged

    # Up to lam sigma = 1000; beyond, rounding decides whether it converges, and to what.
    noise = np.random.default_rng(1).normal(scale=0.02, size=(4, 7, 2, 3))
    stiffest = 1000 / np.max(LAMS * SIGMAS)
    cases = [(q, 1, 1e-6, 1e-5), (q, 100, 1e-5, 1e-2)]
    for turn in (0 * noise[0], *noise):
        near = quaternion.multiply(quaternion.exp(jnp.asarray(turn)), q)
        cases.append((near, stiffest, 1e-4, 0.1))
    for data, stiffer, angle, relative in cases:
        inputs = (jnp.asarray(x, jnp.float32) for x in (data, stiffer * LAMS, SIGMAS))
        mean, covariance, converged = single(*inputs)
        assert mean.dtype == covariance.dtype == jnp.float32
        assert converged
        double, double_covariance = smooth(data, stiffer * LAMS, SIGMAS)
        assert largest_angle(mean, double) < angle
        largest = relative * jnp.max(double_covariance)
        np.testing.assert_allclose(covariance, double_covariance, atol=largest)

    inputs = (jnp.asarray(x, jnp.float32) for x in (q, 1e8 * LAMS, SIGMAS))
    mean, _, converged = single(*inputs)
    assert not converged
    assert jnp.isfinite(mean).all()
    with pytest.raises(Exception, match=r"did not converge"):
        geodesic(q.astype(jnp.float32), 1e8, 1.0)


@pytest.mark.parametrize("order", [1, 2])
def test_frames_beyond_the_data(order):
    """Each joint with its own: the whole cost is least, and what goes on costs nothing."""
    weights = np.ones((16, 2))
    weights[:3, 0] = weights[12:, 0] = weights[14:, 1] = weights[6, 1] = 0
    q = clip(16, 2)
    found = geodesic(q, LAMS, SIGMAS, order=order, weights=weights)
    assert found.gradient_norm < 1e-9
    if order == 2:  # order 1 weighs the steps at the ends of a clip half as much
        inner = geodesic(q[3:12, :1], LAMS[:1], SIGMAS[:1]).mean
        assert largest_angle(found.mean[3:12, 0], inner[:, 0]) < 1e-9
    steps = quaternion.log(quaternion.between(found.mean[:-1], found.mean[1:]))
    at_end = steps[10, 0] if order == 2 else 0 * steps[10, 0]
    np.testing.assert_allclose(steps[11:, 0], np.broadcast_to(at_end, (4, 3)), atol=1e-9)
    sparse = geodesic(q[:5], LAM, SIGMA, order=order, index=[2.5, 4, 5.5, 7, 9], num_frames=14)
    assert sparse.gradient_norm < 1e-9


def test_single_precision_with_many_frames_beyond_the_data():
    """A clip in a room twice its size: normal equations of 300 frames that hang one from the other
    have no digits in float32."""
    turn = 0.7 * np.sin(0.1 * np.arange(226)[:, None] + np.arange(3))
    q = quaternion.exp(turn + 0.01 * np.random.default_rng(0).standard_normal((226, 3)))
    alone = geodesic(np.asarray(q), 300.0, 1.0)
    weights = np.where(np.arange(512) < 226, 1.0, 0.0)
    padded = np.pad(np.asarray(q), ((0, 286), (0, 0)), mode="edge")
    found = geodesic(padded.astype(np.float32), 300.0, 1.0, weights=weights.astype(np.float32))
    assert found.converged
    assert found.num_steps <= alone.num_steps + 2
    assert largest_angle(found.mean[:226], alone.mean) < 1e-3


@pytest.mark.slow
def test_derivatives_forward_reverse_and_finite_differences():
    """In data, lam, sigma, weights, stiffness and a fractional index at once."""
    rng = np.random.default_rng(3)
    q = jnp.asarray(clip(6, 2))
    turn = jnp.asarray(rng.standard_normal((6, 2, 3)))
    weights = jnp.asarray(rng.uniform(0.5, 2, (6, 2)))
    target = jnp.asarray(rng.standard_normal((8, 2, 4)))
    index = jnp.array([0.2, 1.5, 2.2, 4.3, 5.1, 5.6])  # frame 7 is beyond

    def function(t):
        moved = quaternion.multiply(q, quaternion.exp(t * turn))
        found = geodesic(
            moved,
            LAMS * (1 + t),
            4 * SIGMAS * (1 - t),
            loss="huber",
            weights=weights * (1 + t),
            stiffness=FIRM[:8] * (1 + t * target[..., 0]),
            index=index + 0.3 * t,
            num_frames=8,
        )
        return jnp.vdot(target, found.mean)

    forward = eqx.filter_jit(lambda t: jax.jvp(function, (t,), (jnp.ones_like(t),)))
    reverse = eqx.filter_jit(jax.grad(function))
    numeric = (forward(jnp.array(1e-4))[0] - forward(jnp.array(-1e-4))[0]) / 2e-4
    np.testing.assert_allclose(forward(jnp.array(0.0))[1], numeric, rtol=1e-6)
    np.testing.assert_allclose(reverse(jnp.array(0.0)), numeric, rtol=1e-6)


@pytest.mark.parametrize("order", [1, pytest.param(2, marks=pytest.mark.sweep)])  # 2 is above
def test_gradient_in_lam_sigma_and_the_stiffness_of_every_frame(order):
    q = jnp.asarray(clip(7, 2))
    target = jnp.asarray(np.random.default_rng(4).standard_normal((7, 2, 4)))

    def function(parameters):
        lam, sigma, *firm = parameters
        answer = geodesic(q, lam, sigma, order=order, stiffness=jnp.stack(firm))
        return jnp.vdot(target, answer.mean)

    both = eqx.filter_jit(jax.value_and_grad(function))
    at = jnp.concatenate([jnp.stack([LAMS, SIGMAS]), FIRM[:7]])
    np.testing.assert_array_equal(both(at)[1][2], 0)  # frame 0 has none
    for place in [(0, 0), (0, 1), (1, 1), (3, 0), (5, 1)]:
        step = jnp.zeros_like(at).at[place].set(1e-4 * at[place])
        numeric = (both(at + step)[0] - both(at - step)[0]) / (2e-4 * at[place])
        np.testing.assert_allclose(both(at)[1][place], numeric, rtol=1e-6, atol=1e-9)


def test_robust_losses_shrug_off_a_spike():
    frames = 30
    truth = Rotation.from_rotvec(np.arange(frames)[:, None] * [0.05, 0.02, -0.03])
    q = np.roll(truth.as_quat(), 1, axis=-1)
    noisy = Rotation.from_rotvec(0.01 * np.random.default_rng(2).standard_normal((frames, 3)))
    spiked = (truth * noisy).as_quat()
    spiked[12] = (truth[12] * Rotation.from_rotvec([0.0, 1.0, 0.0])).as_quat()
    spiked = np.roll(spiked, 1, axis=-1)
    robust = geodesic(spiked, 1000.0, 0.01, loss="huber").mean
    # Two joints of the same data; of the second, the spike is missing.
    weights = np.ones((frames, 2))
    weights[12, 1] = 0
    both = np.stack([spiked, spiked], axis=1)
    both[12, 1] = np.nan
    plain = geodesic(both, 1000.0, 0.01, weights=weights).mean
    spoiled = largest_angle(plain[:, 0], q)
    assert largest_angle(robust, q) < 0.2 * spoiled
    assert largest_angle(plain[:, 1], q) < 0.02


@pytest.mark.parametrize(("frames", "order"), [(1, 2), (2, 1), (3, 2)])
def test_shortest_clips(frames, order):
    q = clip(frames)[:, 0]
    found = geodesic(q, LAM, SIGMA, order=order)
    assert found.mean.shape == (frames, 4)
    assert found.covariance.shape == (frames, 3, 3)
    assert jnp.isfinite(found.covariance).all()
    expected, _ = dense_minimum(q, q, order)
    assert largest_angle(found.mean, expected) < 1e-8


def test_bad_input_is_named():
    q = clip(6, 2)
    with pytest.raises(ValueError, match=r"q must have shape"):
        geodesic(q[0, 0], LAM, SIGMA)
    for lam, sigma in [(0.0, 1.0), (1.0, -1.0), (np.nan, 1.0)]:
        with pytest.raises(ValueError, match=r"(lam|sigma) must be positive"):
            geodesic(q, lam, sigma)
    for wrong in (FIRM[:5], FIRM[:6, :1].repeat(3, 1), FIRM[:6, :, None]):
        with pytest.raises(ValueError, match=r"stiffness has shape"):
            geodesic(q, LAM, SIGMA, stiffness=wrong)
    with pytest.raises(ValueError, match=r"distinct frames"):
        geodesic(q, LAM, SIGMA, weights=np.array([1.0, 0, 0, 0, 0, 0]))
    for bad in (np.where(q == q[2, 1], np.nan, q), 1.01 * q):
        with pytest.raises(Exception, match=r"NaN or quaternions that are not unit"):
            geodesic(bad, LAM, SIGMA)


def test_a_balance_that_is_no_minimum_has_no_derivative():
    """Half the frames lie 40 sigma on either side of the stiff answer, where the loss has a top."""
    turns = 0.4 * np.where(np.arange(8) % 4 < 2, 1, -1)[:, None] * np.array([1.0, 0, 0])
    q = jnp.asarray(quaternion.exp(turns))

    def mean(sigma, throw):
        return geodesic(q, 1e6, sigma, order=1, loss="cauchy", throw=throw).mean

    answer, slope = jax.jit(lambda s: jax.jvp(lambda s: mean(s, False), (s,), (1.0,)))(0.01)
    assert largest_angle(answer, quaternion.identity((8,))) < 1e-3
    assert np.isnan(slope).any()
    for derivative in (jax.jacfwd, jax.jacrev):
        with pytest.raises(Exception, match="no derivative: the answer is no strict minimum"):
            jax.jit(derivative(lambda s: mean(s, True)))(0.01)


def test_chordal_and_geodesic_answers_on_a_real_clip(data_dir):
    """Eq. 10: near one another for gentle smoothing, further apart the more is smoothed away."""
    motion = io.load(data_dir / "bandai" / "bow_angry_001.bvh")
    q = jnp.asarray(motion.rotations)
    differences = []
    compiled = eqx.filter_jit(lambda lam: geodesic(q, lam, 1.0).mean)
    for lam in (1.0, 10.0, 100.0):
        chordal = smooth_quaternions(q, lam, 1.0)
        differences.append(float(jnp.max(quaternion.distance(chordal, compiled(jnp.asarray(lam))))))
    bounds = (3e-5, 3e-4, 2e-3)
    assert all(1e-7 < d < b for d, b in zip(differences, bounds, strict=True))
    assert differences == sorted(differences)
