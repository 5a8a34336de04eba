"""Every result says what it is in one line, whatever stands in the place of its arrays."""

import html.parser
import logging

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import contacts, metrics
from jaxmotion._summary import brief, by_field, line, timing
from jaxmotion.displacement import minus
from tests.helpers import no_shape_checks, random_motion, random_skeleton
from tests.results import FRAMES, NAMES, example, motion, result_types

HOSTILE = "<script>alert(1)</script>\n\x1b[31m & \u202e" + 300 * "x"


def assert_one_line(thing, name: str):
    text = repr(thing)
    assert text.startswith(f"{name}("), text
    assert text.isprintable(), text
    assert len(text) < 120, text


def stand_ins(thing):
    """What tree maps, transformations and programs put in the place of arrays."""
    mapped = lambda f: jax.tree.map(f, thing)  # noqa: E731
    yield mapped(np.asarray)
    yield mapped(lambda x: np.stack([x, x]))
    yield mapped(lambda x: np.broadcast_to(x, (2, 3, *np.shape(x))))
    yield mapped(lambda x: jax.ShapeDtypeStruct(np.shape(x), np.float32))
    yield mapped(lambda x: np.zeros(np.shape(x), jax.dtypes.float0))
    yield mapped(lambda x: np.ravel(x)[:1])
    yield mapped(lambda x: np.full(np.shape(x), np.nan))
    for leaf in (None, True, 3, (), HOSTILE, object(), jax.random.key(0), [1, 2]):
        yield mapped(lambda x, leaf=leaf: leaf)
    yield mapped(np.shape)


def test_every_result_has_an_example():
    assert set(NAMES) == set(result_types())


@pytest.mark.parametrize("name", NAMES)
def test_results_are_one_line(name):
    thing = example(name)
    assert_one_line(thing, name)
    with no_shape_checks():  # they would find the stand-ins out
        for other in stand_ins(thing):
            if type(other) is type(thing):  # what is no pytree is a leaf
                assert_one_line(other, name)
    assert_one_line(object.__new__(type(thing)) if name not in TUPLES else thing, name)


TUPLES = (
    "Mapped",
    "DetectionScores",
    "ErrorRun",
    "RepairedRun",
    "UpGuess",
    "Bridge",
    "Removal",
    "Interval",
    "StyleSegment",
    "ContactScores",
    "Knowledge",
    "Information",
    "Gains",
    "State",
)


def test_results_are_one_line_while_they_are_traced():
    every = {name: example(name) for name in NAMES}
    modules = {n: x for n, x in every.items() if jax.tree.leaves(eqx.filter(x, eqx.is_array))}
    assert len(modules) > 20
    seen = []

    def traced(values):
        for name, thing in eqx.combine(values, others).items():
            assert_one_line(thing, name)
            seen.append(name)
        return 0

    values, others = eqx.partition(modules, eqx.is_array)
    jax.make_jaxpr(traced)(values)
    jax.make_jaxpr(jax.vmap(traced))(jax.tree.map(lambda x: np.stack([x, x]), values))
    assert seen == 2 * sorted(modules)


def test_nothing_is_computed_and_no_large_array_is_read(caplog):
    every = {name: example(name) for name in NAMES}
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        lines = {name: repr(thing) for name, thing in every.items()}
        lines["tree"] = str(every["Skeleton"])
    assert "ompiling" not in caplog.text
    for name, thing in every.items():
        small = jax.tree.map(
            lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype) if np.size(x) > 64 else x, thing
        )
        assert repr(small).replace(", shapes alone", "") == lines[name].replace(", NumPy", "")


def test_arrays_that_are_gone_are_shown_by_shape():
    given_away = jnp.asarray(3.5)
    assert brief(given_away) == "3.5"
    given_away.delete()
    assert brief(given_away) == "f64[]"


def test_the_main_ones_read_well():
    figure = "7 joints from Hips, y up, float64"
    expected = {
        "Motion": f"Motion(24 frames, 0.4 s at 60 fps, {figure})",
        "Skeleton": "Skeleton(7 joints from Hips, 4 end sites, y up, float64)",
        "Displacement": "Displacement(24 frames, 7 joints, world sense, float64)",
        "WorldPose": "WorldPose(24 frames, 7 joints, 2 end sites, float64)",
        "MotionLayers": f"MotionLayers(24 frames, 0.4 s at 60 fps, {figure}, base λ=0 σ=0)",
        "Pyramid": f"Pyramid(24 frames, 12.00 s at 2 fps, 1 level over a base of 13, {figure})",
        "Posterior": "Posterior(24 frames of f64[3], order 2)",
        "MotionTuning": "MotionTuning(rotations λ=f64[7] σ=f64[7], translations λ=f64[7] σ=f64[7])",
        "Contacts": "Contacts(24 frames, 4 points: LeftFoot.end, LeftToe.end, RightFoot.end, …, "
        "float64)",
        "WarpPath": "WarpPath(cost=0, path=i32[40,2], length=0)",
        "Problem": "Problem(spike, frames 12 to 13, LeftFoot, LeftFoot turns by 45 degrees and "
        "back within a frame)",
    }
    assert {name: repr(example(name)) for name in expected} == expected


def test_a_motion_tells_its_batch_rate_and_arrays():
    clip = motion()
    two = jax.tree.map(lambda x: np.stack([x, x]), clip)
    assert "(2 clips of 24 frames, 0.4 s at 60 fps" in repr(two)
    assert "float64, NumPy)" in repr(two)
    assert repr(two.skeleton).startswith("Skeleton(2 skeletons of 7 joints from Hips, 4 end sites")
    four = jax.tree.map(lambda x: np.stack([x, x]), two)
    assert "((2, 2) clips of 24 frames" in repr(four)
    rates = eqx.tree_at(lambda m: m.frame_time, two, np.array([1 / 60, 1 / 30]))
    assert "0.4 to 0.8 s at 30 to 60 fps" in repr(rates)
    assert "1 frame, 0.0167 s at 60 fps" in repr(clip[3])
    assert repr(jax.eval_shape(lambda m: m, clip)).endswith("y up, float64, shapes alone)")
    told = []
    jax.make_jaxpr(lambda m: told.append(repr(m)) or m.rotations)(clip)
    assert told == ["Motion(24 frames, 7 joints from Hips, y up, float64, traced)"]
    change = jax.tree.map(lambda x: -x, jax.tree.map(np.asarray, clip))  # as a derivative may be
    assert "24 frames, 7 joints" in repr(change)
    assert timing(60, np.float32(1001 / 30000)) == ["2.00 s at 29.97 fps"]
    assert timing(60, 0.0) == timing(60, None) == timing(60, np.zeros(0)) == []


def test_parts_that_are_no_arrays_are_shown_by_field():
    shapes = jax.tree.map(np.shape, motion())
    assert "translations=(24, 7, 3), rotations=(24, 7, 4), frame_time=()" in repr(shapes)
    assert "rotations=None" in repr(jax.tree.map(lambda x: None, motion()))
    half_made = object.__new__(contacts.Contacts)
    assert repr(half_made) == "Contacts()"


def test_errors_and_modules_that_hold_them_print_the_line():
    class Model(eqx.Module):
        clips: list
        skeleton: jm.Skeleton

    clip = motion()
    model = Model([clip, clip], clip.skeleton)
    assert str(model).count("\n") < 10
    assert eqx.tree_pformat((clip,), width=200) == f"({clip!r},)"
    with pytest.raises(Exception, match="minus") as caught:  # of the checks the tests run under
        minus(clip, 3)
    assert repr(clip) in str(caught.value)


def test_joint_names_are_anybodys_text():
    names = [HOSTILE, "b\n", "mixamorig:Hips"]
    skeleton = jm.Skeleton(
        names, [-1, 0, 1], np.ones((3, 3)), end_joints=[2], end_offsets=np.ones((1, 3))
    )
    clip = random_motion(np.random.default_rng(0), 3, skeleton)
    points = contacts.ContactPoints(skeleton, names)
    peak = metrics.Peak(1.0, 0, HOSTILE, 0.5, 0.9, True)
    difference = metrics.Difference(3, 3, peak, peak, peak, peak)
    problem = metrics.Problem("spike", HOSTILE, joint=HOSTILE)
    interval = contacts.Interval(HOSTILE, 0, 0, 1, "point", (0.0, 0.0, 0.0), 1.0)
    for thing in (skeleton, clip, points, peak, difference, problem, interval):
        assert_one_line(thing, type(thing).__name__)
    assert all(text.isprintable() for text in str(skeleton).splitlines())
    assert len(str(skeleton).splitlines()) == 5
    assert "<script" not in clip._repr_html_()


# A motion in a notebook


class Cells(html.parser.HTMLParser):
    """The texts of a table, before the player; any tag that is no part of it is an error."""

    def __init__(self, text):
        super().__init__()
        self.cells = []
        self.feed(text.partition("<iframe")[0])

    def handle_starttag(self, tag, attrs):
        assert tag in ("table", "caption", "tbody", "tr", "th", "td")
        assert {name for name, _ in attrs} <= {"style"}

    def handle_data(self, data):
        self.cells.append(data)


def test_notebooks_show_a_table():
    names, *cells = [Cells(motion()._repr_html_()).cells[1:][k::2] for k in (0, 1)]
    rows = dict(zip(names, *cells, strict=True))
    assert rows == {
        "Frames": "24 frames",
        "Time": "0.4 s at 60 fps",
        "Frame time": ".0166667 s in the file",
        "Joints": "7: Hips, Spine, LeftFoot, LeftToe, RightFoot, RightToe, …",
        "End sites": "4",
        "Translated": "Hips, Spine, LeftFoot, LeftToe, RightFoot, RightToe, …",
        "Up": "y",
        "Numbers": "float64",
    }
    with no_shape_checks():
        for other in stand_ins(motion()):
            text = other._repr_html_()
            assert text is None or Cells(text).cells[0] == "Motion"
    assert jax.tree.map(lambda x: None, motion())._repr_html_() is None


# A skeleton as a tree


def test_a_skeleton_prints_as_a_tree():
    offsets = np.array([[0.0, 0, 0], [0.3, 0, 0.4], [0, 1.25, 0], [0, 0, 2]])
    skeleton = jm.Skeleton(
        ["Hips", "Leg", "Toe", "Arm"],
        [-1, 0, 1, 0],
        offsets,
        end_joints=(2, 3),
        end_offsets=np.array([[0.0, 0, 0.07], [0, 0, 1 / 3]]),
    )
    drawn = """\
Skeleton(4 joints from Hips, 2 end sites, y up, float64, NumPy)
Hips               0
├─ Leg             0.5
│  └─ Toe          1.25
│     └─ end site  0.07
└─ Arm             2
   └─ end site     0.3333"""
    assert str(skeleton) == f"{skeleton}" == drawn
    for other in stand_ins(skeleton):
        with no_shape_checks():
            lines = str(other).splitlines()
        assert lines[0] == repr(other)
        assert [x.split(" ")[-1] for x in lines[1:4]] in (
            ["Hips", "Leg", "Toe"],
            ["0", "0.5", "1.25"],
            ["nan"] * 3,
        )


@pytest.mark.parametrize("kind", ["tree", "chain", "star"])
def test_every_joint_hangs_below_its_parent(kind):
    skeleton = random_skeleton(np.random.default_rng(1), 1200 if kind == "chain" else 60, kind)
    rows = str(skeleton).splitlines()[1:]
    assert len(rows) == skeleton.num_joints + len(skeleton.end_joints)
    above, found = [], {}
    for row in rows:
        name = row.replace("end site", "").split()[-2 if "joint" in row else 0]
        depth = (row.find("joint") if "joint" in row else row.find("end site")) // 3
        above[depth:] = [name]
        if "joint" in row:
            found[name] = above[depth - 1] if depth else None
    names = skeleton.names
    assert found == {
        n: names[p] if p >= 0 else None for n, p in zip(names, skeleton.parents, strict=True)
    }


def test_lines_of_other_things():
    class Odd(eqx.Module):
        first: float
        _hidden: int
        names: tuple
        text: str

    odd = Odd(1 / 3, 2, tuple(range(100)), "a\nb")
    assert by_field(odd) == ["first=0.3333", "names=tuple(…)", r"text='a\nb'"]
    assert line(odd) == r"Odd(first=0.3333, names=tuple(…), text='a\nb')"
    assert brief((1,)) == "(1,)"
    assert brief([True, None]) == "[True, None]"
    assert brief(np.float32(0.25)) == brief(jnp.float32(0.25)) == "0.25"
    assert brief(np.zeros((2, 3), np.uint8)) == "u8[2,3]"
    assert len(motion()) == FRAMES
