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
@click.option(
    "--metres",
    type=click.FloatRange(min=0, min_open=True),
    help="Of a unit of length of the inputs, for .glb (whose lengths are multiplied by it), .usda "
    "and .usdc (which say it): 0.01 for centimetres.  [default: what the input says; else guessed "
    "from the figure's height]",
)
@running_options
def command(
    batch: Batch,
    running: Running,
    to: str | None,
    no_still_positions: bool,
    metres: float | None,
) -> None:
    """Change the file format: BVH, ASF/AMC, AMASS (read only) and our own npz; and glTF (.glb) and
    USD (.usda, .usdc), which are written only, for Blender, engines and viewers.

    \b
    jaxmotion convert take.bvh -o take.amc            (writes take.asf too)
    jaxmotion convert cmu -o bvh --to bvh --fps 120   (a folder)
    jaxmotion convert blender.bvh -o take.bvh --up z  (stands along z; turned to y up)
    jaxmotion convert take.bvh -o take.glb --metres 0.01   (of centimetres; to look at in Blender)
    """
    from jaxmotion.cli import _files
    from jaxmotion.cli._batch import run
    from jaxmotion.io.formats import WRITTEN, for_other_programs

    inputs = _files.expand(batch.files, avoid=batch.out)
    if to is None and (batch.out.suffix.lower() not in WRITTEN or batch.out.is_dir()):
        raise click.UsageError(f"which format? --to {', '.join(suffix[1:] for suffix in WRITTEN)}")
    jobs = _files.plan(inputs, batch.out, to=to)
    options: dict[str, Any] = {}
    if no_still_positions:
        options["still_positions"] = False
        if any(job.target.suffix.lower() != ".bvh" for job in jobs):
            raise click.UsageError("--no-still-positions goes with outputs in BVH")
    if metres is not None:
        options["metres"] = metres
        if not all(for_other_programs(job.target) for job in jobs):
            raise click.UsageError("--metres goes with outputs in glTF or USD")
    run(partial(_convert, batch, options), jobs, batch, running)


def _convert(batch: Batch, options: dict[str, Any], job: Job) -> "Effect":
    from jaxmotion.cli._work import Clip, Effect, read, write

    motion = read(job.source, batch.reading)
    write(motion, job.target, overwrite=batch.overwrite, up=batch.out_up, **options)
    return Effect((Clip.of(motion),), Clip.of(motion))
