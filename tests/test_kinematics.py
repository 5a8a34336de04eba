"""Forward kinematics against 4x4 matrices, its hand-written derivative, velocities and facing."""

import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmotion import Motion, Skeleton, forward_kinematics
from jaxmotion import quaternion as qt
from jaxmotion.kinematics import facing_direction, mirrored_pairs, velocities
from tests.helpers import (
    angle_between,
    assert_finite_derivatives,
    assert_trees_close,
    check_gradients,
    no_shape_checks,
    random_motion,
    random_quaternions,
    random_skeleton,
    world_by_matrices,
)

CMU_SHAPE = [-1] + [j - 1 if j % 6 else 0 for j in range(1, 65)]


def _assert_world(pose, motion, tolerance):
    positions, matrices, tips = world_by_matrices(motion)
    np.testing.assert_allclose(pose.positions, positions, tolerance, tolerance)
    np.testing.assert_allclose(pose.end_positions, tips, tolerance, tolerance)
    world = Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_quat(scalar_first=True)
    assert np.max(angle_between(pose.rotations, world.reshape(pose.rotations.shape))) < tolerance
    np.testing.assert_allclose(np.linalg.norm(pose.rotations, axis=-1), 1, atol=tolerance)


@pytest.mark.parametrize(
    ("kind", "joints", "frames"),
    [("tree", 12, 4), ("chain", 6, 3), ("star", 6, 2), ("tree", 1, 1), ("tree", 2, 1)],
)
def test_world_transforms_are_products_of_matrices(kind, joints, frames, dtype):
    rng = np.random.default_rng(joints)
    skeleton = random_skeleton(rng, joints, kind, dtype)
    motion = random_motion(rng, frames, skeleton, dtype)
    pose = forward_kinematics(motion)
    assert all(leaf.dtype == dtype for leaf in jax.tree.leaves(pose))
    _assert_world(pose, motion, 2e-5 if dtype == np.float32 else 1e-12)


def test_random_trees():
    rng = np.random.default_rng(1)
    for joints in (3, 9, 17):
        motion = random_motion(rng, 3, joints)
        _assert_world(forward_kinematics(motion), motion, 1e-12)


def test_leading_axes_and_vmap():
    rng = np.random.default_rng(2)
    motion = random_motion(rng, 4, 5, batch=(2, 3))
    pose = forward_kinematics(motion)
    assert pose.positions.shape == (2, 3, 4, 5, 3)
    _assert_world(pose, motion, 1e-12)
    one = Motion(motion.skeleton, motion.translations[1, 2], motion.rotations[1, 2], 1 / 30)
    np.testing.assert_allclose(forward_kinematics(one).positions, pose.positions[1, 2], atol=1e-14)

    def over_clips(translations, rotations):
        return forward_kinematics(Motion(motion.skeleton, translations, rotations, 1 / 30))

    mapped = jax.vmap(jax.vmap(over_clips))(motion.translations, motion.rotations)
    assert_trees_close(mapped, pose, 1e-13, 1e-13)


def test_not_compiled_is_the_same():
    motion = random_motion(np.random.default_rng(3), 2, 4)
    compiled = forward_kinematics(motion)
    with jax.disable_jit():
        assert_trees_close(forward_kinematics(motion), compiled, 1e-14, 1e-14)


def test_no_frames_and_no_end_sites():
    rng = np.random.default_rng(4)
    motion = random_motion(rng, 0, random_skeleton(rng, 4, end_sites=False))
    pose = forward_kinematics(motion)
    assert pose.positions.shape == (0, 4, 3)
    assert pose.end_positions.shape == (0, 0, 3)


def test_translations_replace_offsets_at_inner_joints():
    rng = np.random.default_rng(5)
    motion = random_motion(rng, 2, random_skeleton(rng, 4, "chain"))
    other = Skeleton(
        motion.skeleton.names,
        motion.skeleton.parents,
        motion.skeleton.offsets + 10,
        end_joints=motion.skeleton.end_joints,
        end_offsets=motion.skeleton.end_offsets,
    )
    moved = Motion(other, motion.translations, motion.rotations, motion.frame_time)
    assert_trees_close(forward_kinematics(moved), forward_kinematics(motion), 0, 0)
    at_offsets = Motion.from_root(
        motion.skeleton, motion.root_positions, motion.rotations, motion.frame_time
    )
    x = forward_kinematics(at_offsets).positions
    bones = np.linalg.norm(np.diff(x, axis=1), axis=-1)
    lengths = np.linalg.norm(motion.skeleton.offsets[1:], axis=-1)
    np.testing.assert_allclose(bones, np.broadcast_to(lengths, bones.shape), 1e-13)


@pytest.mark.parametrize("moved", [(), (0,), (3, 1), (0, 1, 2), (2, 4), (4, 0, 3, 1, 2)])
def test_a_joint_that_is_not_translated_has_its_first_frame_s_translation(moved):
    """A star under a chain: levels with none, some and all of their joints translated."""
    rng = np.random.default_rng(25)
    bones = rng.standard_normal((6, 3))
    skeleton = Skeleton(
        list("abcde"), (-1, 0, 1, 1, 1), bones[:5], end_joints=(3,), end_offsets=bones[5:]
    )
    given = random_motion(rng, 3, skeleton, batch=(2,))
    motion = Motion(
        skeleton, given.translations, given.rotations, given.frame_time, translated_joints=moved
    )
    moves = np.isin(np.arange(5), moved)[:, None]

    def ours(translations, rotations):
        pose = forward_kinematics(motion.with_transforms(translations, rotations))
        return pose.positions, pose.rotations, pose.end_positions

    def naive(translations, rotations):
        still = jnp.where(moves, translations, translations[:1])
        return _naive(still, rotations, jnp.asarray(skeleton.end_offsets), motion)

    naive = jax.vmap(naive)
    where = motion.translations, motion.rotations
    tangents = jax.tree.map(lambda x: jnp.asarray(rng.standard_normal(x.shape)), where)
    value, pull = jax.vjp(ours, *where)
    expected, pull_of_naive = jax.vjp(naive, *where)
    assert_trees_close(value, expected, 1e-13, 1e-13)
    cotangents = jax.tree.map(lambda x: jnp.asarray(rng.standard_normal(x.shape)), expected)
    assert_trees_close(pull(cotangents), pull_of_naive(cotangents), 1e-12, 1e-12)
    pushed, expected = (jax.jvp(f, where, tangents)[1] for f in (ours, naive))
    assert_trees_close(pushed, expected, 1e-12, 1e-12)


def test_rotations_are_normalised_inside():
    motion = random_motion(np.random.default_rng(6), 3, 5)
    pose = forward_kinematics(motion)
    scaled = motion.with_transforms(rotations=-3 * motion.rotations)
    np.testing.assert_allclose(forward_kinematics(scaled).positions, pose.positions, atol=1e-13)

    def loss(q):
        return jnp.sum(forward_kinematics(scaled.with_transforms(rotations=q)).positions ** 2)

    gradient = jax.grad(loss)(scaled.rotations)
    along = jnp.sum(gradient * scaled.rotations, -1)
    np.testing.assert_allclose(along, 0, atol=1e-11)
    assert np.max(np.abs(gradient)) > 0.1


def test_the_zero_quaternion_stands_for_the_identity():
    motion = random_motion(np.random.default_rng(7), 2, 4)
    unit = motion.with_transforms(rotations=motion.rotations.at[:, 1].set([1.0, 0, 0, 0]))
    zero = motion.with_transforms(rotations=motion.rotations.at[:, 1].set(0.0))
    assert_trees_close(forward_kinematics(zero), forward_kinematics(unit), 1e-14, 1e-14)
    gradient = jax.grad(
        lambda q: jnp.sum(forward_kinematics(zero.with_transforms(rotations=q)).positions ** 2)
    )(zero.rotations)
    assert np.all(np.isfinite(gradient))


def _naive(translations, rotations, ends, motion):
    """One joint after another, left to JAX to differentiate."""
    q, x = [], []
    for j, p in enumerate(motion.skeleton.parents):
        local = qt.normalize(rotations[:, j])
        q.append(local if p < 0 else qt.multiply(q[p], local))
        x.append(translations[:, j] if p < 0 else x[p] + qt.rotate(q[p], translations[:, j]))
    tips = [x[j] + qt.rotate(q[j], ends[i]) for i, j in enumerate(motion.skeleton.end_joints)]
    return jnp.stack(x, 1), jnp.stack(q, 1), jnp.stack(tips, 1)


@pytest.mark.parametrize(("kind", "joints"), [("tree", 6), ("chain", 4)])
def test_derivatives_in_both_modes_are_those_of_the_plain_loop(kind, joints):
    rng = np.random.default_rng(8)
    skeleton = random_skeleton(rng, joints, kind)
    motion = random_motion(rng, 2, skeleton)

    def ours(translations, rotations, ends):
        moved = Motion(
            Skeleton(
                skeleton.names,
                skeleton.parents,
                skeleton.offsets,
                end_joints=skeleton.end_joints,
                end_offsets=ends,
            ),
            translations,
            rotations,
            motion.frame_time,
        )
        pose = forward_kinematics(moved)
        return pose.positions, pose.rotations, pose.end_positions

    def naive(translations, rotations, ends):
        return _naive(translations, rotations, ends, motion)

    # Not unit: the derivative through the normalisation counts.
    where = (motion.translations, 1.7 * motion.rotations, jnp.asarray(skeleton.end_offsets))
    tangents = jax.tree.map(lambda x: jnp.asarray(rng.standard_normal(x.shape)), where)
    cotangents = jax.tree.map(
        lambda x: jnp.asarray(rng.standard_normal(x.shape)), jax.eval_shape(naive, *where)
    )

    def both_modes(f):
        @jax.jit
        def run(where, tangents, cotangents):
            return jax.jvp(f, where, tangents), jax.vjp(f, *where)[1](cotangents)

        return run(where, tangents, cotangents)

    assert_trees_close(both_modes(ours), both_modes(naive), 1e-12, 1e-12)


def test_gradients_and_second_derivatives():
    motion = random_motion(np.random.default_rng(9), 2, 5)
    check_gradients(forward_kinematics, motion)

    def loss(motion):
        pose = forward_kinematics(motion)
        return jnp.sum(jnp.sin(pose.positions)) + jnp.sum(pose.end_positions[..., :1] ** 3)

    check_gradients(jax.grad(loss), motion, rtol=1e-5, atol=1e-5)


def test_gradients_of_many_clips_at_once():
    motion = random_motion(np.random.default_rng(10), 2, 4, batch=(3,))

    def loss(q, t):
        pose = forward_kinematics(Motion(motion.skeleton, t, q, 1 / 30))
        return jnp.sum(pose.positions**3)

    q, t = motion.rotations, motion.translations
    together = jax.vmap(jax.grad(loss))(q, t)
    summed = jax.grad(lambda q: jnp.sum(jax.vmap(loss)(q, t)))(q)
    np.testing.assert_allclose(together, summed, atol=1e-12)
    one = jax.grad(loss)(q[1], t[1])
    np.testing.assert_allclose(together[1], one, atol=1e-12)


def _captured(frames, dtype=np.float32):
    skeleton = Skeleton([f"j{j}" for j in range(65)], CMU_SHAPE, np.zeros((65, 3), dtype))
    shape = (frames, 65)
    return Motion(skeleton, jnp.ones((*shape, 3), dtype), qt.identity(shape, dtype), 1 / 30)


def test_compile_time_and_program_do_not_grow_with_the_frames():
    def energy(translations, rotations, motion):
        pose = forward_kinematics(motion.with_transforms(translations, rotations))
        return jnp.sum(pose.positions**2) + jnp.sum(pose.rotations[..., 0])

    gradient = jax.value_and_grad(energy, (0, 1))
    sizes = []
    for frames in (2, 3000):
        motion = _captured(frames)
        text = str(jax.make_jaxpr(gradient)(motion.translations, motion.rotations, motion))
        sizes.append(text.count(" = "))
    assert sizes[0] == sizes[1]
    motion = _captured(100)
    start = time.process_time()
    jax.jit(gradient).lower(motion.translations, motion.rotations, motion).compile()
    assert time.process_time() - start < 6


def test_the_same_tree_compiles_once():
    traces = []

    @jax.jit
    def run(motion):
        traces.append(1)
        return forward_kinematics(motion).positions

    for seed in (0, 1):
        skeleton = random_skeleton(np.random.default_rng(3), 5)
        run(random_motion(np.random.default_rng(seed), 4, skeleton))
    assert len(traces) == 1
    run(random_motion(np.random.default_rng(2), 4, random_skeleton(np.random.default_rng(5), 5)))
    assert len(traces) == 2


def _spinning(frames, rate, slope, seconds=0.02, dtype=np.float64):
    """One child on a root that turns at ``rate`` f[3] rad/s and travels at ``slope`` f[3]."""
    t = np.arange(frames) * seconds
    skeleton = Skeleton(["root", "tip"], [-1, 0], np.array([[0, 0, 0], [0.3, 0.4, -0.2]], dtype))
    turn = qt.exp(jnp.asarray(t[:, None] * rate, dtype))
    start = random_quaternions(np.random.default_rng(11), (), dtype)
    q = jnp.stack([qt.multiply(turn, start), qt.identity((frames,), dtype)], 1)
    return Motion.from_root(skeleton, jnp.asarray(t[:, None] * slope, dtype), q, seconds)


@pytest.mark.parametrize("frames", [2, 3, 9])
def test_velocities_of_a_steady_turn(frames, dtype):
    rate, slope = np.array([0.4, -1.1, 0.7]), np.array([1.0, 2.0, -3.0])
    motion = _spinning(frames, rate, slope, dtype=dtype)
    v = velocities(motion)
    assert v.linear.dtype == v.angular.dtype == dtype
    tolerance = 2e-4 if dtype == np.float32 else 1e-11
    np.testing.assert_allclose(v.angular, np.broadcast_to(rate, (frames, 2, 3)), atol=tolerance)
    np.testing.assert_allclose(v.linear[:, 0], np.broadcast_to(slope, (frames, 3)), atol=tolerance)
    if frames > 2:  # v = v_root + ω × r to second order in the frame time
        x = np.asarray(forward_kinematics(motion).positions, np.float64)
        expected = slope + np.cross(rate, x[:, 1] - x[:, 0])
        np.testing.assert_allclose(v.linear[1:-1, 1], expected[1:-1], atol=3e-4)


def test_velocities_of_one_frame_are_zero_and_differentiable():
    motion = random_motion(np.random.default_rng(12), 1, 3)
    v = velocities(motion)
    np.testing.assert_array_equal(v.linear, np.zeros((1, 3, 3)))
    np.testing.assert_array_equal(v.angular, np.zeros((1, 3, 3)))


def test_velocity_derivatives():
    rng = np.random.default_rng(13)
    skeleton = random_skeleton(rng, 3)
    steps = random_quaternions(rng, (4, 3), angle=0.5)
    moving = random_motion(rng, 4, skeleton).with_transforms(rotations=steps)
    check_gradients(velocities, moving, rtol=1e-5, atol=1e-4)
    resting = Motion.from_root(
        skeleton, np.zeros((3, 3)), np.asarray(qt.identity((3, 3), np.float64)), 0.1
    )

    def still(q):
        v = velocities(resting.with_transforms(rotations=q))
        return v.linear, v.angular

    assert_finite_derivatives(still, resting.rotations)


def _biped(up="y", names=("Hips", "LeftLeg", "RightLeg", "LeftFoot", "RightFoot")):
    """Left on +X: it faces +Z with Y up."""
    offsets = np.array([[0, 1, 0], [0.1, 0, 0], [-0.1, 0, 0], [0, -0.9, 0], [0, -0.9, 0.0]])
    if up == "z":
        offsets = offsets[:, [2, 0, 1]]
    return Skeleton(names, [-1, 0, 0, 1, 2], offsets, up=up)


@pytest.mark.parametrize("up", ["y", "z"])
def test_facing_follows_the_heading(up, dtype):
    skeleton = _biped(up)
    heading = np.linspace(-3, 3, 7)
    axis = np.eye(3)["xyz".index(up)]
    q = np.tile(np.eye(4)[0], (7, 5, 1))
    q[:, 0] = Rotation.from_rotvec(heading[:, None] * axis).as_quat(scalar_first=True)
    motion = Motion.from_root(skeleton, np.zeros((7, 3), dtype), jnp.asarray(q, dtype), 0.1).astype(
        dtype
    )
    ahead = np.array([0, 0, 1.0]) if up == "y" else np.array([1.0, 0, 0])
    expected = Rotation.from_rotvec(heading[:, None] * axis).apply(ahead)
    facing = facing_direction(motion)
    assert facing.dtype == dtype
    np.testing.assert_allclose(facing, expected, atol=1e-6 if dtype == np.float32 else 1e-14)
    np.testing.assert_allclose(facing_direction(motion, ((3, 4),)), facing, atol=1e-6)


def test_facing_has_finite_derivatives_lying_down():
    q = np.tile(np.eye(4)[0], (2, 5, 1))
    q[0, 0] = np.sqrt(0.5) * np.array([1.0, 0, 0, 1.0])
    motion = Motion.from_root(_biped(), np.zeros((2, 3)), q, 0.1)
    (by_q,) = assert_finite_derivatives(
        lambda q: facing_direction(motion.with_transforms(rotations=q)), motion.rotations
    )
    np.testing.assert_array_equal(by_q[0], np.zeros((3, 2, 5, 4)))
    np.testing.assert_allclose(facing_direction(motion), [[0, 0, 0], [0, 0, 1]], atol=1e-15)
    check_gradients(
        lambda q: facing_direction(motion.with_transforms(rotations=q)),
        random_quaternions(np.random.default_rng(14), (2, 5)),
    )


@pytest.mark.parametrize(
    ("names", "pairs"),
    [
        (("mixamorig:Hips", "mixamorig:LeftArm", "mixamorig:RightArm"), ((1, 2),)),
        (("root", "rfemur", "lfemur", "lowerback"), ((2, 1),)),
        (("Hips", "Hand_L", "Hand_R", "Foot_R", "Foot_L"), ((1, 2), (4, 3))),
        (("Hips", "LThumb", "RThumb", "LHipJoint", "RHipJoint"), ((1, 2), (3, 4))),
        (("pelvis", "l_hip", "r_hip", "hand.l", "hand.r"), ((1, 2), (3, 4))),
        (("hip", "__lthumb", "__rthumb", "rthumb", "lthumb"), ((1, 2), (4, 3))),
        (("Hips", "LeftUpLeg", "Spine", "LowerBack", "Neck"), ()),
        (("Hips", "Spine_Lower", "Neck_1"), ()),
    ],
)
def test_mirrored_pairs(names, pairs):
    skeleton = Skeleton(names, [-1] + [0] * (len(names) - 1), np.zeros((len(names), 3)))
    assert mirrored_pairs(skeleton) == pairs


def test_facing_needs_a_left_and_a_right():
    motion = random_motion(np.random.default_rng(15), 2, 3)
    with pytest.raises(ValueError, match="no left/right joints found by name"):
        facing_direction(motion)


def test_inputs_are_left_alone():
    motion = jax.tree.map(np.array, random_motion(np.random.default_rng(16), 2, 4))
    kept = jax.tree.map(np.copy, motion)
    forward_kinematics(motion)
    velocities(motion)
    assert_trees_close(motion, kept, 0, 0)


def test_facing_is_of_joints_there_are():
    """Numbers out of range were once clamped."""
    motion = random_motion(np.random.default_rng(15), 2, 3)
    for pairs in (((99, 98),), ((1, -1),), ((1, 3),), ((0.5, 1),), (1, 2), ((1, 2, 0),)):
        with (
            no_shape_checks(),
            pytest.raises(ValueError, match=r"facing_direction: pairs must be .* 0\.\.2, got"),
        ):
            facing_direction(motion, pairs)
    want = facing_direction(motion, ((1, 2),))
    for pairs in ([[1, 2]], np.array([[1, 2]])):
        with no_shape_checks():
            np.testing.assert_array_equal(facing_direction(motion, pairs), want)
    with no_shape_checks(), pytest.raises(ValueError, match="not traced"):
        jax.jit(lambda left: facing_direction(motion, ((left, 2),)))(1)
