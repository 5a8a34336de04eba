"""The stream against the batch smoother of everything taken in, frame after frame."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import quaternion
from jaxmotion.smoothing import StreamingSmoother, lgs, smooth_quaternions
from tests.helpers import angle_between, check_gradients, random_quaternions


@jax.jit
def run(smoother, frames, weights):
    """All frames through the stream: outputs, the flushed rest, and the two joined in time."""
    state = smoother.init(frames[0], weights[0])
    state, late = jax.lax.scan(lambda s, fw: smoother.step(s, *fw), state, (frames, weights))
    return late, smoother.flush(state)


def dense(y, weights, product):
    """Minimiser of the weighted misfit plus product^2 |Lx|^2, L of rows (1, -2, 1)."""
    bend = np.diff(np.eye(len(y)), n=2, axis=0)
    system = product**2 * bend.T @ bend + np.diag(weights)
    return np.linalg.solve(system, weights[:, None] * y)


@pytest.mark.parametrize("lag", [0, 5, 20])
def test_equals_the_dense_solve_of_all_frames_so_far(lag, dtype):
    rng = np.random.default_rng(0)
    y, weights = rng.standard_normal((14, 2)) + 50, rng.uniform(0.5, 2, 14)
    weights[[3, 6, 7, 8]] = 0
    y, weights = y.astype(dtype), weights.astype(dtype)
    given = np.where(weights[:, None] > 0, y, np.nan)
    late, rest = run(StreamingSmoother(2.0, 1.5, lag=lag, scale="unit"), given, weights)
    assert late.dtype == rest.dtype == dtype
    y, weights = y.astype(float), weights.astype(float)
    tol = 1e-11 if dtype == np.float64 else 3e-5
    np.testing.assert_allclose(late[0], y[0], atol=tol)
    for t in range(1, 14):
        so_far = dense(y[: t + 1], weights[: t + 1], 3.0)
        np.testing.assert_allclose(late[t], so_far[max(t - lag, 0)], atol=tol)
    shown = min(lag, 14)
    np.testing.assert_allclose(rest[lag - shown :], so_far[14 - shown :], atol=tol)
    if lag > 14:
        np.testing.assert_allclose(rest[: lag - 14], np.tile(so_far[:1], (lag - 14, 1)), atol=tol)


def test_start_before_two_frames_are_seen():
    y = np.array([np.nan, np.nan, 4.0, np.nan, 5.0, np.nan])[:, None]
    late, rest = run(StreamingSmoother(1.0, 1.0, lag=2), y, np.ones(6))
    # Nothing known: 0. One frame seen: at rest there. Two: the line through them.
    np.testing.assert_allclose(late[:, 0], [0, 0, 4, 4, 4, 4.5], atol=1e-12)
    np.testing.assert_allclose(rest[:, 0], [5.0, 5.5], atol=1e-12)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_clips_shorter_than_the_lag(frames):
    y = np.random.default_rng(1).standard_normal((frames, 2))
    _, rest = run(StreamingSmoother(1.0, 1.0, lag=4), y, np.ones(frames))
    np.testing.assert_allclose(rest[4 - frames :], lgs(y, 1.0, 1.0).mean, atol=1e-12)


def test_approaches_the_batch_answer_as_the_lag_grows():
    y = np.cumsum(np.random.default_rng(2).standard_normal((200, 3)), 0)
    batch = lgs(y, 10.0, 1.0).mean
    errors = []
    for lag in (10, 20, 30):
        late, _ = run(StreamingSmoother(10.0, 1.0, lag=lag), y, np.ones(200))
        errors.append(float(jnp.max(jnp.abs(late[lag:] - batch[: 200 - lag]))))
    assert errors[1] < errors[0] / 20
    assert errors[2] < errors[1] / 20


def test_parameters_and_missing_frames_per_channel():
    rng = np.random.default_rng(3)
    y, lam = rng.standard_normal((12, 2, 3)), np.array([[0.5], [4.0]])
    weights = np.ones((12, 2, 1))
    weights[4:6, 0] = weights[0, 1] = 0
    late, rest = run(StreamingSmoother(lam, 0.7, lag=6), y, weights)
    want = lgs(y, lam, 0.7, weights=weights).mean
    np.testing.assert_allclose(rest, want[-6:], atol=1e-12)
    holes = np.where(weights > 0, y, np.nan)
    by_nan, _ = run(StreamingSmoother(lam, 0.7, lag=6), holes, np.ones((12, 2, 1)))
    np.testing.assert_allclose(by_nan, late, atol=1e-12)


def test_long_streams_do_not_drift():
    y = np.random.default_rng(4).standard_normal((3000, 1)) + 1000
    late, _ = run(StreamingSmoother(10.0, 1.0, lag=30), y.astype(np.float32), np.ones(3000, "f4"))
    batch = lgs(y, 10.0, 1.0).mean
    np.testing.assert_allclose(late[30:], batch[:-30], atol=2e-3)


def turning(rng, frames, joints):
    q = [random_quaternions(rng, (joints,))]
    for turn in random_quaternions(rng, (frames - 1, joints), angle=0.3):
        q.append(quaternion.multiply(q[-1], turn))
    return np.stack(q)


@pytest.mark.parametrize("scale", ["half", "unit"])
def test_rotations_within_a_milliradian_of_the_batch(scale):
    rng = np.random.default_rng(5)
    q = turning(rng, 150, 2) * rng.choice([-1.0, 1.0], (150, 2, 1))
    weights = np.ones((150, 2))
    weights[40:43, 0] = 0
    q[41, 0] = np.nan
    smoother = StreamingSmoother(10.0, 1.0, lag=30, scale=scale, rotations=True)
    late, rest = run(smoother, q, weights)
    batch = smooth_quaternions(jnp.asarray(q), 10.0, 1.0, scale=scale, weights=weights)
    together = np.concatenate([late[30:], rest])
    assert angle_between(together, batch).max() < 1e-3
    np.testing.assert_allclose(np.linalg.norm(together, axis=-1), 1, atol=1e-12)


def test_step_by_step_equals_scan_and_vmap():
    y = np.random.default_rng(6).standard_normal((8, 2, 4))
    smoother = StreamingSmoother(np.array([1.0, 3.0]), 0.5, lag=2, rotations=True)
    state, weights = smoother.init(y[0]), np.ones((8, 2))
    late, rest = run(smoother, y, weights)
    for t in range(8):
        state, out = smoother.step(state, y[t])
        np.testing.assert_allclose(out, late[t], atol=1e-12)
    np.testing.assert_allclose(smoother.flush(state), rest, atol=1e-12)
    _, scanned = jax.lax.scan(smoother.step, smoother.init(y[0]), y)
    np.testing.assert_allclose(scanned, late, atol=1e-12)
    mapped, _ = jax.vmap(run, (None, 0, None))(smoother, np.stack([y, y[::-1]]), weights)
    np.testing.assert_allclose(mapped[0], late, atol=1e-12)
    np.testing.assert_allclose(mapped[1], run(smoother, y[::-1], weights)[0], atol=1e-12)


def test_derivatives():
    y, weights = np.random.default_rng(7).standard_normal((6, 2)), np.r_[1, 1, 0, 1, 2, 1.0]

    def smooth(y, lam, weights):
        return run(StreamingSmoother(lam, 0.8, lag=2), y, weights)

    check_gradients(lambda y, lam: smooth(y, lam, weights), y, np.float64(1.3))
    for first in (2, 6):  # missing frames at the start and throughout
        holes = jnp.asarray(y).at[:first].set(jnp.nan)
        for slope in jax.grad(lambda y: jnp.sum(smooth(y, 1.3, weights)[0]))(holes):
            assert np.all(np.isfinite(slope))


@pytest.mark.parametrize(
    ("options", "frame", "weight", "message"),
    [
        (dict(lag=-1), np.ones(2), 1.0, "lag=-1"),
        (dict(scale="double"), np.ones(2), 1.0, "scale='double'"),
        (dict(lam=0.0), np.ones(2), 1.0, "lam must be positive"),
        (dict(sigma=np.nan), np.ones(2), 1.0, "sigma must be positive"),
        (dict(lam=np.ones(3)), np.ones(2), 1.0, r"lam has shape \(3,\)"),
        (dict(), np.ones(2), np.ones(3), r"weight has shape \(3,\)"),
        (dict(), np.ones(2, int), 1.0, "frame has dtype int64"),
        (dict(rotations=True), np.ones((5, 3)), 1.0, r"frame has shape \(5, 3\)"),
        (dict(rotations=True, lam=np.ones(4)), np.ones((5, 4)), 1.0, r"joints of a frame, \(5,\)"),
    ],
)
def test_bad_arguments(options, frame, weight, message):
    options = {"lam": 1.0, "sigma": 1.0, **options}
    with pytest.raises(ValueError, match=message):
        StreamingSmoother(**options).init(frame, weight)


def test_bad_frames():
    smoother = StreamingSmoother(1.0, 1.0)
    state = smoother.init(np.ones(2))
    with pytest.raises(ValueError, match=r"frame is float64 \(3,\): the stream has float64 \(2,\)"):
        smoother.step(state, np.ones(3))
    with pytest.raises(ValueError, match="give init one of that shape"):
        smoother.step(state, np.ones(2), np.ones(2))
    with pytest.raises(Exception, match="weight must be finite"):
        jax.block_until_ready(smoother.step(state, np.ones(2), -1.0))
