"""What leans, and comes back: the body's rotation without its yaw, and with it again."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.cleaning.body import as_lean, from_lean
from tests.cleaning.clips import pacing
from tests.helpers import assert_same_rotation, quaternions_by, random_quaternions
from tests.style.clips import quaternions, rotations, swaying


def yaw_of(q, up=1):
    """The twist of SciPy's swing and twist."""
    q = rotations(q).as_quat()
    q[:, [axis for axis in range(3) if axis != up]] = 0
    return Rotation.from_quat(q)


def carried(seed=0, frames=30):
    """Hips that hang from a root of their own, both of which move; z is up."""
    rng = np.random.default_rng(seed)
    names, parents = ("root", "hips", "spine", "leg"), (-1, 0, 1, 1)
    offsets = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 1], [0, 0, -1.0]])
    skeleton = jm.Skeleton(names, parents, offsets, up="z")
    q = np.array(random_quaternions(rng, (frames, 4), angle=0.5))
    q[:, 0] = quaternions_by(np.linspace(0, 2, frames)[:, None] * np.array([0, 0, 1.0]))
    there = np.array(np.broadcast_to(offsets, (frames, 4, 3)))
    there[:, :2] += 0.1 * rng.standard_normal((frames, 2, 3))
    return jm.Motion(skeleton, there, q, 1 / 30)


def test_only_the_body_changes(dtype):
    motion = swaying(0).astype(dtype)
    leans = as_lean(motion)
    assert leans.dtype == dtype
    np.testing.assert_array_equal(leans[:, 1:], motion.rotations[:, 1:])
    wanted = yaw_of(motion.rotations[:, 0]).inv() * rotations(motion.rotations[:, 0])
    assert_same_rotation(leans[:, 0], quaternions(wanted), 1e-9 if dtype == np.float64 else 1e-5)


@pytest.mark.parametrize("make", [swaying, carried])
def test_there_and_back(make):
    """In the frames that are wrong as well, where the yaw is that of frames beside; bit for bit
    where the body is not wrong."""
    motion = make(0)
    body = 1 if make is carried else 0
    wrong = np.zeros(motion.rotations.shape[:2], bool)
    wrong[5, body + 1] = True
    back = from_lean(motion, as_lean(motion), wrong)
    np.testing.assert_array_equal(back, motion.rotations)
    wrong[7, body] = True
    back = from_lean(motion, as_lean(motion), wrong)
    sound = ~wrong[:, body]
    assert_same_rotation(back[sound], np.asarray(motion.rotations)[sound], 1e-9)


@pytest.mark.parametrize("make", [swaying, carried])
def test_yaw_goes_between(make):
    """From the frame before to the one after, at one speed, whatever it was."""
    motion = make(1, 30)
    up = motion.skeleton.up_axis
    body = 1 if make is carried else 0
    wrong = np.zeros(motion.rotations.shape[:2], bool)
    wrong[10:15, body] = True
    back = from_lean(motion, as_lean(motion), wrong)

    def in_world(q):
        one = rotations(q[:, 0])
        return quaternions(one * rotations(q[:, 1]) if body else one)

    old, new = in_world(np.asarray(motion.rotations)), in_world(back)
    heading = np.unwrap([x[up] for x in yaw_of(new, up).as_rotvec()])
    np.testing.assert_allclose(np.diff(heading[9:16], 2), 0, atol=1e-7)
    np.testing.assert_allclose(
        heading[[9, 15]], np.unwrap(yaw_of(old, up).as_rotvec()[:, up])[[9, 15]], atol=1e-7
    )
    lean = [yaw_of(x, up).inv() * rotations(x) for x in (old, new)]
    assert_same_rotation(quaternions(lean[0]), quaternions(lean[1]), 1e-7)


def test_yaw_at_the_ends_of_a_clip():
    """Stays; where the body is wrong all the time there is none."""
    motion = pacing(0, 12)
    wrong = np.zeros((12, 5), bool)
    wrong[:3, 0] = True
    q = np.array(motion.rotations)
    q[:3, 0] = quaternions(Rotation.from_rotvec([0, 1, 0]) * rotations(q[:3, 0]))
    back = from_lean(motion.with_transforms(rotations=q), as_lean(motion), wrong)
    yaw = yaw_of(back[:4, 0]).as_rotvec()[:, 1]
    np.testing.assert_allclose(yaw, yaw[3], atol=1e-9)
    wrong[:, 0] = True
    assert np.isfinite(from_lean(motion, as_lean(motion), wrong)).all()
