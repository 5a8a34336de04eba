"""What a page holds is what the clips are, whatever their joints are called; the small one in a
notebook stays small."""

import base64
import html
import json
import math
import re
import time
from importlib.resources import files

import equinox as eqx
import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.cleaning import DetectedErrors
from jaxmotion.contacts import ContactPoints, Contacts
from jaxmotion.viz import player
from jaxmotion.viz.player.page import SCRIPTS
from tests.helpers import no_shape_checks, random_motion
from tests.viz.test_body import standing_root

HOSTILE = [
    "</script><script>window.caught = 1</script>",
    '<img src=x onerror="window.caught = 2">',
    "\u2028\u2029 \u202ereversed \x1b[31m ]]> <!-- ${window.caught = 3} `'\"&amp;",
    "mixamorig:Hips",
    "{{script}} {{data}}",
    "\udc80 half of a letter",
]


def content(page):
    """The JSON of a page, by a parser of its own."""
    text = page.html if hasattr(page, "html") else page
    return json.loads(
        re.search(r'<script type="application/json" id="data">(.*?)</script>', text)[1]
    )


def numbers(text, dtype, *shape):
    return np.frombuffer(base64.b64decode(text), dtype).reshape(shape)


def places(clip):
    """World points f[T, P, 3] of the page."""
    frames, points = clip["frames"], len(clip["parents"])
    middle = numbers(clip["middle"], "<f4", frames, 1, 3).astype(float)
    steps = numbers(clip["places"], "<i2", frames, points, 3).astype(float)
    steps[steps == -32768] = np.nan
    return middle + steps * numbers(clip["reach"], "<f4", points)[:, None].astype(float)


def oracle(motion):
    """World points by matrices, a joint at a time."""
    skeleton = motion.skeleton
    q = np.asarray(motion.rotations, float)
    frames = len(q)
    turn, at = {}, {}
    for j, parent in enumerate(skeleton.parents):
        own = Rotation.from_quat(q[:, j], scalar_first=True).as_matrix()
        local = np.asarray(motion.translations, float)[:, j]
        local = local if j in motion.translated_joints else local[:1].repeat(frames, 0)
        turn[j] = own if parent < 0 else turn[parent] @ own
        at[j] = local if parent < 0 else at[parent] + np.einsum("tij,tj->ti", turn[parent], local)
    ends = [
        at[j] + turn[j] @ np.asarray(offset, float)
        for j, offset in zip(skeleton.end_joints, skeleton.end_offsets, strict=True)
    ]
    return np.stack([*(at[j] for j in range(skeleton.num_joints)), *ends], axis=1).reshape(
        frames, -1, 3
    )


def upright(points, up):
    x, y, z = np.moveaxis(points, -1, 0)
    turned = {"x": (-y, x, z), "y": (x, y, z), "z": (x, z, -y)}[up]
    return np.stack(turned, axis=-1)


def walk(frames=40, **options):
    return jm.samples.walk(frames, **options).motion


def named(motion, names):
    skeleton = motion.skeleton
    return motion.replace(
        skeleton=jm.Skeleton(
            names,
            skeleton.parents,
            skeleton.offsets,
            end_joints=skeleton.end_joints,
            end_offsets=skeleton.end_offsets,
            up=skeleton.up,
        )
    )


# What a page holds


@pytest.mark.parametrize("up", ["x", "y", "z"])
@pytest.mark.parametrize("kind", ["walk", "random", "all joints translated"])
def test_points_are_those_of_forward_kinematics(kind, up, dtype):
    motion = walk() if kind == "walk" else random_motion(np.random.default_rng(0), 20, 9)
    if kind == "random":
        motion = motion.replace(translated_joints=(0, 4))
    motion = jm.reorient(motion.astype(dtype), up)
    page = content(player(motion))
    (clip,) = page["clips"]
    want = upright(oracle(motion), up) - page["origin"]
    got = places(clip)
    reach = np.abs(want - want[:, :1]).max()
    np.testing.assert_allclose(got, want, atol=reach / 60000 + 1e-5 * np.abs(want).max())
    pose = jm.forward_kinematics(motion)
    ours = np.concatenate([pose.positions, pose.end_positions], axis=1)
    np.testing.assert_allclose(ours, oracle(motion), atol=1e-5 * np.abs(ours).max())
    assert clip["frameTime"] == float(motion.frame_time)
    assert clip["parents"] == [*motion.skeleton.parents, *motion.skeleton.end_joints]


def test_far_from_the_origin_nothing_is_lost():
    motion = walk(dtype="float64")
    far = motion.replace(translations=motion.translations.at[:, 0].add([3e6, 0.0, -5e6]))
    page = content(player(far))
    np.testing.assert_allclose(
        places(page["clips"][0]), oracle(far) - page["origin"], atol=1e-4, rtol=0
    )


def test_a_root_that_stays_is_no_part_of_the_figure():
    """Its hips go, as in Bandai Namco's files: the page follows the middle of the body."""
    walked, motion = standing_root()
    (clip,) = content(player(motion))["clips"]
    (plain,) = content(player(walked))["clips"]
    middle = numbers(clip["middle"], "<f4", walked.num_frames, 3)
    hips = np.asarray(walked.translations)[:, 0]
    gone = middle[-1] - middle[0]
    np.testing.assert_allclose(gone, hips[-1] - hips[0], atol=0.15)
    assert np.linalg.norm(gone) > 0.7
    assert (clip["apart"], clip["loose"]) == ([0], [1])
    assert (plain["apart"], plain["loose"]) == ([], [])
    assert math.isclose(clip["size"], plain["size"], rel_tol=1e-6)


def test_joints_that_are_picked_at_first():
    motion = walk()
    assert content(player(motion, picked=["Neck"]))["picked"] == ["Neck"]
    assert content(player(motion))["picked"] == []
    with pytest.raises(ValueError, match="picked='Tail' is no joint"):
        player(motion, picked=["Neck", "Tail"])


def test_the_floor_is_below_the_feet_and_the_first_pose_above_the_origin():
    motion = walk()
    page = content(player(motion))
    points = places(page["clips"][0])
    assert abs(points[..., 1].min(axis=1)).max() < 0.02
    np.testing.assert_allclose(np.median(points[0, :, [0, 2]], axis=1), 0, atol=1e-4)
    lifted = motion.replace(translations=motion.translations.at[:, 0, 1].add(40.0))
    points = places(content(player(lifted))["clips"][0])
    assert abs(points[..., 1].min(axis=1)).max() < 0.05
    assert math.isclose(
        page["clips"][0]["size"], np.ptp(oracle(motion)[:, :, 1], 1).mean(), rel_tol=0.1
    )


def test_which_way_the_figure_faces():
    motion = walk()
    (clip,) = content(player(motion))["clips"]
    x, _, z = np.asarray(jm.facing_direction(motion))[0]
    assert abs(clip["facing"] - math.atan2(x, z)) < 0.3
    other = random_motion(np.random.default_rng(0), 5, 4)
    assert content(player(other))["clips"][0]["facing"] is None


def test_angles_are_those_of_the_local_rotations():
    motion = walk()
    (clip,) = content(player(motion))["clips"]
    got = numbers(clip["angles"], "<u2", *motion.rotations.shape[:2]) * np.pi / 65534
    q = np.asarray(motion.rotations, float)
    want = Rotation.from_quat(q.reshape(-1, 4), scalar_first=True).magnitude().reshape(q.shape[:2])
    np.testing.assert_allclose(got, want, atol=5e-5)


def test_numbers_that_are_not_finite_are_missing():
    motion = walk(dtype="float64")
    q = np.array(motion.rotations)
    q[7, motion.skeleton.index("LeftArm")] = np.nan
    q[9, 3] = np.inf
    t = np.array(motion.translations)
    t[11, 0, 2] = np.inf
    broken = motion.replace(rotations=q, translations=t)
    (clip,) = content(player(broken))["clips"]
    missing = np.isnan(places(clip)[..., 0])
    below = [motion.skeleton.index(name) for name in ("LeftForeArm", "LeftHand")]
    assert missing[7, below].all()
    assert not missing[7, motion.skeleton.index("LeftArm")]
    assert missing[11].all()
    assert not np.delete(missing, [7, 9, 11], axis=0).any()
    angles = numbers(clip["angles"], "<u2", *q.shape[:2])
    assert (angles == 65535).sum() == 2
    nothing = motion.replace(translations=np.full_like(t, np.nan))
    assert np.isnan(places(content(player(nothing))["clips"][0])).all()


def test_contacts_errors_and_curves_belong_to_their_motion():
    motion = walk(dtype="float64")
    after = jm.resample(motion, fps=24.0)
    skeleton = motion.skeleton
    points = ContactPoints(skeleton, ["LeftFoot", "RightFoot"], names=["left", "<b>right"])
    on = np.zeros((40, 2), bool)
    on[3:9, 0] = on[20:, 1] = True
    contacts = Contacts(points, on, points.positions(motion))
    mask = np.zeros((after.num_frames, 22), bool)
    mask[4:6, 3] = True
    mdm = np.random.default_rng(0).uniform(0, 1, mask.shape)
    errors = DetectedErrors(mask, mdm, mdm, {"jump": mask}, after)
    energy = np.linspace(-3, 5, 40)
    energy[4] = np.nan
    page = content(
        player(
            {"before": motion, "after": after},
            contacts=contacts,
            errors={"after": errors},
            curves={"energy": energy, "flat": {"after": np.ones((after.num_frames, 22))}},
        )
    )
    before, later = page["clips"]
    assert [before["name"], later["name"]] == ["before", "after"]
    assert later["frames"] == after.num_frames
    assert before["contacts"]["names"] == ["left", "<b>right"]
    where = np.array(before["contacts"]["spans"])
    np.testing.assert_array_equal(where[:, :3], [[0, 3, 8], [1, 20, 39]])
    target = np.asarray(contacts.target)[[3, 20], [0, 1]] - page["origin"]
    np.testing.assert_allclose(where[:, 3:], target, atol=1e-5)
    assert "contacts" not in later
    assert "errors" not in before
    bits = np.unpackbits(numbers(later["errors"], "u1", -1), bitorder="little")[: mask.size]
    np.testing.assert_array_equal(bits.reshape(mask.shape), mask)
    curves = {curve["name"]: curve for curve in page["curves"]}
    assert {name: c["clip"] for name, c in curves.items()} == {
        "digression": 1,
        "energy": 0,
        "flat": 1,
    }
    told = curves["energy"]
    steps = numbers(told["values"], "<u2", 40).astype(float)
    assert np.flatnonzero(steps == 65535) == [4]
    got = told["low"] + (told["high"] - told["low"]) * steps / 65534
    np.testing.assert_allclose(np.delete(got, 4), np.delete(energy, 4), atol=1e-4)
    whole = content(player(motion, errors=on.any(axis=1)))["clips"][0]["errors"]
    bits = np.unpackbits(numbers(whole, "u1", -1), bitorder="little")[: 40 * 22]
    np.testing.assert_array_equal(bits.reshape(40, 22), np.repeat(on.any(1)[:, None], 22, 1))


# The page


def test_names_are_text():
    motion = named(random_motion(np.random.default_rng(0), 5, 6), HOSTILE)
    page = player({HOSTILE[0]: motion, HOSTILE[1]: motion}, title=HOSTILE[0])
    text = page.html
    assert len(re.findall("<script", text)) == len(re.findall("</script", text)) == 2
    assert "onerror=" not in re.sub(r'id="data">.*?</script>', "", text)
    data = re.search(r'id="data">(.*?)</script>', text)[1]
    assert "<" not in data
    assert all(c == "\n" or (c.isprintable() or c == " ") for c in data)
    got = content(page)["clips"][0]["joints"]
    assert got[0] == HOSTILE[0]
    assert got[3:5] == HOSTILE[3:5]
    assert all(name.isprintable() for name in got)
    text.encode("utf-8")
    assert "<title>&lt;/script&gt;" in text


def test_nothing_is_fetched():
    page = player(walk(5)).html
    assert not re.findall(
        r"""(?:src|href)=["'](?!data:)|url\(|import\(|fetch\(|https?://(?!www.w3.org)""", page
    )
    policy = html.unescape(re.search(r'Content-Security-Policy" content="(.*?)"', page)[1])
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe" not in policy


def test_scripts_are_small_enough_to_read():
    folder = files("jaxmotion.viz.player")
    there = {entry.name for entry in folder.iterdir() if entry.name.endswith(".js")}
    assert there == set(SCRIPTS)
    for name in SCRIPTS:
        lines = folder.joinpath(name).read_text(encoding="utf-8").splitlines()
        assert len(lines) <= 400, name
        assert lines[0].startswith("// "), name
        assert not re.search(
            r"innerHTML|outerHTML|insertAdjacent|document\.write|eval\(", "\n".join(lines)
        )


def test_sizes_and_times():
    short = player(walk(600)).html
    assert len(short.encode()) < 400_000
    long = random_motion(np.random.default_rng(0), 2526, 65)
    player(long)
    start = time.perf_counter()
    page = player(long)
    seconds = time.perf_counter() - start
    print(f"\n2526 × 65 written in {seconds:.3f} s, {len(page.html) / 1e6:.2f} MB")
    assert len(page.html) < 4_000_000
    assert seconds < 2  # of a busy machine; 0.1 of one that is not


def test_saved_and_shown(tmp_path):
    page = player(walk(5), title="a clip")
    page.save(tmp_path / "clip.html")
    assert (tmp_path / "clip.html").read_text(encoding="utf-8") == page.html
    assert [path.name for path in tmp_path.iterdir()] == ["clip.html"]
    shown = page._repr_html_()
    assert html.unescape(re.search(r'srcdoc="(.*?)"', shown, re.DOTALL)[1]) == page.html
    assert 'sandbox="allow-scripts"' in shown
    assert repr(page) == f"Player(5 frames, {len(page.html) / 1e6:.2f} MB)"


# What is asked for


def test_what_does_not_fit_is_refused():
    motion, other = walk(9), walk(8)
    points = ContactPoints(motion.skeleton, ["LeftFoot"])
    contacts = Contacts(points, np.zeros((9, 1), bool), points.positions(motion))
    both = {"a": motion, "b": other}
    wrong = [
        (lambda: player({}), "no motion is given"),
        (lambda: player("walk.bvh"), "player: motion is a str; expected a jaxmotion.Motion"),
        (lambda: player({"a": motion, "b": 3}), r"player: motion\['b'\] is an int"),
        (
            lambda: player(jax.tree.map(lambda x: np.stack([x, x]), motion)),
            "one clip at a time, got batch axes",
        ),
        (lambda: player(other, contacts=contacts), "contacts have 9 frames, the motion 8"),
        (lambda: player(motion, contacts=motion), "expected Contacts"),
        (lambda: player(both, contacts={"c": contacts}), "a name in contacts='c'; expected 'a' or"),
        (
            lambda: player(motion, errors=np.zeros(8, bool)),
            r"bool of shape \(8,\); expected Detect",
        ),
        (lambda: player(motion, errors=np.zeros(9)), "float64 of shape"),
        (lambda: player(motion, errors=contacts), "errors is a Contacts; expected an array"),
        (lambda: player(motion, curves=np.zeros(9)), "curves need names"),
        (
            lambda: player(motion, curves={"x": np.zeros(8)}),
            r"curves\['x'\] is float64 of shape \(8",
        ),
        (lambda: player(motion, curves={"x": ["a"] * 9}), r"curves\['x'\] is <U1"),
        (
            lambda: player(both, curves={"x": {"c": [0.0]}}),
            r"curves\['x'\]='c'; expected 'a' or 'b'",
        ),
        (lambda: player(motion, theme="blue"), "theme='blue'; expected 'auto', 'light' or 'dark'"),
    ]
    for call, message in wrong:
        with no_shape_checks(), pytest.raises(ValueError, match=message):
            call()
    with pytest.raises(TypeError, match="cannot be made inside of jit"):
        eqx.filter_jit(lambda m: len(player(m).html))(motion)


def test_the_motion_is_left_as_it_is():
    motion = walk(5)
    before = jax.tree.map(lambda x: np.array(x), motion)
    player(motion)
    for a, b in zip(jax.tree.leaves(before), jax.tree.leaves(motion), strict=True):
        np.testing.assert_array_equal(a, b)


# A clip in a notebook


def page_of(shown):
    return html.unescape(re.search(r'srcdoc="(.*?)"', shown, re.DOTALL)[1])


def test_a_clip_shows_a_small_player():
    motion = walk(30)
    shown = motion._repr_html_()
    assert shown.startswith("<table>")
    assert "every" not in shown.rpartition("</iframe>")[2]
    page = content(page_of(shown))
    assert page["isSmall"] is True
    np.testing.assert_allclose(places(page["clips"][0]) + page["origin"], oracle(motion), atol=1e-4)


@pytest.mark.parametrize(("frames", "joints"), [(900, 22), (4000, 150)])
def test_long_and_large_clips_are_thinned(frames, joints):
    motion = random_motion(np.random.default_rng(0), frames, joints).astype("float32")
    shown = motion._repr_html_()
    assert len(shown) < 300_000
    said = shown.rpartition("</iframe>")[2]
    left, step = map(int, re.search(r"(\d+) frames: every (\d+)\w\w is here", said).groups())
    assert left == -(-frames // step)
    page = content(page_of(shown))
    (clip,) = page["clips"]
    assert clip["frames"] == left
    assert math.isclose(clip["frameTime"], step * float(motion.frame_time), rel_tol=1e-6)
    want = upright(oracle(motion[::step]), motion.skeleton.up) - page["origin"]
    np.testing.assert_allclose(places(clip), want, atol=1e-3 * np.abs(want).max())


def test_what_is_no_clip_to_draw_shows_its_table_alone():
    motion = walk(5)
    nothing = motion.replace(translations=np.full(motion.translations.shape, np.nan))
    for odd in (jax.tree.map(lambda x: np.stack([x, x]), motion), nothing):
        assert "<iframe" not in odd._repr_html_()
        assert "<table>" in odd._repr_html_()


def test_the_line_of_a_clip():
    motion = walk(30)
    assert repr(motion).startswith("Motion(30 frames, 0.5 s at 60 fps, 22 joints from Hips, y up")
    lines = str(motion.skeleton).splitlines()
    assert lines[0] == repr(motion.skeleton)
    assert lines[1].startswith("Hips")
    assert len(lines) == 1 + 22 + len(motion.skeleton.end_joints)
