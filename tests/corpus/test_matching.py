"""Clips brought to one skeleton keep their joints where they are in the world."""

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.corpus.matching import matched, multiplied, reduced, rotated
from tests.corpus.clips import clip
from tests.helpers import world_by_matrices

NAMES = ("Hips", "Spine", "Spine1", "Chest", "Arm", "Leg")
PARENTS = (-1, 0, 1, 2, 3, 0)


def body(names=NAMES, parents=PARENTS, seed=0, frames=7, dtype=np.float64, **more):
    rng = np.random.default_rng(seed)
    bones = jm.Skeleton(
        names,
        parents,
        rng.standard_normal((len(names), 3)).astype(dtype),
        end_joints=[len(names) - 1],
        end_offsets=np.full((1, 3), 0.5, dtype),
        **more,
    )
    return clip(frames, seed, dtype, bones)


def brought(motion, skeleton, may_drop=frozenset()):
    x = matched(motion, skeleton, may_drop)
    return jm.Motion(
        skeleton, x.translations, x.rotations, motion.frame_time, translated_joints=x.translated
    )


def positions(motion):
    by_name = dict(zip(motion.skeleton.names, range(motion.num_joints), strict=True))
    return {n: np.asarray(world_by_matrices(motion)[0])[:, j] for n, j in by_name.items()}


def assert_where_it_was(got, want):
    there, was = positions(got), positions(want)
    for name in got.skeleton.names:
        np.testing.assert_allclose(there[name], was[name], 1e-12, 1e-12, err_msg=name)


def test_the_same_joints_stay_as_they_are(dtype):
    motion = body(dtype=dtype)
    x = matched(motion, body(seed=3, dtype=dtype).skeleton, frozenset())
    assert x.rotations.dtype == dtype
    np.testing.assert_array_equal(x.rotations, motion.rotations)
    np.testing.assert_array_equal(x.offsets, motion.skeleton.offsets)


def test_joints_in_another_order_are_put_in_order():
    other = ("Hips", "Leg", "Spine", "Spine1", "Chest", "Arm")
    motion = body(other, (-1, 0, 0, 2, 3, 4), seed=1)
    got = brought(motion, body().skeleton)
    assert got.skeleton.names == NAMES
    assert_where_it_was(got, motion)
    assert got.translated_joints == (0,)


@pytest.mark.parametrize(
    ("kept", "parents"),
    [
        (("Hips", "Spine", "Chest", "Arm", "Leg"), (-1, 0, 1, 2, 0)),  # one between
        (("Hips", "Chest", "Arm"), (-1, 0, 1)),  # two between, and a leaf
        (("Chest", "Arm"), (-1, 0)),  # the root
    ],
)
def test_what_hangs_from_a_dropped_joint_stays_in_the_world(kept, parents):
    motion = body(seed=2)
    skeleton = reduced(motion.skeleton, kept)
    assert (skeleton.names, skeleton.parents) == (kept, parents)
    for may_drop in (None, frozenset(NAMES)):
        got = brought(motion, skeleton, may_drop)
        assert_where_it_was(got, motion)
        assert 0 in got.translated_joints
        bones = matched(motion, skeleton, may_drop).offsets
        np.testing.assert_allclose(bones, skeleton.offsets, 1e-12)
    if "Chest" in kept[1:]:
        assert kept.index("Chest") in got.translated_joints


def test_bones_of_the_reduced_skeleton_add_up():
    whole = body().skeleton
    got = reduced(whole, ["Hips", "Chest", "Leg"])
    np.testing.assert_allclose(got.offsets[1], np.sum(np.asarray(whole.offsets)[1:4], axis=0))
    assert got.end_joints == (2,)
    np.testing.assert_array_equal(got.end_offsets, whole.end_offsets)


def test_end_sites_are_found_by_joint():
    skeleton = body().skeleton
    other = body(("Hips", "Leg", "Spine", "Spine1", "Chest", "Arm"), (-1, 0, 0, 2, 3, 4)).skeleton
    own = jm.Skeleton(
        other.names,
        other.parents,
        other.offsets,
        end_joints=[5, 1],
        end_offsets=np.array([[9.0, 9, 9], [1, 2, 3]]),
    )
    x = matched(clip(4, bones=own), skeleton, frozenset())
    np.testing.assert_array_equal(x.ends, [[1, 2, 3]])
    none = jm.Skeleton(other.names, other.parents, other.offsets)
    x = matched(clip(4, bones=none), skeleton, frozenset())
    np.testing.assert_array_equal(x.ends, [[0.5, 0.5, 0.5]])


def test_what_does_not_fit_is_told():
    skeleton = body().skeleton
    short = body(NAMES[:4], PARENTS[:4])
    with pytest.raises(ValueError, match="no joint is called 'Arm', nor 1 more of the corpus's"):
        matched(short, skeleton, None)
    other = jm.Skeleton(["A", "B"], [-1, 0], np.ones((2, 3)), length_unit=2.0)
    with pytest.raises(ValueError, match="joint"):  # not that it is in another unit
        matched(body(), other, None)
    with pytest.raises(ValueError, match="joints that the corpus's skeleton lacks: 'Arm', 'Leg'; "):
        matched(body(), short.skeleton, frozenset())
    with pytest.raises(ValueError, match="'Arm' hangs from 'Spine', in the corpus from 'Chest'"):
        matched(body(parents=(-1, 0, 1, 2, 1, 0)), skeleton, None)
    with pytest.raises(ValueError, match="'Leg' hangs from 'Hips', in the corpus from none"):
        matched(body(), jm.Skeleton(["Leg", "Hips"], [-1, 0], np.ones((2, 3))), None)
    with pytest.raises(ValueError, match=r"up is z, the corpus's y; jaxmotion\.reorient"):
        matched(body(up="z"), skeleton, None)
    with pytest.raises(ValueError, match=r"length_unit is 2\.0, the corpus's 1\.0"):
        matched(body(length_unit=2.0), skeleton, None)
    with pytest.raises(ValueError, match="several trees, from 'Chest', 'Leg'"):
        reduced(skeleton, ["Chest", "Leg"])
    with pytest.raises(ValueError, match="no joint matches 'Wing'"):
        reduced(skeleton, ["Wing"])


def test_products_and_turns_are_the_librarys():
    rng = np.random.default_rng(0)
    a, b = (x / np.linalg.norm(x, axis=-1, keepdims=True) for x in rng.standard_normal((2, 9, 4)))
    v = rng.standard_normal((9, 3))
    ours = multiplied(a, b), rotated(a, v)
    theirs = jm.quaternion.multiply(a, b), jm.quaternion.rotate(a, v)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, 1e-13, 1e-13), ours, theirs)
