"""Test session: float64 on, strict promotion, a compile cache, and where real captures are."""

import gc
import importlib
import os
import sys
from importlib import metadata
from pathlib import Path

# Nearly all of the suite's time is compiling: XLA's plain code takes a third of it, and a fifth
# less again in one piece and with loops left as they are. Set XLA_FLAGS, empty or not, to test
# other code. XLA ends the process at flags that it does not know.
if metadata.version("jaxlib").startswith(("0.7.", "0.8.", "0.9.", "0.10.")):
    os.environ.setdefault(
        "XLA_FLAGS",
        "--xla_cpu_use_fusion_emitters=false"
        " --xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
        " --xla_cpu_parallel_codegen_split_count=1 --xla_disable_hlo_passes="
        "while-loop-invariant-code-motion,while-loop-constant-sinking,hlo-verifier",
    )

import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
if cache := os.environ.get("JAXMOTION_TEST_CACHE"):
    jax.config.update("jax_compilation_cache_dir", cache)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)

_BESIDE = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_collection_finish(session):
    """Look for garbage less often: tracing makes many objects, and modules stay."""
    gc.freeze()
    gc.set_threshold(20_000)


@pytest.fixture(scope="module", autouse=True)
def _compiled_code_freed():
    """Let each module's compiled functions go: Linux allows a process 65 530 memory maps."""
    yield
    jax.clear_caches()


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Real captures: ``JAXMOTION_TEST_DATA``, else ``../shared/data`` beside the project."""
    named = os.environ.get("JAXMOTION_TEST_DATA")
    folder = Path(named) if named else _BESIDE
    if not folder.is_dir():
        if named:
            pytest.fail(f"JAXMOTION_TEST_DATA={named} is not a folder")
        pytest.skip("no real captures: set JAXMOTION_TEST_DATA to a folder of them")
    return folder


@pytest.fixture(scope="module")
def script():
    """A script of benchmarks/papers by name; they import each other as when they are run."""
    folder = Path(__file__).parents[1] / "benchmarks"
    before = sys.path[:], set(sys.modules)
    sys.path[:0] = [str(folder / "papers"), str(folder)]
    yield importlib.import_module
    sys.path[:] = before[0]
    for name in set(sys.modules) - before[1]:
        if Path(getattr(sys.modules[name], "__file__", None) or "/").is_relative_to(folder):
            del sys.modules[name]


@pytest.fixture(params=["float32", "float64"])
def dtype(request):
    """Both precisions the library supports, as a numpy dtype."""
    return jax.numpy.dtype(request.param)
