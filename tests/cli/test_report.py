"""The record of a run: what is in it, and that it is written however the run ends."""

import datetime
import hashlib
import html
import re
from importlib import metadata
from urllib.parse import unquote

import click
import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cli import _batch, _changes, _legend, _page, _report, _runs, _work
from jaxmotion.cli._files import Job
from tests.cli.conftest import record_in, swinging
from tests.helpers import quaternions_by

TEXT, NONE = str, type(None)
PEAK = dict.fromkeys(("mean", "p95", "max"), float) | {
    "frame": int,
    "joint": TEXT,
    "end_site": bool,
}
FEET = dict.fromkeys(("slide_before", "slide_edited", "slide_after", "root_move"), float)
FEET |= {"contacts_restored": int, "slide_timed": (float, NONE)}
CLIP = {"unit": (float, NONE), "frames": (int, NONE), "rate": (float, NONE)}
FILE = CLIP | {
    "input": TEXT,
    "output": (TEXT, NONE),
    "status": ("written", "read", "skipped", "failed", "not tried"),
    "message": TEXT,
    "warnings": [TEXT],
    "seconds": (float, NONE),
    "sha256": (TEXT, NONE),
    "with": [CLIP | {"input": TEXT, "sha256": (TEXT, NONE)}],
    "made": dict,
    "result": (CLIP, NONE),
    "changes": (
        {
            "frames": int,
            "frames_changed": int,
            "degrees": PEAK,
            "shift": PEAK,
            "distance": (PEAK, NONE),
            "root": PEAK,
        },
        NONE,
    ),
    "feet": (FEET, NONE),
    "jerk": ({"before": (float, NONE), "after": (float, NONE)}, NONE),
    "player": (TEXT, NONE),
    "learned": dict,
}
RECORD = {
    **dict.fromkeys(("jaxmotion", "jax", "command", "begun", "ended", "end"), TEXT),
    "options": dict,
    "preset": (TEXT, NONE),
    "counts": dict.fromkeys(_report.STATUSES, int),
    "files": [FILE],
}


def fits(value, form):
    """Whether a value has the form: a type, a text, a list of one form, keys, or one of several."""
    if isinstance(form, tuple):
        return any(fits(value, one) for one in form)
    if isinstance(form, list):
        return isinstance(value, list) and all(fits(item, form[0]) for item in value)
    if isinstance(form, dict):
        same = isinstance(value, dict) and value.keys() == form.keys()
        return same and all(fits(value[key], form[key]) for key in form)
    return value == form if isinstance(form, str) else isinstance(value, form)


def read(path):
    """The record in a report, which has the form that is documented."""
    record = record_in(path)
    assert record.keys() == RECORD.keys()
    for key, form in RECORD.items():
        rows = record["files"] if key == "files" else [record[key]]
        assert all(fits(row, form[0] if key == "files" else form) for row in rows), (key, rows)
    assert sum(record["counts"].values()) == len(record["files"])
    for key in RECORD.keys() | FILE.keys() | FEET.keys() | PEAK.keys():
        assert f"``{key}``" in _report.__doc__, key
    return record


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def takes(tmp_path):
    """A folder with two good files, and one that is broken between them."""
    folder = tmp_path / "takes"
    folder.mkdir()
    jm.save(swinging(6), folder / "a.bvh")
    (folder / "b.bvh").write_text("HIERARCHY\nROOT Hips\n{\nOFFSET 0 0\n")
    jm.save(swinging(9, seed=1), folder / "c.bvh")
    return folder


def test_a_run(jaxmotion, takes, tmp_path):
    report, out = tmp_path / "r.json", tmp_path / "one"
    preset = tmp_path / "p.toml"
    preset.write_text("fps = 50\n")
    words = ("convert", takes, "--to", "npz", "--report", report)
    before = datetime.datetime.now(datetime.UTC).replace(microsecond=0)
    jaxmotion(*words, "-o", out, "--preset", preset, code=1)
    record = read(report)
    assert (record["jaxmotion"], record["jax"]) == (jm.__version__, metadata.version("jax"))
    assert (record["command"], record["preset"], record["end"]) == (
        "convert",
        str(preset),
        "finished",
    )
    assert (record["options"]["to"], record["options"]["fps"]) == (".npz", 50)
    times = [datetime.datetime.fromisoformat(record[key]) for key in ("begun", "ended")]
    assert before <= times[0] <= times[1]
    assert (record["counts"]["written"], record["counts"]["failed"]) == (2, 1)
    good, broken, other = record["files"]
    assert good["input"] == str(takes / "a.bvh")
    assert good["sha256"] == sha256(takes / "a.bvh")
    assert (good["frames"], good["rate"], good["unit"]) == (6, 50.0, None)
    assert good["result"] == {"unit": None, "frames": 6, "rate": 50.0}
    assert good["made"] == {str(out / "a.npz"): sha256(out / "a.npz")}
    assert (broken["status"], broken["sha256"]) == ("failed", sha256(takes / "b.bvh"))
    assert "expected" in broken["message"]
    assert (broken["frames"], broken["made"]) == (None, {})
    assert other["frames"] == 9
    assert "exists; add" in jaxmotion(*words, "-o", tmp_path / "two", code=2).stderr
    assert not (tmp_path / "two").exists()


def test_a_page(jaxmotion, takes, tmp_path):
    page = tmp_path / "deep" / "r.html"
    jaxmotion("convert", takes, "--to", "npz", "--report", page, "-o", tmp_path / "out", code=1)
    text = page.read_text("utf-8")
    assert "c.npz" in text
    assert "http" not in text
    assert "2 written, 1 failed; finished" in text
    assert "convert --to .npz" in text
    assert headings(text) == [
        *("file", "output", "status", "frames", "frames a second", "seconds it took")
    ]
    assert read(page)["files"][2]["sha256"] == sha256(takes / "c.bvh")


def headings(text):
    """Of all tables of a page."""
    return re.findall(r'<th[^>]*><button type="button">(.*?)</button></th>', text)


def legends(text):
    """What is said of columns, by the title of a legend."""
    parts = re.findall(
        r'<h4 class="legend">(.*?)</h4>\n<dl class="legend">(.*?)</dl>', text, re.DOTALL
    )
    return {title: dict(re.findall("<dt>(.*?)</dt><dd>(.*?)</dd>", rows)) for title, rows in parts}


def test_columns_are_explained(jaxmotion, take, tmp_path):
    """Each heading of the table of files, at the heading and below; those of tables of what was
    learned as well, once for all files."""
    report = tmp_path / "r.html"
    jm.save(swinging(seed=2, noise=0.03), tmp_path / "other.npz")
    words = ("denoise", take, tmp_path / "other.npz", "-o", tmp_path / "out")
    jaxmotion(*words, "--report", report)
    text = report.read_text("utf-8")
    table = re.findall(r'<div class="table">.*?</div>', text, re.DOTALL)[0]
    titles = re.findall(r'<th title="(.*?)"><button type="button">(.*?)</button></th>', table)
    assert len(titles) == len(headings(table)) > 8
    below = legends(text)
    assert below["What the columns say"] == {name: title for title, name in titles}
    assert all(title.endswith(".") for title, _ in titles)
    assert text.index("What the columns say") < text.index("what was learned of")
    turns = below["What the columns of turns say"]
    assert list(turns) == ["lam", "sigma", "hertz", "degrees"]
    assert text.count(f'title="{turns["hertz"]}"') == 4  # turns and translations of two files
    assert text.count("What the columns of turns say") == 1


def test_every_figure_is_explained():
    """Also keys of what repair and denoise learn."""
    for _, heading, meaning in _legend.FIGURES:
        assert heading
        assert meaning.endswith(".")
    walk = jm.samples.load("walk", fps=24.0, num_frames=96).motion
    broken = jm.samples.offset_joints(walk, jax.random.key(0), runs=1).motion
    found = jm.cleaning.repair(broken)
    tables = {
        "runs": _runs.of_repair(found),
        "runs_left": _runs.of_errors(found.errors),
        "changes": _changes.of_joints(broken, walk, 96, None),
    }
    for name, rows in tables.items():
        assert set(rows[0]) - {"joint"} == set(_legend.LEARNED[name]), name


def test_players_of_several_files(jaxmotion, takes, tmp_path):
    """Beside the report, a page a file; the run after next leaves what it does not make again."""
    report, out = tmp_path / "my report.html", tmp_path / "out"
    words = ("denoise", takes, "-o", out, "--report", report)
    jaxmotion(*words, code=1)
    good, broken, other = read(report)["files"]
    assert broken["player"] is None
    assert broken["jerk"] is None
    for row, name in ((good, "a"), (other, "c")):
        assert row["player"].startswith(f"my%20report-players/{name}-")
        page = report.parent / unquote(row["player"])
        before, after = (jm.load(folder / f"{name}.bvh") for folder in (takes, out))
        for clip, when in ((before, "before"), (after, "after")):
            assert row["jerk"][when] == pytest.approx(jm.metrics.jerk(clip).mean(), rel=1e-3)
        assert row["jerk"]["after"] < row["jerk"]["before"]
        text = page.read_text("utf-8")
        assert '"before"' in text
        assert f'href="{row["player"]}"' in report.read_text("utf-8")
    assert len(list((tmp_path / "my report-players").iterdir())) == 2
    assert "<iframe" not in report.read_text("utf-8")
    jaxmotion(*words, "--resume", code=1)
    assert [row["player"] for row in read(report)["files"]] == [
        good["player"],
        None,
        other["player"],
    ]
    report.unlink()
    assert "players exists; add --overwrite" in jaxmotion(*words, code=2).stderr


def test_the_player_of_one_file_is_in_the_page(jaxmotion, take, tmp_path):
    report, out = tmp_path / "r.html", tmp_path / "out.bvh"
    words = ("denoise", take, "-o", out, "--report", report)
    jaxmotion(*words)
    text = report.read_text("utf-8")
    [hidden] = re.findall(r'<iframe .*?srcdoc="(.*?)"></iframe>', text, re.DOTALL)
    assert html.unescape(hidden).startswith("<!doctype html>")
    assert read(report)["files"][0]["player"] is None
    assert not (tmp_path / "r-players").exists()
    jaxmotion(*words, "--resume")
    assert hidden in report.read_text("utf-8")


def test_no_player_in_json(jaxmotion, take, tmp_path, monkeypatch):
    monkeypatch.setattr(jm.viz, "player", None)
    jaxmotion("denoise", take, "-o", tmp_path / "o.bvh", "--report", tmp_path / "r.json")
    assert read(tmp_path / "r.json")["files"][0]["jerk"]["before"] > 0


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (("retime", "--to-fps", "24"), ["before", "after"]),
        (("layers",), ["before", "base", "denoised"]),
        (("multires", "--gains", "1,1"), ["before", "after"]),
        (("repair",), ["before", "after"]),
        (("augment", "--count", "2"), ["before", "01", "02"]),
        (("stitch", "other.npz"), ["take", "other", "result"]),
    ],
)
def test_every_editing_verb_has_it(jaxmotion, take, tmp_path, monkeypatch, words, names):
    monkeypatch.chdir(tmp_path)
    jm.save(swinging(seed=1), "other.npz")
    shown = []
    player = jm.viz.player
    monkeypatch.setattr(
        jm.viz, "player", lambda clips, **marks: shown.append(clips) or player(clips, **marks)
    )
    verb, *rest = words
    files = [word for word in rest if "." in word and not word[0].isdigit()]
    options = [word for word in rest if word not in files]
    out = "out" if verb in ("layers", "augment") else "out.npz"
    jaxmotion(verb, take, *files, *options, "-o", out, "--report", "r.html")
    [clips] = shown
    assert list(clips) == names


def test_pages_escape_names(tmp_path):
    with click.Context(click.Command("</script><script>")) as context:
        context.info_name = "</script><script>"
        job = Job(tmp_path / "<b>.bvh", tmp_path / "x")
        with _report.Report(tmp_path / "r.html", [job]) as report:
            report.add(_work.Outcome(job, "failed", "</script><script>"))
    text = (tmp_path / "r.html").read_text("utf-8")
    assert text.count("<script>") == 1  # its own
    assert "&lt;b&gt;.bvh" in text
    assert read(tmp_path / "r.html")["files"][0]["message"] == "</script><script>"


def test_what_was_learned(jaxmotion, tmp_path):
    """σ is the noise that was put in; hertz are where the smoother leaves half of a swing."""
    rng, frames, noise = np.random.default_rng(0), 300, 0.02
    clean = swinging(frames, noise=0.0)
    turns = quaternions_by(noise * rng.standard_normal((frames, 4, 3)))
    rotations = np.array(jm.quaternion.multiply(clean.rotations, turns))
    rotations[:, 3] = rotations[0, 3]  # keeps still
    jm.save(clean.with_transforms(rotations=rotations), tmp_path / "take.npz")
    report, out = tmp_path / "r.html", tmp_path / "out.npz"
    told = jaxmotion("denoise", tmp_path / "take.npz", "-o", out, "--report", report).stderr
    [row] = read(report)["files"]
    most, *others = row["learned"]["changes"]
    assert sorted(line["joint"] for line in (most, *others)) == ["Hips", "LeftArm", "LeftHand"]
    assert f"  turned most: {most['joint']} by {most['degrees']:.3g}° at frame" in told
    assert "not like noise" not in told
    for line in (most, *others):
        assert line["noise"] == pytest.approx(np.degrees(noise), rel=0.15)
        assert (line["stands_out"], line["contact"]) == ([], None)
    turned = {line.pop("joint"): line for line in row["learned"]["turns"]}
    assert set(turned) == {"Hips", "LeftArm", "LeftHand"}
    for line in turned.values():
        assert line["degrees"] == pytest.approx(np.degrees(noise), rel=0.15)
        product = line["lam"] * line["sigma"]
        gain = 1 / (1 + 2 * product * 2 * product * np.sin(np.pi * line["hertz"] / 30) ** 4)
        assert gain == pytest.approx(0.5, abs=1e-9) or line["hertz"] == 15
    assert [line["joint"] for line in row["learned"]["translations"]] == ["Hips"]
    text = report.read_text()
    assert "hertz" in headings(text)
    assert "<h4>changes</h4>" in text
    assert "what was learned of" in text
    moved = row["changes"]["distance"]
    assert (moved["joint"], moved["end_site"]) == ("LeftHand", True)
    assert "LeftHand, end site" in text


def test_nothing_is_learned_unless_a_report_asks(take, tmp_path):
    def never():
        raise AssertionError

    editing = _work.Editing(
        lambda motion, length: _work.Edited(motion, never),
        _work.Selection(1.0, (), (None, None), 0),
        _work.Reading(None, None),
    )
    assert _work.edit_file(editing, Job(take, tmp_path / "x.npz")).change.distance is None


def test_rows_of_what_was_learned_are_shown(tmp_path):
    lines = [{"joint": "Toe", "frames": [3, 5], "degrees": 21.5}]
    effect = _work.Effect((), learned={"bridged": lines, "levels": 3})
    with click.Context(click.Command("denoise")) as context:
        context.info_name = "denoise"
        job = Job(tmp_path / "a.bvh", tmp_path / "b.bvh")
        with _report.Report(tmp_path / "r.html", [job]) as report:
            report.add(_work.Outcome(job, "written", effect=effect))
    text = (tmp_path / "r.html").read_text()
    assert "<h4>bridged</h4>" in text
    assert '<td>Toe</td><td>3, 5</td><td class="number" data-value="21.5">21.5</td>' in text
    assert '<td>levels</td><td class="number" data-value="3">3</td>' in text
    assert read(tmp_path / "r.html")["files"][0]["learned"]["bridged"] == lines


@pytest.mark.parametrize("suffix", ["json", "html"])
def test_resume_keeps_what_is_known_of_outputs_that_are_there(jaxmotion, takes, tmp_path, suffix):
    report, out = tmp_path / f"r.{suffix}", tmp_path / "out"
    words = ("convert", takes, "--to", "npz", "--report", report, "-o", out)
    jaxmotion(*words, code=1)
    first = read(report)["files"]
    jm.save(swinging(9, seed=2), out / "c.npz", overwrite=True)  # no longer that of the report
    jaxmotion(*words, "--resume", code=1)
    record = read(report)
    kept, failed, other = record["files"]
    assert record["counts"] == dict.fromkeys(_report.STATUSES, 0) | {"skipped": 2, "failed": 1}
    assert kept == first[0] | {"status": "skipped", "message": "newer than its input"}
    assert failed["status"] == "failed"
    assert (other["status"], other["frames"]) == ("skipped", None)
    assert other["made"] == {str(out / "c.npz"): sha256(out / "c.npz")}
    report.write_text("nonsense")
    jaxmotion(*words, "--resume", code=1)
    assert read(report)["files"][0]["frames"] is None


@pytest.mark.parametrize("suffix", ["json", "html"])
@pytest.mark.parametrize("given", ["the folder", "the new file", "from elsewhere"])
def test_resume_adds_to_the_report(jaxmotion, takes, tmp_path, monkeypatch, suffix, given):
    """A file that was done before keeps its row and what there is to look at, whether it is given
    again or not, and whatever the folders are called from where the program runs."""
    monkeypatch.chdir(tmp_path)
    (takes / "b.bvh").unlink()
    later = (takes / "c.bvh").rename(tmp_path / "c.bvh")
    report = tmp_path / f"r.{suffix}"
    words = ("denoise", "-o", "out", "--report", report)
    jaxmotion(*words, "takes")
    [first] = read(report)["files"]
    assert first["changes"]["frames_changed"] == 6
    later.rename(takes / "c.bvh")
    if given == "from elsewhere":
        monkeypatch.chdir(takes)
        jaxmotion("denoise", "-o", "../out", "--report", report, ".", "--resume")
    else:
        files = "takes" if given == "the folder" else "takes/c.bvh"
        out = "out" if given == "the folder" else "out/c.bvh"
        jaxmotion("denoise", "-o", out, "--report", report, files, "--resume")
    record = read(report)
    rows = {row["input"].split("/")[-1]: row for row in record["files"]}
    assert list(rows) == (["c.bvh", "a.bvh"] if given == "the new file" else ["a.bvh", "c.bvh"])
    assert record["counts"] == dict.fromkeys(_report.STATUSES, 0) | {"skipped": 1, "written": 1}
    assert (rows["c.bvh"]["status"], rows["a.bvh"]["status"]) == ("written", "skipped")
    if given == "from elsewhere":
        first = first | {"input": "a.bvh", "output": "../out/a.bvh"}
        first["made"] = {"../out/a.bvh": first["made"]["out/a.bvh"]}
    said = first["message"] or ("newer than its input" if given != "the new file" else "")
    assert rows["a.bvh"] == first | {"status": "skipped", "message": said}
    text = report.read_text("utf-8")
    if suffix == "html":
        assert all(f"<td>{row['input']}" in text for row in rows.values())
        assert text.count('class="skipped"') == text.count('class="written"') == 1
        assert "<iframe" in _page.pictures_in(text)[first["input"]]


def test_what_an_earlier_report_no_longer_knows(jaxmotion, takes, tmp_path):
    """Rows of outputs that are gone or others now, and of runs that were asked for other things."""
    report, out = tmp_path / "r.json", tmp_path / "out"
    words = ("convert", "--to", "npz", "-o", out, "--report", report)
    jaxmotion(*words, takes, code=1)

    def rows(*more, file="c.bvh"):
        jaxmotion(*words, takes / file, "--resume", "--overwrite", *more)
        return [row["input"].split("/")[-1] for row in read(report)["files"]]

    before = report.read_text()
    assert rows() == ["c.bvh", "a.bvh"]  # b failed: nothing of it was done
    report.write_text(before)
    assert rows("--fps", 50) == ["c.bvh"]
    jaxmotion(*words, takes, "--overwrite", code=1)
    before = report.read_text()
    (out / "a.npz").write_text("other")
    assert rows() == ["c.bvh"]
    report.write_text(before)
    (out / "a.npz").unlink()
    assert rows() == ["c.bvh"]


def test_what_repair_said_is_kept(jaxmotion, takes, tmp_path):
    (takes / "b.bvh").unlink()
    report = tmp_path / "r.html"
    words = ("repair", takes, "-o", tmp_path / "out", "--report", report)
    jaxmotion(*words)
    said = [row["message"] for row in read(report)["files"]]
    assert said == ["nothing found"] * 2
    jaxmotion(*words, "--resume")
    assert [(row["status"], row["message"]) for row in read(report)["files"]] == [
        ("skipped", text) for text in said
    ]


def test_looking_again_keeps_files_that_are_not_given(jaxmotion, takes, tmp_path):
    (takes / "b.bvh").unlink()
    report = tmp_path / "r.json"
    words = ("repair", "--detect-only", "--report", report)
    jaxmotion(*words, takes / "a.bvh")
    jaxmotion(*words, takes / "c.bvh", "--resume")
    files = read(report)["files"]
    assert [row["status"] for row in files] == ["read", "skipped"]
    assert [row["frames"] for row in files] == [9, 6]
    jm.save(swinging(7), takes / "a.bvh", overwrite=True)
    jaxmotion(*words, takes / "c.bvh", "--resume")
    assert len(read(report)["files"]) == 1


def test_the_first_failure_ends_it(jaxmotion, takes, tmp_path):
    report = tmp_path / "r.json"
    words = ("convert", takes, "--to", "npz", "-o", tmp_path / "out", "--report", report)
    told = jaxmotion(*words, "--fail-fast", code=1).stderr
    assert "Stopped at the first failure; 1 not tried." in told
    record = read(report)
    assert record["end"] == "failed: stopped at the first failure"
    statuses = [row["status"] for row in record["files"]]
    assert statuses == ["written", "failed", "not tried"]


@pytest.mark.parametrize(
    ("error", "code", "end"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (RuntimeError("it broke"), 1, "failed: unexpected RuntimeError: it broke"),
    ],
)
def test_what_breaks_off_is_on_record(jaxmotion, takes, tmp_path, monkeypatch, error, code, end):
    (takes / "b.bvh").unlink()
    report, calls = tmp_path / "r.json", []

    def guarded(process, job):
        if calls:
            raise error
        calls.append(job)
        return _work.guarded(process, job)

    monkeypatch.setattr(_batch, "guarded", guarded)
    words = ("convert", takes, "--to", "npz", "-o", tmp_path / "out", "--report", report)
    told = jaxmotion(*words, code=code).stderr
    record = read(report)
    assert record["end"].startswith(end)
    assert [row["status"] for row in record["files"]] == ["written", "not tried"]
    assert record["files"][1]["input"] == str(takes / "c.bvh")
    if code == 130:
        hint = "1 of 2 files are done; the same command with --resume goes on from there."
        assert told.splitlines()[-2:] == ["Interrupted.", hint]
        monkeypatch.undo()
        jaxmotion(*words, "--resume")
        record = read(report)
        assert (record["end"], record["counts"]["skipped"]) == ("finished", 1)
        assert [row["frames"] for row in record["files"]] == [6, 9]


def test_a_source_that_changes_meanwhile_has_no_hash(jaxmotion, take, tmp_path, monkeypatch):
    save = jm.save

    def meddle(*given, **named):
        save(*given, **named)
        take.write_text(take.read_text() + "\n")

    monkeypatch.setattr(jm, "save", meddle)
    report = tmp_path / "r.json"
    jaxmotion("convert", take, "-o", tmp_path / "x.npz", "--report", report)
    [row] = read(report)["files"]
    assert row["sha256"] is None
    assert "take.bvh changed while it was worked on: no hash of it" in row["warnings"][0]


def test_files_that_go_together(jaxmotion, tmp_path):
    jm.save(swinging(5), tmp_path / "take.amc")
    words = ("convert", tmp_path / "take.amc", "-o", tmp_path / "out.amc")
    jaxmotion(*words, "--report", tmp_path / "r.json")
    [row] = read(tmp_path / "r.json")["files"]
    assert row["sha256"] == sha256(tmp_path / "take.amc")
    [skeleton] = row["with"]
    assert skeleton["input"] == str(tmp_path / "take.asf")
    assert skeleton["sha256"] == sha256(tmp_path / "take.asf")
    made = [tmp_path / "out.amc", tmp_path / "out.asf"]
    assert row["made"] == {str(path): sha256(path) for path in made}


def test_joined_clips(jaxmotion, take, tmp_path):
    """Of blend, stitch and align: the clip that is edited, and the others."""
    other, out = tmp_path / "other.npz", tmp_path / "out.npz"
    jm.save(swinging(seed=1), other)
    words = ("-o", out, "--overwrite", "--report", tmp_path / "r.json")
    jaxmotion("stitch", take, other, "--search", "0", *words)
    [row] = read(tmp_path / "r.json")["files"]
    assert (row["input"], row["result"]["frames"]) == (str(take), 79)
    assert [(clip["input"], clip["sha256"], clip["frames"]) for clip in row["with"]] == [
        (str(other), sha256(other), 40)
    ]
    assert row["learned"]["seams"] == [{"frame": 39, "seconds": pytest.approx(1.3, abs=1e-3)}]
    assert row["changes"]["frames"] == 79
    assert row["message"].startswith("2 clips in 79 frames")
    jaxmotion("blend", take, take, other, *words)
    [row] = read(tmp_path / "r.json")["files"]
    assert row["input"] == str(other)
    assert [clip["input"] for clip in row["with"]] == [str(take), str(take)]
    assert row["changes"]["frames_changed"] == 0
    jaxmotion("align", take, other, *words)
    record = read(tmp_path / "r.json")
    [row] = record["files"]
    assert (record["command"], record["options"]["method"]) == ("align", "dtw")
    assert row["learned"]["joints_compared"] == 3
    assert row["made"] == {str(out): sha256(out)}


def test_a_joining_that_fails(jaxmotion, take, tmp_path):
    short, report = tmp_path / "short.bvh", tmp_path / "r.json"
    jm.save(swinging(12), short)
    words = ("blend", take, short, take, "-o", tmp_path / "out.bvh", "--report", report)
    jaxmotion(*words, code=1)
    record = read(report)
    assert record["end"].startswith("failed: the clips have 40, 12, 40 frames")
    [row] = record["files"]
    assert (row["status"], row["sha256"]) == ("failed", sha256(take))
    assert "exists; add --overwrite" in jaxmotion(*words, code=2).stderr


def test_commands_that_write_nothing(jaxmotion, takes, tmp_path):
    report = tmp_path / "r.json"
    words = (takes, "--report", report)
    jaxmotion("check", *words, code=3)
    record = read(report)
    assert record["counts"]["read"] == 2
    good, broken, _ = record["files"]
    assert (good["output"], good["made"], good["frames"]) == (None, {}, 6)
    assert good["sha256"] == sha256(takes / "a.bvh")
    assert (broken["status"], broken["learned"]["problems"][0]["kind"]) == ("failed", "unreadable")
    assert "exists; add --overwrite" in jaxmotion("info", *words, code=2).stderr
    jaxmotion("info", *words, "--overwrite", code=1)
    assert read(report)["files"][0]["learned"]["height"] > 0
    jaxmotion("contacts", *words, "--overwrite", code=1)
    assert read(report)["files"][2]["learned"]["contacts"] == []


def test_every_command_that_reads_files_has_it():
    from jaxmotion.cli._app import app

    context = click.Context(app)
    commands = {name: app.get_command(context, name) for name in app.list_commands(context)}
    without = {n for n, c in commands.items() if all(p.name != "report" for p in c.params)}
    assert without == {"compare", "demo", "view"}
