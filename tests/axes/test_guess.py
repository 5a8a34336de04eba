"""Which axis points up: samples turned every way, bodies that lie and crawl, real captures."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.axes import doubt_up
from jaxmotion.samples.skeletons import biped

BODY = biped()
FRAMES = 60


@pytest.mark.parametrize("name", ["walk", "jump", "quadruped_walk"])
@pytest.mark.parametrize("up", "xyz")
def test_samples_stand_along_the_axis_they_are_turned_to(name, up):
    motion = jm.samples.load(name, num_frames=90, fps=30.0).motion
    assert jm.guess_up(jm.reorient(motion, up)).axis == up


@pytest.mark.parametrize("up", "xyz")
def test_who_hardly_moves_is_guessed_right_or_not_at_all(up):
    motion = jm.samples.idle(90, fps=30.0).motion
    assert jm.guess_up(jm.reorient(motion, up)).axis in (up, None)
    assert jm.guess_up(motion).axis == "y"


def fidgeting(rng, amount):
    """Rotations f[T, J, 4] that swing about the rest pose; the trunk a fifth as much."""
    t = np.arange(FRAMES)[:, None, None] / 30
    shape = (1, BODY.num_joints, 3)
    swings = [np.sin(2 * np.pi * rng.uniform(0.1, 1, shape) * t + rng.uniform(0, 6, shape))]
    vectors = amount * sum(s * rng.standard_normal(shape) for s in swings)
    vectors[:, [BODY.index(n) for n in ("Hips", "Spine", "Spine1", "Spine2")]] *= 0.2
    return quaternions(vectors)


def quaternions(vectors):
    flat = Rotation.from_rotvec(np.reshape(vectors, (-1, 3))).as_quat(scalar_first=True)
    return flat.reshape(*np.shape(vectors)[:-1], 4)


def on_the_floor(rotations, root, path):
    """A clip of the body, y up, whose lowest joint is at height 0 in every frame."""
    q = rotations.copy()
    turn = Rotation.from_quat(root, scalar_first=True)
    own = Rotation.from_quat(q[:, 0], scalar_first=True)
    q[:, 0] = (turn * own).as_quat(scalar_first=True)
    motion = jm.Motion.from_root(BODY, path, q, 1 / 30)
    low = np.asarray(jm.metrics.world_positions(motion))[..., 1].min(axis=1)
    return jm.Motion.from_root(BODY, path - low[:, None] * [0, 1, 0], q, 1 / 30)


def headings():
    return [*(np.pi / 2 * np.arange(4)), 0.1, 2.5]


@pytest.mark.parametrize("amount", [0.0, 0.01, 0.1, 0.3])
@pytest.mark.parametrize("side", ["back", "front", "side"])
def test_who_lies_is_not_said_to_stand(side, amount):
    rng = np.random.default_rng(0)
    down = {"back": [-np.pi / 2, 0, 0], "front": [np.pi / 2, 0, 0], "side": [0, 0, np.pi / 2]}[side]
    for heading in headings():
        root = Rotation.from_rotvec([0, heading, 0]) * Rotation.from_rotvec(down)
        motion = on_the_floor(
            fidgeting(rng, amount), root.as_quat(scalar_first=True), np.zeros((FRAMES, 3))
        )
        guess = jm.guess_up(motion)
        assert guess.axis is None, (heading, guess)


@pytest.mark.parametrize("speed", [0.0, 1.0])
@pytest.mark.parametrize("low", [False, True])
def test_who_crawls_is_not_said_to_stand_along_the_way(low, speed):
    """On hands and knees, and flat on the belly."""
    rng = np.random.default_rng(1)
    for heading in headings():
        rotations = fidgeting(rng, 0.1)
        if not low:
            for side, sign in (("Left", 1), ("Right", -1)):
                bent = {"UpLeg": [-1, 0, 0], "Leg": [1, 0, 0], "Arm": [0, -sign, 0]}
                for part, axis in bent.items():
                    joint = BODY.index(side + part)
                    turn = Rotation.from_rotvec(np.pi / 2 * np.array(axis))
                    own = Rotation.from_quat(rotations[:, joint], scalar_first=True)
                    rotations[:, joint] = (turn * own).as_quat(scalar_first=True)
        yaw = Rotation.from_rotvec([0, heading, 0])
        root = yaw * Rotation.from_rotvec([np.pi / 2, 0, 0])
        path = speed * np.arange(FRAMES)[:, None] / 30 * yaw.apply([0, 0, 1])
        motion = on_the_floor(rotations, root.as_quat(scalar_first=True), path)
        assert jm.guess_up(motion).axis is None, heading


def test_who_rolls_over_the_floor_does_not_stand():
    rng = np.random.default_rng(2)
    for heading in np.pi / 2 * np.arange(4):
        yaw = Rotation.from_rotvec([0, heading, 0])
        angle = np.linspace(0, 12, FRAMES)
        roll = Rotation.from_rotvec(angle[:, None] * yaw.apply([0, 0, 1]))
        root = roll * yaw * Rotation.from_rotvec([-np.pi / 2, 0, 0])
        path = 0.15 * angle[:, None] * yaw.apply([-1, 0, 0])
        motion = on_the_floor(fidgeting(rng, 0.05), root.as_quat(scalar_first=True), path)
        assert jm.guess_up(motion).axis is None, heading


def test_upside_down_and_frozen():
    walk = jm.samples.walk(60, fps=30.0).motion
    over = Rotation.from_rotvec([np.pi, 0, 0])
    q = np.array(walk.rotations)
    q[:, 0] = (over * Rotation.from_quat(q[:, 0], scalar_first=True)).as_quat(scalar_first=True)
    p = np.array(walk.translations)
    p[:, 0] = over.apply(p[:, 0])
    assert jm.guess_up(walk.with_transforms(p, q)).axis is None
    # One pose says something only where the rest pose says the same.
    assert jm.guess_up(walk[:1]).axis == "y"
    assert jm.guess_up(jm.reorient(walk[:1], "z")).axis is None


def test_figures_without_feet_or_head_are_not_guessed():
    walk = jm.samples.walk(60, fps=30.0).motion
    for gone, reason in (("Foot", "no feet"), ("Head", "no head")):
        names = [n.replace(gone, f"part{j}") for j, n in enumerate(walk.skeleton.names)]
        other = replace(walk, skeleton=replace(walk.skeleton, names=tuple(names)))
        assert jm.guess_up(other).axis is None
        assert reason in jm.guess_up(other).reason
    one_foot = jm.Skeleton(["Head", "Foot"], [-1, 0], np.ones((2, 3)))
    q = np.tile([1.0, 0, 0, 0], (3, 2, 1))
    guess = jm.guess_up(jm.Motion.from_root(one_foot, np.zeros((3, 3)), q, 1.0))
    assert guess == (None, "no hips above two feet")


def test_doubts():
    walk = jm.samples.walk(60, fps=30.0).motion
    assert doubt_up(walk) == ""
    lying = replace(walk, skeleton=replace(walk.skeleton, up="z"))
    assert doubt_up(lying).startswith("z points up, but it stands along y")
    [problem] = [p for p in jm.metrics.find_problems(lying) if p.kind == "up"]
    assert problem.serious
    assert problem.message == doubt_up(lying)
    assert not [p for p in jm.metrics.find_problems(walk) if p.kind == "up"]


def test_traced_motions_and_batches_are_refused():
    walk = jm.samples.walk(8, fps=30.0).motion
    with pytest.raises(ValueError, match="guess outside of jit"):
        jax.jit(lambda m: jm.guess_up(m).axis)(walk)
    with pytest.raises(ValueError, match=r"guess_up: one clip at a time, got .*one by one"):
        jm.guess_up(jax.tree.map(lambda x: x[None], walk))


# Z up, whatever the folder's other files are: their offsets and trajectories say so.
Z_UP = {"bvh_test1.bvh", "bvh_test3.bvh", "standard_skeleton.bvh"}
LEGLESS = {"full_precision_frame_time.bvh", "rotation_first_root.bvh"}
# A pose that is held, or nearly: of a turned world it tells nothing, and nothing wrong.
FROZEN = {"bvh_test2.bvh", "bvh_test3.bvh", "standard_skeleton.bvh"}


@pytest.mark.parametrize("folder", ["bandai", "cmu", "cmu_dance", "quirks", "xia"])
@pytest.mark.filterwarnings("ignore::jaxmotion.io.MotionFileWarning")
def test_real_captures_turned_every_way(data_dir, folder):
    files = [p for p in sorted((data_dir / folder).iterdir()) if p.suffix in (".bvh", ".amc")]
    for path in files[:: 8 if folder == "bandai" else 1]:
        motion = jm.load(path)
        frames = np.linspace(0, motion.num_frames - 1, 64).round().astype(int)
        motion = motion.with_transforms(
            np.asarray(motion.translations)[frames], np.asarray(motion.rotations)[frames]
        )
        truth = "z" if path.name in Z_UP else "y"
        motion = replace(motion, skeleton=replace(motion.skeleton, up=truth))
        for up in "xyz":
            guess = jm.guess_up(jm.reorient(motion, up)).axis
            if path.name in LEGLESS:
                assert guess is None, path.name
            else:
                held = path.name in FROZEN
                assert guess == up or (held and guess is None), (path.name, up, guess)
