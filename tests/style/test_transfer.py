"""Style transfer: against the paper in plain NumPy, and what must hold whatever the clips."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import sqrtm
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.style import apply_style, motion_style, transfer_style
from jaxmotion.style.carry import STILL, transport
from jaxmotion.style.correspondence import strides
from tests.helpers import angle_between, assert_same_rotation, check_gradients, no_shape_checks
from tests.style.clips import (
    JOINTS,
    quaternions,
    recursive_mean,
    rotations,
    swaying,
    transferred,
)
from tests.style.test_root import placed, walk

transfer = functools.partial(transfer_style, keep_contacts=False)
apply = functools.partial(apply_style, keep_contacts=False)


def test_is_the_paper_s():
    """Eq. 6 and 7 on the warped clips themselves, and the reverse warp of the result."""
    source, reference = swaying(0, 40), swaying(1, 31)
    result = transfer(source, reference)
    warp = result.warp
    new = np.asarray(warp.is_new_pair)
    at = [np.asarray(i)[new] for i in (warp.source_index, warp.reference_index)]
    for j in range(1, JOINTS):
        q, r = np.asarray(source.rotations[:, j]), np.asarray(reference.rotations[:, j])
        wanted = transferred(q, q[at[0]], r[at[1]])
        assert_same_rotation(result.motion.rotations[:, j], wanted, 1e-9)
        assert_same_rotation(
            result.source_style.mean[j : j + 1], recursive_mean(q[at[0]])[None], 1e-12
        )
    refined = result.motion.rotations[warp.source_index]
    back = jm.timing.unwarp(refined, warp, rotations=True)
    assert_same_rotation(back, result.motion.rotations, 1e-9)
    channels = np.asarray(result.reference_style.root_deviation)
    assert (channels[:3] > 0).all()


@pytest.mark.parametrize("side", ["right", "left"])
def test_has_the_reference_s_mean_and_deviation(side):
    source, reference = swaying(2), swaying(3, 52)
    result = transfer(source, reference, warp=None, mean="karcher", side=side)
    style = motion_style(result.motion, mean="karcher")
    wanted = result.reference_style
    np.testing.assert_allclose(style.deviation[1:], wanted.deviation[1:], rtol=1e-9)
    np.testing.assert_allclose(angle_between(style.mean[1:], wanted.mean[1:]), 0, atol=1e-9)
    np.testing.assert_allclose(style.root_deviation, wanted.root_deviation, rtol=1e-9)
    # The height is that of a body in these poses; all else is the reference's.
    rest = np.array([0, 1, 2, 4, 5])
    np.testing.assert_allclose(style.root_mean[rest], wanted.root_mean[rest], atol=1e-9)


def test_sides_are_what_parent_and_joint_see():
    source, reference = swaying(2), swaying(3)
    for side in ("right", "left"):
        result = transfer(source, reference, warp=None, side=side)
        own, other = result.source_style, result.reference_style
        j, ratio = 2, float(other.deviation[2] / own.deviation[2])
        away = (rotations(own.mean[j]).inv() * rotations(source.rotations[:, j])).as_rotvec()
        after = (
            rotations(other.mean[j]).inv() * rotations(result.motion.rotations[:, j])
        ).as_rotvec()
        if side == "right":
            away, after = rotations(own.mean[j]).apply(away), rotations(other.mean[j]).apply(after)
        np.testing.assert_allclose(after, ratio * away, atol=1e-9)


def test_covariances_arrive():
    source, reference = swaying(4), swaying(5, 33)
    result = transfer(source, reference, warp=None, mean="karcher", deviation="covariance")
    style = motion_style(result.motion, mean="karcher")
    wanted = np.asarray(result.reference_style.covariance)
    np.testing.assert_allclose(style.covariance[1:], wanted[1:], atol=1e-9)


def test_transport_is_the_optimal_map():
    rng = np.random.default_rng(6)
    x = rng.standard_normal((2, 4, 3, 3))
    own, goal = 0.1 * x @ np.swapaxes(x, -1, -2) + 0.01 * np.eye(3)
    found = np.asarray(transport(jnp.asarray(own), jnp.asarray(goal)))
    for a, c, r in zip(found, own, goal, strict=True):
        root = sqrtm(c)
        wanted = np.linalg.inv(root) @ sqrtm(root @ r @ root) @ np.linalg.inv(root)
        np.testing.assert_allclose(a, wanted, atol=1e-9)
        np.testing.assert_allclose(a @ c @ a, r, atol=1e-9)
    capped = transport(jnp.asarray(own), jnp.asarray(goal), jnp.asarray(0.7))
    assert np.linalg.eigvalsh(capped).max() <= 0.7 + 1e-12


def hinge(seed, size, axis=(1.0, 0, 0), bend=0.5):
    """A clip whose leg is a hinge."""
    motion = swaying(seed)
    t = np.arange(40) / 30
    q = np.array(motion.rotations)
    angle = bend + size * np.sin(5 * t)
    q[:, 3] = quaternions(Rotation.from_rotvec(angle[:, None] * np.asarray(axis)))
    return motion.with_transforms(rotations=q)


def test_a_hinge_stays_a_hinge():
    """The source's leg turns about all axes a little; the reference's only bends."""
    source, reference = hinge(7, 0.3), hinge(8, 0.6, bend=0.9)
    noise = 0.02 * np.random.default_rng(0).standard_normal((40, 3))
    q = np.array(source.rotations)
    q[:, 3] = quaternions(rotations(q[:, 3]) * Rotation.from_rotvec(noise))
    source = source.with_transforms(rotations=q)
    off = {}
    for deviation in ("scalar", "covariance"):
        motion = transfer(source, reference, deviation=deviation).motion
        vectors = rotations(motion.rotations[:, 3]).as_rotvec()
        off[deviation] = np.abs(vectors[:, 1:]).max()
    assert off["covariance"] < 1e-3
    assert off["scalar"] > 0.02


@pytest.mark.parametrize("deviation", ["scalar", "covariance"])
def test_still_joints(deviation):
    """Nothing to scale: no more than rounding times what is told; never NaN."""
    source, reference = swaying(9), swaying(10)
    q = np.array(source.rotations)
    q[:, 2] = q[0, 2]
    q[1::2, 2] = quaternions(rotations(q[0, 2]) * Rotation.from_rotvec([1e-5, 0, 0]))
    source = source.with_transforms(rotations=q)
    result = transfer(source, reference, deviation=deviation)
    assert np.asarray(result.report.still).tolist() == [False, False, True, False, False]
    spread = angle_between(result.motion.rotations[0, 2], result.motion.rotations[:, 2])
    assert spread.max() <= 1.01e-5 * float(result.reference_style.deviation[2]) / STILL
    # A still reference stills the source, in its own place.
    p = np.array(reference.rotations)
    p[:, 1] = p[0, 1]
    held = transfer(source, reference.with_transforms(rotations=p), deviation=deviation).motion
    np.testing.assert_allclose(angle_between(held.rotations[:, 1], p[:, 1]), 0, atol=1e-6)


@pytest.mark.parametrize("deviation", ["scalar", "covariance"])
def test_still_bodies_have_finite_derivatives(deviation):
    single = swaying(9, frames=1)
    still = single.with_transforms(
        np.repeat(single.translations, 6, 0), np.repeat(single.rotations, 6, 0)
    )

    def total(q, place, reference):
        clip = still.with_transforms(place, q)
        found = transfer(clip, reference, deviation=deviation, warp=None).motion
        return jnp.sum(found.rotations[..., 1]) + jnp.sum(found.translations)

    slope = jax.jit(jax.grad(total, (0, 1)))
    for reference in (still, swaying(10, frames=6)):
        for x in slope(jnp.asarray(still.rotations), jnp.asarray(still.translations), reference):
            assert jnp.isfinite(x).all()


_ITSELF = itertools.product(("scalar", "covariance"), ("shared", "per_channel", None))
_QUICK = ("scalar", "shared"), ("scalar", None), ("covariance", "per_channel")


@pytest.mark.parametrize(
    ("deviation", "warp"),
    [pytest.param(*x, marks=() if x in _QUICK else pytest.mark.sweep) for x in _ITSELF],
)
def test_itself_is_itself(deviation, warp):
    motion = swaying(11)
    result = transfer(motion, motion, deviation=deviation, warp=warp)
    assert_same_rotation(result.motion.rotations, motion.rotations, 1e-7)
    np.testing.assert_allclose(result.motion.translations, motion.translations, atol=1e-9)


@pytest.mark.parametrize("deviation", ["scalar", "covariance"])
def test_twice_is_once(deviation):
    source, reference = swaying(12), swaying(13)
    options = {"deviation": deviation, "mean": "karcher", "warp": None}
    once = transfer(source, reference, **options).motion
    twice = transfer(once, reference, **options).motion
    assert_same_rotation(twice.rotations, once.rotations, 1e-7)
    np.testing.assert_allclose(twice.translations, once.translations, atol=1e-7)


def test_place_and_yaw_do_not_matter():
    source, reference = swaying(14), swaying(15, 50)
    result = transfer(source, reference).motion
    same = transfer(source, placed(reference, -2.0, [3.0, 4.0, 5.0])).motion
    assert_same_rotation(same.rotations, result.rotations, 1e-9)
    np.testing.assert_allclose(same.translations, result.translations, atol=1e-9)
    moved = transfer(placed(source, 1.1, [3.0, 4.0, 5.0]), reference).motion
    wanted = placed(result, 1.1, [3.0, 4.0, 5.0])
    assert_same_rotation(moved.rotations, wanted.rotations, 1e-9)
    np.testing.assert_allclose(moved.translations[:, 0], wanted.translations[:, 0], atol=1e-9)


def test_a_straight_walk_stays_straight_and_a_circle_a_circle():
    straight, quick = walk(np.full(60, 0.5)), walk(np.full(45, -1.0), speed=2.5)
    path = np.asarray(transfer(straight, quick).motion.translations[:, 0])
    ahead = np.array([np.sin(0.5), 0, np.cos(0.5)]) * 2.5 / 30
    np.testing.assert_allclose(path, np.arange(60)[:, None] * ahead + [0, 2, 0], atol=1e-9)
    # One that turns, at another radius: the reference's speed over its yaw rate.
    circle = walk(0.8 * np.arange(90) / 30, speed=1.0)
    wide = walk(0.5 * np.arange(70) / 30, speed=2.0)
    path = np.asarray(transfer(circle, wide).motion.translations[:, 0])
    chord = 2.0 / 30 / (2 * np.sin(0.25 / 30))
    x, z = path[:, 0], path[:, 2]
    rows = np.stack([2 * x, 2 * z, np.ones_like(x)], 1)
    centre = np.linalg.lstsq(rows, x**2 + z**2, rcond=None)[0]
    radius = np.sqrt(centre[2] + centre[0] ** 2 + centre[1] ** 2)
    np.testing.assert_allclose(radius, chord, rtol=1e-6)
    np.testing.assert_allclose(path[:, 1], 2, atol=1e-9)


def test_strength():
    source, reference = swaying(16), swaying(17)
    none, full, half, more = (transfer(source, reference, strength=s) for s in (0.0, 1.0, 0.5, 1.5))
    assert_same_rotation(none.motion.rotations, source.rotations, 1e-7)
    np.testing.assert_allclose(none.motion.translations, source.translations, atol=1e-9)
    turned = [np.asarray(x.report.turned)[1:] for x in (half, full, more)]
    np.testing.assert_allclose(turned[0], 0.5 * turned[1], atol=1e-9)
    np.testing.assert_allclose(turned[2], np.minimum(1.5 * turned[1], 2 * np.pi - 1.5 * turned[1]))
    speed = [float(motion_style(x.motion).root_mean[0]) for x in (none, half, full, more)]
    assert (np.diff(speed) > 0).all() or (np.diff(speed) < 0).all()


def test_local_style_leaves_the_rest_bit_for_bit():
    source, reference = swaying(18), swaying(19)
    result = transfer(source, reference, joints=["ARM", "sp*"])
    assert result.report.left == ("hips", "leg", "foot")
    for j in (0, 3, 4):
        np.testing.assert_array_equal(result.motion.rotations[:, j], source.rotations[:, j])
    np.testing.assert_array_equal(result.motion.translations, source.translations)
    whole = transfer(source, reference).motion
    for j in (1, 2):
        np.testing.assert_array_equal(result.motion.rotations[:, j], whole.rotations[:, j])
    still = transfer(source, reference, root=False)
    assert still.report.left == ("hips",)
    np.testing.assert_array_equal(still.motion.translations, source.translations)


def test_ratios_are_capped():
    source, reference = swaying(20, size=0.1), swaying(21, size=0.8)
    assert np.asarray(transfer(source, reference).report.ratio).max() > 2
    capped = transfer(source, reference, max_ratio=2.0)
    assert np.asarray(capped.report.ratio).max() == 2
    wide = motion_style(capped.motion).deviation
    narrow = motion_style(source).deviation
    assert (np.asarray(wide)[1:] <= 2 * np.asarray(narrow)[1:] + 1e-3).all()


def test_names_that_agree():
    source = swaying(22)
    reference = swaying(23, names=("hips", "spine", "ARM", "leg", "toe"))
    with pytest.raises(
        ValueError, match=r"only one has 'ARM', 'arm', 'foot', 'toe'.*match='names'"
    ):
        transfer(source, reference)
    result = transfer(source, reference, match="names")
    assert result.report.left == ("arm", "foot")
    for j in (2, 4):
        np.testing.assert_array_equal(result.motion.rotations[:, j], source.rotations[:, j])
    with pytest.raises(ValueError, match="no joint of the reference"):
        transfer(source, swaying(23, names=("a", "b", "c", "d", "e")), match="names")
    skeleton = jm.Skeleton(source.skeleton.names, (-1, 0, 0, 0, 3), source.skeleton.offsets)
    other = jm.Motion.from_root(skeleton, source.translations[:, 0], source.rotations, 1 / 30)
    with pytest.raises(ValueError, match="parents differ"):
        transfer(source, other)


def test_joints_in_another_order():
    source, reference = swaying(24), swaying(25)
    order = [0, 3, 4, 1, 2]
    skeleton = jm.Skeleton(
        tuple(reference.skeleton.names[j] for j in order),
        (-1, 0, 1, 0, 3),
        np.asarray(reference.skeleton.offsets)[order],
    )
    other = jm.Motion.from_root(
        skeleton, reference.translations[:, 0], np.asarray(reference.rotations)[:, order], 1 / 30
    )
    wanted = transfer(source, reference, warp=None).motion
    assert_same_rotation(
        transfer(source, other, warp=None).motion.rotations, wanted.rotations, 1e-9
    )


_RARE = [pytest.param(sizes, marks=pytest.mark.sweep) for sizes in ((40, 1), (600, 30))]


@pytest.mark.parametrize("sizes", [(1, 40), (1, 1), (2, 3), (30, 600), *_RARE])
def test_any_lengths(sizes):
    source, reference = swaying(26, sizes[0]), swaying(27, sizes[1])
    result = transfer(source, reference).motion
    assert result.num_frames == sizes[0]
    assert np.isfinite(result.rotations).all()
    assert np.isfinite(result.translations).all()


def test_long_clips_are_warped_at_every_kth_frame():
    assert strides(400, 427) == (1, 1)
    assert strides(20_000, 20_000) == (10, 10)
    assert strides(30, 600) == (1, 10)
    assert strides(600, 30) == (10, 1)


def test_a_style_without_a_clip():
    source, reference = swaying(28), swaying(29)
    style = motion_style(reference)
    wanted = transfer(source, reference, warp=None).motion
    got = apply(source, style)
    assert_same_rotation(got.rotations, wanted.rotations, 1e-9)
    np.testing.assert_allclose(got.translations, wanted.translations, atol=1e-9)
    with pytest.raises(ValueError, match="only one has"):
        apply(source, motion_style(swaying(29, names=("a", "b", "c", "d", "e"))))
    with pytest.raises(ValueError, match="reorient"):
        apply(jm.reorient(source, up="z"), style)


def test_derivatives_by_both():
    source, reference = swaying(30, 14), swaying(31, 17)

    def numbers(q, r, strength):
        clips = source.with_transforms(rotations=q), reference.with_transforms(rotations=r)
        found = transfer(
            *clips, strength=strength, mean="karcher", deviation="covariance", warp=None
        )
        return found.motion.rotations, found.motion.translations[:, 0]

    given = jnp.asarray(source.rotations), jnp.asarray(reference.rotations), jnp.asarray(0.8)
    check_gradients(jax.jit(numbers), *given, rtol=1e-4, atol=1e-4, eps=1e-6)


def test_jit_vmap_and_float32():
    source, references = swaying(32), [swaying(33), swaying(34)]
    batch, _ = jm.stack(references)
    many = jax.jit(jax.vmap(lambda reference: transfer(source, reference).motion.rotations))(batch)
    for got, reference in zip(many, references, strict=True):
        assert_same_rotation(got, transfer(source, reference).motion.rotations, 1e-9)
    low = [jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), m) for m in (source, references[0])]
    result = transfer(*low)
    kinds = {x.dtype for x in jax.tree.leaves(result.motion)}
    assert kinds == {np.dtype("float32")}
    np.testing.assert_allclose(angle_between(result.motion.rotations, many[0]), 0, atol=5e-3)


def test_feet_stand_where_they_stood():
    source, reference = (jm.samples.load(name).motion[:90] for name in ("walk", "run"))
    contacts = jm.contacts.detect(source)
    slid = transfer(source, reference).motion
    kept = transfer_style(source, reference, keep_contacts=contacts).motion
    own, before, after = (jm.metrics.foot_skate(x, contacts) for x in (source, slid, kept))
    assert before > 2 * own
    # The walk's legs cannot follow at the run's speed, ...
    assert after < 0.05 * before
    # ... but at a walk's own.
    lively = jm.stylize(source, 1.8)
    kept = transfer_style(source, lively, keep_contacts=contacts).motion
    assert jm.metrics.foot_skate(kept, contacts) <= own
    same = transfer_style(source, lively).motion
    np.testing.assert_array_equal(same.rotations, kept.rotations)
    # What moves nothing that touches is left alone.
    arms = transfer_style(source, reference, joints="*Arm*").motion
    feet = [source.skeleton.index(n) for n in source.skeleton.names if "Foot" in n]
    np.testing.assert_array_equal(arms.rotations[:, feet], source.rotations[:, feet])


def test_what_is_wrong_is_said():
    motion = swaying(35)
    with pytest.raises(ValueError, match="no joint matches"):
        transfer(motion, motion, joints="tail")
    with pytest.raises(ValueError, match="max_ratio must be above 0"):
        transfer(motion, motion, max_ratio=0.0)
    with pytest.raises(ValueError, match="strength must be finite"):
        transfer(motion, motion, strength=np.inf)
    with no_shape_checks():
        for name in ("mean", "deviation", "side", "warp", "match"):
            with pytest.raises(ValueError, match=f"transfer_style: {name}"):
                transfer(motion, motion, **{name: "sideways"})
        with pytest.raises(ValueError, match="MotionStyle"):
            apply(motion, motion)
    with pytest.raises(ValueError, match="reorient"):
        transfer(motion, jm.reorient(motion, up="z"))
    with pytest.raises(ValueError, match="keep_contacts=True"):
        jax.jit(lambda m: transfer_style(m, m).motion.rotations)(motion)
