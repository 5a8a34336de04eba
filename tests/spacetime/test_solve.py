"""The oracle poses the same cost in numpy, with kinematics by matrices, for SciPy to minimise."""

from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from jaxmotion import Motion, Skeleton
from jaxmotion.contacts import ContactPoints, Contacts
from jaxmotion.spacetime import JointLimits, Weights, satisfy
from tests.helpers import angle_between, check_gradients, no_shape_checks, world_by_matrices

FRAMES, JOINTS = 6, 5
ACTIVE = (0, 1, 2, 3)  # joint 4 is above no contact point
WEIGHTS = Weights(position=1.0, floor=0.5, limits=0.7, size=1e-2, bend=1e-6, root=3.0)
FLOOR, RAMP = -1.75, 0.07


def case(dtype=np.float64, frames=FRAMES):
    """A two-bone leg below a root, moving smoothly, with an arm aside; one point on the foot's
    bone, one at the knee."""
    rng = np.random.default_rng(0)
    skeleton = Skeleton(
        ["root", "hip", "knee", "ankle", "arm"],
        [-1, 0, 1, 2, 0],
        np.array([[0, 0, 0], [0.2, 0, 0], [0, -1, 0], [0, -0.9, 0], [0, 1, 0]], dtype),
    )
    t = np.arange(frames)[:, None, None] / 30
    v = 0.3 * np.sin(6 * t + rng.uniform(0, 6, (1, JOINTS, 3)))
    q = Rotation.from_rotvec(v.reshape(-1, 3)).as_quat(scalar_first=True).reshape(-1, JOINTS, 4)
    root = np.concatenate([1.0 * t[:, 0], 0 * t[:, 0], 0 * t[:, 0]], -1)
    motion = Motion.from_root(
        skeleton, jnp.asarray(root, dtype), jnp.asarray(q, dtype), np.asarray(1 / 30, dtype)
    )
    points = ContactPoints(skeleton, [3, 2], np.array([[0.1, -0.1, 0.2], [0, 0, 0]]))
    mask = np.zeros((frames, 2), bool)
    mask[frames // 3 : frames // 3 + 2, 0], mask[-1:, 1] = True, True
    positions = points.positions(motion)
    shift = jnp.asarray([[0.1, -0.05, 0.05], [0.03, 0.02, -0.02]], dtype)
    return motion, Contacts(points, mask, positions + shift)


def limits_of(dtype=np.float64):
    return JointLimits(np.full((JOINTS, 3), -0.15), np.full((JOINTS, 3), 0.2)).astype(dtype)


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


class Oracle:
    """E of the module's docstring."""

    def __init__(self, motion, contacts, limits, floor, weights=WEIGHTS):
        self.motion, self.contacts, self.limits, self.floor = motion, contacts, limits, floor
        self.weights, self.start = (
            weights,
            Rotation.from_quat(np.asarray(motion.rotations).reshape(-1, 4), scalar_first=True),
        )
        # Limits move the arm too, by itself.
        self.joints = list(ACTIVE if limits is None else range(JOINTS))
        self.translations = np.array(motion.translations)
        self.skeleton = SimpleNamespace(
            parents=motion.skeleton.parents, end_joints=(), end_offsets=np.zeros((0, 3))
        )
        self.offsets = np.asarray(contacts.point)
        self.dt, self.frames = float(motion.frame_time), motion.num_frames
        # Neither point has a limb of its own: half the longest chain.
        self.length = 0.5 * (0.2 + 1 + 0.9)
        self.goal, self.weight = self.goals()

    def points(self, motion):
        position, turn, _ = world_by_matrices(motion)
        return np.stack(
            [
                position[:, j] + turn[:, j] @ p
                for j, p in zip(self.contacts.joints, self.offsets, strict=True)
            ],
            1,
        )

    def goals(self):
        y, target = self.points(self.motion), np.asarray(self.contacts.target)
        mask = np.asarray(self.contacts.mask)
        goal, weight = y.copy(), np.zeros(mask.shape)
        for t, c in np.ndindex(mask.shape):
            held = np.flatnonzero(mask[:, c])
            border = held[np.argmin(np.abs(held - t))]
            u = min(abs(border - t) * self.dt / RAMP, 1)
            goal[t, c] += target[border, c] - y[border, c]
            weight[t, c] = 1 - 3 * u**2 + 2 * u**3
        return np.where(mask[..., None], target, goal), weight

    def moved(self, delta):
        turn = np.zeros((self.frames, JOINTS, 3))
        turn[:, self.joints] = delta[:, 3:].reshape(self.frames, -1, 3)
        q = (self.start * Rotation.from_rotvec(turn.reshape(-1, 3))).as_quat(scalar_first=True)
        translations = self.translations.copy()
        translations[:, 0] += self.length * delta[:, :3]
        q = q.reshape(self.frames, JOINTS, 4)
        return SimpleNamespace(skeleton=self.skeleton, translations=translations, rotations=q)

    def residuals(self, flat):
        delta, w = flat.reshape(self.frames, -1), self.weights
        motion = self.moved(delta)
        y = self.points(motion)
        parts = [np.sqrt(w.position * self.weight)[..., None] * (y - self.goal) / self.length]
        if self.floor is not None:
            parts.append(np.sqrt(w.floor) * np.maximum(self.floor - y[..., 1], 0) / self.length)
        if self.limits is not None:
            v = Rotation.from_quat(
                motion.rotations[:, self.joints].reshape(-1, 4), scalar_first=True
            )
            v = v.as_rotvec().reshape(self.frames, -1, 3)
            rows = self.joints
            lower, upper = np.asarray(self.limits.lower), np.asarray(self.limits.upper)
            parts.append(np.sqrt(w.limits) * (v - np.clip(v, lower[rows], upper[rows])))
        stiff = np.sqrt(np.where(np.arange(delta.shape[1]) < 6, w.root, 1.0))
        parts.append(np.sqrt(w.size) * stiff * delta)
        parts.append(np.sqrt(w.bend) / self.dt**2 * stiff * np.diff(delta, n=2, axis=0))
        return np.concatenate([np.ravel(part) for part in parts])

    def minimum(self):
        start = np.zeros(self.frames * (3 + 3 * len(self.joints)))
        return least_squares(
            self.residuals, start, xtol=1e-13, ftol=1e-13, gtol=1e-11, max_nfev=100
        )


def difference(a, b):
    turned = angle_between(a.rotations, b.rotations).max()
    return max(turned, np.abs(np.asarray(a.translations) - np.asarray(b.translations)).max())


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
    motion, contacts = case()
    kept = eqx.tree_at(lambda c: c.target, contacts, contacts.points.positions(motion) + 1e-15)

    def missed(contacts):
        return jnp.sum(solve(motion, contacts)[1].position_error)

    np.testing.assert_array_equal(missed(kept), 0)
    slope = jax.grad(lambda x: missed(eqx.tree_at(lambda c: c.target, kept, x)))(kept.target)
    np.testing.assert_array_equal(slope, 0)


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
    want = oracle.minimum()
    answer, report = solve(motion, oracle.contacts)
    assert np.all(np.isfinite(answer.rotations))
    assert float(report.cost) <= want.cost * 1.01
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
    motion, contacts = case()
    aside = ContactPoints(motion.skeleton, [3, 4], contacts.point)  # all joints are active
    contacts = Contacts(aside, contacts.mask, aside.positions(motion) + 0.05)
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
def test_derivatives_in_motion_targets_limits_floor_and_weights():
    motion, contacts = case()

    def answer(root, q, target, lower, floor, size):
        moved = motion.with_transforms(motion.translations.at[:, 0].set(root), q)
        limits = eqx.tree_at(lambda x: x.lower, limits_of(), lower)
        weights = eqx.tree_at(lambda w: w.size, WEIGHTS, size)
        aimed = eqx.tree_at(lambda c: c.target, contacts, target)
        found, report = solve(moved, aimed, limits, floor, weights)
        return found.translations[:, 0], found.rotations, report.cost

    check_gradients(
        answer,
        motion.translations[:, 0],
        motion.rotations,
        contacts.target,
        limits_of().lower,
        jnp.asarray(FLOOR),
        jnp.asarray(WEIGHTS.size),
        rtol=2e-4,
        atol=2e-5,
        eps=1e-6,
    )


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
