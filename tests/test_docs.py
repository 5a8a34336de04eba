"""The pages of docs/: every block of Python runs as printed, block after block of a page; every
command is run, or its options are read; every public name has a page; links are looked at.

The site itself is built by ``.ci/run``, where a broken link or a missing name is an error.
"""

import contextlib
import importlib.util
import io
import re
import shlex
import shutil
import warnings
from pathlib import Path

import click
import jax
import numpy as np
import pytest
from click.testing import CliRunner

import jaxmotion as jm
from jaxmotion.cli import _session
from jaxmotion.cli._app import app
from tests.helpers import single_precision
from tests.test_docstrings import _public

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted(path.name for path in DOCS.glob("*.md"))


pytestmark = pytest.mark.skipif(not DOCS.is_dir(), reason="no docs/ beside the tests")


def text_of(page):
    return (DOCS / page).read_text(encoding="utf-8")


def blocks(page, *languages):
    fences = re.findall(r"^```(\w*)\n(.*?)^```$", text_of(page), re.M | re.S)
    return [text for found, text in fences if found in languages]


def commands(page):
    """Command lines that are whole: those of blocks, and of the table of questions."""
    lines = [line for block in blocks(page, "", "sh") for line in block.splitlines()]
    lines += mentioned(page) if page == "which.md" else []
    return [shlex.split(line, comments=True) for line in lines if line.startswith("jaxmotion ")]


def mentioned(page):
    """What begins with ``jaxmotion`` in running text and tables, with files or without."""
    prose = re.sub(r"^```.*?^```$", "", text_of(page), flags=re.M | re.S)
    found = (" ".join(line.split()) for line in re.findall(r"`(jaxmotion [a-z][^`]*)`", prose))
    return [line for line in found if "..." not in line]


WITH_PYTHON = [page for page in PAGES if blocks(page, "python")]
WITH_COMMANDS = [page for page in PAGES if commands(page)]


@contextlib.contextmanager
def as_users():
    """JAX as it comes, where optax and others may mix dtypes."""
    with single_precision(), jax.numpy_dtype_promotion("standard"):
        yield


def run_page(page):
    scope = {"__name__": "__main__"}
    told = io.StringIO()
    with as_users(), contextlib.redirect_stdout(told):
        for block in blocks(page, "python"):
            exec(compile(block, page, "exec"), scope)
    return scope, told.getvalue()


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What the page on λ and σ makes and prints."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("page"))
        return run_page("lambda_sigma.md")


@pytest.mark.parametrize("page", [p for p in WITH_PYTHON if p != "lambda_sigma.md"])
@pytest.mark.slow
def test_python_runs_as_printed(tmp_path, monkeypatch, page):
    if page == "training.md":
        pytest.importorskip("optax", reason="the tutorial trains with optax")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "takes").mkdir()
    scope, said = run_page(page)
    if page == "training.md":
        first, last = map(float, re.search(r"([\d.]+) at first, ([\d.]+) at last", said).groups())
        assert last < 0.6 * first
        before, after = map(float, re.search(r"from ([\d.]+) to ([\d.]+) rad", said).groups())
        assert after < 0.5 * before
        assert (tmp_path / "restyled.html").stat().st_size > 10_000
    if page == "extending.md":
        (tmp_path / "bad.lines").write_text("HIERARCHY\n")
        with pytest.raises(jm.io.MotionFileError, match="first line that is no JSON"):
            scope["load_lines"]("bad.lines")


def test_cutoffs_are_as_said(told):
    """The formulas of the page against the smoother itself, and the table that README has too."""
    scope, said = told
    hertz, rate = 6.0, 60.0
    swing = np.sin(2 * np.pi * hertz * np.arange(600) / rate)
    kept = np.asarray(jm.smoothing.lgs(swing, scope["product"](hertz, rate), 1.0).mean)
    assert np.allclose(kept[200:400], 0.5 * swing[200:400], atol=1e-3)
    for lam, share, *rates in re.findall(
        r"^\| (\d+) \| ([\d./]+) \| ([\d.]+) Hz \| ([\d.]+) Hz \| ([\d.]+) Hz", page_table(), re.M
    ):
        half = np.arcsin(1 / np.sqrt(2 * float(lam))) / np.pi
        assert eval(share) == pytest.approx(half, rel=0.03)  # two digits
        for value, fps in zip(rates, (30, 60, 120), strict=True):
            assert float(value) == pytest.approx(half * fps, rel=0.05)
        assert scope["product"](half * 60, 60) == pytest.approx(float(lam))
    readme = (DOCS.parent / "README.md").read_text("utf-8")
    assert page_table() in readme
    noise = {joint: float(x) for joint, x in re.findall(r"(\w+): noise ([\d.]+) rad", said)}
    assert noise["LeftLeg"] == pytest.approx(0.05, abs=0.005)
    half = {joint: float(x) for joint, x in re.findall(r"(\w+): noise .* at ([\d.]+) Hz", said)}
    assert half["Head"] < 2 < 3.5 < half["LeftUpLeg"] < 5.5
    product = float(re.search(r"λσ = ([\d.]+),", said)[1])
    assert 5 < product < 20


def page_table():
    (table,) = re.findall(r"^\| λσ \|.*?(?=\n\n)", text_of("lambda_sigma.md"), re.M | re.S)
    return table


def test_a_butterworth_filter_of_order_two_is_close():
    """ "to a hundredth of the signal", away from the ends."""
    from scipy.signal import butter, filtfilt

    rng = np.random.default_rng(0)
    t = np.arange(600) / 60
    y = np.sin(2 * np.pi * t) + 0.3 * np.sin(9 * np.pi * t) + 0.1 * rng.standard_normal(600)
    for lam in (5.0, 10.0, 30.0):
        half = np.arcsin(1 / np.sqrt(2 * lam)) / np.pi * 60
        # Forward and backward a filter has its gain squared: -3 dB becomes one half.
        theirs = filtfilt(*butter(2, half, fs=60), y)
        ours = np.asarray(jm.smoothing.lgs(y, lam, 1.0).mean)
        assert np.sqrt(np.mean((ours - theirs)[60:-60] ** 2)) < 0.01


@pytest.fixture
def takes(tmp_path, monkeypatch):
    """A folder ``takes`` as the pages have it, and the files beside it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "takes").mkdir()
    walk = jm.samples.load("walk", fps=30, num_frames=60).motion
    for number, name in enumerate(("run2", "walk1", "walk3")):
        noisy = jm.samples.add_noise(walk, jax.random.key(number), rotation=0.02).motion
        if name == "walk3":
            noisy = jm.samples.inject_errors(noisy, jax.random.key(2), runs=1).motion
        jm.save(noisy, tmp_path / "takes" / f"{name}.bvh")
    (preset,) = blocks("folder.md", "toml")
    (tmp_path / "studio.toml").write_text(preset)
    return tmp_path


@pytest.mark.slow
def test_a_folder_is_cleaned_as_printed(takes, monkeypatch):
    """One line after the other, in this process. Read and not followed are --jobs, --cluster and
    ``repair``, whose minute tests/cli spends; browsers are not opened."""
    monkeypatch.setenv("JAXMOTION_CACHE_DIR", "")
    monkeypatch.setattr(_session, "_CompilingNotice", lambda **_: None)
    monkeypatch.setattr("webbrowser.open", lambda *_: True)
    lines = [s for b in blocks("folder.md", "") for s in b.splitlines()]
    for line in lines:
        words = shlex.split(line)[1:]
        if "--cluster" in words or words[0] == "repair":
            parsed(words)
            shutil.copytree("takes", "whole", dirs_exist_ok=True)
            continue
        if "--jobs" in words:
            at = words.index("--jobs")
            del words[at : at + 2]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            result = CliRunner().invoke(app, words, prog_name="jaxmotion")
        allowed = (0, 3) if words[0] == "check" else (0,)
        assert result.exit_code in allowed, f"{line}: {result.output}"
    jax.config.update("jax_disable_most_optimizations", False)
    made = {path.name for path in takes.iterdir()}
    assert {"practice", "clean", "firm", "all", "soft", "denoise.html", "difference.html"} <= made
    assert len(list((takes / "firm").glob("*.bvh"))) == 3


def parsed(words):
    """The command takes these words."""
    name, *rest = words
    context = click.Context(app, info_name="jaxmotion")
    command = app.get_command(context, name)
    assert command is not None, f"there is no command {name}"
    made = command.make_context(name, rest, parent=context)
    assert not made.args


@pytest.mark.parametrize("page", PAGES)
def test_commands_and_options_that_are_mentioned_are_there(page):
    context = click.Context(app, info_name="jaxmotion")
    for line in mentioned(page):
        _, name, *words = shlex.split(line)
        command = app.get_command(context, name)
        assert command is not None, line
        known = {flag for p in command.params for flag in (*p.opts, *p.secondary_opts)}
        asked = {word.partition("=")[0] for word in words if word.startswith("-")}
        assert asked <= known | {"--help"}, line


@pytest.mark.parametrize("page", WITH_COMMANDS)
def test_commands_take_what_is_shown(page, takes):
    for line in commands(page):
        words = line[1:]
        for word in words:
            if word.endswith((".bvh", ".npz", ".amc")):
                Path(word).parent.mkdir(parents=True, exist_ok=True)
                Path(word).touch()
        try:
            parsed(words)
        except click.ClickException as error:
            pytest.fail(f"{page}: {shlex.join(line)}: {error.format_message()}")


def test_functions_that_pages_name_are_there():
    """``jm.…`` in running text, in tables and in roles; arguments too where a call is shown."""
    for page in PAGES:
        names = re.findall(r"`jm\.([a-z_]\w*(?:\.\w+)*)", text_of(page))
        names += re.findall(r"\{\w+\}`jaxmotion\.([\w.]+)`", text_of(page))
        for name in names:
            thing = jm
            for part in name.split("."):
                assert hasattr(thing, part), f"{page}: jaxmotion.{name}"
                thing = getattr(thing, part)


@pytest.fixture(scope="module")
def rooms():
    return extension("rooms")


def extension(name):
    """One of the site's, where its generator is installed."""
    spec = importlib.util.spec_from_file_location(name, DOCS / "_ext" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except ModuleNotFoundError as error:
        pytest.skip(f"no {error.name}: pip install '.[docs]'")
    return module


def test_every_public_name_has_a_page(rooms):
    """The site has what the docstrings' tests call public, each under a room that has a page."""
    described = {id(thing) for thing in rooms.public().values()}
    missing = [name for name, thing in _public().items() if id(thing) not in described]
    assert not missing
    for room in rooms.ROOMS:
        page = DOCS / "api" / f"{room.rpartition('.')[2]}.rst"
        assert f".. room:: {room}\n" in page.read_text("utf-8")
    assert {rooms.room_of(name) for name in rooms.public()} <= set(rooms.ROOMS)


def test_docstrings_become_lists_and_tables(rooms):
    text = """Smooth a signal.

    y = A x

**Arguments:** ``y``: f[Nd, *channels]; ``lam``, ``sigma``: above 0 (``a``: no item); ``per``: one
of *three*.
**Returns:** what |x| is.
"""
    lines = rooms.written(text)
    assert lines[0] == "Smooth a signal."
    assert rooms.TEXT in lines
    items = [line for line in lines if line.startswith("- ")]
    assert items == [
        r"- ``y``: f[Nd, \*channels]",
        "- ``lam``, ``sigma``: above 0 (``a``: no item)",
        "- ``per``: one of *three*.",
    ]
    assert r"what \|x\| is." in lines
    table = rooms.written("| a | b |\n|---|---|\n| 1 | ``2`` |")
    assert [line.strip() for line in table if "- " in line] == ["* - a", "- b", "* - 1", "- ``2``"]


def test_the_page_of_commands_has_every_option():
    """The help of each, with all of its options."""
    commands = extension("commands")
    with click.Context(app, info_name="jaxmotion") as above:
        for name in app.list_commands(above):
            text = commands.said(above, name)
            assert text.startswith(f"Usage: jaxmotion {name} ")
            for option in app.get_command(above, name).params:
                if isinstance(option, click.Option) and not option.hidden:
                    assert option.opts[-1] in text


def test_broken_links_are_found(tmp_path):
    links = extension("links")
    (tmp_path / "b.html").write_text("<h1 id='here'>b</h1><a href='a.html'>a</a>")
    (tmp_path / "a.html").write_text(
        "<a href='b.html#here'>1</a><a href='b.html#there'>2</a><a href='c.html'>3</a>"
        "<a href='#top'>4</a><a href='https://example.org/x'>5</a><img src='https://x.org/p.png'>"
        "<a href='#nowhere'>6</a><script src='s.js'></script>"
    )
    (tmp_path / "s.js").write_text("")
    (tmp_path / "style.css").write_text("@import url('https://fonts.example/a.css');")
    found = list(links.faults(tmp_path))
    assert [fault.split(": ")[-1] for fault in found[:3]] == [
        "no such anchor",
        "no such file",
        "no such anchor",
    ]
    assert "a.html loads https://x.org/p.png" in found
    assert "style.css loads from another site" in found
    assert len(found) == 5


def test_pages_are_in_the_navigation():
    index = text_of("index.md")
    for page in PAGES:
        if page != "index.md":
            assert re.search(rf"^{Path(page).stem}$", index, re.M), (
                f"{page} is in no list of index.md"
            )
