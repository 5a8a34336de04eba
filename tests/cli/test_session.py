"""The process's own JAX settings, checked in a process of their own."""

import os
import subprocess
import sys
import time

import jax
import pytest

import jaxmotion as jm
from jaxmotion import _compilation_cache as _cache
from jaxmotion.cli import _session
from tests.cli.conftest import swinging


def test_cache_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXMOTION_CACHE_DIR", str(tmp_path))
    assert _cache.cache_folder() == tmp_path
    monkeypatch.setenv("JAXMOTION_CACHE_DIR", "")
    assert _cache.cache_folder() is None
    monkeypatch.delenv("JAXMOTION_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "x"))
    if sys.platform == "linux":
        assert _cache.cache_folder() == tmp_path / "x" / "jaxmotion"
    assert _cache.cache_folder().name == "jaxmotion"


@pytest.mark.parametrize(("release", "given"), [("0.10.2", True), ("0.99.0", False)])
def test_flags_that_end_the_process_go_to_releases_that_know_them(monkeypatch, release, given):
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=true")
    monkeypatch.setattr(_session.metadata, "version", lambda name: release)
    _session._generate_plain_code()
    mine, *users = os.environ["XLA_FLAGS"].rsplit(maxsplit=1)
    assert (mine == _session._PLAIN_CODE) == given
    assert (users or [mine]) == ["--xla_cpu_use_fusion_emitters=true"]


MISS = "/jax/compilation_cache/cache_misses"


@pytest.mark.parametrize(
    ("kept", "text"),
    [(True, "compiling (kept for the next run) ...\n"), (False, "compiling ...\n")],
)
def test_notice_while_compiling(monkeypatch, capfd, notice_class, kept, text):
    monkeypatch.setattr(_session, "_PATIENCE", 0.05)
    notice = notice_class(kept=kept)
    notice._on_miss(MISS)
    for pause, told in ((0.0, ""), (0.5, text), (0.5, "")):
        notice._on_event("/jax/core/compile/jaxpr_to_mlir_module_duration", 0.1)
        time.sleep(pause)
        notice._on_event("/jax/core/compile/backend_compile_duration", 0.1)
        heard = capfd.readouterr().err
        assert heard.startswith(told)
        assert bool(heard) == bool(told)


def test_reading_the_cache_is_not_called_compiling(monkeypatch, capfd, notice_class):
    monkeypatch.setattr(_session, "_PATIENCE", 0.05)
    notice = notice_class(kept=True)
    for event, told in (("/jax/compilation_cache/cache_hits", False), (MISS, True)):
        notice._on_event("/jax/core/compile/jaxpr_to_mlir_module_duration", 0.1)
        time.sleep(0.5)
        notice._on_event("/jax/core/compile/backend_compile_duration", 0.5)
        assert capfd.readouterr().err == ""
        notice._on_miss(event)
        assert notice._compiles == told


def test_a_miss_is_told_of_as_jax_reports_it(tmp_path, notice_class):
    names = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")
    before = {name: jax.config.values[name] for name in names}
    notice = notice_class(kept=True)
    try:
        _configure(dict(zip(names, (str(tmp_path), 0.0), strict=True)))
        jax.jit(lambda x: 2 * x + time.time())(1.0)
    finally:
        _configure(before)
    assert notice._compiles


def _configure(options):
    from jax.experimental.compilation_cache import compilation_cache

    for name, value in options.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()


def test_notice_listens_to_what_jax_reports(monkeypatch, notice_class):
    events = []
    monkeypatch.setattr(
        notice_class, "_on_event", lambda self, event, duration_secs, **_: events.append(event)
    )
    notice_class(kept=True)
    jax.jit(lambda x: x + len(events))(1.0)
    ends = [event.rpartition("/")[2] for event in events]
    assert ends.index("jaxpr_to_mlir_module_duration") < ends.index("backend_compile_duration")


@pytest.mark.slow
def test_the_second_run_compiles_nothing(tmp_path):
    jm.save(swinging(), tmp_path / "a.bvh")
    jm.save(swinging(44, seed=1), tmp_path / "b.bvh")
    cache = tmp_path / "cache"
    options = ("-o", "out", "--lam", "1", "--sigma", "1", "--overwrite")

    def denoise(name, *words):
        run = subprocess.run(
            [sys.executable, "-m", "jaxmotion", "denoise", f"{name}.bvh", *options, *words],
            cwd=tmp_path,
            env={**os.environ, "JAXMOTION_CACHE_DIR": str(cache)},
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert run.returncode == 0, run.stderr

    denoise("a", "--no-cache")
    assert not cache.exists()
    denoise("a")
    compiled = sorted(cache.rglob("*-cache"))
    assert compiled
    # A clip of another length needs nothing new.
    denoise("b")
    assert sorted(cache.rglob("*-cache")) == compiled
    # Entries that were cut off are made anew, once.
    sizes = [path.stat().st_size for path in compiled]
    compiled[0].write_bytes(b"")
    compiled[-1].write_bytes(compiled[-1].read_bytes()[:-20])
    denoise("a")
    assert [path.stat().st_size for path in compiled] == pytest.approx(sizes, rel=0.1)
