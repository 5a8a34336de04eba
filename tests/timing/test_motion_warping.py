"""Iterative motion warping against a dense loop, enumeration of warps, and its own energy."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from jaxmotion import quaternion
from jaxmotion.timing import motion_warping, unwarp
from tests.helpers import no_shape_checks

NAMES = ("scale_smoothness", "offset_smoothness")
RUN = jax.jit(motion_warping, static_argnames=("shared", "slope", "max_iterations", *NAMES))


def clips(num_source, num_reference, channels=3):
    """A curve and a bent, scaled, shifted copy of it."""
    phase = np.arange(channels)
    t = np.linspace(0, 6, num_source)[:, None]
    u = 6 * np.linspace(0, 1, num_reference)[:, None] ** 1.2
    return np.sin(t + phase), 1.5 * np.sin(u + phase) + 0.3


@pytest.fixture(scope="module")
def found():
    """The warp of the clips most tests share, compiled once."""
    return RUN(*clips(12, 18))


def energy(source, reference, runs, a, b, m, weights=(1.0, 1.0)):
    mean, rms = source.mean(axis=0), source.std(axis=0)
    a_b = (rms * a, b + mean * a)
    data = np.repeat(source * a + b, runs, axis=0) - np.repeat(reference, m, axis=0)
    rough = [w**2 * np.sum(np.diff(x, axis=0) ** 2) for w, x in zip(weights, a_b, strict=True)]
    return np.sum(data**2) + sum(rough)


def dense_fit(source, reference, runs, m, weights=(1.0, 1.0)):
    """The normal equations of one channel, written out, of scale and the level b + mean·a."""
    n, mean = len(source), source.mean()
    source = source - mean
    warp = np.zeros((m * len(reference), n))
    warp[np.arange(len(warp)), np.repeat(np.arange(n), runs)] = 1
    s, d = np.diag(source), np.diff(np.eye(n), axis=0)
    f, g = weights[0] * source.std() * d, weights[1] * d
    gram = np.block([[s.T @ warp.T @ warp @ s + f.T @ f, s.T @ warp.T @ warp],
                     [warp.T @ warp @ s, warp.T @ warp + g.T @ g]])  # fmt: skip
    target = warp.T @ np.repeat(reference, m)
    a, level = np.split(np.linalg.solve(gram, np.r_[s @ target, target]), 2)
    return a, level - mean * a


def dense_runs(distance, longest):
    """Cheapest run lengths by a plain table over (source frame, refined frame)."""
    n, refined = distance.shape
    best = np.full((n + 1, refined + 1), np.inf)
    best[0, 0] = 0
    length = np.zeros((n + 1, refined + 1), int)
    for i, j in itertools.product(range(1, n + 1), range(1, refined + 1)):
        for c in range(1, min(longest, j) + 1):
            total = best[i - 1, j - c] + distance[i - 1, j - c : j].sum()
            if total < best[i, j]:
                best[i, j], length[i, j] = total, c
    runs, j = [], refined
    for i in range(n, 0, -1):
        runs.append(length[i, j])
        j -= length[i, j]
    return np.array(runs[::-1]), best[n, refined]


def dense_warping(source, reference, m, rounds):
    a, b = np.ones_like(source), np.zeros_like(source)
    old, energies = None, []
    for _ in range(rounds):
        refined = np.repeat(reference, m, axis=0)
        distance = np.sum(((source * a + b)[:, None] - refined[None]) ** 2, axis=-1)
        runs, _ = dense_runs(distance, m * m)
        energies.append(energy(source, reference, runs, a, b, m))
        fits = [dense_fit(s, r, runs, m) for s, r in zip(source.T, reference.T, strict=True)]
        a, b = (np.stack(x, axis=-1) for x in zip(*fits, strict=True))
        energies.append(energy(source, reference, runs, a, b, m))
        if old is not None and np.array_equal(runs, old):
            break
        old = runs
    return runs, a, b, np.array(energies)


@pytest.mark.parametrize(("num_source", "num_reference"), [(12, 18), (18, 13), (7, 20)])
def test_equals_the_dense_loop(num_source, num_reference):
    source, reference = clips(num_source, num_reference)
    got = RUN(source, reference)
    runs, a, b, energies = dense_warping(source, reference, got.repeats, 100)
    np.testing.assert_array_equal(got.runs, runs)
    np.testing.assert_allclose(got.scale, a, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(got.offset, b, rtol=1e-9, atol=1e-9)
    steps = 2 * int(got.iterations)
    np.testing.assert_allclose(got.energy[:steps], energies[:steps], rtol=1e-9)
    np.testing.assert_allclose(got.energy[steps:], energies[-1], rtol=1e-9)
    assert bool(got.converged)


def test_first_warp_is_the_best_of_all_warps():
    source, reference = np.random.default_rng(0).random((2, 4, 2))
    reference = reference[:3]
    got = RUN(source, reference, max_iterations=1)
    assert got.repeats == 2
    every = (w for w in itertools.product(range(1, 5), repeat=4) if sum(w) == 6)
    ones, zeros = np.ones_like(source), np.zeros_like(source)
    best = min(energy(source, reference, w, ones, zeros, 2) for w in every)
    np.testing.assert_allclose(got.energy[0], best, rtol=1e-12)
    np.testing.assert_allclose(
        energy(source, reference, np.asarray(got.runs), ones, zeros, 2), best, rtol=1e-12
    )
    assert not bool(got.converged)
    with pytest.raises(Exception, match="motion_warping: still changing after 1 iterations"):
        motion_warping(source, reference, max_iterations=1, throw=True)


@pytest.mark.parametrize(
    ("num_source", "num_reference", "shared"), [(40, 60, True), (60, 45, True), (12, 18, False)]
)
def test_energy_never_rises_and_runs_obey_the_slope(num_source, num_reference, shared):
    source, reference = clips(num_source, num_reference)
    source = source + 0.1 * np.random.default_rng(1).standard_normal(source.shape)
    got = RUN(source, reference, shared=shared)
    assert np.all(np.diff(got.energy, axis=0) <= 1e-9)
    assert bool(jnp.all(got.converged))
    assert got.runs.shape == ((num_source,) if shared else (num_source, 3))
    assert np.all(np.sum(got.runs, axis=0) == got.repeats * num_reference)
    assert int(got.runs.min()) >= 1
    assert int(got.runs.max()) <= got.repeats**2


def test_a_warp_per_channel_is_each_channel_alone():
    source, reference = clips(12, 18)
    got = RUN(source, reference, shared=False)
    pairs = got.is_new_pair
    for c in range(3):
        alone = RUN(source[:, c : c + 1], reference[:, c : c + 1])
        np.testing.assert_array_equal(got.runs[:, c], alone.runs)
        np.testing.assert_array_equal(got.source_index[:, c], alone.source_index)
        np.testing.assert_array_equal(pairs[:, c], alone.is_new_pair)
        np.testing.assert_allclose(got.scale[:, c], alone.scale[:, 0], rtol=1e-9)
        np.testing.assert_allclose(got.energy[:, c], alone.energy, rtol=1e-9)
    signal = got.source_index.astype(float)
    np.testing.assert_allclose(unwarp(signal, got), np.repeat(np.arange(12.0)[:, None], 3, 1))


def test_a_clip_warps_onto_itself_without_energy(dtype):
    source, _ = clips(15, 15)
    got = RUN(source.astype(dtype), source.astype(dtype))
    assert got.scale.dtype == got.energy.dtype == dtype
    np.testing.assert_allclose(got.energy[0], 0, atol=1e-10)
    np.testing.assert_array_equal(got.runs, np.full(15, 2))
    tolerance = 1e-3 if dtype == jnp.float32 else 1e-9
    np.testing.assert_allclose(got.scale, 1, atol=tolerance)
    np.testing.assert_allclose(got.offset, 0, atol=tolerance)


def level_of(got, unit, origin):
    """The offset, if unit and origin of the channels were 1 and 0."""
    scale, offset = (np.asarray(x, float) for x in (got.scale, got.offset))
    return (offset - origin * (1 - scale)) / unit


def assert_same_but_for_unit_and_origin(got, want, unit, origin, rtol):
    """``unit``, ``origin``: of got's channels."""
    np.testing.assert_array_equal(got.runs, want.runs)
    np.testing.assert_allclose(got.scale, want.scale, rtol, rtol)
    level = level_of(got, unit, origin)
    np.testing.assert_allclose(level, want.offset, rtol, rtol * (1 + np.abs(origin / unit).max()))


@pytest.mark.parametrize(
    ("unit", "origin"), [(1, 100), (1e-4, 0), (3e-25, 0), (7e12, -1e14), (0.02, 5)]
)
def test_unit_and_origin_of_the_channels_do_not_matter(unit, origin, dtype):
    want = RUN(*clips(12, 18))
    source, reference = ((unit * x + origin).astype(dtype) for x in clips(12, 18))
    got = RUN(source, reference)
    rtol = 2e-5 * (1 + abs(origin / unit)) ** 0.5 if dtype == jnp.float32 else 1e-9
    assert_same_but_for_unit_and_origin(got, want, unit, origin, rtol)
    assert int(got.iterations) == int(want.iterations)
    if unit > 1e-18:
        np.testing.assert_allclose(got.energy / unit, unit * want.energy, rtol=1e-2, atol=1e-6)


def test_channels_of_any_unit_stand_beside_each_other(dtype):
    """A channel that says next to nothing of the warp gets its own scale all the same."""
    source, reference = clips(12, 18)
    source[:, 2], reference[:, 2] = source[:, 0], reference[:, 0]
    unit, origin = np.array([1, 1, 1e-5]), np.array([0, 30, 0.01])
    want = RUN(source[:, :2], reference[:, :2])
    got = RUN(*((unit * x + origin).astype(dtype) for x in (source, reference)))
    scale, level = got.scale, level_of(got, unit, origin)
    np.testing.assert_array_equal(got.runs, want.runs)
    atol = 1e-2 if dtype == jnp.float32 else 1e-9
    np.testing.assert_allclose(scale[:, [0, 1]], want.scale, atol=atol)
    np.testing.assert_allclose(scale[:, 2], want.scale[:, 0], atol=atol)
    np.testing.assert_allclose(level[:, 2], want.offset[:, 0], atol=atol)


@pytest.mark.parametrize(("w_a", "w_b"), [(0.1, 0.1), (1e3, 0.1), (1.0, 1e5), (1e9, 1e9)])
def test_smoothness_of_any_size(w_a, w_b, dtype):
    source, reference = (x[:, :1] for x in clips(12, 18))
    got = RUN(
        source.astype(dtype), reference.astype(dtype), **dict(zip(NAMES, (w_a, w_b), strict=True))
    )
    runs = np.asarray(got.runs)
    # by orthogonal transforms, which lose half as many digits as the normal equations
    warp, d = np.repeat(np.eye(12), runs, axis=0), np.diff(np.eye(12), axis=0)
    mean, rms = source.mean(), source.std()
    rows = [[warp * (source[:, 0] - mean), warp], [w_a * rms * d, 0 * d], [0 * d, w_b * d]]
    target = np.r_[np.repeat(reference[:, 0] - mean, got.repeats), np.zeros(22)]
    a, level = np.split(np.linalg.lstsq(np.block(rows), target)[0], 2)
    atol = 2e-3 if dtype == jnp.float32 else 1e-7
    np.testing.assert_allclose(got.scale[:, 0], a, atol=atol)
    np.testing.assert_allclose(got.offset[:, 0], level + mean * (1 - a), atol=atol)


def test_constant_channels_keep_scale_one_and_reach_the_least_energy(dtype):
    source, reference = (x.astype(dtype) for x in clips(12, 18))
    source[:, 1] = 0.7
    source[:, 2] = 0
    got = RUN(source, reference)
    np.testing.assert_allclose(got.scale[:, 1:], 1, rtol=1e-5)
    assert bool(jnp.all(jnp.isfinite(got.offset)))
    runs = np.asarray(got.runs)
    tolerance = 1e-4 if dtype == jnp.float32 else 1e-9
    for c, level in ((1, 0.7), (2, 0.0)):
        warp = np.zeros((got.num_refined, 12))
        warp[np.arange(got.num_refined), np.repeat(np.arange(12), runs)] = 1
        d = np.diff(np.eye(12), axis=0)
        target = np.repeat(reference[:, c], got.repeats) - level
        want = np.linalg.solve(warp.T @ warp + d.T @ d, warp.T @ target)
        np.testing.assert_allclose(got.offset[:, c], want, atol=tolerance)


@pytest.mark.parametrize(("num_source", "num_reference"), [(1, 3), (3, 1), (2, 2)])
def test_shortest_clips(num_source, num_reference):
    source, reference = clips(num_source, num_reference, channels=2)
    got = RUN(source, reference)
    assert int(got.runs.sum()) == got.num_refined
    assert bool(jnp.all(jnp.isfinite(got.scale) & jnp.isfinite(got.offset)))
    assert np.all(np.diff(got.energy) <= 1e-12)


def test_scale_and_offset_are_differentiable_given_the_warp():
    source, reference = (jnp.asarray(x) for x in clips(6, 8, channels=2))

    @jax.jit
    def fit(s, r):
        got = motion_warping(s, r)
        return got.scale, got.offset

    check_grads(fit, (source, reference), order=1, modes=("fwd", "rev"), eps=1e-6)
    still = jnp.full((5, 2), 0.4)
    slope = jax.jit(jax.grad(lambda s: jnp.sum(motion_warping(s, s).offset ** 2)))(still)
    assert bool(jnp.all(jnp.isfinite(slope)))


def test_derivatives_know_neither_unit_nor_origin():
    """Forward and reverse, a million away from the origin and in thousandths of the unit."""
    source, reference = (jnp.asarray(x) for x in clips(6, 8, channels=2))

    @jax.jit
    def modes(s, r):
        def fit(s, r):
            got = motion_warping(s, r)
            return got.scale, got.offset - 1e6 * (1 - got.scale)

        return jax.jacfwd(fit, (0, 1))(s, r), jax.jacrev(fit, (0, 1))(s, r)

    wanted = jax.jit(jax.jacrev(lambda s, r: motion_warping(s, r).scale, (0, 1)))(source, reference)
    for unit in (1.0, 1e-3):
        forward, reverse = modes(unit * source + 1e6, unit * reference + 1e6)
        atol = 1e-5 / unit
        for got, want in zip(jax.tree.leaves(forward), jax.tree.leaves(reverse), strict=True):
            np.testing.assert_allclose(got, want, atol=1e-9 / unit)
        for got, want in zip(forward[0], wanted, strict=True):
            np.testing.assert_allclose(unit * got, want, atol=atol)


def test_indices_count_each_pair_once(found):
    got = found
    pairs = list(zip(got.source_index.tolist(), got.reference_index.tolist(), strict=True))
    want = [pair != before for before, pair in zip([None, *pairs], pairs, strict=False)]
    np.testing.assert_array_equal(got.is_new_pair, want)
    assert [len(list(g)) for _, g in itertools.groupby(got.source_index.tolist())] == list(got.runs)


def test_unwarp_averages_runs(found, dtype):
    rng = np.random.default_rng(2)
    warp = found
    clip = rng.standard_normal((12, 2, 3)).astype(dtype)
    np.testing.assert_allclose(unwarp(clip[warp.source_index], warp), clip, rtol=1e-6)
    signal = rng.standard_normal((warp.num_refined, 3)).astype(dtype)
    got = unwarp(signal, warp)
    assert got.dtype == dtype
    ends = np.cumsum(warp.runs)
    for i, (start, end) in enumerate(itertools.pairwise([0, *ends])):
        np.testing.assert_allclose(got[i], signal[start:end].mean(axis=0), rtol=2e-5, atol=1e-6)


def test_unwarp_averages_rotations_along_geodesics(found, dtype):
    rng = np.random.default_rng(3)
    warp = found
    average = jax.jit(lambda v, flips: unwarp(flips * quaternion.exp(v), warp, rotations=True))
    index = np.asarray(warp.source_index)
    vectors = rng.standard_normal((12, 1, 3)).astype(dtype)
    flips = rng.choice([-1, 1], (warp.num_refined, 1, 1)).astype(dtype)
    got = average(vectors[index], flips)
    assert got.dtype == dtype
    turned = np.asarray(quaternion.distance(got, quaternion.exp(vectors)))
    np.testing.assert_allclose(turned, 0, atol=1e-3 if dtype == jnp.float32 else 1e-7)

    # about one axis the average of a run is the rotation by its mean angle
    angles = (0.5 * rng.standard_normal(warp.num_refined)).astype(dtype)
    axis = np.array([0.6, 0.0, 0.8], dtype)
    got = average(angles[:, None, None] * axis, np.ones_like(flips))
    means = unwarp(angles[:, None], warp)
    want = quaternion.exp(means[..., None] * axis)
    np.testing.assert_allclose(got, want, atol=1e-5 if dtype == jnp.float32 else 1e-12)


def test_unwarp_is_differentiable(found):
    warp = found
    v = jnp.asarray(0.5 * np.random.default_rng(4).standard_normal((warp.num_refined, 1, 3)))
    run = jax.jit(lambda v: unwarp(quaternion.exp(v), warp, rotations=True))
    check_grads(run, (v,), order=1, modes=("fwd", "rev"), eps=1e-6)
    check_grads(jax.jit(lambda v: unwarp(v, warp)), (v,), order=1, modes=("fwd", "rev"))


def test_modes_agree():
    source, reference = clips(7, 9)
    kept = source.copy(), reference.copy()
    batch = jax.jit(jax.vmap(motion_warping))(
        np.stack([source, source[::-1]]), np.stack([reference] * 2)
    )
    one = RUN(source, reference)
    eager = motion_warping(source, reference)
    np.testing.assert_array_equal(batch.runs[0], one.runs)
    np.testing.assert_array_equal(eager.runs, one.runs)
    np.testing.assert_allclose(batch.scale[0], one.scale, rtol=1e-10)
    np.testing.assert_allclose(eager.offset, one.offset, rtol=1e-10)
    turned = RUN(source[::-1], reference)
    np.testing.assert_array_equal(batch.runs[1], turned.runs)
    np.testing.assert_allclose(batch.energy[1], turned.energy, rtol=1e-10)
    np.testing.assert_array_equal(source, kept[0])
    np.testing.assert_array_equal(reference, kept[1])


def test_static_trouble_names_the_argument(found):
    source, reference = clips(6, 20)
    with pytest.raises(ValueError, match="slope=2; want at least 4"):
        motion_warping(source, reference, slope=2)
    with pytest.raises(ValueError, match=r"\(6, 3\) and reference \(20, 2\)"):
        motion_warping(source, reference[:, :2])
    for wrong in (0.0, 1e-3, 1e15, np.nan):
        with pytest.raises(ValueError, match=f"scale_smoothness={wrong}, .*want both from 0.02 to"):
            motion_warping(
                *(x.astype(np.float32) for x in (source, reference)),
                scale_smoothness=wrong,
                slope=4,
            )
    source[3, 1] = np.nan
    with pytest.raises(Exception, match="motion_warping: source and reference must be finite"):
        motion_warping(source, reference)
    with pytest.raises(ValueError, match="warped has 6 frames; want 36"):
        unwarp(source, found)
    with pytest.raises(ValueError, match="rotations=True"):
        unwarp(np.zeros((36, 3)), found, rotations=True)


@pytest.mark.parametrize("count", [0, -1, 2.5, None])
def test_at_least_one_iteration(count):
    """None at all died in the middle."""
    x = np.random.default_rng(0).normal(size=(12, 2))
    message = f"motion_warping: max_iterations={count}; want a whole number of at least 1"
    with no_shape_checks(), pytest.raises(ValueError, match=message):
        motion_warping(x, x, max_iterations=count)
    with no_shape_checks(), pytest.raises(ValueError, match=r"slope=2\.5; want at least 1, whole"):
        motion_warping(x, x, slope=2.5)
    once = motion_warping(x, x, max_iterations=1)
    assert once.energy.shape == (2,)
