"""glTF files: read back by a NumPy reader of their bytes, by trimesh and by pygltflib."""

import json
import os
import struct
import sys
import warnings

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.io import MotionFileError, MotionFileWarning
from jaxmotion.io.gltf import viewer_note
from jaxmotion.io.interchange import rate_of
from tests.helpers import no_shape_checks, random_motion, single_precision
from tests.interchange import CLIPS, ODD_NAMES, REAL, assert_close, named, places, walk

pygltflib = pytest.importorskip("pygltflib", reason="glTF needs pygltflib")
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Glb:
    """A .glb file by its specification, from its bytes."""

    def __init__(self, path):
        data = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON"
        assert size % 4 == 0
        self.doc = json.loads(data[20 : 20 + size])
        rest = data[20 + size :]
        size, kind = struct.unpack_from("<I4s", rest)
        assert kind == b"BIN\0"
        assert size % 4 == 0
        self.binary = rest[8 : 8 + size]
        [buffer] = self.doc["buffers"]
        assert size - 3 <= buffer["byteLength"] <= size

    def array(self, number):
        accessor = self.doc["accessors"][number]
        view = self.doc["bufferViews"][accessor["bufferView"]]
        width, count = WIDTHS[accessor["type"]], accessor["count"]
        start = accessor.get("byteOffset", 0)
        assert accessor["componentType"] == 5126
        assert start % 4 == view.get("byteOffset", 0) % 4 == 0
        assert start + 4 * width * count <= view["byteLength"]
        start += view.get("byteOffset", 0)
        values = np.frombuffer(self.binary, "<f4", width * count, start)
        return values.reshape(count, width)[:, 0] if width == 1 else values.reshape(count, width)

    @property
    def parents(self):
        found = [-1] * len(self.doc["nodes"])
        for number, node in enumerate(self.doc["nodes"]):
            for child in node.get("children", ()):
                assert found[child] == -1
                found[child] = number
        return found

    def world(self):
        """Transforms of all nodes in all frames, f64[T, N, 4, 4], and the seconds."""
        [animation] = self.doc["animations"]
        [clock] = {sampler["input"] for sampler in animation["samplers"]}
        seconds = self.array(clock)
        local = np.tile(np.eye(4), (len(seconds), len(self.doc["nodes"]), 1, 1))
        for number, node in enumerate(self.doc["nodes"]):
            assert not {"matrix", "rotation", "scale"} & set(node)
            local[:, number, :3, 3] = node.get("translation", 0)
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            assert sampler["interpolation"] == "LINEAR"
            values = self.array(sampler["output"]).astype(np.float64)
            node = channel["target"]["node"]
            if channel["target"]["path"] == "rotation":
                assert (np.einsum("tc,tc->t", values[1:], values[:-1]) >= 0).all()
                np.testing.assert_allclose(np.linalg.norm(values, axis=-1), 1, atol=1e-6)
                local[:, node, :3, :3] = Rotation.from_quat(values).as_matrix()
            else:
                assert channel["target"]["path"] == "translation"
                local[:, node, :3, 3] = values
        for node, parent in enumerate(self.parents):
            if parent >= 0:
                assert parent < node
                local[:, node] = local[:, parent] @ local[:, node]
        return local, seconds


def save(motion, path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MotionFileWarning)
        jm.save(motion, path, **options)
    return Glb(path)


@pytest.mark.parametrize("metres", [1.0, 0.01])
@pytest.mark.parametrize("clip", CLIPS)
def test_joints_and_end_sites_are_where_they_were(clip, metres, tmp_path):
    motion = CLIPS[clip]()
    glb = save(motion, tmp_path / "a.glb", metres=metres)
    world, seconds = glb.world()
    assert_close(world[..., :3, 3], jm.reorient(motion, "y"), metres)
    np.testing.assert_allclose(seconds, np.arange(len(seconds)) / rate_of(motion), rtol=1e-6)
    skeleton = motion.skeleton
    assert glb.parents == [*skeleton.parents, *skeleton.end_joints]


@pytest.mark.parametrize("name", REAL)
def test_real_captures(name, data_dir, tmp_path):
    motion = jm.load(data_dir / name)[:300]
    with pytest.warns(MotionFileWarning, match="by a guess: its joints then span 1"):
        jm.save(motion, tmp_path / "a.glb")
    scale = 0.01 if "bandai" in name else 0.0254 / 0.45
    assert_close(Glb(tmp_path / "a.glb").world()[0][..., :3, 3], motion, scale)


@pytest.mark.parametrize("clip", ["walk", "six channels", "zero offsets", "z up", "one joint"])
def test_the_skin_holds_every_node_and_its_rest(clip, tmp_path):
    """Inverse bind matrices undo the rest: trimesh's place of every node, which is not animated."""
    trimesh = pytest.importorskip("trimesh", reason="checked by trimesh")
    glb = save(CLIPS[clip](), tmp_path / "a.glb", metres=2.0)
    [skin] = glb.doc["skins"]
    nodes = glb.doc["nodes"]
    assert skin["joints"] == list(range(len(nodes)))
    assert skin["skeleton"] == 0
    assert glb.doc["scenes"][glb.doc["scene"]]["nodes"] == [0]
    inverse = glb.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
    np.testing.assert_array_equal(inverse[:, 3], np.tile([0, 0, 0, 1], (len(nodes), 1)))
    graph = trimesh.load(tmp_path / "a.glb").graph
    for node, matrix in zip(nodes, inverse, strict=True):
        rest, _ = graph.get(node["name"])
        np.testing.assert_allclose(matrix @ rest, np.eye(4), atol=1e-5)


def test_what_the_recipe_asks_for(tmp_path):
    motion = walk()
    glb = save(motion, tmp_path / "a.glb")
    [animation] = glb.doc["animations"]
    paths = [channel["target"]["path"] for channel in animation["channels"]]
    assert paths == ["rotation"] * 22 + ["translation"]  # only the root leaves its offset
    clock = glb.doc["accessors"][animation["samplers"][0]["input"]]
    seconds = glb.array(animation["samplers"][0]["input"])
    assert clock["min"] == [0.0]
    assert np.float32(clock["max"][0]) == seconds[-1] == np.float32(23 / 60)
    assert (np.diff(seconds) > 0).all()
    assert "meshes" not in glb.doc or glb.doc["meshes"] == []
    assert glb.doc["asset"]["version"] == "2.0"
    names = [node["name"] for node in glb.doc["nodes"]]
    ends = [f"{motion.skeleton.names[joint]}_end" for joint in motion.skeleton.end_joints]
    assert names == [*motion.skeleton.names, *ends]
    library = pygltflib.GLTF2().load(str(tmp_path / "a.glb"))
    assert [node.name for node in library.nodes] == names


def test_translations_are_written_of_joints_that_leave_their_offsets(tmp_path):
    motion = CLIPS["off their offsets"]()
    [animation] = save(motion, tmp_path / "a.glb").doc["animations"]
    paths = [(c["target"]["path"], c["target"]["node"]) for c in animation["channels"]]
    assert [node for path, node in paths if path == "translation"] == [0, 2, 3]


def test_names_stay_as_they_are_and_long_ones_are_told(tmp_path):
    long = "骨" * 22
    clip = named(*ODD_NAMES, "tail", "tail_end", long)
    with pytest.warns(MotionFileWarning, match="more than 63 bytes, which Blender cuts off: 骨骨"):
        jm.save(clip, tmp_path / "a.glb", metres=1)
    names = [node["name"] for node in Glb(tmp_path / "a.glb").doc["nodes"]]
    assert names == [*ODD_NAMES, "tail", "tail_end", long, f"{long}_end"]
    ends = jm.Skeleton(
        ["a", "a_end"],
        [-1, 0],
        np.ones((2, 3)),
        end_joints=[0, 0],
        end_offsets=np.array([[1.0, 0, 0], [0, 1.0, 0]]),
    )
    motion = random_motion(np.random.default_rng(0), 2, ends)
    nodes = save(motion, tmp_path / "b.glb").doc["nodes"]
    assert [node["name"] for node in nodes] == ["a", "a_end", "a_end_2", "a_end_3"]
    for name in ("a\0b", "a\udcff"):
        with pytest.raises(ValueError, match="cannot be written; expected text"):
            jm.save(named(name), tmp_path / "c.glb", metres=1)


@pytest.mark.parametrize(
    ("scale", "metres", "said"),
    [
        (1.0, 1.0, "a metre"),
        (100.0, 0.01, "a centimetre"),
        (1000.0, 0.001, "a millimetre"),
        (40.0, 0.0254, "for an inch,"),
        (17.7, 0.0254 / 0.45, "as CMU's"),
        (1e-3, 1.0, "a metre"),
        (1e7, 0.001, "a millimetre"),
    ],
)
def test_the_unit_is_guessed_and_said(scale, metres, said, tmp_path):
    motion = untold(walk(), scale)
    with pytest.warns(MotionFileWarning, match=rf"{said}.*by a guess.*metres= \(--metres\)"):
        jm.save(motion, tmp_path / "a.glb")
    assert_close(Glb(tmp_path / "a.glb").world()[0][..., :3, 3], motion, metres)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jm.save(motion, tmp_path / "b.glb", metres=metres)
    assert (tmp_path / "a.glb").stat().st_size == (tmp_path / "b.glb").stat().st_size


def untold(motion, scale=1.0):
    """The motion in another unit, which nothing tells."""
    skeleton = motion.skeleton
    plain = jm.Skeleton(
        skeleton.names,
        skeleton.parents,
        skeleton.offsets * scale,
        end_joints=skeleton.end_joints,
        end_offsets=skeleton.end_offsets * scale,
    )
    return motion.replace(skeleton=plain, translations=motion.translations * scale)


def test_a_point_has_no_height_to_guess_by(tmp_path):
    skeleton = jm.Skeleton(["a"], [-1], np.zeros((1, 3)))
    motion = random_motion(np.random.default_rng(0), 2, skeleton)
    with pytest.warns(MotionFileWarning, match="a metre, by a guess: nothing shows it"):
        jm.save(motion, tmp_path / "a.glb")


@pytest.mark.parametrize("metres", [0, -1.0, np.nan, np.inf, True, "cm"])
def test_impossible_units_are_refused(metres, tmp_path):
    with no_shape_checks(), pytest.raises(ValueError, match="save_glb: metres="):
        jm.save(walk(), tmp_path / "a.glb", metres=metres)
    with no_shape_checks(), pytest.raises(ValueError, match="metres has shape"):
        jm.save(walk(), tmp_path / "a.glb", metres=np.ones(2))
    assert not os.listdir(tmp_path)


def test_the_up_axis(tmp_path):
    motion = jm.reorient(walk(), "z")
    with pytest.warns(MotionFileWarning, match="turned from z up to y up, as glTF is"):
        jm.save(motion, tmp_path / "a.glb", metres=1)
    with pytest.warns(MotionFileWarning, match="z points up, but readers of glTF take it that y"):
        jm.save(motion, tmp_path / "b.glb", metres=1, up="keep")
    assert_close(Glb(tmp_path / "b.glb").world()[0][..., :3, 3], motion)


@pytest.mark.parametrize(
    ("seconds", "rate"),
    [
        (1 / 30, 30),
        (0.0333333, 30),
        (0.033333, 30),
        (0.008333, 120),
        (0.0083333, 120),
        (0.016667, 60),
        (1001 / 30000, 30000 / 1001),
        (0.0417083, 24000 / 1001),
        (1 / 12.5, 12.5),
        (0.0333, None),
        (1 / 29.9, 29.9),
        (3.0, None),
        (1e-3, 1000),
    ],
)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_rate_that_was_meant(seconds, rate, dtype):
    motion = walk().astype(dtype).replace(frame_time=np.asarray(seconds, dtype))
    found = rate_of(motion)
    if rate is None:
        assert dtype(1 / found) == dtype(seconds)
    else:
        assert found == pytest.approx(rate, rel=1e-15)


def test_what_viewers_make_of_the_rate_is_told():
    assert "set 60 frames a second, and the last frame, before" in viewer_note(walk())
    note = viewer_note(walk(frame_time=1001 / 30000))
    assert "30 frames a second with base 0.999001" in note
    assert "base 1.001000 after it" in note


def test_what_cannot_be_written_is_refused_and_leaves_nothing(tmp_path):
    path = tmp_path / "a.glb"
    motion = walk()
    broken = motion.replace(translations=motion.translations.at[3, 4].set(jnp.nan))
    with pytest.raises(ValueError, match=r"^save: translations of '.*' at frame 3 are not finite"):
        jm.save(broken, path)
    lost = motion.replace(rotations=motion.rotations.at[2, 1].set(jnp.inf))
    with pytest.raises(ValueError, match=r"^save: rotations of '.*' at frame 2 are not finite"):
        jm.save(lost, path)
    with pytest.raises(ValueError, match="float32"):
        jm.save(motion.replace(translations=motion.translations * 1e39), path, metres=1)
    quick = random_motion(np.random.default_rng(0), 3, 1).replace(frame_time=1e-40)
    with pytest.raises(ValueError, match="told apart"):
        jm.save(quick.replace(frame_time=1e-50), path, metres=1)
    skeleton = jm.Skeleton(["a"], [-1], np.full((1, 3), np.nan))
    with pytest.raises(ValueError, match="offsets and end_offsets must be finite"):
        jm.save(random_motion(np.random.default_rng(0), 2, skeleton), path)
    with pytest.raises(ValueError, match="one clip at a time"):
        jm.save(random_motion(np.random.default_rng(0), 2, 3, batch=(2,)), path)
    assert not os.listdir(tmp_path)


def test_a_file_is_written_whole_and_only_if_it_may(tmp_path):
    path = tmp_path / "a.GLB"
    path.write_text("mine")
    with pytest.raises(FileExistsError, match="overwrite=True"):
        jm.save(walk(), path, overwrite=False)
    assert path.read_text() == "mine"
    jm.save(walk(), path)
    assert os.listdir(tmp_path) == ["a.GLB"]
    first = path.read_bytes()
    jm.save(walk(), path)
    assert path.read_bytes() == first


def test_it_is_not_read(tmp_path):
    jm.save(walk(), tmp_path / "a.glb")
    with pytest.raises(MotionFileError, match=r"'\.glb', a format that is written only"):
        jm.load(tmp_path / "a.glb")


def test_without_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pygltflib", None)
    with pytest.raises(ImportError, match=r"needs pygltflib: pip install 'jaxmotion\[gltf\]'"):
        jm.save(walk(), tmp_path / "a.glb")
    assert not os.listdir(tmp_path)


def test_inputs_are_untouched_and_single_precision_will_do(tmp_path):
    motion = walk()
    before = np.array(motion.rotations), np.array(motion.translations)
    jm.save(motion, tmp_path / "a.glb")
    np.testing.assert_array_equal(motion.rotations, before[0])
    np.testing.assert_array_equal(motion.translations, before[1])
    with single_precision():
        small = motion.astype(np.float32)
        jm.save(small, tmp_path / "b.glb")
    assert_close(Glb(tmp_path / "b.glb").world()[0][..., :3, 3], motion)
    assert places(motion)[1] > 1
