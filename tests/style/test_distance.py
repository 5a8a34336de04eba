"""How far from a manner: closed forms, derivatives, and a motion that is pulled to one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import sqrtm

import jaxmotion as jm
from jaxmotion.style import motion_style, style_distance
from tests.helpers import check_gradients
from tests.style.clips import JOINTS, rotations, swaying

HEIGHT = 3


def by_hand(own, style, joints, root):
    total = 0.0
    for j in joints:
        turn = rotations(style.mean[j]).inv() * rotations(own.mean[j])
        spread = sqrtm(own.covariance[j]) - sqrtm(style.covariance[j])
        total += (np.sum(turn.as_rotvec() ** 2) + np.sum(np.real(spread) ** 2)) / len(joints)
    if root:
        unit = np.where([1, 1, 0, 1, 0, 0], style.root_mean[HEIGHT], 1)
        middle = (own.root_mean - style.root_mean) / unit
        spread = (own.root_deviation - style.root_deviation) / unit
        total += np.mean(middle**2 + spread**2)
    return np.sqrt(total)


def test_is_what_it_says():
    motion, style = swaying(0), motion_style(swaying(1), mean="karcher")
    own = motion_style(motion, mean="karcher")
    joints = range(1, JOINTS)
    np.testing.assert_allclose(style_distance(motion, style), by_hand(own, style, joints, True))
    without = style_distance(motion, style, root=False)
    np.testing.assert_allclose(without, by_hand(own, style, joints, False))
    local = style_distance(motion, style, joints=["arm", "leg"])
    np.testing.assert_allclose(local, by_hand(own, style, [2, 3], False))
    path = style_distance(motion, style, joints="hips")
    np.testing.assert_allclose(path, by_hand(own, style, [], True))


def test_its_own_style_is_no_distance_away():
    motion = swaying(2)
    style = motion_style(motion, mean="karcher")
    assert style_distance(motion, style) < 1e-7
    slope = jax.grad(lambda q: style_distance(motion.with_transforms(rotations=q), style))(
        jnp.asarray(motion.rotations)
    )
    assert jnp.isfinite(slope).all()


def test_single_precision_stays():
    motion, other = (swaying(seed).astype(np.float32) for seed in (0, 1))
    found = style_distance(motion, motion_style(other))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, style_distance(swaying(0), motion_style(swaying(1))), 1e-4)


def test_derivatives():
    motion, style = swaying(3, frames=12), motion_style(swaying(4), mean="karcher")

    def far(rotations, translations, style):
        return style_distance(motion.with_transforms(translations, rotations), style)

    given = jnp.asarray(motion.rotations), jnp.asarray(motion.translations), style
    check_gradients(jax.jit(far), *given, rtol=1e-4, eps=1e-6)


def test_still_bodies_have_finite_derivatives():
    single = swaying(5, frames=1)
    still = single.with_transforms(
        np.repeat(single.translations, 9, 0), np.repeat(single.rotations, 9, 0)
    )
    for style in (motion_style(swaying(6)), motion_style(still)):
        slope = jax.grad(
            lambda q, style=style: style_distance(still.with_transforms(rotations=q), style)
        )(jnp.asarray(still.rotations))
        assert jnp.isfinite(slope).all()


def test_a_motion_is_pulled_to_a_style():
    motion, style = swaying(7), motion_style(swaying(8), mean="karcher")

    @jax.jit
    def step(vectors):
        def far(vectors):
            turned = jm.quaternion.multiply(motion.rotations, jm.quaternion.exp(vectors))
            return style_distance(motion.with_transforms(rotations=turned), style, root=False) ** 2

        value, slope = jax.value_and_grad(far)(vectors)
        return value, vectors - 20.0 * slope

    vectors, values = jnp.zeros((40, JOINTS, 3)), []
    for _ in range(150):
        value, vectors = step(vectors)
        values.append(float(value))
    assert values[-1] < 0.05 * values[0]


def test_names_and_weights():
    motion = swaying(9)
    style = motion_style(swaying(10), mean="karcher")
    other = motion_style(swaying(10, names=("hips", "spine", "ARM", "leg", "toe")), mean="karcher")
    with pytest.raises(ValueError, match="only one has"):
        style_distance(motion, other)
    agree = style_distance(motion, other, match="names")
    np.testing.assert_allclose(
        agree, style_distance(motion, style, joints=["hips", "spine", "leg"])
    )
    half = style_distance(motion, style, weights=(np.arange(40) < 20).astype(float), root=False)
    np.testing.assert_allclose(half, style_distance(motion[:20], style, root=False), rtol=1e-6)
    with pytest.raises(ValueError, match="weights have shape"):
        style_distance(motion, style, weights=np.ones(3))
    with pytest.raises(ValueError, match="no joint is left"):
        style_distance(motion, style, joints="hips", root=False)
