"""Every clip: planted feet, the floor, rigid bones, smoothness, precision, bad arguments."""

import warnings

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import samples
from tests.helpers import single_precision, world_by_matrices

LEG = 0.92
# Peak angular speed (rad/s) and acceleration (rad/s²) over all joints, with a margin.
LIMITS = {
    "walk": (9.0, 350.0),
    "run": (16.0, 1100.0),
    "idle": (1.5, 6.0),
    "kick": (18.0, 300.0),
    "jump": (14.0, 200.0),
    "dance": (10.0, 160.0),
    "quadruped_walk": (20.0, 1700.0),
    "quadruped_trot": (20.0, 1300.0),
}
CLIPS = tuple(LIMITS)


@pytest.fixture(scope="module")
def clips():
    return {name: samples.load(name) for name in CLIPS}


def contact_points(sample):
    """World positions f[T, K, 3] of the contact points, by the oracle."""
    positions, rotations, _ = world_by_matrices(sample.motion)
    joints = list(sample.contact_joints)
    offsets = np.asarray(sample.contact_offsets, np.float64)
    return positions[:, joints] + np.einsum("tkab,kb->tka", rotations[:, joints], offsets)


def angular_velocity(motion):
    """f[T−1, J, 3] rad/s, in each joint's own frame, by numpy alone."""
    a, b = (np.asarray(motion.rotations)[s] for s in (slice(None, -1), slice(1, None)))
    w = np.sum(a * b, axis=-1)
    u = a[..., :1] * b[..., 1:] - b[..., :1] * a[..., 1:] - np.cross(a[..., 1:], b[..., 1:])
    norm = np.linalg.norm(u, axis=-1, keepdims=True)
    angle = 2 * np.arctan2(norm, w[..., None])
    return u * np.where(norm > 0, angle / np.where(norm > 0, norm, 1), 2) * float(motion.fps)


def test_names_are_all_the_clips():
    assert set(samples.names()) == set(CLIPS)
    with pytest.raises(ValueError, match=r"moonwalk.*'walk', 'run'"):
        samples.load("moonwalk")


@pytest.mark.parametrize("name", CLIPS)
def test_planted_points_do_not_move(clips, name):
    sample = clips[name]
    points, contacts = contact_points(sample), np.asarray(sample.contacts)
    np.testing.assert_allclose(sample.contact_positions, points, rtol=0, atol=1e-12)
    held = contacts[1:] & contacts[:-1]
    assert held.any(axis=0).all()
    step = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    assert step[held].max() <= 1e-9 * LEG
    # Over a whole plant too, not only from frame to frame.
    for k in range(contacts.shape[1]):
        edges = np.flatnonzero(np.diff(np.r_[False, contacts[:, k], False]))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            assert np.ptp(points[start:stop, k], axis=0).max() <= 1e-9 * LEG


@pytest.mark.parametrize("name", CLIPS)
def test_on_the_floor_in_contact_and_above_it_otherwise(clips, name):
    sample = clips[name]
    height, contacts = contact_points(sample)[..., 1], np.asarray(sample.contacts)
    assert np.abs(height[contacts] - float(sample.floor)).max() <= 1e-9 * LEG
    assert height.min() >= float(sample.floor) - 1e-9 * LEG
    clear = np.asarray(sample.clear())
    assert np.all(clear[contacts])
    np.testing.assert_array_equal(clear, contacts | (height >= float(sample.floor) + 0.01))
    # Few frames are in doubt, and every swing gets well away.
    assert clear.mean() > 0.88
    for k in range(contacts.shape[1]):
        change = np.diff(contacts[:, k].astype(int))
        for lift in np.flatnonzero(change == -1):
            lands = np.flatnonzero(change[lift:] == 1)
            if len(lands):
                assert height[lift : lift + lands[0] + 1, k].max() > 0.04


@pytest.mark.parametrize("name", CLIPS)
def test_unit_quaternions_rigid_bones_and_smoothness(clips, name):
    motion = clips[name].motion
    q = np.asarray(motion.rotations)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1, atol=1e-14)
    assert np.sum(q[1:] * q[:-1], axis=-1).min() > 0
    offsets = np.asarray(motion.skeleton.offsets)
    expected = np.broadcast_to(offsets[1:], (motion.num_frames, *offsets[1:].shape))
    np.testing.assert_array_equal(motion.translations[:, 1:], expected)
    assert motion.translated_joints == (0,)
    velocity = angular_velocity(motion)
    fps = float(motion.fps)
    speed, acceleration = LIMITS[name]
    assert np.linalg.norm(velocity, axis=-1).max() < speed
    assert np.linalg.norm(np.diff(velocity, axis=0), axis=-1).max() * fps < acceleration
    root = np.asarray(motion.root_positions)
    assert np.linalg.norm(np.diff(root, 2, axis=0), axis=-1).max() * fps**2 < 45


@pytest.mark.parametrize("name", ["walk", "quadruped_trot"])
def test_accelerations_stay_bounded_as_the_rate_rises(name):
    """A kink in position would double its finite-difference acceleration at twice the rate."""
    peaks = []
    for fps in (120, 480):
        motion = samples.load(name, num_frames=fps, fps=fps).motion
        velocity = angular_velocity(motion)
        peaks.append(np.linalg.norm(np.diff(velocity, axis=0), axis=-1).max() * fps)
    assert peaks[1] < 1.6 * peaks[0]


@pytest.mark.parametrize("name", ["walk", "kick", "jump", "dance"])
def test_the_pelvis_path_is_twice_differentiable(name):
    """A step in acceleration would multiply the peak third difference quotient by four."""
    jerks = []
    for fps in (120, 480):
        root = np.asarray(samples.load(name, num_frames=3 * fps, fps=fps).motion.root_positions)
        jerks.append(np.abs(np.diff(root, 3, axis=0)).max() * fps**3)
    assert jerks[1] < 1.3 * jerks[0]


def test_a_kick_turns_hip_and_knee_fast_and_far(clips):
    motion = clips["kick"].motion
    for joint in ("RightUpLeg", "RightLeg"):
        q = np.asarray(motion.rotations)[:, motion.skeleton.index(joint)]
        between = 2 * np.arccos(np.clip(np.abs(q @ q.T), 0, 1))
        within = [np.diagonal(between, lag).max() for lag in range(20)]
        assert max(within) > np.pi / 2  # within a third of a second


def test_gaits_go_where_they_are_told(clips):
    walk = clips["walk"].motion
    root = np.asarray(walk.root_positions)
    assert root[-1, 2] - root[0, 2] == pytest.approx(1.25 * 239 / 60, abs=0.03)
    # One stride from strike to strike, to the scatter of the steps.
    heel = np.asarray(clips["walk"].contacts)[:, 0]
    strikes = np.flatnonzero(heel[1:] & ~heel[:-1]) + 1
    places = np.asarray(clips["walk"].contact_positions)[strikes, 0, 2]
    np.testing.assert_allclose(np.diff(places), 1.3, atol=0.02)
    np.testing.assert_allclose(np.diff(strikes) / 60, 1.3 / 1.25, atol=1.1 / 60)
    turned = samples.walk(120, turning=np.pi / 4).motion
    *_, end = np.asarray(turned.root_positions)
    radius = 1.25 / (np.pi / 4)
    angle = np.pi / 4 * 119 / 60
    expected = radius * np.array([1 - np.cos(angle), np.sin(angle)])
    np.testing.assert_allclose(end[[0, 2]], expected, atol=0.04)


def test_arms_swing_against_the_legs(clips):
    motion = clips["walk"].motion
    positions = world_by_matrices(motion)[0]

    def ahead(joint):
        return positions[:, motion.skeleton.index(joint), 2] - positions[:, 0, 2]

    for hand, foot in (("LeftHand", "LeftFoot"), ("RightHand", "RightFoot")):
        assert np.corrcoef(ahead(hand), ahead(foot))[0, 1] < -0.7


def test_a_run_has_flight_and_a_walk_has_none(clips):
    touching = {n: np.asarray(clips[n].contacts).any(axis=1) for n in ("walk", "run", "jump")}
    assert touching["walk"].all()
    assert 0.1 < 1 - touching["run"].mean() < 0.5
    assert not touching["jump"].all()
    assert np.asarray(clips["idle"].contacts).all()


@pytest.mark.parametrize("name", CLIPS)
def test_same_seed_same_clip_other_seed_another(clips, name):
    again = samples.load(name)
    jax.tree.map(np.testing.assert_array_equal, again, clips[name])
    other = samples.load(name, seed=1)
    assert np.abs(np.asarray(other.motion.rotations - again.motion.rotations)).max() > 1e-4


@pytest.mark.parametrize("name", CLIPS)
def test_single_precision_is_the_rounded_double(clips, name):
    single = samples.load(name, dtype=np.float32)
    assert {leaf.dtype for leaf in jax.tree.leaves(single)} == {
        np.dtype(np.float32),
        np.dtype(bool),
    }
    double = clips[name].motion
    np.testing.assert_allclose(single.motion.rotations, double.rotations, atol=1e-6)
    points = contact_points(single)
    np.testing.assert_allclose(points, clips[name].contact_positions, atol=1e-5)
    np.testing.assert_array_equal(single.contacts, clips[name].contacts)


@pytest.mark.parametrize("frames", [1, 2, 3])
@pytest.mark.parametrize("name", CLIPS)
def test_short_clips(name, frames):
    sample = samples.load(name, num_frames=frames)
    assert sample.motion.num_frames == frames
    assert sample.contacts.shape == (frames, len(sample.contact_names))
    assert np.isfinite(np.asarray(sample.motion.rotations)).all()
    np.testing.assert_allclose(contact_points(sample), sample.contact_positions, atol=1e-12)


@pytest.mark.parametrize("name", CLIPS)
def test_a_longer_clip_begins_with_the_shorter_one(clips, name):
    """Contacts and the trunk do; legs only up to the constant height of the pelvis."""
    long, short = clips[name], samples.load(name, num_frames=50)
    np.testing.assert_array_equal(short.contacts, long.contacts[:50])
    held = np.asarray(short.contacts)
    np.testing.assert_allclose(
        np.asarray(short.contact_positions)[held],
        np.asarray(long.contact_positions)[:50][held],
        atol=1e-12,
    )
    for joint in ("Hips", "Spine1", "Head"):
        j = short.motion.skeleton.index(joint)
        np.testing.assert_allclose(
            short.motion.rotations[:, j], long.motion.rotations[:50, j], atol=1e-12
        )


def test_without_double_precision_clips_are_single():
    with single_precision():
        sample = samples.walk(20)
        assert sample.motion.dtype == np.float32
        with pytest.raises(ValueError, match="jax_enable_x64"):
            samples.walk(20, dtype=np.float64)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("walk", {"num_frames": 0}, "num_frames=0"),
        ("idle", {"num_frames": -3}, "num_frames=-3"),
        ("walk", {"fps": 0.0}, "fps=0"),
        ("kick", {"fps": float("nan")}, "fps=nan"),
        ("walk", {"speed": -1.0}, "speed=-1"),
        ("run", {"stride": 0}, "stride=0"),
        ("walk", {"stride": 4.0}, "shorter stride"),
        ("quadruped_walk", {"stride": 2.5}, "shorter stride"),
        ("walk", {"turning": float("inf")}, "turning=inf"),
        ("idle", {"seed": -1}, "seed=-1"),
        ("kick", {"height": 3.0}, "height=3"),
        ("jump", {"height": 2.0}, "height=2"),
        ("jump", {"distance": 3.0}, "distance=3"),
        ("dance", {"tempo": 0.0}, "tempo=0"),
        ("walk", {"dtype": np.float16}, "float32 or float64"),
    ],
)
def test_bad_arguments(name, options, message):
    with pytest.raises(ValueError, match=message):
        samples.load(name, **options)


def test_clean_and_noisy():
    sample, noisy = samples.clean_and_noisy("kick", num_frames=200, rotation=0.05, translation=0.01)
    clean = sample.motion
    assert noisy.mask.all()
    shift = np.asarray(noisy.motion.root_positions - clean.root_positions)
    assert shift.std() == pytest.approx(0.01, rel=0.1)
    again = samples.clean_and_noisy("kick", num_frames=200, rotation=0.05, translation=0.01)[1]
    jax.tree.map(np.testing.assert_array_equal, again, noisy)


@pytest.mark.parametrize("name", CLIPS)
def test_errors_name_the_clip_that_was_called(name):
    bad = ({"num_frames": 0}, {"fps": 0.0}, {"seed": -1}, {"dtype": np.float16})
    if name in ("walk", "run", "quadruped_walk", "quadruped_trot"):
        bad += ({"turning": np.inf}, {"stride": 9.0})
    for options in bad:
        with pytest.raises(ValueError, match=f"^{name}: "):
            getattr(samples, name)(**options)


def test_errors_name_the_skeleton_and_the_pair_that_were_called():
    for make in (samples.biped, samples.quadruped):
        with pytest.raises(ValueError, match=f"^{make.__name__}: dtype="):
            make(np.float16)
    for options in ({"name": "moonwalk"}, {"rotation": -1.0}):
        with pytest.raises(ValueError, match=r"^clean_and_noisy: "):
            samples.clean_and_noisy(num_frames=9, **options)


def test_single_precision_is_no_matter_of_warnings(tmp_path):
    with single_precision(), warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in jm.samples.names():
            motion = jm.samples.load(name, num_frames=8).motion
            assert motion.dtype == motion.skeleton.offsets.dtype == np.float32
        for suffix in (".bvh", ".npz", ".amc"):
            jm.save(motion, tmp_path / f"clip{suffix}")
            assert jm.load(tmp_path / f"clip{suffix}").dtype == np.float32
