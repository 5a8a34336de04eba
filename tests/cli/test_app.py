"""The frame of the command line: help without JAX, exit codes, errors in one line."""

import json
import os
import subprocess
import sys

import click
import pytest

from jaxmotion.cli import _app

COMMANDS = (
    "align", "augment", "blend", "check", "compare", "contacts", "convert", "demo", "denoise",
    "info", "layers", "mirror", "multires", "prior", "repair", "retime", "stitch", "style",
    "transfer", "view",
)  # fmt: skip


def python(code, *argv):
    return subprocess.run(
        [sys.executable, "-c", code, *argv], capture_output=True, text=True, timeout=60
    )


def test_help_never_imports_jax_or_numpy():
    code = """
import json, sys, time
from click.testing import CliRunner
begun = time.process_time()
from jaxmotion.cli._app import app
runner = CliRunner()
first = runner.invoke(app, ["--help"])
spent = time.process_time() - begun
results = [first] + [runner.invoke(app, [name, "--help"]) for name in sys.argv[1:]]
heavy = sorted({m.partition(".")[0] for m in sys.modules} & {"jax", "numpy", "equinox", "rich"})
print(json.dumps([[r.exit_code for r in results], heavy, spent, first.output]))
"""
    ran = python(code, *COMMANDS)
    codes, heavy, spent, text = json.loads(ran.stdout)
    assert codes == [0] * (1 + len(COMMANDS))
    assert heavy == []
    assert all(name in text for name in COMMANDS)
    assert spent < 0.25


def test_help_is_quick():
    best = min(
        _seconds(lambda: python("import jaxmotion.cli as c; c.main()", "--help")) for _ in "ab"
    )
    bare = min(_seconds(lambda: python("pass")) for _ in "ab")
    assert best - bare < 0.5


def _seconds(run):
    """Of work: how long it takes also tells what else the machine does."""
    begun = os.times()
    assert run().returncode == 0
    ended = os.times()
    return sum(ended[2:4]) - sum(begun[2:4])  # of the processes that have been waited for


def test_every_module_is_a_command(jaxmotion):
    assert tuple(_app.app.list_commands(click.Context(_app.app))) == COMMANDS
    for name in COMMANDS:
        text = jaxmotion(name, "--help").stdout
        assert text.startswith(f"Usage: jaxmotion {name}")


def test_version(jaxmotion):
    import jaxmotion as jm

    assert jm.__version__ in jaxmotion("--version").stdout


@pytest.mark.parametrize(
    "words",
    [
        ["nonsense"],
        ["denoise"],
        ["denoise", "nowhere.bvh", "-o", "out"],
        ["denoise", "--strength", "2", "x", "-o", "y"],
        ["denoise", "--range", "1-2", "x", "-o", "y"],
        ["style", "--gain", "Arm", "x", "-o", "y"],
        ["denoise", "--report", "r.pdf", "x", "-o", "y"],
    ],
)
def test_usage_errors_exit_2(jaxmotion, words):
    result = jaxmotion(*words, code=2)
    assert "Error" in result.stderr
    assert "Traceback" not in result.output


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("denoize", "did you mean denoise?"),
        ("Stylise", "did you mean style?"),
        ("exaggeration", "multires or style?"),
        ("qqq", "jaxmotion --help lists them"),
    ],
)
def test_an_unknown_verb_gets_a_suggestion(jaxmotion, word, hint):
    told = jaxmotion(word, "x.bvh", code=2).stderr
    assert f"there is no command '{word}'" in told
    assert hint in told


def test_unforeseen_trouble_is_one_line_and_debug_shows_where(jaxmotion, monkeypatch, take):
    from jaxmotion.cli import _reading

    def broken(*args, **kwargs):
        raise KeyError("surprise")

    monkeypatch.setattr(_reading._session, "start", broken)
    result = jaxmotion("info", take, code=1)
    assert "unexpected KeyError: 'surprise'" in result.stderr
    assert "--debug" in result.stderr
    assert "Traceback" not in result.output
    assert "Traceback" in jaxmotion("info", take, "--debug", code=1).stderr


def test_interruption_exits_130(jaxmotion, monkeypatch, take):
    from jaxmotion.cli import _reading

    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(_reading._session, "start", interrupted)
    result = jaxmotion("info", take, code=130)
    assert "Interrupted" in result.stderr
    assert "Traceback" not in result.output
