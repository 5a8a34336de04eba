"""Runs of a warp where only the first frames count."""

import jax.numpy as jnp
import numpy as np

from jaxmotion.timing.runs import best_runs, run_sums, source_index
from tests.timing.test_motion_warping import dense_runs


def test_the_best_runs_of_the_frames_that_count():
    """Whatever stands beyond, as cheap as it may be."""
    rng = np.random.default_rng(0)
    d = rng.random((9, 11))
    for frames, reference in ((9, 11), (5, 7), (7, 5), (9, 6), (4, 11)):
        far = np.where((np.arange(9) < frames)[:, None] & (np.arange(11) < reference), d, -100.0)
        counts = jnp.arange(9) < frames
        got = np.asarray(best_runs(jnp.asarray(far), 3, counts, jnp.asarray(reference)))
        want, _ = dense_runs(np.repeat(d[:frames, :reference], 3, axis=1), 9)
        np.testing.assert_array_equal(got[:frames], want)
        np.testing.assert_array_equal(got[frames:], 0)


def test_what_is_past_the_last_run_is_the_last_frame_s():
    runs = jnp.array([2, 1, 3, 0, 0], jnp.int32)
    index = source_index(runs, num_refined=9)
    np.testing.assert_array_equal(index, [0, 0, 1, 2, 2, 2, 4, 4, 4])
    full = source_index(runs[:3], num_refined=8)
    np.testing.assert_array_equal(full, [0, 0, 1, 2, 2, 2, 2, 2])
    signal = jnp.where(jnp.arange(9) < 6, jnp.arange(9.0), 0.0)
    np.testing.assert_array_equal(run_sums(runs, signal), [1, 2, 12, 0, 0])
