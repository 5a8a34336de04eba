"""Steps beyond the ends of a clip, beside a walk to and fro."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.frames.ends import mirrored_step, steps_around


def walked(index, count):
    """From step 0 on in both directions, turning round at the first and at the last."""
    at, ahead = 0, 1
    for _ in range(abs(index)):
        if not 0 <= at + ahead < count:
            ahead = -ahead
        at = min(max(at + ahead, 0), count - 1)
    return at


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_steps_turn_round_at_the_ends(count):
    around = range(-9, count + 9)
    want = [walked(i, count) for i in around]
    np.testing.assert_array_equal(steps_around(count, 9, 9), want)
    found = mirrored_step(jnp.arange(-9, count + 9), jnp.asarray(count))
    np.testing.assert_array_equal(found, want)


def test_steps_of_none_are_the_first():
    """A clip of one frame has no steps; what is asked for is a place that exists."""
    assert mirrored_step(jnp.asarray(3), jnp.asarray(0)) == 0
