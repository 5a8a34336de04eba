"""Footskate cleanup by the root alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.contacts import Contacts, cleanup_root, detect, replant
from jaxmotion.metrics import foot_skate, penetration
from tests.helpers import check_gradients, no_shape_checks

FRAMES = 60


@pytest.fixture(scope="module")
def skating():
    walk = jm.samples.walk(FRAMES, fps=30.0).motion
    slid = jm.samples.slide_root(walk, jax.random.key(0), amount=0.3).motion
    return walk, slid, detect(walk)


def test_a_sliding_root_is_put_back(skating):
    """The drift is what planted feet slide, so taking it back restores the walk's own path."""
    walk, slid, contacts = skating
    own = replant(slid, contacts)
    clean = cleanup_root(slid, own)
    assert foot_skate(clean, own) < 0.15 * foot_skate(slid, own)
    np.testing.assert_array_equal(clean.rotations, slid.rotations)
    path, slid_path, want = (np.asarray(m.root_positions) for m in (clean, slid, walk))
    moved, drift = path[-1] - path[0], slid_path[-1] - slid_path[0]
    whole = want[-1] - want[0]
    assert np.linalg.norm(moved - whole) < 0.1 * np.linalg.norm(drift - whole)


def test_a_steady_slide_is_taken_back_exactly():
    """One foot planted throughout, a root that glides: nothing is left of the slide."""
    still = jm.samples.idle(40, fps=30.0).motion[0]
    rotations = jnp.repeat(still.rotations, 40, 0)
    places = np.array(jnp.repeat(still.translations, 40, 0))
    places[:, 0] += 0.01 * np.arange(40)[:, None] * np.array([1.0, 0, 0.5])
    moving = still.with_transforms(jnp.asarray(places), rotations)
    contacts = replant(moving, detect(moving, tolerance=10.0))
    assert contacts.mask.all()
    clean = cleanup_root(moving, contacts)
    np.testing.assert_allclose(clean.root_positions - clean.root_positions[0], 0, atol=1e-9)


def test_floor_no_contacts_and_errors(skating):
    _, slid, contacts = skating
    low = slid.with_transforms(slid.translations.at[:, 0, 1].add(-0.05))
    clean = cleanup_root(low, contacts, floor=0.0)
    assert penetration(clean, contacts.points).max() < 1e-9
    np.testing.assert_array_equal(  # a floor below the feet lifts and lowers nothing
        cleanup_root(slid, contacts, floor=-1.0).translations,
        cleanup_root(slid, contacts).translations,
    )
    none = Contacts(contacts.points, np.zeros((FRAMES, 4), bool), contacts.target)
    np.testing.assert_array_equal(cleanup_root(slid, none).translations, slid.translations)
    assert cleanup_root(slid, detect(slid, joints=[])) is slid
    with no_shape_checks(), pytest.raises(ValueError, match="contacts have 60 frames"):
        cleanup_root(slid[:30], contacts)


def test_frames_beyond_the_length_do_not_matter(skating):
    _, slid, contacts = skating
    few = jax.tree.map(lambda x: x[:45] if x.shape[:1] == (FRAMES,) else x, contacts)
    want = cleanup_root(slid[:45], few)
    wild = slid.with_transforms(slid.translations.at[45:].mul(7.0))
    got = cleanup_root(wild, contacts, length=45)
    np.testing.assert_allclose(got.translations[:45], want.translations, atol=1e-9)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_tiny_clips_in_single_precision(skating, frames):
    _, slid, contacts = skating
    few = jax.tree.map(lambda x: x[:frames] if x.shape[:1] == (FRAMES,) else x, contacts)
    clean = cleanup_root(slid[:frames].astype(np.float32), few)
    assert clean.translations.dtype == np.float32
    assert np.isfinite(clean.translations).all()


def test_gradients(skating):
    _, slid, contacts = skating

    def f(root):
        moved = slid.with_transforms(slid.translations.at[:, 0].add(root))
        return cleanup_root(moved, contacts).translations[:, 0]

    root = 0.01 * np.random.default_rng(0).standard_normal((FRAMES, 3))
    check_gradients(f, root, rtol=1e-5, atol=1e-7)
