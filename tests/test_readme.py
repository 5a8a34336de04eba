"""README's samples and examples run as printed; commands have the options that it shows."""

import ast
import contextlib
import inspect
import io
import re
import shlex
from pathlib import Path

import click
import pytest

import jaxmotion as jm
from jaxmotion.cli._app import app

README = Path(__file__).parents[1] / "README.md"
COMMANDS = app.list_commands(click.Context(app))

pytestmark = pytest.mark.skipif(not README.is_file(), reason="no README beside the tests")


def blocks(language):
    fences = re.findall(r"^```(\w*)\n(.*?)^```$", README.read_text(encoding="utf-8"), re.M | re.S)
    return [text for found, text in fences if found == language]


def commands():
    lines = [line for block in blocks("") for line in block.splitlines()]
    return [shlex.split(line, comments=True) for line in lines if line.startswith("jaxmotion ")]


def examples():
    """The example of every row of the table of capabilities."""
    header = "| capability | example | more | source |\n|---|---|---|---|\n"
    rows = README.read_text(encoding="utf-8").split(header)[1].split("\n\n")[0].splitlines()
    return [row.split(" | ")[1].strip("`") for row in rows]


def test_the_sample_runs_as_printed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with contextlib.redirect_stdout(io.StringIO()) as told:
        exec(blocks("python")[0], {})
    motion, slope = told.getvalue().rsplit(maxsplit=1)
    assert motion.startswith("Motion(120 frames, ")
    assert float(slope) < 0
    assert (tmp_path / "lively.bvh").stat().st_size > 10_000


def test_every_capability_has_an_example_that_can_be_called():
    """Names are there, and take the arguments."""
    found = examples()
    assert len(found) > 25
    for example in found:
        assert example.startswith("jm."), example
        for call in (node for node in ast.walk(ast.parse(example)) if isinstance(node, ast.Call)):
            name = ast.unparse(call.func)
            if name.startswith("jm."):
                names = [keyword.arg for keyword in call.keywords]
                function = eval(name, {"jm": jm})
                inspect.signature(function).bind(*call.args, **dict.fromkeys(names))


@pytest.mark.sweep
def test_samples_and_examples_run_one_after_the_other(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scope = {}
    for sample in blocks("python"):
        exec(sample, scope)
    for example in examples():
        eval(example, scope)
    assert (tmp_path / "lively.npz").exists()


def test_the_files_it_links_are_there():
    links = re.findall(r"\]\(([^):]+)\)", README.read_text(encoding="utf-8"))
    assert "docs/performance.md" in links
    assert [link for link in links if not (README.parent / link).is_file()] == []


def test_there_is_a_line_for_every_command():
    assert sorted(words[1] for words in commands()) == COMMANDS


@pytest.mark.parametrize("name", COMMANDS)
def test_commands_take_what_is_shown(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    (words,) = [words[2:] for words in commands() if words[1] == name]
    for word in words:
        if word.endswith(".bvh"):
            Path(word).touch()
    command = app.get_command(click.Context(app), name)
    assert command is not None
    context = command.make_context(name, words, parent=click.Context(app, info_name="jaxmotion"))
    assert not context.args
