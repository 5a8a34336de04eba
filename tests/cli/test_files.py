"""Which files go in and where outputs go."""

from pathlib import Path

import click
import numpy as np
import pytest

from jaxmotion.cli import _files


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A folder of empty files, the current one."""
    names = [
        "a.bvh",
        "sub/b.BVH",
        "sub/deep/c.amc",
        "sub/c.asf",
        ".hidden/d.bvh",
        ".e.bvh",
        "n.txt",
    ]
    for name in names:
        path = tmp_path / "takes" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def relative(inputs):
    return [item.relative.as_posix() for item in inputs]


def test_a_folder_is_searched_through(tree):
    assert relative(_files.expand(["takes"])) == ["a.bvh", "sub/b.BVH", "sub/deep/c.amc"]


def test_a_pattern_is_relative_to_its_fixed_part(tree):
    assert relative(_files.expand(["takes/sub/**/*.amc"])) == ["deep/c.amc"]
    assert relative(_files.expand(["takes/*.bvh"])) == ["a.bvh"]


def test_a_file_is_taken_once(tree):
    assert relative(_files.expand(["takes/a.bvh", "takes/*.bvh", "takes"])).count("a.bvh") == 1


def test_a_name_with_wildcards_that_exists_is_a_file(tree):
    (tree / "odd[1].bvh").touch()
    assert relative(_files.expand(["odd[1].bvh"])) == ["odd[1].bvh"]


def test_several_folders_keep_their_names(tree):
    inputs = _files.expand(["takes", "takes/sub"])
    assert relative(inputs)[0] == "takes/a.bvh"


@pytest.mark.parametrize("name", ["gone.bvh", "gone*.bvh", "empty"])
def test_nothing_found_is_a_usage_error(tree, name):
    (tree / "empty").mkdir()
    with pytest.raises(click.UsageError):
        _files.expand([name])


def test_an_output_folder_inside_the_input_folder_is_not_an_input(tree):
    (tree / "takes/clean").mkdir()
    (tree / "takes/clean/a.bvh").touch()
    assert "clean/a.bvh" not in relative(_files.expand(["takes"], avoid=Path("takes/clean")))
    assert relative(_files.expand(["takes/sub"], avoid=Path("takes")))[0] == "b.BVH"


def test_archives_that_are_no_motions_are_left_out_of_folders(tree):
    np.savez("takes/shape.npz", betas=np.zeros(3))
    np.savez("takes/amass.npz", poses=np.zeros(3), trans=np.zeros(3))
    found = relative(_files.expand(["takes"]))
    assert "shape.npz" not in found
    assert "amass.npz" in found


def test_outputs_mirror_the_tree(tree):
    jobs = _files.plan(_files.expand(["takes"]), Path("out"), to=".npz")
    assert [job.target.as_posix() for job in jobs] == [
        "out/a.npz",
        "out/sub/b.npz",
        "out/sub/deep/c.npz",
    ]


def test_one_input_may_name_its_output(tree):
    [job] = _files.plan(_files.expand(["takes/a.bvh"]), Path("x.amc"))
    assert job.target == Path("x.amc")
    with pytest.raises(click.UsageError, match="one file for 3 inputs"):
        _files.plan(_files.expand(["takes"]), Path("x.bvh"))
    with pytest.raises(click.UsageError, match="disagree"):
        _files.plan(_files.expand(["takes/a.bvh"]), Path("x.bvh"), to=".npz")


def test_an_output_over_an_input_is_refused(tree):
    inputs = _files.expand(["takes"])
    with pytest.raises(click.UsageError, match="over an input"):
        _files.plan(inputs, Path("takes"))
    with pytest.raises(click.UsageError, match="over an input"):
        _files.plan(_files.expand(["takes/a.bvh"]), Path("takes/sub/../a.bvh"))


def test_two_inputs_for_one_output_are_refused(tree):
    (tree / "takes/a.amc").touch()
    with pytest.raises(click.UsageError, match="both be written"):
        _files.plan(_files.expand(["takes"]), Path("out"), to=".bvh")


def test_layer_folders(tree):
    inputs = _files.expand(["takes/a.bvh"])
    assert _files.plan_folders(inputs, Path("out"))[0].target == Path("out")
    jobs = _files.plan_folders(_files.expand(["takes"]), Path("out"))
    assert jobs[1].target == Path("out/sub/b")
    with pytest.raises(click.UsageError, match="is a file"):
        _files.plan_folders(inputs, Path("takes/a.bvh"))


@pytest.mark.parametrize(
    "words",
    ["convert", "denoise", "layers", "style --alpha 2", "multires --level 1", "retime --frames 9"],
)
def test_an_output_of_no_format_is_refused_never_made_a_folder(jaxmotion, take, tmp_path, words):
    verb, *rest = words.split()
    out = tmp_path / "clean.fbx"
    result = jaxmotion(verb, take, *rest, "-o", out, code=2)
    assert (
        "'.fbx'; expected .bvh, .amc (with its .asf), .npz, .glb, .usda or .usdc" in result.stderr
    )
    assert "may end with '/'" in result.stderr
    assert "name the .amc file" in jaxmotion(verb, take, "-o", "clean.asf", code=2).stderr
    assert not out.exists()


@pytest.mark.parametrize("verb", ["layers", "demo"])
def test_a_folder_is_not_named_like_a_file(jaxmotion, take, tmp_path, verb):
    words = (verb, take) if verb == "layers" else (verb,)
    assert "folder" in jaxmotion(*words, "-o", tmp_path / "parts.bvh", code=2).stderr
    assert not (tmp_path / "parts.bvh").exists()


def test_folders_may_have_dots_in_their_names(jaxmotion, tree, take):
    Path("there.v2").mkdir()
    for out in ("takes.2026.11", "there.v2", "new.v2/"):
        words = ("convert", take, "-o", out, "--to", "npz", "--dry-run")
        assert f" -> {Path(out) / 'take.npz'}" in jaxmotion(*words).stdout
