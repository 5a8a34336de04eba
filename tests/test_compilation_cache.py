"""Compiled programs kept on disk for the next process."""

import subprocess
import sys

import pytest

import jaxmotion as jm

SMOOTH = """
import sys
import jax.numpy as jnp
import jaxmotion as jm
from jax import monitoring

hits = []
monitoring.register_event_listener(lambda event, **_: hits.append(event))
print(jm.enable_compilation_cache(sys.argv[1]))
jm.smoothing.lgs(jnp.arange(8.0), 1.0, 1.0).mean.block_until_ready()
print(hits.count("/jax/compilation_cache/cache_hits"))
print(hits.count("/jax/compilation_cache/cache_misses"))
"""


def test_the_second_process_compiles_nothing(tmp_path):
    runs = [
        subprocess.run(
            [sys.executable, "-c", SMOOTH, str(tmp_path / "kept")],
            capture_output=True,
            text=True,
            check=True,
        ).stdout.split()
        for _ in range(2)
    ]
    assert [run[0] for run in runs] == [str(tmp_path / "kept")] * 2
    assert int(runs[0][1]) == 0
    assert int(runs[0][2]) > 0
    assert int(runs[1][1]) > 0
    assert int(runs[1][2]) == 0


def test_a_folder_that_cannot_be_is_refused(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError):
        jm.enable_compilation_cache(tmp_path / "file" / "folder")
    monkeypatch.setenv("JAXMOTION_CACHE_DIR", "")
    with pytest.raises(OSError, match="no folder is given"):
        jm.enable_compilation_cache()
