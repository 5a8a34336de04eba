"""Random numbers of a seed: NumPy's, so that shuffling compiles nothing."""

import jax
import numpy as np

from jaxmotion._types import Key


def entropy_of(caller: str, seed: int | Key) -> tuple[int, ...]:
    """A whole number from 0 on, or a key of JAX's, as whole numbers.

    **Raises:** ``ValueError`` for anything else.
    """
    if isinstance(seed, (int, np.integer)) and not isinstance(seed, bool):
        if seed < 0:
            raise ValueError(f"{caller}: seed={seed}; expected 0 or more")
        return (int(seed),)
    if isinstance(seed, jax.Array):
        is_key = jax.numpy.issubdtype(seed.dtype, jax.dtypes.prng_key)
        data = np.asarray(jax.random.key_data(seed) if is_key else seed)
        if data.dtype == np.uint32:
            return tuple(int(x) for x in data.ravel())
    raise ValueError(f"{caller}: seed is {seed!r}; expected a whole number or jax.random.key(0)")


def generator(entropy: tuple[int, ...], *more: int) -> np.random.Generator:
    """Random numbers of a seed, other ones for other ``more``."""
    return np.random.default_rng([*entropy, *more])
