import jax
import jax.numpy as jnp
import numpy as np

from jaxmotion.spacetime.goals import ramped_goals
from tests.helpers import assert_jit_and_vmap_agree

DT = 0.1
compiled = jax.jit(ramped_goals)


def brute_force(positions, target, mask, ramp):
    goal, weight = positions.copy(), np.zeros(mask.shape)
    for t, c in np.ndindex(mask.shape):
        if mask[t, c]:
            goal[t, c], weight[t, c] = target[t, c], 1
            continue
        sides = []
        for frames in (range(t, -1, -1), range(t, len(mask))):
            border = next((s for s in frames if mask[s, c]), None)
            if border is not None and abs(border - t) * DT < ramp:
                u = abs(border - t) * DT / ramp
                offset = target[border, c] - positions[border, c]
                sides.append((1 - 3 * u**2 + 2 * u**3, offset))
        if sides:
            total = sum(h for h, _ in sides)
            goal[t, c] += sum(h * offset for h, offset in sides) / total
            weight[t, c] = max(h for h, _ in sides)
    return goal, weight


def case(frames=30, points=4, seed=0):
    rng = np.random.default_rng(seed)
    mask = np.repeat(rng.random((frames // 3, points)) < 0.3, 3, axis=0)
    mask[:, 0], mask[:, 1] = False, True
    return rng.standard_normal((2, frames, points, 3)), mask


def test_goals_against_the_table(dtype):
    (positions, target), mask = case()
    for ramp in (0.0, 0.25, 1.2):
        arrays = (jnp.asarray(x, dtype) for x in (positions, target))
        goal, weight = compiled(
            *arrays, jnp.asarray(mask), jnp.asarray(DT, dtype), jnp.asarray(ramp, dtype)
        )
        assert goal.dtype == weight.dtype == dtype
        want_goal, want_weight = brute_force(positions, target, mask, ramp)
        np.testing.assert_allclose(weight, want_weight, atol=2e-6)
        held = want_weight > 1e-3  # where nothing pulls, the goal means nothing
        np.testing.assert_allclose(goal[held], want_goal[held], atol=2e-3)


def test_weights_have_no_kink():
    mask = np.zeros((41, 1), bool)
    mask[20] = True
    still = jnp.zeros((41, 1, 3))
    _, weight = compiled(still, still, jnp.asarray(mask), jnp.asarray(0.01), jnp.asarray(0.15))
    assert np.abs(np.diff(np.asarray(weight)[:, 0], n=2)).max() < 0.06
    assert np.all(np.diff(np.asarray(weight)[:21, 0]) >= 0)


def test_goals_compiled_and_mapped():
    (positions, target), mask = case(12)
    assert_jit_and_vmap_agree(
        lambda a, b: compiled(a, b, jnp.asarray(mask), jnp.asarray(DT), jnp.asarray(0.3)),
        positions,
        target,
    )
