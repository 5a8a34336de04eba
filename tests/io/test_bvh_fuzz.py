"""Whatever the bytes, reading BVH ends in a sound motion, or in a MotionFileError; nothing else."""

import tracemalloc
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import jaxmotion as jm
from jaxmotion.io import MotionFileError, MotionFileWarning
from tests.helpers import assert_same_rotation

CLIP = b"""HIERARCHY
ROOT Hips
{
\tOFFSET 0.0 1.5 -2
\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
\tJOINT Leg
\t{
\t\tOFFSET 1 2 3
\t\tCHANNELS 3 Zrotation Xrotation Yrotation
\t\tEnd Site
\t\t{
\t\t\tOFFSET 0 -1e1 0
\t\t}
\t}
\tJOINT Arm
\t{
\t\tOFFSET 1 2 3
\t}
}
MOTION
Frames: 3
Frame Time: .0333333
1 2 3 40.5 -50 60 7 8 9
1.5 2 3 41 -51 61 7.25 8 -9e-1
2 2 3 42 -52 62 7.5 8 9
"""

PIECES = [
    b"nan", b"inf", b"-inf", b"1e999", b"1e-999", b"-", b"+", b".", b"e", b"0x1", b"1_0", b"1,5",
    b"{", b"}", b"\n", b"\r", b"\t", b" ", b"\x00", b"\x1a", b"\xff", b"\xc3\xa9", b"\xef\xbb\xbf",
    b"\xff\xfe", b"9" * 40, b"9" * 5000, b"-1", b"0", b"ROOT a", b"JOINT Leg\n{\n", b"End Site\n{",
    b"End", b"OFFSET 0 0 0", b"OFFSET", b"CHANNELS 0", b"CHANNELS 3 Xrotation Xrotation Yrotation",
    b"CHANNELS 99999999999", b"MOTION", b"\nMOTION\n", b"HIERARCHY", b"Frames: 99999999999999",
    b"Frames:", b"Frame Time: 0", b"Frame Time:", b"Zrotation", b"Wscale", b"\xe2\x80\xa8",
]  # fmt: skip


def outcome_of(path):
    try:
        return jm.load(path)
    except MotionFileError as error:
        return error


@pytest.fixture(scope="module")
def attempt(tmp_path_factory):
    """Read bytes as a file; check what comes of it; return the motion or the error."""
    path = tmp_path_factory.mktemp("fuzz") / "clip.bvh"

    def attempt(data):
        path.write_bytes(data)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            outcome = outcome_of(path)
        if isinstance(outcome, MotionFileError):
            assert "\n" not in str(outcome)
            assert len(str(outcome)) < 1000
            assert outcome.path == str(path)
            return outcome
        assert all(issubclass(w.category, MotionFileWarning) for w in said)
        assert len(outcome) > 0
        assert np.isfinite(outcome.translations).all()
        np.testing.assert_allclose(np.linalg.norm(outcome.rotations, axis=-1), 1, atol=1e-12)
        assert 0 < float(outcome.frame_time) < np.inf
        return outcome

    return attempt


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    return tmp_path_factory.mktemp("scratch") / "clip.bvh"


def test_the_clip_itself_is_fine(attempt):
    assert attempt(CLIP).rotations.shape == (3, 3, 4)


@pytest.mark.parametrize("cut", range(len(CLIP)))
def test_cut_off_anywhere(attempt, cut):
    outcome = attempt(CLIP[:cut])
    first_row = CLIP.index(b"1 2 3 40.5")
    complete = CLIP[first_row:cut].count(b"\n") if cut > first_row else 0
    if complete:
        assert complete <= len(outcome) <= complete + 1
    elif cut < first_row:
        assert isinstance(outcome, MotionFileError)


@settings(max_examples=150, deadline=None)
@given(data=st.binary(max_size=300))
@example(b"HIERARCHY")
@example(b"HIERARCHY\n\x1c\n")
@example(b"\xff\xfeH\x00")
@example(b"\xfe\xff\x00H\x00")
def test_random_bytes(attempt, data):
    assert isinstance(attempt(data), MotionFileError)


edits = st.lists(
    st.tuples(
        st.integers(0, len(CLIP)),
        st.integers(0, 60),
        st.one_of(st.sampled_from(PIECES), st.binary(max_size=6), st.text(max_size=4)),
    ),
    min_size=1,
    max_size=4,
)


@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(edits=edits)
def test_garbled(attempt, scratch, edits):
    data = CLIP
    for place, length, piece in edits:
        piece = piece.encode("utf-8", "surrogatepass") if isinstance(piece, str) else piece
        data = data[:place] + piece + data[place + length :]
    motion = attempt(data)
    if isinstance(motion, jm.Motion):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MotionFileWarning)
            jm.save(motion, scratch)
        back = jm.load(scratch)
        assert back.skeleton.names == motion.skeleton.names
        assert back.skeleton.end_labels == motion.skeleton.end_labels
        np.testing.assert_array_equal(back.translations, motion.translations)
        assert_same_rotation(back.rotations, motion.rotations)


@settings(max_examples=150, deadline=None)
@given(order=st.permutations(range(24)), drop=st.integers(0, 23))
def test_lines_shuffled_doubled_and_dropped(attempt, order, drop):
    lines = CLIP.split(b"\n")[:-1]
    attempt(b"\n".join([lines[0], *(lines[i] for i in order if i != drop), lines[drop]]))
    attempt(b"\n".join(lines[:drop] + lines[drop : drop + 1] * 2 + lines[drop + 1 :]))
    attempt(b"\n".join(lines[:drop] + lines[drop + 1 :]))


@pytest.mark.parametrize("piece", PIECES)
def test_every_token_replaced(attempt, piece):
    tokens = CLIP.split(b" ")
    for i in range(0, len(tokens), 2):
        attempt(b" ".join([*tokens[:i], piece, *tokens[i + 1 :]]))


def deep(joints, closed=True):
    opening = b"".join(
        b"%s j%d\n{\nOFFSET 0 1 0\nCHANNELS %s\n"
        % (b"JOINT" if j else b"ROOT", j, b"0" if j else b"1 Yrotation")
        for j in range(joints)
    )
    closing = b"}\n" * (joints if closed else joints - 1)
    return b"HIERARCHY\n" + opening + closing + b"MOTION\nFrames: 1\nFrame Time: 1\n5\n"


def test_nesting_of_any_depth(attempt, tmp_path):
    motion = attempt(deep(1500))
    assert motion.num_joints == 1500
    jm.save(motion, tmp_path / "deep.bvh")
    assert jm.load(tmp_path / "deep.bvh").skeleton.parents == motion.skeleton.parents
    assert "1 are open" in str(attempt(deep(5000, closed=False)))
    assert isinstance(attempt(b"HIERARCHY\n" + b"ROOT a\n{\n" * 20_000), MotionFileError)
    assert isinstance(attempt(b"HIERARCHY\n" + b"{" * 200_000), MotionFileError)


def test_huge_counts_reserve_no_memory(attempt):
    many = deep(2000).replace(b"Frames: 1", b"Frames: 300000") + b"5\n" * 300_000
    tracemalloc.start()
    for count in (10**9, 10**15, 10**30):
        outcome = attempt(CLIP.replace(b"Frames: 3", b"Frames: %d" % count))
        assert isinstance(outcome, MotionFileError) or len(outcome) == 3
    assert "outgrow" in str(attempt(many))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100 << 20


def test_one_endless_line_and_endless_blank_lines(attempt):
    rows = CLIP[CLIP.index(b"1 2 3 40.5") :].replace(b"\n", b" ")
    head = CLIP[: CLIP.index(b"1 2 3 40.5")]
    assert len(attempt(head + rows * 5000)) == 15_000
    assert len(attempt(CLIP + b"\n" * 2_000_000)) == 3
    assert len(attempt(CLIP + b" \r\n" * 500_000)) == 3
    assert isinstance(attempt(head + b"1" * 3_000_000), MotionFileError)
    assert isinstance(attempt(CLIP.replace(b"Hips", b"H" * 3_000_000)), jm.Motion)
    assert isinstance(attempt(b"x" * 3_000_000), MotionFileError)
