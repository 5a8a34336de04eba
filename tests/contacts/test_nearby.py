"""Neither the place of a clip nor its unit of length changes what is done to it.

Roots, targets and moves are multiples of 2^-12, so that moving a clip rounds nothing even in
float32, a thousand times its height away; and units are a power of two apart.
"""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import Motion, spacetime
from jaxmotion.contacts import (
    Contacts,
    cleanup_footskate,
    cleanup_root,
    detect,
    find_feet,
    fit_distances,
    replant,
)

FRAMES, CENTIMETRES = 40, 128.0
AWAY = {"float64": (1e6, -2e6, 1.5e6), "float32": (2000.0, 1800.0, -1900.0)}
FLOOR = 0.03125
# The others take up to half a minute each to compile.
QUICK = {("cleanup_footskate", "float32"), ("cleanup_root", "float64"), ("satisfy", "float64")}


@pytest.fixture(scope="module")
def scenes():
    """(clip, an edit of it whose feet slide, the clip's contacts), by dtype."""
    walk = jm.samples.walk(FRAMES, fps=30.0).motion
    walk = at_grid(walk, walk.translations)
    contacts = detect(walk)
    contacts = with_target(contacts, np.round(contacts.target * 4096) / 4096)
    slide = (
        0.3
        * np.sin(np.arange(FRAMES) / 6)[:, None, None]
        * (np.arange(walk.num_joints) == 0)[:, None]
    )
    edit = at_grid(walk, walk.translations + slide)
    return {d: tuple(cast(x, d) for x in (walk, edit, contacts)) for d in AWAY}


def at_grid(motion, translations):
    root = np.round(np.asarray(translations)[:, 0] * 4096) / 4096
    return motion.with_transforms(jnp.asarray(translations).at[:, 0].set(root))


def with_target(contacts, target) -> Contacts:
    return eqx.tree_at(lambda c: c.target, contacts, jnp.asarray(target))


def cast(tree, dtype):
    return jax.tree.map(
        lambda x: x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x, tree
    )


def moved(motion, by) -> Motion:
    by = jnp.asarray(by, motion.dtype)
    return motion.with_transforms(motion.translations.at[:, 0].add(by))


def scaled(motion, factor) -> Motion:
    factor = jnp.asarray(factor, motion.dtype)
    skeleton = eqx.tree_at(
        lambda s: (s.offsets, s.end_offsets),
        motion.skeleton,
        (motion.skeleton.offsets * factor, motion.skeleton.end_offsets * factor),
    )
    return eqx.tree_at(
        lambda m: (m.skeleton, m.translations), motion, (skeleton, motion.translations * factor)
    )


def contacts_moved(contacts, by) -> Contacts:
    return with_target(contacts, contacts.target + jnp.asarray(by, contacts.target.dtype))


def contacts_scaled(contacts, factor) -> Contacts:
    factor = jnp.asarray(factor, contacts.target.dtype)
    return eqx.tree_at(
        lambda c: (c.points.point, c.target),
        contacts,
        (contacts.point * factor, contacts.target * factor),
    )


EDITS = {
    "cleanup_footskate": lambda clip, edit, contacts, floor: cleanup_footskate(
        edit, contacts, floor=floor
    ),
    "cleanup_root": lambda clip, edit, contacts, floor: cleanup_root(edit, contacts, floor=floor),
    "satisfy": lambda clip, edit, contacts, floor: spacetime.satisfy(edit, contacts, floor=floor)[
        0
    ],
    "hierarchical": lambda clip, edit, contacts, floor: spacetime.satisfy(
        edit, contacts, method="hierarchical"
    )[0],
    "keep_contacts": lambda clip, edit, contacts, floor: spacetime.keep_contacts(
        edit, clip, contacts
    ),
}


@pytest.mark.parametrize(
    ("name", "dtype"),
    [
        pytest.param(*case, marks=[] if case in QUICK else pytest.mark.sweep)
        for case in itertools.product(EDITS, AWAY)
    ],
)
def test_edits(scenes, name, dtype):
    dtype = np.dtype(dtype)
    clip, edit, contacts = scenes[str(dtype)]
    here = EDITS[name](clip, edit, contacts, jnp.asarray(FLOOR, dtype))
    by = np.asarray(AWAY[str(dtype)], dtype)
    there = EDITS[name](
        moved(clip, by), moved(edit, by), contacts_moved(contacts, by), by[1] + dtype.type(FLOOR)
    )
    np.testing.assert_array_equal(there.rotations, here.rotations)
    change = np.asarray(here.translations - edit.translations)
    assert np.abs(change).max() > 1e-3
    rounding = 4 * np.finfo(dtype).eps * np.abs(by).max()
    np.testing.assert_allclose(
        there.translations - moved(edit, by).translations, change, atol=rounding
    )
    large = EDITS[name](
        scaled(clip, CENTIMETRES),
        scaled(edit, CENTIMETRES),
        contacts_scaled(contacts, CENTIMETRES),
        jnp.asarray(FLOOR * CENTIMETRES, dtype),
    )
    np.testing.assert_array_equal(large.rotations, here.rotations)
    np.testing.assert_array_equal(large.translations, CENTIMETRES * here.translations)


@pytest.mark.parametrize("method", ["segments", "thresholds"])
@pytest.mark.parametrize("floor", ["auto", FLOOR])
def test_detection(scenes, dtype, method, floor):
    clip = scenes[str(dtype)][0]
    by = np.asarray(AWAY[str(dtype)], dtype)

    def found(motion, floor):
        return detect(motion, method=method, floor=floor, points=find_feet(motion))

    auto = isinstance(floor, str)
    here = found(clip, floor)
    there = found(moved(clip, by), floor if auto else by[1] + dtype.type(floor))
    large = found(scaled(clip, CENTIMETRES), floor if auto else floor * CENTIMETRES)
    assert 0.2 < np.mean(here.mask) < 0.8
    for other in (there, large):
        np.testing.assert_array_equal(other.mask, here.mask)
        np.testing.assert_array_equal(other.kind, here.kind)
        np.testing.assert_array_equal(other.confidence, here.confidence)
    np.testing.assert_array_equal(there.point, here.point)
    np.testing.assert_array_equal(large.point, CENTIMETRES * here.point)
    rounding = 2 * np.finfo(dtype).eps * np.abs(by).max()
    np.testing.assert_allclose(there.target - by, here.target, atol=rounding)
    np.testing.assert_array_equal(large.target, CENTIMETRES * here.target)


def test_targets(scenes, dtype):
    _, edit, contacts = scenes[str(dtype)]
    by = np.asarray(AWAY[str(dtype)], dtype)
    rounding = 2 * np.finfo(dtype).eps * np.abs(by).max()
    for step in (replant, fit_distances):
        here = step(edit, contacts)
        there = step(moved(edit, by), contacts_moved(contacts, by))
        np.testing.assert_allclose(there.target - by, here.target, atol=rounding)
        large = step(scaled(edit, CENTIMETRES), contacts_scaled(contacts, CENTIMETRES))
        np.testing.assert_array_equal(large.target, CENTIMETRES * here.target)
