"""Names in any encoding: shown as text, written with the same bytes, told rightly or harmlessly."""

import re
import warnings

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.io import MotionFileError
from jaxmotion.io.amc import read_amc
from jaxmotion.io.text import decoded, plain_bytes
from tests.helpers import random_motion

NAMES = {
    "cp932": ["センター", "ボーン", "左腕", "右ひざ", "能力"],  # ー, ボ, 能: second bytes [ { \
    "gbk": ["根骨骼", "左臂", "右手腕", "頭", "脊椎"],
    "cp949": ["골반", "왼팔", "오른쪽 다리", "머리", "목"],
    "latin-1": ["Hüfte", "épaule gauche", "Fuß", "BRAÇO", "Mão"],
    "utf-8": ["Hüfte", "左臂", "Mão", "골반", "x y"],
}


def bvh(names, *, brace="\n{\n"):
    """A chain of joints, one channel each."""
    text = "HIERARCHY\n"
    for depth, name in enumerate(names):
        text += f"{'JOINT' if depth else 'ROOT'} {name}{brace}OFFSET 0 {depth} 0\n"
        text += "CHANNELS 1 Yrotation\n"
    rows = " ".join("5" for _ in names)
    return text + "}\n" * len(names) + f"MOTION\nFrames: 1\nFrame Time: 0.01\n{rows}\n"


def names_in(path):
    """The bytes of the names in a BVH file, found without the reader."""
    return re.findall(rb"(?:ROOT|JOINT) (.*?)\s*(?:\n|\{\s)", path.read_bytes())


@pytest.mark.parametrize("encoding", NAMES)
@pytest.mark.parametrize("brace", ["\n{\n", " {\n"])
def test_names_are_read_as_text_and_written_as_the_same_bytes(tmp_path, encoding, brace):
    names = NAMES[encoding]
    path = tmp_path / "a.bvh"
    path.write_bytes(bvh(names, brace=brace).encode(encoding))
    motion = jm.load(path)
    assert motion.skeleton.names == tuple(names)
    assert motion.skeleton.encoding == encoding
    jm.save(motion, tmp_path / "b.bvh")
    assert names_in(tmp_path / "b.bvh") == [name.encode(encoding) for name in names]
    assert jm.load(tmp_path / "b.bvh").skeleton.names == tuple(names)


@pytest.mark.parametrize("encoding", NAMES)
def test_names_pass_through_the_other_formats(tmp_path, encoding):
    names = [name.replace(" ", "_") for name in NAMES[encoding]]
    names[1] += "\N{NO-BREAK SPACE}b" if encoding in ("latin-1", "utf-8") else ""
    (tmp_path / "a.bvh").write_bytes(bvh(names).encode(encoding))
    before = jm.load(tmp_path / "a.bvh")
    jm.save(before, tmp_path / "b.npz")
    jm.save(jm.load(tmp_path / "b.npz"), tmp_path / "c.bvh")
    assert names_in(tmp_path / "c.bvh") == names_in(tmp_path / "a.bvh")
    jm.save(before, tmp_path / "d.amc")
    for file in ("d.asf", "d.amc"):
        data = (tmp_path / file).read_bytes()
        assert all(name.encode(encoding) in data for name in names[1:])
    acclaim = jm.load(tmp_path / "d.amc")
    assert acclaim.skeleton.names == ("root", *names[1:])  # the one name that ASF prescribes
    jm.save(acclaim, tmp_path / "e.amc")
    assert (tmp_path / "e.asf").read_bytes() == (tmp_path / "d.asf").read_bytes()
    jm.save(acclaim, tmp_path / "f.bvh")
    assert names_in(tmp_path / "f.bvh")[1:] == names_in(tmp_path / "a.bvh")[1:]


def test_an_amc_may_be_in_another_encoding_than_its_asf(tmp_path):
    (tmp_path / "a.amc").write_bytes("1\nroot 1\nHüfte 2 3\nlinks 4\n".encode())
    widths = {"root": 1, "Hüfte": 2, "LINKS": 1}
    columns = read_amc(tmp_path / "a.amc", widths, "latin-1").columns
    np.testing.assert_array_equal(columns["Hüfte"], [[2, 3]])
    assert set(columns) == set(widths)


def test_bytes_of_any_kind_come_back(tmp_path):
    """What is no text in any encoding that is told, too."""
    rng = np.random.default_rng(0)
    plain = [b for b in range(1, 256) if b not in b"\t\n\v\f\r\x1a {}\\\x85\xa0"]
    for trial in range(12):
        names = [bytes(rng.choice(plain, rng.integers(1, 9))) + b"%d" % j for j in range(4)]
        texts = [name.decode("latin-1") for name in names]
        (tmp_path / "a.bvh").write_bytes(bvh(texts).encode("latin-1"))
        motion = jm.load(tmp_path / "a.bvh")
        jm.save(motion, tmp_path / "b.bvh")
        assert names_in(tmp_path / "b.bvh") == names, trial


def test_every_real_file_keeps_the_bytes_of_its_names(data_dir, tmp_path):
    files = sorted((data_dir / "quirks").glob("*.bvh")) + sorted(data_dir.glob("*/*.bvh"))[::20]
    assert len(files) >= 16
    for file in files:
        top = file.read_bytes().partition(b"MOTION")[0]
        jm.save(jm.load(file)[:2], tmp_path / "b.bvh")
        lines = [line.strip() for line in re.split(rb"\r\n|\n|\r", top)]
        mine = [line.strip() for line in (tmp_path / "b.bvh").read_bytes().split(b"\n")]
        named = rb"(?i)(root|joint|end)[ \t]"
        wanted = [line.split(None, 1)[1].rstrip(b"{ \t") for line in lines if re.match(named, line)]
        assert [line.split(None, 1)[1] for line in mine if re.match(named, line)] == wanted, file


@pytest.mark.parametrize(
    ("data", "encoding"),
    [
        ("Müller\nFuß\nÄnkle\nFÜSSE".encode("latin-1"), "latin-1"),
        ("Peter’s arm\nPeter’s leg".encode("cp1252"), "latin-1"),
        ("Рука\nЛевая рука\nТаз\nГОЛОВА".encode("cp1251"), "latin-1"),
        ("ręka\ngłowa\nkość".encode("cp1250"), "latin-1"),
        ("根骨骼\n左臂".encode("gbk"), "gbk"),
        (b"Hips", "utf-8"),
        (b"", "utf-8"),
        (b"\xff\xfe\xfd", "latin-1"),
    ],
)
def test_what_is_told_from_bytes(data, encoding):
    text, told = decoded("a.bvh", data)
    assert told == encoding
    assert text.encode(told) == data


def test_an_encoding_that_is_asked_for(tmp_path):
    path = tmp_path / "a.bvh"
    path.write_bytes(bvh(["骨盆", "左手"]).encode("big5"))
    motion = jm.load(path, encoding="big5")
    assert motion.skeleton.names == ("骨盆", "左手")
    jm.save(motion, tmp_path / "b.bvh")  # where big5 would not be told, UTF-8
    assert jm.load(tmp_path / "b.bvh").skeleton.names == ("骨盆", "左手")
    with pytest.raises(MotionFileError, match="no utf-8 text"):
        jm.load(path, encoding="utf-8")
    for wrong in ("klingon", "utf-16"):
        with pytest.raises(ValueError, match=wrong):
            jm.load(path, encoding=wrong)


def test_names_that_their_encoding_cannot_write_are_written_in_utf_8(tmp_path):
    motion = random_motion(np.random.default_rng(0), 1, jm.Skeleton(
        ["Hüfte", "左臂"], [-1, 0], np.zeros((2, 3)), encoding="latin-1"
    ), translated=False)  # fmt: skip
    jm.save(motion, tmp_path / "a.bvh")
    assert names_in(tmp_path / "a.bvh") == ["Hüfte".encode(), "左臂".encode()]
    # Latin-1 could write these, but they would be read as UTF-8.
    skeleton = jm.Skeleton(["Ã¼"], [-1], np.zeros((1, 3)), encoding="latin-1")
    jm.save(random_motion(np.random.default_rng(0), 1, skeleton), tmp_path / "b.bvh")
    assert jm.load(tmp_path / "b.bvh").skeleton.names == ("Ã¼",)
    unknown = jm.Skeleton(["ü"], [-1], np.zeros((1, 3)), encoding="\0 no such")
    jm.save(random_motion(np.random.default_rng(0), 1, unknown), tmp_path / "c.bvh")
    assert jm.load(tmp_path / "c.bvh").skeleton.names == ("ü",)


def test_a_name_that_is_no_text_is_refused(tmp_path):
    skeleton = jm.Skeleton(["\udc80 half"], [-1], np.zeros((1, 3)))
    motion = random_motion(np.random.default_rng(0), 1, skeleton)
    with pytest.raises(ValueError, match=r"joint name '.udc80 half' cannot be written"):
        jm.save(motion, tmp_path / "a.bvh")
    assert list(tmp_path.iterdir()) == []


def test_what_is_said_of_names_can_be_shown(tmp_path):
    path = tmp_path / "a.bvh"
    path.write_bytes(bvh(["a\x1b[2J", "a\x1b[2J"]).encode())
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        jm.load(path)
    assert [str(w.message).isprintable() for w in said] == [True]
    assert r"a\x1b[2J" in str(said[0].message)
    with pytest.raises(MotionFileError) as caught:
        jm.load(tmp_path / "no\nsuffix")
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("data", "plain"),
    [
        (b"a\n\x1a", b"a\n"),
        (b"a 1\x1a", b"a 1"),
        (b"a\r\n\x1a\x1a\0\0\r\n", b"a\r\n"),
        (b"a\x1ab\n", b"a\x1ab\n"),
        (b"\xef\xbb\xbfa\n", b"a\n"),
        ("ü\n".encode("utf-16"), "ü\n".encode()),
        (b"a\rb", b"a\nb"),
    ],
)
def test_marks_around_a_text_are_taken_off(data, plain):
    assert plain_bytes("a.bvh", data) == plain
