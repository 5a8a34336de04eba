"""Spikes told from feet that push off, against the rule in plain loops; and the list of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion import quaternion
from jaxmotion.smoothing import bridged, outlier_weights
from jaxmotion.smoothing.spikes import spikes
from tests.helpers import no_shape_checks, random_skeleton

FRAMES, JOINTS = 96, 4
# Degrees of a toe at 30 frames a second, as real ones move: it swells, and is soon back.
TOE_OFFS = (
    [0.3, 1.5, 9, 18, 32, 13, 6, 6],
    [0.1, 4, 5, 16, 26, 46, 8, 4],
    [1, 2, 6, 15, 19, 30, 22, 4],
)


def turned(axis, degrees):
    """Quaternions f[..., 4] about an axis."""
    half = np.radians(np.asarray(degrees))[..., None] / 2
    return np.concatenate([np.cos(half), np.sin(half) * np.asarray(axis)], axis=-1)


def swinging(frames=FRAMES, fps=30.0):
    """f[T, J, 4] at ease: a few degrees a frame at 30 frames a second."""
    t = np.arange(frames) / fps
    angles = [25 * np.sin(5 * t), 8 * np.sin(3 * t + 1), 15 * np.cos(4 * t), np.zeros(frames)]
    axes = [[1, 0, 0], [0, 1, 0], [0, 0.6, 0.8], [0, 0, 1]]
    return np.stack([turned(a, x) for a, x in zip(axes, angles, strict=True)], axis=1)


def walking():
    """The same, with a toe that pushes off every 30 frames as the last joint."""
    toe = np.zeros(FRAMES)
    for start, angles in zip((15, 44, 75), TOE_OFFS, strict=True):
        toe[start : start + len(angles)] = angles
    q = swinging()
    q[:, 3] = turned([1, 0, 0], toe)
    return q


def spoilt(q, events, seed=0):
    """Rotations with events (joint, first frame, number of frames, degrees), and which samples."""
    rng = np.random.default_rng(seed)
    q, hit = q.copy(), np.zeros(q.shape[:2], bool)
    for joint, start, length, degrees in events:
        axis = rng.standard_normal(3)
        spike = turned(axis / np.linalg.norm(axis), degrees)
        sign = rng.choice([-1, 1])
        for t in range(start, start + length):
            q[t, joint] = sign * np.asarray(quaternion.multiply(q[t, joint], spike))
            hit[t, joint] = True
    return q, hit


EVENTS = [(0, 8, 1, 20), (0, 40, 2, 45), (1, 20, 3, 20), (1, 60, 1, 150), (2, 30, 2, 30)]
EVENTS += [(2, 33, 1, 60), (2, 70, 3, 179), (3, 29, 1, 60), (3, 64, 3, 90)]
_found = jax.jit(spikes, static_argnames="turning")


def found(x, there=None, fps=30.0, turning=True):
    x = jnp.asarray(x)
    there = np.ones(x.shape[:2], bool) if there is None else there
    return np.asarray(_found(x, there, jnp.asarray(1 / fps, x.dtype), turning=turning))


def by_loops(q, fps):
    """The rule for whole clips in loops over joints and frames, on rotations of SciPy."""

    def turn(a, b):
        pair = Rotation.from_quat(a, scalar_first=True), Rotation.from_quat(b, scalar_first=True)
        return (pair[0].inv() * pair[1]).magnitude()

    frames, joints, _ = q.shape
    got = np.zeros((frames, joints), bool)
    for j in range(joints):
        y = q[:, j].copy()
        for t in range(1, frames):
            y[t] *= -1 if y[t] @ y[t - 1] < 0 else 1

        def bridges(a, b, y=y):
            near = [y[a - 1 if a > 1 else 0], y[a], y[b], y[min(b + 1, frames - 1)]]
            near = [-x if x @ near[1] < 0 else x for x in near]
            ends = np.array([-1.0, 0, b - a, b - a + 1])
            cubic = np.linalg.solve(np.vander(ends), np.array(near))
            for at in range(1, b - a):
                share = at / (b - a)
                chord = (1 - share) * near[1] + share * near[2]
                yield min(
                    turn(chord, y[a + at]), turn(at ** np.arange(3, -1, -1) @ cubic, y[a + at])
                )

        step = np.array([turn(y[t], y[t + 1]) for t in range(frames - 1)])
        runs = [(a, a + n + 1) for n in (1, 2, 3) for a in range(frames - n - 1)]
        out = {}
        for a, b in runs:
            d = min(*bridges(a, b), step[a] / 0.7, step[b - 1] / 0.7)
            out[a, b] = d if max(step[a:b]) < 4 * d else 0
        across = {(a, b): turn(y[a], y[b]) for a, b in runs}
        suspect = np.zeros(frames + 1, bool)
        for a, b in runs:
            suspect[a + 1 : b] |= out[a, b] > 3 * (across[a, b] + np.median(step))

        def bend(t, y=y, suspect=suspect):
            if t < 1 or t > frames - 2 or suspect[t - 1 : t + 2].any():
                return 0
            before, after = y[t - 1], y[t + 1] if y[t + 1] @ y[t - 1] > 0 else -y[t + 1]
            return 2 * turn(before + after, y[t])

        def usual(values):
            blocks = [max(values[t : t + 8]) for t in range(0, len(values), 8)]
            return sorted(blocks)[-3]

        fast = min(usual([0, *step]), np.radians(450 / fps))
        own = {
            n: usual([0, *(out.get((t, t + n + 1), 0) for t in range(frames - 1))])
            for n in (1, 2, 3)
        }
        for a, b in runs:
            rough = max(bend(t) for t in (a - 3, a - 2, a - 1, b + 1, b + 2, b + 3))
            limit = max(2.75 * max(rough, np.radians(0.3)), fast)
            limit = max(limit, min(2 * own[b - a - 1], np.radians(1200 / fps)))
            alone = not suspect[a] and not suspect[b]
            if out[a, b] > limit and alone:
                got[a + 1 : b, j] = True
    return got


def test_the_rule_is_that_of_plain_loops():
    rng = np.random.default_rng(5)
    noise = Rotation.from_rotvec(np.radians(0.5) * rng.standard_normal((FRAMES * JOINTS, 3)))
    noise = noise.as_quat(scalar_first=True).reshape(FRAMES, JOINTS, 4)
    q = np.asarray(quaternion.multiply(walking(), noise))
    few = [(joint, start, length, 12.0 + 4 * start % 31) for joint, start, length, _ in EVENTS]
    q, hit = spoilt(q, few)
    want = by_loops(q, 30.0)
    assert 0.3 < np.mean(want[hit]) < 1  # some are near the limits
    np.testing.assert_array_equal(found(q)[4:-4], want[4:-4])


def test_a_foot_that_pushes_off_is_no_spike(dtype):
    q = walking().astype(dtype)
    step = np.degrees(quaternion.distance(q[1:, 3], q[:-1, 3]))
    assert step.max() > 30
    assert not found(q).any()
    motion = clip_of(q)
    np.testing.assert_array_equal(outlier_weights(motion), 1)


def test_spikes_are_found_whole_and_alone(dtype):
    q, hit = spoilt(walking(), EVENTS)
    np.testing.assert_array_equal(found(q.astype(dtype)), hit)


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
def test_spikes_are_found_at_all_rates(fps):
    q, hit = spoilt(swinging(fps=fps), EVENTS)
    np.testing.assert_array_equal(found(q, fps=fps), hit)


def test_an_error_that_comes_often_is_one_if_no_joint_can_do_it():
    """25 degrees there and back are too much in 1/60 s, and what a toe does in 1/15 s."""
    q, hit = spoilt(swinging(), [(1, t, 1, 25) for t in range(6, 90, 10)])
    np.testing.assert_array_equal(found(q, fps=120.0), hit)
    assert not found(q, fps=30.0).any()


def test_the_first_and_the_last_frame_are_judged_by_one_edge():
    q, hit = spoilt(swinging(), [(0, 0, 1, 60), (1, FRAMES - 1, 1, 60)])
    np.testing.assert_array_equal(found(q), hit)
    near, _ = spoilt(swinging(), [(0, 0, 1, 30), (1, FRAMES - 1, 1, 30)])
    assert not found(near).any()


def test_a_turn_that_stays_and_a_rotation_at_rest_are_none():
    q = np.array(swinging())
    q[50:, 1] = quaternion.multiply(q[50:, 1], turned([0, 0, 1], 120.0))
    assert not found(q).any()
    assert not found(np.broadcast_to(q[:1], q.shape)).any()


def test_missing_samples_are_never_looked_at():
    q, hit = spoilt(walking(), EVENTS)
    there = np.ones(hit.shape, bool)
    there[50:54], there[FRAMES - 5 :] = False, False
    gone = np.where(there[..., None], q, np.nan)
    np.testing.assert_array_equal(found(gone, there), hit & there)


def test_jumps_of_a_position_are_found_in_any_unit():
    t = np.arange(FRAMES) / 30
    path = np.stack([1.4 * t, 0.9 + 0.03 * np.sin(12 * t), 0 * t], axis=-1)[:, None]
    path = np.repeat(path, JOINTS, axis=1)
    hit = np.zeros(path.shape[:2], bool)
    for joint, start, length in ((0, 20, 1), (1, 40, 2), (2, 70, 3)):
        path[start : start + length, joint] += [0, 0.5, 0]
        hit[start : start + length, joint] = True
    for unit in (0.01, 1, 1000):
        np.testing.assert_array_equal(found(unit * path, turning=False), hit)


def test_batches_and_derivatives():
    clips = np.stack([spoilt(walking(), EVENTS)[0], swinging()])
    there, step = np.ones(clips.shape[1:3], bool), jnp.asarray(1 / 30)
    both = jax.vmap(lambda q: _found(q, there, step, turning=True))(clips)
    for got, q in zip(both, clips, strict=True):
        np.testing.assert_array_equal(got, found(q))
    motion = clip_of(clips[0])
    slope = jax.grad(lambda q: jnp.sum(outlier_weights(motion.with_transforms(rotations=q))))
    np.testing.assert_array_equal(slope(motion.rotations), 0)


def clip_of(q):
    rng = np.random.default_rng(0)
    skeleton = random_skeleton(rng, JOINTS, dtype=q.dtype)
    offsets = np.broadcast_to(skeleton.offsets, (len(q), JOINTS, 3))
    return jm.Motion(skeleton, offsets, q, 1 / 30)


def test_what_was_bridged_is_listed():
    q, _ = spoilt(walking(), [(2, 30, 2, 40), (0, 8, 1, 25), (0, 60, 3, 90)])
    motion, clean = clip_of(q), clip_of(walking())
    rows = bridged(motion, clean, outlier_weights(motion))
    assert [(r.joint, r.frame, r.last_frame) for r in rows] == [
        ("joint0", 8, 8),
        ("joint2", 30, 31),
        ("joint0", 60, 62),
    ]
    np.testing.assert_allclose([r.degrees for r in rows], [25, 40, 90], atol=1e-6)
    np.testing.assert_allclose([r.seconds for r in rows], [8 / 30, 1, 2])
    every = bridged(motion, clean, np.arange(FRAMES) % 48 != 8)
    assert [r.frame for r in every] == [8] * JOINTS + [56] * JOINTS
    assert bridged(motion, clean, np.ones(FRAMES)) == ()


def test_mistakes_in_lists_are_named():
    motion = clip_of(walking())
    with pytest.raises(ValueError, match=r"bridged: weights have shape \(3,\)"):
        bridged(motion, motion, np.ones(3))
    with pytest.raises(ValueError, match=r"bridged: result has rotations of shape \(90, 4, 4\)"):
        bridged(motion, motion[:90], np.ones(FRAMES))
    with no_shape_checks(), pytest.raises(ValueError, match="bridged: result is a str"):
        bridged(motion, "walk.bvh", np.ones(FRAMES))
    with pytest.raises(TypeError, match="inside of jit"):
        jax.jit(lambda m: bridged(m, m, np.ones(FRAMES)) and 0)(motion)


WALKS = ("walk_childish_002", "walk-left_happy_001", "walk-right_happy_001", "walk_old_002")


@pytest.mark.parametrize("name", WALKS)
def test_real_steps_are_no_spikes_and_spikes_among_them_are(name, data_dir):
    """96 frames at 30 frames a second, with toes that turn by up to 20 degrees a frame."""
    q = np.asarray(jm.load(data_dir / "bandai" / f"{name}.bvh").rotations)[:96]
    assert not found(q).any()
    moving = np.flatnonzero(np.max(quaternion.distance(q, q[:1]), axis=0) > 0.1)
    events = [
        (joint, start, length, degrees)
        for joint, start, length, degrees in zip(
            np.resize(moving, 12), range(7, 90, 7), [1, 2, 3] * 4, [30, 45, 60, 90] * 3, strict=True
        )
    ]
    spiked, hit = spoilt(q, events)
    got = found(spiked)
    assert np.mean(got[hit]) > 0.9
    assert not got[~hit].any()
