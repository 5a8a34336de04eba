"""The pictures of docs/ are those of one script, small, and shown where they are."""

import importlib.util
import re
from pathlib import Path

import jax
import pytest

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "docs" / "pictures.py"
MOST = 100_000  # bytes

pytestmark = pytest.mark.skipif(not SCRIPT.is_file(), reason="no docs/ beside the tests")


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("pictures", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_each_is_there_and_small(script):
    files = {path.stem: path.stat().st_size for path in script.FOLDER.glob("*")}
    assert set(files) == set(script.PICTURES)
    assert max(files.values()) < MOST


def test_pages_show_pictures_that_there_are():
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    shown = 0
    for page in pages:
        for link in re.findall(r"!\[[^]]*\]\((?!https?:)([^)]+)\)", page.read_text("utf-8")):
            assert (page.parent / link).is_file(), f"{page.name}: {link}"
            shown += 1
    assert shown >= 5


@pytest.mark.slow
def test_they_can_be_remade(script, tmp_path):
    try:
        script.main(["layers"], tmp_path)
    finally:
        jax.config.update("jax_enable_x64", True)
    made = (tmp_path / "layers.png").read_bytes()
    assert made.startswith(b"\x89PNG")
    assert len(made) < MOST


def test_others_are_refused(script):
    with pytest.raises(SystemExit, match="no picture dance; there are strip, layers, "):
        script.main(["dance"])
