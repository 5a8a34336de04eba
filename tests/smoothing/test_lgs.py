"""The LGS smoother against dense matrices, and what its definition promises."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from jaxmotion.smoothing import lgs
from tests.helpers import check_gradients

RNG = np.random.default_rng(0)
CASES = {
    "every frame": (9, None, None),
    "gaps and both ends open": (11, [2, 3, 7, 8], None),
    "unsorted and repeated": (7, [5, 0, 5, 3, 1, 0], None),
    "fractional": (8, [0.0, 1.25, 1.5, 4.75, 7.0], None),
    "fractional, first and last open": (8, [2.5, 2.75, 5.0, 5.5], None),
    "weights with a missing datum": (6, None, [1.0, 0.5, 0.0, 2.0, 0.0, 1.5]),
    "one frame": (1, None, None),
    "two frames": (2, None, None),
    "three frames": (3, [0, 2], None),
}


def dense_model(frames, t, w, lam, sigma, order, scale):
    """P and A of Eq. 6 and 7, the null space, and the prior rows, each from its definition."""
    a = np.zeros((len(t), frames))
    for i, position in enumerate(t):
        j = min(int(np.floor(position)), max(frames - 2, 0))
        a[i, j] = 1 - (position - j)
        if frames > 1:
            a[i, j + 1] = position - j
    eye = np.eye(frames)
    if order == 2:
        rows = lam * np.diff(eye, n=2, axis=0) * (0.5 if scale == "half" else 1.0)
        null = np.stack([np.ones(frames), np.arange(frames)], 1)[:, : min(2, frames)]
    else:
        counts = np.full(max(frames - 1, 0), 2.0)
        counts[:1] = counts[-1:] = 1
        rows = np.sqrt(lam * counts)[:, None] * np.diff(eye, axis=0)
        null = np.ones((frames, 1))
    precision = rows.T @ rows + a.T @ np.diag(w / sigma**2) @ a
    return a, rows, null, precision


def restricted_log_density(y, a, rows, null, noise):
    """Density of the contrasts of y that the null space cannot move, then the flat density's."""
    x_cov = np.linalg.pinv(rows.T @ rows) if rows.size else np.zeros((a.shape[1],) * 2)
    cov = a @ x_cov @ a.T + np.diag(noise)
    design = a @ null
    u, s, _ = np.linalg.svd(design)
    contrasts = u[:, len(s) :]
    part = contrasts.T @ cov @ contrasts
    z = contrasts.T @ y
    log_det = np.linalg.slogdet(part)[1] if len(z) else 0.0
    log_density = -0.5 * (len(z) * np.log(2 * np.pi) + log_det + z @ np.linalg.solve(part, z))
    return log_density - np.sum(np.log(s))


def parts(y, lam, sigma, **options):
    posterior = lgs(y, lam, sigma, **options)
    return (
        posterior.mean,
        posterior.variance,
        posterior.lag_one_covariance,
        posterior.log_evidence,
    )


@pytest.mark.parametrize(("order", "dtype"), [(1, "float64"), (2, "float64"), (2, "float32")])
@pytest.mark.parametrize("name", CASES)
def test_matches_dense(name, order, dtype):
    frames, index, weights = CASES[name]
    t = np.arange(frames) if index is None else np.asarray(index)
    w = np.ones(len(t)) if weights is None else np.asarray(weights)
    lam, sigma = 1.7, 0.6
    y = np.random.default_rng(1).standard_normal((len(t), 2)).astype(dtype)
    y[w == 0] = np.nan
    options = dict(index=index, num_frames=frames, order=order, weights=weights)
    found = jax.jit(lambda y: parts(y, lam, sigma, **options))(y)

    a, rows, null, precision = dense_model(frames, t, w, lam, sigma, order, "half")
    cov = np.linalg.inv(precision)
    seen = w > 0
    y = np.where(seen[:, None], y, 0).astype(float)
    evidence = [
        restricted_log_density(y[seen, c], a[seen], rows, null, sigma**2 / w[seen])
        for c in range(2)
    ]
    mean = cov @ a.T @ (w[:, None] * y) / sigma**2
    tol = {"rtol": 1e-4, "atol": 1e-4} if dtype == "float32" else {"rtol": 1e-9, "atol": 1e-10}
    for got, want in zip(
        found, (mean, np.diag(cov), np.diag(cov, 1), np.asarray(evidence)), strict=True
    ):
        assert got.dtype == dtype
        np.testing.assert_allclose(got, want, **tol)


def test_inputs_stay_as_they_were():
    y, weights, index = RNG.standard_normal((6, 2)), np.ones(6), np.arange(6)[::-1].copy()
    copies = y.copy(), weights.copy(), index.copy()
    lgs(y, 1.0, 0.5, weights=weights, index=index).mean.block_until_ready()
    for now, before in zip((y, weights, index), copies, strict=True):
        np.testing.assert_array_equal(now, before)


def test_minimises_the_printed_energies():
    """Eq. 6 and 7 as sums over frames: no small move of any frame lowers them."""
    y = RNG.standard_normal(12)
    lam, sigma = 2.0, 0.7

    def eq6(x):
        bend = x[1:-1] - (x[:-2] + x[2:]) / 2
        return np.sum((x - y) ** 2) / (2 * sigma**2) + lam**2 / 2 * np.sum(bend**2)

    def eq7(x):
        back, ahead = x[1:-1] - x[:-2], x[1:-1] - x[2:]
        return np.sum((x - y) ** 2) / (2 * sigma**2) + lam / 2 * np.sum(back**2 + ahead**2)

    for order, energy in ((2, eq6), (1, eq7)):
        x = np.asarray(lgs(y, lam, sigma, order=order).mean)
        for frame in range(12):
            step = 1e-4 * np.eye(12)[frame]
            slope = (energy(x + step) - energy(x - step)) / 2e-4
            assert abs(slope) < 1e-8


def test_frequency_response():
    """Interior gain 1 / (1 + (lam sigma)^2 (2 - 2 cos w)^2), unit scale."""
    t = np.arange(801)
    for product in (1.0, 10.0):
        half_power = 2 * np.arcsin(1 / (2 * np.sqrt(product)))
        y = np.cos(half_power * (t - 400))
        gain = lgs(y, 2 * product, 1.0).mean[400]
        np.testing.assert_allclose(gain, 0.5, atol=1e-6)


def test_scaling_laws():
    y = RNG.standard_normal((15, 2))
    base = lgs(y, 3.0, 0.5)
    same = lgs(y, 6.0, 0.25)
    np.testing.assert_allclose(same.mean, base.mean, atol=1e-12)
    np.testing.assert_allclose(same.variance, base.variance / 4, rtol=1e-12)
    unit = lgs(y, 1.5, 0.5, scale="unit")
    np.testing.assert_allclose(unit.mean, base.mean, atol=1e-12)
    np.testing.assert_allclose(unit.log_evidence, base.log_evidence, rtol=1e-12)
    np.testing.assert_allclose(lgs(y[::-1], 3.0, 0.5).mean[::-1], base.mean, atol=1e-12)


@pytest.mark.parametrize("weights", [None, np.r_[np.ones(10), 0.0, 0.3]])
def test_null_space_is_kept_exactly(weights, dtype):
    ramp = (0.7 * np.arange(12)[:, None] + [2.0, -5.0]).astype(dtype)
    tol = 2e-5 if dtype == np.float32 else 1e-12
    np.testing.assert_allclose(lgs(ramp, 5.0, 2.0, weights=weights).mean, ramp, atol=tol)
    still = np.broadcast_to(ramp[:1], ramp.shape)
    for order in (1, 2):
        smooth = lgs(still, 1e4, 1.0, order=order, weights=weights).mean
        np.testing.assert_allclose(smooth, still, rtol=3e-7)
    # Continued beyond the data along the line.
    posterior = lgs(ramp[3:9], 5.0, 2.0, index=np.arange(3, 9), num_frames=12)
    np.testing.assert_allclose(posterior.mean, ramp, atol=10 * tol)


def test_evidence_ignores_frames_without_data():
    y = RNG.standard_normal((6, 2))
    # At order 1 the printed C counts the end differences once, so compare two open stretches.
    for order, tight in ((1, np.arange(1, 7)), (2, np.arange(6))):
        base = lgs(y, 2.0, 0.5, order=order, index=tight, num_frames=7 + (order == 1))
        padded = lgs(y, 2.0, 0.5, order=order, index=np.arange(4, 10), num_frames=15)
        np.testing.assert_allclose(padded.log_evidence, base.log_evidence, rtol=1e-11)


def test_missing_data_leak_nothing():
    y = RNG.standard_normal((8, 3))
    weights = np.ones((8, 3))
    weights[2, 0] = weights[5:7, 1] = 0
    holes = np.where(weights > 0, y, np.nan)

    def value(y, weights):
        posterior = lgs(y, 2.0, 0.5, weights=weights)
        return jnp.sum(posterior.mean**2) + jnp.sum(posterior.log_evidence)

    for weight in (weights, weights[:, :1]):
        data = jnp.asarray(holes if weight is weights else np.where(weight > 0, y, np.inf))
        both = jax.jit(jax.value_and_grad(value, argnums=(0, 1)))
        result, grads = both(data, jnp.asarray(weight))
        assert np.isfinite(result)
        assert all(np.all(np.isfinite(g)) for g in grads)
        assert np.all(np.asarray(grads[0])[np.broadcast_to(weight == 0, y.shape)] == 0)
    # Per channel weights are as many separate problems.
    both = lgs(holes, 2.0, 0.5, weights=weights)
    for c in range(3):
        alone = lgs(holes[:, c], 2.0, 0.5, weights=weights[:, c])
        np.testing.assert_allclose(both.mean[:, c], alone.mean, atol=1e-12)
        np.testing.assert_allclose(both.variance[:, c], alone.variance, atol=1e-12)
        np.testing.assert_allclose(both.log_evidence[c], alone.log_evidence, atol=1e-11)


def test_parameters_per_channel_jit_and_vmap():
    y = jnp.asarray(RNG.standard_normal((10, 3, 4)))
    lam, sigma = jnp.asarray([[1.0], [2.0], [5.0]]), jnp.asarray(0.5)
    whole = lgs(y, lam, sigma)
    assert whole.mean.shape == y.shape
    assert whole.variance.shape == (10, 3, 1)
    assert whole.log_evidence.shape == (3, 4)
    for joint in range(3):
        alone = lgs(y[:, joint], float(lam[joint, 0]), 0.5)
        assert alone.variance.shape == (10,)
        np.testing.assert_allclose(whole.mean[:, joint], alone.mean, atol=1e-12)
        np.testing.assert_allclose(whole.variance[:, joint, 0], alone.variance, atol=1e-12)
        np.testing.assert_allclose(whole.log_evidence[joint], alone.log_evidence, atol=1e-11)

    jitted = jax.jit(lambda y, lam: parts(y, lam, 0.5))(y, lam)
    over_joints = jax.vmap(lambda y, lam: parts(y, lam, 0.5), in_axes=(1, 0), out_axes=-1)
    vmapped = jax.jit(over_joints)(y, lam[:, 0])
    eager = (whole.mean, whole.variance, whole.lag_one_covariance, whole.log_evidence)
    for now, compiled in zip(eager, jitted, strict=True):
        np.testing.assert_allclose(compiled, now, atol=1e-12)
    np.testing.assert_allclose(np.swapaxes(vmapped[0], 1, 2), whole.mean, atol=1e-12)
    np.testing.assert_allclose(vmapped[1], whole.variance[..., 0], atol=1e-12)
    np.testing.assert_allclose(vmapped[3].T, whole.log_evidence, atol=1e-11)


@pytest.mark.parametrize("order", [1, 2])
def test_derivatives(order):
    y = jnp.asarray(RNG.standard_normal((6, 2)))
    weights = jnp.asarray(RNG.uniform(0.5, 2, (6, 2)))
    index = jnp.asarray([0.3, 2.6, 2.2, 4.5, 5.7, 6.4])
    lam, sigma = jnp.asarray([0.8, 1.5]), jnp.asarray(0.7)

    def outputs(y, lam, sigma, weights, index):
        posterior = lgs(y, lam, sigma, weights=weights, index=index, num_frames=8, order=order)
        return posterior.mean, posterior.variance, posterior.log_evidence

    def evidence(lam, sigma):
        return jnp.sum(outputs(y, lam, sigma, weights, index)[2])

    arguments = (y, lam, sigma, weights, index)
    check_gradients(outputs, *arguments)
    if order == 2:
        slope = jax.jit(jax.grad(evidence, argnums=(0, 1)))
        check_grads(slope, (lam, sigma), 1, modes=("fwd",), rtol=1e-4)


def test_derivative_in_the_index_is_one_sided_on_whole_frames():
    """From below, and at frame 0 from above."""
    y = jnp.asarray(RNG.standard_normal(4))
    value = jax.jit(lambda t: jnp.sum(lgs(y, 1.0, 0.5, index=t, num_frames=6).mean ** 2))
    t = jnp.asarray([0.0, 2.0, 4.5, 5.0])
    slope = jax.jit(jax.grad(value))(t)
    for i, step in enumerate([1e-6, -1e-6, 1e-6, -1e-6]):
        moved = (value(t.at[i].add(step)) - value(t)) / step
        np.testing.assert_allclose(slope[i], moved, rtol=1e-4)


def test_mean_alone_costs_one_factor_and_one_solve():
    y = jnp.asarray(RNG.standard_normal((20, 3)))
    mean = jax.jit(lambda y, lam: lgs(y, lam, 0.5).mean)
    slope = jax.jit(jax.grad(lambda y, lam: jnp.sum(lgs(y, lam, 0.5).mean ** 2), argnums=1))
    evidence = jax.jit(jax.grad(lambda y, lam: lgs(y, lam, 0.5).log_evidence.sum(), argnums=1))
    loops = [
        f.lower(y, jnp.asarray(2.0)).compile().as_text().count(" while(")
        for f in (mean, slope, evidence)
    ]
    # Factor, forward, back; a second solve for the derivative of the mean; for the evidence none,
    # but the factor and the selected inverse of its log-determinant.
    assert loops[0] == 3
    assert loops[1] == 5
    assert loops[2] <= 6


def test_samples():
    y = RNG.standard_normal((6, 2))
    posterior = lgs(y, [2.0, 3.0], [0.5, 1.0])
    draws = np.asarray(posterior.sample(jax.random.key(3), (100, 100)))
    assert draws.shape == (100, 100, 6, 2)
    draws = draws.reshape(-1, 6, 2)
    std = np.sqrt(np.asarray(posterior.variance))
    np.testing.assert_allclose((draws.mean(0) - posterior.mean) / std, 0, atol=0.05)
    np.testing.assert_allclose(draws.std(0) / std, 1, atol=0.04)
    lag = np.mean((draws - draws.mean(0))[:, :-1] * (draws - draws.mean(0))[:, 1:], axis=0)
    expected = np.asarray(posterior.lag_one_covariance)
    np.testing.assert_allclose(lag / expected, 1, atol=0.15)
    assert posterior.sample(jax.random.key(3)).shape == (6, 2)
    again = posterior.sample(jax.random.key(3), (100, 100)).reshape(-1, 6, 2)
    np.testing.assert_array_equal(again, draws)


def test_float32_is_close_to_float64_at_heavy_smoothing():
    t = np.arange(3000)
    y = np.sin(t / 40)[:, None] + np.array([0.0, 100.0]) + 0.1 * RNG.standard_normal((3000, 2))
    single, double = (lgs(y.astype(d), 1e4, 1.0) for d in ("float32", "float64"))
    span = np.ptp(y, axis=0)
    error = np.abs(np.asarray(single.mean, float) - np.asarray(double.mean)) / span
    assert error.max() < 5e-5
    np.testing.assert_allclose(single.variance, double.variance, rtol=1e-3)
    np.testing.assert_allclose(single.log_evidence, double.log_evidence, rtol=1e-3)


ONES = np.ones((5, 2))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(lam=0.0), "lam must be positive"),
        (dict(lam=[1.0, np.nan]), "lam must be positive"),
        (dict(sigma=-1), "sigma must be positive"),
        (dict(lam=[1.0, 2.0, 3.0]), r"lam has shape \(3,\)"),
        (dict(order=3), "order=3"),
        (dict(scale="double"), "scale='double'"),
        (dict(y=np.ones((5, 2), int)), "y has dtype int64"),
        (dict(y=np.float64(1.0)), "y is a scalar"),
        (dict(y=np.ones((0, 2))), "y has no data"),
        (dict(num_frames=9), "num_frames=9"),
        (dict(index=[0, 1]), r"index has shape \(2,\)"),
        (dict(index=[0, 1, 2, 3, 9], num_frames=9), "between 0 and num_frames - 1 = 8, got 9"),
        (dict(index=[0, 1, 2, 3, np.nan]), "index must lie"),
        (dict(index=[True] * 5), "index has dtype bool"),
        (dict(index=[3] * 5, num_frames=9), "2 or more distinct"),
        (dict(weights=[0, 0, 1, 0, 0]), "2 or more distinct"),
        (dict(weights=[0] * 5, order=1), "1 or more distinct"),
        (dict(weights=[1, 1, 1, 1, -1]), "weights must be finite"),
        (dict(weights=np.ones((5, 3))), r"weights have shape \(5, 3\)"),
    ],
)
def test_bad_static_input(arguments, message):
    arguments = {"y": ONES, "lam": 1.0, "sigma": 1.0, **arguments}
    with pytest.raises(ValueError, match=message):
        lgs(arguments.pop("y"), arguments.pop("lam"), arguments.pop("sigma"), **arguments)


def test_a_traced_index_does_not_tell_the_number_of_frames():
    with pytest.raises(ValueError, match="num_frames is needed"):
        jax.jit(lambda index: lgs(ONES, 1.0, 1.0, index=index).mean)(jnp.arange(5))
    known = lgs(ONES, 1.0, 1.0, index=jnp.arange(5) * 2)
    assert known.mean.shape[0] == 9


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(lam=-1.0), "lam must be positive"),
        (dict(sigma=0.0), "sigma must be positive"),
        (dict(index=jnp.asarray([0, 1, 2, 3, 9])), "index must lie"),
        (dict(index=jnp.asarray([2, 2, 2, 2, 2])), "2 or more distinct"),
        (dict(weights=jnp.asarray([0.0, 1.0, 0.0, 0.0, 0.0])), "2 or more distinct"),
        (dict(weights=jnp.asarray([1.0, 1.0, -1.0, 1.0, 1.0])), "weights must be finite"),
        (dict(y=jnp.asarray(ONES).at[3, 1].set(jnp.nan)), "y holds NaN"),
        (dict(y=jnp.asarray(ONES).at[0, 0].set(jnp.inf)), "y holds NaN"),
    ],
)
def test_bad_traced_input(arguments, message):
    defaults = {"y": jnp.asarray(ONES), "lam": 1.0, "sigma": 1.0, "index": None, "weights": None}
    traced = {k: v if v is None else jnp.asarray(v) for k, v in (defaults | arguments).items()}

    @jax.jit
    def smooth(y, lam, sigma, index, weights):
        return lgs(y, lam, sigma, index=index, weights=weights, num_frames=5).mean

    with pytest.raises(Exception, match=message):
        smooth(**traced).block_until_ready()


@pytest.mark.parametrize("order", [1, 2])
def test_stiffness_of_every_frame_is_a_dense_solve_and_an_evidence(order):
    """lam may differ by frame: against the normal equations and the density of the contrasts."""
    rng = np.random.default_rng(5)
    frames, lam, sigma = 9, 1.7, 0.6
    y = rng.standard_normal((frames, 2))
    firm = rng.uniform(0.3, 3, (frames, 2))
    got = lgs(y, lam, sigma, order=order, stiffness=firm, scale="unit" if order == 2 else "half")
    rows = np.diff(np.eye(frames), n=order, axis=0)
    for c in range(2):
        if order == 2:
            precision = (lam * firm[1:-1, c]) ** 2
        else:
            precision = lam * firm[1:, c] * np.r_[1, np.full(frames - 3, 2), 1]
        q = rows.T @ np.diag(precision) @ rows
        p = q + np.eye(frames) / sigma**2
        mean = np.linalg.solve(p, y[:, c] / sigma**2)
        np.testing.assert_allclose(got.mean[:, c], mean, atol=1e-10)
        np.testing.assert_allclose(got.variance[:, c], np.diag(np.linalg.inv(p)), rtol=1e-9)
        energy = np.sum((y[:, c] - mean) ** 2) / sigma**2 + mean @ q @ mean
        null = order
        log_evidence = -0.5 * (
            (frames - null) * np.log(2 * np.pi)
            + frames * np.log(sigma**2)
            - np.sum(np.log(precision))
            + np.linalg.slogdet(p)[1]
            + energy
        )
        np.testing.assert_allclose(got.log_evidence[c], log_evidence, rtol=1e-9)
    check_gradients(lambda s: lgs(y, lam, sigma, order=order, stiffness=s).mean, firm)
    shared = lgs(y, lam, sigma, order=order, stiffness=firm[:, 0])
    both = lgs(y, lam, sigma, order=order, stiffness=np.repeat(firm[:, :1], 2, 1))
    np.testing.assert_allclose(shared.mean, both.mean, atol=1e-12)
    with pytest.raises(ValueError, match="stiffness has shape"):
        lgs(y, lam, sigma, order=order, stiffness=firm[:5])
