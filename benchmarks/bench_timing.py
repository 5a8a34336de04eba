"""Dynamic time warping and its relatives against dtaidistance, tslearn and librosa.

All peers report the root of summed squared distances or the sum of distances; ours is asked for the
same, and the values are compared. dtaidistance gives a distance only, as its path takes seconds.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.timing import dtw, motion_warping, pose_distance, soft_dtw

FRAMES, FEATURES = 1000, 96


def clip(seed, frames=FRAMES, features=FEATURES, dtype="float64"):
    rng = np.random.default_rng(seed)
    return (0.1 * np.cumsum(rng.standard_normal((frames, features)), axis=0)).astype(dtype)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_one_pair(race, dtype):
    """Distance and path of one pair of long clips."""
    librosa = pytest.importorskip("librosa")
    dtw_ndim = pytest.importorskip("dtaidistance.dtw_ndim")
    tslearn = pytest.importorskip("tslearn.metrics")
    x, y = clip(0), clip(1)
    a, b = jnp.asarray(x, dtype), jnp.asarray(y, dtype)
    run = jax.jit(lambda x, y: dtw(x, y, metric="sqeuclidean"))
    ours, theirs = race(
        f"dtw with path {FRAMES}x{FRAMES}x{FEATURES} {dtype}",
        lambda: run(a, b),
        {
            "dtaidistance C, no path": lambda: dtw_ndim.distance_fast(x, y),
            "tslearn numba": lambda: tslearn.dtw_path(x, y),
            "librosa numba": lambda: librosa.sequence.dtw(x.T, y.T, metric="sqeuclidean"),
        },
        goals={"dtaidistance C, no path": 1.0, "tslearn numba": 1.0, "librosa numba": 1.0},
    )
    tolerance = 1e-10 if dtype == "float64" else 1e-5
    cost = float(jnp.sqrt(ours.cost))
    np.testing.assert_allclose(cost, theirs["dtaidistance C, no path"], rtol=tolerance)
    np.testing.assert_allclose(cost, theirs["tslearn numba"][1], rtol=tolerance)
    np.testing.assert_allclose(cost**2, theirs["librosa numba"][0][-1, -1], rtol=tolerance)
    if dtype == "float64":
        path = np.asarray(ours.path[: int(ours.length)])
        np.testing.assert_array_equal(path, np.asarray(theirs["tslearn numba"][0]))


@pytest.mark.parametrize("with_path", [False, True], ids=["distance", "path"])
def test_many_pairs(race, with_path):
    """All 100 x 100 pairs of a word of 15 frames and one of 20."""
    dtw_ndim = pytest.importorskip("dtaidistance.dtw_ndim")
    rng = np.random.default_rng(2)
    x, y = rng.standard_normal((100, 15, FEATURES)), rng.standard_normal((100, 20, FEATURES))
    words = [*x, *y]
    a, b = jnp.asarray(x), jnp.asarray(y)

    def one(x, y):
        warp = dtw(x, y, metric="sqeuclidean")
        return warp if with_path else warp.cost

    run = jax.jit(jax.vmap(jax.vmap(one, (None, 0)), (0, None)))
    block = ((0, 100), (100, 200))

    def blocked(parallel):
        return dtw_ndim.distance_matrix_fast(words, block=block, parallel=parallel)

    ours, theirs = race(
        f"dtw {'with path ' if with_path else ''}10 000 pairs 15x20x{FEATURES} float64",
        lambda: run(a, b),
        {
            "dtaidistance blocked C": lambda: blocked(False),
            "dtaidistance blocked C, parallel": lambda: blocked(True),
        },
        goals={"dtaidistance blocked C": 2.0},
    )
    cost = np.sqrt(ours.cost if with_path else ours)
    want = theirs["dtaidistance blocked C"][:100, 100:]
    np.testing.assert_allclose(cost, want, rtol=1e-10)


def test_constrained_words(race):
    """One word of 15 frames against 14 336 targets of 20: the scan of motion repair, no peer."""
    costs = jnp.asarray(np.random.default_rng(3).random((14_336, 15, 20)))

    @jax.jit
    @jax.vmap
    def run(cost):
        return dtw(cost=cost, step_pattern="slope3", open_end=True, min_matched=11).cost

    race("dtw slope3 open end 14 336 words 15x20 float64", lambda: run(costs))


def test_soft_dtw(race):
    """Value and gradient in the features of one pair of long clips."""
    tslearn = pytest.importorskip("tslearn.metrics")
    x, y = clip(0), clip(1)
    a, b = jnp.asarray(x), jnp.asarray(y)
    run = jax.jit(jax.value_and_grad(soft_dtw))

    def theirs():
        cost = tslearn.SquaredEuclidean(x, y)
        soft = tslearn.SoftDTW(cost, gamma=1.0)
        return soft.compute(), cost.jacobian_product(soft.grad())

    ours, peers = race(
        f"soft_dtw value and gradient {FRAMES}x{FRAMES}x{FEATURES} float64",
        lambda: run(a, b),
        {"tslearn numba": theirs},
        goals={"tslearn numba": 2.0},
    )
    value, gradient = peers["tslearn numba"]
    np.testing.assert_allclose(ours[0], value, rtol=1e-10)
    np.testing.assert_allclose(ours[1], gradient, rtol=0, atol=1e-9)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_motion_warping(race, dtype):
    """The walk and hobble of Wu et al., Table 1: 900 ms there, on a Pentium 4."""
    rng = np.random.default_rng(4)
    size, phase = rng.standard_normal((2, 57, 4))

    def motion(t):
        waves = [
            size[:, k] * np.sin(4 * np.pi * (k + 1) * t[:, None] + 6 * phase[:, k]) / (k + 1)
            for k in range(4)
        ]
        return jnp.asarray(sum(waves) + 0.05 * rng.standard_normal((len(t), 57)), dtype)

    source = motion(np.linspace(0, 1, 427))
    reference = 1.3 * motion(np.linspace(0, 1, 400) ** 1.1) + jnp.asarray(0.2, dtype)
    run = jax.jit(motion_warping)
    ours, _ = race(f"motion_warping 427 on 400x57 {dtype}", lambda: run(source, reference))
    assert bool(ours.converged)


def test_pose_distance(race):
    """All pairs of frames of two clips of 24 joints, the 3 worst left out."""
    rng = np.random.default_rng(5)
    x, y = rng.standard_normal((2, FRAMES, 24, 4))
    a, b = (jnp.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True)) for q in (x, y))
    run = jax.jit(lambda a, b: pose_distance(a, b, trim=3))
    race(f"pose_distance {FRAMES}x{FRAMES}x24 trim 3 float64", lambda: run(a, b))
