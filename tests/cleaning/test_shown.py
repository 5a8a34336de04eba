"""What neighbours show in place of a run, by plain loops."""

import numpy as np
import pytest
from scipy.spatial.transform import Slerp

from jaxmotion.cleaning import joint_groups, nearest_words
from jaxmotion.cleaning.body import as_lean
from jaxmotion.cleaning.levels import examined
from jaxmotion.cleaning.shown import Shown
from jaxmotion.cleaning.words import texture
from tests.cleaning.clips import pacing, turned
from tests.cleaning.oracles import ShownByHand, median_by_hand, medoid_by_hand
from tests.helpers import angle_between, assert_same_rotation
from tests.style.clips import quaternions, rotations, swaying

K = 3


@pytest.fixture(scope="module")
def given():
    """A clip with errors, its context, what was found, and what is wrong."""
    motion = turned(pacing(0, 80), 2, np.arange(30, 42), [1.0, 0, 0])
    motion = turned(motion, 3, np.arange(6), [1.2, 0, 0])
    motion = turned(motion, 1, np.arange(70, 80), [0, 0, 1.2])
    context = [pacing(1, 60), pacing(2, 50)]
    wrong = np.zeros((80, 5), bool)
    wrong[30:42, 2] = wrong[:6, 3] = wrong[70:, 1] = True
    return motion, context, examined("f", motion, context, K), wrong


def shown(given, method):
    motion, _, evidence, wrong = given
    return Shown(evidence, wrong, as_lean(motion), method)


@pytest.mark.parametrize(
    ("method", "middle"), [("median", median_by_hand), ("medoid", medoid_by_hand)]
)
def test_one_pose_of_all(given, method, middle):
    """Of the run and a frame on both sides, where there is one."""
    motion, context, _, wrong = given
    found, by_hand = shown(given, method), ShownByHand(motion, context, K, wrong)
    for joint, start, stop, first, last in (
        (2, 30, 42, 29, 43),
        (3, 0, 6, 0, 7),
        (1, 70, 80, 69, 80),
    ):
        poses = found.over(joint, start, stop)
        assert len(poses) == last - first
        for t in (first, (first + last) // 2, last - 1):
            q = by_hand(t, joint)
            assert_same_rotation(poses[t - first], middle(q), 1e-7)


def candidates_by_hand(motion, context, wrong, joint, first, last):
    """What each neighbour of a word about the middle shows in those frames."""
    every = [motion, *context]
    textures = [np.asarray(texture(clip, tuple(range(5)))) for clip in every]
    made = []
    for members in joint_groups(every).values():
        if joint not in members:
            continue
        found = nearest_words(motion, context, k=K, joints=members)
        for word, start in enumerate(np.asarray(found.starts)):
            if not start <= (first + last - 1) / 2 < start + 15:
                continue
            for clip, warp in zip(found.clip[word], np.asarray(found.warp)[word], strict=True):
                at = []
                for t in range(first, last):
                    i = t - start
                    if i < 0:
                        at.append(warp[0] + i)
                    elif i > 14:
                        at.append(warp[14] + i - 14)
                    else:
                        at.append(warp[i])
                q = textures[int(clip)][:, joint]
                if clip < 0 or min(at) < 0 or max(at) > len(q) - 1:
                    continue
                beside = np.minimum(np.array([at, np.array(at) + 1]), len(q) - 1)
                if clip == 0 and wrong[beside, joint].any():
                    continue
                made.append(quaternions(Slerp(np.arange(len(q)), rotations(q))(at)))
    return made


def test_the_nearest_end(given):
    """The neighbour whose ends lie nearest to the frames beside; an end that is the clip's does not
    count."""
    motion, context, _, wrong = given
    leans, found = as_lean(motion), shown(given, "nearest_end")
    for joint, start, stop in ((2, 30, 42), (3, 0, 6), (1, 70, 80)):
        first, last = max(start - 1, 0), min(stop + 1, 80)
        made = candidates_by_hand(motion, context, wrong, joint, first, last)
        assert len(made) >= 2
        sides = [(0, first)] * (start > 0) + [(-1, last - 1)] * (stop < 80)
        away = [sum(angle_between(q[end], leans[t, joint]) ** 2 for end, t in sides) for q in made]
        poses = found.over(joint, start, stop)
        assert_same_rotation(poses, made[int(np.argmin(away))], 1e-7)


def test_what_nothing_is_shown_of(given):
    """Joints that tell nothing, and clips without neighbours."""
    motion = pacing(0, 60)
    q = np.array(motion.rotations)
    q[:, 3] = q[0, 3]
    motion, wrong = motion.with_transforms(rotations=q), np.zeros((60, 5), bool)
    evidence = examined("f", motion, (), K)
    short = swaying(0, 10)
    alone = examined("f", short, (), K)
    still = motion.with_transforms(rotations=np.repeat(q[:1], 60, axis=0))
    stands = examined("f", still, (), K)
    for method in ("median", "medoid", "nearest_end"):
        found = Shown(evidence, wrong, as_lean(motion), method)
        assert found.over(3, 20, 25) is None
        assert found.over(2, 20, 25) is not None
        found = Shown(alone, wrong[:10], as_lean(short), method)
        assert found.over(2, 3, 5) is None
        assert Shown(stands, wrong, as_lean(still), method).over(2, 3, 5) is None


def test_between_thinned_frames():
    """At 120 frames a second every fifth is looked at; those between lie between them."""
    motion = pacing(0, 400, rate=120.0)
    evidence = examined("f", motion, [pacing(1, 70)], K)
    wrong = np.zeros((400, 5), bool)
    wrong[200:230, 2] = True
    for method in ("median", "medoid", "nearest_end"):
        poses = Shown(evidence, wrong, as_lean(motion), method).over(2, 200, 230)
        assert poses.shape == (32, 4)
        step = angle_between(poses[1:], poses[:-1])
        # No frame stands still, and none jumps.
        assert step.max() < 3 * np.median(step) + 0.02
        assert angle_between(poses, motion.rotations[199:231, 2]).max() < 0.2
