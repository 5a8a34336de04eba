"""Spellings, channel orders, labels and ASF bones: kept for the file, no business of JAX's."""

import copy
import dataclasses
import logging
import pickle

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import Motion, Skeleton, multiresolution, samples
from jaxmotion._asf_bone import AsfBone
from jaxmotion._file_facts import FileFact, compiled
from jaxmotion.confine import confine
from jaxmotion.io import MotionFileWarning
from jaxmotion.multiresolution import blend, build_pyramid, stitch
from tests.helpers import assert_same_rotation, random_quaternions

POSITIONS = ("Xposition", "Yposition", "Zposition")
A_CHANNELS = ((*POSITIONS, "Zrotation", "Xrotation", "Yrotation"),) + 3 * (
    ("Zrotation", "Xrotation", "Yrotation"),
)
B_CHANNELS = (
    ("Yrotation", "Xrotation", "Zrotation", *POSITIONS),
    ("Xrotation", "Yrotation", "Zrotation"),
    ("Yrotation", "Zrotation", "Xrotation"),
    (),
)
A_BONES = tuple(AsfBone(axis=(0.0, 10.0 * j, 0.0)) for j in range(4))
B_BONES = tuple(AsfBone(axis=(5.0, 0.0, 20.0 * j), axis_order="ZYX") for j in range(4))


def clip(rng, text, label, channels, bones=(), *, seconds=0.016666668, frames=9) -> Motion:
    """Four joints in a chain; the last one keeps still, so that any channels can say what it does.

    The first three turn smoothly, so that nothing has to be resampled to be compared.
    """
    skeleton = Skeleton(
        ["Hips", "Spine", "Arm", "Hand"],
        [-1, 0, 1, 2],
        np.array([[0.0, 0, 0], [0, 2, 0], [1, 0, 0], [1, 0.5, 0]]),
        end_joints=(3,),
        end_offsets=np.array([[0.5, 0, 0]]),
        end_labels=(label,),
        channels=channels,
        asf=bones,
    )
    q = np.array(random_quaternions(rng, (frames, 4), angle=1.0))
    q[:, 3] = (1, 0, 0, 0)
    root = np.cumsum(rng.standard_normal((frames, 3)), axis=0)
    return Motion.from_root(skeleton, jnp.asarray(root), q, seconds, frame_time_text=text)


@pytest.fixture
def a():
    return clip(np.random.default_rng(1), "0.016666668", "End Site", A_CHANNELS, A_BONES)


@pytest.fixture
def b():
    return clip(np.random.default_rng(2), "0.0166666680", "End site", B_CHANNELS, B_BONES)


def facts(motion: Motion):
    skeleton = motion.skeleton
    return motion.frame_time_text, skeleton.end_labels, skeleton.channels, skeleton.asf


def test_facts_are_no_part_of_the_structure(a, b):
    assert facts(a) != facts(b)
    one, other = jax.tree.structure(a), jax.tree.structure(b)
    assert one == other
    assert hash(one) == hash(other)
    assert hash(FileFact("End Site")) == hash(FileFact(("End site",)))
    stacked = jax.tree.map(lambda *x: jnp.stack(x), a, b)
    assert stacked.rotations.shape == (2, 9, 4, 4)
    assert facts(stacked) == facts(a)
    assert eqx.tree_equal(a, eqx.tree_at(lambda m: m.rotations, b, a.rotations)) is not True
    same = Motion(b.skeleton, a.translations, a.rotations, a.frame_time, translated_joints=(0,))
    assert bool(eqx.tree_equal(a, same))
    assert bool(a == same)
    other = Motion(dataclasses.replace(b.skeleton, up="z"), *jax.tree.leaves(a)[2:])
    assert jax.tree.structure(other) != one


def test_facts_are_fields_like_any_other(a, b):
    """Copies, pickles and functions of pytrees keep each clip's own; replacing one takes."""
    for motion in (a, b):
        for other in (
            copy.copy(motion),
            copy.deepcopy(motion),
            pickle.loads(pickle.dumps(motion)),
            jax.tree.map(lambda x: x, motion),
            jax.tree.unflatten(jax.tree.structure(motion), jax.tree.leaves(motion)),
            eqx.tree_at(lambda m: m.translations, motion, 2 * motion.translations),
            eqx.combine(*eqx.partition(motion, eqx.is_array)),
            dataclasses.replace(motion, frame_time=0.1),
            motion.with_transforms(),
            motion.astype(np.float32),
            motion[2:5],
        ):
            assert facts(other) == facts(motion)
    changed = dataclasses.replace(a, frame_time_text=None)
    assert changed.frame_time_text is None
    assert facts(changed)[1:] == facts(a)[1:]
    skeleton = dataclasses.replace(a.skeleton, asf=(), channels=B_CHANNELS)
    assert (skeleton.asf, skeleton.channels) == ((), B_CHANNELS)
    assert skeleton.end_labels == a.skeleton.end_labels
    assert "0.016666668" in a._repr_html_()
    with pytest.raises(AttributeError):
        a.frame_time_text = "0.1"
    assert not hasattr(object.__new__(Motion), "frame_time_text")
    with pytest.raises(TypeError, match="Pyramid: frame_time_text is missing"):
        multiresolution.Pyramid(a, (), None, None, (9,), (), False)
    with pytest.raises(ValueError, match="channels must have 4 entries, got 1"):
        dataclasses.replace(a.skeleton, channels=[()])


def test_clips_that_only_their_files_tell_apart_compile_once(a, b, caplog):
    edited = jm.denoise(a)
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        other = jm.denoise(b)
    assert "Compiling" not in caplog.text
    assert facts(edited) == facts(a)
    assert facts(other) == facts(b)


def _pyramids(motion):
    pyramid = build_pyramid(motion, 1)
    return pyramid.base, pyramid.reconstruct(), pyramid


EDITS = {
    "confine": lambda m: confine(m, m.with_transforms(2 * m.translations), 0.5),
    "decompose": lambda m: jm.decompose(m).base,
    "synthesize": lambda m: jm.synthesize(jm.decompose(m)),
    "pyramid base": lambda m: _pyramids(m)[0],
    "reconstruct": lambda m: _pyramids(m)[1],
    "reduce": lambda m: multiresolution.reduce(m),
    "expand": lambda m: multiresolution.expand(m),
    "compress": lambda m: multiresolution.compress(
        m, rotation_tolerance=0.1, translation_tolerance=0.1, levels=1
    ).decompress(),
    "stitch": lambda m: stitch([m, m], 1),
    "add_noise": lambda m: samples.add_noise(m, jax.random.key(7)).motion,
    "drop_frames": lambda m: samples.drop_frames(m, jax.random.key(7)).motion,
    "slide_root": lambda m: samples.slide_root(m, jax.random.key(7)).motion,
    "flip_signs": lambda m: samples.flip_signs(m, jax.random.key(7)).motion,
    "freeze_joints": lambda m: samples.freeze_joints(m, jax.random.key(7), length=(1, 3)).motion,
}


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
def test_results_have_the_facts_of_their_own_clip(edit, a, b):
    """Not of the clip that the function was compiled for."""
    before = edit(a)
    after = edit(b)
    assert facts(before)[1:] == facts(a)[1:]
    assert facts(after)[1:] == facts(b)[1:]
    for motion, source in ((before, a), (after, b)):
        kept = motion.frame_time == source.frame_time
        assert motion.frame_time_text in ((source.frame_time_text,) if kept else (None,))


def test_of_many_clips_each_fact_goes_where_it_came_from(a, b):
    """A blend is the second clip with what the first has: its facts are the second's."""
    blends = blend(a, a, a, 1), blend(a, a, b, 1), blend(b, b, a, 1)
    assert [facts(m) for m in blends] == [facts(a), facts(b), facts(a)]
    assert facts(multiresolution.follow(b, a)) == facts(a)
    assert facts(multiresolution.follow(a, b)) == facts(b)

    @compiled
    def shuffled(clips):
        return {"last": clips[1], "both": (clips[0][::2], [clips[0]]), "text": clips[0].num_frames}

    for one, other in ((a, a), (a, b), (b, a)):
        result = shuffled([one, other])
        assert facts(result["last"]) == facts(other)
        assert facts(result["both"][1][0]) == facts(one)
        assert result["both"][0].frame_time_text is None
        assert result["both"][0].skeleton.channels == one.skeleton.channels
        assert result["text"] == 9


def test_a_compiled_function_cannot_read_facts(a):
    @compiled
    def counted(motion):
        return sum(len(names) for names in motion.skeleton.channels)

    with pytest.raises(TypeError):
        counted(a)


@pytest.mark.parametrize("suffix", [".bvh", ".amc", ".npz"])
@pytest.mark.filterwarnings("ignore::jaxmotion.io.MotionFileWarning")
def test_files_are_right_with_the_facts_of_another_clip(suffix, a, b, tmp_path):
    """Under a caller's jit the facts are those of the clip traced; the motion written is not."""
    turned = jax.jit(lambda m: m.with_transforms(m.translations + 1.0))
    slower = dataclasses.replace(b, frame_time=0.04170837504, frame_time_text="0.04170837504")
    turned(a)
    for source in (b, slower):
        result = turned(source)
        assert facts(result) == facts(a)
        jm.save(result, tmp_path / f"b{suffix}")
        back = jm.load(tmp_path / f"b{suffix}")
        np.testing.assert_allclose(back.frame_time, source.frame_time, rtol=1e-15)
        np.testing.assert_allclose(back.translations, source.translations + 1, atol=1e-12)
        assert_same_rotation(back.rotations, source.rotations, 1e-12)
    if suffix == ".bvh":
        assert "Frame Time: 0.04170837504\n" in (tmp_path / "b.bvh").read_text()


def test_channels_of_another_clip_are_completed(a, b, tmp_path):
    """A clip whose joints turn about more axes than the channels it got can say."""
    kept = jax.jit(lambda m: m.with_transforms())
    kept(b)
    rotations = np.array(a.rotations)
    rotations[:, 3] = rotations[:, 1]
    turning = kept(a.with_transforms(rotations=rotations))
    assert turning.skeleton.channels == B_CHANNELS
    with pytest.warns(MotionFileWarning, match="added to 1 joints so that nothing is lost: Hand"):
        jm.save(turning, tmp_path / "a.bvh")
    assert_same_rotation(jm.load(tmp_path / "a.bvh").rotations, rotations, 1e-12)


def test_two_subjects_of_acclaim_files_are_one_structure(data_dir, tmp_path):
    """Lengths and axes of bones differ from subject to subject, names and tree do not."""
    one = jm.load(data_dir / "cmu" / "01_01.amc")[:5]
    other = jm.load(data_dir / "cmu" / "02_03.amc")[:5]
    assert one.skeleton.asf != other.skeleton.asf
    assert jax.tree.structure(one) == jax.tree.structure(other)
    second = jax.tree.map(lambda *x: jnp.stack(x)[1], one, other)
    assert second.skeleton.asf == one.skeleton.asf
    jm.save(second, tmp_path / "second.amc")
    back = jm.load(tmp_path / "second.amc")
    size = np.abs(other.skeleton.offsets).max()
    np.testing.assert_allclose(back.skeleton.offsets, other.skeleton.offsets, atol=1e-12 * size)
    np.testing.assert_allclose(back.translations, other.translations, atol=1e-12 * size)
    assert_same_rotation(back.rotations, other.rotations, 1e-9)
