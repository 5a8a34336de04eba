"""``jaxmotion mirror``: left and right exchanged."""

from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from jaxmotion.cli._files import Job
from jaxmotion.cli._options import Batch, Reading, Running, batch_options, running_options

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion.cli._work import Effect


@click.command(short_help="Exchange left and right.")
@batch_options
@click.option(
    "--plane",
    type=click.Choice(["body", "x", "y", "z"]),
    default="body",
    show_default=True,
    help="Where the mirror stands: along the way the hips face in the first frame, so that it sets "
    "out alike, or across an axis of the world.",
)
@click.option(
    "--reference",
    type=click.Path(exists=True, dir_okay=False),
    help="A clip of the same joints that moves alike on both sides, such as a walk, for rigs whose "
    "rest pose does not show how joints of left and right lie.",
)
@running_options
def command(
    batch: Batch,
    running: Running,
    plane: Literal["body", "x", "y", "z"],
    reference: str | None,
) -> None:
    """Exchange left and right, as a mirror does: a turn to the left becomes one to the right.

    Bones keep their lengths.

    \b
    jaxmotion mirror turn.bvh -o turn-right.bvh
    jaxmotion mirror takes -o mirrored --plane x
    """
    from jaxmotion.cli import _files
    from jaxmotion.cli._batch import run

    jobs = _files.plan(_files.expand(batch.files, avoid=batch.out), batch.out)
    run(partial(_mirror, batch, plane, reference), jobs, batch, running)


def _mirror(
    batch: Batch, plane: Literal["body", "x", "y", "z"], reference: str | None, job: Job
) -> "Effect":
    import jaxmotion as jm
    from jaxmotion.cli._compared import compared
    from jaxmotion.cli._work import Clip, Effect, finite, read, write

    before = read(job.source, batch.reading, uses_up=True)
    walk = None if reference is None else _walk(Path(reference), batch.reading)
    after = jm.mirror(before, plane, reference=walk)
    write(finite(after), job.target, overwrite=batch.overwrite, up=batch.out_up)
    beside = compared({"before": before, "after": after}, batch.report, job.source.name)
    message = f"{before.num_frames} frames mirrored"
    return Effect((Clip.of(before),), Clip.of(after), message, compared=beside)


@lru_cache(maxsize=1)
def _walk(reference: Path, reading: Reading) -> "Motion":
    """The reference, which is read once for a whole folder."""
    from jaxmotion.cli._work import read

    return read(reference, reading, uses_up=True)
