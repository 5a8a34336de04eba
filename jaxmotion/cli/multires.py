"""``jaxmotion multires``: a motion's levels of detail, stronger or weaker or left out."""

import warnings
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from jaxmotion.cli._options import (
    Batch,
    Running,
    Selection,
    batch_options,
    keep_contacts_option,
    running_options,
    selection_options,
)
from jaxmotion.cli._terminal import Notice
from jaxmotion.cli._work import Edited

if TYPE_CHECKING:
    from jaxmotion import Motion


_DEEPEST = 6  # levels of detail, where nobody says how many


class Gains(click.ParamType):
    """``1,1.5,0.8``: numbers."""

    name = "G,G,..."

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """A tuple of floats."""
        if isinstance(value, tuple):
            return value
        try:
            return tuple(float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not of the form '1,1.5,0.8'", param, ctx)


@click.command(short_help="Exaggerate, soften or drop levels of detail.")
@batch_options
@click.option(
    "--gains",
    type=Gains(),
    help="How much of every level, coarse to fine: 1.5,1,1 exaggerates the broadest, 1,1,0 leaves "
    "out the finest. There are as many levels as numbers; a clip too short for them has the finest "
    "of them.",
)
@click.option(
    "--level",
    type=click.FloatRange(min=0),
    help="Keep this many levels of detail and part of the next: 0 is the coarse motion, 2.5 has "
    "two and a half.",
)
@click.option(
    "--levels",
    type=click.IntRange(0),
    help="Into how many levels to take a motion for --level; by default 6 or what it allows, and "
    "never more than it allows.",
)
@keep_contacts_option
@selection_options
@running_options
def command(
    batch: Batch,
    running: Running,
    selection: Selection,
    gains: tuple[float, ...] | None,
    level: float | None,
    levels: int | None,
    keep_contacts: bool | None,
) -> None:
    """Take a motion apart into a coarse motion and levels of detail, twice as fine each, and put
    it together with other shares of them.

    \b
    jaxmotion multires walk.bvh -o lively.bvh --gains 1,1.3,1.6,1.3,1
    jaxmotion multires takes -o smooth --level 4
    """
    from jaxmotion.cli._batch import edit_files

    if (gains is None) == (level is None):
        raise click.UsageError("say what: --gains 1,1.5,1, or --level 3; one of them")
    if gains is not None and levels is not None and levels != len(gains):
        raise click.UsageError(f"--levels {levels} and {len(gains)} --gains disagree")
    deepest = _DEEPEST if levels is None else levels
    if level is not None and level > deepest:
        there = f"there is {deepest} level" if deepest == 1 else f"there are {deepest} levels"
        raise click.UsageError(f"--level {level:g}: {there} of detail; --levels makes more")
    changes = partial(edit, gains=gains, level=level, levels=levels)
    edit_files(changes, batch, running, selection, keep=keep_contacts)


def edit(
    motion: "Motion",
    length: int,
    *,
    gains: tuple[float, ...] | None,
    level: float | None,
    levels: int | None,
) -> Edited:
    """The library's gains or level of detail on a padded clip, with no more levels than it has: the
    finest, which are as fine in a short clip as in a long one."""
    import numpy as np

    from jaxmotion.multiresolution import build_pyramid, level_of_detail, scale_details
    from jaxmotion.multiresolution.cascade import level_sizes
    from jaxmotion.multiresolution.pyramid import level_count

    wanted = len(gains) if gains is not None else levels
    most = len(level_sizes(length)) - 1
    number = level_count(length, wanted if wanted is None else min(wanted, most), "multires")
    if wanted is not None and number < wanted:
        text = f"{_counted(length, 'frame')}: {_counted(number, 'level')} of detail, not {wanted}"
        warnings.warn(text, Notice, stacklevel=2)
    pyramid = build_pyramid(motion, number, length=length)
    if gains is not None:
        edited = scale_details(pyramid, np.asarray(gains)[len(gains) - number :])
    else:
        edited = level_of_detail(pyramid, level or 0.0)
    return Edited(edited, lambda: {"levels": number})


def _counted(number: int, thing: str) -> str:
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
