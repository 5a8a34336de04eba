"""Dynamic time warping against enumeration of every path, its derivative against differences."""

import logging
from functools import cache, partial
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from jaxmotion import quaternion
from jaxmotion.timing import (
    WarpPath,
    bucket_size,
    dtw,
    frame_distance,
    motion_warping,
    pad_to_bucket,
    pose_distance,
    soft_alignment,
    soft_dtw,
)
from tests.helpers import no_shape_checks, random_motion, random_skeleton

align = jax.jit(dtw, static_argnames=("window", "step_pattern", "metric"))


@cache
def align_many(**options):
    """One compiled function of a stack of cost matrices, shared by the tests."""
    return jax.jit(jax.vmap(lambda d: dtw(cost=d, **options)))


PATTERNS = ("symmetric", "symmetric2", "asymmetric", "slope1", "slope2", "slope3")


def moves(pattern):
    if pattern == "asymmetric":
        return ((1, 0), (1, 1), (1, 2))
    return ((1, 0), (0, 1), (1, 1))


def weight(pattern, step):
    return sum(step) if pattern == "symmetric2" else 1


def all_paths(cost, pattern):
    """Every path from (0, 0), by the rules in words: yields (cells, sum)."""
    n, m = cost.shape
    longest = int(pattern[5:]) if pattern.startswith("slope") else n + m

    def go(cells, total, last, run):
        yield cells, total
        for step in moves(pattern):
            i, j = cells[-1][0] + step[0], cells[-1][1] + step[1]
            steps_on_end = 0 if step == (1, 1) else run + 1 if step == last else 1
            if i >= n or j >= m or (steps_on_end > longest and pattern != "asymmetric"):
                continue
            more = total + weight(pattern, step) * cost[i, j]
            yield from go([*cells, (i, j)], more, step, steps_on_end)

    yield from go([(0, 0)], weight(pattern, (1, 1)) * cost[0, 0], None, 0)


def best_sums(cost, pattern):
    """Least sum at every cell and the cell counts of the paths that reach it."""
    best = {}
    for cells, total in all_paths(cost, pattern):
        old, counts = best.get(cells[-1], (1e300, set()))
        if total < old - 1e-12:
            best[cells[-1]] = (total, {len(cells)})
        elif abs(total - old) <= 1e-12:
            counts.add(len(cells))
    return best


def path_of(warp, row=None):
    length = int(warp.length if row is None else warp.length[row])
    path = np.asarray(warp.path if row is None else warp.path[row])
    return [tuple(p) for p in path[:length].tolist()]


def assert_follows(path, pattern, cost, total):
    """The path obeys the pattern's rules and sums to the total."""
    assert path[0] == (0, 0)
    longest = int(pattern[5:]) if pattern.startswith("slope") else len(path)
    run, last, got = 0, None, weight(pattern, (1, 1)) * cost[0, 0]
    for before, after in pairwise(path):
        step = (after[0] - before[0], after[1] - before[1])
        assert step in moves(pattern)
        run = 0 if step == (1, 1) else run + 1 if step == last else 1
        assert run <= longest
        last, got = step, got + weight(pattern, step) * cost[after]
    np.testing.assert_allclose(got, total, rtol=1e-12)


def batch(seed, ties, shape=(4, 5), count=12):
    """Negative entries make detours pay, which otherwise a diagonal always beats."""
    rng = np.random.default_rng(seed)
    integers = rng.integers(-1, 3, (count, *shape)).astype(float)
    return integers if ties else rng.random((count, *shape)) - 0.4


@pytest.mark.parametrize("ties", [False, True], ids=["generic", "ties"])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_closed_end_equals_enumeration(pattern, ties):
    costs = batch(0, ties)
    warp = align_many(step_pattern=pattern)(costs)
    for row, cost in enumerate(costs):
        total, _ = best_sums(cost, pattern)[3, 4]
        np.testing.assert_allclose(warp.cost[row], total, rtol=1e-12)
        path = path_of(warp, row)
        assert path[-1] == (3, 4)
        assert_follows(path, pattern, cost, total)


@pytest.mark.parametrize("ties", [False, True], ids=["generic", "ties"])
@pytest.mark.parametrize("pattern", ["symmetric2", "asymmetric", "slope3"])
@pytest.mark.parametrize("open_end", [True, "either"])
def test_open_end_equals_enumeration(pattern, open_end, ties):
    costs = batch(1, ties)
    divide = {"symmetric2": "frames", "asymmetric": "sum", "slope3": None}[pattern]
    found = align_many(step_pattern=pattern, open_end=open_end, min_matched=2, normalize=divide)(
        costs
    )
    for row, cost in enumerate(costs):
        sums = best_sums(cost, pattern)
        ends = {(3, j) for j in range(1, 5)}
        if open_end == "either":
            ends |= {(i, 4) for i in range(1, 4)}
        sizes = {
            end: {"frames": {sum(end) + 2}, "sum": {1}, None: sums[end][1]}[divide]
            for end in ends & set(sums)
        }
        means = {end: [sums[end][0] / s for s in size] for end, size in sizes.items()}
        path = path_of(found, row)
        assert path[-1] in ends
        got = float(found.cost[row])
        # with ties the number of cells, hence the mean, may be that of any of the cheapest paths
        assert any(abs(got - v) < 1e-12 for v in means[path[-1]])
        assert got <= min(max(v) for v in means.values()) + 1e-12
        assert_follows(path, pattern, cost, sums[path[-1]][0])


def test_slope3_equals_the_seven_state_recursion_of_the_appendix():
    """15 × 20 frames, which enumeration cannot reach: a plain loop over cells and states."""
    rng = np.random.default_rng(2)
    costs = rng.random((6, 15, 20))
    run = jax.jit(
        jax.vmap(lambda d: dtw(cost=d, step_pattern="slope3", open_end=True, min_matched=11))
    )
    found = run(costs)
    for row, cost in enumerate(costs):
        value, cells = seven_states(cost)
        best = value[14].min(axis=-1)
        mean = best / cells[14, np.arange(20), value[14].argmin(axis=-1)]
        end = 10 + int(np.argmin(mean[10:]))
        np.testing.assert_allclose(found.cost[row], mean[end], rtol=1e-12)
        assert path_of(found, row)[-1] == (14, end)
        assert_follows(path_of(found, row), "slope3", cost, best[end])


@pytest.mark.parametrize("open_end", [False, "either"])
def test_long_clips_go_through_in_strips(open_end):
    """201 rows are two strips with a row to spare; alone, padded, and as one of several lanes."""
    cost = np.random.default_rng(20).random((201, 60))
    value, cells = seven_states(cost)
    best = value.min(axis=-1)
    mean = best / np.take_along_axis(cells, value.argmin(axis=-1)[..., None], axis=-1)[..., 0]
    ends = np.full_like(mean, np.inf)
    ends[200, 59] = mean[200, 59]
    if open_end:
        ends[200], ends[:, 59] = mean[200], mean[:, 59]
    end = np.unravel_index(np.argmin(ends), ends.shape)
    run = partial(dtw, step_pattern="slope3", open_end=open_end, normalize="mean")
    alone = jax.jit(lambda d: run(cost=d))(cost)
    more = jax.jit(jax.vmap(lambda d, n, m: run(cost=d, x_length=n, y_length=m), (None, 0, 0)))(
        np.pad(cost, [(0, 7), (0, 5)]), np.array([150, 201, 20]), np.array([60, 60, 59])
    )
    for warp, row in ((alone, None), (more, 1)):
        np.testing.assert_allclose(np.asarray(warp.cost).reshape(-1)[row or 0], ends[end])
        assert path_of(warp, row)[-1] == end
        assert_follows(path_of(warp, row), "slope3", cost, best[end])
    if not open_end:
        np.testing.assert_allclose(more.cost[0], mean[149, 59], rtol=1e-12)
        np.testing.assert_allclose(more.cost[2], mean[19, 58], rtol=1e-12)


def seven_states(cost, longest=3):
    n, m = cost.shape
    value = np.full((n, m, 1 + 2 * longest), np.inf)
    cells = np.ones((n, m, 1 + 2 * longest), int)
    value[0, 0, 0] = cost[0, 0]
    for i in range(n):
        for j in range(m):
            if i and j:
                s = np.argmin(value[i - 1, j - 1])
                value[i, j, 0] = value[i - 1, j - 1, s] + cost[i, j]
                cells[i, j, 0] = cells[i - 1, j - 1, s] + 1
            for first, di, dj in ((1, 1, 0), (1 + longest, 0, 1)):
                if i < di or j < dj:
                    continue
                before, counts = value[i - di, j - dj], cells[i - di, j - dj]
                others = [s for s in range(len(before)) if not first <= s < first + longest]
                sources = [min(others, key=lambda s, b=before: b[s])]
                sources += range(first, first + longest - 1)
                for state, s in enumerate(sources, first):
                    value[i, j, state] = before[s] + cost[i, j]
                    cells[i, j, state] = counts[s] + 1
    return value, cells


@pytest.mark.parametrize(("n", "m"), [(1, 1), (1, 3), (3, 1)])
def test_shortest_clips(n, m, dtype):
    cost = np.random.default_rng(3).random((n, m)).astype(dtype)
    warp = align(cost=cost)
    assert warp.cost.dtype == dtype
    total, _ = best_sums(cost.astype(float), "symmetric")[n - 1, m - 1]
    np.testing.assert_allclose(warp.cost, total, rtol=1e-6)
    assert path_of(warp)[-1] == (n - 1, m - 1)
    assert bool(
        jnp.all(warp.path[int(warp.length) - 1 :] == jnp.asarray([n - 1, m - 1], jnp.int32))
    )
    assert int(jnp.sum(warp.mask)) == int(warp.length)


def test_a_clip_matches_itself_exactly(dtype):
    x = np.random.default_rng(4).standard_normal((9, 40)).astype(dtype) + 1000
    warp = align(x, x)
    assert float(warp.cost) == 0.0
    assert path_of(warp) == [(i, i) for i in range(9)]


def test_time_reversal_and_exchange_leave_the_cost():
    rng = np.random.default_rng(5)
    x, y = rng.standard_normal((11, 3)), rng.standard_normal((8, 3))
    run = jax.jit(lambda x, y: dtw(x, y, step_pattern="slope2").cost)
    np.testing.assert_allclose(run(x, y), run(x[::-1], y[::-1]), rtol=1e-12)
    np.testing.assert_allclose(run(x, y), run(y, x), rtol=1e-12)


@pytest.mark.parametrize("radius", [0, 1, 3])
@pytest.mark.parametrize("shape", [(4, 6), (6, 4), (5, 5)])
def test_window_is_a_band_about_both_corners(shape, radius):
    cost = np.random.default_rng(6).random(shape)
    i, j = np.indices(shape)
    longer = shape[1] - shape[0]
    inside = (j - i >= min(longer, 0) - radius) & (j - i <= max(longer, 0) + radius)
    total, _ = best_sums(np.where(inside, cost, np.inf), "symmetric")[shape[0] - 1, shape[1] - 1]
    warp = align(cost=cost, window=radius)
    np.testing.assert_allclose(warp.cost, total, rtol=1e-12)
    assert all(inside[cell] for cell in path_of(warp))


def test_no_path_gives_infinite_cost_and_no_cells():
    cost = np.random.default_rng(7).random((4, 5))
    cost[2, :] = np.inf
    warp = align(cost=cost)
    assert np.isposinf(warp.cost)
    assert int(warp.length) == 0
    assert not bool(warp.mask.any())


def test_padding_and_lengths_change_nothing():
    rng = np.random.default_rng(8)
    lengths = np.array([[5, 7], [9, 6]])
    x, y = rng.standard_normal((2, 9, 3)), rng.standard_normal((2, 10, 3))
    run = partial(dtw, step_pattern="slope2", window=4, open_end="either")
    padded = jax.jit(jax.vmap(lambda x, y, n, m: run(x, y, x_length=n, y_length=m)))(
        x, y, lengths[:, 0], lengths[:, 1]
    )
    for row, (n, m) in enumerate(lengths):
        alone = jax.jit(run)(x[row, :n], y[row, :m])
        np.testing.assert_allclose(padded.cost[row], alone.cost, rtol=1e-12)
        assert path_of(padded, row) == path_of(alone)


def plain_recursion(x, y):
    cost = np.linalg.norm(x[:, None] - y[None], axis=-1)
    total = np.full((len(x) + 1, len(y) + 1), np.inf)
    total[0, 0] = 0
    for i, j in np.ndindex(cost.shape):
        total[i + 1, j + 1] = cost[i, j] + min(total[i, j], total[i, j + 1], total[i + 1, j])
    return total[-1, -1]


def test_one_compile_serves_a_bucket_of_lengths():
    rng = np.random.default_rng(9)

    @jax.jit
    def in_bucket(x, y, n, m):
        return dtw(x, y, x_length=n, y_length=m)

    target = rng.standard_normal((40, 4))
    for frames in (33, 37, 40, 48):
        x, n = pad_to_bucket(rng.standard_normal((frames, 4)))
        y, m = pad_to_bucket(target)
        warp = in_bucket(x, y, n, m)
        assert path_of(warp)[-1] == (frames - 1, 39)
        np.testing.assert_allclose(warp.cost, plain_recursion(x[:frames], target), rtol=1e-12)
    assert in_bucket._cache_size() == 1
    x, n = pad_to_bucket(rng.standard_normal((49, 4)))
    in_bucket(x, *pad_to_bucket(target)[:1], n, 40)
    assert in_bucket._cache_size() == 2


def test_a_second_call_compiles_nothing():
    x, y = np.random.default_rng(10).standard_normal((2, 6, 3))
    q = quaternion.exp(np.random.default_rng(11).standard_normal((4, 3, 3)))
    calls = (
        lambda n: dtw(x, y, metric="sqeuclidean", x_length=n),
        lambda n: soft_dtw(x, y, 0.1 * n, x_length=n),
        lambda n: soft_alignment(x, y, 0.1 * n, y_length=n),
        lambda n: motion_warping(x[:5], y[:6]),
        lambda n: pose_distance(q, q, trim=1),
    )
    for call in calls:
        call(3)
    with jax.no_tracing():
        for call in calls:
            call(4)


def test_buckets():
    assert [bucket_size(n) for n in (1, 16, 17, 24, 25, 33, 49, 1000)] == [
        16, 16, 24, 24, 32, 48, 64, 1024,
    ]  # fmt: skip
    x, n = pad_to_bucket(np.arange(6.0).reshape(3, 2), size=5)
    np.testing.assert_array_equal(x, [[0, 1], [2, 3], [4, 5], [4, 5], [4, 5]])
    assert n == 3
    with pytest.raises(ValueError, match="size=2"):
        pad_to_bucket(np.zeros((3, 2)), size=2)


def test_derivative_in_the_cost_is_the_path():
    cost = np.random.default_rng(10).random((5, 6))

    @jax.jit
    def run(d):
        return dtw(cost=d, step_pattern="symmetric2", open_end=True, normalize="frames")

    def mean(d):
        return run(d).cost

    warp = run(cost)
    path = path_of(warp)
    counted = np.zeros_like(cost)
    for before, after in pairwise([(-1, -1), *path]):
        counted[after] = after[0] - before[0] + after[1] - before[1]
    np.testing.assert_allclose(jax.grad(mean)(cost), counted / (sum(path[-1]) + 2), rtol=1e-12)
    np.testing.assert_allclose(jax.jacfwd(mean)(cost), counted / (sum(path[-1]) + 2), rtol=1e-12)
    assert not np.any(jax.hessian(mean)(cost))


@pytest.mark.parametrize("metric", ["euclidean", "sqeuclidean"])
def test_derivative_in_the_features(metric):
    rng = np.random.default_rng(11)
    x, y = rng.standard_normal((2, 5, 3)), rng.standard_normal((2, 4, 3))
    run = jax.jit(jax.vmap(lambda x, y: dtw(x, y, metric=metric, normalize="mean").cost))
    check_grads(run, (jnp.asarray(x), jnp.asarray(y)), order=1, modes=("fwd", "rev"), eps=1e-6)


def test_derivative_where_frames_agree_is_zero():
    x = np.random.default_rng(12).standard_normal((4, 3))
    assert not np.any(jax.jit(jax.grad(lambda x: dtw(x, x).cost))(x))
    assert not np.any(jax.jit(jax.grad(lambda a: dtw(a, x).cost))(x))


def test_modes_agree():
    """Eager, jit, vmap, nested vmap (either order) and a plain loop; inputs stay as they were."""
    rng = np.random.default_rng(13)
    x, y = (rng.standard_normal((3, t, 35)) for t in (6, 7))
    kept = x.copy(), y.copy()
    loop = [[align(a, b) for b in y] for a in x]
    eager = dtw(x[0], y[1])
    one = jax.jit(jax.vmap(dtw))(x, y)
    pairs = jax.jit(jax.vmap(jax.vmap(dtw, (None, 0)), (0, None)))(x, y)
    turned = jax.jit(jax.vmap(jax.vmap(dtw, (0, None)), (None, 0)))(x, y)
    np.testing.assert_allclose(eager.cost, loop[0][1].cost, rtol=1e-12)
    for i in range(3):
        np.testing.assert_allclose(one.cost[i], loop[i][i].cost, rtol=1e-12)
        for j in range(3):
            np.testing.assert_allclose(pairs.cost[i, j], loop[i][j].cost, rtol=1e-12)
            np.testing.assert_allclose(turned.cost[j, i], loop[i][j].cost, rtol=1e-12)
            np.testing.assert_array_equal(pairs.path[i, j], loop[i][j].path)
            np.testing.assert_array_equal(turned.path[j, i], loop[i][j].path)
    np.testing.assert_array_equal(x, kept[0])
    np.testing.assert_array_equal(y, kept[1])


def test_many_pairs_go_through_in_blocks():
    """More pairs than one block of lanes holds, with a remainder."""
    costs = np.random.default_rng(14).random((2500, 3, 4))
    got = align_many(step_pattern="symmetric")(costs)
    for row in (0, 1023, 1024, 2499):
        total, _ = best_sums(costs[row], "symmetric")[2, 3]
        np.testing.assert_allclose(got.cost[row], total, rtol=1e-12)
        assert_follows(path_of(got, row), "symmetric", costs[row], total)


@pytest.mark.parametrize("trim", [0, 2])
def test_pose_distance_equals_logarithms(trim, dtype):
    rng = np.random.default_rng(15)
    x, y = (rng.standard_normal((t, 6, 4)).astype(dtype) for t in (4, 5))
    x, y = (q / np.linalg.norm(q, axis=-1, keepdims=True) for q in (x, y))
    y[0] = -x[0]
    weights = rng.random(6).astype(dtype) + 0.5
    got = jax.jit(pose_distance, static_argnames="trim")(x, y, trim=trim, weights=weights)
    dots = np.abs(np.einsum("ijc,kjc->ikj", x.astype(float), y.astype(float)))
    terms = weights * np.arccos(np.minimum(dots, 1)) ** 2
    want = np.sort(terms, axis=-1)[..., : 6 - trim].sum(axis=-1)
    tolerance = 1e-5 if dtype == jnp.float32 else 1e-12
    np.testing.assert_allclose(got, want, rtol=tolerance, atol=tolerance)
    assert got.dtype == dtype
    assert float(got[0, 0]) == 0.0


def test_poses_align_by_their_rotations():
    rng = np.random.default_rng(21)
    x, y = (rng.standard_normal((t, 2, 4)) for t in (4, 5))
    x, y = (q / np.linalg.norm(q, axis=-1, keepdims=True) for q in (x, y))
    turned = np.asarray(jax.jit(quaternion.distance)(x[:, None], y[None]))
    total, _ = best_sums(np.sum((turned / 2) ** 2, axis=-1), "symmetric")[3, 4]
    np.testing.assert_allclose(align(x, y, metric="pose").cost, total, rtol=1e-12)


def test_pose_distance_is_accurate_for_small_turns():
    angle = 10.0 ** -np.arange(1, 9)
    x = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0 * angle, 0 * angle], axis=-1)[:, None]
    rest = jnp.asarray([[[1.0, 0.0, 0.0, 0.0]]])
    np.testing.assert_allclose(pose_distance(x, rest)[:, 0], (angle / 2) ** 2, rtol=1e-7)


def test_pose_distance_derivative():
    rng = np.random.default_rng(16)
    x, y = (jnp.asarray(rng.standard_normal((3, 4, 3))) for _ in range(2))
    metric = partial(pose_distance, trim=1)

    @jax.jit
    def run(x, y):
        return dtw(quaternion.exp(x), quaternion.exp(y), metric=metric).cost

    check_grads(run, (x, y), order=1, modes=("fwd", "rev"), eps=1e-6)
    still = jax.jit(jax.grad(lambda q: dtw(q, q, metric=metric).cost))(quaternion.exp(x))
    assert not np.any(still)


def test_frame_distance_is_exact_where_frames_agree(dtype):
    """The expanded square would be off by √ε times the distance from the origin."""
    x = np.random.default_rng(17).standard_normal((5, 33)).astype(dtype) + 100
    y = x + np.asarray(1e-3, dtype)
    want = np.linalg.norm(x[:, None].astype(float) - y[None].astype(float), axis=-1)
    tolerance = 1e-5 if dtype == jnp.float32 else 1e-12
    np.testing.assert_allclose(jax.jit(frame_distance)(x, y), want, rtol=tolerance)


@pytest.mark.parametrize("clips", ["x", "y", "both", "all pairs"])
def test_frame_distance_under_vmap(clips):
    rng = np.random.default_rng(18)
    x, y = rng.standard_normal((3, 5, 34)), rng.standard_normal((3, 4, 34))
    want = np.linalg.norm(x[:, None, :, None] - y[None, :, None], axis=-1)
    if clips == "x":
        np.testing.assert_allclose(jax.vmap(frame_distance, (0, None))(x, y[1]), want[:, 1])
    elif clips == "y":
        np.testing.assert_allclose(jax.vmap(frame_distance, (None, 0))(x[1], y), want[1])
    elif clips == "both":
        got = jax.vmap(frame_distance)(x, y)
        np.testing.assert_allclose(got, want[np.arange(3), np.arange(3)])
    else:
        got = jax.vmap(lambda a: jax.vmap(lambda b: frame_distance(a, b))(y))(x)
        np.testing.assert_allclose(got, want)


X = np.zeros((4, 3))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: dtw(X), "either x and y, or cost="),
        (lambda: dtw(X, X, cost=X), "either x and y, or cost="),
        (lambda: dtw(X, X[:, :2]), r"\(4, 3\) and y \(4, 2\)"),
        (lambda: dtw(X, X, metric="city"), "metric .*='city'; expected 'euclidean'"),
        (lambda: dtw(X, X, step_pattern="slope9"), "step_pattern='slope9'"),
        (lambda: dtw(X, X, window=-1), "window=-1"),
        (lambda: dtw(X, X, open_end="both"), "open_end='both'"),
        (lambda: dtw(X, X, open_end=True, min_matched=5), "min_matched=5"),
        (lambda: dtw(X, X, normalize="median"), "normalize='median'"),
        (lambda: dtw(cost=np.zeros((2, 9)), step_pattern="slope3"), r"no path .*\(2, 9\)"),
        (lambda: dtw(cost=np.zeros((0, 9))), r"\(0, 9\)"),
        (lambda: dtw(cost=np.zeros((2, 9), int)), "dtype int64"),
        (lambda: pose_distance(X, X), r"\(n, J, 4\)"),
        (lambda: pose_distance(np.zeros((2, 3, 4)), np.zeros((2, 3, 4)), trim=3), "trim=3"),
        (
            lambda: pose_distance(np.zeros((2, 3, 4)), np.zeros((2, 3, 4)), weights=[1.0]),
            r"weights has shape \(1,\)",
        ),
    ],
)
def test_static_trouble_names_the_argument(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_result_is_a_pytree_of_arrays():
    warp = dtw(cost=np.zeros((2, 2)))
    assert isinstance(warp, WarpPath)
    assert len(jax.tree.leaves(warp)) == 3


def test_distances_of_other_clips_compile_nothing(caplog):
    """Outside of jit too."""
    rng = np.random.default_rng(0)
    clips = [jnp.asarray(rng.standard_normal((n, 7))) for n in (5, 6, 5, 6)]
    frame_distance(*clips[:2])
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        frame_distance(*clips[2:])
    assert "Compiling" not in caplog.text


def test_either_open_end_may_ask_for_as_many_frames_as_the_longer_clip_has():
    """Once only y's were counted."""
    x = np.linspace(0, 8, 9)[:, None]
    found = dtw(x, x[:5] + 0.25, open_end="either", min_matched=5)
    assert found.cost == 0.25
    cost = np.ones((9, 5))
    cost[:, 4] = 0.5
    found = dtw(cost=cost, open_end="either", min_matched=7)
    last = found.path[int(found.length) - 1]
    assert int(last[1]) == 4
    assert int(last[0]) >= 6
    for open_end, most in (("either", 9), (True, 5)):
        with pytest.raises(ValueError, match=rf"dtw: min_matched=10; want 1 \.\.\. {most}"):
            dtw(cost=cost, open_end=open_end, min_matched=10)


def test_two_motions_are_compared_by_their_poses():
    rng = np.random.default_rng(7)
    skeleton = random_skeleton(rng, 4)
    x, y = (random_motion(rng, frames, skeleton) for frames in (9, 6))
    between = pose_distance(x.rotations, y.rotations)
    np.testing.assert_array_equal(pose_distance(x, y), between)
    np.testing.assert_array_equal(frame_distance(x, y), between)
    assert dtw(x, y).cost == dtw(cost=between).cost
    assert soft_dtw(x, y, 0.1) == soft_dtw(cost=between, gamma=0.1)
    shares = soft_alignment(x, y), soft_alignment(cost=between)  # by two programs: to rounding
    np.testing.assert_allclose(*shares, rtol=1e-12)
    trimmed = partial(pose_distance, trim=1)
    assert dtw(x, y, metric=trimmed).cost == dtw(cost=trimmed(x, y)).cost
    padded, n = pad_to_bucket(x)
    assert (len(padded), n) == (16, 9)
    np.testing.assert_array_equal(padded.rotations[8:], np.tile(x.rotations[8:], (8, 1, 1)))
    np.testing.assert_array_equal(padded.translations[:9], x.translations)
    assert dtw(padded, y, x_length=n).cost == dtw(x, y).cost


def test_motions_that_cannot_be_compared():
    rng = np.random.default_rng(8)
    x, other = random_motion(rng, 3, 4), random_motion(rng, 3, 5)
    calls = {
        "dtw": dtw,
        "soft_dtw": soft_dtw,
        "soft_alignment": soft_alignment,
        "frame_distance": frame_distance,
    }
    for name, f in calls.items():
        with pytest.raises(ValueError, match=rf"^{name}: metric='euclidean' .* expected 'pose'"):
            f(x, x, metric="euclidean")
    calls["pose_distance"] = pose_distance
    batch = jax.tree.map(lambda x: x[None], x)
    for name, f in calls.items():
        for wrong, message in (
            (x.rotations, r"y is an array of shape \(3, 4, 4\); expected two motions or two"),
            (other, "the motions have different joints or dtypes"),
            (x.astype(np.float32), "the motions have different joints or dtypes"),
            (batch, r"one clip at a time for y, got batch axes \(1,\); use jax.vmap"),
        ):
            with no_shape_checks(), pytest.raises(ValueError, match=f"^{name}: {message}"):
                f(x, wrong)
