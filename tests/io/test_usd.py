"""USD files: read back by usd-core's own skeleton queries, and passed by its validators."""

import os
import sys
import warnings

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.io import MotionFileError, MotionFileWarning
from jaxmotion.io.usd import save_usd, viewer_note
from tests.interchange import CLIPS, ODD_NAMES, REAL, assert_close, named, walk

Usd = pytest.importorskip("pxr.Usd", reason="USD needs usd-core")
from pxr import Sdf, UsdGeom, UsdSkel  # noqa: E402


@pytest.fixture(params=[".usda", ".usdc"])
def path(request, tmp_path):
    return tmp_path / f"a{request.param}"


def save(motion, path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MotionFileWarning)
        jm.save(motion, path, **options)
    return Usd.Stage.Open(str(path))


def query(stage):
    root = UsdSkel.Root(stage.GetDefaultPrim())
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    [skeleton] = [prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Skeleton)]
    return cache.GetSkelQuery(UsdSkel.Skeleton(skeleton))


def world(stage):
    """Where joints and end sites are at every code from the first to the last, f64[T, N, 3]."""
    found = query(stage)
    codes = range(int(stage.GetStartTimeCode()), int(stage.GetEndTimeCode()) + 1)
    matrices = np.array([found.ComputeJointSkelTransforms(float(code)) for code in codes])
    return matrices[:, :, 3, :3]


def findings(path):
    """What the validators say that usd-core has; nothing of one that has none."""
    try:
        from pxr import UsdValidation as validation
    except ImportError:
        return []
    known = validation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(known) > 5
    found = validation.ValidationContext(known).Validate(Usd.Stage.Open(str(path)))
    return [f"{error.GetName()}: {error.GetMessage()}" for error in found]


@pytest.mark.parametrize("clip", CLIPS)
def test_joints_and_end_sites_are_where_they_were(clip, path):
    motion = CLIPS[clip]()
    stage = save(motion, path, metres=0.01)
    there = motion if motion.skeleton.up != "x" else jm.reorient(motion, "y")
    assert_close(world(stage), there)
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    assert UsdGeom.GetStageUpAxis(stage) == there.skeleton.up.upper()
    assert findings(path) == []


@pytest.mark.parametrize("name", REAL)
def test_real_captures(name, data_dir, path):
    motion = jm.load(data_dir / name)[:300]
    with pytest.warns(MotionFileWarning, match="by a guess: its joints then span 1"):
        jm.save(motion, path)
    stage = Usd.Stage.Open(str(path))
    assert_close(world(stage), motion)
    unit = 0.01 if "bandai" in name else 0.0254 / 0.45
    assert UsdGeom.GetStageMetersPerUnit(stage) == unit
    assert findings(path) == []


def test_the_validators_are_heard(tmp_path):
    """They find fault with a file that lacks what ours have."""
    pytest.importorskip("pxr.UsdValidation", reason="this usd-core has no validators")
    stage = save(walk(), tmp_path / "a.usda")
    text = stage.GetRootLayer().ExportToString().replace('    upAxis = "Y"\n', "")
    (tmp_path / "b.usda").write_text(text.replace("def SkelRoot", "def Xform"))
    assert len(findings(tmp_path / "b.usda")) >= 1


def test_what_the_recipe_asks_for(path):
    motion = walk()
    stage = save(motion, path)
    root = stage.GetDefaultPrim()
    assert root.IsA(UsdSkel.Root)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 60
    layer = stage.GetRootLayer()  # one stands in for the other where it is not said
    assert layer.HasTimeCodesPerSecond()
    assert layer.HasFramesPerSecond()
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 23)
    found = query(stage)
    animation = UsdSkel.Animation(found.GetAnimQuery().GetPrim())
    ends = [f"{motion.skeleton.names[joint]}_end" for joint in motion.skeleton.end_joints]
    skeleton = found.GetSkeleton()
    assert list(skeleton.GetJointNamesAttr().Get()) == [*motion.skeleton.names, *ends]
    assert list(animation.GetJointsAttr().Get()) == list(found.GetJointOrder())
    for attribute in (animation.GetTranslationsAttr(), animation.GetRotationsAttr()):
        assert attribute.GetTimeSamples() == [float(code) for code in range(24)]
    assert animation.GetScalesAttr().GetTimeSamples() == []
    np.testing.assert_array_equal(animation.GetScalesAttr().Get(), np.ones((27, 3)))
    rest = np.array(skeleton.GetRestTransformsAttr().Get())
    offsets = [*np.asarray(motion.skeleton.offsets), *np.asarray(motion.skeleton.end_offsets)]
    np.testing.assert_allclose(rest[:, 3, :3], offsets, atol=1e-12)
    bind = np.array(skeleton.GetBindTransformsAttr().Get())
    rests = found.ComputeJointSkelTransforms(0.0, atRest=True)
    np.testing.assert_allclose(bind, np.array(rests), atol=1e-7)
    [mesh] = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert UsdGeom.Imageable(mesh).ComputePurpose() == "guide"
    assert UsdSkel.BindingAPI(mesh).GetSkeleton().GetPrim() == skeleton.GetPrim()


def test_one_frame_is_sampled_too(path):
    stage = save(walk()[:1], path)
    animation = query(stage).GetAnimQuery()
    assert UsdSkel.Animation(animation.GetPrim()).GetRotationsAttr().GetTimeSamples() == [0.0]
    assert stage.GetEndTimeCode() == 0


def test_text_is_laid_out_as_three_reads_it(tmp_path):
    """Each sample, and each item of a prim's metadata, on a line of its own."""
    save(walk(), tmp_path / "a.usda")
    lines = (tmp_path / "a.usda").read_text().splitlines()
    for code in range(24):
        assert sum(line.lstrip().startswith(f"{code}: [(") for line in lines) == 2
    assert lines.count('        prepend apiSchemas = ["SkelBindingAPI"]') == 2


def test_names_become_identifiers_and_jointnames_keeps_them(path):
    names = (*ODD_NAMES, "a__b", "", " ", "line\nend", "é\u0301", "tail_end", "tail")
    clip = named(*names)
    with pytest.warns(MotionFileWarning) as caught:
        jm.save(clip, path, metres=1)
    [said] = [str(warning.message) for warning in caught]
    assert "but for jointNames: mixamorig:Hips as mixamorig_Hips, a b as a_b_2, a.b as " in said
    assert said.endswith("and 6 more")
    stage = Usd.Stage.Open(str(path))  # what is asked of it ends with it
    found = query(stage)
    assert list(found.GetSkeleton().GetJointNamesAttr().Get()) == [*names, "tail_end_2"]
    paths = list(found.GetJointOrder())
    own = [place.rpartition("/")[2] for place in paths]
    assert all(Sdf.Path.IsValidIdentifier(name) for name in own)
    assert len(set(own)) == len(own)
    assert own[4] == "a_b"  # what is an identifier already stays
    assert own[1:4] == ["a_b_2", "a_b_3", "a_b_4"]
    assert own[5:7] == ["_1st", "骨"]
    topology = UsdSkel.Topology(found.GetJointOrder())
    assert list(topology.GetParentIndices()) == [-1, *range(len(paths) - 1)]
    with pytest.raises(ValueError, match="cannot be written; expected text"):
        jm.save(named("a\0b"), path, metres=1)


@pytest.mark.parametrize("seconds", [1001 / 30000, 1 / 12.5, 0.0333333])
def test_rates_that_are_not_whole(seconds, path):
    stage = save(walk(frame_time=seconds), path)
    rate = stage.GetTimeCodesPerSecond()
    assert 1 / rate == pytest.approx(seconds, rel=2e-6)
    assert stage.GetFramesPerSecond() == rate
    assert stage.GetEndTimeCode() == 23


def test_the_up_axis(path):
    motion = walk()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jm.save(jm.reorient(motion, "z"), path)
        assert UsdGeom.GetStageUpAxis(Usd.Stage.Open(str(path))) == "Z"
        jm.save(jm.reorient(motion, "z"), path.with_stem("b"), up="y")
        assert UsdGeom.GetStageUpAxis(Usd.Stage.Open(str(path.with_stem("b")))) == "Y"
    with pytest.warns(MotionFileWarning, match="turned from x up to y up, as USD knows only"):
        jm.save(jm.reorient(motion, "x"), path.with_stem("c"))


def test_what_viewers_make_of_the_rate_is_told():
    assert "set 60 frames a second" in viewer_note(walk())
    assert viewer_note(walk(frame_time=1 / 24)) == ""


@pytest.mark.parametrize("stem", ["take 1", "1", "é", "Skeleton", "a.b"])
def test_the_root_is_named_after_the_file(stem, path):
    stage = save(walk()[:2], path.with_name(stem + path.suffix))
    assert stage.GetDefaultPrim().IsA(UsdSkel.Root)
    assert world(stage).shape == (2, 27, 3)


def test_what_cannot_be_written_is_refused_and_leaves_nothing(path):
    motion = walk()
    broken = motion.replace(rotations=motion.rotations.at[2, 1].set(np.nan))
    with pytest.raises(ValueError, match=r"^save: rotations of '.*' at frame 2 are not finite"):
        jm.save(broken, path)
    with pytest.raises(ValueError, match="save_usd: lengths that are too large for float32"):
        jm.save(motion.replace(translations=motion.translations * 1e39), path, metres=1)
    with pytest.raises(ValueError, match="save_usd: metres=0"):
        jm.save(motion, path, metres=0)
    with pytest.raises(ValueError, match=r"'\.usdz'; expected '\.usda' or '\.usdc'"):
        save_usd(motion, path.with_suffix(".usdz"))
    assert not os.listdir(path.parent)


def test_a_file_is_written_whole_and_only_if_it_may(path):
    path.write_text("mine")
    with pytest.raises(FileExistsError, match="overwrite=True"):
        jm.save(walk(), path, overwrite=False)
    assert path.read_text() == "mine"
    jm.save(walk(), path)
    assert os.listdir(path.parent) == [path.name]
    first = path.read_bytes()
    jm.save(walk(), path)
    assert path.read_bytes() == first


def test_it_is_not_read(path):
    jm.save(walk(), path)
    with pytest.raises(MotionFileError, match=r"'\.usd[ac]', a format that is written only"):
        jm.load(path)


def test_without_the_extra(path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(ImportError, match=r"needs usd-core: pip install 'jaxmotion\[usd\]'"):
        jm.save(walk(), path)
    assert not os.listdir(path.parent)
