"""Limbs that were repaired stand where they are planted."""

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cleaning.planted import nearest_to_contacts, planted_again
from tests.cleaning.clips import turned
from tests.helpers import angle_between, world_by_matrices


@pytest.fixture(scope="module")
def walk():
    return jm.samples.load("walk", fps=24.0, num_frames=72).motion.astype(np.float64)


@pytest.fixture(scope="module")
def contacts(walk):
    return jm.contacts.detect(walk)


@pytest.fixture(scope="module")
def left(walk):
    return [walk.skeleton.index(f"Left{name}") for name in ("UpLeg", "Leg", "Foot", "ToeBase")]


def broken(walk, contacts, left, size=0.15):
    """The thigh turned while a foot stands, and what is in error."""
    mine = [limb is not None and limb[0] == left[0] for limb in contacts.limbs]
    stands = np.asarray(contacts.mask)[:, mine].any(axis=1)
    middle = int(np.flatnonzero(stands & (np.arange(72) > 20))[0]) + 3
    frames = np.arange(middle - 6, middle + 6)
    mask = np.zeros(walk.rotations.shape[:2], bool)
    mask[frames, left[0]] = True
    assert stands[frames].sum() > 0
    return turned(walk, left[0], frames, [size, 0, 0]), mask, frames


def away(motion, contacts):
    """From where each point is held, f[T, C], by 4x4 matrices."""
    positions, turns, _ = world_by_matrices(motion)
    joints = list(contacts.joints)
    points = positions[:, joints] + np.einsum("tcab,cb->tca", turns[:, joints], contacts.point)
    return np.linalg.norm(points - np.asarray(contacts.target), axis=-1)


def test_the_candidate_that_stands_best(walk, contacts, left):
    """Limb by limb, and run by run; where no point is planted, or in no other joint, the first."""
    right = [walk.skeleton.index(f"Right{name}") for name in ("UpLeg", "Leg", "Foot", "ToeBase")]
    arm = walk.skeleton.index("LeftArm")
    frames = np.arange(5, 60)
    mask = np.zeros(walk.rotations.shape[:2], bool)
    mask[np.ix_(frames, [left[0], right[0], arm])] = True
    mask[30, [left[0], right[0]]] = False
    first = turned(turned(walk, left[0], frames, [0.3, 0, 0]), arm, frames, [0.3, 0, 0])
    wrong = turned(walk, right[0], frames[frames > 30], [0.3, 0, 0])
    worse = turned(walk, left[0], frames, [0.6, 0, 0])
    made = nearest_to_contacts([first, wrong, worse], contacts, mask)
    # The right leg of the first is right in both runs, and its left in none.
    np.testing.assert_array_equal(made.rotations[:, arm], first.rotations[:, arm])
    np.testing.assert_array_equal(made.rotations[:, right], walk.rotations[:, right])
    changed = np.delete(np.arange(72), 30)
    np.testing.assert_array_equal(
        made.rotations[changed, left[0]], walk.rotations[changed, left[0]]
    )
    np.testing.assert_array_equal(made.rotations[30, left[0]], first.rotations[30, left[0]])
    # Run by run: what is right in the first of them only, and in the second.
    halves = [turned(walk, left[0], x, [0.3, 0, 0]) for x in (frames[frames < 30], frames[25:])]
    made = nearest_to_contacts(halves, contacts, mask)
    np.testing.assert_array_equal(made.rotations[:30], walk.rotations[:30])
    np.testing.assert_array_equal(made.rotations[31:], walk.rotations[31:])
    other = nearest_to_contacts([wrong, first], contacts, mask)
    np.testing.assert_array_equal(other.rotations, walk.rotations)
    alone = nearest_to_contacts([wrong], contacts, mask)
    np.testing.assert_array_equal(alone.rotations, wrong.rotations)
    none = jm.contacts.Contacts(contacts.points, np.zeros_like(contacts.mask), contacts.target)
    same = nearest_to_contacts([first, wrong], none, mask)
    np.testing.assert_array_equal(same.rotations, first.rotations)


def test_points_come_back(walk, contacts, left):
    motion, mask, frames = broken(walk, contacts, left)
    free = np.ones(walk.num_joints, bool)
    made, wide = planted_again(motion, contacts, mask, free)
    mine = np.array([limb is not None and limb[0] == left[0] for limb in contacts.limbs])
    held = np.asarray(contacts.mask) & mask.any(axis=1)[:, None] & mine
    size = float(np.linalg.norm(walk.skeleton.offsets, axis=-1).sum())
    assert away(motion, contacts)[held].max() > 0.02
    # Several points on one foot share its limb's end: it comes to their mean.
    before, after = (away(x, contacts)[held] for x in (walk, made))
    assert after.max() < max(before.max() + 1e-3 * size, 2e-3 * size)
    # Only the limb is turned, and only in the frames that were repaired.
    same = np.ones_like(mask)
    same[np.ix_(frames, left[:3])] = False
    np.testing.assert_array_equal(
        np.asarray(made.rotations)[same], np.asarray(motion.rotations)[same]
    )
    np.testing.assert_array_equal(made.translations, motion.translations)
    assert wide[:, left[:3]].any(axis=1).sum() == mask.any(axis=1).sum()
    assert not np.delete(wide, left[:3], axis=1).any()
    assert not wide[~mask.any(axis=1)].any()
    assert mask.sum() == len(frames)


def test_ankles_keep_their_turns(walk, contacts, left):
    motion, mask, frames = broken(walk, contacts, left)
    made, _ = planted_again(motion, contacts, mask, np.ones(walk.num_joints, bool))
    old, new = (world_by_matrices(x)[1] for x in (motion, made))
    np.testing.assert_allclose(new[frames][:, left[2:]], old[frames][:, left[2:]], atol=1e-9)
    bones = [
        np.linalg.norm(np.diff(world_by_matrices(x)[0][:, left[:3]], axis=1), axis=-1)
        for x in (motion, made)
    ]
    np.testing.assert_allclose(bones[0], bones[1], atol=1e-9)


def test_it_fades_where_the_foot_is_free(walk, contacts, left):
    """Within 0.15 seconds, where repaired."""
    motion, mask, _ = broken(walk, contacts, left)
    mask[:, left[0]] = True
    made, wide = planted_again(motion, contacts, mask, np.ones(walk.num_joints, bool))
    change = angle_between(motion.rotations, made.rotations)[:, left[0]]
    mine = np.array([limb is not None and limb[0] == left[0] for limb in contacts.limbs])
    held = np.asarray(contacts.mask)[:, mine].any(axis=1)
    near = np.array([held[max(t - 4, 0) : t + 5].any() for t in range(72)])
    assert change[~near].max(initial=0) < 1e-9
    assert change[near & ~held].max() > 1e-4
    assert not wide[~near][:, left[1:]].any()


def test_what_is_left_alone(walk, contacts, left):
    """No error in the limb, none while it stands, or a joint of it that may not be changed."""
    motion, mask, frames = broken(walk, contacts, left)
    free = np.ones(walk.num_joints, bool)
    arm = np.zeros_like(mask)
    arm[frames, walk.skeleton.index("LeftArm")] = True
    held = free.copy()
    held[left[1]] = False
    none = jm.contacts.Contacts(contacts.points, np.zeros_like(contacts.mask), contacts.target)
    for errors, may, given in ((arm, free, contacts), (mask, held, contacts), (mask, free, none)):
        made, wide = planted_again(motion, given, errors, may)
        np.testing.assert_array_equal(made.rotations, motion.rotations)
        np.testing.assert_array_equal(wide, errors)


def test_an_error_above_the_limb(walk, contacts, left):
    """Carries it: both feet come back."""
    frames = np.arange(30, 40)
    motion = turned(walk, 0, frames, [0, 0, 0.05])
    mask = np.zeros(walk.rotations.shape[:2], bool)
    mask[frames, 0] = True
    made, wide = planted_again(motion, contacts, mask, np.ones(walk.num_joints, bool))
    held = np.asarray(contacts.mask) & mask.any(axis=1)[:, None]
    assert held.any()
    assert away(made, contacts)[held].mean() < 0.3 * away(motion, contacts)[held].mean()
    assert wide[:, walk.skeleton.index("RightLeg")].any() or wide[:, left[1]].any()


def test_contacts_of_another_clip(walk, contacts, left):
    motion, mask, _ = broken(walk, contacts, left)
    with pytest.raises(ValueError, match="repair"):
        planted_again(motion[:40], contacts, mask[:40], np.ones(walk.num_joints, bool))
