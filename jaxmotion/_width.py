"""JAX's 64-bit types as the caller has them, in other threads and on workers: the setting may be of
one thread only."""

from contextlib import AbstractContextManager

import jax


def wide() -> bool:
    """Whether JAX keeps 64 bits, in this thread."""
    return bool(jax.config.jax_enable_x64)  # type: ignore[attr-defined]


def kept_wide(on: bool) -> AbstractContextManager:
    """64-bit types, on or off, for a while and for this thread only."""
    setting = getattr(jax, "enable_x64", None)
    if setting is None:  # before JAX 0.8
        from jax.experimental import enable_x64 as setting  # type: ignore[attr-defined]
    return setting(on)
