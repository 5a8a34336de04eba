"""Ranges and speeds of clean clips, by plain loops."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.cleaning import baseline_errors
from tests.helpers import angle_between, no_shape_checks
from tests.style.clips import quaternions, rotations, swaying


def with_turns(motion, places):
    """Turned by rotation vectors: {(frame, joint): vector}."""
    q = np.array(motion.rotations)
    for (t, j), v in places.items():
        q[t, j] = quaternions(rotations(q[t, j]) * Rotation.from_rotvec(v))[0]
    return motion.with_transforms(rotations=q)


def rates_by_hand(motion, clean):
    """A step on either side is faster than any of the same joint."""
    speed = [
        angle_between(x.rotations[:-1], x.rotations[1:]) / float(x.frame_time)
        if x.num_frames > 1
        else np.zeros((0, x.num_joints))
        for x in (motion, *clean)
    ]
    found = np.zeros(motion.rotations.shape[:2], bool)
    for j in range(motion.num_joints):
        most = max(x[:, j].max(initial=0) for x in speed[1:])
        for t in range(len(speed[0])):
            if speed[0][t, j] > most:
                found[t, j] = found[t + 1, j] = True
    return found


def test_rates_in_plain_loops():
    clean = [swaying(0, 60), swaying(0, 40)]
    motion = with_turns(clean[0], {(10, 2): [0.4, 0, 0], (30, 4): [0, 0.02, 0]})
    found = np.asarray(baseline_errors(motion, clean, "rates"))
    np.testing.assert_array_equal(found, rates_by_hand(motion, clean))
    np.testing.assert_array_equal(np.flatnonzero(found[:, 2]), [9, 10, 11])
    # The same steps in half the time.
    fast = clean[0].replace(frame_time=clean[0].frame_time / 2)
    found = np.asarray(baseline_errors(fast, clean, "rates"))
    np.testing.assert_array_equal(found, rates_by_hand(fast, clean))
    assert found.any()
    assert not np.asarray(baseline_errors(clean[0], [fast], "rates")).any()


def test_limits_are_what_the_clean_clips_keep():
    """The clips themselves keep them; what goes beyond on an axis does not, if only a little."""
    clean = [swaying(1, 60), swaying(2, 50)]
    for clip in clean:
        assert not np.asarray(baseline_errors(clip, clean, "limits")).any()
    motion = with_turns(clean[0], {(10, 2): [1.5, 0, 0], (40, 3): [0, -1.5, 0]})
    found = np.asarray(baseline_errors(motion, clean, "limits"))
    wanted = np.zeros((60, 5), bool)
    wanted[10, 2] = wanted[40, 3] = True
    np.testing.assert_array_equal(found, wanted)
    # By a little as well: a joint that turns about one axis only.
    q = np.array(clean[0].rotations)
    angle = 0.4 * np.sin(np.arange(60) / 5)
    angle[15:17] = 0.4, -0.4
    q[:, 2] = quaternions(Rotation.from_rotvec(angle[:, None] * np.array([1.0, 0, 0])))
    hinge = clean[0].with_transforms(rotations=q)
    for size, beyond in ((0.39, False), (0.41, True)):
        q = q.copy()
        q[20, 2] = quaternions(Rotation.from_rotvec([size, 0, 0]))
        found = baseline_errors(clean[0].with_transforms(rotations=q), hinge, "limits")
        np.testing.assert_array_equal(np.flatnonzero(found), [20 * 5 + 2] if beyond else [])
    # The root has no limits.
    turned = with_turns(clean[0], {(10, 0): [1.5, 0, 0]})
    assert not np.asarray(baseline_errors(turned, clean, "limits")).any()


def test_both(dtype):
    clean = swaying(1, 60).astype(dtype)
    motion = with_turns(clean, {(10, 2): [1.5, 0, 0], (30, 4): [0, 0.3, 0]}).astype(dtype)
    limits, rates, both = (
        np.asarray(baseline_errors(motion, clean, rule)) for rule in ("limits", "rates", "both")
    )
    np.testing.assert_array_equal(both, limits | rates)
    np.testing.assert_array_equal(both, baseline_errors(motion, [clean]))
    assert (limits & ~rates).any() or (rates & ~limits).any()
    signed = motion.with_transforms(rotations=-np.asarray(motion.rotations))
    np.testing.assert_array_equal(both, baseline_errors(signed, clean))


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_few_frames(frames):
    clean = swaying(3, 40)
    assert not np.asarray(baseline_errors(clean[:frames], clean)).any()
    found = np.asarray(baseline_errors(clean[:3], clean[:frames], "rates"))
    np.testing.assert_array_equal(found, rates_by_hand(clean[:3], [clean[:frames]]))


def test_other_styles_are_called_errors():
    """What the baselines are known for."""
    walk = jm.samples.load("walk", fps=24.0, num_frames=60).motion
    wide = walk.with_transforms(
        rotations=jm.quaternion.slerp(
            np.broadcast_to([1.0, 0, 0, 0], walk.rotations.shape).astype(walk.dtype),
            walk.rotations,
            np.asarray(1.3, walk.dtype),
        )
    )
    assert np.asarray(baseline_errors(wide, walk)).mean() > 0.05


def test_what_is_wrong_is_said():
    motion = swaying(4)
    with pytest.raises(ValueError, match="no clean clips"):
        baseline_errors(motion, [])
    with pytest.raises(ValueError, match="other joints"):
        baseline_errors(motion, swaying(0, names=("a", "b", "c", "d", "e")))
    with pytest.raises(ValueError, match="traced"):
        jax.jit(lambda m: baseline_errors(m, motion))(motion)
    q = np.array(motion.rotations)
    q[3, 2] = np.nan
    with pytest.raises(ValueError, match="finite"):
        baseline_errors(motion.with_transforms(rotations=q), motion)
    with no_shape_checks(), pytest.raises(ValueError, match="rule"):
        baseline_errors(motion, motion, "all")
