"""README's sample runs as printed."""

import contextlib
import io
import re
from pathlib import Path

import pytest

README = Path(__file__).parents[1] / "README.md"


@pytest.mark.skipif(not README.is_file(), reason="no README beside the tests")
def test_the_sample_runs_as_printed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (sample,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    with contextlib.redirect_stdout(io.StringIO()) as told:
        exec(sample, {})
    motion, slope = told.getvalue().rsplit(maxsplit=1)
    assert motion.startswith("Motion(120 frames, ")
    assert float(slope) < 0
    assert (tmp_path / "lively.bvh").stat().st_size > 10_000
