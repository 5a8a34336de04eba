"""JAX for the command line's own process: float64, a compile cache on disk, a word while compiling.

The library never changes a global setting; a program may. Failed run-time checks become NaN
instead of callbacks into Python (``EQX_ON_ERROR``), because programs with callbacks cannot be kept
in the cache; results are checked before they are written. Little work is compiled without
optimisation and by XLA's older, plainer code generator: that takes a sixth of the time, and what
comes out runs at half the speed.
"""

import gc
import os
import sys
import threading
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

from jaxmotion._compilation_cache import keep_programs, usable_folder
from jaxmotion.cli import _leaving
from jaxmotion.cli._terminal import say

_PATIENCE = 1.0  # seconds of compiling before it is mentioned
_LITTLE = 16 * 2**20  # bytes of input files that take less time than compiling
# XLA ends the process at a flag that it does not know, so only releases known to have it get it.
_PLAIN_CODE = "--xla_cpu_use_fusion_emitters=false"
_RELEASES_WITH_PLAIN_CODE = ("0.7.", "0.8.", "0.9.", "0.10.")


def is_little(paths: Iterable[Path]) -> bool:
    """Whether working through these files takes less time than compiling for it."""
    return sum(map(size_of, paths)) < _LITTLE


def size_of(path: Path) -> int:
    """Bytes of a file, nought if nobody knows."""
    try:
        return path.stat().st_size
    except OSError:  # reading it will tell
        return 0


def start(*, cache: bool = True, little: bool = False, notice: bool = True, share: int = 1) -> None:
    """Import and set up JAX.

    **Arguments:** ``cache``: keep compiled programs on disk; ``little``: compile fast for little
    work; ``notice``: say on stderr when compiling takes a while; ``share``: number of processes
    that share this machine's cores.
    """
    if "equinox" not in sys.modules:
        os.environ.setdefault("EQX_ON_ERROR", "nan")
    # Importing and tracing make many lasting objects: looking among them for garbage every few
    # hundred takes a tenth of a cold start.
    gc.set_threshold(100_000, 20, 100)
    if share > 1:
        os.environ.setdefault("NPROC", str(max(1, (os.cpu_count() or 1) // share)))
    # NumPy's matrices are small here: threads would wait for each other, longest where cores are
    # busy. Only read as NumPy is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if little and "jax" not in sys.modules:
        _generate_plain_code()
    import jax

    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_disable_most_optimizations", little)
    from jaxmotion.io.atomic import abandon

    _leaving.always(abandon)
    folder = usable_folder() if cache else None
    if folder is not None:
        keep_programs(folder)
    if notice:
        _CompilingNotice(kept=folder is not None)


def _generate_plain_code() -> None:
    """Ask XLA for the code that it generates fastest; flags that the user has set come after."""
    if metadata.version("jaxlib").startswith(_RELEASES_WITH_PLAIN_CODE):
        flags = (_PLAIN_CODE, os.environ.get("XLA_FLAGS", ""))
        os.environ["XLA_FLAGS"] = " ".join(flags).strip()


class _CompilingNotice:
    """Says once that compiling takes a while. JAX reports when lowering ends, which is when
    compiling or reading the cache begins, and when that ends. Which of the two it was, it reports
    when a program has been written to the cache: until one has, nothing is said to be compiled,
    for reading a large program takes a while as well."""

    def __init__(self, *, kept: bool):
        from jax import monitoring

        self._kept = kept
        self._compiles = not kept
        self._told = False
        self._timer: threading.Timer | None = None
        monitoring.register_event_listener(self._on_miss)
        monitoring.register_event_duration_secs_listener(self._on_event)

    def _on_miss(self, event: str, **kwargs: str | int) -> None:
        self._compiles |= event.endswith("compilation_cache/cache_misses")

    def _on_event(self, event: str, duration_secs: float, **kwargs: str | int) -> None:
        if event.endswith("jaxpr_to_mlir_module_duration") and not self._told:
            self._cancel()
            self._timer = threading.Timer(_PATIENCE, self._tell)
            self._timer.daemon = True
            self._timer.start()
        elif event.endswith("backend_compile_duration"):
            self._cancel()

    def _cancel(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _tell(self) -> None:
        if self._compiles:
            self._told = True
            say(f"compiling{' (kept for the next run)' if self._kept else ''} ...", err=True)
