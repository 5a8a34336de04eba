"""Edits that keep contacts: what a walk turned up by two slides, and what the restored one does.

Figures are taken in numpy from world matrices.
"""

import functools
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.contacts import Contacts, detect, fit_distances, limb_lengths
from jaxmotion.spacetime import ConvergenceWarning, keep_contacts, restore
from tests.helpers import angle_between, random_motion, world_by_matrices

FRAMES = 60


@pytest.fixture(scope="module")
def original():
    return jm.samples.walk(FRAMES, fps=30.0).motion


@pytest.fixture(scope="module")
def contacts(original):
    return detect(original)


def points(motion, contacts):
    position, turn, _ = world_by_matrices(motion)
    joints = list(contacts.joints)
    offsets = np.asarray(contacts.point, np.float64)
    return position[:, joints] + np.einsum("tcij,cj->tci", turn[:, joints], offsets)


def skate(motion, contacts):
    """Mean slide a frame of the points in contact."""
    held = np.asarray(contacts.mask)
    moved = np.linalg.norm(np.diff(points(motion, contacts), axis=0), axis=-1)
    return moved[held[1:] & held[:-1]].mean()


def peak_accelerations(motion):
    """Of each joint's local rotation, rad/s^2."""
    q = np.asarray(motion.rotations, np.float64)
    peaks = []
    for j in range(motion.num_joints):
        turn = Rotation.from_quat(q[:, j], scalar_first=True)
        spin = (turn[:-1].inv() * turn[1:]).as_rotvec() / float(motion.frame_time)
        bend = np.diff(spin, axis=0) / float(motion.frame_time)
        peaks.append(np.linalg.norm(bend, axis=-1).max())
    return np.array(peaks)


def check_quality(original, edit):
    contacts = detect(original)
    answer, report = restore(edit, contacts)
    assert bool(report.converged)
    assert skate(answer, contacts) < 0.05 * skate(edit, contacts)
    leg = float(limb_lengths(original, contacts.points).mean())
    wanted = np.asarray(fit_distances(edit, contacts).target)
    miss = np.linalg.norm(points(answer, contacts) - wanted, axis=-1)[np.asarray(contacts.mask)]
    assert miss.max() < 0.002 * leg
    before, after = peak_accelerations(edit), peak_accelerations(answer)
    assert np.all(after < 1.1 * before + 1e-3)
    return answer, report


def test_exaggerated_walk(original):
    edit = jm.stylize(original, 2.0)
    answer, report = check_quality(original, edit)
    assert int(report.num_steps) < 20
    legs = {14, 15, 16, 17, 18, 19, 20, 21}
    others = [j for j in range(1, original.num_joints) if j not in legs]
    np.testing.assert_array_equal(answer.rotations[:, others], edit.rotations[:, others])
    assert angle_between(answer.rotations, edit.rotations).max() < 0.7


@pytest.mark.sweep  # a walk that is made is above
def test_exaggerated_capture(data_dir):
    motion = jm.load(data_dir / "bandai" / "walk_normal_001.bvh")
    layers = jm.decompose(motion)
    part = slice(40, 40 + FRAMES)
    check_quality(motion[part], jm.synthesize(layers, 2.0)[part])


@pytest.mark.sweep
def test_exaggerated_capture_whole(data_dir):
    """Of the walks of the Bandai set the one whose feet have to hurry most."""
    motion = jm.load(data_dir / "bandai" / "walk_childish_001.bvh")
    check_quality(motion, jm.stylize(motion, 2.0))


@pytest.mark.sweep  # a walk in single precision is tested below
def test_exaggerated_capture_in_single_precision(data_dir):
    """Heel and ball of a foot are one body: their rows left float32 without a root after a step,
    33 cm from the answer."""
    motion = jm.load(data_dir / "bandai" / "walk_childish_002.bvh", dtype=np.float32)[:120]
    _, report = restore(jm.stylize(motion, 2.0), detect(motion))
    assert bool(report.converged)
    assert float(jnp.max(report.position_error)) < 0.03


def test_single_precision(original, contacts):
    edit = jm.stylize(original, 2.0)
    answer, report = restore(edit.astype(np.float32), contacts)
    assert answer.rotations.dtype == report.position_error.dtype == np.float32
    want = restore(edit, contacts)[0]
    assert angle_between(answer.rotations, want.rotations).max() < 5e-3
    assert bool(report.converged)


def test_every_edit_takes_keep_contacts(original, contacts):
    edit = jm.stylize(original, 2.0)
    want = keep_contacts(edit, original)
    for got in (
        restore(edit, contacts)[0],
        keep_contacts(edit, original=original),
        jm.stylize(original, 2.0, keep_contacts=True),
        jm.stylize(original, 2.0, keep_contacts=contacts),
        jm.synthesize(jm.decompose(original), 2.0, keep_contacts=True),
    ):
        assert angle_between(got.rotations, want.rotations).max() < 1e-4
        np.testing.assert_allclose(got.translations, want.translations, atol=1e-4)
    assert keep_contacts(edit, original, False) is edit


def test_contacts_follow_a_time_warp(original, contacts):
    """The first half takes twice the time: contacts last twice as long, in the same places."""
    half = jax.tree.map(lambda x: x[:30] if x.shape[:1] == (FRAMES,) else x, contacts)
    options = {"pairs": np.array([[29 / 30, 59 / 30]]), "num_frames": FRAMES, "alpha": 2.0}
    plain = jm.time_warp(original[:30], **options)
    slow = jm.time_warp(original[:30], **options, keep_contacts=half)
    at = np.arange(FRAMES) * 29 / 59
    moved = half.at_frames(jnp.asarray(at))
    np.testing.assert_array_equal(moved.mask, np.asarray(contacts.mask)[np.round(at).astype(int)])
    assert skate(slow, moved) < 0.1 * skate(plain, moved)


@pytest.mark.sweep  # tests/test_lengths.py restores clips of a given length
def test_what_lies_beyond_the_length_does_not_matter(original, contacts):
    edit = jm.stylize(original, 2.0)
    turned = edit.rotations.at[45:].set(jnp.roll(edit.rotations, 3, axis=0)[45:])
    other = eqx.tree_at(
        lambda c: (c.mask, c.target), contacts, (~contacts.mask, contacts.target + 1)
    )
    other = jax.tree.map(
        lambda a, b: a.at[45:].set(b[45:]) if a.shape[:1] == (FRAMES,) else a, contacts, other
    )
    want = restore(edit, contacts, length=45)[0]
    got = restore(edit.with_transforms(rotations=turned), other, length=45)[0]
    assert angle_between(got.rotations[:45], want.rotations[:45]).max() < 1e-6


def test_a_body_without_feet_and_a_clip_without_contacts_come_back(original, contacts):
    nobody = random_motion(np.random.default_rng(0), 5, 4)
    answer = keep_contacts(nobody, nobody)
    np.testing.assert_array_equal(answer.rotations, nobody.rotations)
    never = eqx.tree_at(lambda c: c.mask, contacts, jnp.zeros_like(contacts.mask))
    answer, report = restore(original, never)
    np.testing.assert_array_equal(answer.translations, original.translations)
    assert angle_between(answer.rotations, original.rotations).max() < 1e-12
    assert float(report.position_error.max()) == 0


def test_out_of_reach_and_contradictory_contacts_are_reported(original, contacts):
    apart = jnp.asarray([[9.0, 0, 0], [9.0, 0, 0], [-9.0, 0, 0], [-9.0, 0, 0]])
    torn = Contacts(contacts.points, jnp.ones_like(contacts.mask), contacts.target + apart)
    answer, report = restore(original, torn)
    assert np.isfinite(answer.rotations).all()
    assert np.isfinite(answer.translations).all()
    assert float(report.cost) < float(report.cost_before)
    assert float(report.position_error.min()) > 1


def test_an_answer_that_is_not_at_rest_warns(original, contacts, monkeypatch):
    """Nothing to say of an edit that settles; traced, the report tells."""
    edit = jm.stylize(original, 2.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        keep_contacts(edit, original, contacts)
    short = functools.partial(jm.spacetime.satisfy, max_steps=2)
    monkeypatch.setattr(jm.spacetime, "satisfy", short)
    with pytest.warns(
        ConvergenceWarning, match=r"not at rest after 2 steps: .* up to [0-9.]+ "
    ) as told:
        got = keep_contacts(edit, original, contacts)
    assert got.num_frames == FRAMES
    assert told[0].filename == __file__
    jax.eval_shape(keep_contacts, edit, original, contacts)
    with pytest.raises(eqx.EquinoxRuntimeError, match="satisfy: not at rest"):
        short(edit, contacts, throw=True)


def test_traced_clips_are_restored_with_given_contacts(original, contacts):
    def edit(alpha):
        return jm.stylize(original, alpha, keep_contacts=contacts).rotations.sum()

    assert jax.eval_shape(jax.grad(edit), 2.0).shape == ()


def test_traced_clips_need_contacts(original):
    with pytest.raises(ValueError, match="traced"):
        jax.eval_shape(lambda m: jm.stylize(m, 2.0, keep_contacts=True), original)
