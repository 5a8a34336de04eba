"""Contacts found in clips whose contacts are known, and what may not change them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.contacts import LINE, PLANE, POINT, ContactPoints, detect, find_feet, replant, rigid
from jaxmotion.metrics import contact_scores
from tests.helpers import assert_trees_close, check_gradients, no_shape_checks

METHODS = ["segments", "thresholds"]


def true_points(sample):
    return ContactPoints(
        sample.motion.skeleton,
        sample.contact_joints,
        sample.contact_offsets,
        names=sample.contact_names,
    )


@pytest.fixture(scope="module")
def walk():
    return jm.samples.walk(90, fps=30.0)


@pytest.fixture(scope="module")
def clips():
    return {name: jm.samples.load(name, num_frames=150, fps=50.0) for name in jm.samples.names()}


def noisy(sample, size):
    """White noise on rotations and root that moves contact points by ``size`` (root mean square
    distance), in shares of a 0.9 m leg."""
    points = true_points(sample)
    limb = float(jm.contacts.limb_lengths(sample.motion, points)[0])
    clean = points.positions(sample.motion)

    def damaged(rotation):
        key = jax.random.key(0)
        return jm.samples.add_noise(
            sample.motion, key, rotation=rotation, translation=0.4 * limb * rotation
        ).motion

    moved = points.positions(damaged(1e-3)) - clean
    rms = float(np.sqrt(np.mean(np.sum(moved**2, -1))))
    return damaged(1e-3 * size * limb / 0.9 / rms)


@pytest.mark.parametrize("millimetres", [0.0, 5.0])
@pytest.mark.parametrize("method", METHODS)
def test_precision_and_recall(clips, method, millimetres):
    for name, sample in clips.items():
        motion = noisy(sample, 1e-3 * millimetres) if millimetres else sample.motion
        found = detect(motion, method=method, points=true_points(sample))
        scores = contact_scores(found.mask, sample.contacts, sample.clear())
        assert min(scores) >= 0.97, (name, scores)


@pytest.mark.parametrize("method", METHODS)
def test_feet_found_by_name_do_nearly_as_well(walk, method):
    found = detect(walk.motion, method=method)
    columns = [0, 1, 3, 4]
    scores = contact_scores(
        found.mask, np.asarray(walk.contacts)[:, columns], np.asarray(walk.clear())[:, columns]
    )
    assert min(scores) >= 0.95, scores


@pytest.mark.parametrize("method", METHODS)
def test_units_up_axis_and_place_do_not_matter(walk, method):
    motion, points = walk.motion, true_points(walk)
    want = detect(motion, method=method, points=points)
    skeleton = motion.skeleton
    inches = jm.Skeleton(skeleton.names, skeleton.parents, skeleton.offsets / 0.0254, up="z")
    quarter = jm.quaternion.exp(np.array([np.pi / 2, 0, 0]))
    root = jm.quaternion.rotate(quarter, motion.root_positions) / 0.0254 + 500.0
    turns = motion.rotations.at[:, 0].set(jm.quaternion.multiply(quarter, motion.rotations[:, 0]))
    other = jm.Motion.from_root(inches, root, turns, motion.frame_time)
    moved = ContactPoints(inches, points.joints, points.point / 0.0254)
    got = detect(other, method=method, points=moved)
    np.testing.assert_array_equal(got.mask, want.mask)
    np.testing.assert_array_equal(got.kind, want.kind)
    np.testing.assert_allclose(got.confidence, want.confidence, atol=1e-6)
    far = jm.quaternion.rotate(quarter, want.target) / 0.0254 + 500.0
    np.testing.assert_allclose(got.target, far, atol=1e-8)


def test_residual_of_windows_is_least_squares():
    """The penalised fixed point by dense least squares, window by window."""
    rng = np.random.default_rng(0)
    frames, window, size, still = 12, 5, 2.0, 0.006
    turns = np.asarray(
        jm.quaternion.to_matrix(jm.quaternion.exp(0.2 * rng.standard_normal((frames, 1, 3))))
    )
    places = 0.02 * rng.standard_normal((frames, 1, 3))
    square, _ = rigid._window_moments(
        jnp.asarray(places), jnp.asarray(turns), jnp.asarray([size]), window, still
    )
    for start in range(frames - window + 1):
        now = slice(start, start + window)
        s = (turns[now, 0] - turns[now, 0].mean(0)).reshape(-1, 3)
        e = (places[now, 0] - places[now, 0].mean(0)).ravel()
        prior = np.sqrt(window) * still / rigid.REACH * np.eye(3)
        shift = np.linalg.lstsq(np.vstack([s, prior]), np.r_[-e, 0, 0, 0], rcond=None)[0]
        shift *= min(1, rigid.REACH * size / np.linalg.norm(shift))
        want = np.sum((s @ shift + e) ** 2) / window
        np.testing.assert_allclose(square[start, 0], want, rtol=1e-9)


def test_kinds():
    """A segment that rests, one that rolls about an axis, one that turns about a point."""
    skeleton = jm.Skeleton(["root", "a", "b", "c"], [-1, 0, 1, 2], np.eye(4, 3) + 1.0)
    t = np.arange(31) / 30
    turns = {
        PLANE: np.zeros((31, 3)),
        LINE: np.stack([1.5 * t, 0 * t, 0 * t], -1),
        POINT: 0.5 * np.stack([np.cos(8 * t), np.sin(8 * t), 0 * t], -1),
    }
    for kind, turn in turns.items():
        vectors = np.zeros((31, 4, 3))
        vectors[:, 3] = turn
        rotations = jm.quaternion.exp(vectors)
        motion = jm.Motion.from_root(skeleton, np.zeros((31, 3)), rotations, 1 / 30)
        found = detect(motion, joints=["c"], floor=None, window=10)
        assert found.mask.all()
        assert np.all(found.kind == kind), kind


def test_heights_count_only_if_asked(walk):
    """A hand that rests on a table: still, but not low."""
    one, count = walk.motion[0], 90
    motion = one.with_transforms(
        np.repeat(one.translations, count, 0), np.repeat(one.rotations, count, 0)
    )
    hand = ContactPoints(motion.skeleton, ["LeftHand"])
    height = float(hand.positions(one)[0, 0, 1])
    assert detect(motion, points=hand, floor=None).mask.all()
    assert detect(motion, points=hand, floor=height).mask.all()
    assert not detect(motion, points=hand, floor=0.0).mask.any()


@pytest.mark.parametrize("method", METHODS)
def test_padding_does_not_matter(walk, method):
    motion, points = walk.motion[:70], true_points(walk)
    want = detect(motion, method=method, points=points)
    index = np.minimum(np.arange(90), 69)
    padded = motion.with_transforms(motion.translations[index], motion.rotations[index])
    got = detect(padded, method=method, points=points, length=70)
    np.testing.assert_array_equal(got.mask[:70], want.mask)
    assert not got.mask[70:].any()
    np.testing.assert_allclose(got.target[:70], want.target, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_jit_vmap_and_single_precision(walk, method):
    points, motion = true_points(walk), walk.motion
    want = detect(motion, method=method, points=points, window=4)

    def f(motion):
        return detect(motion, method=method, points=points, window=4)

    assert_trees_close(eqx.filter_jit(f)(motion), want, 1e-9, 1e-9)
    later = jm.samples.walk(90, fps=30.0, seed=5).motion
    both = jax.tree.map(lambda a, b: jnp.stack([a, b]), motion, later)
    mapped = jax.vmap(f)(both)
    assert_trees_close(jax.tree.map(lambda x: x[0], mapped), want, 1e-9, 1e-9)
    np.testing.assert_array_equal(mapped.mask[1], f(later).mask)
    single = detect(
        motion.astype(np.float32),
        method=method,
        points=jax.tree.map(lambda x: x.astype(np.float32), points),
        window=4,
    )
    assert single.target.dtype == single.confidence.dtype == np.float32
    assert np.mean(single.mask != want.mask) < 0.01


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("frames", [1, 2, 3])
def test_tiny_clips_and_no_points(walk, method, frames):
    motion = walk.motion[:frames]
    found = detect(motion, method=method, points=true_points(walk))
    assert found.mask.shape == (frames, 6)
    for leaf in jax.tree.leaves(found):
        assert np.isfinite(leaf).all()
    nothing = detect(motion, method=method, joints=[])
    assert nothing.mask.shape == (frames, 0)


@pytest.mark.parametrize("method", METHODS)
def test_confidence_is_differentiable(method):
    motion = jm.samples.walk(16, fps=30.0).motion
    points = find_feet(motion)

    def f(root):
        moved = motion.with_transforms(motion.translations.at[:, 0].add(root))
        return detect(moved, method=method, points=points).confidence

    noise = 0.002 * np.random.default_rng(0).standard_normal((16, 3))
    check_gradients(f, jnp.asarray(noise), rtol=1e-4, atol=1e-4, eps=1e-7)


def test_replant(walk):
    points = true_points(walk)
    found = detect(walk.motion, points=points)
    again = replant(walk.motion, found)
    np.testing.assert_allclose(again.target, found.target, atol=1e-12)
    there = walk.motion.with_transforms(walk.motion.translations.at[:, 0].add(1.0))
    np.testing.assert_allclose(replant(there, found).target, found.target + 1.0, atol=1e-9)


def test_what_is_refused(walk):
    motion, points = walk.motion, true_points(walk)
    with pytest.raises(ValueError, match="expected one of them"):
        detect(motion, points=points, joints=["LeftFoot"])
    with pytest.raises(ValueError, match="at least 2 frames"):
        detect(motion, points=points, window=1)
    with pytest.raises(ValueError, match="pass window"):
        eqx.filter_jit(lambda m: detect(m, points=points))(motion)


def test_real_walks_always_have_a_foot_down(data_dir):
    for path in ("xia/neutral_01_000.bvh", "bandai/walk_old_001.bvh"):
        motion = jm.load(data_dir / path)[:280]
        for method in METHODS:
            mask = np.asarray(detect(motion, method=method).mask)
            assert np.mean(mask.any(1)) > 0.97, path
            assert np.all((mask.mean(0) > 0.2) & (mask.mean(0) < 0.7)), path


def test_one_frame_that_counts_is_a_clip_of_one_frame(walk):
    motion, points = walk.motion, true_points(walk)
    got = detect(motion, method="thresholds", points=points, length=1)
    want = detect(motion[:1], method="thresholds", points=points)
    np.testing.assert_array_equal(got.mask[:1], want.mask)
    assert want.mask.any()


@pytest.mark.parametrize("method", METHODS)
def test_derivatives_are_finite_beside_padding(walk, method):
    points = true_points(walk)

    def f(root):
        moved = walk.motion.with_transforms(walk.motion.translations.at[:, 0].add(root))
        return detect(moved, method=method, points=points, window=4, length=70).confidence

    slope = jax.jit(jax.grad(lambda root: jnp.sum(f(root))))(jnp.zeros((90, 3)))
    assert jnp.all(jnp.isfinite(slope))
    assert jnp.all(slope[70:] == 0)


def test_wrong_arguments_are_named(walk):
    motion, points = walk.motion, true_points(walk)
    contacts = detect(motion[:20], points=points)
    with no_shape_checks():
        for frames in (1, 19, 21):
            with pytest.raises(ValueError, match=f"replant: contacts have 20 .* motion {frames};"):
                replant(motion[:frames], contacts)
        for bad in (0.0, -1.0):
            with pytest.raises(ValueError, match=f"detect: tolerance must be above 0, got {bad}"):
                detect(motion, points=points, tolerance=bad)
        with pytest.raises(ValueError, match=r"detect: tolerance has shape \(2,\)"):
            detect(motion, points=points, tolerance=np.ones(2))
        with pytest.raises(ValueError, match="limb_lengths: length must be a whole number"):
            jm.contacts.limb_lengths(motion, points, length=91)
