"""Which floating-point type a file's arrays get."""

import jax.numpy as jnp
import numpy as np


def float_type(dtype=None) -> np.dtype:
    """``dtype`` checked; ``None`` is float64 if JAX has 64-bit types enabled, else float32.

    **Raises:** ``ValueError`` for a type that is neither, or float64 while JAX has it disabled.
    """
    available = np.dtype(jnp.zeros((), float).dtype)
    wanted = available if dtype is None else np.dtype(dtype)
    if wanted not in (np.float32, np.float64):
        raise ValueError(f"load: dtype={dtype!r}; expected float32 or float64")
    if wanted == np.float64 and available != np.float64:
        raise ValueError(
            "load: dtype=float64 needs 64-bit types: jax.config.update('jax_enable_x64', True)"
        )
    return wanted
