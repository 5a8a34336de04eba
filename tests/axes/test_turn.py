"""Clips turned to another up axis: 4x4 matrices as the oracle, there and back."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import jaxmotion as jm
from tests.helpers import (
    assert_jit_and_vmap_agree,
    assert_same_rotation,
    check_gradients,
    random_motion,
    world_by_matrices,
)

AXES = "xyz"
# What becomes of (x, y, z), written out by hand: the shortest turn of one axis onto the other.
TURNED = {
    "zy": lambda v: np.stack([v[..., 0], v[..., 2], -v[..., 1]], -1),
    "yz": lambda v: np.stack([v[..., 0], -v[..., 2], v[..., 1]], -1),
    "xy": lambda v: np.stack([-v[..., 1], v[..., 0], v[..., 2]], -1),
    "yx": lambda v: np.stack([v[..., 1], -v[..., 0], v[..., 2]], -1),
    "xz": lambda v: np.stack([-v[..., 2], v[..., 1], v[..., 0]], -1),
    "zx": lambda v: np.stack([v[..., 2], v[..., 1], -v[..., 0]], -1),
}


def standing(up, dtype=np.float64, batch=()):
    motion = random_motion(np.random.default_rng(0), 4, 5, dtype=dtype, batch=batch)
    return replace(motion, skeleton=replace(motion.skeleton, up=up))


@pytest.mark.parametrize("way", TURNED)
def test_the_world_is_turned_and_nothing_else(way):
    before = standing(way[0])
    after = jm.reorient(before, way[1])
    assert after.skeleton.up == way[1]
    for was, now in zip(world_by_matrices(before), world_by_matrices(after), strict=True):
        if was.shape[-2:] == (3, 3):  # the columns of a rotation matrix are vectors of the world
            was, now = np.swapaxes(was, -1, -2), np.swapaxes(now, -1, -2)
        np.testing.assert_allclose(now, TURNED[way](was), atol=1e-12)
    np.testing.assert_array_equal(after.rotations[:, 1:], before.rotations[:, 1:])
    np.testing.assert_array_equal(after.translations[:, 1:], before.translations[:, 1:])
    offsets, turned = np.asarray(before.skeleton.offsets), np.asarray(after.skeleton.offsets)
    np.testing.assert_array_equal(turned[0], TURNED[way](offsets[0]))
    np.testing.assert_array_equal(turned[1:], offsets[1:])


@pytest.mark.parametrize("way", TURNED)
def test_there_and_back(way, dtype):
    before = standing(way[0], dtype, batch=(2,))
    back = jm.reorient(jm.reorient(before, way[1]), way[0])
    assert jax.tree.structure(back) == jax.tree.structure(before)
    assert {leaf.dtype for leaf in jax.tree.leaves(back)} == {dtype}
    np.testing.assert_array_equal(back.translations, before.translations)
    np.testing.assert_array_equal(back.skeleton.offsets, before.skeleton.offsets)
    assert_same_rotation(back.rotations, before.rotations, 8 * np.finfo(dtype).eps)


def test_what_stands_so_already_is_left_alone():
    motion = standing("z")
    assert jm.reorient(motion, "z") is motion


def test_under_jit_and_vmap_and_differentiated():
    motion = standing("z")

    def turned(translations, rotations):
        after = jm.reorient(motion.with_transforms(translations, rotations), "x")
        return after.translations, after.rotations

    assert_jit_and_vmap_agree(turned, motion.translations, motion.rotations)
    check_gradients(turned, motion.translations, motion.rotations)


def test_facing_follows():
    """Whoever faces z in a world of y up faces −y when z is up."""
    walk = jm.samples.walk(8, fps=30.0).motion
    ahead = np.asarray(jm.facing_direction(walk))
    turned = np.asarray(jm.facing_direction(jm.reorient(walk, "z")))
    np.testing.assert_allclose(turned, TURNED["yz"](ahead), atol=1e-12)


def test_other_axes_are_refused():
    for up in ("Y", "-z", "w", ""):
        with pytest.raises(ValueError, match="expected 'x', 'y' or 'z'"):
            jm.reorient(standing("y"), up)
