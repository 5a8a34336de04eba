"""Presets and the types of options."""

import inspect

import click
import pytest

from jaxmotion import augment, cleaning, contacts, layers, mirror, multiresolution, style, timing
from jaxmotion.cli._app import app
from jaxmotion.cli._joining import Joining
from jaxmotion.cli._options import Batch, FrameRange, Gain, Reading, Running, Selection
from jaxmotion.io.bvh import save_bvh
from jaxmotion.io.gltf import save_glb
from jaxmotion.smoothing import motion_prior


@pytest.mark.parametrize(
    ("text", "want"),
    [("120:480", (120, 480)), ("5:", (5, None)), (":-2", (None, -2)), ("-9:7", (-9, 7))],
)
def test_frame_range(text, want):
    assert FrameRange().convert(text, None, None) == want


@pytest.mark.parametrize("text", ["5", "a:b", "1:2:3", "", "480:120", "5:5", ":0", "-3:-7"])
def test_bad_frame_range(text):
    with pytest.raises(click.BadParameter):
        FrameRange().convert(text, None, None)


def test_gain():
    assert Gain().convert("*Arm*=2.5", None, None) == ("*Arm*", 2.5)
    assert Gain().convert("a=b=-1", None, None) == ("a=b", -1.0)
    for text in ("Arm", "=2", "Arm=two"):
        with pytest.raises(click.BadParameter):
            Gain().convert(text, None, None)


def test_selection_of_everything():
    assert Selection(1.0, (), (None, None), 8).everything
    assert not Selection(0.5, (), (None, None), 8).everything
    assert not Selection(1.0, ("Left*",), (None, None), 8).everything
    assert not Selection(1.0, (), (3, None), 8).everything


@pytest.fixture
def edited(monkeypatch):
    """What ``edit_files`` was called with, which then does nothing."""
    from jaxmotion.cli import _batch

    calls = []
    monkeypatch.setattr(_batch, "edit_files", lambda edit, *rest, **_: calls.append((edit, *rest)))
    return calls


def test_preset_gives_defaults_and_flags_win(jaxmotion, take, tmp_path, edited):
    preset = tmp_path / "house.toml"
    preset.write_text(
        "overwrite = true\njobs = 2\nalpha = 3\n[style]\nalpha = 1.5\nfade = 3\n"
        'joints = ["Left*", "Hips"]\nrange = "3:9"\n[style.gain]\n"*Arm*" = 2\n[denoise]\nlam = 9\n'
    )
    jaxmotion("style", take, "-o", "out", "--preset", preset, "--fade", "5", "--jobs", "1")
    [(edit, batch, running, selection)] = edited
    gains = (("*Arm*", 2.0),)
    want = {"alpha": 1.5, "gains": gains, "residual": 0.0}
    assert edit.keywords == want
    assert (batch.overwrite, batch.jobs, running.cache) == (True, 1, True)
    assert selection == Selection(1.0, ("Left*", "Hips"), (3, 9), 5)


@pytest.mark.parametrize(
    ("text", "word"),
    [("strenght = 1", "strenght"), ("[denoise]\nalpha = 1", "alpha"), ("a = [", "preset.toml")],
)
def test_bad_presets_are_usage_errors(jaxmotion, take, tmp_path, edited, text, word):
    preset = tmp_path / "preset.toml"
    preset.write_text(text)
    result = jaxmotion("denoise", take, "-o", "out", "--preset", preset, code=2)
    assert word in result.stderr
    assert edited == []


def test_missing_preset_and_bad_values(jaxmotion, take, tmp_path, edited):
    jaxmotion("denoise", take, "-o", "out", "--preset", tmp_path / "none.toml", code=2)
    preset = tmp_path / "preset.toml"
    preset.write_text("strength = 7")
    assert "7" in jaxmotion("denoise", take, "-o", "out", "--preset", preset, code=2).stderr


# What each command calls, and its options that are of no argument or of a part of one.
CALLS = {
    "align": ((timing.align,), {"path", "plot", "few-joints", "keep-contacts"}),
    "augment": ((augment,), {"count", "seed", "style", "margin"}),
    "blend": ((multiresolution.blend,), set()),
    "contacts": ((contacts.detect,), {"json", "restore"}),
    "convert": ((save_bvh, save_glb), {"to"}),
    "denoise": ((layers.denoise,), {"keep-contacts"}),
    "layers": ((layers.decompose,), set()),
    "multires": (
        (
            multiresolution.build_pyramid,
            multiresolution.scale_details,
            multiresolution.level_of_detail,
        ),
        set(),
    ),
    "mirror": ((mirror,), set()),
    "prior": ((motion_prior,), set()),
    "repair": ((cleaning.repair,), {"detect-only", "keep-contacts"}),
    "retime": (
        (layers.time_warp, timing.resample),
        {"to-fps", "speed", "ease-in", "ease-out", "keep-duration"},
    ),
    "stitch": ((multiresolution.stitch,), set()),
    "style": ((layers.stylize,), {"gain"}),
    "transfer": ((style.transfer_style,), {"amount", "reference"}),
}
GROUPS = [Batch, Joining, Reading, Running, Selection]
COMMON = {field for group in GROUPS for field in group.__dataclass_fields__} | {"range", "preset"}


@pytest.mark.parametrize("name", CALLS)
def test_options_have_the_names_of_the_arguments(name):
    functions, own = CALLS[name]
    arguments = {a for function in functions for a in inspect.signature(function).parameters}
    command = app.get_command(click.Context(app), name)
    for option in (p for p in command.params if isinstance(p, click.Option)):
        names = {opt.lstrip("-") for opt in option.opts}
        spelt = {n.removeprefix("no-").replace("-", "_") for n in names}
        assert spelt & (arguments | COMMON | {"cache"}) or names & own, f"{name}: {option.opts}"


def options_with_numbers():
    """Command, option, and the text before a number of it."""
    before = {"float": "", "float range": "", "PATTERN=GAIN": "*=", "G,G,...": "1,"}
    before["BEFORE=AFTER"] = "1="
    ctx = click.Context(app)
    commands = {name: app.get_command(ctx, name) for name in app.list_commands(ctx)}
    for name, command in commands.items():
        for option in command.params:
            if isinstance(option, click.Option) and option.type.name in before:
                yield name, option.opts[0], before[option.type.name]


@pytest.mark.parametrize("number", ["nan", "inf"])
def test_numbers_that_are_not_finite_are_usage_errors(jaxmotion, take, number):
    found = list(options_with_numbers())
    assert len(found) > 25
    for verb, option, before in found:
        files = {"align": 2, "blend": 3, "compare": 2, "demo": 0}.get(verb, 1) * [take]
        files = [*files, "--reference", take] if verb == "transfer" else files
        reads = ("check", "compare", "info", "demo", "view")
        out = [] if verb in reads else ["-o", "out.npz"]
        told = jaxmotion(verb, *files, *out, option, before + number, code=2).stderr
        assert option in told, (verb, told)
        assert "finite" in told or "range" in told


def test_both_names_of_an_option_are_one(jaxmotion, take, tmp_path, edited):
    jaxmotion("denoise", take, "-o", "out", "--paper")
    jaxmotion("denoise", take, "-o", "out", "--no-tune")
    preset = tmp_path / "house.toml"
    for key in ("auto", "tune"):
        preset.write_text(f"[denoise]\n{key} = false\n")
        jaxmotion("denoise", take, "-o", "out", "--preset", preset)
    assert [edit.keywords["options"] for edit, *_ in edited] == [{"tune": False}] * 4
