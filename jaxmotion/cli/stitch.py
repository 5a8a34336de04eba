"""``jaxmotion stitch``: clips one after another, without a seam."""

from typing import TYPE_CHECKING

import click

from jaxmotion.cli._feet import with_feet
from jaxmotion.cli._joining import Joined, Joining, join, joining_options
from jaxmotion.cli._options import keep_contacts_option

if TYPE_CHECKING:
    from jaxmotion import Motion


@click.command(short_help="Join clips without a seam.")
@click.argument("files", nargs=-1, required=True, metavar="FILES...")
@click.option(
    "--search",
    type=click.FloatRange(min=0),
    default=1.0,
    show_default=True,
    help="Seconds that may be dropped on either side of a seam, to cut where it shows least; 0 "
    "drops none.",
)
@click.option(
    "--levels",
    type=click.IntRange(0),
    help="A transition takes about 2 frames, twice as many a level; by default half a second on "
    "either side.",
)
@click.option("--no-align", is_flag=True, help="Leave every clip where it stands and looks.")
@keep_contacts_option
@joining_options
def command(
    files: tuple[str, ...],
    search: float,
    levels: int | None,
    no_align: bool,
    keep_contacts: bool | None,
    joining: Joining,
) -> None:
    """Join FILES, in the order given; those of a folder or pattern, by name.

    Each clip is moved over the ground and turned to go on where the one before it ends.

    \b
    jaxmotion stitch walk.bvh turn.bvh run.bvh -o all.bvh
    """
    from jaxmotion.cli import _files

    def combine(clips: "list[Motion]") -> Joined:
        from jaxmotion.multiresolution.stitching import stitched

        seconds = float(clips[0].frame_time)
        found = stitched(clips, levels, align=not no_align, search=round(search / seconds))
        frames = found.motion.num_frames
        motion, skate = with_feet(found.end_to_end, found.motion, keep_contacts)
        dropped = sum(clip.num_frames for clip in clips) - len(clips) + 1 - frames
        seams = [{"frame": frame, "seconds": frame * seconds} for frame in found.seams]
        told = [f"frame {seam['frame']} ({seam['seconds']:.4g} s)" for seam in seams]
        text = f"{len(clips)} clips in {frames} frames, {dropped} dropped"
        text += f", seam{'s' * (len(seams) > 1)} at {', '.join(told)}" if seams else ""
        learned = {"dropped": dropped, "seams": seams}
        return Joined(motion, text, found.end_to_end, skate, learned)

    sources = [source.path for source in _files.expand(files, avoid=joining.out)]
    join(combine, sources, joining)
