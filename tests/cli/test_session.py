"""The process's own JAX settings, checked in a process of their own."""

import os
import subprocess
import sys

import pytest

import jaxmotion as jm
from jaxmotion.cli import _session
from tests.cli.conftest import swinging


def test_cache_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXMOTION_CACHE_DIR", str(tmp_path))
    assert _session.cache_folder() == tmp_path
    monkeypatch.setenv("JAXMOTION_CACHE_DIR", "")
    assert _session.cache_folder() is None
    monkeypatch.delenv("JAXMOTION_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "x"))
    if sys.platform == "linux":
        assert _session.cache_folder() == tmp_path / "x" / "jaxmotion"
    assert _session.cache_folder().name == "jaxmotion"


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
        return run.stderr

    denoise("a", "--no-cache")
    assert not cache.exists()
    assert "compiling (first run only)" in denoise("a")
    compiled = sorted(cache.rglob("*-cache"))
    assert compiled
    # A clip of another length needs nothing new.
    assert "compiling" not in denoise("b")
    assert sorted(cache.rglob("*-cache")) == compiled
