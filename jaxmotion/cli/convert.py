"""``jaxmotion convert``: from any format that is read to any that is written."""

from functools import partial
from typing import TYPE_CHECKING, Any

import click

from jaxmotion.cli._files import Job
from jaxmotion.cli._options import Batch, Running, batch_options, format_option, running_options

if TYPE_CHECKING:
    from jaxmotion.cli._work import Effect


@click.command(short_help="Change the file format.")
@batch_options
@format_option
@click.option(
    "--no-still-positions",
    is_flag=True,
    help="In BVH, leave out the positions of joints that never move: their places become OFFSETs, "
    "as three.js, pybvh and others want it. The root keeps its own.",
)
@running_options
def command(batch: Batch, running: Running, to: str | None, no_still_positions: bool) -> None:
    """Change the file format: BVH, ASF/AMC, AMASS (read only) and our own npz.

    \b
    jaxmotion convert take.bvh -o take.amc            (writes take.asf too)
    jaxmotion convert cmu -o bvh --to bvh --fps 120   (a folder)
    jaxmotion convert blender.bvh -o take.bvh --up z  (stands along z; turned to y up)
    """
    from jaxmotion.cli import _files
    from jaxmotion.cli._batch import run
    from jaxmotion.io.formats import SUFFIXES

    inputs = _files.expand(batch.files, avoid=batch.out)
    if to is None and (batch.out.suffix.lower() not in SUFFIXES or batch.out.is_dir()):
        raise click.UsageError("which format? --to bvh, amc or npz")
    jobs = _files.plan(inputs, batch.out, to=to)
    options = {"still_positions": False} if no_still_positions else {}
    if options and any(job.target.suffix.lower() != ".bvh" for job in jobs):
        raise click.UsageError("--no-still-positions goes with outputs in BVH")
    run(partial(_convert, batch, options), jobs, batch, running)


def _convert(batch: Batch, options: dict[str, Any], job: Job) -> "Effect":
    from jaxmotion.cli._work import Clip, Effect, read, write

    motion = read(job.source, batch.reading)
    write(motion, job.target, overwrite=batch.overwrite, up=batch.out_up, **options)
    return Effect((Clip.of(motion),), Clip.of(motion))
