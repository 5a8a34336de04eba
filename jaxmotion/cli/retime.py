"""``jaxmotion retime``: another frame rate, another timing."""

import itertools
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from jaxmotion.cli._files import Job
from jaxmotion.cli._options import (
    Batch,
    Running,
    batch_options,
    keep_contacts_option,
    running_options,
)

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion._types import ArrayLike
    from jaxmotion.cli._work import Effect

_POSITIVE = click.FloatRange(min=0, min_open=True)
_SECONDS = click.FloatRange(min=0)


class When(click.ParamType):
    """``1.5=2.0``: a time in the input and its time in the output."""

    name = "BEFORE=AFTER"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The pair of seconds."""
        if isinstance(value, tuple):
            return value
        before, _, after = str(value).partition("=")
        try:
            return float(before), float(after)
        except ValueError:
            self.fail(f"{value!r} is not of the form '1.5=2.0', seconds", param, ctx)


@dataclass(frozen=True)
class Timing:
    """What was asked for: ``warp`` are options of ``time_warp``, ``rate`` of ``resample``, empty
    where nothing was; ``speed``: of the whole clip, 1 its own; ``method``: of both."""

    warp: dict[str, Any]
    speed: float | None
    keep_duration: bool
    rate: dict[str, Any]
    method: Any


@click.command(short_help="Change the frame rate or the timing.")
@batch_options
@click.option("--to-fps", type=_POSITIVE, help="Frame rate of the outputs, such as 24 or 23.976.")
@click.option(
    "--num-frames",
    "--frames",
    "frames",
    type=click.IntRange(1),
    help="Number of frames, over the same duration.",
)
@click.option(
    "--speed", type=_POSITIVE, help="Speed of the whole clip: 0.8 plays it a quarter longer."
)
@click.option(
    "--amount",
    "--slow",
    "slow",
    type=_SECONDS,
    help="Slow down where much happens: 0.25 makes a clip a quarter longer.",
)
@click.option(
    "--pairs",
    "--at",
    "pairs",
    type=When(),
    multiple=True,
    help="What happens at BEFORE seconds is to happen at AFTER; may be repeated.",
)
@click.option("--ease-in", type=_SECONDS, default=0.0, help="Seconds to leave rest at the start.")
@click.option("--ease-out", type=_SECONDS, default=0.0, help="Seconds to come to rest at the end.")
@click.option("--keep-duration", is_flag=True, help="Fit the new timing into the old duration.")
@click.option(
    "--method",
    type=click.Choice(["lgs", "cubic", "slerp"]),
    default="lgs",
    show_default=True,
    help="How poses between frames are found: smoothest, local cubic, or constant speed.",
)
@keep_contacts_option
@running_options
def command(
    batch: Batch,
    running: Running,
    to_fps: float | None,
    frames: int | None,
    speed: float | None,
    slow: float | None,
    pairs: tuple[tuple[float, float], ...],
    ease_in: float,
    ease_out: float,
    keep_duration: bool,
    method: str,
    keep_contacts: bool | None,
) -> None:
    """Change the frame rate, or when things happen; both if both are asked for.

    The first pose stays the first. --to-fps keeps all frames that the duration holds, so the last
    pose may fall between two frames; --frames keeps it.

    \b
    jaxmotion retime take.bvh -o film.bvh --to-fps 24
    jaxmotion retime take.bvh -o slower.bvh --speed 0.8
    jaxmotion retime takes -o slow --slow 0.25 --ease-out 0.5
    jaxmotion retime kick.bvh -o hit.bvh --at 0.8=1.0 --at 1.1=2.5
    """
    from jaxmotion.cli import _files
    from jaxmotion.cli._batch import run

    if to_fps is not None and frames is not None:
        raise click.UsageError("--to-fps and --frames both set the rate; give one of them")
    if (speed is not None) + (slow is not None) + bool(pairs) > 1:
        raise click.UsageError("--speed, --slow and --at all set the timing; give one of them")
    marks = [(0.0, 0.0), *(pairs[1:] if pairs[:1] == ((0.0, 0.0),) else pairs)]
    for (a, b), (c, d) in itertools.pairwise(marks):
        if c <= a or d <= b:
            told = f"{c:g}={d:g} does not come after {a:g}={b:g}"
            raise click.UsageError(f"--at must increase on both sides, from 0; {told}")
    warp, rate = {}, {}
    if speed is not None or slow is not None or pairs or ease_in or ease_out:
        ease = (ease_in, ease_out)
        warp = {"amount": slow, "pairs": pairs or None, "ease": ease}
    elif keep_duration:
        raise click.UsageError(
            "--keep-duration goes with --speed, --slow, --at, --ease-in or --ease-out"
        )
    if to_fps is not None or frames is not None:
        rate = {"fps": to_fps, "num_frames": frames}
    if not warp and not rate:
        asked = "--to-fps 24, --frames 300, --speed 0.8, --slow 0.25 or --at 1=1.5"
        raise click.UsageError(f"say what: {asked}")
    timing = Timing(warp, speed, keep_duration, rate, method)
    jobs = _files.plan(_files.expand(batch.files, avoid=batch.out), batch.out)
    run(partial(_retime, batch, timing, keep_contacts), jobs, batch, running)


def _retime(batch: Batch, timing: Timing, keep: bool | None, job: Job) -> "Effect":
    from jaxmotion.cli._compared import compared
    from jaxmotion.cli._feet import with_timed_feet
    from jaxmotion.cli._work import Clip, Effect, finite, read, write

    before = read(job.source, batch.reading, uses_up=True)
    retimed, source_frames = edit(before, timing)
    after, skate = with_timed_feet(before, retimed, source_frames, keep)
    write(finite(after), job.target, overwrite=batch.overwrite, up=batch.out_up)
    message = f"{_length(before)} to {_length(after)}"
    beside = compared({"before": before, "after": after}, batch.report, job.source.name)
    return Effect((Clip.of(before),), Clip.of(after), message, skate=skate, compared=beside)


def edit(motion: "Motion", timing: Timing) -> "tuple[Motion, ArrayLike]":
    """The library's time warp, then its resampling, as far as they are asked for, and the frame of
    the clip, a fraction too, that each frame of the result shows."""
    import numpy as np

    import jaxmotion as jm
    from jaxmotion.layers.time_warp import warped_frames
    from jaxmotion.timing.resample import resampled_frames

    result, at = motion, np.arange(motion.num_frames)
    if timing.warp:
        frames = motion.num_frames if timing.keep_duration else None
        warp, end = dict(timing.warp), float(motion.times[-1])
        if timing.speed is not None and end:
            warp["pairs"] = ((end, end / timing.speed),)
        result = jm.time_warp(motion, num_frames=frames, method=timing.method, **warp)
        at = warped_frames(motion, num_frames=frames, **warp)
    if timing.rate:
        of_result, _ = resampled_frames(result, **timing.rate)
        at = np.interp(of_result, np.arange(result.num_frames), at)
        result = jm.resample(result, method=timing.method, **timing.rate)
    return result, at


def _length(motion: "Motion") -> str:
    from jaxmotion.cli._work import duration

    rate = 1 / float(motion.frame_time)
    return f"{motion.num_frames} frames ({duration(motion):.4g} s at {rate:.5g} a second)"
