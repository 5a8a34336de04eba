"""Eager calls at one of a few sizes: the same numbers, and nothing is compiled for more lengths."""

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import contacts, multiresolution, spacetime
from jaxmotion._room import Room, room_for
from jaxmotion.frames.padding import program_size
from tests.helpers import assert_trees_close, compilations


@pytest.fixture(scope="module")
def walk():
    clip = jm.samples.walk(60, fps=30.0).motion
    return clip.astype(np.float64)


@pytest.fixture(scope="module")
def compiled():
    """The programs that were compiled so far."""
    with compilations() as names:
        yield names


def _restored(motion):
    return spacetime.restore(motion, contacts.detect(motion))


def _planted(motion):
    """A body whose root goes on faster than its feet."""
    faster = np.array(motion.translations)
    faster[:, 0] *= 1.05
    slid = motion.with_transforms(faster)
    return contacts.cleanup_footskate(slid, contacts.replant(slid, contacts.detect(motion)))


def _weighted(motion):
    weights = np.ones((len(motion), motion.num_joints))
    weights[3:6, 2:5] = 0
    return jm.denoise(motion, weights=weights, strength=0.5 + 0.5 * weights)


def _styled(motion):
    return jm.stylize(motion, np.linspace(0, 2, len(motion))[:, None])


CALLS = {
    "denoise": jm.denoise,
    "denoise weighted": _weighted,
    "decompose": jm.decompose,
    "stylize": _styled,
    "detect": contacts.detect,
    "pyramid": multiresolution.build_pyramid,
    "lazy pyramid": lambda motion: multiresolution.build_pyramid(motion, 3, lazy=True),
    "restore": _restored,
    "cleanup": _planted,
    "resample": lambda motion: jm.resample(motion, fps=24.0),
    "time_warp": lambda motion: jm.time_warp(motion, amount=0.3),
}

LONG = "restore", "denoise"  # others call all that these do


@pytest.mark.parametrize(
    "call",
    [pytest.param(call, marks=pytest.mark.sweep if call in LONG else ()) for call in CALLS],
)
def test_the_numbers_are_those_of_the_clips_own_size(walk, compiled, call):
    """Also for another length, for which nothing is compiled."""
    function, clip, other = CALLS[call], walk[:41], walk[:57]
    with jm.buckets(False):
        want = function(clip)
    assert_trees_close(function(clip), want, 1e-12, 1e-12)
    compiled.clear()
    function(other)
    assert not compiled


def test_sizes():
    lengths = 2, 128, 129, 2048, 2049, 2400, 4097
    assert [program_size(n) for n in lengths] == [128, 128, 512, 2048, 3072, 3072, 6144]


def test_what_gets_no_room(walk):
    assert room_for(walk[0]) == Room(1)
    assert room_for(walk, length=9) == Room(60)
    assert room_for(walk) == Room(60, 128)
    assert room_for(walk, longest=59) == Room(60)
    with jm.buckets(False):
        assert room_for(walk) == Room(60)
    seen = []
    jax.jit(lambda x: seen.append(room_for(walk, x)) or x)(1.0)
    assert seen == [Room(60)]


def test_single_precision_stays(walk):
    found = jm.denoise(walk[:20].astype(np.float32))
    assert found.dtype == found.translations.dtype == np.float32
