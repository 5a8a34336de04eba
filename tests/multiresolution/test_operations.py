"""Edits by level: identities, gains by level and joint, and the paper's comparison with Euler
angles (Figures 10 and 11)."""

from dataclasses import replace
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion import quaternion
from jaxmotion.multiresolution import blend, build_pyramid, level_of_detail, scale_details
from tests.helpers import assert_same_rotation, no_shape_checks
from tests.multiresolution.oracles import reduced_vectors, swaying, vectors_between

FRAMES, LEVELS = 17, 2


@pytest.fixture(scope="module")
def clips():
    return [swaying(FRAMES, seed=s, moving=True) for s in range(3)]


def assert_same_motion(got, want, atol=1e-12):
    assert_same_rotation(got.rotations, want.rotations, atol)
    np.testing.assert_allclose(got.translations, want.translations, atol=atol)


def test_levels_of_detail(clips):
    pyramid = build_pyramid(clips[0], LEVELS)
    assert_same_motion(level_of_detail(pyramid, LEVELS), clips[0])
    assert_same_motion(level_of_detail(pyramid, 7), clips[0])
    assert_same_motion(level_of_detail(pyramid, 0), scale_details(pyramid, np.zeros(2)))
    assert_same_motion(level_of_detail(pyramid, 1), scale_details(pyramid, np.array([1.0, 0])))
    some = level_of_detail(pyramid, 1.25)
    assert_same_motion(some, scale_details(pyramid, np.array([1, 0.25])))
    base = np.asarray(level_of_detail(pyramid, 0).rotations)[::4]
    assert_same_rotation(base, pyramid.base.rotations)


def test_gains(clips):
    pyramid = build_pyramid(clips[0], LEVELS)
    back = pyramid.reconstruct()
    one = scale_details(pyramid, 1.0)
    np.testing.assert_array_equal(one.rotations, back.rotations)
    np.testing.assert_array_equal(one.translations, back.translations)
    gains = np.ones((LEVELS, 3))
    gains[:, 1] = 1.7
    strong = scale_details(pyramid, gains)
    np.testing.assert_array_equal(strong.rotations[:, ::2], back.rotations[:, ::2])
    again = build_pyramid(strong, 0)
    assert again.levels == 0
    apart = quaternion.distance(strong.rotations[:, 1], back.rotations[:, 1])
    assert np.max(apart) > 0.01
    huge = scale_details(pyramid, 1e3)
    np.testing.assert_allclose(np.linalg.norm(huge.rotations, axis=-1), 1, atol=1e-12)
    with no_shape_checks(), pytest.raises(ValueError, match=r"gains has shape \(5,\)"):
        scale_details(pyramid, np.ones(5))


def test_gains_are_the_layers_scaled(clips):
    """The finest level's gain, by hand: d scaled on what the level below expands to."""
    pyramid = build_pyramid(clips[0], 1)
    smooth = scale_details(pyramid, np.zeros(1))
    got = scale_details(pyramid, np.array([1.5]))
    for j in range(3):
        r = Rotation.from_quat(np.asarray(smooth.rotations)[:, j], scalar_first=True)
        v = 3.0 * np.asarray(pyramid.details[0].rotations)[:, j]
        want = (r * Rotation.from_rotvec(v)).as_quat(scalar_first=True)
        assert_same_rotation(got.rotations[:, j], want)
        u = 1.5 * np.asarray(pyramid.details[0].translations)[:, j]
        want = np.asarray(smooth.translations)[:, j] + r.apply(u)
        np.testing.assert_allclose(got.translations[:, j], want, atol=1e-13)


def test_blends(clips):
    a, b, c = clips
    assert_same_motion(blend(a, b, a, LEVELS), b)
    assert_same_motion(blend(a, a, b, LEVELS), b)
    assert_same_motion(blend(a, a, a, LEVELS), a)
    mixed = blend(a, b, c, LEVELS)
    assert min(np.max(quaternion.distance(mixed.rotations, m.rotations)) for m in clips) > 0.05
    with no_shape_checks(), pytest.raises(ValueError, match=r"first has shape \(9, 3, 4\)"):
        blend(a, b[:9], c)


def test_a_blend_about_one_axis_adds_angles():
    """Where turns commute, limp + (turn − walk) is the sum of the angles."""
    t = np.arange(FRAMES) / 5
    angles = [np.sin(t), 0.4 * t, 0.3 * np.cos(2 * t)]
    still = swaying(FRAMES, joints=1)
    axis = np.array([0.0, 0.6, 0.8])

    def clip(angle):
        q = Rotation.from_rotvec(angle[:, None] * axis).as_quat(scalar_first=True)
        return still.with_transforms(0 * np.asarray(still.translations), q[:, None])

    got = blend(*(clip(x) for x in angles), LEVELS)
    want = clip(angles[1] + angles[2] - angles[0])
    assert_same_rotation(got.rotations, want.rotations)


def test_float32(clips):
    a, b, c = (jax.tree.map(lambda x: x.astype(np.float32), m) for m in clips)
    got = blend(a, b, c, LEVELS)
    assert got.rotations.dtype == got.translations.dtype == np.float32
    assert_same_motion(got, blend(*clips, LEVELS), 1e-5)


YAW = Rotation.from_euler("Y", np.pi / 12)


def yawed_by_euler(rotations, order, steps):
    """The base turned, in a multiresolution of unwrapped Euler angles (the way of Figure 11)."""

    def angles_of(r):
        return np.unwrap(r.as_euler(order), axis=0)

    levels = [angles_of(rotations)]
    for _ in range(LEVELS):
        levels.append(reduced_vectors(levels[-1]))
    details = [x - vectors_between(y) for x, y in pairwise(levels)]
    base = Rotation.from_euler(order, levels[-1])
    for _ in range(steps):
        base = YAW * base
    x = angles_of(base)
    for detail in details[::-1]:
        x = vectors_between(x) + detail
    return Rotation.from_euler(order, x)


@pytest.fixture(scope="module")
def tumbling():
    """A body that turns all ways, its pitch within a quarter turn in every order."""
    t = 2 * np.pi * np.arange(FRAMES)[:, None] / FRAMES
    v = np.sin(t * np.array([1, 2, 1]) + np.array([0, 1, 2])) * np.array([1.1, 0.5, 0.9])
    return Rotation.from_rotvec(v)


def test_nine_yaw_steps_are_reproduced(tumbling):
    clip = swaying(FRAMES, joints=1)
    q = tumbling.as_quat(scalar_first=True)[:, None]
    pyramid = build_pyramid(clip.with_transforms(clip.translations, q), LEVELS)
    turn = Rotation.identity()
    for _ in range(9):
        turn = YAW * turn
        base = pyramid.base
        base = base.with_transforms(
            turn.apply(np.array(base.translations)[:, 0])[:, None],
            quaternion.multiply(turn.as_quat(scalar_first=True), base.rotations),
        )
        got = replace(pyramid, base=base).reconstruct()
        assert_same_rotation(got.rotations[:, 0], (turn * tumbling).as_quat(scalar_first=True))
        want = turn.apply(np.array(clip.translations)[:, 0])
        np.testing.assert_allclose(got.translations[:, 0], want, atol=1e-12)


@pytest.mark.parametrize("order", ["XYZ", "ZYX", "ZXY", "YXZ"])
def test_euler_angles_do_not_reproduce_them(tumbling, order):
    """Unless the turn is about their outermost axis."""
    worst = []
    for steps in range(1, 10):
        want = Rotation.from_rotvec([0, steps * np.pi / 12, 0]) * tumbling
        worst.append((yawed_by_euler(tumbling, order, steps).inv() * want).magnitude().max())
    if order == "YXZ":
        assert max(worst) < 1e-12
    else:
        assert 0.5 < max(worst) <= np.pi


@pytest.mark.sweep  # those through loops are tested in test_kernels.py
def test_second_derivatives_by_a_gain():
    """Deep enough that the coarse levels run in a loop."""
    clip = swaying(40, seed=5, moving=True)
    pyramid = build_pyramid(clip, 3)
    weights = np.random.default_rng(6).standard_normal((2, *clip.rotations.shape))

    def loss(gain):
        edit = scale_details(pyramid, gain)
        by_translations = jnp.sum(weights[1, ..., :3] * edit.translations**2)
        return jnp.sum(weights[0] * edit.rotations) + by_translations

    first = jax.jit(jax.grad(loss))
    want = (first(1.1 + 1e-5) - first(1.1 - 1e-5)) / 2e-5
    for second in (jax.hessian(loss), jax.jacfwd(jax.jacfwd(loss)), jax.grad(jax.grad(loss))):
        np.testing.assert_allclose(jax.jit(second)(1.1), want, rtol=1e-6)


def test_errors_name_the_edit_that_was_called():
    walk = jm.samples.walk(17, fps=30.0).motion
    pyramid, few = build_pyramid(walk, 1), jm.contacts.detect(walk[:9])
    kept = {
        "scale_details": lambda c: scale_details(pyramid, 2.0, keep_contacts=c),
        "level_of_detail": lambda c: level_of_detail(pyramid, 0, keep_contacts=c),
        "blend": lambda c: blend(walk, walk, walk, 1, keep_contacts=c),
    }
    for name, edit in kept.items():
        with pytest.raises(ValueError, match=f"{name}: contacts have 9 frames, the motion 17"):
            edit(few)
    with pytest.raises(ValueError, match=r"scale_details: keep_contacts=True, but .* traced"):
        jax.eval_shape(lambda g: scale_details(pyramid, g, keep_contacts=True), 2.0)
    with pytest.raises(ValueError, match="blend: levels=9"):
        blend(walk, walk, walk, 9)
    with no_shape_checks():
        with pytest.raises(ValueError, match=r"level_of_detail: level has shape \(1,\)"):
            level_of_detail(pyramid, np.ones(1))
        with pytest.raises(ValueError, match="blend: times has shape"):
            blend(walk, walk, walk, 1, times=np.arange(3.0))


def test_only_clips_of_one_kind_blend():
    walk = swaying(9)
    slow = walk.replace(frame_time=2 * walk.frame_time)
    bones = walk.skeleton
    names = [f"other{j}" for j in range(bones.num_joints)]
    other = walk.replace(skeleton=jm.Skeleton(names, bones.parents, bones.offsets))
    for clips in ((walk, slow, walk), (walk, walk, slow), (slow, walk, walk)):
        with pytest.raises(ValueError, match="blend: the clips must have one frame time"):
            blend(*clips, 1)
    for clips in ((walk, other, walk), (walk, walk, other)):
        with pytest.raises(ValueError, match="blend: the clips have different joints"):
            blend(*clips, 1)
