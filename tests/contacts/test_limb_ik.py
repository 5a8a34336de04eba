"""Two-bone limbs against geometry, quadrature and finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from jaxmotion.contacts import limb_ik
from jaxmotion.quaternion import rotate
from tests.helpers import (
    assert_finite_derivatives,
    assert_jit_and_vmap_agree,
    check_gradients,
    no_shape_checks,
    random_quaternions,
    random_vectors,
)

N = 200


def limbs(seed=0, dtype=np.float64):
    rng = np.random.default_rng(seed)
    root, a, b, c = (random_vectors(rng, (N,), dtype) for _ in range(4))
    return root, root + a, root + a + b, root + c


def norm(v):
    return np.linalg.norm(np.asarray(v, np.float64), axis=-1)


def posed(root, middle, end, turn):
    """The limb turned, by SciPy."""

    def turned(q, v):
        return Rotation.from_quat(np.array(q, np.float64), scalar_first=True).apply(v)

    a, b = (np.array(v, np.float64) for v in (middle - root, end - middle))
    size = np.asarray(turn.scale, np.float64)[:, None]
    knee = np.asarray(root, np.float64) + size * turned(turn.root, a)
    return knee, knee + size * turned(turn.middle, b)


@pytest.mark.parametrize("stretch", [0.0, 0.05])
def test_the_end_meets_what_it_can_reach_and_comes_near_what_it_cannot(dtype, stretch):
    root, middle, end, target = limbs(dtype=dtype)
    turn = limb_ik(root, middle, end, target, stretch=stretch)
    upper, lower, apart = norm(middle - root), norm(end - middle), norm(target - root)
    most = 1 + stretch
    far = np.maximum(apart - most * (upper + lower), np.abs(upper - lower) / most - apart)
    tolerance = 1e-5 if dtype == np.float32 else 1e-12
    _, reached = posed(root, middle, end, turn)
    assert turn.end.dtype == dtype
    np.testing.assert_allclose(reached, turn.end, atol=tolerance)
    np.testing.assert_allclose(norm(turn.end - target), np.maximum(far, 0), atol=2 * tolerance)
    assert np.mean(far < 0) > 0.5
    scale = np.asarray(turn.scale)
    assert scale.max() <= most + 1e-6
    assert scale.min() >= 1 / most - 1e-6


def test_a_limb_at_its_target_stays():
    root, middle, end, _ = limbs()
    turn = limb_ik(root, middle, end, end)
    np.testing.assert_allclose(np.abs(turn.root[:, 0]), 1, atol=1e-12)
    np.testing.assert_allclose(np.abs(turn.middle[:, 0]), 1, atol=1e-12)


def test_targets_along_the_limb_keep_its_plane():
    """Swivel: with the target on the line to the end, the knee stays in the limb's plane."""
    root, middle, end, _ = limbs(1)
    turn = limb_ik(root, middle, end, root + 0.8 * (end - root))
    knee, _ = posed(root, middle, end, turn)
    normal = np.cross(middle - root, end - root)
    np.testing.assert_allclose(np.sum((knee - root) * normal, -1), 0, atol=1e-10)
    side = np.sum(np.cross(knee - root, end - root) * normal, -1)
    assert np.all(side > -1e-9), "the knee bends to its own side"


def test_turning_everything_turns_the_answer():
    given = limbs(2)
    q = random_quaternions(np.random.default_rng(3))
    turn = limb_ik(*given)
    other = limb_ik(*(rotate(q, p) for p in given))
    np.testing.assert_allclose(other.end, rotate(q, turn.end), atol=1e-10)


@pytest.mark.parametrize("reach", [1.7, 1.9, 1.97, 1.999, 2.0])
def test_damping_is_the_integral_and_the_bones_make_up_for_it(reach):
    """Kovar's θ₀ + ∫ f by quadrature, f = 2t³ − 3t² + 1 beyond ρ."""
    start, rho = 2.6, 2.8

    def f(x):
        t = np.clip((x - rho) / (np.pi - rho), 0, 1)
        return 2 * t**3 - 3 * t**2 + 1

    root, middle = np.zeros(3), np.array([0.0, -1, 0])
    end = middle + np.array([np.sin(start), np.cos(start), 0])
    goal = reach * np.array([0.6, -0.8, 0])
    turn = limb_ik(root, middle, end, goal, stretch=0.1, straight=rho)
    wanted = np.arccos(np.clip(1 - reach**2 / 2, -1, 1))
    angle = start + quad(f, start, wanted, epsabs=1e-12)[0]
    scale = reach / np.sqrt(2 - 2 * np.cos(angle))
    np.testing.assert_allclose(turn.scale, scale, rtol=1e-9)
    np.testing.assert_allclose(turn.end, goal, atol=1e-9)


def test_the_hinge_decides_how_a_straight_limb_bends():
    root, middle, end = np.zeros(3), np.array([0.0, -1, 0]), np.array([0.0, -2, 0])
    for side in (1.0, -1.0):
        hinge = np.array([0, 0, side])
        turn = limb_ik(root, middle, end, np.array([0.0, -1.5, 0]), hinge=hinge)
        knee = rotate(turn.root, middle)
        np.testing.assert_allclose(knee, [-side * np.sqrt(1 - 0.75**2), -0.75, 0], atol=1e-12)


def test_gradients_and_transforms():
    given = [p[:6] for p in limbs(4)]
    reachable = given[0] + 0.5 * (given[3] - given[0])

    def f(root, middle, end, target):
        return limb_ik(root, middle, end, target, stretch=0.02)

    check_gradients(f, *given[:3], reachable, rtol=1e-5, atol=1e-5, eps=1e-6)
    assert_jit_and_vmap_agree(f, *given[:3], reachable, rtol=1e-9, atol=1e-9)


STRAIGHT = ([0.0, 0, 0], [0.0, -1, 0], [0.0, -2, 0])
NEARLY_STRAIGHT = ([0.1, 0.9, 0.3], [0.12, 0.48, 0.31], [0.14, 0.06, 0.32])
BENT = ([0.0, 0, 0], [0.0, -1, 0.3], [0.0, -2, 0])
SINGULAR = {
    "full extension": (*STRAIGHT, [0.0, -2, 0]),
    "from full extension": (*STRAIGHT, [0.3, -1.5, 0]),
    "out of reach": (*BENT, [0.0, -3, 0]),
    "target at the root": (*BENT, [0.0, 0, 0]),
    "end at the root": ([0.0, 0, 0], [0.0, -1, 0], [0.0, 0, 0], [0.5, 0, 0]),
    "no upper bone": ([0.0, 0, 0], [0.0, 0, 0], [0.0, -1, 0], [0.5, -0.5, 0]),
    "no lower bone": ([0.0, 0, 0], [0.0, -1, 0], [0.0, -1, 0], [0.5, -0.5, 0]),
    "no bones": ([0.0, 0, 0],) * 4,
    "target behind": (*BENT, [0.0, 2, 0]),
}


def test_singular_places_have_finite_derivatives():
    points = [jnp.array(p) for p in zip(*SINGULAR.values(), strict=True)]
    given = [jnp.concatenate([p, p]) for p in points]
    stretch = jnp.repeat(jnp.array([0.0, 0.05]), len(SINGULAR))

    def f(root, middle, end, target, stretch):
        return limb_ik(root, middle, end, target, stretch=stretch)

    @jax.jit
    @jax.vmap
    def everything(*given):
        numbers = (0, 1, 2, 3)
        return f(*given), jax.jacfwd(f, numbers)(*given), jax.jacrev(f, numbers)(*given)

    for leaf in jax.tree.leaves(everything(*given, stretch)):
        bad = ~np.isfinite(leaf).reshape(2, len(SINGULAR), -1).all((0, 2))
        assert not bad.any(), np.array(list(SINGULAR))[bad]


@pytest.mark.parametrize("hinge", [None, np.array([1.0, 0, 0])])
def test_a_limb_that_is_straight_but_for_rounding_takes_no_axis_from_it(hinge):
    root, middle, end = map(np.asarray, NEARLY_STRAIGHT)
    assert 0 < norm(np.cross(middle - root, end - middle)) < 1e-16
    jacobian = assert_finite_derivatives(
        lambda *points: limb_ik(*points, hinge=hinge), root, middle, end, np.array([0.2, 0.2, 0.5])
    )
    assert max(np.abs(x).max() for x in jax.tree.leaves(jacobian)) < 20


def test_points_need_three_components():
    with no_shape_checks(), pytest.raises(ValueError, match="target must have shape"):
        limb_ik(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))
