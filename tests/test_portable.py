"""Copies, pickles and maps of results are what they were; equality and hashes agree.

Pickles keep every digit, also where 64-bit types are off; sizes are those of the arrays.
"""

import copy
import pickle
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import Motion, Skeleton, contacts, metrics
from jaxmotion._file_facts import FileFact
from jaxmotion._portable import Portable
from jaxmotion.displacement import minus
from jaxmotion.spacetime import Weights
from tests.helpers import random_motion, random_skeleton, single_precision
from tests.results import NAMES, example, motion

_READER = """
import pickle, sys
import jax
import numpy as np
motion = pickle.load(sys.stdin.buffer)
assert not jax.config.jax_enable_x64
held = np.ndarray if motion.dtype == np.float64 else jax.Array
assert isinstance(motion.rotations, held), type(motion.rotations)
sys.stdout.buffer.write(pickle.dumps(motion[1:]))
"""


def _same(a, b):
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert type(x) is type(y)
        assert x.dtype == y.dtype
        np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize(
    "travel", [copy.copy, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))]
)
def test_copies_and_pickles_are_what_they_were(travel, dtype):
    motion = random_motion(np.random.default_rng(0), dtype=dtype)
    assert isinstance(motion.skeleton.offsets, np.ndarray)  # NumPy's stay NumPy's
    _same(travel(motion), motion)
    _same(travel(minus(motion, motion)), minus(motion, motion))


def test_copies_are_made_of_traced_motions_too():
    motion = random_motion(np.random.default_rng(0))
    turned = jax.jit(lambda m: copy.deepcopy(copy.copy(m)))(motion)
    np.testing.assert_array_equal(turned.rotations, motion.rotations)


@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_digits_are_kept_where_64_bit_types_are_off(kind):
    motion = random_motion(np.random.default_rng(0), dtype=np.dtype(kind))
    answer = subprocess.run(
        [sys.executable, "-c", _READER], input=pickle.dumps(motion), capture_output=True, check=True
    )
    back = pickle.loads(answer.stdout)
    assert back.dtype == np.dtype(kind)
    np.testing.assert_array_equal(back.rotations, motion.rotations[1:])
    np.testing.assert_array_equal(back.translations, motion.translations[1:])


def test_arrays_are_sent_without_a_copy():
    motion = random_motion(np.random.default_rng(0), frames=50)
    buffers = []
    head = pickle.dumps(motion, protocol=5, buffer_callback=buffers.append)
    arrays = sum(leaf.nbytes for leaf in jax.tree.leaves(motion))
    assert sum(b.raw().nbytes for b in buffers) == arrays
    assert len(head) < 5000
    _same(pickle.loads(head, buffers=buffers), motion)


def test_the_size_is_that_of_the_arrays():
    motion = random_motion(np.random.default_rng(0), frames=1000)
    arrays = sum(leaf.nbytes for leaf in jax.tree.leaves(motion))
    assert arrays <= sys.getsizeof(motion) <= arrays + 500
    sizeof = pytest.importorskip("dask.sizeof", reason="no dask").sizeof
    assert arrays <= sizeof(motion) <= arrays + 500


def test_a_motion_through_dask_workers_keeps_its_digits():
    distributed = pytest.importorskip("distributed", reason="no dask.distributed")
    skeleton = random_skeleton(np.random.default_rng(0), 3)
    still = jnp.full((4, 3), 1 / 3, jnp.float64)
    motion = Motion.from_root(skeleton, still, jnp.ones((4, 3, 4)) / 2, 1 / 3)
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None
    )
    with cluster, distributed.Client(cluster) as client:
        enabled, back = client.submit(_seen, motion).result(timeout=120)
    assert not enabled
    assert back.dtype == np.float64
    np.testing.assert_array_equal(back.translations, motion.translations)


def _seen(motion):
    return bool(jax.config.jax_enable_x64), motion


# Every result

JOURNEYS = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda x: pickle.loads(pickle.dumps(x)),
    "map": lambda x: jax.tree.map(lambda leaf: leaf, x),
    "parts": lambda x: eqx.combine(*eqx.partition(x, eqx.is_array)),
}
# By identity, as scan asks of what its function belongs to.
ITSELF_ALONE = ("StreamingSmoother",)
# Plain tuples of arrays, which Python compares one by one.
TUPLES_OF_ARRAYS = ("Knowledge", "Information", "Gains", "State")


def _facts(thing):
    """What only files say, wherever it is in a module."""
    if isinstance(thing, FileFact):
        return [thing.value]
    values = vars(thing).values() if isinstance(thing, eqx.Module) else ()
    return [fact for value in values for fact in _facts(value)]


@pytest.mark.parametrize("travel", JOURNEYS.values(), ids=JOURNEYS)
def test_every_result_arrives_as_it_left(travel):
    for name in NAMES:
        thing = example(name)
        if name in MODULES:
            thing = jax.tree.map(np.asarray, thing)
        there = travel(thing)
        assert type(there) is type(thing)
        assert jax.tree.structure(there) == jax.tree.structure(thing), name
        for x, y in zip(jax.tree.leaves(there), jax.tree.leaves(thing), strict=True):
            assert type(x) is type(y), name
            np.testing.assert_array_equal(x, y)
        assert _facts(there) == _facts(thing)
        if name not in (*ITSELF_ALONE, *TUPLES_OF_ARRAYS):
            assert bool(there == thing), name
            assert not bool(there != thing), name
        assert repr(there) == repr(thing)


MODULES = [name for name in NAMES if isinstance(example(name), Portable)]


def test_every_module_is_portable_and_keeps_its_digits():
    """Where 64-bit types are off, too; those inside of a module that is sent as well."""
    assert [name for name in NAMES if isinstance(example(name), eqx.Module)] == MODULES
    sent = {name: pickle.dumps(example(name)) for name in MODULES}
    with single_precision():
        arrived = {name: pickle.loads(data) for name, data in sent.items()}
    for name, thing in arrived.items():
        there = [getattr(x, "dtype", None) for x in jax.tree.leaves(thing)]
        assert there == [getattr(x, "dtype", None) for x in jax.tree.leaves(example(name))], name


# Equality and hashes


def test_motions_are_equal_by_value():
    clip = motion()
    assert bool(clip == clip)
    assert bool(clip == copy.deepcopy(clip))
    assert bool(clip == jax.tree.map(np.asarray, clip))
    assert clip in [clip[1:], clip]
    assert clip != eqx.tree_at(lambda m: m.rotations, clip, -clip.rotations)
    assert clip != clip[1:]
    assert clip != clip.skeleton
    assert clip != 3
    with pytest.raises(TypeError, match="unhashable"):  # as any module of equinox with arrays
        hash(clip)


def test_what_is_equal_has_one_hash():
    """Facts of files tell nothing apart: not the static parts of two clips, which once had two."""
    clip = motion()
    spelt = clip.replace(frame_time_text="0.016667", skeleton=_as_from_another_file(clip.skeleton))
    arrays, static = eqx.partition(clip, eqx.is_array)
    _, other = eqx.partition(spelt, eqx.is_array)
    assert _facts(static) != _facts(other)
    assert static == other
    assert hash(static) == hash(other)
    assert hash(static) != hash(eqx.partition(clip[::2].skeleton, eqx.is_array)[1])
    traces = []

    def frames(arrays, static):
        traces.append(static)
        return eqx.combine(arrays, static).rotations.shape[0]

    counted = jax.jit(frames, static_argnums=1)
    assert counted(arrays, static) == counted(arrays, other) == 24
    assert len(traces) == 1


def _as_from_another_file(skeleton: Skeleton) -> Skeleton:
    return Skeleton(
        skeleton.names,
        skeleton.parents,
        skeleton.offsets,
        end_joints=skeleton.end_joints,
        end_offsets=skeleton.end_offsets,
        end_labels=["End site"] * len(skeleton.end_joints),
        encoding="gbk",
    )


def test_small_results_are_keys_of_dictionaries():
    for make in (
        lambda: contacts.Interval("toe", 2, 3, 17, "point", (0.1, 0.0, 2.0), 0.5),
        lambda: metrics.ContactScores(0.5, 1.0),
        lambda: metrics.Peak(0.5, 3, "toe", 0.1, 0.4),
        lambda: metrics.Difference(3, 2, *(metrics.Peak(0.5, 3, "toe", 0.1, 0.4),) * 3, None),
        lambda: metrics.Problem("spike", "it jumps", 3, 4, "toe"),
        Weights,
        lambda: copy.deepcopy(example("AsfBone")),
        lambda: copy.deepcopy(example("UpGuess")),
    ):
        assert {make(): 1}[make()] == 1
    bone = example("AsfBone")
    assert bone != type(bone)(length=2.0)
    assert Weights(position=2.0) != Weights()


def test_a_traced_result_can_be_copied_and_compared():
    seen = []

    @jax.make_jaxpr
    def traced(clip):
        copies = copy.copy(clip), copy.deepcopy(clip), jax.tree.map(lambda x: x, clip)
        seen.extend(repr(c) for c in copies)
        return [c == clip for c in copies]

    traced(motion())
    assert len(set(seen)) == 1
