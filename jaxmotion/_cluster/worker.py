"""What runs on a worker: a few items through the work, one after the other, in steady memory.

Compiled programs are never dropped by JAX: some megabytes for every shape that is new. When a
worker has grown by much and has met many, it forgets them all and gives the memory back; the ones
that are needed come back from the folder of compiled programs.
"""

import functools
import gc
import pickle
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

_MANY = 64  # programs, compiled or read, before it is worth to forget them
_MUCH = 160 * 2**20  # bytes by which a worker may grow before it does

# One item at a time in a process, whatever its number of threads: what catches warnings, and where
# a process is, is one for all of them.
_one = threading.RLock()


def same(value: bytes) -> bytes:
    """The value: what is sent to a worker once, made anew if the workers are lost that hold it."""
    return value


def run(blob: bytes, items: Sequence[Any], along: Sequence[Any] | None = None) -> list[Any]:
    """The values of the pickled work for some items, each with what goes ``along``."""
    with _one:
        work = _read(blob)
        try:
            if along is None:
                return [work(item) for item in items]
            return [work(item, more) for item, more in zip(items, along, strict=True)]
        finally:
            _memory.tidy()


def prepare(blob: bytes) -> None:
    """Import what the work needs, and set it up."""
    with _one:
        setup = getattr(_read(blob), "prepare", None)
        if setup is not None:
            setup()


@functools.lru_cache(maxsize=2)
def _read(blob: bytes) -> Any:
    return pickle.loads(blob)


class _Memory:
    """How this process has grown since it last forgot its programs."""

    def __init__(self):
        self._programs: int | None = None  # None until JAX is there to ask
        self._size = 0

    def tidy(self) -> None:
        """Give back what is free, and forget compiled programs if there is reason to."""
        if "jax" not in sys.modules:
            return
        _trim()
        if self._programs is None:
            from jax import monitoring

            self._programs = 0
            monitoring.register_event_duration_secs_listener(self._count)
            self._size = _resident()
        elif self._programs >= _MANY and _resident() - self._size > _MUCH:
            self.forget()

    def forget(self) -> None:
        """Forget all of them, and give the memory back to the system."""
        import jax

        jax.clear_caches()
        gc.collect()
        _trim()
        self._programs, self._size = 0, _resident()

    def _count(self, event: str, duration_secs: float, **kwargs: str | int) -> None:
        if event.endswith("backend_compile_duration"):
            self._programs = (self._programs or 0) + 1


_memory = _Memory()


def _resident() -> int:
    """Bytes of memory that this process holds."""
    import psutil

    return psutil.Process().memory_info().rss


def _trim() -> None:
    """What is freed goes back to the system at once, where the C library knows how."""
    import ctypes

    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)
