"""Confining an edit: copies where it must, geodesics between, weights from names and ranges."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from jaxmotion import quaternion
from jaxmotion.confine import confine, selection_weights
from tests.helpers import (
    assert_finite_derivatives,
    assert_jit_and_vmap_agree,
    assert_same_rotation,
    assert_trees_close,
    check_gradients,
    random_motion,
    random_quaternions,
    random_skeleton,
)

T, J = 6, 4


@pytest.fixture
def clips(dtype):
    return pair(dtype)


def pair(dtype=np.float64, seed=0):
    """A clip, and one near it with some quaternions negated."""
    rng = np.random.default_rng(seed)
    a = random_motion(rng, T, J, dtype)
    b = random_motion(rng, T, a.skeleton, dtype)
    turned = quaternion.multiply(a.rotations, random_quaternions(rng, (T, J), dtype, angle=1.5))
    signs = jnp.asarray(rng.choice([-1.0, 1.0], (T, J, 1)), dtype)
    return a, b.with_transforms(rotations=signs * turned)


def test_zero_and_one_are_copies(clips):
    a, b = clips
    weight = np.zeros((T, J))
    weight[2:4, 1] = 1
    out = confine(a, b, weight)
    chosen = weight > 0
    np.testing.assert_array_equal(out.rotations[~chosen], a.rotations[~chosen])
    np.testing.assert_array_equal(out.translations[~chosen], a.translations[~chosen])
    np.testing.assert_array_equal(out.translations[chosen], b.translations[chosen])
    np.testing.assert_array_equal(np.abs(out.rotations[chosen]), np.abs(b.rotations[chosen]))
    assert jnp.all(jnp.sum(out.rotations * a.rotations, -1) > 0)
    assert out.dtype == a.dtype


def test_what_is_not_chosen_does_not_matter():
    a, b = pair()
    spoilt = b.with_transforms(b.translations.at[2].set(np.nan), b.rotations.at[2].set(np.nan))
    weight = (np.arange(T) != 2)[:, None]
    out = confine(a, spoilt, weight)
    np.testing.assert_array_equal(out.rotations[2], a.rotations[2])
    np.testing.assert_array_equal(out.translations[2], a.translations[2])


def test_between_is_slerp():
    a, b = pair()
    out = confine(a, b, 0.3)
    for t, j in np.ndindex(T, J):
        ends = Rotation.from_quat(
            np.stack([a.rotations[t, j], b.rotations[t, j]]), scalar_first=True
        )
        want = Slerp([0, 1], ends)(0.3).as_quat(scalar_first=True)
        assert_same_rotation(out.rotations[t, j], want, 1e-9)
    np.testing.assert_allclose(
        out.translations, 0.7 * a.translations + 0.3 * b.translations, atol=1e-12
    )


@pytest.mark.parametrize("shape", [(), (J,), (T, 1), (T, J)])
def test_weights_broadcast(shape):
    a, b = pair()
    weight = np.random.default_rng(1).uniform(size=shape)
    assert_trees_close(confine(a, b, weight), confine(a, b, np.broadcast_to(weight, (T, J))))


def test_wrong_shapes_are_refused():
    a, b = pair()
    with pytest.raises(ValueError, match="weight has shape"):
        confine(a, b, np.zeros(T))
    with pytest.raises(ValueError, match="must agree"):
        confine(a, b[:3], 0.5)


def test_jit_vmap_and_derivatives():
    a, b = pair()

    def run(ta, qa, tb, qb, weight):
        out = confine(a.with_transforms(ta, qa), b.with_transforms(tb, qb), weight)
        return out.translations, out.rotations

    weight = np.random.default_rng(2).uniform(0.2, 0.8, (T, J))
    args = (a.translations, a.rotations, b.translations, b.rotations, weight)
    assert_jit_and_vmap_agree(run, *args)
    check_gradients(run, *args)


def test_derivatives_are_finite_where_the_clips_agree():
    a, _ = pair()
    still = a[:2]
    assert_finite_derivatives(
        lambda q, w: confine(still, still.with_transforms(rotations=q), w).rotations,
        still.rotations,
        np.array([[0.0, 1.0, 0.5, 0.2], [1.0, 0.0, 0.3, 1.0]]),
    )


def test_gradient_passes_through_copies():
    a, b = pair()

    def total(q):
        return jnp.sum(confine(a, b.with_transforms(rotations=q), 1.0).rotations ** 2)

    assert jnp.any(jax.grad(total)(b.rotations) != 0)


def test_selection_by_name_and_strength():
    skeleton = random_skeleton(np.random.default_rng(0), J)
    weights = selection_weights(skeleton, T, joints=("JOINT1", "joint[23]"), strength=0.4)
    np.testing.assert_array_equal(weights, np.tile([0, 0.4, 0.4, 0.4], (T, 1)))
    with pytest.raises(ValueError, match="no joint matches"):
        selection_weights(skeleton, T, joints=("Tail*",))


def test_selection_by_frames_fades_inside_only():
    skeleton = random_skeleton(np.random.default_rng(0), 1)
    weights = selection_weights(skeleton, 20, frames=(5, 15), fade=3)[:, 0]
    assert np.all(weights[:5] == 0)
    assert np.all(weights[15:] == 0)
    np.testing.assert_array_equal(weights[8:12], 1)
    want = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, 4) / 4)
    np.testing.assert_allclose(weights[5:8], want)
    np.testing.assert_allclose(weights[12:15], want[::-1])


def test_selection_at_the_ends_does_not_fade():
    skeleton = random_skeleton(np.random.default_rng(0), 1)
    assert np.all(selection_weights(skeleton, 20, fade=5) == 1)
    weights = selection_weights(skeleton, 20, frames=(None, 10), fade=5)[:, 0]
    assert np.all(weights[:5] == 1)
    assert weights[9] < 0.1
    assert selection_weights(skeleton, 20, frames=(9, 10), fade=5)[9, 0] == 1
    assert selection_weights(skeleton, 20, frames=(-5, None), fade=0)[:, 0].sum() == 5


@pytest.mark.parametrize(
    "bad", [{"frames": (7, 7)}, {"frames": (30, None)}, {"fade": -1}, {"strength": 1.5}]
)
def test_selection_refuses(bad):
    skeleton = random_skeleton(np.random.default_rng(0), 1)
    with pytest.raises(ValueError):
        selection_weights(skeleton, 20, **bad)


def test_a_range_without_frames_is_named():
    skeleton = random_skeleton(np.random.default_rng(0), 3)
    with pytest.raises(ValueError, match=r"selection_weights: frames=\(5, 5\); the range leaves"):
        selection_weights(skeleton, 20, frames=(5, 5))
