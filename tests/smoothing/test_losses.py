"""Robust losses: their definitions, by derivatives and where they bend."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.smoothing.losses import BEND, slack, slope

U = np.array([0.0, 1e-12, 0.3, 1.0, 1.345**2, 2.0, 2.385**2, 30.0, 1e6])


def rho(u, loss):
    k = BEND.get(loss)
    if loss == "huber":
        return u if u <= k * k else 2 * k * np.sqrt(u) - k * k
    return k * k * np.log1p(u / (k * k)) if loss == "cauchy" else u


@pytest.mark.parametrize("loss", ["l2", *BEND])
def test_slope_and_slack_are_those_of_the_loss(loss, dtype):
    u = jnp.asarray(U, dtype)
    weight, rest = slope(u, loss), slack(u, loss)
    assert weight.dtype == rest.dtype == dtype
    eps = float(np.finfo(dtype).eps)
    weight, rest = (np.asarray(y, np.float64) for y in (weight, rest))
    for x, w, r in zip(U, weight, rest, strict=True):
        h = 1e-6 * max(x, 1e-3)
        quotient = (rho(x + h, loss) - rho(max(x - h, 0), loss)) / (x + h - max(x - h, 0))
        np.testing.assert_allclose(w, quotient, rtol=1e-4)
        np.testing.assert_allclose(r, rho(x, loss) - x * w, rtol=1e3 * eps, atol=1e2 * eps * x)
    assert np.all(rest >= -1e2 * eps * U)


@pytest.mark.parametrize("loss", ["l2", *BEND])
def test_derivatives_are_finite_everywhere(loss):
    for f in (slope, slack):
        assert np.isfinite(jax.vmap(jax.grad(lambda u, f=f: f(u, loss)))(jnp.asarray(U))).all()
