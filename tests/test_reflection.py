"""Mirrored clips against reflected 4x4 matrices, on rigs of several makes and on real captures."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.kinematics import mirrored_pairs
from jaxmotion.reflection import _turns, _usual
from tests.helpers import (
    assert_jit_and_vmap_agree,
    assert_same_rotation,
    check_gradients,
    hung,
    quaternions_by,
    random_motion,
    scipy_rotation,
    world_by_matrices,
)

X, Y, Z = np.diag([-1.0, 1, 1]), np.diag([1.0, -1, 1]), np.diag([1.0, 1, -1])


@pytest.fixture(scope="module")
def walk():
    return jm.samples.load("walk", num_frames=48, fps=30.0).motion


def other_side(skeleton):
    side = np.arange(skeleton.num_joints)
    for left, right in mirrored_pairs(skeleton):
        side[left], side[right] = right, left
    return side


def rigged(motion, frames):
    """The same movement of a rig whose joints have other axes, matrices ``frames`` in the old."""
    skeleton = motion.skeleton
    above = np.stack([np.eye(3) if p < 0 else frames[p] for p in skeleton.parents])
    local = scipy_rotation(motion.rotations).as_matrix().reshape(*motion.rotations.shape[:2], 3, 3)
    matrices = np.swapaxes(above, -1, -2) @ local @ frames
    q = jm.quaternion.from_matrix(jnp.asarray(matrices))
    moved = np.einsum("jba,...jb->...ja", above, np.asarray(motion.translations))
    offsets = np.einsum("jba,jb->ja", above, np.asarray(skeleton.offsets))
    skeleton = replace(skeleton, offsets=offsets, end_joints=(), end_labels=(), end_offsets=None)
    return motion.replace(skeleton=skeleton, translations=jnp.asarray(moved), rotations=q)


def frames_of_two_sides(skeleton, limbs, middle, seed=0):
    """Axes of a rig: of the left any, of the right theirs in a mirror, all but ``limbs`` turned."""
    turns = np.random.default_rng(seed).standard_normal((skeleton.num_joints, 3))
    frames = scipy_rotation(quaternions_by(turns)).as_matrix()
    side = other_side(skeleton)
    for j, other in enumerate(side):
        if j == other:
            frames[j] = middle
        elif j < other:
            frames[other] = X @ frames[j] @ limbs
    return frames


def assert_reflected(before, after, matrix, through=0.0, atol=1e-9):
    """World positions of the joints of the other side, seen in a mirror."""
    side = other_side(before.skeleton)
    was, now = world_by_matrices(before)[0], world_by_matrices(after)[0]
    np.testing.assert_allclose(now, (was[:, side] - through) @ matrix + through, atol=atol)


def assert_turned(before, after, matrix, axes):
    """World rotations of the other side, seen in a mirror, with axes f[J, 3, 3] laid likewise."""
    was, now = world_by_matrices(before)[1], world_by_matrices(after)[1]
    np.testing.assert_allclose(now, matrix @ was[:, other_side(before.skeleton)] @ axes, atol=1e-7)


@pytest.mark.parametrize(("plane", "matrix"), [("x", X), ("z", Z)])
def test_world_in_a_mirror(walk, plane, matrix):
    mirrored = jm.mirror(walk, plane)
    assert_reflected(walk, mirrored, matrix)
    assert_turned(walk, mirrored, matrix, X)
    np.testing.assert_array_equal(mirrored.translations[:, 1:], walk.translations[:, 1:])
    assert eqx.tree_equal(mirrored.skeleton, walk.skeleton)
    assert mirrored.frame_time == walk.frame_time


@pytest.mark.parametrize("limbs", [-np.eye(3), X, Y, Z], ids=["-1", "x", "y", "z"])
@pytest.mark.parametrize("middle", [np.eye(3), np.eye(3)[[1, 2, 0]]], ids=["T-pose", "turned"])
def test_rigs_of_other_axes(walk, limbs, middle):
    """How axes mirror each other is found, whatever they are."""
    rig = rigged(walk, frames_of_two_sides(walk.skeleton, limbs, middle))
    np.testing.assert_allclose(world_by_matrices(rig)[0], world_by_matrices(walk)[0], atol=1e-9)
    mirrored = jm.mirror(rig, "x")
    assert_reflected(rig, mirrored, X)
    back = jm.mirror(mirrored, "x")
    assert_same_rotation(back.rotations, rig.rotations, atol=1e-7)


def twisted(motion, joint, about):
    """The joint half round its bone all the time."""
    turn = quaternions_by(np.radians(175) * np.broadcast_to(about, (motion.num_frames, 3)))
    q = jm.quaternion.multiply(motion.rotations[:, joint], jnp.asarray(turn))
    return motion.with_transforms(rotations=motion.rotations.at[:, joint].set(q))


def test_a_t_pose_needs_no_clip(walk):
    """One frame of a body that stands otherwise left than right."""
    odd = twisted(walk[:1], walk.skeleton.index("LeftArm"), [1.0, 0, 0])
    assert_turned(odd, jm.mirror(odd, "x"), X, X)


def test_a_reference_for_a_clip_of_one_side(walk):
    """An arm that is twisted all the time does not tell how its axes lie; a walk does."""
    side = other_side(walk.skeleton)
    frames = np.broadcast_to(np.eye(3), (walk.num_joints, 3, 3)).copy()
    frames[side < np.arange(walk.num_joints)] = -X
    rig = rigged(walk, frames)
    odd = twisted(rig, rig.skeleton.index("LeftArm"), [1.0, 0, 0])
    axes = np.where((side == np.arange(walk.num_joints))[:, None, None], X, -np.eye(3))
    assert_turned(odd, jm.mirror(odd, "x", reference=rig), X, axes)
    with pytest.raises(AssertionError):
        assert_turned(odd, jm.mirror(odd, "x"), X, axes)


def test_it_sets_out_alike(walk):
    """Seen from where it begins, and however the clip lies in the world."""
    mirrored = jm.mirror(walk)
    np.testing.assert_allclose(mirrored.root_positions[0], walk.root_positions[0], atol=1e-12)
    across = scipy_rotation(walk.rotations[0, 0]).as_matrix()[0, :, 0] * [1, 0, 1]
    across /= np.linalg.norm(across)
    matrix = np.eye(3) - 2 * np.outer(across, across)
    assert_reflected(walk, mirrored, matrix, np.asarray(walk.root_positions[0]))
    turn = jnp.asarray(quaternions_by([0, 2.1, 0]))

    def placed(clip):
        root = jm.quaternion.rotate(turn, clip.root_positions) + jnp.array([3.0, 0, -5])
        return clip.with_transforms(
            clip.translations.at[:, 0].set(root),
            clip.rotations.at[:, 0].set(jm.quaternion.multiply(turn, clip.rotations[:, 0])),
        )

    there, here = jm.mirror(placed(walk)), placed(mirrored)
    np.testing.assert_allclose(there.translations, here.translations, atol=1e-9)
    same = jnp.abs(jnp.sum(there.rotations * here.rotations, -1))
    np.testing.assert_allclose(same, 1, atol=1e-9)


@pytest.mark.parametrize("plane", ["body", "z"])
def test_twice_is_once(walk, plane):
    back = jm.mirror(jm.mirror(walk, plane), plane)
    np.testing.assert_allclose(back.rotations, walk.rotations, atol=1e-12)
    np.testing.assert_allclose(back.translations, walk.translations, atol=1e-12)


def test_joints_that_are_translated(walk):
    """Their way from the OFFSET is mirrored."""
    left, right = (walk.skeleton.index(f"{side}Hand") for side in ("Left", "Right"))
    moved = walk.translations.at[:, left].add(jnp.array([0.01, 0.02, 0.03]))
    motion = walk.replace(translations=moved, translated_joints=(0, left))
    mirrored = jm.mirror(motion, "x")
    assert mirrored.translated_joints == tuple(sorted((0, left, right)))
    assert_reflected(motion, mirrored, X)
    wanted = walk.translations[:, right] + jnp.array([-0.01, 0.02, 0.03])
    np.testing.assert_allclose(mirrored.translations[:, right], wanted, atol=1e-12)


def test_below_a_joint_that_stands_still(walk):
    below = hung(walk)
    mirrored = jm.mirror(below)
    np.testing.assert_array_equal(mirrored.rotations[:, 0], below.rotations[:, 0])
    np.testing.assert_array_equal(mirrored.translations[:, 0], below.translations[:, 0])
    wanted = world_by_matrices(jm.mirror(walk))[0]
    np.testing.assert_allclose(world_by_matrices(mirrored)[0][:, 1:], wanted, atol=1e-9)


def test_z_up(walk):
    mirrored = jm.mirror(jm.reorient(walk, "z"))
    wanted = world_by_matrices(jm.mirror(walk))[0]
    now = world_by_matrices(jm.reorient(mirrored, "y"))[0]
    np.testing.assert_allclose(now, wanted, atol=1e-9)


def test_float32_jit_vmap_and_derivatives(walk):
    clip = walk[:3]
    single = jm.mirror(clip.astype(np.float32))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single.rotations, jm.mirror(clip).rotations, atol=1e-6)

    def moved(p, q):
        mirrored = jm.mirror(clip.with_transforms(p, q))
        return mirrored.translations, mirrored.rotations

    p, q = jnp.asarray(clip.translations), jnp.asarray(clip.rotations)
    assert_jit_and_vmap_agree(moved, p, q)
    check_gradients(moved, p, q)


def test_nan_stays_where_it_is(walk):
    """On a rig whose axes are found by its poses, too."""
    rig = rigged(walk, frames_of_two_sides(walk.skeleton, Y, np.eye(3)))
    arm, other = (walk.skeleton.index(f"{side}ForeArm") for side in ("Left", "Right"))
    motion = rig.with_transforms(rotations=rig.rotations.at[7, arm].set(jnp.nan))
    mirrored, whole = jm.mirror(motion), jm.mirror(rig)
    odd = np.isnan(mirrored.rotations)
    assert np.argwhere(odd.all(-1)).tolist() == [[7, other]]
    np.testing.assert_array_equal(mirrored.rotations[~odd], whole.rotations[~odd])
    np.testing.assert_array_equal(mirrored.translations, whole.translations)


def test_refusals(walk):
    with pytest.raises(ValueError, match="plane='y' is across the axis that points up"):
        jm.mirror(walk, "y")
    with pytest.raises(ValueError, match="no left/right joints found by name"):
        jm.mirror(random_motion(np.random.default_rng(0)))
    arm, leg = walk.skeleton.index("LeftArm"), walk.skeleton.index("RightLeg")
    with pytest.raises(ValueError, match="'LeftArm' twice"):
        jm.mirror(walk, pairs=((arm, walk.skeleton.index("RightArm")), (arm, leg)))
    with pytest.raises(ValueError, match="do not hang from joints that are a pair"):
        jm.mirror(walk, pairs=((arm, leg),))
    with pytest.raises(ValueError, match="pairs must be"):
        jm.mirror(walk, pairs=((1, 99),))
    with pytest.raises(ValueError, match="reference has other joints"):
        jm.mirror(walk, reference=hung(walk))
    with pytest.raises(ValueError, match="one clip at a time"):
        jm.mirror(jm.stack([walk, walk])[0])


def test_on_its_side(walk):
    """The left is above the right: only an axis of the world will do."""
    q = np.zeros((2, walk.num_joints, 4))
    q[..., 0] = 1
    q[:, 0] = quaternions_by([0, 0, np.pi / 2])
    lying = walk[:2].with_transforms(rotations=jnp.asarray(q))
    with pytest.raises(ValueError, match="lies on its side in the first frame"):
        jm.mirror(lying)
    with pytest.raises(Exception, match="lies on its side in the first frame"):
        jax.block_until_ready(jax.jit(lambda m: jm.mirror(m).rotations)(lying))
    assert_reflected(lying, jm.mirror(lying, "x"), X)


def test_bones_that_mirror_in_no_way(walk):
    """Arms of other lengths, and twisted on their way."""
    arm = walk.skeleton.index("LeftForeArm")
    offsets = jnp.asarray(walk.skeleton.offsets).at[arm].mul(jnp.array([9.0, 1, 1]))
    odd = jm.Motion.from_root(
        replace(walk.skeleton, offsets=offsets), walk.root_positions, walk.rotations, 1 / 30
    )
    with pytest.raises(ValueError, match="axes of left and right joints do not mirror"):
        jm.mirror(odd)


def test_real_rigs(data_dir):
    """All of Bandai Namco's files have one rig, which a T-pose of identities does not show: spine
    and hips are mirrored in an axis each, limbs in the point. CMU's is a T-pose."""
    found = {}
    for folder in ("bandai", "cmu"):
        for path in sorted((data_dir / folder).glob("*.bvh")):
            clip = jm.load(path)
            side = tuple(other_side(clip.skeleton).tolist())
            turns, alike = _turns(clip.skeleton.parents, side, clip.body_joint, *_usual(clip))
            assert alike
            which = "".join("1xyz"[i] for i in np.asarray(turns).argmax(-1))
            found.setdefault(folder, set()).add(which)
    assert found == {"bandai": {"yyzzzz" + 16 * "1"}, "cmu": {31 * "x"}}


@pytest.mark.parametrize("name", ["bandai/walk_normal_001.bvh", "cmu/01_01.bvh"])
def test_real_clips(data_dir, name):
    """As the mirror shows them but for what bones of left and right differ by."""
    clip = jm.load(data_dir / name)[:120]
    mirrored = jm.mirror(clip, "x")
    was = world_by_matrices(clip)[0][:, other_side(clip.skeleton)] @ X
    now = world_by_matrices(mirrored)[0]
    height = np.ptp(now[:, :, 1], axis=1).max()
    assert np.linalg.norm(now - was, axis=-1).max() < 0.02 * height
    feet = [jm.metrics.foot_skate(m, jm.contacts.detect(m)) for m in (clip, mirrored)]
    assert feet[1] == pytest.approx(feet[0], rel=0.05)
