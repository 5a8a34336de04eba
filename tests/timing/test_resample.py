"""Other frame rates and sparse keys, against SciPy, dense solves and motions known in between."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.spatial.transform import Rotation, Slerp

import jaxmotion as jm
from jaxmotion import resample
from jaxmotion.timing import resample as resample_of_the_room
from jaxmotion.timing.resample import _curve, _read
from tests.helpers import (
    angle_between,
    assert_same_rotation,
    check_gradients,
    no_shape_checks,
    quaternions_by,
    random_motion,
    random_skeleton,
    scipy_rotation,
)

AXIS = np.array([0.0, 0.6, 0.8])


def smooth_motion_at(times, fps, dtype=np.float64, joints=4):
    """A clip known at every time: joints swing by waves of up to 1.5 Hz, the root glides."""
    rng = np.random.default_rng(0)
    skeleton = random_skeleton(rng, joints, dtype=dtype)
    size, phase = rng.uniform(0.2, 0.5, (2, joints, 3)), rng.uniform(0, 6, (2, joints, 3))
    t = np.asarray(times)[:, None, None]
    turns = sum(
        a * np.sin(2 * np.pi * f * t + p) for a, f, p in zip(size, (0.5, 1.5), phase, strict=True)
    )
    root = np.concatenate([np.sin(t[:, 0]), 1 + 0 * t[:, 0], 2 * t[:, 0]], axis=1)
    rotations = quaternions_by(turns, dtype)
    return jm.Motion.from_root(skeleton, root.astype(dtype), rotations, 1 / fps)


def clip(frames, fps, **options):
    return smooth_motion_at(np.arange(frames) / fps, fps, **options)


def keys_of_a_turn(gap, steps=(60, 60), seed=0):
    """One joint turning about AXIS, steps before and after a gap (degrees); signs at random."""
    angles = np.radians(np.cumsum([0, *steps, gap, *steps]))
    q = quaternions_by(angles[:, None, None] * AXIS)
    q = q * np.random.default_rng(seed).choice([-1.0, 1.0], (len(angles), 1, 1))
    skeleton = jm.Skeleton(["joint"], [-1], np.zeros((1, 3)))
    return jm.Motion.from_root(skeleton, np.zeros((len(angles), 3)), q, 1 / 24)


def turned(motion):
    """Degrees turned about AXIS since the first frame, continuously."""
    about = scipy_rotation(motion.rotations).as_rotvec() @ AXIS
    return np.degrees(np.unwrap(about))


def aligned(q):
    q = np.array(q, np.float64)
    for i in range(1, len(q)):
        q[i] *= np.where(np.sum(q[i] * q[i - 1], -1, keepdims=True) < 0, -1, 1)
    return q


def unit(x):
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


@pytest.mark.parametrize(("before", "after"), [(24, 30), (30, 24), (60, 24000 / 1001), (24, 120)])
def test_methods_are_scipy_s(before, after, dtype):
    motion = clip(40, before, dtype=dtype)
    t = np.arange(40) / before
    at = np.arange(int(np.floor(39 / before * after + 1e-9)) + 1) / after
    y, p = aligned(motion.rotations), np.asarray(motion.root_positions, np.float64)
    natural = CubicSpline(t, y, bc_type="natural")
    hermite = CubicHermiteSpline(t, y, np.gradient(y, t, axis=0))
    slerp = [Slerp(t, Rotation.from_quat(y[:, j], scalar_first=True)) for j in range(4)]
    want = {
        "lgs": (unit(natural(at)), CubicSpline(t, p, bc_type="natural")(at)),
        "cubic": (unit(hermite(at)), CubicHermiteSpline(t, p, np.gradient(p, t, axis=0))(at)),
        "slerp": (
            np.stack([s(at).as_quat(scalar_first=True) for s in slerp], axis=1),
            np.stack([np.interp(at, t, p[:, k]) for k in range(3)], axis=1),
        ),
    }
    atol = 1e-11 if dtype == np.float64 else 1e-5
    for method, (rotations, positions) in want.items():
        got = resample(motion, fps=after, method=method)
        assert (got.dtype, got.num_frames) == (dtype, len(at))
        assert got.fps == pytest.approx(after, rel=1e-6)
        assert_same_rotation(got.rotations, rotations, atol)
        np.testing.assert_allclose(got.root_positions, positions, atol=atol)
        offsets = np.broadcast_to(motion.translations[0, 1:], got.translations[:, 1:].shape)
        np.testing.assert_array_equal(got.translations[:, 1:], offsets)


def test_smoothing_is_the_least_squares_problem_of_the_room():
    """Minimiser over 10 values a frame with ∫x″² as a sum, by a dense solve."""
    motion = clip(9, 30)
    product, fine = 1.3, 10
    n = 8 * fine + 1
    bend = (np.eye(n)[:-2] - 2 * np.eye(n)[1:-1] + np.eye(n)[2:]) * fine**1.5
    data = np.eye(n)[::fine]
    system = data.T @ data + (product / 2) ** 2 * bend.T @ bend
    y = aligned(motion.rotations).reshape(9, -1)
    want = np.linalg.solve(system, data.T @ y)[:: fine // 2].reshape(-1, 4, 4)
    got = resample(motion, num_frames=17, smoothing=product)
    assert_same_rotation(got.rotations, unit(want), 2e-3)
    assert angle_between(got.rotations[::2], motion.rotations).max() > 0.01
    gains = np.array([0.0, 0.4, 1.3, 5.0])
    each = resample(motion, num_frames=17, smoothing=gains)
    for j, gain in enumerate(gains):
        alone = resample(motion, num_frames=17, smoothing=gain)
        assert_same_rotation(each.rotations[:, j], alone.rotations[:, j])
        if j == 0:
            np.testing.assert_allclose(each.root_positions, alone.root_positions, atol=1e-12)


@pytest.mark.parametrize("fps", [24, 24000 / 1001, 60, 120])
def test_what_was_between_the_frames_is_found(fps):
    """Far closer to the truth than SLERP, away from the ends, and back again."""
    motion = clip(90, 30)
    off = {}
    for method in ("lgs", "cubic", "slerp"):
        new = resample(motion, fps=fps, method=method)
        truth = smooth_motion_at(np.asarray(new.times), fps)
        inside = slice(round(fps / 3), -round(fps / 3))
        off[method] = angle_between(new.rotations[inside], truth.rotations[inside]).max()
    assert off["lgs"] < 3e-4
    assert off["lgs"] < 0.2 * off["cubic"] < 0.2 * off["slerp"]
    if fps > 30:
        again = resample(resample(motion, fps=fps), fps=30)
        assert_same_rotation(again.rotations, motion.rotations[: len(again)], 1e-9)


def test_the_same_rate_changes_nothing():
    motion = random_motion(np.random.default_rng(1), 12)
    for same in (resample(motion, num_frames=12), resample(motion, fps=30)):
        assert_same_rotation(same.rotations, motion.rotations, 1e-14)
        np.testing.assert_array_equal(same.translations, motion.translations)


def test_how_many_frames():
    motion = clip(31, 30)
    assert resample(motion, fps=24).num_frames == 25  # 1 s and both ends
    assert resample(motion, fps=23).num_frames == 24
    assert resample(motion, fps=23.5).num_frames == 24  # 1/47 s left over
    rounded = jm.Motion(motion.skeleton, motion.translations, motion.rotations, 0.0333333)
    assert resample(rounded, fps=60).num_frames == 61
    assert resample(motion, fps=29.7).num_frames == 30  # 0.3 of a frame missing, for no reason
    long = resample(motion, num_frames=100)
    assert float(long.times[-1]) == pytest.approx(1.0)
    assert_same_rotation(long.rotations[::99], motion.rotations[::30])
    assert resample(motion, num_frames=1).num_frames == 1


@pytest.mark.parametrize(
    ("frame_time", "frames", "fps", "wanted"),
    [
        (0.033333, 7840, 30, 7840),  # 1/30: the text makes the clip 0.08 of a frame short
        (0.033333, 7840, 60, 15679),
        (0.0333, 101, 30, 101),
        (0.008333, 5000, 120, 5000),
        (0.041708, 7000, 24000 / 1001, 7000),
        (0.033333, 80_000, 30, 79_999),  # 0.8 of a frame: the last pose is nearer to the next
        (0.01, 103, 30, 31),  # exact, 30.6 frames
        (0.03, 103, 30, 92),  # of so few digits that it may be anything
        (0.0417, 101, 24, 101),  # longer than 1/24
        (1 / 30, 7840, 30, 7840),
    ],
)
def test_a_rounded_frame_time_does_not_cost_the_last_pose(frame_time, frames, fps, wanted, dtype):
    skeleton = jm.Skeleton(["root"], [-1], np.zeros((1, 3), dtype))
    steps = np.arange(frames, dtype=dtype)[:, None, None] * np.ones(3, dtype)
    turns = np.tile(np.asarray([1, 0, 0, 0], dtype), (frames, 1, 1))
    motion = jm.Motion(skeleton, steps, turns, np.asarray(frame_time, dtype))
    result = resample(motion, fps=fps, method="slerp")
    assert result.num_frames == wanted
    last = (wanted - 1) / (fps * frame_time)
    assert abs(last - (frames - 1)) <= 1 / (fps * frame_time)
    np.testing.assert_allclose(result.root_positions[-1], last, rtol=1e-6)


@pytest.mark.parametrize(("keys", "frames", "fps"), [(8, 40, 80), (34, 680, 400)])
def test_sparse_keys(keys, frames, fps):
    """Table 1's airplane and ballet in size: whole frames, passed exactly, near the truth."""
    truth = clip(frames, fps)
    index = np.round(np.linspace(0, frames - 1, keys)).astype(int)
    poses = truth.with_transforms(truth.translations[index], truth.rotations[index])
    got = resample(poses, index=index)
    assert got.num_frames == frames
    assert got.frame_time == poses.frame_time
    assert_same_rotation(got.rotations[index], poses.rotations, 1e-12)
    off = angle_between(got.rotations, truth.rotations).max()
    slerp = resample(poses, index=index, method="slerp")
    assert off < 0.5 * angle_between(slerp.rotations, truth.rotations).max()
    uneven = CubicSpline(index, aligned(poses.rotations), bc_type="natural")(np.arange(frames))
    assert_same_rotation(got.rotations, unit(uneven), 1e-11)


def test_index_may_be_fractional_traced_and_leave_ends():
    poses = clip(5, 24)
    index = np.array([1.5, 3.0, 4.25, 8.0, 9.0])
    got = resample(poses, index=index, num_frames=12, fps=12)
    spline = CubicSpline(index, aligned(poses.rotations), bc_type="natural")
    assert_same_rotation(got.rotations[2:10], unit(spline(np.arange(2.0, 10))), 1e-12)
    start, slope = spline(1.5), spline(1.5, 1)
    assert_same_rotation(got.rotations[0], unit(start - 1.5 * slope), 1e-12)
    assert got.fps == pytest.approx(12)
    traced = jax.jit(lambda i: resample(poses, index=i, num_frames=12).rotations)(index)
    assert_same_rotation(traced, got.rotations, 1e-12)
    with pytest.raises(Exception, match="increase strictly"):
        resample(poses, index=jnp.asarray(index[::-1]), num_frames=12)


@pytest.mark.parametrize("gap", [180.5, 200, 220])
def test_a_turn_past_half_a_circle(gap):
    """Fig. 8: SLERP and nearest signs flip to the other way round, the least energy does not."""
    keys = keys_of_a_turn(gap)
    index = 8 * np.arange(6)
    ours = turned(resample(keys, index=index))
    np.testing.assert_allclose(ours[index], np.cumsum([0, 60, 60, gap, 60, 60]), atol=1e-9)
    assert np.all(np.diff(ours) > 0)
    for options in (
        {"method": "slerp"},
        {"signs": "nearest"},
        {"method": "cubic", "signs": "nearest"},
    ):
        flipped = turned(resample(keys, index=index, **options))
        assert flipped[24] - flipped[16] == pytest.approx(gap - 360)
    also = turned(resample(keys, index=index, method="cubic"))
    assert also[24] - also[16] == pytest.approx(gap)


def test_signs_input_trusts_the_file():
    keys = keys_of_a_turn(250)
    half = np.radians(np.cumsum([0, 60, 60, 250, 60, 60]))[:, None, None] / 2
    continuous = np.concatenate([np.cos(half), np.sin(half) * AXIS], axis=-1)
    keys = keys.with_transforms(rotations=continuous)
    ours = turned(resample(keys, index=8 * np.arange(6), signs="input"))
    assert ours[24] - ours[16] == pytest.approx(250)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_shortest_clips(frames, dtype):
    motion = random_motion(np.random.default_rng(frames), frames, 3, dtype)
    for method in ("lgs", "cubic", "slerp"):
        got = resample(motion, num_frames=4, method=method)
        np.testing.assert_allclose(np.linalg.norm(got.rotations, axis=-1), 1, atol=1e-6)
        assert np.all(np.isfinite(got.translations))
        if frames > 1:
            ends = motion.rotations[:: frames - 1]
            assert_same_rotation(got.rotations[::3], ends, 2e-6)
        else:
            assert_same_rotation(got.rotations, np.repeat(motion.rotations, 4, axis=0), 2e-6)
            assert got.frame_time == motion.frame_time
        assert resample(motion, fps=90, method=method).num_frames == 3 * (frames - 1) + 1


def test_derivatives():
    motion = clip(6, 24, joints=2)
    index = jnp.array([0.0, 1.2, 2.9, 4.1, 5.3, 7.6])

    def frames(rotations, translations, index, smoothing):
        given = motion.with_transforms(translations, rotations)
        got = resample(given, index=index, num_frames=9, smoothing=smoothing)
        return got.rotations, got.translations

    check_gradients(frames, motion.rotations, motion.translations, index, jnp.asarray(0.4))
    for method in ("cubic", "slerp"):
        check_gradients(
            lambda q, m=method: (
                resample(motion.with_transforms(rotations=q), num_frames=9, method=m).rotations
            ),
            motion.rotations,
        )


@pytest.mark.parametrize("method", ["lgs", "cubic", "slerp"])
def test_derivatives_far_from_the_origin(method):
    """A million away float32 knows positions to 1/16; how they change with time is as near."""
    near = clip(9, 24, dtype=np.float32, joints=1)
    steps = np.round(np.asarray(near.translations) * 16) / 16  # exact far away too
    near = near.with_transforms(translations=steps.astype(np.float32))
    index = jnp.array([0, 1.2, 2.9, 4.1, 5.3, 7.6, 8.2, 9.9, 11.1], jnp.float32)

    def slopes(motion):
        def read(index):
            return resample(motion, index=index, num_frames=12, method=method).translations

        return jax.jvp(read, (index,), (jnp.linspace(-1, 1, 9, dtype=jnp.float32),))[1]

    far = near.with_transforms(translations=near.translations + np.float32(1e6))
    np.testing.assert_allclose(slopes(far), slopes(near), atol=1e-6)


def test_compiled_and_mapped():
    motions = [random_motion(np.random.default_rng(s), 7, 3) for s in (0, 0)]
    other = motions[1].with_transforms(rotations=motions[1].rotations[::-1])
    both = jax.tree.map(lambda a, b: jnp.stack([a, b]), motions[0], other)
    mapped = jax.jit(jax.vmap(lambda m: resample(m, num_frames=11)))(both)
    for i, motion in enumerate((motions[0], other)):
        want = resample(motion, num_frames=11)
        assert_same_rotation(mapped.rotations[i], want.rotations)
        np.testing.assert_allclose(mapped.translations[i], want.translations, atol=1e-12)
        np.testing.assert_allclose(mapped.frame_time[i], want.frame_time)
    with no_shape_checks(), pytest.raises(ValueError, match="one clip"):
        resample(both, num_frames=11)


def test_what_is_known_is_not_checked_again_when_it_runs():
    """A check at run time calls the host; that of the solver is the only one."""
    motion = clip(40, 30)
    program = jax.jit(lambda m: resample(m, num_frames=30).rotations).lower(motion).as_text()
    assert program.count("call @branched_error_if_impl") == 1


def test_one_compilation_serves_a_bucket_of_lengths():
    """Clips of 33 to 48 frames, to rates that give 25 to 48 frames."""
    counts = []
    for frames, fps in ((33, 24), (40, 24), (48, 24), (37, 25)):
        motion = clip(frames, 30)
        got = resample(motion, fps=fps)
        t = np.arange(frames) / 30
        spline = CubicSpline(t, aligned(motion.rotations), bc_type="natural")
        assert_same_rotation(got.rotations, unit(spline(np.asarray(got.times))), 1e-11)
        counts.append((_curve._cached._cache_size(), _read._cached._cache_size()))
    assert counts[0] == counts[1]
    assert counts[2] == counts[3]
    assert np.ptp([c[0] for c in counts]) == 0


def test_the_motion_is_untouched_and_the_spelling_of_a_kept_rate_stays(tmp_path: Path):
    motion = clip(10, 30)
    jm.save(motion, tmp_path / "x.bvh")
    motion = jm.load(tmp_path / "x.bvh")
    before = jax.tree.map(np.array, motion)
    spread = resample(motion, index=2 * np.arange(10))
    assert spread.frame_time_text == motion.frame_time_text is not None
    assert resample(motion, fps=60).frame_time_text is None
    assert spread.translated_joints == motion.translated_joints
    assert resample_of_the_room is resample
    for a, b in zip(jax.tree.leaves(before), jax.tree.leaves(motion), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "expected one of them, or an index"),
        ({"fps": 24, "num_frames": 5}, "expected one of them"),
        ({"fps": 0}, "fps=0; expected a rate above 0"),
        ({"num_frames": 0}, "num_frames=0; expected at least 1"),
        ({"fps": 24, "method": "best"}, "method='best'; expected 'lgs'"),
        ({"fps": 24, "signs": "any"}, "signs='any'; expected 'nearest'"),
        ({"fps": 24, "smoothing": -1.0}, "smoothing must be λσ of 0 or more, got -1"),
        ({"fps": 24, "smoothing": np.ones(3)}, r"smoothing has shape \(3,\)"),
        ({"index": [0, 1, 2]}, r"index has shape \(3,\); expected \(5,\)"),
        ({"index": [0, 1, 1, 2, 3]}, "increase strictly"),
    ],
)
def test_trouble_is_named(options, message):
    motion = clip(5, 30)
    with no_shape_checks(), pytest.raises(ValueError, match=message):
        resample(motion, **options)


def test_a_traced_index_cannot_tell_the_number_of_frames():
    motion = clip(5, 24)
    with pytest.raises(ValueError, match="num_frames is needed when index is traced"):
        jax.jit(lambda i: resample(motion, index=i).rotations)(jnp.arange(5.0))


def test_a_traced_frame_time_cannot_tell_the_number_of_frames():
    motion = clip(5, 30)
    with pytest.raises(ValueError, match="give num_frames"):
        jax.jit(lambda m: resample(m, fps=24).rotations)(motion)
