"""``jaxmotion convert``: from any format that is read to any that is written."""

from functools import partial

import click

from jaxmotion.cli._files import Job
from jaxmotion.cli._options import Batch, Running, batch_options, format_option, running_options


@click.command(short_help="Change the file format.")
@batch_options
@format_option
@running_options
def command(batch: Batch, running: Running, to: str | None) -> None:
    """Change the file format: BVH, ASF/AMC, AMASS (read only) and our own npz.

    \b
    jaxmotion convert take.bvh -o take.amc            (writes take.asf too)
    jaxmotion convert cmu -o bvh --to bvh --fps 120   (a folder)
    jaxmotion convert blender.bvh -o take.bvh --up z  (stands along z; turned to y up)
    """
    from jaxmotion.cli import _files
    from jaxmotion.cli._batch import run

    inputs = _files.expand(batch.files, avoid=batch.out)
    if to is None and (batch.out.suffix.lower() not in _files.SUFFIXES or batch.out.is_dir()):
        raise click.UsageError("which format? --to bvh, amc or npz")
    jobs = _files.plan(inputs, batch.out, to=to)
    run(partial(_convert, batch), jobs, batch, running)


def _convert(batch: Batch, job: Job) -> None:
    from jaxmotion.cli._work import read, write

    write(read(job.source, batch.reading), job.target, overwrite=batch.overwrite, up=batch.out_up)
