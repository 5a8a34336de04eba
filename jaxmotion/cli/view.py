"""``jaxmotion view``: clips in a browser."""

from typing import TYPE_CHECKING

import click

from jaxmotion.cli._options import (
    Reading,
    Running,
    files_argument,
    reading_options,
    running_options,
)
from jaxmotion.cli._showing import Showing, names_of, showing_options

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion.contacts import Contacts

_MOST = 12


@click.command(short_help="Play clips in a browser.")
@files_argument
@reading_options
@click.option(
    "--contacts", is_flag=True, help="Mark when and where feet touch the floor, as found."
)
@showing_options
@running_options
def command(
    files: tuple[str, ...], running: Running, reading: Reading, contacts: bool, showing: Showing
) -> None:
    """Play clips in a browser: one page that needs nothing else, and can be sent on as it is.

    Several clips play together, one over the other or side by side.

    \b
    jaxmotion view walk.bvh
    jaxmotion view take.bvh clean/take.bvh
    jaxmotion view walk.bvh --contacts -o walk.html --no-open
    """
    from jaxmotion.cli._files import expand
    from jaxmotion.cli._reading import each

    inputs = expand(files)
    if len(inputs) > _MOST:
        raise click.UsageError(f"{len(inputs)} clips; one page shows {_MOST} at most")
    showing.check([item.path for item in inputs])
    found = [item for item in each(inputs, reading, running, uses_up=True) if item.motion]
    if not found:
        raise click.exceptions.Exit(1)
    names = names_of([item.path for item in found])
    clips = {name: item.motion for name, item in zip(names, found, strict=True) if item.motion}
    from jaxmotion.viz import player

    marks = {name: _feet(clip) for name, clip in clips.items()} if contacts else None
    page = player(clips, contacts=marks, title=", ".join(clips))
    showing.show(page.html, found[0].path.stem)
    raise click.exceptions.Exit(1 if len(found) < len(inputs) else 0)


def _feet(motion: "Motion") -> "Contacts":
    from jaxmotion.cli._feet import find_feet
    from jaxmotion.cli._padding import pad, unpadded_contacts

    padded, length = pad(motion)
    return unpadded_contacts(find_feet(padded, length), length)
