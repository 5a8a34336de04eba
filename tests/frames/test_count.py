"""Which frames count."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.frames.count import counted_weights, frame_mask, step_mask


@pytest.mark.parametrize("count", [1, 3, 5])
def test_masks_are_of_the_first(count):
    want = np.array([i < count for i in range(5)])
    given = jnp.asarray(count, jnp.int32)
    np.testing.assert_array_equal(frame_mask(given, 5), want)
    np.testing.assert_array_equal(step_mask(given, 5), want[:-1] & want[1:])
    np.testing.assert_array_equal(jax.jit(frame_mask, static_argnums=1)(given, 5), want)


def test_masks_of_several_clips():
    mask = frame_mask(jnp.asarray([2, 4], jnp.int32), 5)
    np.testing.assert_array_equal(mask.sum(-1), [2, 4])
    np.testing.assert_array_equal(jax.vmap(frame_mask, (0, None))(jnp.asarray([2, 4]), 5), mask)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_weights_end_with_the_clip(dtype):
    count = jnp.asarray(2, jnp.int32)
    alone = counted_weights(None, count, 4, dtype)
    np.testing.assert_array_equal(alone, [1, 1, 0, 0])
    assert alone.dtype == dtype
    weights = jnp.arange(8, dtype=dtype).reshape(4, 2)
    np.testing.assert_array_equal(
        counted_weights(weights, count, 4, dtype), [[0, 1], [2, 3], [0, 0], [0, 0]]
    )
    np.testing.assert_array_equal(counted_weights(weights[:, 1], count, 4, dtype), [1, 3, 0, 0])
