"""Run-time checks: what they say, of which element of a batch; programs without them travel."""

import os
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import Motion, checks, decompose, denoise, quaternion, resample, samples, stylize
from jaxmotion._checks import counted, one_number, one_of, poisoned, raise_faults, require
from jaxmotion.contacts import ContactPoints, Contacts, cleanup_root, detect
from jaxmotion.layers import time_warp
from jaxmotion.multiresolution import build_pyramid, filter_motion
from jaxmotion.smoothing import (
    StreamingSmoother,
    geodesic,
    lgs,
    outlier_weights,
    suggest_keys,
    tune,
    windowed_lgs,
)
from jaxmotion.spacetime import restore
from jaxmotion.timing import align, dtw, motion_warping, soft_dtw
from tests.helpers import no_shape_checks, random_skeleton


def clip(seed=0, frames=12, joints=3, dtype=np.float64) -> Motion:
    rng = np.random.default_rng(seed)
    turns = np.cumsum(0.1 * rng.standard_normal((frames, joints, 3)), axis=0)
    turns += 0.02 * rng.standard_normal(turns.shape)
    skeleton = random_skeleton(np.random.default_rng(1), joints, dtype=dtype)
    path = jnp.asarray(np.cumsum(rng.standard_normal((frames, 3)), axis=0), dtype)
    return Motion.from_root(skeleton, path, quaternion.exp(jnp.asarray(turns, dtype)), 1 / 30)


def stacked(clips):
    return jax.tree.map(lambda *x: jnp.stack(x), *clips)


def computed(tree):
    """Floating-point arrays that depend on the data."""
    if isinstance(tree, Motion):
        return [tree.rotations, tree.translations[..., list(tree.translated_joints), :]]
    return [x for x in jax.tree.leaves(tree) if jnp.issubdtype(x.dtype, jnp.inexact)]


def total(x, limit):
    """A function with two checks."""
    faults = [(jnp.any(x < 0), "x is negative"), (jnp.sum(x) > limit, "x is too much")]
    return jnp.sum(raise_faults(x, faults))


def fault_of(f, *args) -> str:
    with pytest.raises(eqx.EquinoxRuntimeError) as caught:
        jax.block_until_ready(eqx.filter_jit(f)(*args))
    (line,) = (x for x in str(caught.value).splitlines() if "RuntimeError: x is" in x)
    return line.split("Error: ")[1]


def test_a_fault_is_the_error_the_first_of_several():
    assert total(jnp.ones(3), 5.0) == 3
    assert fault_of(total, -jnp.ones(3), 5.0) == "x is negative"
    assert fault_of(total, jnp.ones(3), 2.0) == "x is too much"
    assert fault_of(total, -jnp.ones(3), -4.0) == "x is negative"
    with pytest.raises(jax.errors.JaxRuntimeError, match="x is too much"):
        jax.block_until_ready(jax.jit(total)(jnp.ones(3), 2.0))


def test_the_element_of_a_batch_is_named():
    x = jnp.ones((4, 3)).at[2, 1].set(-1)
    many = jax.vmap(total, (0, None))
    assert fault_of(many, x, 5.0) == "x is negative (batch element 2 of 4)"
    assert fault_of(many, x, 2.0) == "x is too much (batch element 0, and 3 more of 4)"
    x = jnp.ones((2, 4, 3)).at[1, 3].set(2)
    of_many = jax.vmap(many, (0, None))
    assert fault_of(of_many, x, 5.0) == "x is too much (batch element (1, 3) of 8)"
    limits = jax.vmap(total, (None, 0))
    message = "x is too much (batch element 1 of 2)"
    assert fault_of(limits, jnp.ones(3), jnp.array([5.0, 2])) == message
    looped = jax.vmap(lambda x: jax.lax.fori_loop(0, 3, lambda _, s: s + total(x, 5.0), 0.0))
    assert fault_of(looped, x[1]) == "x is too much (batch element 3 of 4)"


def test_of_a_faulty_element_only_the_results_become_nan():
    x = jnp.ones((4, 3)).at[2, 1].set(-1)
    with checks("nan"):
        got = jax.jit(jax.vmap(total, (0, None)))(x, 5.0)
        np.testing.assert_array_equal(got, [3, 3, np.nan, 3])
        whole = raise_faults((jnp.arange(2), x), [(jnp.asarray(True), "")])
    np.testing.assert_array_equal(whole[0], [0, 1])
    assert np.all(np.isnan(whole[1]))
    with checks("off"):
        np.testing.assert_array_equal(jax.vmap(total, (0, None))(x, 5.0), [3, 3, 1, 3])


def test_a_branch_not_taken_leaves_nothing():
    def f(x):
        return jax.lax.cond(x[0] > 0, lambda: total(x, 5.0), lambda: 7.0)

    with checks("nan"):
        np.testing.assert_array_equal(jax.vmap(f)(jnp.array([[1.0], [-1]])), [1, 7])


def test_another_setting_is_traced_again():
    traces = []

    @jax.jit
    def f(x):
        traces.append(x)
        return total(x, 5.0)

    x = -jnp.ones(3)
    for mode, result in (("nan", np.nan), ("off", -3), ("nan", np.nan), ("off", -3)):
        with checks(mode):
            np.testing.assert_array_equal(f(x), result)
    assert len(traces) == 2
    with pytest.raises(jax.errors.JaxRuntimeError, match="x is negative"):
        jax.block_until_ready(f(x))
    with no_shape_checks(), pytest.raises(ValueError, match="mode='quiet'; expected 'raise'"):
        checks("quiet").__enter__()


def test_derivatives_pass_a_check_as_they_are():
    for mode in ("raise", "nan", "off"):
        with checks(mode):
            x = jnp.ones(3)
            np.testing.assert_array_equal(jax.grad(total)(x, 5.0), x)
            np.testing.assert_array_equal(jax.jvp(lambda x: total(x, 5.0), (x,), (x,))[1], 3)
            np.testing.assert_array_equal(jax.vmap(jax.jacfwd(total), (0, None))(x[None], 5.0), [x])


def test_what_is_known_is_a_value_error_in_every_mode():
    for mode in ("raise", "nan", "off"):
        with checks(mode):
            for bad in (True, np.True_, jnp.asarray(True)):
                with pytest.raises(ValueError, match="x is odd, got 3"):
                    require(3, bad, "x is odd", got=3)
            assert require(3, jnp.asarray(False), "") == 3
    assert poisoned(3.0, [(jnp.asarray(True), "")]) == 3


def test_a_choice_is_one_of_those_there_are():
    for value in ("fast", None, 1, jnp.asarray(1), np.array(["dtw"])):
        with pytest.raises(ValueError, match=r"align: method=.*; expected 'dtw' or 'warping'"):
            one_of("align: method", value, ("dtw", "warping"))
    for value in (None, True, "either"):
        one_of("open_end", value, (None, True, "either"))
    with pytest.raises(ValueError, match="expected 'only'"):
        one_of("x", "other", {"only": 1})


@pytest.mark.parametrize("kind", [int, np.int64, np.asarray, jnp.asarray])
def test_how_many_frames_count(kind):
    assert int(counted("f: length", kind(5), 5)[0]) == 5
    for wrong in (-3, 0, 6):
        with pytest.raises(
            ValueError, match=rf"f: length must be .* 1 to the 5 frames.*got {wrong}"
        ):
            counted("f: length", kind(wrong), 5)


def test_how_many_frames_count_may_be_left_out_and_is_whole():
    x = np.ones(3)
    length, same = counted("f: length", None, 7, x)
    assert (int(length), length.dtype) == (7, np.int32)
    assert same is x
    assert int(counted("f: length", 4.0, 7)[0]) == 4
    for wrong in (2.5, [1, 2], jnp.arange(2)):
        with no_shape_checks(), pytest.raises(ValueError, match="must be a whole number"):
            counted("f: length", wrong, 7)
    with pytest.raises(ValueError, match="must be a whole number"):
        jax.jit(lambda n: counted("f: length", n, 7)[0])(2.0)


_TIMES = np.arange(12.0)
_ROWS = np.random.default_rng(2).normal(size=(12, 2))
_COST = np.random.default_rng(0).uniform(1, 2, (5, 6))


def _paused():
    """A walk of 12 frames with its feet."""
    motion = clip(joints=4)
    points = ContactPoints(motion.skeleton, [3])
    return motion, Contacts(points, np.ones((12, 1), bool), np.zeros((12, 1, 3)))


# Wrong in silence once: what each function was given, and what it says now.
_KNOWN = {
    "gamma": lambda one: decompose(clip(), gamma=one(5.0)),
    "gamma below": lambda one: decompose(clip(), gamma=one(-1.0)),
    "smoothing": lambda one: resample(clip(), num_frames=8, smoothing=one(-1.0)),
    "index": lambda one: resample(clip(), index=one(np.arange(12)[::-1]), num_frames=12),
    "temperature": lambda one: soft_dtw(cost=_COST, gamma=one(-1.0)),
    "settle": lambda one: align(clip(), clip(), settle=one(-1.0)),
    "mask": lambda one: filter_motion(clip(), one(np.array([0.5, 1.0, 0.5]))),
    "stream": lambda one: StreamingSmoother(one(-1.0), 1.0),
    "lam": lambda one: lgs(_TIMES, one(-1.0), 1.0),
    "weights": lambda one: lgs(_TIMES, 1.0, 1.0, weights=one(-_TIMES)),
    "index of lgs": lambda one: lgs(_TIMES, 1.0, 1.0, index=one(_TIMES + 1), num_frames=12),
    "rate": lambda one: samples.drop_frames(clip(), jax.random.key(0), rate=one(1.5)),
    "noise": lambda one: samples.add_noise(clip(), jax.random.key(0), rotation=one(-1.0)),
    "length of decompose": lambda one: decompose(clip(), length=one(99)),
    "length of denoise": lambda one: denoise(clip(), length=one(0)),
    "length of detect": lambda one: detect(clip(), length=one(99)),
    "no length of detect": lambda one: detect(clip(), length=one(0)),
    "length of a pyramid": lambda one: build_pyramid(clip(), 2, length=one(99)),
    "negative length": lambda one: build_pyramid(clip(), 2, length=one(-3)),
    "times of padding": lambda one: build_pyramid(clip(), times=one(0 * _TIMES), length=12),
    "length of signs": lambda one: quaternion.least_energy_signs(clip().rotations, length=one(0)),
    "x_length": lambda one: dtw(cost=_COST, x_length=one(99)),
    "y_length": lambda one: soft_dtw(cost=_COST, y_length=one(99)),
    "length of contacts": lambda one: restore(*_paused(), length=one(99)),
    "length of root": lambda one: cleanup_root(*_paused(), length=one(99)),
    "stiffness": lambda one: lgs(_TIMES, 1.0, 1.0, stiffness=one(-_TIMES)),
    "stiffness of geodesic": lambda one: geodesic(
        clip().rotations, 1.0, 1.0, stiffness=one(-_TIMES)
    ),
    "weight of a stream": lambda one: (smoother := StreamingSmoother(1.0, 1.0)).step(
        smoother.init(_TIMES), _TIMES, one(-1.0)
    ),
    "weights of outliers": lambda one: outlier_weights(_TIMES, weights=one(_TIMES - 5)),
    "weights of tuning": lambda one: tune(_TIMES, weights=one(_TIMES - 5)),
    "index of tuning": lambda one: tune(_TIMES, index=one(_TIMES + 1), num_frames=12),
    "weights of decompose": lambda one: decompose(clip(), weights=one(_TIMES - 5)),
    "lam_c": lambda one: decompose(clip(), lam_c=one(-1.0)),
    "lam of denoise": lambda one: denoise(clip(), lam=one(-1.0)),
    "tolerance": lambda one: motion_warping(_ROWS, _ROWS, tolerance=one(-1.0)),
    "frame time": lambda one: clip().replace(frame_time=one(-1.0)),
    "no frame time": lambda one: clip().replace(frame_time=one(0.0)),
}


@pytest.mark.parametrize("what", _KNOWN)
def test_what_is_known_to_be_wrong_is_a_value_error(what):
    """Of Python (where it is one number), NumPy and JAX alike."""
    for array in (lambda x: x, np.asarray, jnp.asarray):
        with pytest.raises(ValueError, match=r"must|expected|want"):
            _KNOWN[what](array)
    with pytest.raises(ValueError, match=r"must|expected|want"):  # while something else is traced
        jax.eval_shape(lambda _: (_KNOWN[what](lambda x: x), 0.0)[1], 0.0)


def test_lengths_of_dtw_are_those_there_are():
    """x_length=99 of 5 frames once gave less than the least there is."""
    x, y = np.random.default_rng(0).normal(size=(2, 5, 3))
    for f in (dtw, soft_dtw):
        with pytest.raises(ValueError, match=rf"{f.__name__}: x_length must be"):
            f(x, y, x_length=99)
    padded = np.concatenate([x, np.full((3, 3), 50.0)])
    assert dtw(padded, y, x_length=jnp.asarray(5)).cost == dtw(x, y).cost


def test_keys_that_are_known_need_no_number_of_frames():
    index = np.arange(12) * 2.0
    found = resample(clip(), index=jnp.asarray(index))
    np.testing.assert_array_equal(found.rotations, resample(clip(), index=index).rotations)


# Every public function with a check of its own: what it computes from a faulty element, a fault.
def _keys(allowed):
    return suggest_keys(lgs(jnp.arange(6.0) ** 2, 1.0, 1.0), 2, candidates=allowed).variance


def _stream(weight):
    smoother = StreamingSmoother(2.0, 0.5, lag=2)
    frames = jnp.arange(8.0) ** 2
    state, late = jax.lax.scan(
        lambda s, y: smoother.step(s, y, weight), smoother.init(frames[0]), frames
    )
    return late, smoother.flush(state)


def _pyramid(times):
    return build_pyramid(clip(), 1, times=times).base.rotations


def _timed(method):
    return lambda pairs: time_warp(clip(), pairs=pairs, num_frames=12, method=method)


_SITES = {
    "lgs": (lambda s: lgs(jnp.arange(5.0), 1.0, s).mean, jnp.asarray(1.0), jnp.asarray(-1.0)),
    "keys": (_keys, jnp.ones(6, bool), jnp.arange(6) < 1),
    "stream": (_stream, jnp.asarray(1.0), jnp.asarray(-1.0)),
    "pairs": (_timed("lgs"), jnp.array([[0.1, 0.2]]), jnp.array([[0.1, -0.2]])),
    "pairs by slerp": (_timed("slerp"), jnp.array([[0.1, 0.2]]), jnp.array([[0.1, -0.2]])),
    "amount": (
        lambda a: time_warp(clip(), amount=a, num_frames=12),
        jnp.asarray(0.2),
        jnp.asarray(-0.2),
    ),
    "ease": (
        lambda e: time_warp(clip(), ease=(e, 0.0), num_frames=12),
        jnp.asarray(0.1),
        jnp.asarray(-0.1),
    ),
    "pyramid": (_pyramid, _TIMES, np.where(_TIMES == 5, 2.0, _TIMES)),
    "times of padding": (
        lambda t: build_pyramid(clip(), 1, times=t, length=6).base.rotations[:4],
        _TIMES,
        np.where(_TIMES == 3, 0.0, _TIMES),
    ),
    "length of a pyramid": (
        lambda n: build_pyramid(clip(), 1, length=n).base.rotations,
        jnp.asarray(12),
        jnp.asarray(99),
    ),
    "gamma": (lambda g: decompose(clip(), gamma=g).base, jnp.asarray(1.0), jnp.asarray(5.0)),
    "smoothing": (
        lambda s: resample(clip(), num_frames=8, smoothing=s).rotations,
        jnp.asarray(1.0),
        jnp.asarray(-1.0),
    ),
    "index": (
        lambda i: resample(clip(), index=i, num_frames=14).rotations,
        _TIMES,
        _TIMES[::-1],
    ),
    "settle": (
        lambda s: align(clip(), clip(1), settle=s).motion.rotations,
        jnp.asarray(1.0),
        jnp.asarray(-1.0),
    ),
    "mask": (
        lambda m: filter_motion(clip(), m).rotations,
        jnp.array([0.25, 0.5, 0.25]),
        jnp.array([0.5, 1.0, 0.5]),
    ),
    "temperature": (
        lambda g: soft_dtw(cost=_COST, gamma=g),
        jnp.asarray(1.0),
        jnp.asarray(-1.0),
    ),
    "x_length": (lambda n: dtw(cost=_COST, x_length=n).cost, jnp.asarray(3), jnp.asarray(99)),
    "y_length": (lambda n: soft_dtw(cost=_COST, y_length=n), jnp.asarray(3), jnp.asarray(0)),
    "length of signs": (
        lambda n: quaternion.least_energy_signs(clip().rotations, length=n),
        jnp.asarray(12),
        jnp.asarray(0),
    ),
    "rate": (
        lambda r: samples.flip_signs(clip(), jax.random.key(0), rate=r).motion.rotations,
        jnp.asarray(0.5),
        jnp.asarray(1.5),
    ),
}


@pytest.mark.parametrize("site", _SITES)
def test_every_check_spoils_its_element_and_no_other(site):
    f, fine, wrong = _SITES[site]
    with checks("nan"):
        alone = jax.jit(f)(fine)
        both = jax.jit(jax.vmap(f))(jnp.stack([fine, wrong]))
    for want, got in zip(computed(alone), computed(both), strict=True):
        np.testing.assert_allclose(got[0], want, 1e-9, 1e-9)
        assert np.all(np.isnan(got[1])), got[1]


def _geodesic(motion):
    return geodesic(motion.rotations, 5.0, 0.1).mean


_WHOLE = {
    "denoise": denoise,
    "decompose": lambda m: (lambda layers: (layers.base, layers.control))(decompose(m)),
    "stylize": lambda m: stylize(m, 1.5),
    "geodesic": _geodesic,
}


def _whole(rare):
    """Every one of them, the rare where a sweep is asked for."""
    return pytest.mark.parametrize(
        "name", [pytest.param(x, marks=pytest.mark.sweep if x in rare else ()) for x in _WHOLE]
    )


@pytest.mark.slow
@_whole(rare=("geodesic", "decompose"))  # its checks are met below; stylize decomposes
def test_a_bad_clip_names_itself_and_leaves_the_others_alone(name):
    f = eqx.filter_jit(jax.vmap(_WHOLE[name]))
    clips = [clip(seed) for seed in range(3)]
    fine = stacked(clips)
    broken = fine.with_transforms(rotations=fine.rotations.at[1, 4, 1].set(jnp.nan))
    with checks("nan"):
        want, got = f(fine), f(broken)
    parts = want if isinstance(want, tuple) else (want,), got if isinstance(got, tuple) else (got,)
    for whole, part in zip(*parts, strict=True):
        for x, y in zip(computed(whole), computed(part), strict=True):
            np.testing.assert_array_equal(y[::2], x[::2])
            assert np.all(np.isfinite(x))
            assert np.all(np.isnan(y[1]))
    with pytest.raises(eqx.EquinoxRuntimeError, match=r"\(batch element 1 of 3\)"):
        jax.block_until_ready(f(broken))


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [pytest.param(np.float32, marks=pytest.mark.sweep), np.float64])
@_whole(rare=("decompose",))  # denoise and stylize do
def test_programs_without_callbacks_are_exported(name, dtype):
    motion = clip(dtype=dtype)

    def f(translations, rotations):
        return computed(_WHOLE[name](motion.with_transforms(translations, rotations)))

    if name == "decompose":

        def f(translations, rotations):
            layers = decompose(motion.with_transforms(translations, rotations))
            return computed(layers.base) + computed((layers.control, layers.residual))

    def values_and_slope(call):
        """What ``call`` computes and how the first of it changes with the rotations, compiled."""

        def weighed(rotations):
            found = call(motion.translations, rotations)
            return jnp.sum(found[0] ** 3), found

        return jax.jit(jax.grad(weighed, has_aux=True))(motion.rotations)

    with checks("nan"):
        exported = jax.export.export(jax.jit(f))(motion.translations, motion.rotations)
        slope, want = values_and_slope(f)
    pytest.importorskip("flatbuffers", reason="exported programs are written with flatbuffers")
    again = jax.export.deserialize(exported.serialize(vjp_order=1))
    got_slope, got = values_and_slope(again.call)
    for x, y in zip(want, got, strict=True):
        assert y.dtype == dtype
        np.testing.assert_allclose(y, x, rtol=0, atol=64 * np.finfo(dtype).eps)
    np.testing.assert_allclose(got_slope, slope, 0, 1e4 * np.finfo(dtype).eps)


_CACHED = """
import sys
import jax
import numpy as np
jax.config.update("jax_compilation_cache_dir", sys.argv[1])
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
hits = []
jax.monitoring.register_event_listener(lambda name, **_: hits.append(name))
import jaxmotion
from jaxmotion.smoothing import lgs
f = jax.jit(lambda y: lgs(y, 1.0, 1.0).mean)
y = np.ones((20, 3), np.float32)
hits.clear()
with jaxmotion.checks(sys.argv[2]):
    f.lower(y).compile()
print(hits.count("/jax/compilation_cache/cache_hits"))
"""


def _alone(script, *args, **variables):
    run = subprocess.run(
        [sys.executable, "-c", script, *args],
        env=os.environ | variables,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout.strip()


def test_the_compilation_cache_keeps_programs_without_callbacks(tmp_path):
    hits = [_alone(_CACHED, str(tmp_path), mode) for mode in ("nan", "nan", "raise", "raise")]
    assert hits == ["0", "1", "0", "0"]


def test_the_environment_sets_what_holds_elsewhere():
    script = """
import jax, numpy as np
from jaxmotion.smoothing import lgs
print(np.isnan(jax.vmap(lambda s: lgs(np.ones(4), 1.0, s).mean)(np.array([1.0, -1]))).all(axis=1))
"""
    assert _alone(script, EQX_ON_ERROR="nan") == "[False  True]"


_MESH = """
import jax
jax.config.update("jax_num_cpu_devices", 2)
import numpy as np
import jaxmotion
from jax.sharding import NamedSharding, PartitionSpec
from jaxmotion.smoothing import lgs
mesh = jax.make_mesh((2,), ("clip",), axis_types=(jax.sharding.AxisType.Explicit,))
y = np.ones((4, 12, 3), np.float32)
y[3, 1] = np.nan
spread = jax.device_put(y, NamedSharding(mesh, PartitionSpec("clip")))
f = jax.jit(jax.vmap(lambda y: lgs(y, 1.0, 1.0).mean))
with jax.set_mesh(mesh):
    with jaxmotion.checks("nan"):
        smooth = f(spread)
    assert smooth.sharding.spec[0] == "clip", smooth.sharding
    whole = np.asarray(smooth)
np.testing.assert_allclose(whole[:3], 1, rtol=1e-5)
assert np.isnan(whole[3]).all()
axis = PartitionSpec("clip")
f = jax.vmap(lambda y: lgs(y, 1.0, 1.0).mean)
f = jax.jit(jax.shard_map(f, mesh=mesh, in_specs=axis, out_specs=axis, check_vma=False))
with jaxmotion.checks("nan"):
    np.testing.assert_array_equal(np.asarray(f(spread)), whole)
print("done")
"""


def test_explicit_meshes_are_taken_by_the_batch_axis():
    assert _alone(_MESH) == "done"


def _turns(frame):
    """Rotations of a clip, one of which is spoilt."""
    return clip().rotations.at[frame, 1].multiply(jnp.nan)


# Data known to hold NaN: what takes them, and how it says where.
_HOLES = {
    "lgs": (lambda one: lgs(one(np.where(_TIMES == 5, np.nan, _TIMES)), 1.0, 1.0), r"y .* \[5\]"),
    "windows": (
        lambda one: windowed_lgs(np.where(_TIMES == 5, np.inf, _TIMES), 1.0, 1.0, window=8),
        "y holds",
    ),
    "geodesic": (lambda one: geodesic(one(_turns(5)), 1.0, 0.1), "geodesic: q holds NaN"),
    "not unit": (
        lambda one: geodesic(one(1.1 * clip().rotations), 1.0, 0.1),
        "geodesic: q .* unit",
    ),
    "outliers": (lambda one: outlier_weights(one(_turns(5))), r"outlier_weights: y .* \[5, 1, 0\]"),
    "tuning": (lambda one: tune(one(_turns(5))), r"tune: y holds"),
    "decompose": (
        lambda one: decompose(clip().with_transforms(rotations=one(_turns(5)))),
        r"decompose: motion.rotations of 'joint1' at frame 5 are not finite; .* weight 0\)",
    ),
    "denoise": (
        lambda one: denoise(clip().with_transforms(rotations=one(_turns(5)))),
        "denoise: motion.rotations of 'joint1' at frame 5 are",
    ),
    "outliers of a motion": (
        lambda one: outlier_weights(clip().with_transforms(rotations=one(_turns(5)))),
        "outlier_weights: y.rotations of 'joint1' at frame 5 are",
    ),
    "warping": (
        lambda one: motion_warping(one(np.nan * _ROWS), _ROWS),
        "motion_warping: source and reference must be finite",
    ),
}


@pytest.mark.parametrize("what", _HOLES)
def test_data_known_to_be_no_numbers_are_a_value_error(what):
    """A run-time error once, whatever was known."""
    call, message = _HOLES[what]
    for array in (np.asarray, jnp.asarray):
        with pytest.raises(ValueError, match=message):
            call(array)


def test_data_that_are_missing_may_be_no_numbers():
    there = np.where(_TIMES == 5, 0.0, 1.0)
    holed = np.where(there, 0.1 * _TIMES, np.nan)
    assert jnp.isfinite(lgs(holed, 1.0, 1.0, weights=there).mean).all()
    motion = clip().with_transforms(rotations=_turns(5))
    assert jnp.isfinite(geodesic(motion.rotations, 1.0, 0.1, weights=there).mean).all()
    assert jnp.isfinite(denoise(motion, weights=there).rotations[there > 0]).all()


def test_what_cannot_be_used_is_refused():
    """Ignored in silence once."""
    calls = [
        (
            lambda: align(clip(), clip(), method="warping", window=3),
            "align: method='warping' takes",
        ),
        (
            lambda: align(clip(), clip(), method="warping", step_pattern="x"),
            "takes no step_pattern",
        ),
        (lambda: dtw(cost=_COST, min_matched=2), "dtw: min_matched=2 is of an open end"),
        (lambda: decompose(clip(), tune="gcv", lam_c=2.0), "decompose: tune= learns"),
        (
            lambda: resample(clip(), num_frames=8, method="slerp", smoothing=1.0),
            "resample: method='slerp' takes no smoothing=",
        ),
        (
            lambda: time_warp(clip(), amount=0.5, method="cubic", smoothing=np.ones(3)),
            "resample: method='cubic' takes no smoothing=",
        ),
    ]
    for call, message in calls:
        with pytest.raises(ValueError, match=message):
            call()


def test_single_numbers():
    """Of any kind, traced too; an array of one is an array."""
    for value in (2, 2.0, np.float32(2), jnp.asarray(2.0)):
        assert one_number("f: x", value) == 2
    assert jax.jit(lambda x: one_number("f: x", x) + 1)(2.0) == 3
    for array in ([2.0], np.ones((1,)), jnp.ones((2, 3))):
        with pytest.raises(ValueError, match=r"^f: x has shape \(.*\); expected one number$"):
            one_number("f: x", array)
    calls = {
        "decompose: gamma": lambda two: decompose(clip(), gamma=two),
        "stylize: gamma": lambda two: stylize(clip(), 1.0, gamma=two),
    }
    for name, call in calls.items():
        with no_shape_checks(), pytest.raises(ValueError, match=f"^{name} has shape"):
            call(np.ones(2))
