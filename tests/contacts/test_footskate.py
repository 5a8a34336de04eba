"""Footskate cleanup: planted points stay, everything else stays as it was."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

import jaxmotion as jm
from jaxmotion import quaternion
from jaxmotion.contacts import (
    ContactPoints,
    Contacts,
    cleanup_footskate,
    detect,
    find_feet,
    footskate,
    limb_lengths,
    replant,
)
from jaxmotion.metrics import foot_skate, penetration, world_positions
from tests.helpers import angle_between, check_gradients, no_shape_checks

FRAMES = 60


@pytest.fixture(scope="module")
def skating():
    """A walk whose root drifts, the contacts it had, and those contacts on the drifting clip."""
    walk = jm.samples.walk(FRAMES, fps=30.0).motion
    slid = jm.samples.slide_root(walk, jax.random.key(0), amount=0.2).motion
    contacts = detect(walk)
    return slid, contacts, replant(slid, contacts)


def errors(motion, contacts):
    """Distance of planted points from their targets over limb length."""
    off = np.linalg.norm(contacts.points.positions(motion) - contacts.target, axis=-1)
    return np.where(contacts.mask, off / limb_lengths(motion, contacts.points), 0)


@pytest.mark.parametrize("stretch", [0.0, 0.03])
def test_planted_points_stay(skating, stretch):
    motion, contacts, own = skating
    for wanted in (contacts, own):
        clean = cleanup_footskate(motion, wanted, stretch=stretch)
        assert foot_skate(clean, wanted) < 0.01 * foot_skate(motion, wanted)
        assert np.isfinite(clean.rotations).all()
    clean = cleanup_footskate(motion, contacts, stretch=stretch)
    assert errors(clean, contacts).max() < 0.002
    assert clean.translated_joints == ((0, 15, 16, 19, 20) if stretch else (0,))
    lengths = np.linalg.norm(clean.translations[:, [15, 16, 19, 20]], axis=-1)
    rest = np.linalg.norm(motion.skeleton.offsets[jnp.array([15, 16, 19, 20])], axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(rest, lengths.shape), rtol=stretch + 1e-9)


def test_a_foot_s_turn_fades_from_contact_to_contact(skating):
    """The root sways to and fro by 0.2 rad, and planted feet are turned back by as much: not at
    once, but over the fade."""
    motion, contacts, _ = skating
    up = np.array([0.0, 1.0, 0.0])
    sway = quaternion.exp(0.2 * np.sin(np.arange(FRAMES) / 6.0)[:, None] * up)
    swaying = motion.with_transforms(
        rotations=motion.rotations.at[:, 0].set(quaternion.multiply(sway, motion.rotations[:, 0]))
    )
    feet = sorted({limb[2] for limb in contacts.points.limbs})

    def turns(fade):
        clean = cleanup_footskate(swaying, contacts, fade=fade)
        after, before = (jm.forward_kinematics(m).rotations[:, feet] for m in (clean, swaying))
        return np.asarray(quaternion.log(quaternion.between(before, after)))

    size = np.linalg.norm(turns(0.15), axis=-1).max()
    assert size > 0.15
    faded, sudden = (
        np.linalg.norm(np.diff(turns(fade), axis=0), axis=-1).max() for fade in (0.15, 1e-3)
    )
    assert faded < 0.4 * size < 0.8 * size < sudden


def test_what_is_not_near_a_contact_is_untouched(skating):
    """Joints off the legs, bit for bit; the legs wherever no contact is within the fade."""
    motion, _, own = skating
    first = np.zeros((FRAMES, 4), bool)
    first[:8] = np.asarray(own.mask)[:8]
    few = Contacts(own.points, first, own.target)
    clean = cleanup_footskate(motion, few)
    legs = [14, 15, 16, 18, 19, 20]
    others = [j for j in range(motion.num_joints) if j not in legs]
    np.testing.assert_array_equal(clean.rotations[:, others], motion.rotations[:, others])
    np.testing.assert_array_equal(clean.rotations[14:], motion.rotations[14:])
    assert np.abs(clean.rotations[:8, legs] - motion.rotations[:8, legs]).max() > 1e-4
    np.testing.assert_array_equal(clean.translations[:, 1:], motion.translations[:, 1:])


def test_a_clip_without_skate_hardly_changes():
    walk = jm.samples.walk(FRAMES, fps=30.0)
    points = ContactPoints(walk.motion.skeleton, walk.contact_joints[:2], walk.contact_offsets[:2])
    truth = Contacts(points, walk.contacts[:, :2], walk.contact_positions[:, :2])
    clean = cleanup_footskate(walk.motion, truth)
    assert angle_between(clean.rotations, walk.motion.rotations).max() < 0.02
    np.testing.assert_allclose(clean.translations, walk.motion.translations, atol=2e-3)


def test_no_contacts_and_no_feet(skating):
    motion, contacts, _ = skating
    none = Contacts(contacts.points, np.zeros((FRAMES, 4), bool), contacts.target)
    same = cleanup_footskate(motion, none)
    np.testing.assert_array_equal(same.rotations, motion.rotations)
    np.testing.assert_array_equal(same.translations, motion.translations)
    nothing = detect(motion, joints=[])
    assert cleanup_footskate(motion, nothing) is motion


def test_contradictory_and_unreachable_targets_have_a_finite_answer(skating):
    motion, contacts, _ = skating
    apart = np.array(contacts.target)
    apart[:, :2] += [5.0, 0, 0]
    apart[:, 2:] -= [5.0, 0, 0]
    all_down = np.ones((FRAMES, 4), bool)
    clean = cleanup_footskate(motion, Contacts(contacts.points, all_down, apart))
    for part in (clean.rotations, clean.translations):
        assert np.isfinite(part).all()
    ankles = jm.forward_kinematics(clean).positions[:, [16, 20]]
    assert np.all(np.sign(ankles[..., 0]) == [1, -1]), "each leg points at its target"


def test_feet_are_kept_above_a_floor(skating):
    motion, _, own = skating
    low = motion.with_transforms(motion.translations.at[:, 0, 1].add(-0.03))
    before = penetration(low, own.points)
    clean = cleanup_footskate(low, own, floor=0.0)
    free = ~np.asarray(own.mask)
    assert np.where(free, before, 0).max() > 0.02
    assert np.where(free, penetration(clean, own.points), 0).max() < 0.004


def test_padding_does_not_matter(skating):
    motion, contacts, _ = skating
    short = jax.tree.map(lambda x: x[:45] if x.shape[:1] == (FRAMES,) else x, contacts)
    want = cleanup_footskate(motion[:45], short)
    got = cleanup_footskate(motion, contacts, length=45)
    np.testing.assert_allclose(got.translations[:45], want.translations, atol=1e-9)
    np.testing.assert_allclose(got.rotations[:45], want.rotations, atol=1e-8)


def test_single_precision_jit_and_vmap(skating):
    motion, contacts, own = skating
    want = cleanup_footskate(motion, contacts)
    single = jax.tree.map(
        lambda x: x.astype(np.float32) if x.dtype == np.float64 else x, (motion, contacts)
    )
    got = cleanup_footskate(*single)
    assert got.rotations.dtype == got.translations.dtype == np.float32
    assert angle_between(got.rotations, want.rotations).max() < 2e-2
    both = jax.tree.map(lambda a, b: jnp.stack([a, b]), contacts, own)
    mapped = eqx.filter_jit(jax.vmap(lambda c: cleanup_footskate(motion, c)))(both)
    np.testing.assert_allclose(mapped.rotations[0], want.rotations, atol=1e-8)
    other = cleanup_footskate(motion, own)
    np.testing.assert_allclose(mapped.rotations[1], other.rotations, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("stretch", [0.0, pytest.param(0.03, marks=pytest.mark.sweep)])
def test_gradients(stretch):
    """Far from knees at full length, where a root that must move adds kinks."""
    walk = jm.samples.walk(12, fps=30.0).motion
    low = walk.with_transforms(walk.translations.at[:, 0, 1].add(-0.05))
    contacts = detect(walk, points=find_feet(walk))

    def f(target, rotations):
        wanted = eqx.tree_at(lambda c: c.target, contacts, contacts.target + target)
        moved = low.with_transforms(rotations=low.rotations + rotations)
        clean = cleanup_footskate(moved, wanted, stretch=stretch)
        return clean.rotations, clean.translations

    rng = np.random.default_rng(0)
    target = 1e-3 * rng.standard_normal(contacts.target.shape)
    rotations = 1e-3 * rng.standard_normal(low.rotations.shape)
    check_gradients(f, target, rotations, rtol=1e-4, atol=1e-4, eps=1e-7)


def test_derivatives_are_finite_where_bones_stretch_most_and_straight_knees_hang():
    """Feet far away, under the hips and at them; legs that hang straight in a still clip."""
    walk = jm.samples.walk(3, fps=30.0).motion
    rotations = jnp.broadcast_to(jnp.array([1.0, 0, 0, 0]), walk.rotations.shape)
    still = walk.with_transforms(jnp.broadcast_to(walk.translations[:1], (3, 22, 3)), rotations)
    points = find_feet(still)
    hips = jm.forward_kinematics(still).positions[:, [limb[0] for limb in points.limbs]]
    own = points.positions(still)
    down = np.ones((3, 4), bool)
    run = eqx.filter_jit(
        lambda motion, target: jax.jacrev(
            lambda t: (
                cleanup_footskate(motion, Contacts(points, down, t), stretch=0.03).translations
            )
        )(target)
    )
    for target in (own, own + jnp.array([5.0, 0, 0]), own - jnp.array([0, 1e-9, 0]), hips):
        assert np.isfinite(run(still, target)).all()


def test_straight_legs_have_moderate_gradients():
    """Straight but for rounding throughout, so that no frame shows how the knees bend."""
    names = ("Hips", "LeftUpLeg", "LeftLeg", "LeftFoot")
    offsets = np.array([[0.1, 0.9, 0.3], [0.1, -0.05, 0], [0.02, -0.42, 0.01], [0.02, -0.42, 0.01]])
    skeleton = jm.Skeleton(names, (-1, 0, 1, 2), offsets)
    motion = jm.Motion.from_root(
        skeleton,
        np.array([[0.013, 0.927, 0.31], [0.11, 1.1, 0.7]]),
        quaternion.identity((2, 4)),
        1 / 30,
    )
    points = ContactPoints(skeleton, [3])
    hip, knee, ankle = np.moveaxis(np.asarray(world_positions(motion))[:, 1:4], 1, 0)
    assert 0 < np.abs(np.cross(knee - hip, ankle - knee)).max() < 1e-15
    raised = points.positions(motion) + np.array([0, 0.3, 0.1])
    contacts = Contacts(points, np.ones((2, 1), bool), raised)

    def cleaned(rotations):
        return cleanup_footskate(motion.with_transforms(rotations=rotations), contacts).rotations

    jacobian = jax.jacrev(cleaned)(motion.rotations)
    assert np.abs(jacobian).max() < 100


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_tiny_clips(skating, frames):
    motion, contacts, _ = skating
    few = jax.tree.map(lambda x: x[:frames] if x.shape[:1] == (FRAMES,) else x, contacts)
    clean = cleanup_footskate(motion[:frames], few)
    assert errors(clean, few).max() < 0.002


def test_nearest_point_of_two_balls_by_slsqp(monkeypatch):
    monkeypatch.setattr(footskate, "_CYCLES", 3000)
    rng = np.random.default_rng(1)
    count = 20
    center = 0.4 * rng.standard_normal((count, 2, 3))
    reach = rng.uniform(0.6, 1.0, (count, 2))
    start = rng.standard_normal((count, 3))
    planted = rng.uniform(size=(count, 2)) < 0.8
    got = footskate._nearest(*(jnp.asarray(a) for a in (start, center, reach, planted)))
    for i in range(count):
        limits = [
            {"type": "ineq", "fun": lambda x, c=c, r=r: r**2 - np.sum((x - c) ** 2)}
            for c, r, on in zip(center[i], reach[i], planted[i], strict=True)
            if on
        ]
        want = minimize(
            lambda x, i=i: np.sum((x - start[i]) ** 2), start[i], constraints=limits, tol=1e-12
        ).x
        np.testing.assert_allclose(got[i], want, atol=1e-3)


def test_what_is_refused(skating):
    motion, contacts, _ = skating
    skeleton = motion.skeleton
    with no_shape_checks(), pytest.raises(ValueError, match="contacts have 60 frames, the motion"):
        cleanup_footskate(motion[:30], contacts)
    spine = ContactPoints(skeleton, ["Spine"])
    wanted = Contacts(spine, np.ones((FRAMES, 1), bool), np.zeros((FRAMES, 1, 3)))
    with pytest.raises(ValueError, match="'Spine' hangs from no two-bone limb"):
        cleanup_footskate(motion, wanted)
    crossed = ContactPoints(
        skeleton, ["LeftFoot", "LeftToeBase"], limbs=[(14, 15, 16), (15, 16, 17)]
    )
    wanted = Contacts(crossed, np.ones((FRAMES, 2), bool), np.zeros((FRAMES, 2, 3)))
    with pytest.raises(ValueError, match="'LeftLeg' belongs to two limbs"):
        cleanup_footskate(motion, wanted)


def test_wrong_stretches_and_fades_are_named(skating):
    motion, contacts, _ = skating
    with no_shape_checks():
        for bad in (-0.1, np.nan, np.ones(2)):
            with pytest.raises(ValueError, match="cleanup_footskate: stretch="):
                cleanup_footskate(motion, contacts, stretch=bad)
        with pytest.raises(ValueError, match=r"cleanup_footskate: stretch=.* not traced"):
            jax.eval_shape(lambda s: cleanup_footskate(motion, contacts, stretch=s), 0.02)
        with pytest.raises(ValueError, match=r"cleanup_footskate: fade must be 0 .*, got -0\.1"):
            cleanup_footskate(motion, contacts, fade=-0.1)
        with pytest.raises(ValueError, match=r"cleanup_footskate: fade has shape \(2,\)"):
            cleanup_footskate(motion, contacts, fade=np.ones(2))
