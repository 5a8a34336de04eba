"""Iterative motion warping of clips of many lengths: the same numbers from few programs."""

import numpy as np
import pytest

from jaxmotion.timing import motion_warping
from tests.helpers import by_precision, compilations
from tests.timing.test_motion_warping import RUN, clips


def noisy(num_source, num_reference, dtype=np.float64):
    rng = np.random.default_rng(num_source)
    return (
        (x + 0.1 * rng.standard_normal(x.shape)).astype(dtype)
        for x in clips(num_source, num_reference)
    )


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize(
    ("sizes", "dtype"),
    by_precision(
        [(12, 18), (31, 20), (128, 100), (100, 128), (1, 2), (2, 1)], single=[(31, 20), (1, 2)]
    ),
)
def test_the_numbers_are_those_of_the_clips_own_sizes(sizes, shared, dtype):
    """Under ``jit`` nothing is padded; 128 is a size of a program itself."""
    source, reference = noisy(*sizes, dtype)
    want = RUN(source, reference, shared=shared)
    got = motion_warping(source, reference, shared=shared)
    for name in ("runs", "source_index", "reference_index", "is_new_pair", "iterations"):
        np.testing.assert_array_equal(getattr(got, name), getattr(want, name), err_msg=name)
    assert (got.num_refined, got.repeats) == (want.num_refined, want.repeats)
    assert bool(np.all(got.converged == want.converged))
    close = 1e-4 if dtype == np.float32 else 1e-11
    for name in ("scale", "offset", "energy"):
        found, wanted = getattr(got, name), getattr(want, name)
        assert found.dtype == dtype
        np.testing.assert_allclose(found, wanted, close, close, err_msg=name)


def test_a_clip_that_is_there_at_once_stays_so():
    """Frames that do not count move nothing, from the first round on."""
    source, _ = noisy(15, 15)
    warp = motion_warping(source, source)
    assert int(warp.iterations) == int(RUN(source, source).iterations) == 1


def test_many_lengths_share_a_program():
    motion_warping(*noisy(12, 18))
    pairs = [list(noisy(*sizes)) for sizes in ((13, 18), (31, 20), (127, 90))]
    with compilations() as compiled:
        found = [motion_warping(*pair) for pair in pairs]
    assert not compiled
    assert [warp.num_refined for warp in found] == [36, 40, 180]


def test_the_slope_is_that_of_the_lengths():
    """Not of the sizes at which they are computed, which agree."""
    assert motion_warping(*noisy(10, 25)).repeats == 3
    with pytest.raises(ValueError, match="slope=2; want at least 3"):
        motion_warping(*noisy(10, 25), slope=2)
