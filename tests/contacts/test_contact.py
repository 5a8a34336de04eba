"""The types: positions against 4x4 matrices, limbs from trees, what is refused."""

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.contacts import FREE, POINT, ContactPoints, Contacts, intervals, limb_lengths
from tests.helpers import no_shape_checks, random_motion, random_skeleton, world_by_matrices


@pytest.fixture(scope="module")
def walk():
    return jm.samples.walk(60, fps=30.0)


def test_positions_and_limb_lengths():
    motion = random_motion(
        np.random.default_rng(0), 4, random_skeleton(np.random.default_rng(1), 6, "chain")
    )
    offsets = np.arange(6.0).reshape(2, 3)
    points = ContactPoints(motion.skeleton, [3, "joint5"], offsets)
    positions, turns, _ = world_by_matrices(motion)
    for c, joint in enumerate(points.joints):
        want = positions[:, joint] + turns[:, joint] @ offsets[c]
        np.testing.assert_allclose(points.positions(motion)[:, c], want, atol=1e-12)
    bones = np.linalg.norm(motion.translations, axis=-1).mean(0)
    assert points.limbs == ((1, 2, 3), (3, 4, 5))
    np.testing.assert_allclose(
        limb_lengths(motion, points), [bones[2] + bones[3], bones[4] + bones[5]]
    )
    head = ContactPoints(motion.skeleton, [1])
    assert head.limbs == (None,)
    np.testing.assert_allclose(limb_lengths(motion, head), [bones[1:].sum() / 2])


def test_points_of_one_foot_share_its_limb(walk):
    skeleton = walk.motion.skeleton
    points = ContactPoints(skeleton, walk.contact_joints, walk.contact_offsets)
    left, right = (
        tuple(skeleton.index(side + part) for part in ("UpLeg", "Leg", "Foot"))
        for side in ("Left", "Right")
    )
    assert points.limbs == (left,) * 3 + (right,) * 3


def test_the_truth_of_a_sample_as_contacts(walk):
    points = ContactPoints(walk.motion.skeleton, walk.contact_joints, walk.contact_offsets)
    np.testing.assert_allclose(points.positions(walk.motion), walk.contact_positions, atol=1e-12)
    contacts = Contacts(points, walk.contacts, walk.contact_positions)
    np.testing.assert_array_equal(contacts.kind, np.where(walk.contacts, POINT, FREE))
    np.testing.assert_array_equal(contacts.confidence, np.asarray(walk.contacts, float))
    found = intervals(contacts)
    covered = np.zeros((60, 6), bool)
    for one in found:
        c = contacts.joints.index(one.joint) if one.joint in (16, 20) else None
        assert one.kind == "point"
        assert one.confidence == 1.0
        if c is not None:
            covered[one.first : one.last + 1, c] = True
            np.testing.assert_allclose(one.target, walk.contact_positions[one.first, c])
    np.testing.assert_array_equal(covered[:, [0, 3]], np.asarray(walk.contacts)[:, [0, 3]])
    assert sum(one.last - one.first + 1 for one in found) == walk.contacts.sum()


def test_what_does_not_fit_is_refused(walk):
    skeleton = walk.motion.skeleton
    with pytest.raises(ValueError, match=r"joints has 99; expected 0..21"):
        ContactPoints(skeleton, [99])
    with pytest.raises(ValueError, match="no joint is called 'Tentacle'"):
        ContactPoints(skeleton, ["Tentacle"])
    points = ContactPoints(skeleton, ["LeftFoot"])
    with no_shape_checks():
        with pytest.raises(ValueError, match=r"point has shape \(2, 3\), expected \(1, 3\)"):
            ContactPoints(skeleton, [3], np.zeros((2, 3)))
        with pytest.raises(ValueError, match=r"target has shape \(60, 2, 3\); expected \(60, 1, 3"):
            Contacts(points, np.ones((60, 1), bool), np.zeros((60, 2, 3)))
