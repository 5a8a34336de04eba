"""Which points are the figure's."""

import numpy as np

import jaxmotion as jm
from jaxmotion.viz.body import body_of, some_poses
from jaxmotion.viz.poses import _bones


def standing_root(frames=61):
    """A walk under a root that stays at the origin, as in Bandai Namco's files."""
    walk = jm.samples.load("walk", num_frames=frames).motion
    skeleton = walk.skeleton
    stays = jm.Skeleton(
        ("World", *skeleton.names),
        (-1, *(parent + 1 for parent in skeleton.parents)),
        np.concatenate([np.zeros((1, 3)), skeleton.offsets]),
        end_joints=[joint + 1 for joint in skeleton.end_joints],
        end_offsets=skeleton.end_offsets,
    )
    still = np.tile([1.0, 0, 0, 0], (frames, 1, 1))
    translations = [np.zeros((frames, 1, 3)), walk.translations]
    rotations = [still, walk.rotations]
    there, turned = (np.concatenate(x, axis=1) for x in (translations, rotations))
    return walk, jm.Motion(stays, there, turned, walk.frame_time)


def points_and_parents(motion):
    pose = jm.forward_kinematics(motion)
    points = np.concatenate([pose.positions, pose.end_positions], axis=1)
    return points, [*motion.skeleton.parents, *motion.skeleton.end_joints]


def test_a_root_that_stays_is_no_part():
    walk, motion = standing_root()
    points, parents = points_and_parents(motion)
    body = body_of(points, parents)
    np.testing.assert_array_equal(body.points, np.arange(len(parents)) > 0)
    np.testing.assert_array_equal(body.loose, np.arange(len(parents)) == 1)
    assert body.first == 1
    np.testing.assert_array_equal(body.drawn(parents), np.arange(len(parents)) > 1)
    whole = body_of(*points_and_parents(walk))
    assert whole.points.all()
    assert not whole.loose.any()
    assert whole.first == 0


def test_a_part_that_slides_is_seen():
    """A jaw that comes off by more than a fiftieth, and what hangs from it: apart, but drawn."""
    parents = [-1, 0, 1, 1, 3]
    t = np.linspace(0, 1, 9)
    points = np.zeros((9, 5, 3))
    points[:, :, 1] = [0, 1, 2, 1.5, 1.7]
    points[:, 3:, 0] = (0.3 * t)[:, None]
    body = body_of(points, parents)
    np.testing.assert_array_equal(body.points, [True, True, True, False, False])
    np.testing.assert_array_equal(body.loose, [False, False, False, True, False])
    np.testing.assert_array_equal(body.drawn(parents), [False, True, True, True, True])


def test_where_nothing_holds_together_all_is_the_figure():
    rng = np.random.default_rng(0)
    parents = [-1, 0, 0, 1, 2]
    body = body_of(rng.standard_normal((20, 5, 3)), parents)
    assert body.points.all()
    assert body.first == 0
    one = body_of(rng.standard_normal((1, 5, 3)), parents)
    assert one.points.all()
    assert not one.loose.any()
    assert body_of(np.full((3, 5, 3), np.nan), parents).points.all()
    assert body_of(np.zeros((3, 1, 3)), [-1]).first == 0


def test_few_poses_are_looked_at():
    points = np.zeros((1000, 2, 3))
    points[::2] = np.nan
    assert 32 <= len(some_poses(points)) <= 64


def test_strips_and_paths_follow_the_body():
    walk, motion = standing_root()
    frames, view = np.array([0, 30, 60]), np.array([[0.0, 0, 1], [0, 1, 0]])
    bones, plain = (_bones(clip, frames, view) for clip in (motion, walk))
    np.testing.assert_allclose(bones[:, 1:], plain, atol=1e-6)
    np.testing.assert_array_equal(bones[:, 0, 0], bones[:, 0, 1])
    [axes] = jm.viz.plot_trajectories(motion).axes
    [same] = jm.viz.plot_trajectories(walk).axes
    np.testing.assert_allclose(axes.lines[0].get_xydata(), same.lines[0].get_xydata(), atol=1e-6)
    assert len(axes.collections) == len(same.collections) == 1
