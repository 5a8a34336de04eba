import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.contacts import ContactPoints, Contacts, fit_distances
from tests.helpers import no_shape_checks, random_motion, random_skeleton

FRAMES = 12
fit = jax.jit(fit_distances)


def case(dtype=np.float64, seed=0):
    rng = np.random.default_rng(seed)
    motion = random_motion(rng, FRAMES, random_skeleton(rng, 6, "chain", dtype), dtype)
    points = ContactPoints(
        motion.skeleton,
        [3, 4, 0],
        0.2 * rng.standard_normal((3, 3)),
        limbs=[(1, 2, 3)] * 2 + [None],
    )
    mask = np.repeat(rng.random((FRAMES // 3, 3)) < 0.6, 3, axis=0)
    mask[:7, 0], mask[:, 1], mask[4:9, 1] = [0, 1, 1, 1, 1, 1, 0], False, True
    return motion, Contacts(points, mask, np.asarray(rng.standard_normal((FRAMES, 3, 3)), dtype))


def by_hand(motion, contacts):
    y = np.asarray(contacts.points.positions(motion))
    apart = np.linalg.norm(y[:, 0] - y[:, 1], axis=-1)
    mask, target = np.asarray(contacts.mask), np.array(contacts.target)
    given, shift = target.copy(), np.zeros((2, 3))
    for t in range(FRAMES):
        begins = [mask[t, c] and not (t and mask[t - 1, c]) for c in (0, 1)]
        for c in (0, 1):
            if begins[c]:
                shift[c] = 0
        for c, other in ((0, 1), (1, 0)):
            stood = t and mask[t - 1, other] if c == 0 else True
            if begins[c] and mask[t, other] and stood:
                line = given[t, c] - (given[t, other] + shift[other])
                place = given[t, other] + shift[other] + apart[t] * line / np.linalg.norm(line)
                shift[c] = place - given[t, c]
        for c in (0, 1):
            if mask[t, c]:
                target[t, c] = given[t, c] + shift[c]
    return target


def test_targets_by_hand(dtype):
    motion, contacts = case(dtype)
    got = fit(motion, contacts)
    assert got.target.dtype == dtype
    want = by_hand(motion, contacts)
    assert np.abs(want - contacts.target).max() > 0.1
    np.testing.assert_allclose(got.target, want, atol=1e-5)
    np.testing.assert_array_equal(got.mask, contacts.mask)


def test_points_of_no_limb_or_alone_are_left(dtype):
    motion, contacts = case(dtype)
    alone = ContactPoints(motion.skeleton, [3, 0, 5], limbs=[(1, 2, 3), None, None])
    contacts = eqx.tree_at(lambda c: c.points, contacts, alone)
    assert fit_distances(motion, contacts) is contacts


def test_targets_in_one_place_stay():
    motion, contacts = case()
    same = eqx.tree_at(lambda c: c.target, contacts, jnp.zeros_like(contacts.target))
    np.testing.assert_array_equal(fit(motion, same).target, 0)


def test_other_lengths_are_refused():
    motion, contacts = case()
    with no_shape_checks(), pytest.raises(ValueError, match="contacts have 12 frames, the motion"):
        fit_distances(motion[:5], contacts)
