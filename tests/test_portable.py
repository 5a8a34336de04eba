"""Pickles keep every digit, also where 64-bit types are off; sizes are those of the arrays."""

import copy
import pickle
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import Motion
from jaxmotion.displacement import minus
from tests.helpers import random_motion, random_skeleton

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
