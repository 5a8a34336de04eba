"""The whole solver against SciPy on the same cost; ``everything`` is compiled once for all that
need derivatives."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmotion.contacts import ContactPoints, Contacts
from jaxmotion.spacetime import JointLimits, Weights, satisfy
from tests.helpers import angle_between, no_shape_checks
from tests.spacetime.scene import (
    FLOOR,
    FRAMES,
    RAMP,
    WEIGHTS,
    Oracle,
    case,
    difference,
    limits_of,
)


def solve(motion, contacts, limits=None, floor=None, weights=WEIGHTS, **options):
    return satisfy(
        motion,
        contacts,
        joint_limits=limits,
        floor=floor,
        weights=weights,
        ramp=RAMP,
        **{"tolerance": 1e-9 if motion.dtype == jnp.float64 else 1e-5, "max_steps": 200} | options,
    )


def all_active():
    """The scene with a contact aside: all joints are active."""
    motion, contacts = case()
    points = ContactPoints(motion.skeleton, [3, 4], contacts.point)
    return motion, Contacts(points, contacts.mask, points.positions(motion) + 0.05)


def givens(motion, contacts):
    """What ``everything`` takes and differentiates in."""
    limits = limits_of()
    return {
        "root": motion.translations[:, 0],
        "q": motion.rotations,
        "target": contacts.target,
        "lower": limits.lower,
        "upper": limits.upper,
        "floor": jnp.asarray(FLOOR, float),
        "size": jnp.asarray(WEIGHTS.size, float),
    }


def smooth(motion, report):
    """What is differentiated."""
    return {
        "root": motion.translations[:, 0],
        "q": motion.rotations,
        "cost": report.cost,
        "error": report.position_error,
    }


@functools.partial(jax.jit, static_argnums=0)
def everything(scene, given, tangent, cotangent):
    """The answer and its report; the derivative of ``smooth`` along the tangent, and the slopes of
    its product with the cotangent."""
    motion, contacts = scene()

    def function(given):
        moved = motion.with_transforms(motion.translations.at[:, 0].set(given["root"]), given["q"])
        limits = JointLimits(given["lower"], given["upper"])
        weights = eqx.tree_at(lambda w: w.size, WEIGHTS, given["size"])
        aimed = eqx.tree_at(lambda c: c.target, contacts, given["target"])
        answer = solve(moved, aimed, limits, given["floor"], weights)
        return smooth(*answer), answer

    _, forward, answer = jax.linearize(function, given, has_aux=True)
    (slopes,) = jax.linear_transpose(forward, given)(cotangent)
    return answer, forward(tangent), slopes


def zeros():
    """A tangent and a cotangent of ``everything``."""
    motion, contacts = case()
    none = jnp.zeros(contacts.mask.shape)
    tangent = givens(motion, contacts)
    cotangent = {"root": tangent["root"], "q": tangent["q"], "cost": jnp.zeros(()), "error": none}
    return jax.tree.map(jnp.zeros_like, (tangent, cotangent))


@pytest.mark.parametrize("asked", ["contacts", "everything"])
def test_the_answer_is_scipys(asked):
    motion, contacts = case()
    extra = (limits_of(), FLOOR) if asked == "everything" else (None, None)
    oracle = Oracle(motion, contacts, *extra)
    want = oracle.minimum()
    answer, report = solve(motion, contacts, *extra)
    assert bool(report.converged)
    np.testing.assert_allclose(report.cost_before, 0.5 * np.sum(oracle.residuals(0 * want.x) ** 2))
    np.testing.assert_allclose(report.cost, want.cost, rtol=1e-7)
    assert difference(answer, oracle.moved(want.x.reshape(FRAMES, -1))) < 1e-4
    miss = np.linalg.norm(oracle.points(answer) - contacts.target, axis=-1)
    np.testing.assert_allclose(report.position_error, np.where(contacts.mask, miss, 0), atol=1e-9)
    if asked == "everything":
        depth = np.maximum(FLOOR - oracle.points(answer)[..., 1], 0)
        np.testing.assert_allclose(report.penetration, depth, atol=1e-9)
        excess = np.linalg.norm(extra[0].excess(answer.rotations), axis=-1)
        np.testing.assert_allclose(report.limit_excess, excess, atol=1e-9)
        assert oracle.residuals(0 * want.x)[oracle.weight.size * 3 :].max() > 0.05  # all matter


def test_contacts_are_met_and_the_rest_is_left_alone(dtype):
    motion, contacts = case(dtype)
    before = jax.tree.map(np.array, (motion, contacts))
    firm = Weights(position=1.0, size=1e-6, bend=1e-10)
    answer, report = solve(motion, contacts, weights=firm)
    assert answer.rotations.dtype == report.position_error.dtype == dtype
    assert bool(report.converged)
    assert float(report.position_error.max()) < 1e-4
    np.testing.assert_array_equal(answer.rotations[:, 4], motion.rotations[:, 4])
    np.testing.assert_array_equal(answer.translations[:, 1:], motion.translations[:, 1:])
    for a, b in zip(jax.tree.leaves(before), jax.tree.leaves((motion, contacts)), strict=True):
        np.testing.assert_array_equal(a, b)


def test_contacts_already_kept_change_nothing():
    motion, contacts = case()
    kept = eqx.tree_at(lambda c: c.target, contacts, contacts.points.positions(motion))
    answer, report = solve(motion, kept)
    assert difference(answer, motion) < 1e-12
    assert float(report.cost) < 1e-25


def test_a_miss_of_rounding_size_is_none():
    """Its direction would be rounding's, and so would be a derivative of size one along it."""
    motion, contacts = all_active()
    given = givens(motion, contacts)
    given["target"] = contacts.points.positions(motion) + 1e-15
    far = {"lower": -10.0, "upper": 10.0, "floor": -100.0}
    given |= {name: jnp.full_like(given[name], value) for name, value in far.items()}
    tangent, cotangent = zeros()
    cotangent["error"] = jnp.ones_like(cotangent["error"])
    (_, report), _, slopes = everything(all_active, given, tangent, cotangent)
    np.testing.assert_array_equal(report.position_error, 0)
    np.testing.assert_array_equal(slopes["target"], 0)


def test_a_joint_that_never_turns_does_not_start_to():
    motion, contacts = case()
    fixed = motion.with_transforms(rotations=motion.rotations.at[:, 1].set(motion.rotations[0, 1]))
    answer, report = solve(fixed, contacts)
    assert bool(report.converged)
    turned = angle_between(answer.rotations, fixed.rotations).max(axis=0)
    assert turned[1] < 1e-6
    assert turned[2] > 1e-3


def test_unreachable_and_contradictory_targets_get_the_compromise():
    motion, contacts = case()
    far = contacts.target.at[:, 0].add(jnp.asarray([9.0, 3.0, 0.0]))
    oracle = Oracle(motion, eqx.tree_at(lambda c: c.target, contacts, far), None, None)
    want = oracle.minimum(steps=40)  # then 1 + 4e-4 of what it goes on to
    answer, report = solve(motion, oracle.contacts)
    assert np.all(np.isfinite(answer.rotations))
    assert float(report.cost) <= want.cost * 1.009
    assert float(report.position_error.max()) > 0.1


def test_no_contacts_at_all():
    motion, contacts = case()
    never = eqx.tree_at(lambda c: c.mask, contacts, jnp.zeros_like(contacts.mask))
    nowhere = eqx.tree_at(lambda c: c.target, never, jnp.full_like(never.target, jnp.nan))
    answer, report = solve(motion, nowhere)
    assert difference(answer, motion) == 0
    assert float(report.cost) == 0
    nobody = Contacts(
        ContactPoints(motion.skeleton, []), np.zeros((FRAMES, 0), bool), np.zeros((FRAMES, 0, 3))
    )
    answer, report = solve(motion, nobody)
    assert difference(answer, motion) == 0
    assert report.position_error.shape == (FRAMES, 0)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_short_clips(frames):
    motion, contacts = case(frames=frames)
    answer, report = solve(motion, contacts)
    assert np.all(np.isfinite(answer.rotations))
    assert float(report.cost) < float(report.cost_before)


def test_splines_meet_contacts(dtype):
    motion, contacts = case(dtype, frames=24)
    answer, report = solve(motion, contacts, method="hierarchical")
    assert answer.rotations.dtype == dtype
    assert float(report.position_error.max()) < 1e-3
    np.testing.assert_array_equal(answer.rotations[:, 4], motion.rotations[:, 4])
    kept = eqx.tree_at(lambda c: c.target, contacts, contacts.points.positions(motion))
    assert difference(solve(motion, kept, method="hierarchical")[0], motion) < 1e-4
    far = eqx.tree_at(lambda c: c.target, contacts, contacts.target + 9)
    answer, report = solve(motion, far, method="hierarchical")
    assert np.all(np.isfinite(answer.rotations))
    assert float(report.cost) < float(report.cost_before)


@pytest.mark.slow
def test_bounds_and_firm_limits_agree_and_bounds_are_never_crossed():
    motion, contacts = all_active()
    firm = eqx.tree_at(lambda w: w.limits, WEIGHTS, 1e3)
    soft, _ = solve(motion, contacts, limits_of(), weights=firm, tolerance=1e-8, max_steps=500)
    hard, report = solve(
        motion, contacts, limits_of(), method="bounds", tolerance=1e-8, max_steps=3000
    )
    assert bool(report.converged)
    assert float(report.limit_excess.max()) < 1e-12
    assert difference(soft, hard) < 2e-4
    turns = limits_of().turns(hard.rotations)[:, 1:]  # the root too is limited, the others suffice
    assert np.isclose(np.abs(turns - 0.025), 0.175, atol=1e-9).any()  # the limits matter

    def answer(target):
        aimed = eqx.tree_at(lambda c: c.target, contacts, target)
        return solve(motion, aimed, limits_of(), method="bounds")[0].rotations

    with pytest.raises(Exception, match="bounds"):
        jax.eval_shape(lambda x: jax.jvp(answer, (x,), (x,)), contacts.target)


def test_rotating_and_moving_the_world_moves_the_answer():
    motion, contacts = case()
    turn = Rotation.from_rotvec([0.3, -1.0, 0.7])
    shift = np.array([3.0, -1.0, 2.0])
    q = turn * Rotation.from_quat(np.asarray(motion.rotations[:, 0]), scalar_first=True)
    place = turn.apply(np.array(motion.translations[:, 0])) + shift
    elsewhere = motion.with_transforms(
        motion.translations.at[:, 0].set(place),
        motion.rotations.at[:, 0].set(q.as_quat(scalar_first=True)),
    )
    target = (
        turn.apply(np.array(contacts.target).reshape(-1, 3)).reshape(contacts.target.shape) + shift
    )
    answer, _ = solve(motion, contacts)
    there, _ = solve(elsewhere, eqx.tree_at(lambda c: c.target, contacts, jnp.asarray(target)))
    assert angle_between(answer.rotations[:, 1:], there.rotations[:, 1:]).max() < 1e-7
    moved = turn.apply(np.array(answer.translations[:, 0])) + shift
    np.testing.assert_allclose(there.translations[:, 0], moved, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene",
    [all_active, pytest.param(case, marks=pytest.mark.sweep)],  # with a joint by itself
)
def test_derivatives_in_motion_targets_limits_floor_and_weights(scene):
    given, rng, eps = givens(*scene()), np.random.default_rng(0), 1e-6
    tangent, cotangent = jax.tree.map(lambda x: jnp.asarray(rng.standard_normal(x.shape)), zeros())

    def moved(h):
        (motion, report), forward, slopes = everything(
            scene, jax.tree.map(lambda x, v: x + h * v, given, tangent), tangent, cotangent
        )
        return smooth(motion, report), forward, slopes

    (beyond, _, _), (before, _, _), (_, forward, slopes) = moved(eps), moved(-eps), moved(0.0)
    numeric = jax.tree.map(lambda a, b: (a - b) / (2 * eps), beyond, before)
    close = functools.partial(np.testing.assert_allclose, rtol=2e-4, atol=2e-5)
    for name, want in numeric.items():
        close(forward[name], want, err_msg=f"forward mode: {name}")

    def inner(a, b):
        return sum(np.vdot(a[name], b[name]) for name in a)

    close(inner(slopes, tangent), inner(cotangent, numeric), err_msg="reverse mode")


def test_mapped_over_clips():
    motion, contacts = case()
    other = contacts.target + 0.03
    both = jnp.stack([contacts.target, other])
    mapped = jax.jit(
        jax.vmap(lambda t: solve(motion, eqx.tree_at(lambda c: c.target, contacts, t))[0].rotations)
    )(both)
    for target, q in zip(both, mapped, strict=True):
        alone, _ = solve(motion, eqx.tree_at(lambda c: c.target, contacts, target))
        np.testing.assert_allclose(q, alone.rotations, atol=1e-8)


def test_what_does_not_fit_is_refused():
    motion, contacts = case()
    with no_shape_checks():
        with pytest.raises(ValueError, match="method='magic'"):
            satisfy(motion, contacts, method="magic")  # pyright: ignore
        with pytest.raises(ValueError, match="contacts have 6 frames, the motion 4"):
            satisfy(motion[:4], contacts)
        with pytest.raises(ValueError, match="joint_limits has 2 joints, the motion 5"):
            satisfy(motion, contacts, joint_limits=limits_of().of((0, 1)))
        with pytest.raises(ValueError, match="vmap"):
            satisfy(jax.tree.map(lambda x: x[None], motion), contacts)


def test_targets_that_are_not_finite_are_refused():
    motion, contacts = case()
    broken = eqx.tree_at(lambda c: c.target, contacts, contacts.target.at[2, 0, 0].set(jnp.nan))
    with pytest.raises(Exception, match="targets that are not finite"):
        jax.block_until_ready(solve(motion, broken))
