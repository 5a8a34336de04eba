"""What a corruption touches is what its mask says, and by how much; the rest is bit-identical."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import samples
from tests.helpers import (
    angle_between,
    assert_same_rotation,
    no_shape_checks,
    random_motion,
    random_skeleton,
)

KEY = jax.random.key(3)
ALL = {
    "add_noise": {"translation": 0.01},
    "drop_frames": {"rate": 0.3},
    "slide_root": {},
    "flip_signs": {"rate": 0.2},
    "offset_joints": {},
    "add_spikes": {},
    "violate_limits": {},
    "freeze_joints": {},
    "fill_gaps": {},
    "swap_limbs": {},
    "drift_joints": {},
    "swap_markers": {},
    "inject_errors": {},
}


@pytest.fixture(scope="module")
def walk():
    return samples.walk(90).motion


@pytest.fixture(scope="module")
def damaged(walk):
    return {name: getattr(samples, name)(walk, KEY, **options) for name, options in ALL.items()}


def changed(before, after):
    """bool[T, J]: any bit of rotation or translation differs."""
    return np.any(np.asarray(before.rotations) != np.asarray(after.rotations), axis=-1) | np.any(
        np.asarray(before.translations) != np.asarray(after.translations), axis=-1
    )


@pytest.mark.parametrize("name", ALL)
def test_only_masked_entries_change(walk, damaged, name):
    result = damaged[name]
    assert result.mask.shape == (90, 22)
    assert result.mask.any()
    touched = changed(walk, result.motion)
    assert not np.any(touched & ~np.asarray(result.mask))
    if name not in (*("freeze_joints", "fill_gaps", "drop_frames", "swap_limbs", "inject_errors"),):
        np.testing.assert_array_equal(touched, result.mask)  # others may hold what does not move
    np.testing.assert_allclose(np.linalg.norm(result.motion.rotations, axis=-1), 1, atol=1e-14)


@pytest.mark.parametrize("name", ALL)
def test_same_key_same_damage_other_key_other(walk, damaged, name):
    corrupt = getattr(samples, name)
    jax.tree.map(np.testing.assert_array_equal, corrupt(walk, KEY, **ALL[name]), damaged[name])
    other = corrupt(walk, jax.random.key(4), **ALL[name])
    assert changed(damaged[name].motion, other.motion).any()


@pytest.mark.parametrize("name", ALL)
def test_single_precision_stays_single(walk, name):
    shapes = jax.eval_shape(
        lambda motion: getattr(samples, name)(motion, KEY, **ALL[name]), walk.astype(np.float32)
    )
    assert shapes.motion.rotations.dtype == shapes.motion.translations.dtype == np.float32
    assert shapes.motion.rotations.shape == walk.rotations.shape


@pytest.mark.parametrize("name", sorted({*ALL} - {"add_spikes", "inject_errors"}))
def test_mapped_over_keys(walk, damaged, name):
    keys = jnp.stack([jax.random.key(8), KEY])
    mapped = jax.jit(jax.vmap(lambda key: getattr(samples, name)(walk, key, **ALL[name])))(keys)
    want = damaged[name]
    np.testing.assert_array_equal(mapped.mask[1], want.mask)
    np.testing.assert_allclose(mapped.motion.rotations[1], want.motion.rotations, atol=1e-14)
    np.testing.assert_allclose(mapped.motion.translations[1], want.motion.translations, atol=1e-14)
    other = jax.tree.map(lambda x: x[0], mapped.motion)
    assert changed(other, want.motion).any()


@pytest.mark.parametrize(
    ("name", "frames"),
    [(name, 1) for name in ALL]
    + [(n, t) for n in ("freeze_joints", "fill_gaps", "drop_frames") for t in (2, 3)],
)
def test_short_clips(walk, name, frames):
    motion = walk[:frames]
    result = getattr(samples, name)(motion, KEY, **ALL[name])
    assert np.isfinite(np.asarray(result.motion.rotations)).all()
    assert result.mask.shape == (frames, 22)
    assert not np.any(changed(motion, result.motion) & ~np.asarray(result.mask))


def test_offsets_may_come_and_go(walk):
    """The same runs and directions, their edges as raised cosines; no jump is left."""
    options = {"runs": 4, "length": (20, 30), "magnitude": (0.5, 1.0)}
    hard = samples.offset_joints(walk, KEY, **options)
    soft = samples.offset_joints(walk, KEY, ramp=5, **options)
    np.testing.assert_array_equal(hard.mask, soft.mask)
    far, less = (angle_between(walk.rotations, x.motion.rotations) for x in (hard, soft))
    mask = np.asarray(hard.mask)
    weights = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, 6) / 6)
    seen = 0
    for joint in np.flatnonzero(mask.any(axis=0)):
        frames = np.flatnonzero(mask[:, joint])
        runs = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
        for run in (run for run in runs if 20 <= len(run) <= 30 and run[-1] < 89):
            shape = np.ones(len(run))
            shape[:5], shape[-5:] = weights, weights[::-1]
            np.testing.assert_allclose(less[run, joint], shape * far[run, joint], atol=1e-9)
            seen += 1
    assert seen
    assert np.abs(np.diff(less, axis=0)).max() < 0.3 < np.abs(np.diff(far, axis=0)).max()


def test_holds_may_shake(walk):
    """About what is held, by as much as is asked."""
    options = {"runs": 8, "length": (20, 30)}
    still, shaken = (
        samples.freeze_joints(walk, KEY, noise=noise, **options) for noise in (0.0, 0.01)
    )
    np.testing.assert_array_equal(still.mask, shaken.mask)
    mask = np.asarray(still.mask)
    away = angle_between(still.motion.rotations, shaken.motion.rotations)
    assert np.sqrt(np.mean(away[mask] ** 2) / 3) == pytest.approx(0.01, rel=0.1)
    assert not away[~mask].any()


@pytest.mark.parametrize("name", ALL)
def test_changes_are_told(walk, damaged, name):
    """As angles, and of nothing else than the mask's entries."""
    result = damaged[name]
    away = angle_between(walk.rotations, result.motion.rotations)
    np.testing.assert_allclose(result.change, away, atol=1e-7)
    assert not np.asarray(result.change)[~np.asarray(result.mask)].any()


def test_drift_grows_at_its_rate(walk):
    """From the frame before the run on, frame after frame, to its end."""
    result = samples.drift_joints(walk, KEY, runs=1, rate=(0.5, 0.5), length=(20, 20))
    frames, joints = np.nonzero(np.asarray(result.mask))
    assert len({*joints}) == 1
    seconds = np.arange(1, 21) * float(walk.frame_time)
    away = angle_between(walk.rotations, result.motion.rotations)[frames, joints]
    np.testing.assert_allclose(away, 0.5 * seconds[: len(away)], atol=1e-9)


def test_swapped_markers_turn_one_bone(walk):
    """In the world the joint turns, what hangs from it is where it looked before."""
    elbow = walk.skeleton.index("LeftForeArm")
    (hand,) = walk.skeleton.children[elbow]
    result = samples.swap_markers(walk, KEY, runs=1, length=(10, 10), joints=[elbow])
    touched = np.flatnonzero(np.asarray(result.mask).any(axis=0))
    assert {*touched} == {elbow, hand}
    before, after = (jm.forward_kinematics(m).rotations for m in (walk, result.motion))
    turned = angle_between(before, after)
    assert (turned[:, elbow] > 0.5)[np.asarray(result.mask)[:, elbow]].all()
    np.testing.assert_allclose(np.delete(turned, elbow, axis=1), 0, atol=1e-7)


def test_gaps_are_filled_the_short_way(walk):
    """At one speed, from the frame before to the frame after; the rest is as it was."""
    result = samples.fill_gaps(walk, KEY, runs=3, length=(12, 20), joints=[2, 5, 9])
    mask, q = np.asarray(result.mask), np.asarray(result.motion.rotations)
    assert mask.any()
    for joint in np.flatnonzero(mask.any(axis=0)):
        frames = np.flatnonzero(mask[:, joint])
        for run in np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1):
            whole = q[run[0] - 1 : run[-1] + 2, joint]
            steps = angle_between(whole[:-1], whole[1:])
            np.testing.assert_allclose(steps, steps[0], atol=1e-9)
            np.testing.assert_allclose(steps.sum(), angle_between(whole[0], whole[-1]), atol=1e-9)


def test_all_kinds_stay_on_the_joints_that_are_given(walk):
    hit = samples.inject_errors(walk, KEY, joints=[4, 7]).mask
    assert np.flatnonzero(np.asarray(hit).any(axis=0)).tolist() == [4, 7]


def test_a_lone_joint_can_be_hit():
    rng = np.random.default_rng(0)
    lone = random_motion(rng, 9, random_skeleton(rng, 1))
    assert samples.offset_joints(lone, KEY).mask.any()


def test_noise_has_the_asked_deviation_and_passes_gradients(walk):
    noisy = samples.add_noise(walk, KEY, rotation=0.03, translation=0.02)
    q, p = np.asarray(walk.rotations), np.asarray(noisy.motion.rotations)
    w = np.sum(q * p, axis=-1, keepdims=True)
    v = 2 * np.sign(w) * (q[..., :1] * p[..., 1:] - p[..., :1] * q[..., 1:])
    v = v - 2 * np.sign(w) * np.cross(q[..., 1:], p[..., 1:])  # log(q⁻¹p), to third order
    assert v.std() == pytest.approx(0.03, rel=0.03)
    assert abs(v.mean()) < 0.002
    shift = np.asarray(noisy.motion.translations - walk.translations)
    assert shift[:, 0].std() == pytest.approx(0.02, rel=0.15)
    assert not np.any(shift[:, 1:])
    none = samples.add_noise(walk, KEY, rotation=0.0)
    assert not none.mask.any()
    np.testing.assert_array_equal(none.motion.rotations, walk.rotations)
    only = samples.add_noise(walk, KEY, rotation=0.0, translation=0.1).mask
    assert only[:, 0].all()
    assert not only[:, 1:].any()

    @jax.jit
    @jax.value_and_grad
    def total(amount):
        return jnp.sum(samples.add_noise(walk, KEY, rotation=amount).motion.rotations)

    slope = (total(0.02 + 1e-6)[0] - total(0.02 - 1e-6)[0]) / 2e-6
    assert float(total(0.02)[1]) == pytest.approx(float(slope), rel=1e-6)
    assert np.isfinite(total(0.0)[1])


def test_offsets_have_their_size_and_length(walk):
    result = samples.offset_joints(walk, KEY, runs=1, magnitude=(0.7, 0.9), length=(6, 8))
    mask = np.asarray(result.mask)
    joint = np.flatnonzero(mask.any(axis=0))
    assert len(joint) == 1
    assert joint[0] != 0
    assert 6 <= mask.sum() <= 8
    assert np.ptp(np.flatnonzero(mask[:, joint[0]])) == mask.sum() - 1
    angle = angle_between(walk.rotations, result.motion.rotations)[mask]
    assert 0.7 <= angle.min() <= angle.max() <= 0.9
    np.testing.assert_allclose(angle, angle[0], atol=1e-12)
    every = samples.offset_joints(walk, KEY, runs=40, joints=[2, 5])
    angle = angle_between(walk.rotations, every.motion.rotations)[np.asarray(every.mask)]
    assert 0.5 <= angle.min() <= angle.max() <= 1.5
    assert set(np.flatnonzero(np.asarray(every.mask).any(axis=0))) == {2, 5}


def test_spikes_last_one_frame(walk):
    result = samples.add_spikes(walk, KEY, count=1)
    assert result.mask.sum() == 1
    assert samples.add_spikes(walk, KEY, count=30).mask.sum() > 20


def test_violations_leave_the_range_of_the_clip(walk):
    result = samples.violate_limits(walk, KEY, runs=12, excess=(0.3, 0.8))
    mask = np.asarray(result.mask)
    for joint in np.flatnonzero(mask.any(axis=0)):
        clean, pushed = (np.asarray(m.rotations)[:, joint, None] for m in (walk, result.motion))
        # Farther from every pose of the clip than any pose of the clip is from its mean.
        nearest = angle_between(pushed[mask[:, joint]], clean[None, :, 0]).min(axis=1)
        assert nearest.min() > 0.25


def test_frozen_joints_hold_the_frame_before_the_mask(walk):
    result = samples.freeze_joints(walk, KEY, runs=1, length=(7, 7))
    mask = np.asarray(result.mask)
    assert mask.sum() == 7
    joint = int(np.flatnonzero(mask.any(axis=0))[0])
    first = int(np.flatnonzero(mask[:, joint])[0])
    held = np.asarray(result.motion.rotations)[first - 1 : first + 7, joint]
    expected = np.broadcast_to(np.asarray(walk.rotations)[first - 1, joint], held.shape)
    np.testing.assert_array_equal(held, expected)


def test_swapping_twice_gives_the_clip_back(walk):
    once = samples.swap_limbs(walk, KEY)
    twice = samples.swap_limbs(once.motion, KEY)
    np.testing.assert_array_equal(twice.motion.rotations, walk.rotations)
    mask = np.asarray(once.mask)
    left = [n.startswith(("Left", "Right")) for n in walk.skeleton.names]
    np.testing.assert_array_equal(mask.any(axis=0), left)
    i, j = (walk.skeleton.index(n) for n in ("LeftLeg", "RightLeg"))
    hit = mask[:, i]
    np.testing.assert_array_equal(
        np.asarray(once.motion.rotations)[hit, i], np.asarray(walk.rotations)[hit, j]
    )
    some = samples.swap_limbs(walk, KEY, pairs=[(i, j)])
    assert set(np.flatnonzero(np.asarray(some.mask).any(axis=0))) == {i, j}


def test_dropped_frames_repeat_the_last_one_kept(walk):
    result = samples.drop_frames(walk, KEY, rate=0.4)
    lost = np.asarray(result.mask)[:, 0]
    assert not lost[0]
    assert 0.2 < lost.mean() < 0.6
    kept = 0
    for t in range(walk.num_frames):
        kept = kept if lost[t] else t
        np.testing.assert_array_equal(result.motion.rotations[t], walk.rotations[kept])
        np.testing.assert_array_equal(result.motion.translations[t], walk.translations[kept])
    everything = samples.drop_frames(walk, KEY, rate=1.0)
    assert np.asarray(everything.mask)[1:].all()
    assert not np.asarray(everything.mask)[0].any()


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_the_root_slides_slowly_along_the_floor(walk, up):
    skeleton = samples.biped()
    turned = type(skeleton)(skeleton.names, skeleton.parents, skeleton.offsets, up=up)
    motion = type(walk)(turned, walk.translations, walk.rotations, walk.frame_time)
    drift = np.asarray(samples.slide_root(motion, KEY, amount=0.2).motion.translations)
    drift = drift[:, 0] - np.asarray(walk.translations)[:, 0]
    assert not np.any(drift[:, "xyz".index(up)])
    chain = 0.46 + np.hypot(0.03, 0.12) - 0.10 + np.hypot(0.15, 0.01) + 0.28 + 0.25
    legs = np.hypot(0.09, 0.04) + 0.43 + 0.41 + np.hypot(0.08, 0.14)
    assert np.linalg.norm(drift[-1]) == pytest.approx(0.2 * max(chain, legs), rel=1e-9)
    assert np.linalg.norm(np.diff(drift, axis=0), axis=-1).max() < 3 * 0.2 * legs / 90
    still = samples.slide_root(motion, KEY, amount=0.0)
    assert not still.mask.any()
    np.testing.assert_array_equal(still.motion.translations, walk.translations)


def test_flipped_signs_are_the_same_rotations(walk, damaged):
    flipped = damaged["flip_signs"]
    assert_same_rotation(flipped.motion.rotations, walk.rotations)
    assert 0.15 < np.asarray(flipped.mask).mean() < 0.25


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("add_noise", {"rotation": -0.1}, "rotation must be 0 or more, got -0.1"),
        ("add_noise", {"translation": -1.0}, "translation must be 0 or more, got -1"),
        ("offset_joints", {"runs": 0}, "runs=0"),
        ("offset_joints", {"magnitude": (1.5, 0.5)}, "magnitude="),
        ("offset_joints", {"length": (0, 5)}, "length="),
        ("offset_joints", {"joints": [99]}, "from 0 to 21"),
        ("offset_joints", {"joints": []}, "joints="),
        ("add_spikes", {"count": 0}, "count=0"),
        ("violate_limits", {"excess": (-1.0, 0.5)}, "excess="),
        ("freeze_joints", {"length": (9, 3)}, "length="),
        ("swap_limbs", {"pairs": [(1, 2), (2, 3)]}, "twice"),
        ("swap_limbs", {"pairs": []}, "no joints called"),
        ("drop_frames", {"rate": 1.5}, "rate must be a share from 0 to 1, got 1.5"),
        ("flip_signs", {"rate": -0.1}, "rate must be a share from 0 to 1, got -0.1"),
        ("slide_root", {"amount": -1.0}, "amount must be 0 or more, got -1"),
    ],
)
def test_bad_arguments(walk, name, options, message):
    with pytest.raises(ValueError, match=message):
        getattr(samples, name)(walk, KEY, **options)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("swap_limbs", {"pairs": [(1, 99)]}, "swap_limbs: pairs=.* joints from 0 to 21"),
        ("swap_limbs", {"pairs": [(1, 2, 3)]}, "swap_limbs: pairs="),
        ("add_noise", {"rotation": np.ones(3)}, r"add_noise: rotation has shape \(3,\)"),
        ("add_noise", {"translation": np.ones((9, 1))}, "add_noise: translation has shape"),
        ("drop_frames", {"rate": np.ones(2) / 2}, "drop_frames: rate has shape"),
        ("flip_signs", {"rate": np.ones(2) / 2}, "flip_signs: rate has shape"),
        ("slide_root", {"amount": np.ones(2)}, "slide_root: amount has shape"),
        ("inject_errors", {"runs": 0}, "inject_errors: runs=0"),
        ("inject_errors", {"joints": [22]}, "inject_errors: joints"),
        ("offset_joints", {"ramp": -1}, "offset_joints: ramp=-1"),
        ("freeze_joints", {"noise": -0.1}, "freeze_joints: noise must be 0 or more"),
        ("fill_gaps", {"runs": 0}, "fill_gaps: runs=0"),
        ("drift_joints", {"rate": (1, 0.5)}, r"drift_joints: rate=\(1, 0.5\)"),
        ("swap_markers", {"joints": [22]}, "swap_markers: joints"),
    ],
)
def test_errors_name_what_was_called(walk, name, options, message):
    with no_shape_checks(), pytest.raises(ValueError, match=message):
        getattr(samples, name)(walk, KEY, **options)
