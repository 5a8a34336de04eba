"""The tree of joints: checks, levels, look-ups, and its life as a pytree."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import Skeleton
from jaxmotion._asf_bone import AsfBone
from jaxmotion.skeleton import Conventions, feet_by_name
from tests.helpers import random_skeleton

NAMES = ("Hips", "Spine", "LeftArm", "RightArm", "LeftHand")
PARENTS = (-1, 0, 1, 1, 2)


def _skeleton(**changes):
    given = {"names": NAMES, "parents": PARENTS, "offsets": np.zeros((5, 3))} | changes
    return Skeleton(given.pop("names"), given.pop("parents"), given.pop("offsets"), **given)


def test_levels_and_children():
    skeleton = _skeleton()
    assert skeleton.num_joints == 5
    assert skeleton.levels == ((0,), (1,), (2, 3), (4,))
    assert skeleton.children == ((1,), (2, 3), (4,), (), ())


@pytest.mark.parametrize("seed", range(3))
def test_levels_put_every_parent_one_level_up(seed):
    skeleton = random_skeleton(np.random.default_rng(seed), 20)
    depth = {j: d for d, level in enumerate(skeleton.levels) for j in level}
    assert sorted(depth) == list(range(20))
    for j, p in enumerate(skeleton.parents[1:], 1):
        assert depth[j] == depth[p] + 1
        assert j in skeleton.children[p]


def test_finding_joints():
    skeleton = _skeleton()
    assert skeleton.index("LeftArm") == 2
    assert skeleton.matching("left*") == (2, 4)
    assert skeleton.matching("*ARM") == (2, 3)
    assert skeleton.matching("Hips") == (0,)
    assert skeleton.matching("*arm", "left*") == (2, 3, 4)
    assert skeleton.matching() == ()
    with pytest.raises(ValueError, match="no joint is called 'leftarm'; the joints are Hips, Spi"):
        skeleton.index("leftarm")
    with pytest.raises(ValueError, match=r"no joint matches 'Tail\*'; the joints are Hips, Spine"):
        skeleton.matching("Tail*")


def test_defaults():
    skeleton = _skeleton(end_joints=(3, 4), end_offsets=np.ones((2, 3)))
    assert skeleton.channels[0][:3] == ("Xposition", "Yposition", "Zposition")
    assert all(c == ("Zrotation", "Xrotation", "Yrotation") for c in skeleton.channels[1:])
    assert skeleton.end_labels == ("End Site", "End Site")
    assert (skeleton.up, skeleton.length_unit, skeleton.asf) == ("y", 1.0, ())
    assert _skeleton().end_offsets.shape == (0, 3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"names": (), "parents": ()}, "names is empty"),
        ({"names": ("a", "b", "a", "c", "d")}, r"names must be unique; \['a'\] occur more"),
        ({"parents": (-1, 0)}, r"parents must have 5 entries and begin with -1, got \(-1, 0\)"),
        ({"parents": (0, 0, 1, 1, 2)}, "begin with -1"),
        ({"parents": (-1, 0, 3, 1, 2)}, r"parents\[2\] is 3; each parent must come before"),
        ({"parents": (-1, -1, 1, 1, 2)}, r"parents\[1\] is -1"),
        ({"offsets": np.zeros((4, 3))}, r"offsets must have shape \(5, 3\), got \(4, 3\)"),
        ({"end_joints": (4,)}, r"names 1 end sites, but end_offsets has shape \(0, 3\)"),
        (
            {"end_joints": (4,), "end_offsets": np.zeros((1, 3)), "end_labels": ("a", "b")},
            "end_labels 2 entries",
        ),
        ({"end_joints": (5,), "end_offsets": np.zeros((1, 3))}, r"end_joints\[0\] is 5"),
        ({"end_joints": (-1,), "end_offsets": np.zeros((1, 3))}, r"end_joints\[0\] is -1"),
        ({"channels": (("Xrotation",),)}, "channels must have 5 entries, got 1"),
        ({"asf": (AsfBone(),)}, "asf must have 5 entries, got 1"),
        ({"up": "Y"}, "up='Y'; expected 'x', 'y' or 'z'"),
    ],
)
def test_pieces_that_do_not_fit(changes, message):
    with pytest.raises(ValueError, match=message):
        _skeleton(**changes)


def test_only_offsets_are_leaves():
    skeleton = _skeleton(end_joints=(4,), end_offsets=np.ones((1, 3)))
    leaves, structure = jax.tree.flatten(skeleton)
    assert [leaf.shape for leaf in leaves] == [(5, 3), (1, 3)]
    again = jax.tree.unflatten(structure, leaves)
    assert eqx.tree_equal(again, skeleton)
    assert again.levels == skeleton.levels
    assert structure == jax.tree.structure(_skeleton(end_joints=(4,), end_offsets=np.ones((1, 3))))
    assert structure != jax.tree.structure(_skeleton())
    assert not eqx.tree_equal(_skeleton(), _skeleton(up="z"))


def test_bone_lengths_can_be_optimised():
    skeleton = _skeleton(offsets=jnp.ones((5, 3)))

    @jax.jit
    def total(skeleton):
        assert skeleton.names == NAMES
        return jnp.sum(skeleton.offsets**2)

    np.testing.assert_array_equal(jax.grad(total)(skeleton).offsets, np.full((5, 3), 2.0))


def test_skeletons_cannot_be_changed_in_place():
    with pytest.raises(AttributeError):
        _skeleton().up = "z"


def test_conventions_tell_people_and_part_nothing():
    """Clips that differ in what is assumed go together in one tree."""
    told, assumed = _skeleton(), _skeleton(conventions=Conventions(up="assumed", metres=0.01))
    assert jax.tree.structure(told) == jax.tree.structure(assumed)
    assert eqx.tree_equal(told, assumed)
    assert assumed.conventions.metres == 0.01
    assert told.conventions != assumed.conventions


def test_feet_by_name_are_the_topmost_joint_of_each():
    names = ["Hips", "LeftFoot", "LeftFootToe", "leg", "Right_ANKLE", "hoof.end", "paw"]
    skeleton = Skeleton(names, [-1, 0, 1, 0, 3, 4, 2], np.zeros((7, 3)))
    assert feet_by_name(skeleton) == (1, 4)
    assert feet_by_name(Skeleton(["foot"], [-1], np.zeros((1, 3)))) == (0,)
    assert feet_by_name(Skeleton(["a"], [-1], np.zeros((1, 3)))) == ()


def test_the_up_axis_is_the_component_of_heights():
    for i, up in enumerate("xyz"):
        assert Skeleton(["root"], [-1], np.eye(3)[i][None], up=up).up_axis == i
