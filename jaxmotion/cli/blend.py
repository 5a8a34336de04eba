"""``jaxmotion blend``: what one clip has and another lacks, put onto a third."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from jaxmotion.cli._feet import with_feet
from jaxmotion.cli._joining import Joined, Joining, a_file, join, joining_options
from jaxmotion.cli._options import keep_contacts_option

if TYPE_CHECKING:
    from jaxmotion import Motion


@click.command(short_help="Give a clip what another one has.")
@click.argument("reference", type=a_file(exists=True))
@click.argument("first", type=a_file(exists=True))
@click.argument("second", type=a_file(exists=True))
@click.option(
    "--levels", type=click.IntRange(0), help="Levels of detail; by default 6 or what a clip allows."
)
@keep_contacts_option
@joining_options
def command(
    reference: Path,
    first: Path,
    second: Path,
    levels: int | None,
    keep_contacts: bool | None,
    joining: Joining,
) -> None:
    """Write SECOND with what FIRST has and REFERENCE lacks: of a walk, a limp and a turn, a
    limping turn.

    The clips must have one skeleton and number of frames, and do alike at the same time: see
    jaxmotion align.

    \b
    jaxmotion blend walk.bvh limp.bvh turn.bvh -o limping-turn.bvh
    """

    def combine(clips: "list[Motion]") -> Joined:
        from jaxmotion.multiresolution import blend

        lengths = [clip.num_frames for clip in clips]
        if len(set(lengths)) > 1:
            numbers = ", ".join(map(str, lengths))
            raise click.ClickException(
                f"the clips have {numbers} frames; jaxmotion align gives one the timing of another"
            )
        mixed, frames = blend(*clips, levels=levels), clips[0].num_frames
        motion, skate = with_feet(clips[-1], mixed, keep_contacts)
        return Joined(motion, f"{frames} frames", clips[-1], skate)

    join(combine, [reference, first, second], joining, edited=2)
