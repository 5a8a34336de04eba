"""Alignment of motions against warps that are known, and dense sums."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import quaternion
from jaxmotion.timing import align, dtw
from jaxmotion.timing.align import _source_times
from tests.helpers import (
    angle_between,
    assert_same_rotation,
    no_shape_checks,
    quaternions_by,
    random_motion,
)


def waving(times, fps=30.0, dtype=np.float64, bigger=1.0, seed=0):
    """A clip whose poses differ at every time, known at any time."""
    rng = np.random.default_rng(seed)
    size, phase = rng.uniform(0.3, 0.6, (2, 3, 3)), rng.uniform(0, 6, (2, 3, 3))
    t = np.asarray(times)[:, None, None]
    turns = t * 0.4 + sum(
        bigger * a * np.sin(f * t + p) for a, f, p in zip(size, (1.3, 2.9), phase, strict=True)
    )
    skeleton = jm.Skeleton(["Hips", "Arm", "Hand"], [-1, 0, 1], np.ones((3, 3), dtype))
    root = np.stack([3 * np.ravel(t), 0 * np.ravel(t), 0 * np.ravel(t)], axis=1).astype(dtype)
    return jm.Motion.from_root(skeleton, root, quaternions_by(turns, dtype), 1 / fps)


TIMES = np.linspace(0, 4, 81)
WARPED = 4 * (np.linspace(0, 1, 101) + 0.15 * np.sin(2 * np.pi * np.linspace(0, 1, 101)) / np.pi)


@pytest.mark.parametrize("method", ["dtw", "warping"])
def test_a_known_warp_is_undone(method, dtype):
    source, reference = waving(TIMES, dtype=dtype), waving(WARPED, fps=24.0, dtype=dtype)
    found = align(source, reference, method=method)
    copy = found.motion
    assert (copy.num_frames, copy.dtype) == (101, dtype)
    assert copy.frame_time == reference.frame_time
    assert np.all(np.diff(found.source_frame) >= -1e-5)
    np.testing.assert_allclose(np.asarray(found.source_frame)[[0, -1]], [0, 80], atol=1e-4)
    np.testing.assert_allclose(found.source_frame / 20, WARPED, atol=0.03)
    off = angle_between(copy.rotations, reference.rotations)
    evenly = jm.resample(source, num_frames=101)
    assert off.max() < 0.1
    assert off.mean() < 0.2 * angle_between(evenly.rotations, reference.rotations).mean()
    np.testing.assert_allclose(copy.root_positions, reference.root_positions, atol=0.1)


def test_warping_looks_past_another_posture():
    source, reference = waving(TIMES, bigger=1.3), waving(WARPED)
    bent = quaternion.multiply(source.rotations, quaternions_by([0.8, 0, 0]))
    source = source.with_transforms(rotations=bent)
    off = {
        method: np.abs(align(source, reference, method=method).source_frame / 20 - WARPED).mean()
        for method in ("dtw", "warping")
    }
    assert off["warping"] < 0.8 * off["dtw"]


def test_the_path_is_dtw_s_without_the_root():
    rng = np.random.default_rng(1)
    source, reference = waving(TIMES[:20]), waving(WARPED[:24])
    turned = source.with_transforms(
        rotations=source.rotations.at[:, 0].set(quaternions_by(rng.standard_normal((20, 3))))
    )
    want = dtw(source.rotations[:, 1:], reference.rotations[:, 1:], metric="pose")
    for clip in (source, turned):
        found = align(clip, reference)
        path = np.asarray(found.path)[: int(found.length)]
        np.testing.assert_array_equal(path, np.asarray(want.path)[: int(want.length)])
    angles = angle_between(source.rotations[path[:, 0], 1:], reference.rotations[path[:, 1], 1:])
    np.testing.assert_allclose(found.distance, np.sqrt(np.mean(angles**2)), rtol=1e-9)


@pytest.mark.parametrize("settle", [0.0, 3.0])
def test_source_times_are_the_least_squares_problem(settle):
    source, reference = waving(TIMES[:20]), waving(WARPED[:24])
    found = align(source, reference, settle=settle)
    path = np.asarray(found.path)[: int(found.length)]
    mean = np.array([path[path[:, 1] == j, 0].mean() for j in range(24)])
    steps = np.diff(np.eye(24), axis=0)
    system = (np.eye(24) + settle**2 * steps.T @ steps)[1:-1]
    inside = np.linalg.solve(system[:, 1:-1], mean[1:-1] - 19 * system[:, -1])
    np.testing.assert_allclose(found.source_frame, [0, *inside, 19], atol=1e-9)


def test_joints_are_matched_by_name():
    source, reference = waving(TIMES[:30]), waving(TIMES[:30])
    skeleton = jm.Skeleton(["Hips", "Hand", "Tail"], [-1, 0, 0], np.ones((3, 3)))
    other = jm.Motion.from_root(
        skeleton,
        reference.root_positions,
        jnp.stack([reference.rotations[:, j] for j in (0, 2, 1)], axis=1),
        1 / 30,
    )
    found = align(source, other)
    assert float(found.distance) == 0
    np.testing.assert_allclose(found.source_frame, np.arange(30), atol=1e-9)
    unknown = jm.Motion.from_root(
        jm.Skeleton(["A", "B", "C"], [-1, 0, 1], np.ones((3, 3))),
        reference.root_positions,
        reference.rotations,
        1 / 30,
    )
    with pytest.raises(ValueError, match=r"no joint of the source \(Hips, Arm, Hand\)"):
        align(source, unknown)


SHORTEST = [(n, m, "dtw") for n, m in ((1, 1), (1, 4), (2, 3), (3, 2), (4, 1))]


@pytest.mark.parametrize(("n", "m", "method"), [*SHORTEST, (1, 4, "warping"), (3, 2, "warping")])
def test_shortest_clips(n, m, method):
    rng = np.random.default_rng(2)
    skeleton = jm.Skeleton(["only"], [-1], np.zeros((1, 3)))
    source, reference = random_motion(rng, n, skeleton), random_motion(rng, m, skeleton)
    found = align(source, reference, method=method)
    assert found.motion.num_frames == m
    assert np.all(np.isfinite(found.motion.rotations))
    assert_same_rotation(found.motion.rotations[0], source.rotations[0], 1e-9)


def test_compiled_mapped_and_differentiable():
    source, reference = waving(TIMES[:12]), waving(WARPED[:14])
    want = align(source, reference)
    both = jax.tree.map(lambda x: jnp.stack([x, x]), source)
    mapped = jax.jit(jax.vmap(lambda s: align(s, reference)))(both)
    np.testing.assert_allclose(mapped.source_frame[1], want.source_frame, atol=1e-9)
    assert_same_rotation(mapped.motion.rotations[1], want.motion.rotations, 1e-9)

    @jax.jit
    @jax.grad
    def slope(rotations):
        found = align(source.with_transforms(rotations=rotations), reference)
        return jnp.sum(found.motion.rotations**3)

    assert np.all(np.isfinite(slope(source.rotations)))
    assert np.any(slope(source.rotations) != 0)


def test_one_compilation_serves_a_bucket_of_lengths():
    counts = []
    for n, m in ((33, 25), (48, 32)):
        source, reference = waving(TIMES[:n]), waving(WARPED[:m])
        found = align(source, reference)
        assert tuple(found.path[int(found.length) - 1]) == (n - 1, m - 1)
        counts.append(_source_times._cached._cache_size())
    assert len(set(counts)) == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "best"}, "method='best'; expected 'dtw' or 'warping'"),
        ({"settle": -1.0}, "settle must be 0 or more frames, got -1.0"),
        ({"step_pattern": "slope1"}, "leave no path"),
        ({"step_pattern": "best"}, "step_pattern='best'"),
    ],
)
def test_trouble_is_named(options, message):
    with no_shape_checks(), pytest.raises(ValueError, match=message):
        align(waving(TIMES[:4]), waving(WARPED[:20]), **options)
    with pytest.raises(ValueError, match="float64, the reference float32"):
        align(waving(TIMES), waving(TIMES, dtype=np.float32))
