"""How far joints are from what they do elsewhere, in plain NumPy and SciPy."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import jaxmotion as jm
from jaxmotion.cleaning import digression_map, joint_groups
from jaxmotion.cleaning.digression import at_every_frame
from jaxmotion.cleaning.words import texture
from tests.cleaning.clips import repeating
from tests.cleaning.oracles import digression_by_hand
from tests.helpers import assert_same_rotation, no_shape_checks, random_quaternions
from tests.style.clips import quaternions, rotations, swaying


@pytest.fixture(scope="module")
def clips():
    return repeating(0, 80), [repeating(0, 70, 0.05), repeating(0, 60, 0.05)]


@pytest.fixture(scope="module")
def found(clips):
    return digression_map(*clips, k=3)


def test_in_plain_numpy(clips, found):
    """Of every group the residual, of these the least."""
    residual, mean = digression_by_hand(*clips, k=3)
    size = np.linalg.norm(residual, axis=-1)
    np.testing.assert_allclose(found.residual, residual, atol=1e-7)
    np.testing.assert_allclose(found.digression, size, atol=1e-7)
    assert_same_rotation(found.texture, mean, 1e-6)
    np.testing.assert_allclose(found.mdm, 1 - 0.5 ** ((size / 0.5) ** 2), atol=1e-7)
    assert found.step == 1
    assert list(found.neighbours) == list(joint_groups([clips[0], *clips[1]]))


def test_a_size_of_each_joint(clips, found):
    sizes = np.array([0.2, 0.3, 0.5, 1.0, 0.1])
    mdm = digression_map(*clips, k=3, scale=sizes).mdm
    wanted = 1 - 0.5 ** ((np.asarray(found.digression) / sizes) ** 2)
    np.testing.assert_allclose(mdm, wanted, atol=1e-9)


def test_the_paper_s(clips, found):
    """Rows of mean 1, of what is not freed of its median."""
    mdm = np.asarray(digression_map(*clips, k=3, normalise="row_mean").mdm)
    joints = tuple(range(5))
    away = rotations(found.texture).inv() * rotations(texture(clips[0], joints))
    plain = away.magnitude().reshape(80, 5)
    np.testing.assert_allclose(mdm, 1 - np.exp(-((plain / plain.mean(axis=0)) ** 2)), atol=1e-6)


def test_place_yaw_and_signs_do_not_matter(clips, found):
    motion, (one, two) = clips
    turn = Rotation.from_rotvec([0, 1.2, 0])
    q = np.array(one.rotations)
    q[:, 0] = quaternions(turn * rotations(q[:, 0]))
    q[::3] *= -1
    moved = one.with_transforms(np.array(one.translations) + np.array([3.0, 0, -1]), q)
    again = digression_map(motion, [moved, two], k=3)
    np.testing.assert_allclose(again.digression, found.digression, atol=1e-7)
    turned = np.array(motion.rotations)
    turned[:, 0] = quaternions(turn * rotations(turned[:, 0]))
    again = digression_map(motion.with_transforms(rotations=turned), [one, two], k=3)
    np.testing.assert_allclose(again.residual, found.residual, atol=1e-7)


def test_an_error_shows(clips, found):
    """In its joint and its frames, as large as it is."""
    motion, context = clips
    q = np.array(motion.rotations)
    turn = Rotation.from_rotvec([0.9, 0, 0])
    q[30:40, 2] = quaternions(rotations(q[30:40, 2]) * turn)
    broken = np.asarray(
        digression_map(motion.with_transforms(rotations=q), context, k=3).digression
    )
    change = broken - np.asarray(found.digression)
    assert change[30:40, 2].min() > 0.5
    assert broken[30:40, 2].min() > np.delete(broken, 2, axis=1).max()


def test_float32(clips, found):
    single = [x.astype(np.float32) for x in (clips[0], *clips[1])]
    again = digression_map(single[0], single[1:], k=3)
    for name in ("digression", "mdm", "residual", "texture"):
        assert getattr(again, name).dtype == np.float32
    np.testing.assert_allclose(again.digression, found.digression, atol=1e-3)


def test_between_thinned_frames():
    """On a straight way; beyond the last as before it; known where both beside are."""
    rng = np.random.default_rng(0)
    q = np.array(random_quaternions(rng, (5, 2), angle=0.8))
    made = at_every_frame(q, 14, 3)
    assert made.shape == (14, 2, 4)
    assert_same_rotation(made[:13:3], q, 1e-12)
    for j in range(2):
        line = Slerp(3 * np.arange(5), rotations(q[:, j]))
        assert_same_rotation(made[:13, j], quaternions(line(np.arange(13))), 1e-9)
    step = rotations(made[11]).inv() * rotations(made[12])
    assert_same_rotation(made[13], quaternions(rotations(made[12]) * step), 1e-7)
    known = np.array([[1, 1], [1, 0], [1, 1], [1, 1], [0, 1]], bool)
    there = at_every_frame(known, 14, 3)
    wanted = np.zeros((14, 2), bool)
    wanted[:9, 0] = True
    wanted[6:, 1] = True
    np.testing.assert_array_equal(there, wanted)
    np.testing.assert_array_equal(at_every_frame(q, 5, 1), q)
    np.testing.assert_array_equal(at_every_frame(q[:1], 3, 4), np.repeat(q[:1], 3, axis=0))


def test_other_rates():
    """A clip at 120 frames a second beside one at 24 is judged in every frame."""
    fast = jm.samples.load("walk", fps=120.0, num_frames=400).motion
    slow = jm.samples.load("walk", fps=30.0, num_frames=130).motion
    found = digression_map(fast, slow[::1], k=3)
    assert found.step == 5
    assert found.digression.shape == (400, fast.num_joints)
    thin = digression_map(fast[::5], slow, k=3)
    assert thin.step == 1
    for name, neighbours in thin.neighbours.items():
        np.testing.assert_array_equal(found.neighbours[name].frame, neighbours.frame)
    body = np.arange(fast.num_joints)
    near = [j for j in body if np.ptp(np.asarray(found.digression)[:, j]) > 0]
    np.testing.assert_allclose(
        np.asarray(found.digression)[:395:5][:, near],
        np.asarray(thin.digression)[:79][:, near],
        atol=0.05,
    )
    assert np.abs(np.diff(np.asarray(found.digression)[:395, near], axis=0)).max() < 0.1


@pytest.mark.parametrize("frames", [1, 2, 3, 14, 19])
def test_what_has_no_neighbours(frames):
    """Digresses by nothing, and its own texture is the mean."""
    motion = swaying(1, frames)
    found = digression_map(motion)
    np.testing.assert_array_equal(found.digression, np.zeros((frames, 5)))
    np.testing.assert_array_equal(found.mdm, 0)
    told = [j for members in joint_groups(motion).values() for j in members]
    for j in set(range(1, 5)) - set(told):
        np.testing.assert_array_equal(found.texture[:, j], motion.rotations[:, j])


def test_joints_that_tell_nothing(clips):
    motion, context = clips
    q = np.array(motion.rotations)
    q[:, 3] = q[0, 3]
    still = [
        x.with_transforms(rotations=np.where(np.arange(5)[:, None] == 3, q[0, 3], x.rotations))
        for x in (motion, *context)
    ]
    found = digression_map(still[0], still[1:], k=2)
    assert not np.asarray(found.digression)[:, 3].any()
    assert np.asarray(found.digression)[:, 2].any()
    np.testing.assert_array_equal(found.texture[:, 3], still[0].rotations[:, 3])
    # Nothing moves: nothing is searched for.
    stands = motion.with_transforms(rotations=np.repeat(motion.rotations[:1], 80, axis=0))
    found = digression_map(stands)
    assert found.neighbours == {}
    assert not np.asarray(found.digression).any()


def test_progress(clips):
    """Words of all groups, on and on."""
    told = []
    found = digression_map(clips[0], k=1, progress=lambda *x: told.append(x))
    words, many = 14, len(found.neighbours)
    assert told == [(words * (n + 1), words * many) for n in range(many)]


def test_what_is_wrong_is_said(clips):
    motion, _ = clips
    for scale in (0.0, -1.0, np.ones(3), np.nan):
        with pytest.raises(ValueError, match="scale="):
            digression_map(motion, scale=scale)
    with no_shape_checks():
        with pytest.raises(ValueError, match="normalise"):
            digression_map(motion, normalise="median")
        with pytest.raises(ValueError, match="Motion"):
            digression_map("walk")
    with pytest.raises(ValueError, match="k=0"):
        digression_map(motion, k=0)
    with pytest.raises(ValueError, match="other joints"):
        digression_map(motion, swaying(0, names=("a", "b", "c", "d", "e")))
    with pytest.raises(ValueError, match="traced"):
        jax.jit(lambda m: digression_map(m).mdm)(motion)
    q = np.array(motion.rotations)
    q[3, 2] = np.nan
    with pytest.raises(ValueError, match="finite"):
        digression_map(motion.with_transforms(rotations=q))
