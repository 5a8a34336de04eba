"""Every notebook runs from top to bottom, its last cells check what it shows, and it is light."""

import base64
import json
import re
from pathlib import Path

import jax
import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

from tests.helpers import single_precision

FOLDER = Path(__file__).parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
NEEDS = {"optax": ("03", "08"), "distributed": ("10",)}

pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason="no notebooks/ beside the tests")


def cells_of(path):
    return json.loads(path.read_text(encoding="utf-8"))["cells"]


def code_of(path):
    return ["".join(c["source"]) for c in cells_of(path) if c["cell_type"] == "code"]


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_code_cells_run_in_order(path, tmp_path, monkeypatch):
    """As a reader has it: float32, JAX's own promotion of dtypes, a folder of no matter."""
    for package, numbers in NEEDS.items():
        if path.name.startswith(numbers):
            pytest.importorskip(package)
    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("JAXMOTION_NOTEBOOK_CLIP", raising=False)
    monkeypatch.setenv("PYTHONPATH", str(FOLDER.parent))
    names = {"__name__": "__main__"}
    with single_precision(), jax.numpy_dtype_promotion("standard"):
        for number, source in enumerate(code_of(path), start=1):
            exec(compile(source, f"{path.name}, code cell {number}", "exec"), names)
    plt.close("all")
    assert not any(tmp_path.iterdir()), "it leaves files behind"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_it_asks_shows_and_checks(path):
    cells = cells_of(path)
    kinds = [cell["cell_type"] for cell in cells]
    title = "".join(cells[0]["source"])
    assert kinds[0] == "markdown"
    assert title.startswith(f"# {path.stem[:2]} ")
    assert "?" in title, "it opens with a question"
    assert "## Check" in "".join(cells[-3]["source"])
    assert "assert " in "".join(cells[-2]["source"])
    assert "".join(cells[-1]["source"]).startswith("Next: ")
    assert "JAXMOTION_NOTEBOOK_CLIP" in code_of(path)[0]
    assert max(len(source.splitlines()) for source in code_of(path)) <= 32


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_outputs_are_light_and_of_one_run(path):
    """They were run in order, and hold no path, warning or failure, and no page that plays."""
    assert path.stat().st_size < 300_000
    code = [cell for cell in cells_of(path) if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    pictures = 0
    for output in (o for cell in code for o in cell["outputs"]):
        kind = output["output_type"]
        assert kind in ("stream", "execute_result", "display_data"), output
        assert output.get("name") != "stderr", output
        data = output.get("data", {})
        assert set(data) <= {"text/plain", "image/png"}
        if "image/png" in data:
            pictures += 1
            assert len(base64.b64decode(data["image/png"])) < 60_000
        text = "".join(output.get("text", data.get("text/plain", "")))
        assert not re.search(r"/(home|tmp|root|work|Users)/|Warning|Traceback", text), text
    assert pictures or path.stem.startswith("10")


def test_readme_lists_them():
    readme = (FOLDER.parent / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"\(notebooks/(\S+)\.ipynb\)", readme) == [path.stem for path in NOTEBOOKS]
    assert [path.stem[:2] for path in NOTEBOOKS] == [f"{n:02}" for n in range(1, 11)]
