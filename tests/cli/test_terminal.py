"""Names and messages reach terminals and reports only as text that prints."""

import io
import json
import os
import shutil
import subprocess
import sys

import pytest

import jaxmotion as jm
from jaxmotion._plain import as_json, printable
from jaxmotion.cli import _terminal
from jaxmotion.io import MotionFileError, MotionFileWarning
from tests.cli.conftest import swinging

RED = "\x1b[31m"
TITLE = "\x1b]0;mine\x07"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("día 1/歩く é ü °.bvh", "día 1/歩く é ü °.bvh"),
        ("e\u0301 \u3000", "e\u0301 \u3000"),  # a combining accent, a wide space
        ("C:\\a\\b", "C:\\a\\b"),
        (f"{RED}a", r"\x1b[31ma"),
        (TITLE, r"\x1b]0;mine\x07"),
        ("a\nb\r\tc\x7f", r"a\nb\r\tc\x7f"),
        ("\x9b31m", r"\x9b31m"),  # the same in one character
        ("a\u202eb\u2028", r"a\u202eb\u2028"),  # reversed, a line's end
        (os.fsdecode(b"a\xff"), r"a\xff" if os.name != "nt" else "a\ufffd"),
        ("\ud800\U000e0001", r"\ud800\U000e0001"),
    ],
)
def test_text_that_prints(text, shown):
    assert printable(text) == shown
    assert as_json([text]).isprintable() == shown.isprintable()
    assert json.loads(as_json([text])) == [text]
    assert json.loads(as_json([text], indent=1, ascii_only=True)) == [text]


def test_errors_and_warnings_are_one_line_that_prints():
    text = str(MotionFileError(f"{RED}a.bvh", "x\ny", expected=TITLE, hint="\x9bz", line=3))
    assert text == r"\x1b[31ma.bvh:3: found x\ny; expected \x1b]0;mine\x07. Try: \x9bz"
    assert str(MotionFileWarning(f"{TITLE}: repaired")) == r"\x1b]0;mine\x07: repaired"


@pytest.fixture
def rude(tmp_path):
    """A folder whose files, readable and not, carry escape sequences in names and joints."""
    folder = tmp_path / f"takes{RED}"
    folder.mkdir()
    jm.save(swinging(8), folder / f"a{TITLE}\n.bvh")
    text = (folder / f"a{TITLE}\n.bvh").read_text()
    (folder / f"a{TITLE}\n.bvh").write_text(text.replace("LeftArm", f"Left{RED}Arm"))
    (folder / "broken.bvh").write_text(f"HIERARCHY\nROOT {TITLE}\n{{\nOFFSET {RED} 0\n")
    return folder


def checked(result):
    """The output, which prints but for its ends of lines."""
    for text in (result.stdout, result.stderr):
        assert not set(text) & {"\x1b", "\x07", "\r", "\x9b"}, text
        assert text.replace("\n", "").isprintable()
    return result.stdout + result.stderr


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["info", "{}", "--tree"], 1),
        (["info", "{}", "--json"], 1),
        (["info", "{}", "--debug"], 1),
        (["check", "{}"], 3),
        (["check", "{}", "--json"], 3),
        (["contacts", "{}", "--joint", "Left*"], 1),
        (["convert", "{}", "-o", "{}/out", "--to", "npz", "--dry-run"], 0),
        (["convert", "{}", "-o", "{}/out", "--to", "amc", "--report", "{}/r.json"], 1),
        (["convert", "{}", "-o", "{}/out", "--to", "npz", "--report", "{}/r.html"], 1),
        (["convert", "{}/none", "-o", "{}"], 2),
        (["convert", "{}/broken.bvh", "-o", "{}/broken.bvh"], 2),
        (["retime", "{}", "-o", "{}/out", "--to-fps", "20"], 1),
        (["stitch", "{}/a*", "{}/a*", "-o", f"{{}}/s{RED}.txt"], 2),
        (["align", "{}/none.bvh", "{}/broken.bvh", "-o", "{}/x.bvh"], 2),
        (["denoise", "{}", "-o", "{}/out", "--joints", "{}"], 1),
        (["denoise", "{}", "-o", "{}/out", "--report", f"{{}}/r{RED}.txt"], 2),
        (["denoise", "{}", "-o", "{}/out", "--preset", "{}/none"], 2),
        (["{}"], 2),
    ],
)
def test_no_command_lets_an_escape_sequence_through(jaxmotion, rude, words, code):
    if words[0] == "denoise":  # never gets as far as compiling
        (rude / f"a{TITLE}\n.bvh").write_text(f"{TITLE}")
    text = checked(jaxmotion(*(word.format(rude) for word in words), code=code))
    assert r"\x1b" in text or r"\u001b" in text
    for report in rude.glob("r.*"):
        written = report.read_text("utf-8")
        assert written.replace("\n", "").isprintable()
        if report.suffix == ".json":
            row = json.loads(written)["files"][0]
            assert row["input"] == str(rude / f"a{TITLE}\n.bvh")


def test_names_in_other_scripts_stay_readable(jaxmotion, tmp_path):
    path = tmp_path / "歩く día.bvh"
    jm.save(swinging(4), path)
    path.write_text(path.read_text("utf-8").replace("LeftArm", "左腕"), "utf-8")
    assert "左腕" in jaxmotion("info", path, "--tree").stdout
    text = jaxmotion("info", path, "--json").stdout
    assert "歩く día" in text
    assert "左腕" in text


def test_a_terminal_with_few_characters(monkeypatch):
    for say, value in ((_terminal.say, "歩 °"), (_terminal.say_json, ["歩 °\x1b"])):
        raw = io.BytesIO()
        monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, "cp1252"))
        _terminal.make_streams_lenient()
        say(value)
        text = raw.getvalue().decode("cp1252")
        assert text == "\\u6b69 °\n" if say is _terminal.say else json.loads(text) == value


def program(*words, shell):
    """Run Python with streams as a shell sets them up."""
    command = ["sh", "-c", f'exec "$@" {shell}', "sh", sys.executable]
    return subprocess.run([*command, *map(str, words)], capture_output=True, text=True, timeout=120)


sh = pytest.mark.skipif(shutil.which("sh") is None, reason="no shell")


@sh
def test_closed_streams(tmp_path):
    """What would be printed must not end up in the file that takes the stream's number."""
    code = """
import os, sys
from jaxmotion.cli import _terminal
_terminal.make_ready()
with open(sys.argv[1], "wb", 0) as file:
    file.write(b"mine")
    for number in (1, 2):
        os.write(number, b"noise")
    _terminal.say("noise")
    _terminal.say("noise", err=True)
"""
    ran = program("-c", code, tmp_path / "x", shell="<&- >&- 2>&-")
    assert ran.returncode == 0
    assert (tmp_path / "x").read_bytes() == b"mine"
    ran = program("-m", "jaxmotion", "--help", shell="<&- >&- 2>&-")
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")


@sh
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
def test_full_streams():
    ran = program("-m", "jaxmotion", "--help", shell=">/dev/full")
    assert ran.returncode == 1
    assert ran.stderr == "Error: standard output cannot be written: the disk is full\n"
    ran = program("-m", "jaxmotion", "denoise", shell="2>/dev/full")
    assert (ran.returncode, ran.stdout) == (2, "")


def test_nobody_reads_any_more():
    ours, theirs = os.pipe()
    os.close(ours)
    ran = subprocess.run(
        [sys.executable, "-m", "jaxmotion", "--help"],
        stdout=theirs,
        stderr=subprocess.PIPE,
        text=True,
        timeout=60,
    )
    os.close(theirs)
    assert (ran.returncode, ran.stderr) == (1, "")


def test_a_broken_stderr_does_not_stop_the_work(monkeypatch):
    class Broken(io.StringIO):
        def write(self, text):
            raise BrokenPipeError(32, "Broken pipe")

    monkeypatch.setattr(sys, "stderr", Broken())
    _terminal.say("progress", err=True)
    monkeypatch.setattr(sys, "stdout", Broken())
    with pytest.raises(BrokenPipeError):
        _terminal.say("result")


@pytest.mark.skipif(os.name == "nt", reason="pipes as Unix has them")
def test_pipes_are_refused_and_not_waited_for(jaxmotion, take, tmp_path):
    pipe = tmp_path / "pipe.bvh"
    os.mkfifo(pipe)
    out = tmp_path / "out.bvh"
    assert "a named pipe" in jaxmotion("info", pipe, code=2).stderr
    assert "a named pipe" in jaxmotion("align", take, pipe, "-o", out, code=1).stderr
    assert "a named pipe" in jaxmotion("convert", take, "-o", pipe, "--overwrite", code=1).stderr
    assert "a named pipe" in jaxmotion("stitch", take, "-o", pipe, "--overwrite", code=1).stderr
    assert "a named pipe" in jaxmotion("info", take, "--preset", pipe, code=2).stderr
    (tmp_path / "loop.bvh").symlink_to("loop.bvh")
    assert "a loop of symbolic links" in jaxmotion("info", tmp_path / "loop.bvh", code=2).stderr
    loop = tmp_path / "loop.bvh"
    text = jaxmotion("convert", take, "-o", loop, "--overwrite", code=1).stderr
    assert "loop.bvh: cannot be written: a loop of symbolic links" in text
    (tmp_path / "gone.bvh").symlink_to("nowhere.bvh")
    assert "a link to nothing" in jaxmotion("info", tmp_path / "gone.bvh", code=2).stderr
    (tmp_path / "folder.npz").mkdir()
    words = ("convert", tmp_path / "*ake.bvh", "-o", tmp_path, "--to", "npz")
    (tmp_path / "take.npz").mkdir()
    text = jaxmotion(*words, "--resume", code=1).stderr
    assert "take.npz cannot be written: a folder, not a file" in text


def test_a_bar_on_a_terminal_prints_names_likewise(monkeypatch, tmp_path):
    from jaxmotion.cli import _leaving
    from jaxmotion.cli._files import Job
    from jaxmotion.cli._progress import Progress
    from jaxmotion.cli._work import Outcome

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr(sys, "stderr", Terminal())
    acts = len(_leaving._acts)
    with Progress(2) as progress:
        assert len(_leaving._acts) == acts + 1  # should the run be interrupted: the cursor
        job = Job(tmp_path / TITLE, tmp_path / TITLE)
        progress.tell(Outcome(job, "failed", f"{TITLE}歩く", [TITLE]))
    assert len(_leaving._acts) == acts
    text = sys.stderr.getvalue()
    assert TITLE not in text
    assert text.count(r"\x1b]0;mine\x07") == 3
    assert "歩く" in text
