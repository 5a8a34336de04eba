"""Clips at a few sizes."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxmotion.frames.padding import bucket_size, in_buckets


def test_clips_are_padded_by_their_last_frame():
    clip = np.arange(34.0).reshape(17, 2)
    padded, other = in_buckets(clip, jnp.asarray(clip[:5]), size=bucket_size)
    assert (len(padded), len(other)) == (bucket_size(17), bucket_size(5)) == (24, 16)
    np.testing.assert_array_equal(padded[:17], clip)
    np.testing.assert_array_equal(padded[17:], np.tile(clip[-1], (7, 1)))
    assert isinstance(other, np.ndarray)


def test_one_frame_and_traced_clips_stay():
    assert in_buckets(np.ones((1, 3)))[0].shape == (1, 3)
    assert jax.eval_shape(lambda x: in_buckets(x)[0], jnp.ones((5, 3))).shape == (5, 3)
