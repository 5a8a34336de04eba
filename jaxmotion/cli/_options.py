"""Options that commands share, gathered into a few values: what a command takes is one decorator a
group and one argument a group.
"""

import functools
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from jaxmotion.cli._presets import flags_of, load_preset
from jaxmotion.io.formats import WRITTEN, unknown_suffix

NOWHERE = Path(os.devnull)

# Options that say how to go about it, not what comes out.
_MANNERS = {"out", "overwrite", "resume", "dry-run", "jobs", "fail-fast", "report", "no-cache"}
_MANNERS |= {"debug", "path", "plot", "cluster"}


@dataclass(frozen=True)
class Running:
    """How a process runs: ``cache``, ``debug``."""

    cache: bool
    debug: bool


@dataclass(frozen=True)
class Reading:
    """What is said of the inputs that they may not say: ``fps``, ``up``; None to believe them."""

    fps: float | None
    up: str | None


@dataclass(frozen=True)
class Batch:
    """Files in, files out: what the options of :func:`batch_options` say."""

    files: tuple[str, ...]
    out: Path
    overwrite: bool
    resume: bool
    dry_run: bool
    jobs: int
    cluster: str | None
    fail_fast: bool
    report: Path | None
    reading: Reading
    out_up: str | None


@dataclass(frozen=True)
class Selection:
    """Where an edit applies and how much of it."""

    strength: float
    joints: tuple[str, ...]
    frames: tuple[int | None, int | None]
    fade: int

    @property
    def everything(self) -> bool:
        """Whether the whole edit applies everywhere."""
        return self.strength == 1.0 and not self.joints and self.frames == (None, None)


class Output(click.Path):
    """A folder, or a file of a format that is written: what ends in another suffix was meant for a
    file, unless it is there or ends in a slash. (A suffix has a letter: ``takes.2026`` is a name.)
    """

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path."""
        path = Path(str(super().convert(value, param, ctx)))
        is_folder = path.is_dir() or str(value).endswith(("/", os.sep))
        has_suffix = any(map(str.isalpha, path.suffix))
        known = path.suffix.lower() in WRITTEN and self.file_okay
        if has_suffix and not known and not is_folder:
            what = (
                unknown_suffix(path, writing=True)
                if self.file_okay
                else f"{path}: expected a folder"
            )
            self.fail(f"{what} (the name of a folder may end with '/')", param, ctx)
        return path


class FrameRange(click.ParamType):
    """``120:480``, ``120:`` or ``:480``: frames as in ``motion[120:480]``, from 0, end excluded."""

    name = "FIRST:END"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The pair (first, end), ``None`` where left out."""
        if isinstance(value, tuple):
            return value
        try:
            first, end = (int(part) if part.strip() else None for part in str(value).split(":"))
        except ValueError:
            self.fail(f"{value!r} is not a range of frames such as 120:480", param, ctx)
        start = first or 0
        if end is not None and (start < 0) == (end < 0) and end <= start:
            self.fail(f"{value!r} holds no frame; the end is excluded", param, ctx)
        return first, end


class Gain(click.ParamType):
    """``PATTERN=NUMBER``: a gain for the joints whose names match."""

    name = "PATTERN=GAIN"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The pair (pattern, gain)."""
        if isinstance(value, tuple):
            return value
        pattern, _, number = str(value).rpartition("=")
        try:
            if not pattern:
                raise ValueError
            return pattern, float(number)
        except ValueError:
            self.fail(f"{value!r} is not of the form '*Arm*=2.0'", param, ctx)


def running_options(function: Callable) -> Callable:
    """``--preset --no-cache --debug``; the command is given ``running``. Numbers of all its
    options must be finite."""

    @click.option(
        "--preset",
        type=click.Path(dir_okay=False, path_type=Path),
        is_eager=True,
        expose_value=False,
        callback=load_preset,
        help="TOML file with other defaults for these options.",
    )
    @click.option("--no-cache", is_flag=True, help="Do not keep compiled programs on disk.")
    @click.option(
        "--debug",
        is_flag=True,
        is_eager=True,
        callback=_note_debug,
        help="Show where in the program an error happened.",
    )
    @functools.wraps(function)
    def command(*args, no_cache: bool, debug: bool, **values):
        _refuse_infinite(click.get_current_context())
        return function(*args, running=Running(not no_cache, debug), **values)

    return command


def files_argument(function: Callable) -> Callable:
    """FILES: files, folders or patterns, at least one."""
    return click.argument("files", nargs=-1, required=True, metavar="FILES...")(function)


def keep_contacts_option(function: Callable) -> Callable:
    """``--keep-contacts``: ``None`` if nothing is said."""
    return click.option(
        "--keep-contacts/--no-keep-contacts",
        default=None,
        help="Feet that stood still before stand still after, in the same places.  [default: where "
        "they would slide visibly more than before]",
    )(function)


def reading_options(function: Callable) -> Callable:
    """``--fps --up``; the command is given ``reading``."""

    @click.option(
        "--fps",
        type=click.FloatRange(min=0, min_open=True),
        help="Frame rate of the inputs, whatever they say; most .amc files say none, and 120 is "
        "taken. Nothing is resampled.",
    )
    @click.option(
        "--up",
        type=click.Choice(["x", "y", "z", "auto"]),
        help="The axis that points up in the inputs, whatever they say; .bvh and .amc files say "
        "none, and y is taken. auto guesses from the motion. Nothing is turned.",
    )
    @functools.wraps(function)
    def command(*args, fps: float | None, up: str | None, **values):
        return function(*args, reading=Reading(fps, up), **values)

    return command


def out_up_option(function: Callable) -> Callable:
    """``--out-up``."""
    return click.option(
        "--out-up",
        type=click.Choice(["x", "y", "z", "keep"]),
        help="The axis that is to point up in the outputs, which are turned for it.  [default: y "
        "in .bvh and .amc, which cannot say it, and .glb; keep in others]",
    )(function)


def report_option(function: Callable) -> Callable:
    """``--report``."""
    return click.option(
        "--report",
        type=click.Path(dir_okay=False, path_type=Path),
        callback=_report_suffix,
        help="Write a record of the run to an .html or .json file: options, versions, hashes, what "
        "changed in every file, what was learned of it. Also if the run fails or is interrupted.",
    )(function)


def reading_report_options(function: Callable) -> Callable:
    """``--report --overwrite``, for commands that write nothing else."""
    overwrite = click.option("--overwrite", is_flag=True, help="Replace a report that exists.")
    return report_option(overwrite(function))


def batch_options(function: Callable | None = None, *, out_required: bool = True) -> Callable:
    """FILES, ``-o`` and how to go through them; the command is given ``batch``, whose ``out`` is
    ``NOWHERE`` when ``-o`` may be left out and was."""
    if function is None:
        return functools.partial(batch_options, out_required=out_required)

    @files_argument
    @click.option(
        "-o",
        "--out",
        required=out_required,
        type=Output(),
        help="Output folder, which mirrors the inputs' tree; or the output file, for one input.",
    )
    @reading_options
    @out_up_option
    @click.option("--overwrite", is_flag=True, help="Replace outputs that exist.")
    @click.option(
        "--resume",
        is_flag=True,
        help="Skip outputs that are newer than their inputs and were made with the same options, "
        "of which a folder of outputs keeps a record (.jaxmotion-made). What a killed run left "
        "half-written is removed, with or without it.",
    )
    @click.option("-n", "--dry-run", is_flag=True, help="Say what would be written, and stop.")
    @click.option(
        "-j", "--jobs", type=click.IntRange(1), default=1, show_default=True, help="Processes."
    )
    @click.option(
        "--cluster",
        metavar="local|tcp://HOST:PORT",
        callback=_cluster,
        help="Work on a dask cluster: the scheduler of that address, whose workers share these "
        "folders, or workers of this machine, --jobs of them or one a core.",
    )
    @click.option("--fail-fast", is_flag=True, help="Stop at the first file that fails.")
    @report_option
    @functools.wraps(function)
    def command(*args, **values):
        values["out"] = values["out"] or NOWHERE
        values["jobs"] = _workers(click.get_current_context(), values["jobs"], values["cluster"])
        batch = Batch(**{name: values.pop(name) for name in Batch.__dataclass_fields__})
        return function(*args, batch=batch, **values)

    return command


def asked_for(ctx: click.Context) -> dict[str, Any]:
    """The command and those of its options that change what it writes."""
    options = {flags_of(p)[0]: p for p in ctx.command.params if isinstance(p, click.Option)}
    chosen = {flag: ctx.params[p.name] for flag, p in options.items() if p.name in ctx.params}
    return {"command": ctx.info_name, **{f: chosen[f] for f in chosen if f not in _MANNERS}}


def selection_options(function: Callable) -> Callable:
    """``--strength --joints --range --fade``; the command is given ``selection``."""

    @click.option(
        "--strength",
        type=click.FloatRange(0, 1),
        default=1.0,
        show_default=True,
        help="How much of the edit to apply.",
    )
    @click.option(
        "--joints",
        multiple=True,
        metavar="PATTERN",
        help="Only joints whose names match, such as 'Left*'; may be repeated.",
    )
    @click.option(
        "--range",
        "frames",
        type=FrameRange(),
        default=(None, None),
        help="Only these frames, such as 120:480 (from 0, end excluded); others stay as they are.",
    )
    @click.option(
        "--fade",
        type=click.IntRange(0),
        default=8,
        show_default=True,
        help="Frames over which the edit sets in and out, inside --range.",
    )
    @functools.wraps(function)
    def command(*args, **values):
        selection = Selection(**{name: values.pop(name) for name in Selection.__dataclass_fields__})
        return function(*args, selection=selection, **values)

    return command


def format_option(function: Callable) -> Callable:
    """``--to``: the suffix of outputs in a folder, ``None`` for each input's own."""
    return click.option(
        "--to",
        type=click.Choice([suffix[1:] for suffix in WRITTEN]),
        callback=lambda ctx, param, value: f".{value}" if value else None,
        help="Format of the outputs in a folder.",
    )(function)


def _refuse_infinite(ctx: click.Context) -> None:
    for param in ctx.command.params:
        for number in _numbers(ctx.params.get(param.name or "")):
            if not math.isfinite(number):
                raise click.BadParameter(f"{number} is not a finite number", ctx, param)


def _numbers(value: Any) -> Iterator[float]:
    """Those in a value, which may be a tuple of such."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, tuple):
        yield from chain.from_iterable(map(_numbers, value))


def _note_debug(ctx: click.Context, param: click.Parameter, value: bool) -> bool:
    ctx.meta["jaxmotion.debug"] = value
    return value


def _cluster(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    """What may be a cluster, if dask is there."""
    if value is None:
        return None
    from jaxmotion._cluster import connections

    if value != "local" and not connections.is_address(value):
        text = f"{value!r} is neither local nor an address such as tcp://host:8786"
        raise click.BadParameter(text, ctx, param)
    connections.needed("--cluster")
    return value


def _workers(ctx: click.Context, jobs: int, cluster: str | None) -> int:
    """Processes on this machine: of a cluster of its own, one a core if nothing is said."""
    if cluster is None:
        return jobs
    source = ctx.get_parameter_source("jobs")
    if cluster != "local" and source is ParameterSource.COMMANDLINE:
        raise click.UsageError(f"--jobs are processes of this machine; {cluster} has its workers")
    if source is not ParameterSource.DEFAULT:
        return jobs
    from jaxmotion._cluster.connections import cores

    return cores()


def _report_suffix(ctx: click.Context, param: click.Parameter, value: Path | None) -> Path | None:
    if value is not None and value.suffix.lower() not in (".html", ".json"):
        raise click.BadParameter(f"{value.name!r} ends neither in .html nor in .json")
    return value
